"""What compensation is worth, predicted: the interval holds the truth, and is as wide as what is not known asks for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tcs_friction.config import default_control
from tcs_friction.control.loop import Cancellation, LoopConfig, simulate_loop
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.control.spread import FRICTION, INERTIA, Spread, drawn
from tcs_friction.control.worth import ALL, LAW, LEAST_DRAWS, NOTHING, Task, Worth, shown_error, worth
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance

LUGRE = {"coulomb": 7.0, "static": 9.0, "stribeck_velocity": 5e-3, "stiffness": 9000.0, "damping": 60.0, "viscous": 11.0}
NAMES = tuple((FRICTION, name) for name in ("coulomb", "static", "viscous"))
SIZES = np.array([0.3, 0.4, 1.0])


def axis(noise: float = 0.02) -> Axis:
    return Axis(
        "axis", 4.2, instance(law("lugre"), LUGRE), sensors=Sensors(noise=1e-6), drive=Drive(limit=200.0, noise=noise)
    )


def task(model: Axis) -> Task:
    reference = Reference(Sinusoid(amplitude=0.05, period=3.0, duration=5.0))
    return Task(reference, default_control(model).controller, LoopConfig(period=2e-3), ObserverSettings(), settle=1.0)


def spread(scale: float = 1.0) -> Spread:
    correlation = np.eye(3)
    correlation[0, 1] = correlation[1, 0] = 0.6
    return Spread(NAMES, correlation * np.outer(scale * SIZES, scale * SIZES))


@cache
def predicted(noise: float, scale: float, draws: int = LEAST_DRAWS) -> Worth:
    return worth(axis(noise), task(axis()), spread=spread(scale), draws=draws)


def gain_of(true: Axis, seed: int) -> float:
    model, sizes = axis(), []
    for kind in ("none", "model"):
        one = task(model)
        loop = replace(one.loop, compensation=kind)
        run = simulate_loop(true, one.reference, one.controller, loop, seed=seed, cancellation=Cancellation(model))
        sizes.append(float(np.std((run.reference - run.true_position)[run.t >= one.settle])))
    return sizes[1] / sizes[0]


def test_the_gain_of_axes_that_could_be_true_lies_in_the_interval() -> None:
    low, high = predicted(0.02, 1.0).stage(LAW).gain_between or (0.0, 0.0)
    true = drawn(axis(), task(axis()).controller, spread(), 30, 99)
    gains = np.array([gain_of(one, 1000 + k) for k, (one, _) in enumerate(true)])
    inside = int(np.sum((gains >= low) & (gains <= high)))
    assert inside >= 21, "of 30 at 90 % there are 20 or fewer with a probability of 0.05 %"
    assert high / low > 1.3
    best = worth(axis(), task(axis()), draws=0).stage(LAW).gain
    assert best < np.median(gains), "parameters taken as exact promise too much"


def test_a_larger_covariance_makes_a_wider_interval_about_a_larger_error() -> None:
    small, large = (predicted(0.02, scale).stage(LAW) for scale in (0.5, 2.0))
    assert small.gain_between is not None
    assert large.gain_between is not None
    assert np.diff(large.gain_between) > 2.0 * np.diff(small.gain_between)
    assert large.gain > small.gain


def test_noise_of_the_drive_raises_the_floor() -> None:
    quiet, loud = (worth(axis(noise), task(axis()), draws=LEAST_DRAWS) for noise in (0.02, 1.0))
    assert loud.stage(LAW).rms > 2.0 * quiet.stage(LAW).rms
    low, high = loud.stage(LAW).between or (0.0, 0.0)
    assert low < high, "each draw has noise of its own"
    assert quiet.stage(LAW).measured > 0.0


def test_each_stage_is_compared_within_its_draw() -> None:
    model = axis().with_effect(instance(effect("torque_bias"), {"bias": 0.0}))
    found = worth(model, task(model), spread=spread(), draws=LEAST_DRAWS)
    assert [stage.name for stage in found.stages] == [NOTHING, LAW, ALL]
    assert found.stage(NOTHING).gain == 1.0
    assert found.stage(NOTHING).gain_between == (1.0, 1.0)
    assert found.beyond == (pytest.approx(1.0), pytest.approx((1.0, 1.0))), "an effect of size 0 changes no draw"
    assert found.draws == LEAST_DRAWS


def test_the_run_that_is_shown_is_the_median_draw() -> None:
    found = predicted(0.02, 1.0).stages[-1]
    counted = found.run.t >= 1.0
    shown = np.sqrt(np.mean((found.run.reference - found.run.true_position)[counted] ** 2))
    assert shown == pytest.approx(found.rms)


def test_without_draws_there_is_no_interval() -> None:
    found = worth(axis(), task(axis()), draws=0)
    assert [stage.name for stage in found.stages] == [NOTHING, LAW], "no effects"
    assert found.beyond is None
    assert all(stage.between is None and stage.gain_between is None for stage in found.stages)
    assert shown_error(axis(), task(axis()), NOTHING, {}, None, 0) == (found.stage(NOTHING).measured, None)


def test_the_error_that_an_encoder_shows_is_the_same_by_itself_and_among_all() -> None:
    found = predicted(0.02, 1.0)
    alone = shown_error(axis(), task(axis()), ALL, {}, spread(), LEAST_DRAWS)
    assert alone == shown_error(axis(), task(axis()), ALL, {}, spread(), LEAST_DRAWS, found)
    assert alone == (found.stage(LAW).measured, found.stage(LAW).measured_between), "everything is the law, without effects"


def test_progress_ends_at_all_and_a_run_that_is_over_before_it_counts_is_refused() -> None:
    shares: list[float] = []
    worth(axis(), task(axis()), spread=Spread((INERTIA,), np.array([[0.01]])), draws=LEAST_DRAWS, progress=shares.append)
    assert shares[-1] == 1.0
    assert len(shares) == LEAST_DRAWS
    with pytest.raises(InputError, match="settle: 6 s"):
        worth(axis(), replace(task(axis()), settle=6.0))
