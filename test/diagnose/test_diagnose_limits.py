"""Bad input: one clear line, or what the data cannot show; never a complaint about good data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from proof_cases import PERIOD, along, axis, conditioned, item, recorded, scaled

from tcs_friction.config import load_axis
from tcs_friction.diagnose.dataset.excitation import barred, check_units, count_reversals, limits, passed_once
from tcs_friction.diagnose.dataset.preprocessing import Conditioned, condition
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording

T = PERIOD * np.arange(20000)


@pytest.fixture(scope="module")
def good() -> Recording:
    return recorded(axis())


def refused(r: Recording, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        condition([r])
    assert "\n" not in str(caught.value)


def test_constant_position_is_refused(good: Recording) -> None:
    refused(replace(good, position=np.zeros(len(good))), "never changes")


def test_chatter_of_few_encoder_steps_is_refused(good: Recording) -> None:
    chatter = np.random.default_rng(0).integers(0, 3, len(good)) * 1e-6
    refused(replace(good, position=chatter), "only 3 values")


@pytest.mark.parametrize("level", [0.0, 2.5])
def test_constant_torque_is_refused(good: Recording, level: float) -> None:
    refused(replace(good, torque=np.full(len(good), level)), "torque is constant")


def test_too_short_is_refused(good: Recording) -> None:
    refused(good.part(slice(0, 400)), "longest stretch")


def test_gaps_that_leave_no_stretch_are_refused(good: Recording) -> None:
    pieces = tuple(slice(a, a + 300) for a in range(0, 9000, 300))
    refused(replace(good, segments=pieces), "longest stretch")


def test_nan_never_becomes_a_recording(good: Recording) -> None:
    position = good.position.copy()
    position[17] = np.nan
    with pytest.raises(InputError, match=r"position\[17\] is nan"):
        replace(good, position=position)


def test_velocity_in_degrees_is_refused(good: Recording) -> None:
    velocity = np.gradient(good.position, PERIOD)
    condition([replace(good, velocity=velocity)])
    refused(replace(good, velocity=np.degrees(velocity)), "degrees")


def test_position_in_degrees_is_refused_without_a_velocity(good: Recording) -> None:
    for factor in (57.29578, 1.0 / 57.29578):
        with pytest.raises(InputError, match="degrees"):
            check_units(conditioned(scaled(good, position=factor)), axis())


def test_torque_of_the_wrong_sign_is_refused(good: Recording) -> None:
    with pytest.raises(InputError, match="opposes every motion"):
        check_units(conditioned(scaled(good, torque=-1.0)), axis())


@pytest.mark.parametrize("factor", [0.4, 0.7, 1.0, 1.5, 2.5])
def test_a_wrong_guess_of_the_inertia_is_no_reason(good: Recording, factor: float) -> None:
    check_units(conditioned(good), replace(axis(), inertia=1000.0 * factor))


@pytest.mark.parametrize("constant", [0.02, 0.3, 5.0, 60.0])
def test_effort_in_ampere_is_no_reason(good: Recording, constant: float) -> None:
    check_units(conditioned(scaled(good, torque=constant)), axis())


@pytest.mark.parametrize("name", ["emps", "laas_speed", "odrive_slow", "bam_sin_sin_kp200"])
def test_real_recordings_are_not_refused(shared_data, name: str) -> None:  # type: ignore[no-untyped-def]
    folder = shared_data / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no recording {name}")
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    check_units(condition(read_recordings([folder / "recording"], file.signals)), file.axis)


def test_good_data_have_no_limits(good: Recording) -> None:
    travel = scaled(good, position=20.0)
    data = conditioned(travel)
    assert limits(data, axis()) == ()
    assert barred(data, axis()) == frozenset()


def found(position: np.ndarray) -> Conditioned:
    torque = (
        60.0 * np.sign(np.gradient(position))
        + 5.0 * np.sin(T)
        + 1000.0 * np.gradient(np.gradient(position, PERIOD), PERIOD)
    )
    return conditioned(along(position, torque))


def test_one_direction_only() -> None:
    data = found(0.1 * T + 0.05 * np.sin(T))
    assert any("never reverses" in line and "positive" in line for line in limits(data, axis()))
    assert {"presliding", "coulomb_asymmetry", "backlash", "torque_bias"} <= barred(data, axis())
    assert count_reversals(data) == 0


def test_the_other_direction_is_named() -> None:
    assert any("negative" in line for line in limits(found(-0.1 * T - 0.05 * np.sin(T)), axis()))


def test_few_reversals() -> None:
    data = found(np.sin(2.0 * np.pi * T / 40.0 + 0.1))
    assert count_reversals(data) == 2
    assert any("reverses only 2 times" in line for line in limits(data, axis()))
    assert "presliding" in barred(data, axis())
    assert "coulomb_asymmetry" not in barred(data, axis())


def test_one_speed() -> None:
    data = found(0.2 * T + 1e-5 * np.sin(T))
    assert any("one speed" in line for line in limits(data, axis()))
    assert "stribeck" in barred(data, axis())


def test_no_acceleration_leaves_the_inertia_open() -> None:
    data = found(4.0 * np.sin(2.0 * np.pi * T / 500.0))
    light = replace(axis(), inertia=0.1)
    assert any("inertia is not determined" in line for line in limits(data, light))
    assert "flexible_mode" in barred(data, light)


def test_one_sinusoid_leaves_open_what_follows_the_position() -> None:
    swing = 0.3 * np.sin(T)
    data = found(swing)
    assert any("swings like one sinusoid" in line for line in limits(data, axis()))
    assert {"cable_wrap", "imbalance"} <= barred(data, axis())
    assert "imbalance" not in barred(found(swing + 0.1 * np.sin(3.0 * T)), axis())


def test_short_and_narrow() -> None:
    data = conditioned(scaled(recorded(axis(), duration=8.0), position=0.1))
    lines = limits(data, axis())
    assert any("lasts only" in line for line in lines)
    assert any("of a turn" in line for line in lines)
    assert "warmup_drift" in barred(data, axis())


def test_hardly_moving_names_nothing_that_moves() -> None:
    rng = np.random.default_rng(3)
    r = Recording(
        t=T, position=1e-6 * rng.standard_normal(len(T)), torque=rng.standard_normal(len(T)), source="bag"
    )
    data = condition([r])
    with pytest.raises(InputError, match="nothing but noise"):
        check_units(data, axis())
    assert any("hardly moves" in line for line in limits(data, axis()))
    assert {"backlash", "stribeck", "presliding"} <= barred(data, axis())


def test_limits_speak_of_effects_that_exist() -> None:
    from tcs_friction.diagnose.dataset import excitation as module
    from tcs_friction.physics.registry import effects

    for names in (module.REVERSING, module.SPEEDS, module.ACCELERATING, module.SLOW):
        assert names <= set(effects())
    assert item("torque_bias", bias=1.0).term.id in effects()


def test_a_place_that_the_axis_passed_once_is_said(good: Recording) -> None:
    """The middle of a to and fro is passed again and again, in its first seconds once."""
    whole, part = condition([good]), condition([good.part(slice(0, 1500))])
    middle = 0.5 * float(part.joined("position").min() + part.joined("position").max())
    bump = item("local_friction_bump", amplitude=0.3, centre=middle, width=0.01)
    assert passed_once(whole, [bump, item("torque_bias", bias=1.0)]) == ()
    (line,) = passed_once(part, [bump])
    assert "local friction bump" in line
    assert "once" in line
