"""Recordings of real machines, as they are and with an effect injected, each with what can be true of it and what cannot.

They lie in data/ and robots/ of the folder that TCS_FRICTION_DATA names, or of ../shared. Nobody knows all that is true of a real
machine. `tolerated` is what its parts can do, by how it is built; any other name is false: a carriage on a level screw has no
imbalance, behind the torque sensor of a joint there is no friction of the motor. What its makers say of it, and what is injected,
has to be named. An injected effect is added to the logged torque: with it the same motion would have taken that much more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.concealed_score import Expected
from benchmarks.hardware import data_folder
from benchmarks.trials import JOINT, Trial, rng_of
from tcs_friction.conditioning.checks import plain_balance
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile, load_axis
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap

FRICTION = frozenset({
    "stribeck", "presliding", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_drag", "position_dependent_friction",
    "temperature_dependent_friction", "warmup_drift", "local_friction_bump",
})  # fmt: skip
"""What any axis with bearings may have."""
MOTOR = frozenset({"cogging", "torque_ripple", "encoder_periodic_error", "torque_bias", "actuator_lag", "transport_delay"})
"""What any motor with its drive and encoder may have."""
GEAR = frozenset({"load_dependent_friction", "flexible_mode"})
ARM = frozenset({"imbalance", "cross_axis_coupling", "exogenous", "position_dependent_inertia"})
"""What a joint of an arm may have: weight, and the links beyond it."""


@dataclass(frozen=True)
class Machine:
    """A joint: where it is recorded, what its parts can do, what of that its makers say or is plain to see.

    joint: of several; "" of a recording with an axis file. number: of the joint in a table. published: inertia (kg m^2) and dry
    friction (N m).
    """

    path: str
    tolerated: frozenset[str]
    known: tuple[tuple[str, ...], ...] = ()
    joint: str = ""
    number: int = 0
    published: tuple[float, float] | None = None


PENDULUM = {"shoulder": (0.1111, 0.093), "elbow": (0.0267, 0.078)}  # I1 + m2 l1^2 and I2, each with the rotor's gr^2 Ir
UR10 = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
MACHINES: Mapping[str, Machine] = {
    **{
        f"bam_{run}": Machine(f"data/bam_{run}", FRICTION | MOTOR | GEAR | {"imbalance", "backlash"})
        for run in ("lift_and_drop_kp200", "lift_and_drop_kp800", "sin_sin_kp200", "sin_sin_kp800")
    },
    "emps": Machine("data/emps", FRICTION | MOTOR | {"flexible_mode"}),
    "laas_speed": Machine("data/laas_speed", FRICTION | MOTOR | {"imbalance"}, (("cogging", "torque_ripple"),)),
    "odrive_slow": Machine("data/odrive_slow", FRICTION | MOTOR | {"imbalance"}, (("cogging", "torque_ripple"),)),
    **{
        f"pendulum_{joint}_{run}": Machine(
            f"robots/double_pendulum/trajectory_{run}.csv",
            FRICTION | MOTOR | GEAR | ARM,
            joint=joint,
            number=number,
            published=published,
        )
        for run in ("00", "03", "11")
        for number, (joint, published) in enumerate(PENDULUM.items())
    },
    **{
        f"ur10_{name}": Machine(
            "robots/ur10/ur10_exciting_trajectory.db3", FRICTION | MOTOR | GEAR | ARM, joint=f"{name}_joint"
        )
        for name in UR10
    },
    **{
        f"panda_{k}": Machine("robots/panda/panda_exciting_trajectory.db3", ARM | {"torque_bias"}, joint=f"fer_joint{k}")
        for k in range(1, 8)
    },
}
"""The UR10 and the Panda have strain wave gears, which have no backlash; the Panda's torque is measured behind its own."""


