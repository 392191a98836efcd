"""Bags of four simulated axes over a simulated year, with the truth beside them.

Four telescopes of one make, called after where they stand, are recorded about once a week at night, less than a minute at a
time. The temperature follows year, night and weather, and friction follows it on all of them. Beyond that

    north  does not change
    east   has a lubricant that ages: its Coulomb and viscous friction grow through the year
    south  gets a bump in its bearing
    west   has a cable that is dressed anew: it pulls like a spring, and to one side

Each axis turns to and fro under its controller, with the noise of encoder and drive. Some recordings are of steady tracking
in one direction, which says little of friction.

    python -m benchmarks.fleet_bags DIRECTORY [--bags 200]

writes DIRECTORY/bags/AXIS/*, DIRECTORY/axes/AXIS.yaml, DIRECTORY/AXES.yaml, and DIRECTORY/truth.json.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tcs_friction.config import AxisFile, default_control, save_axis, write_whole
from tcs_friction.control.loop import LoopConfig, simulate_loop
from tcs_friction.control.reference import ConstantSpeed, Multisine, Reference
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.write import write_recording

AXES = ("north", "east", "south", "west")
YEAR = 365.0  # days
SECONDS, PERIOD = 50.0, 0.004  # s
BEGIN = datetime.datetime(2025, 1, 1, tzinfo=datetime.UTC)
REFERENCE_TEMPERATURE = 10.0  # degC, at which the values of an axis hold
DRY_PER_DEGREE, VISCOUS_PER_DEGREE = -0.003, -0.012  # 1/degC
TRACKING = 12  # one recording in so many is of steady tracking

NOMINAL = {
    "coulomb": 78.1,
    "static": 117.2,
    "stribeck_velocity": 6.1e-4,
    "stiffness": 2.96e5,
    "damping": 3.4e4,
    "viscous": 572.0,
}
INERTIA = 1000.0  # kg m^2

AGEING = {"coulomb": 0.14, "viscous": 0.30}  # relative growth in a year, of the lubricant of east
BUMP_DAY, BUMP = 213.4, {"amplitude": 0.25, "centre": 0.06, "width": 0.02}
CABLE_DAY = 131.6
CABLE_AFTER = {"stiffness": 15.0}  # N m/rad; before, the cable hung free
CABLE_OFFSET = 4.0  # N m


@dataclass(frozen=True)
class Change:
    """A planted change: a `step` at `day` of the year, or a `drift` through it; `effect` is "" for the law and the offset."""

    axis: str
    kind: str
    effect: str
    parameter: str
    before: float
    after: float
    day: float


@dataclass(frozen=True)
class Bag:
    """One recording: its axis, path from the directory, start (ns since 1970) and day, what was true of it."""

    axis: str
    path: str
    start: int
    day: float
    temperature: float
    programme: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Truth:
    """What was planted, and every recording in the order in which they were made."""

    changes: tuple[Change, ...]
    bags: tuple[Bag, ...]
    dry_per_degree: float = DRY_PER_DEGREE
    viscous_per_degree: float = VISCOUS_PER_DEGREE


def write_fleet(directory: Path, bags: int = 200, seed: int = 0) -> Truth:
    """Write `bags` recordings, shared among the axes and spread over the year. The same arguments give the same bytes.

    Raises InputError if a bag is there already.
    """
    for number, name in enumerate(AXES):
        save_axis(
            directory / "axes" / f"{name}.yaml", believed(name, np.random.default_rng([seed, 1, number]))
        )
    entries = [{"axis": f"axes/{name}.yaml"} for name in AXES]
    write_whole(directory / "AXES.yaml", yaml.safe_dump(entries, sort_keys=False))
    made = [_write_bag(directory, k, bags, seed) for k in range(bags)]
    truth = Truth(planted(seed), tuple(sorted(made, key=lambda bag: bag.start)))
    write_whole(directory / "truth.json", json.dumps(asdict(truth), indent=1))
    return truth


def planted(seed: int) -> tuple[Change, ...]:
    """Every planted change, in SI units."""
    east = made_like(seed, "east")
    grown = [
        Change("east", "drift", "", name, east[name], east[name] * (1.0 + growth), 0.0)
        for name, growth in AGEING.items()
    ]
    south = [Change("south", "step", "local_friction_bump", "amplitude", 0.0, BUMP["amplitude"], BUMP_DAY)]
    west = [
        Change("west", "step", "cable_wrap", name, 0.0, value, CABLE_DAY)
        for name, value in CABLE_AFTER.items()
    ]
    return (*grown, *south, *west, Change("west", "step", "", "offset", 0.0, CABLE_OFFSET, CABLE_DAY))


def made_like(seed: int, name: str) -> dict[str, float]:
    """Friction and inertia of an axis when new: the nominal ones, 2 % off as axes of one make are."""
    random = np.random.default_rng([seed, 2, AXES.index(name)])
    values = {key: value * (1.0 + 0.02 * random.standard_normal()) for key, value in NOMINAL.items()}
    return {**values, "inertia": INERTIA * (1.0 + 0.005 * random.standard_normal())}


def axis_on(seed: int, name: str, day: float) -> Axis:
    """The true axis on a day of the year."""
    values = made_like(seed, name)
    effects = [_temperature()]
    if name == "east":
        values |= {key: values[key] * (1.0 + growth * day / YEAR) for key, growth in AGEING.items()}
        values["static"] *= values["coulomb"] / made_like(seed, name)["coulomb"]
    if name == "south" and day >= BUMP_DAY:
        effects.append(instance(effect("local_friction_bump"), BUMP))
    if name == "west" and day >= CABLE_DAY:
        effects.append(instance(effect("cable_wrap"), CABLE_AFTER))
        effects.append(instance(effect("torque_bias"), {"bias": CABLE_OFFSET}))
    friction = instance(law("lugre"), {key: values[key] for key in NOMINAL})
    sensors = Sensors(resolution=2.4240684e-8, noise=4.8481368e-8, velocity_bandwidth=50.0)
    drive = Drive(limit=1000.0, noise=0.25, noise_bandwidth=10.0)
    return Axis(name, values["inertia"], friction, tuple(effects), sensors=sensors, drive=drive)


def _temperature() -> Instance:
    values = {
        "dry": DRY_PER_DEGREE,
        "viscous": VISCOUS_PER_DEGREE,
        "reference_temperature": REFERENCE_TEMPERATURE,
    }
    return instance(effect("temperature_dependent_friction"), values)


def believed(name: str, random: np.random.Generator) -> AxisFile:
    """What the axis file says: the make's values, some per cent off, and nothing of temperature, cables or bumps."""
    values = {key: value * (1.0 + 0.02 * random.standard_normal()) for key, value in NOMINAL.items()}
    axis = Axis(name, INERTIA, instance(law("lugre"), values), actuation_delay=0.5 * PERIOD)
    return AxisFile(axis, signals_of(name), default_control(axis))


