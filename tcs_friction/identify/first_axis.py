"""The first axis file, from recordings alone: nothing is believed, everything is fitted or measured, and says where it is from.

Torque is J a + friction + a constant, and what the position does where a recording shows it. A torque that takes energy out of
the motion has the wrong sign; then it is turned over. Laws are compared roughly, on samples that no fit has seen; a law with
fewer parameters is preferred while it errs no more, and that one is identified.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import sosfreqz

from tcs_friction.conditioning.bands import step_of
from tcs_friction.conditioning.checks import check_read
from tcs_friction.conditioning.motion import Motion, prepare, sections
from tcs_friction.conditioning.sensor_noise import white_noise
from tcs_friction.config import AxisFile, Control, default_control
from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.errors import InputError
from tcs_friction.identify.controller_period import controller_period
from tcs_friction.identify.drive_noise import DriveNoise, drive_noise
from tcs_friction.identify.gravity import PositionTorque, position_torque
from tcs_friction.identify.identification import identified_axis, identify
from tcs_friction.identify.linear_balance import SIGNIFICANT
from tcs_friction.identify.net_work import NetWork, Sign, net_work
from tcs_friction.identify.problem import Problem, pose
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.identify.rough_comparison import RoughFit, compare_roughly
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.recording.signals import SignalMap

LAWS = ("coulomb_viscous", "stribeck_static", "dahl_viscous", "lugre")
"""Tried in this order, from few parameters to many."""
AS_GOOD = 0.02  # of the held-out residual: a law with more parameters has to err less by more
HEADROOM = 1.2  # times the fastest motion recorded, that the controller may ask for
BRISTLE = 1e-4  # of the travel, over which bristles bend where the law has none
LEAST_SHARE = 1e-9  # of the largest torque: friction so small stands for none


@dataclass(frozen=True)
class FirstAxis:
    """An axis file that nobody wrote, and what it follows from.

    work: what decided over the torque's sign. position: what the position does. rough: all laws, best first. left_out: law -> why
    it could not be fitted. found: the chosen one. motion: that was looked at, turned over if need be. fresh: where the
    control period is from. drive_noise: None where none is told. largest: torque seen, N m.
    """

    file: AxisFile
    work: NetWork
    position: PositionTorque
    rough: tuple[RoughFit, ...]
    left_out: Mapping[str, str]
    found: Identification
    motion: Motion
    fresh: str
    drive_noise: DriveNoise | None
    largest: float


def first_axis(
    recordings: Sequence[Recording],
    name: str,
    kind: str,
    signals: SignalMap,
    progress: Callable[[str], None] = lambda _: None,
) -> FirstAxis:
    """Fit a first axis file to recordings, one data set with common physics. `progress` is told what is being done.

    Raises InputError when the axis never moves, or no torque is ever applied.
    """
    for one in recordings:
        check_read(one)
    motion = prepare(recordings)
    if not np.ptp(motion.position) > 0.0 or np.abs(motion.velocity).max() <= motion.resolution:
        raise InputError(recordings[0].source, "the axis never moves", "a recording of motion")
    largest = max(float(np.abs(one.torque).max()) for one in recordings)
    if not largest > 0.0:
        raise InputError(recordings[0].source, "no torque is ever applied", "a recording of a driven axis")
    work = net_work(motion, kind)
    if work.sign is Sign.TURNED:
        recordings = [one.turned_over() for one in recordings]
        motion = prepare(recordings)
        signals = replace(signals, torque=replace(signals.torque, scale=-signals.torque.scale))
    position = position_torque(motion, kind, largest)
    guess = replace(_guess(name, kind, position, motion, largest), torque_unit=same_torque_unit(recordings))
    rough, left_out = compare_roughly(motion, guess, LAWS, lambda law: progress(_which(law)))
    found, refused = _identified(recordings, guess, rough, progress)
    axis = identified_axis(guess, _without_chance(found, largest))
    period, fresh = controller_period(recordings)
    sensors = _sensors(recordings)
    noise = _drive_noise(found, motion, axis, period, sensors)
    drive = Drive(limit=largest) if noise is None else Drive(largest, noise.rms, noise.bandwidth)
    axis = replace(axis, sensors=sensors, drive=drive)
    file = AxisFile(axis, signals, _cautious(axis, motion, period))
    return FirstAxis(file, work, position, rough, {**left_out, **refused}, found, motion, fresh, noise, largest)


def _which(name: str) -> str:
    return f"law {LAWS.index(name) + 1} of {len(LAWS)} ({name})" if name in LAWS else name


def _guess(name: str, kind: str, position: PositionTorque, motion: Motion, largest: float) -> Axis:
    """What a search starts from: the balance's values. A spring rests in the middle of the travel."""
    balance = position.balance.values
    friction = instance(law("coulomb_viscous"), {"coulomb": float(max(abs(balance[1]), LEAST_SHARE * largest)), "viscous": 0.0})
    effects = []
    if position.gravity is not None:
        sine, cosine = position.gravity
        effects.append(instance(effect("imbalance"), {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine)}))
    if position.spring is not None:
        middle = 0.5 * float(motion.position.min() + motion.position.max())
        effects.append(instance(effect("cable_wrap"), {"stiffness": position.spring, "neutral": middle}))
    return Axis(name, float(abs(balance[0])) or largest, friction, tuple(effects), kind)