def _cogging(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    period = min(2.0 * np.pi / 31.0, float(np.ptp(position)) / 9.0)
    return np.asarray(np.cos(2.0 * np.pi * position / period + rng.uniform(0.0, 2.0 * np.pi)))


def _spring(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return position - position.mean() - rng.uniform(-0.1, 0.1) * np.ptp(position)


def _imbalance(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(np.cos(position + rng.uniform(0.0, 2.0 * np.pi)))


INJECTED: Mapping[str, tuple[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]]] = {
    "laas_speed": ("imbalance", _imbalance),
    "odrive_slow": ("imbalance", _imbalance),
    "emps": ("cable_wrap", _spring),
    "pendulum_shoulder_11": ("cable_wrap", _spring),
    "ur10_shoulder_pan": ("imbalance", _imbalance),
    "ur10_elbow": ("cogging", _cogging),
    "panda_1": ("cable_wrap", _spring),
}
"""What is injected into which machine, as a torque of its position."""
SIZE = 0.3  # of the logged torque, rms, that an injected one has
WITH = "_with_"


def names() -> list[str]:
    """The machines, then those with an effect injected."""
    return [*MACHINES, *(f"{name}{WITH}{effect}" for name, (effect, _) in INJECTED.items())]


def folder_of(name: str) -> Path:
    """Where a machine's recording is. InputError where it is missing."""
    place = data_folder().parent / MACHINES[name.partition(WITH)[0]].path
    if not place.exists():
        raise InputError(str(place), "no recording", "the recordings of real machines (TCS_FRICTION_DATA names the folder)")
    return place


def world(name: str, seed: int = 0) -> Trial:
    """The recording of that name. seed: of the phase of what is injected. InputError where it is missing or cannot be read."""
    machine, injects = name.partition(WITH)[::2]
    recording, believed = _read(folder_of(name), MACHINES[machine])
    known = MACHINES[machine].known
    if injects:
        effect, shape = INJECTED[machine]
        added = shape(recording.position, rng_of(name, seed))
        added *= SIZE * np.sqrt(np.mean(recording.torque**2)) / np.std(added)
        recording = replace(recording, torque=recording.torque + added)
        known = (*known, (effect,))
    right = Expected(known, 0.0, tolerated=MACHINES[machine].tolerated, partial=True)
    return Trial(name, recording, believed, right, f"a real machine{', with an effect injected' if injects else ''}")


def _read(place: Path, machine: Machine) -> tuple[Recording, AxisFile]:
    """Its recording, and what is believed: the file that lies beside it, what is published, or what a plain balance tells."""
    if not machine.joint:
        file = load_axis(place / "axis.yaml")
        (recording,) = read_recordings([place / "recording"], file.mapped(place / "axis.yaml"))
        return recording, file
    signals = SignalMap.from_mapping(_block(machine), "real worlds")
    recording = _of_table(place, machine) if place.suffix == ".csv" else read_recordings([place], signals)[0]
    data = prepare([recording], held_out=False)
    told = machine.published or plain_balance(data, np.ones(data.ends[-1], bool))
    inertia, dry = told if told is not None and min(told) > 0.0 else _nothing_known(recording)
    values = {"coulomb": max(dry, 0.01 * float(np.std(recording.torque))), "viscous": 0.0}
    return recording, AxisFile(Axis(machine.joint, inertia, instance(law("coulomb_viscous"), values)), signals=signals)


def _block(machine: Machine) -> dict[str, object]:
    """Where the signals of a joint stand, and positions and velocities of those that may push on it."""

    def source(field: str, joint: str) -> dict[str, str]:
        return {"topic": JOINT, "field": field, "joint": joint}

    block: dict[str, object] = {
        name: source(field, machine.joint)
        for name, field in (("position", "position"), ("velocity", "velocity"), ("torque", "effort"))
    }
    beside = [one.joint for one in MACHINES.values() if one.path == machine.path and one.joint != machine.joint]
    others = {f"{joint}_{field}": source(field, joint) for joint in beside for field in ("position", "velocity")}
    return block | {"exogenous": others}


def _of_table(place: Path, machine: Machine) -> Recording:
    """A joint of a table of time, positions, velocities and torques of two; samples whose time stands still are left out."""
    columns = np.loadtxt(place, delimiter=",", skiprows=1).T
    t, rest = columns[0], columns[1:].reshape(3, 2, -1)
    kept = np.concatenate([[True], np.diff(np.maximum.accumulate(t)) > 0.0])
    own, other = machine.number, 1 - machine.number
    beside = next(one.joint for one in MACHINES.values() if one.path == machine.path and one.number == other)
    position, velocity, torque = rest[:, own, kept]
    signals = {f"{beside}_{field}": rest[k, other, kept] for k, field in enumerate(("position", "velocity"))}
    return Recording(t[kept], position, torque, velocity, exogenous=signals, source=place.name)


def _nothing_known(recording: Recording) -> tuple[float, float]:
    """Inertia and dry friction where a plain balance tells neither: what would take all of the torque."""
    size = float(np.std(recording.torque))
    acceleration = np.gradient(np.gradient(recording.position, recording.t), recording.t)
    return size / float(np.std(acceleration)), 0.1 * size
