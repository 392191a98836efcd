"""Recordings that cannot carry a torque balance are refused in one clear line, good ones never."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from open_loop_cases import LUGRE, PERIOD, axis, recorded, scaled

from tcs_friction.conditioning.checks import check_units, plain_balance
from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile, load_axis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording


@pytest.fixture(scope="module")
def good() -> Recording:
    return recorded(axis(), duration=20.0)


def prepared(r: Recording) -> DataSet:
    return prepare([r])


def refused(r: Recording, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        prepare([r])
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


def test_a_motion_too_slow_for_its_length_is_refused() -> None:
    """At a constant speed the filter is as slow as the motion: its edges and the held-out data take all of two seconds."""
    t = np.arange(0.0, 2.5, 1e-3)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (2, len(t)))
    refused(Recording(t=t, position=0.5 * t + noise[0], torque=1.0 + noise[1]), "0 samples are left to be fitted")


def oscillation() -> Recording:
    """A sinusoid so slow and so noisy that each of its samples is within the filter's length of a reversal."""
    t = PERIOD * np.arange(20000)
    speed = 2.0 * np.pi * 0.45
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (2, len(t)))
    torque = -1000.0 * 0.01 * speed**2 * np.sin(speed * t) + 60.0 * np.sign(np.cos(speed * t))
    return Recording(t=t, position=0.01 * np.sin(speed * t) + noise[0], torque=torque + 1e4 * noise[1], source="bag")


def test_reversals_everywhere_are_refused_for_friction_without_memory_only() -> None:
    prepare([oscillation()])
    with pytest.raises(InputError, match=r"100% of the time.* 0 samples are left.* a friction law with memory such as lugre"):
        prepare([oscillation()], at_rest=False)


def test_reversals_everywhere_are_diagnosed_with_a_law_that_has_a_memory() -> None:
    assert diagnose([oscillation()], AxisFile(axis())).retuned.held_out > 0.0


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
    prepare([replace(good, velocity=velocity)])
    refused(replace(good, velocity=np.degrees(velocity)), "degrees")


def test_a_velocity_that_has_nothing_to_do_with_the_position_is_no_reason(good: Recording) -> None:
    prepare([replace(good, velocity=np.random.default_rng(0).standard_normal(len(good)))])
    prepare([replace(good, velocity=np.zeros(len(good)))])


def test_a_velocity_in_other_units_than_degrees_gives_no_hint(good: Recording) -> None:
    velocity = 10.0 * np.gradient(good.position, PERIOD)
    with pytest.raises(InputError, match=r"0\.1 times as fast") as caught:
        prepare([replace(good, velocity=velocity)])
    assert "degrees" not in str(caught.value)


def test_recordings_with_different_signals_are_refused(good: Recording) -> None:
    windy = replace(good, exogenous={"wind": np.ones(len(good))})
    with pytest.raises(InputError, match="other exogenous signals"):
        prepare([windy, good])


def test_short_pieces_are_left_out_and_said(good: Recording) -> None:
    split = replace(good, segments=(slice(0, 300), slice(300, len(good))))
    data = prepare([split])
    assert len(data.stretches) == 1
    assert data.notes[0] == "1 of 2 stretches between gaps are too short and left out"


def test_position_in_degrees_is_refused_without_a_velocity(good: Recording) -> None:
    for factor in (57.29578, 1.0 / 57.29578):
        with pytest.raises(InputError, match="degrees"):
            check_units(prepared(scaled(good, position=factor)), axis())


def test_torque_of_the_wrong_sign_is_refused(good: Recording) -> None:
    with pytest.raises(InputError, match="opposes every motion"):
        check_units(prepared(scaled(good, torque=-1.0)), axis())


@pytest.mark.parametrize("factor", [0.4, 0.7, 1.0, 1.5, 2.5])
def test_a_wrong_guess_of_the_inertia_is_no_reason(good: Recording, factor: float) -> None:
    check_units(prepared(good), replace(axis(), inertia=1000.0 * factor))


