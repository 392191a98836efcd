"""What a data set can carry: units that cannot be right are refused, limits are said, and good data have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from open_loop_cases import PERIOD, along, axis, conditioned, item, recorded, scaled

from tcs_friction.conditioning.checks import check_units
from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.dataset.excitation import barred, count_reversals, lacking, limits, passed_once
from tcs_friction.errors import InputError
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Need
from tcs_friction.recording.recording import Recording

T = PERIOD * np.arange(20000)


@pytest.fixture(scope="module")
def good() -> Recording:
    return recorded(axis())


def test_good_data_have_no_limits(good: Recording) -> None:
    travel = scaled(good, position=20.0)
    data = conditioned(travel)
    assert limits(data, axis()) == ()
    assert barred(lacking(data, axis())) == frozenset()


def found(position: np.ndarray) -> DataSet:
    torque = (
        60.0 * np.sign(np.gradient(position))
        + 5.0 * np.sin(T)
        + 1000.0 * np.gradient(np.gradient(position, PERIOD), PERIOD)
    )
    return conditioned(along(position, torque))


def test_one_direction_only() -> None:
    data = found(0.1 * T + 0.05 * np.sin(T))
    assert any("never reverses" in line and "positive" in line for line in limits(data, axis()))
    wanted = {"presliding", "coulomb_asymmetry", "backlash", "torque_bias", "position_dependent_friction"}
    assert wanted <= barred(lacking(data, axis()))
    assert count_reversals(data) == 0


def test_the_other_direction_is_named() -> None:
    assert any("negative" in line for line in limits(found(-0.1 * T - 0.05 * np.sin(T)), axis()))


def test_few_reversals() -> None:
    data = found(np.sin(2.0 * np.pi * T / 40.0 + 0.1))
    assert count_reversals(data) == 2
    assert any("reverses only 2 times" in line for line in limits(data, axis()))
    assert "presliding" in barred(lacking(data, axis()))
    assert "coulomb_asymmetry" not in barred(lacking(data, axis()))


def test_one_speed() -> None:
    data = found(0.2 * T + 1e-5 * np.sin(T))
    assert any("one speed" in line for line in limits(data, axis()))
    assert "stribeck" in barred(lacking(data, axis()))


def test_no_acceleration_leaves_the_inertia_open() -> None:
    data = found(4.0 * np.sin(2.0 * np.pi * T / 500.0))
    light = replace(axis(), inertia=0.1)
    assert any("inertia is not determined" in line for line in limits(data, light))
    assert "flexible_mode" in barred(lacking(data, light))


def test_one_sinusoid_leaves_open_what_follows_the_position() -> None:
    swing = 0.3 * np.sin(T)
    data = found(swing)
    assert any("swings like one sinusoid" in line for line in limits(data, axis()))
    assert {"cable_wrap", "imbalance"} <= barred(lacking(data, axis()))
    assert "imbalance" not in barred(lacking(found(swing + 0.1 * np.sin(3.0 * T)), axis()))


def test_short_and_narrow() -> None:
    data = conditioned(scaled(recorded(axis(), duration=8.0), position=0.1))
    lines = limits(data, axis())
    assert any("lasts only" in line for line in lines)
    assert any("of a turn" in line for line in lines)
    assert "warmup_drift" in barred(lacking(data, axis()))


def test_hardly_moving_names_nothing_that_moves() -> None:
    rng = np.random.default_rng(3)
    r = Recording(
        t=T, position=1e-6 * rng.standard_normal(len(T)), torque=rng.standard_normal(len(T)), source="bag"
    )
    data = prepare([r])
    with pytest.raises(InputError, match="nothing but noise"):
        check_units(data, axis())
    assert any("hardly moves" in line for line in limits(data, axis()))
    assert {"backlash", "stribeck", "presliding"} <= barred(lacking(data, axis()))


def test_every_need_is_some_effect_s(good: Recording) -> None:
    """And a whole recording meets them all."""
    assert set(Need) == frozenset().union(*(term.needs for term in effects().values()))
    assert barred(lacking(prepare([good]), axis())) == {"position_dependent_inertia"}  # it covers less than a tenth of a turn


def test_a_place_that_the_axis_passed_once_is_said(good: Recording) -> None:
    """The middle of a to and fro is passed again and again, in its first seconds once."""
    whole, part = prepare([good]), prepare([good.part(slice(0, 1500))])
    middle = 0.5 * float(part.joined("position").min() + part.joined("position").max())
    bump = item("local_friction_bump", amplitude=0.3, centre=middle, width=0.01)
    assert passed_once(whole, [bump, item("torque_bias", bias=1.0)]) == ()
    (line,) = passed_once(part, [bump])
    assert "local friction bump" in line
    assert "once" in line
