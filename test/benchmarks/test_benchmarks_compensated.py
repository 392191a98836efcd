"""The benchmark of compensation: its axes are those of the concealed worlds, and its spoilt models are wrong."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.compensated import cancellable, draw, true_axis
from benchmarks.compensated_tracking import SETTLE, Bench, Choice, motions, spoilt
from benchmarks.worlds import draw_world
from tcs_friction.control.model_compensator import effect_names


def test_every_effect_that_can_be_cancelled_is_drawn_alone_and_some_in_pairs() -> None:
    worlds = draw(40, 0)
    alone = {chosen[0] for chosen, _, _ in worlds if len(chosen) == 1}
    assert alone == set(cancellable())
    assert {"backlash", "wind_torque", "temperature_dependent_friction", "stribeck"}.isdisjoint(alone)
    assert sum(len(chosen) == 2 for chosen, _, _ in worlds) == 12
    assert len({size for _, size, _ in worlds}) == 3


def test_motions_begin_where_the_axis_is_and_are_longer_than_they_settle() -> None:
    for reference in motions(0.3):
        assert reference.duration > 2.0 * SETTLE
        assert abs(float(reference.over(np.array([0.0]))[0, 0]) - 0.3) <= 0.5


@pytest.mark.filterwarnings("ignore")
def test_the_truth_is_cancelled_and_the_guard_lets_no_spoilt_model_pass() -> None:
    rng = np.random.default_rng(0)
    world = draw_world(rng, ("cogging",), 6.0, 0.2)
    true = true_axis(world)
    bench = Bench(true, world.believed.axis, 0.0, world.recording)
    start = Choice(world.believed.axis, ())
    before = bench.tracking(start).rms
    assert bench.tracking(Choice(true, ("cogging",))).rms < 0.97 * before
    wrong = spoilt(true, rng)
    assert set(wrong) == {"sign", "phase", "ghost", "ghost of the encoder"}
    assert bench.tracking(Choice(wrong["sign"], ("cogging",))).rms > before
    for model in wrong.values():
        kept = bench.guarded(start, model, list(effect_names(model)))
        assert bench.tracking(kept).rms < 1.02 * before
