"""The sign of a torque, by the work that it does and by the inertia."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_cases import axis_of, recording

from tcs_friction.conditioning.motion import Motion, prepare
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.identify.net_work import CLOCKS, NetWork, Scale, Sign, closed_span, net_work, refuse_turned
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.tables import import_table

RATE = 250.0
T = np.arange(int(30.0 * RATE)) / RATE
SWING = 0.4 * np.sin(0.9 * T) + 0.1 * np.sin(3.1 * T)


def moved(position: np.ndarray, torque: np.ndarray, seed: int = 0) -> Motion:
    """A motion with a little noise in both."""
    random = np.random.default_rng(seed)
    noisy = torque + 0.01 * np.std(torque) * random.standard_normal(len(T))
    return prepare([Recording(T, position + 1e-7 * random.standard_normal(len(T)), noisy)])


def speed(position: np.ndarray, order: int = 1) -> np.ndarray:
    for _ in range(order):
        position = np.gradient(position, 1.0 / RATE)
    return position


def turned(motion: Motion) -> Motion:
    return replace(motion, torque=-motion.torque)


@pytest.mark.parametrize(
    ("inertia", "coulomb", "viscous", "stiffness", "gravity"),
    [
        (2.0, 3.0, 1.0, 0.0, 0.0),
        (0.0, 3.0, 0.0, 0.0, 0.0),  # a damper: nothing but friction
        (0.0, 0.5, 0.0, 40.0, 0.0),  # on a spring, which looks like a negative inertia
        (1.0, 0.5, 0.2, 0.0, 30.0),  # an arm, lifted and lowered
        (50.0, 0.05, 0.0, 0.0, 0.0),  # hardly any friction: the inertia tells
    ],
)
def test_a_torque_that_takes_energy_out_of_the_motion_is_turned_over(
    inertia: float, coulomb: float, viscous: float, stiffness: float, gravity: float
) -> None:
    v = speed(SWING)
    torque = inertia * speed(SWING, 2) + coulomb * np.sign(v) + viscous * v + stiffness * SWING + gravity * np.cos(SWING)
    motion = moved(SWING, torque)
    assert net_work(motion, "rotary").sign is Sign.RIGHT
    assert net_work(turned(motion), "rotary").sign is Sign.TURNED
    refuse_turned(motion, "rotary")
    with pytest.raises(InputError, match=r"signal torque: it opposes every motion that it should drive, .*scale: -1.0"):
        refuse_turned(turned(motion), "rotary")


def test_the_work_is_what_friction_took() -> None:
    v = speed(SWING)
    motion = moved(SWING, 2.0 * speed(SWING, 2) + 3.0 * np.sign(v) + 10.0 * SWING)
    work = net_work(motion, "rotary")
    assert work.work == pytest.approx(3.0 * float(np.mean(np.abs(v))) * work.seconds, rel=0.05)
    assert work.std < 0.05 * work.work
    assert work.seconds > 20.0


@pytest.mark.parametrize("late", [-0.02, 0.02])
def test_a_clock_that_is_wrong_does_not_turn_a_torque_over(late: float) -> None:
    quick = 0.05 * np.sin(6.0 * T) + 0.1 * np.sin(2.0 * T)
    torque = 5.0 * speed(quick, 2) + 0.4 * np.sign(speed(quick))
    motion = moved(quick, np.interp(T - late, T, torque))
    assert net_work(motion, "rotary").sign is Sign.RIGHT
    assert net_work(turned(motion), "rotary").sign is Sign.TURNED
    assert net_work(motion, "rotary").clocks == pytest.approx(
        CLOCKS * 5.0 * float(np.mean(speed(quick, 2) ** 2)) * net_work(motion, "rotary").seconds, rel=0.1
    )


def test_one_way_at_one_speed_the_sign_is_not_told_and_stays() -> None:
    """A load that is lowered does the same as friction of the other sign."""
    motion = moved(0.01 * T, np.full(len(T), -4.0) + 0.1 * np.random.default_rng(1).standard_normal(len(T)))
    work = net_work(motion, "linear")
    assert work.sign is Sign.OPEN
    refuse_turned(motion, "linear")


def test_a_turn_closes_a_rotary_axis_and_not_a_linear_one() -> None:
    position = 0.9 * T
    torque = 2.0 + 1.5 * np.sin(position)
    motion = moved(position, torque)
    assert net_work(motion, "rotary").by_work is Sign.RIGHT
    assert net_work(motion, "linear").by_work is Sign.OPEN


def test_what_drives_the_axis_from_outside_turns_nothing_over() -> None:
    """The work is negative, the inertia positive: a brake on an axis that the wind turns."""
    v = speed(SWING)
    motion = moved(SWING, 20.0 * speed(SWING, 2) - 6.0 * v)
    work = net_work(motion, "rotary")
    assert (work.by_work, work.by_inertia, work.sign) == (Sign.TURNED, Sign.RIGHT, Sign.OPEN)


def test_an_axis_that_stands_closes_no_span() -> None:
    motion = moved(SWING, speed(SWING))
    still = replace(motion, velocity=np.zeros(len(motion)))
    span, gap = closed_span(still, slice(0, len(still)), Scale(1.0, 1.0, 0.0), rotary=False)
    assert (span, gap) == (slice(0, len(still)), np.inf)


def test_both_signs_stand_beside_each_other() -> None:
    text = str(NetWork(12.3, 0.4, 0.1, 30.0, (1.0, 0.1)))
    assert text == "it does 12.3 J as recorded, -12.3 J turned over (± 0.5) over 30 s of motion that comes back to where it began"


def test_a_telescope_with_presliding_has_the_right_sign() -> None:
    assert net_work(prepare([recording(axis_of(), seconds=24.0)]), "rotary").sign is Sign.RIGHT


RIGHT = (
    *(f"data/{name}/recording" for name in ("emps", "laas_speed", "odrive_slow", "bam_sin_sin_kp200", "bam_lift_and_drop_kp800")),
    "practice/mujoco_coulomb/recording",
    "inputs/timing/m2_20240312",
    "inputs/timing/w02_robot_joint_amps_1/bag",
    "inputs/timing/w11_irregular_missing_1/bag",
    "inputs/intake/torque_held_50_hz",
)


@pytest.mark.parametrize("name", RIGHT)
def test_no_recording_that_is_right_is_turned_over(shared_data: Path, name: str) -> None:
    path = shared_data / name
    recordings = read_recordings([path], SignalMap.from_mapping(bag_info(path).signals, name))
    kind = "linear" if "emps" in name else "rotary"
    motion = prepare(recordings)
    assert net_work(motion, kind).sign is not Sign.TURNED
    assert net_work(turned(motion), kind).sign is Sign.TURNED


@pytest.mark.parametrize(
    ("name", "expected"), [("turned_over", Sign.TURNED), ("clean", Sign.RIGHT), ("friction_damper", Sign.RIGHT)]
)
def test_tables_of_both_signs(shared_data: Path, name: str, expected: Sign) -> None:
    """The damper is passive: the force that moves it does 6 kJ of work on it."""
    table = import_table(shared_data / "inputs" / "intake" / f"{name}.csv", "axis", {})
    assert net_work(prepare([table.recording]), table.kind or "rotary").sign is expected


def test_a_torque_that_is_turned_over_and_late_is_found_out(shared_data: Path) -> None:
    folder = shared_data / "inputs" / "timing"
    file = load_axis(folder / "w10_wrong_sign_axis.yaml")
    with pytest.raises(InputError, match="opposes every motion"):
        refuse_turned(prepare(read_recordings([folder / "w10_bag"], file.mapped("axis"))), file.axis.kind)
