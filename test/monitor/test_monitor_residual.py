"""The residual of an axis that runs: the torque noise alone where the model is exact, and what the model has wrong else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tcs_friction.config import load_axis, shipped
from tcs_friction.control.loop import LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.reference import Reference, reference_from_mapping
from tcs_friction.monitor.baseline import moving
from tcs_friction.monitor.residual import (
    COLUMNS,
    DIRECTION,
    END,
    INERTIAL,
    PLACE,
    RESIDUAL,
    SETTLING,
    SLOWEST,
    SPEED,
    SURROUNDINGS,
    direction_resolution,
    evaluator,
    follow,
    interrupt,
)
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance

Array = NDArray[np.float64]
PERIOD = 1e-3
DRY = ("coulomb", "static")
FILE = load_axis(shipped("azimuth_1p2m.yaml"))
WARM = instance(effect("temperature_dependent_friction"), {"dry": -0.01, "viscous": 0.0, "reference_temperature": 20.0})
AXIS = FILE.axis.with_effect(WARM)


def reference(duration: float = 24.0) -> Reference:
    return reference_from_mapping({"kind": "sinusoid", "amplitude": 0.03, "period": 12.0, "duration": duration}, "reference")


@pytest.fixture(scope="module")
def temperature() -> Array:
    return np.linspace(20.0, 30.0, 24_001)


@pytest.fixture(scope="module")
def run(temperature: Array) -> LoopRun:
    assert FILE.control is not None
    return simulate_loop(AXIS, reference(), FILE.control.controller, LoopConfig(), temperature=temperature)


def followed(axis: Axis, run: LoopRun, temperature: Array, pieces: int = 1) -> Array:
    """The blocks (n, COLUMNS), made of so many pieces of the run."""
    state, rows = evaluator(axis, PERIOD), []
    for q, u, t in zip(*(np.array_split(x, pieces) for x in (run.position, run.torque, temperature)), strict=True):
        out = np.empty((len(q) // 20 + 2, COLUMNS))
        rows.append(out[: follow(state, q, u, t[:, None].copy(), out)])
    return np.concatenate(rows)


def test_the_exact_model_leaves_the_torque_noise(run: LoopRun, temperature: Array) -> None:
    rows = followed(AXIS, run, temperature)
    judged = rows[moving(rows)]
    assert len(judged) > 0.8 * len(rows)
    assert abs(judged[:, RESIDUAL].mean()) < 0.05
    assert judged[:, RESIDUAL].std() < 1.1 * AXIS.drive.noise


def test_blocks_have_the_motion_at_their_middle(run: LoopRun, temperature: Array) -> None:
    rows = followed(AXIS, run, temperature)
    late = 4.0 / (2.0 * np.pi * 46.0) + 0.01  # of four poles, half a block
    assert rows[50:, PLACE] == pytest.approx(np.interp(rows[50:, END] - late, run.t, run.true_position), abs=5e-5)
    assert rows[50:, SPEED] == pytest.approx(np.interp(rows[50:, END] - late, run.t, run.true_velocity), abs=2e-4)


def test_pieces_give_what_the_whole_gives(run: LoopRun, temperature: Array) -> None:
    assert np.array_equal(followed(AXIS, run, temperature), followed(AXIS, run, temperature, 7))


@pytest.mark.parametrize(
    ("change", "part", "share"),
    [
        (lambda axis: replace(axis, inertia=1.05 * axis.inertia), INERTIAL, 1 / 1.05 - 1),
        (lambda axis: axis.with_friction({n: 0.9 * axis.friction.values[n] for n in DRY}), DIRECTION, 1 / 0.9 - 1),
        (lambda axis: replace(axis, effects=axis.effects[:-1]), None, 1.0),
    ],
    ids=["inertia", "friction", "temperature"],
)
def test_what_a_model_has_wrong_is_in_proportion_to_its_part(
    run: LoopRun, temperature: Array, change: object, part: int | None, share: float
) -> None:
    rows, exact = followed(change(AXIS), run, temperature), followed(AXIS, run, temperature)  # type: ignore[operator]
    judged = moving(rows) & moving(exact)
    more = rows[judged, RESIDUAL] - exact[judged, RESIDUAL]
    expected = share * rows[judged, part] if part is not None else exact[judged, SURROUNDINGS]
    assert np.ptp(expected) > 0.5
    assert more == pytest.approx(expected, abs=0.12 * np.ptp(expected))


def test_reversals_and_the_settling_filter_are_not_judged(run: LoopRun, temperature: Array) -> None:
    rows = followed(AXIS, run, temperature)
    assert not rows[rows[:, END] < SETTLING, SLOWEST].any()
    turns = run.t[1:][np.diff(np.sign(run.true_velocity[:])) != 0]
    for turn in turns[(turns > 2.0) & (turns < 23.0)]:
        assert not rows[(rows[:, END] > turn + 0.02) & (rows[:, END] < turn + 0.08), SLOWEST].any()


def test_an_interruption_is_not_bridged(run: LoopRun, temperature: Array) -> None:
    state, out = evaluator(AXIS, PERIOD), np.empty((1000, COLUMNS))
    one = temperature[:, None].copy()
    first = follow(state, run.position[:8000], run.torque[:8000], one[:8000], out)
    interrupt(state, 4.0)
    second = follow(state, run.position[12_000:], run.torque[12_000:], one[12_000:], out[first:])
    rows = out[: first + second]
    assert rows[first, END] == pytest.approx(12.02, abs=1e-6)
    assert not rows[first : first + 14, SLOWEST].any()
    judged = rows[moving(rows)]
    assert np.abs(judged[:, RESIDUAL]).max() < 6.0 * AXIS.drive.noise


@pytest.mark.parametrize("name", ["coulomb_viscous", "dahl_viscous", "stribeck_static"])
def test_other_laws_are_followed(name: str) -> None:
    declared = law(name)
    known = FILE.axis.friction.values
    values = {p.name: known[p.name] for p in declared.parameters if p.name in known}
    axis = replace(FILE.axis, friction=instance(declared, values))
    assert FILE.control is not None
    run = simulate_loop(axis, reference(6.0), FILE.control.controller, LoopConfig())
    rows = followed(axis, run, np.full(len(run.t), 20.0))
    judged = rows[moving(rows)]
    assert len(judged) > 0.6 * len(rows)
    assert abs(judged[:, RESIDUAL].mean()) < 0.1
    assert judged[:, RESIDUAL].std() < 1.5 * axis.drive.noise


def test_an_axis_that_nobody_knows_the_noise_of_has_a_resolution() -> None:
    assert direction_resolution(replace(AXIS, sensors=replace(AXIS.sensors, noise=0.0, resolution=0.0)), PERIOD) > 0.0
    assert direction_resolution(AXIS, PERIOD) < 1e-5
