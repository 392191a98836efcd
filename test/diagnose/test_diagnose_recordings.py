"""Whole diagnoses of recordings that were not made here: another simulator's, and real hardware's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import load_axis
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.outcome.result import Diagnosis, Found
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording


def diagnosed(folder: Path) -> Diagnosis:
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    return diagnose(read_recordings([folder / "recording"], file.signals), file)


def thinned(whole: Recording, step: int) -> Recording:
    """Every so many samples of position, torque and exogenous signals."""
    kept = slice(None, None, step)
    return Recording(
        whole.t[kept],
        whole.position[kept],
        whole.torque[kept],
        exogenous={name: values[kept] for name, values in whole.exogenous.items()},
    )


def named(found: Diagnosis, effect: str) -> Found:
    """The effect, by its name or as one that the data cannot tell from it."""
    return next(item for item in found.effects if effect in (item.effect, *(kind.effect for kind in item.equivalent)))


@pytest.mark.parametrize("name", ["match", "cogging"])
def test_practice_recordings_of_another_simulator(name: str, shared_data: Path) -> None:
    """All eleven are judged by `./tcs bench concealed --worlds practice`."""
    folder = shared_data / "practice" / name
    truth = json.loads((folder / "truth.json").read_text())
    found = diagnosed(folder)
    assert sorted(item.effect for item in found.effects) == sorted(truth["effects"])
    assert found.verdict == ("missing_physics" if truth["effects"] else "parameters")
    assert found.improved.held_out < 1.1 * found.noise_floor
    assert found.axis_file.axis.inertia == pytest.approx(truth["inertia"], rel=2.5e-4)  # noise makes it no smaller
    if name == "cogging":
        values = {key: entry["value"] for key, entry in found.effects[0].parameters.items()}
        assert values["order"] == pytest.approx(truth["effect_parameters"]["cogk"], abs=0.01)
        assert values["amplitude"] == pytest.approx(truth["effect_parameters"]["coga"], rel=0.01)


def test_slow_sampling_is_no_physics(shared_data: Path) -> None:
    """Every fifth sample, of the second half: it looks a little like collisions and like friction that follows the load."""
    folder = shared_data / "practice" / "cable_and_asymmetry"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    (whole,) = read_recordings([folder / "recording"], file.signals)
    found = diagnose([thinned(whole.part(slice(len(whole) // 2, None)), 5)], file)
    assert sorted(item.effect for item in found.effects) == ["cable_wrap", "coulomb_asymmetry"]


def test_ball_screw(shared_data: Path) -> None:
    """Real, 24.8 s: friction that depends on the direction and a ripple locked to the pitch of 2.5 mm; not all is explained."""
    folder = shared_data / "data" / "emps"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    (whole,) = read_recordings([folder / "recording"], file.signals)
    found = diagnose([thinned(whole, 2)], file)  # 500 Hz suffice, in half the time
    assert {item.effect for item in found.effects} <= {"viscous_asymmetry", "cogging", "quadratic_drag"}
    assert found.free_run["improved"] < 0.2 * found.free_run["retuned"]
    assert named(found, "viscous_asymmetry").parameters["asymmetry"]["value"] < -25.0
    order = named(found, "cogging").parameters["order"]["value"]
    assert 1.0 / order == pytest.approx(2.5e-3, rel=2e-3)
    assert found.improved.held_out < 1.6 < 3.0 < found.retuned.held_out


def test_the_offset_of_the_ball_screw_is_friction_by_direction(shared_data: Path) -> None:
    """The published model has an offset of -3.2 N; beside viscous friction by direction nothing of it is left."""
    folder = shared_data / "data" / "emps"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    balance = TorqueBalance(prepare(read_recordings([folder / "recording"], file.signals)))
    bias = instance(effect("torque_bias"), {"bias": -3.0})
    asymmetry = instance(effect("viscous_asymmetry"), {"asymmetry": -40.0})
    ripple = instance(effect("cogging"), {"order": 399.7, "amplitude": 1.0, "phase": 0.0})
    held_out, left = [], []
    for effects in ((bias,), (asymmetry,), (bias, asymmetry, ripple)):
        fit = settle(balance, replace(file.axis, effects=effects), white_noise(balance.samples))
        held_out.append(float(np.sqrt(np.mean(balance.residual(fit.axis, fit.noise)[balance.held_out] ** 2))))
        left.append(fit.axis.effects[0].values)
    assert left[0]["bias"] == pytest.approx(-3.3, abs=0.2)
    assert held_out[1] < 0.8 * held_out[0]
    assert abs(left[2]["bias"]) < 0.3


def test_pendulum_on_a_servo(shared_data: Path) -> None:
    """Real, 6 s: gravity, which over a third of a turn is hardly to be told from a cable."""
    found = diagnosed(shared_data / "data" / "bam_sin_sin_kp800")
    assert [named(found, "imbalance")] == list(found.effects)
    assert found.free_run["improved"] < 0.5 * found.free_run["retuned"]


def test_pendulum_on_a_soft_servo(shared_data: Path) -> None:
    """Real, 6 s: gravity over a quarter of a turn, or a cable, comes first; beside so much that is unexplained it is no name."""
    found = diagnosed(shared_data / "data" / "bam_sin_sin_kp200")
    assert found.effects == ()
    first = found.described[0]
    assert {first.effect, *(kind.effect for kind in first.equivalent)} >= {"imbalance", "cable_wrap"}


def test_load_dependent_friction_of_a_servo_is_not_to_be_seen(shared_data: Path) -> None:
    """Real, two runs: beside gravity its coefficient has either sign and predicts no better. The effort is a voltage."""
    coefficients, gains = [], []
    for name in ("bam_sin_sin_kp200", "bam_sin_sin_kp800"):
        folder = shared_data / "data" / name
        file = load_axis(folder / "axis.yaml")
        assert file.signals is not None
        balance = TorqueBalance(prepare(read_recordings([folder / "recording"], file.signals)))
        gravity = instance(effect("imbalance"), {"amplitude": 5.0, "phase": 0.0})
        loaded = instance(effect("load_dependent_friction"), {"coefficient": 0.1})
        noise = white_noise(balance.samples)
        fits = [settle(balance, replace(file.axis, effects=some), noise) for some in ((gravity,), (gravity, loaded))]
        plain, better = (float(np.std(balance.residual(fit.axis, fit.noise)[balance.held_out])) for fit in fits)
        coefficients.append(fits[1].axis.effects[1].values["coefficient"])
        gains.append(plain / better)
    assert min(coefficients) < 0.0 < max(coefficients)
    assert max(gains) < 1.05


def test_slow_motor(shared_data: Path) -> None:
    """Real, 10 s, irregular sampling, one direction: cogging of 7 per turn, twice and of the 12 slots, and no other kind.

    Mirrored: a name does not depend on the sign of the position.
    """
    folder = shared_data / "data" / "odrive_slow"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    (r,) = read_recordings([folder / "recording"], file.signals)
    found = diagnose([Recording(r.t, -r.position, -r.torque, segments=r.segments)], file)
    orders = [item.parameters["order"]["value"] for item in found.effects]
    assert orders[0] == pytest.approx(7.0, abs=0.1)
    assert all(min(abs(order - k) for k in (7.0, 12.0, 14.0)) < 0.15 for order in orders)
    assert {item.effect for item in found.effects} == {"cogging"}
    assert found.improved.held_out < 0.6 * found.retuned.held_out
    assert found.free_run["improved"] < found.free_run["believed"], "six windows of 0.3 s tell it from no retuned one"


def test_motor_at_speed(shared_data: Path) -> None:
    """Real, 8 s at two speeds, with a pause of the log: the orders of the cogging are those that the whole recording shows."""
    folder = shared_data / "data" / "laas_speed"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    (whole,) = read_recordings([folder / "recording"], file.signals)
    found = diagnose([whole.part(slice(8_000, 16_000))], file)
    orders = [item.parameters["order"]["value"] for item in found.effects if item.effect == "cogging"]
    assert orders
    assert all(min(abs(order - k) for k in (12.0, 18.0, 72.0)) < 0.1 for order in orders)
    assert found.improved.held_out < 0.4 * found.retuned.held_out


def test_too_little_motion_is_no_match(shared_data: Path) -> None:
    """What one short run shows once cannot be confirmed, and what is far above the noise is no match."""
    found = diagnosed(shared_data / "data" / "bam_lift_and_drop_kp200")
    assert found.verdict != "match"