def _identified(
    recordings: Sequence[Recording], guess: Axis, rough: Sequence[RoughFit], progress: Callable[[str], None]
) -> tuple[Identification, dict[str, str]]:
    """The chosen law, as `identify` finds it, and why others were refused.

    It is the plainest that errs as little as the best but for AS_GOOD. Where the recording determines nothing of it, it is the
    plainest that held-out samples like as much, of which something is determined.
    """
    plain = sorted(rough, key=lambda one: LAWS.index(one.law))
    good = [one for one in plain if not one.held_out > (1.0 + AS_GOOD) * rough[0].held_out]
    others = [one for one in plain if one.as_good(rough[0])] + list(rough)
    first: Identification | None = None
    refused: dict[str, str] = {}
    for one in dict.fromkeys([*good, *others]):
        if first is not None and not one.as_good(rough[0]):
            break

        def shown(generation: Generation, name: str = one.law) -> None:
            progress(f"{_which(name)}: {100.0 * generation.share:.0f} %")

        try:
            found = identify(recordings, guess, "default", one.law, progress=shown)
        except InputError as error:
            refused[one.law], last = str(error), error
            continue
        if any(item.determined for item in found.parameters.values()):
            return found, refused
        first = first or found
    if first is None:
        raise last
    return first, refused


def _without_chance(found: Identification, largest: float) -> Identification:
    """Without a constant torque that may be chance, or that is larger than any recorded: it could only cancel something else."""
    if SIGNIFICANT * found.offset.std < abs(found.offset.value) <= largest:
        return found
    return replace(found, offset=replace(found.offset, determined=False))


def _sensors(recordings: Sequence[Recording]) -> Sensors:
    """Noise (rad rms) and step (rad) of the position, as far as they show."""
    step = max(step_of(one.position) for one in recordings)
    noises = [white_noise(one.t, one.position, step) for one in recordings]
    return Sensors(noise=float(np.median(noises)), resolution=float(step))


def _drive_noise(found: Identification, motion: Motion, axis: Axis, period: float, sensors: Sensors) -> DriveNoise | None:
    """Of what the fit leaves, where that is the axis' motion."""
    problem = pose(axis, motion, predicted=False)
    rate = problem.motion.rate / problem.thin.stride
    series = np.split(found.fit.residual, found.fit.bounds[1:-1])
    position_noise = math.hypot(sensors.noise, sensors.resolution / math.sqrt(12.0))
    return drive_noise(series, rate, period, position_noise, axis.inertia, _passed(problem))


def _passed(problem: Problem) -> Callable[[np.ndarray], np.ndarray]:
    """What the low pass, run forwards and backwards, and the thinning leave of the power at frequencies (m,), Hz."""
    rate, taps = problem.motion.rate, problem.thin.taps
    half = np.arange(len(taps)) - len(taps) // 2
    passed = sections(problem.motion.bandwidth, rate)

    def share(frequency: np.ndarray) -> np.ndarray:
        _, gain = sosfreqz(passed, frequency, fs=rate)
        thinned = np.cos(2.0 * np.pi * np.outer(frequency / rate, half)) @ taps
        return np.asarray(np.abs(gain) ** 4 * thinned**2)

    return share


def _cautious(axis: Axis, motion: Motion, period: float) -> Control:
    """A controller for that period, and the friction as a compensator has it."""
    control = default_control(axis, period)
    fastest, travel = float(np.abs(motion.velocity).max()), float(np.ptp(motion.position))
    values = axis.friction.values
    coulomb = values["coulomb"]
    stiffness = values.get("stiffness", coulomb / (BRISTLE * travel))
    friction = LugreParameters(
        coulomb=coulomb,
        static=max(values.get("static", coulomb), coulomb),
        stribeck_velocity=values.get("stribeck_velocity", BRISTLE * fastest),
        stiffness=stiffness,
        damping=values.get("damping", 2.0 * math.sqrt(stiffness * axis.inertia)),
        viscous=values.get("viscous", 0.0),
    )
    return replace(
        control,
        controller=replace(control.controller, velocity_limit=HEADROOM * fastest),
        compensator=CompensatorConfig(friction, friction),
    )
