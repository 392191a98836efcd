"""Free runs: the right model stays near the measured motion, a wrong one leaves it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from open_loop_cases import axis, conditioned, item, recorded

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.outcome.free_run import (
    free_run,
    independent,
    moves_worse,
    telling_horizon,
    typical,
    usable_horizon,
)
from tcs_friction.physics.terms import Instance


@pytest.fixture(scope="module")
def plain() -> DataSet:
    return conditioned(recorded(axis()))


def test_the_right_model_follows_the_motion(plain: DataSet) -> None:
    """The start's velocity noise times the horizon bounds the error, a few times over for smoothing at reversals."""
    assert free_run(plain, axis()) < 1e-4 * np.ptp(plain.joined("position"))


def test_wrong_parameters_leave_it(plain: DataSet) -> None:
    right = free_run(plain, axis())
    assert free_run(plain, axis().with_friction({"coulomb": 70.0, "static": 100.0})) > 10.0 * right
    assert free_run(plain, replace(axis(), inertia=1050.0)) > 10.0 * right


@pytest.mark.parametrize(
    "effect",
    [
        item("transport_delay", delay=0.02),
        item("flexible_mode", frequency=6.0, damping=0.05, inertia_ratio=0.4),
        item("cable_hysteresis", amplitude=20.0, width=0.05),
        item("warmup_drift", dry=0.5, time_constant=30.0),
        item("encoder_periodic_error", order=40.0, amplitude=2e-4, phase=0.7),
    ],
    ids=lambda e: str(e.term.id),
)
def test_what_terms_remember_is_carried_into_the_windows(effect: Instance) -> None:
    r = recorded(axis(*([effect] if effect.term.id != "encoder_periodic_error" else [])))
    if effect.term.id == "encoder_periodic_error":
        order, amplitude, phase = (effect.values[name] for name in ("order", "amplitude", "phase"))
        r = replace(r, position=r.position + amplitude * np.sin(order * r.position + phase))
    data = conditioned(r)
    assert free_run(data, axis(effect)) < 0.3 * free_run(data, axis())


def test_a_second_body_is_where_the_shaft_left_it_when_a_window_begins() -> None:
    """Half a step between them on a stiff contact is a torque that outweighs the collisions themselves."""
    backlash = item("backlash", gap=2e-3, inertia_ratio=0.3, contact_frequency=40.0, contact_damping=0.7)
    data = conditioned(recorded(axis(backlash)))
    assert free_run(data, axis(backlash), 0.25) < 0.5 * free_run(data, axis(), 0.25)


def test_a_longer_horizon_strays_further(plain: DataSet) -> None:
    wrong = axis().with_friction({"coulomb": 70.0, "static": 100.0})
    assert free_run(plain, wrong, 0.25) < 0.5 * free_run(plain, wrong, 1.0)


def test_two_axes_are_told_apart_over_a_shorter_time_where_all_models_stray_from_each_start() -> None:
    mode = item("flexible_mode", frequency=20.0, damping=0.02, inertia_ratio=0.3)
    data = conditioned(recorded(axis(mode), duration=80.0))
    wrong = axis(mode).with_friction({"coulomb": 70.0, "static": 100.0})
    assert telling_horizon(data, axis(mode), wrong) == usable_horizon(data) == 1.0
    assert telling_horizon(data, wrong, axis(mode)) == 1.0
    assert telling_horizon(data, axis(mode), axis(mode)) == 1.0
    short = telling_horizon(data, axis(mode), axis())
    assert 2.0 / data.cutoff <= short < 1.0
    assert free_run(data, axis(mode), short) < free_run(data, axis(), short)


def test_a_model_that_runs_away_has_a_number(plain: DataSet) -> None:
    runaway = axis(item("cable_wrap", stiffness=-1e6))
    error = free_run(plain, runaway)
    assert math.isfinite(error)
    assert error <= np.ptp(plain.joined("position"))
    assert error > 0.1 * np.ptp(plain.joined("position"))


def test_the_horizon_shrinks_to_what_is_held_out() -> None:
    data = conditioned(recorded(axis(), duration=8.0))
    assert 0.0 < usable_horizon(data) < 1.0
    assert free_run(data, axis()) > 0.0


def test_without_held_out_data_nothing_is_claimed() -> None:
    data = prepare([recorded(axis(), duration=8.0)], held_out=False)
    assert usable_horizon(data) == 0.0
    assert free_run(data, axis()) == 0.0


def test_training_data_do_not_matter(plain: DataSet) -> None:
    """Windows lie in held-out data only: torque changed far behind the last of them changes nothing."""
    (s,) = plain.stretches
    last = int(np.flatnonzero(s.held_out)[-1]) * plain.stride
    torque = s.torque.copy()
    torque[last + 1 :] += 1e3
    changed = replace(plain, stretches=(replace(s, torque=torque),))
    assert free_run(changed, axis()) == free_run(plain, axis())


def test_a_model_moves_worse_if_its_errors_are_larger_by_more_than_chance() -> None:
    rng = np.random.default_rng(0)
    first = rng.lognormal(size=80)
    false_alarms = sum(moves_worse(first, rng.permutation(first)) for _ in range(500))
    assert false_alarms <= 15, "one in a hundred"
    assert moves_worse(1.01 * first, first), "by little, but in every window"
    assert not moves_worse(first, 1.01 * first)
    far = first.copy()
    far[:5] *= 1e6
    assert not moves_worse(far, first), "in a few windows only"
    assert not moves_worse(first, first)
    assert not moves_worse(np.zeros(0), np.zeros(0))


def test_windows_that_resemble_their_neighbours_are_fewer_than_they_seem() -> None:
    """One in a hundred is a false alarm, where Student's t of all of them gives one in ten."""
    rng, alarms, runs = np.random.default_rng(2), 0, 1000
    for _ in range(runs):
        shocks, ratios = rng.standard_normal(100), np.zeros(100)
        for k in range(100):
            ratios[k] = 0.6 * ratios[k - 1] * (k > 0) + shocks[k]
        alarms += moves_worse(np.exp(ratios), np.ones(100))
    assert alarms < 0.03 * runs
    assert independent(rng.standard_normal(400)) > 200.0
    assert independent(np.ones(5)) == 5.0


def test_the_typical_error_is_not_that_of_a_few_windows() -> None:
    assert typical(np.array([2.0, 2.0, 2.0, 2.0])) == pytest.approx(2.0)
    assert typical(np.array([1.0, 1.0, 1.0, 1e4])) == pytest.approx(10.0)
    assert typical(np.zeros(0)) == 0.0
    assert typical(np.array([0.0, 1.0])) >= 0.0