def signals_of(name: str) -> SignalMap:
    """Where the signals of an axis are in its bags."""
    joint = {"topic": f"/{name}/joint_states", "joint": "azimuth"}
    block = {
        "position": {**joint, "field": "position"},
        "velocity": {**joint, "field": "velocity"},
        "torque": {**joint, "field": "effort"},
        "temperature": {"topic": f"/{name}/temperature", "field": "temperature"},
    }
    return SignalMap.from_mapping(block, name)


def temperature_on(day: float, random: np.random.Generator) -> float:
    """degC: coldest in the middle of January, warmer in the evening than towards morning, and the weather of the day."""
    season = -12.0 * math.cos(2.0 * math.pi * (day - 15.0) / YEAR)
    night = 2.5 * math.cos(2.0 * math.pi * (day % 1.0 - 0.6))
    return 10.0 + season + night + 3.0 * float(random.standard_normal())


def programme(random: np.random.Generator) -> tuple[str, Reference]:
    """To and fro over some tenths of a radian, never twice quite the same, or now and then a steady tracking."""
    centre, stretch = random.normal(0.0, 0.01), random.uniform(0.9, 1.1)
    if random.integers(TRACKING) == 0:
        return "tracking", Reference(ConstantSpeed(7.3e-5 * random.uniform(0.8, 1.2), centre, SECONDS))
    moves = Multisine(
        velocity_amplitude=0.01 * stretch,
        lowest_frequency=1.0 / SECONDS,
        frequency_step=1.3 / SECONDS,
        components=4,
        center=centre,
        duration=SECONDS,
    )
    return "survey", Reference(moves)


def record(axis: Axis, reference: Reference, temperature: float, seed: int) -> Recording:
    """The axis under its controller; its bearing warms by a tenth of a degree on the way."""
    control = default_control(replace(axis, effects=()))
    count = round(reference.duration / PERIOD) + 1
    course = temperature + 0.1 * np.linspace(0.0, 1.0, count)
    run = simulate_loop(
        axis, reference, control.controller, LoopConfig(PERIOD), seed=seed, temperature=course
    )
    return Recording(
        run.t, run.position, run.torque, velocity=run.velocity, temperature=course, source=axis.name
    )


def _write_bag(directory: Path, number: int, bags: int, seed: int) -> Bag:
    """Bag `number`: the axes take turns, each some time in the night of its turn."""
    random = np.random.default_rng([seed, 3, number])
    name, turns = AXES[number % len(AXES)], math.ceil(bags / len(AXES))
    night = math.floor(YEAR * (number // len(AXES) + 0.5) / turns)
    day = night + float(random.uniform(0.8, 1.2))
    temperature = temperature_on(day, random)
    title, reference = programme(random)
    axis = axis_on(seed, name, day)
    recording = record(axis, reference, temperature, int(random.integers(2**31)))
    start = BEGIN + datetime.timedelta(seconds=round(day * 86400.0))
    path = Path("bags") / name / f"{start:%Y-%m-%dT%H%M%S}"
    nanoseconds = round(start.timestamp()) * 1_000_000_000
    write_recording(directory / path, recording, signals_of(name), nanoseconds)
    values: dict[str, Any] = {**axis.friction.values, "inertia": axis.inertia}
    return Bag(name, str(path), nanoseconds, day, temperature, title, values)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--bags", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    truth = write_fleet(arguments.directory, arguments.bags, arguments.seed)
    print(f"{arguments.directory}: {len(truth.bags)} bags, {len(truth.changes)} planted changes")


if __name__ == "__main__":
    main()