@pytest.mark.parametrize("constant", [0.02, 0.3, 5.0, 60.0])
def test_effort_in_ampere_is_no_reason(good: Recording, constant: float) -> None:
    check_units(prepared(scaled(good, torque=constant)), axis())


@pytest.mark.parametrize("name", ["emps", "laas_speed", "odrive_slow", "bam_sin_sin_kp200"])
def test_real_recordings_are_not_refused(shared_data, name: str) -> None:  # type: ignore[no-untyped-def]
    folder = shared_data / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no recording {name}")
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    check_units(prepare(read_recordings([folder / "recording"], file.signals)), file.axis)


def test_a_linear_axis_in_millimetres_is_refused(good: Recording) -> None:
    for factor, name in ((1e3, "mm"), (1e-3, "m where")):
        with pytest.raises(InputError, match=name):
            check_units(prepared(scaled(good, position=factor)), replace(axis(), kind="linear"))


def test_quarters_that_contradict_each_other_are_no_reason(good: Recording) -> None:
    """Where the torque's sign changes half way nothing is known of the wiring."""
    torque = np.where(np.arange(len(good)) < len(good) // 2, -good.torque, good.torque)
    check_units(prepared(replace(good, torque=torque)), axis())


def test_a_plain_balance_finds_inertia_and_dry_friction(good: Recording) -> None:
    data = prepared(good)
    found = plain_balance(data, np.ones(int(data.ends[-1]), bool))
    assert found is not None
    assert found == pytest.approx((1000.0, LUGRE["coulomb"]), rel=0.15)


def test_a_motion_at_one_speed_determines_no_balance(good: Recording) -> None:
    data = prepared(good)
    (stretch,) = data.stretches
    for velocity in (np.ones_like(stretch.velocity), np.zeros_like(stretch.velocity)):
        still = replace(stretch, velocity=velocity, acceleration=np.zeros_like(velocity))
        assert plain_balance(replace(data, stretches=(still,)), np.ones(int(data.ends[-1]), bool)) is None


def test_friction_that_would_drive_the_axis_is_no_balance(good: Recording) -> None:
    """A controller against cogging at one speed feigns such friction, and an inertia that is 37 times too small."""
    data = prepared(good)
    everything = np.ones(int(data.ends[-1]), bool)
    (stretch,) = data.stretches
    for share, known in ((0.5, True), (3.0, False)):
        driving = share * LUGRE["coulomb"] * stretch.velocity / float(np.std(stretch.velocity))
        driven = replace(stretch, torque=stretch.torque - LUGRE["viscous"] * stretch.velocity - driving)
        assert (plain_balance(replace(data, stretches=(driven,)), everything) is not None) == known, share


def without(r: Recording, lost: np.ndarray) -> Recording:
    """The recording without some samples, indices (k,)."""
    return Recording(np.delete(r.t, lost), np.delete(r.position, lost), np.delete(r.torque, lost), source=r.source)


def test_around_a_pause_of_the_log_nothing_is_compared(good: Recording) -> None:
    """Four samples are lost, fewer than make a gap. What comes late is stamped when it comes."""
    lost = without(good, np.arange(3000, 3004))
    late = replace(lost, t=np.where(np.arange(len(lost)) == 3001, 0.9 * lost.t[3000] + 0.1 * lost.t[3001], lost.t))
    data = prepared(late)
    (stretch,) = data.stretches
    compared = stretch.train | stretch.held_out
    near = np.abs(data.joined("t") - good.t[3002]) < 0.1
    assert near.any()
    assert not compared[near].any()
    assert data.dt * np.count_nonzero(compared) > 17.0, "of 20 s"
    assert data.notes[-1] == "nothing is compared around 1 pause of the log, longer than 3 usual times between samples"


def test_where_pauses_are_usual_what_lies_between_them_is_compared(good: Recording) -> None:
    lost = np.flatnonzero(np.isin(np.arange(len(good)) % 100, (0, 1, 2, 3)))[4:]
    data = prepared(without(good, lost))
    assert np.count_nonzero(data.train) > 0.9 * np.count_nonzero(prepared(good).train)
    assert not any("pause" in note for note in data.notes)
