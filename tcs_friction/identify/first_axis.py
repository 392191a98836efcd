"""The first axis file, from recordings alone: nothing is believed, everything is fitted or measured, and says where it is from.

Torque is J a + friction + a constant, and gravity where a rotary axis shows it. Of a torque with the wrong sign the friction
would give power to the motion; then the sign is turned over. Laws are compared on samples that no fit has seen; a law with fewer
parameters is preferred while it errs no more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.config import AxisFile, Control, default_control
from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.diagnose.dataset.bands import choose_cutoff, step_of
from tcs_friction.errors import InputError
from tcs_friction.identify.comparison import Comparison, compare_laws
from tcs_friction.identify.identification import identified_axis
from tcs_friction.identify.linear_balance import linear_balance
from tcs_friction.identify.motion import Motion, prepare
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.recording.signals import SignalMap

LAWS = ("coulomb_viscous", "stribeck_static", "dahl_viscous", "lugre")
"""Tried in this order, from few parameters to many."""
AS_GOOD = 0.02  # of the held-out residual: a law with more parameters has to err less by more
LIKELY_TURNED = 3.0  # standard errors by which friction that drives the motion tells that the torque's sign is turned over
HEADROOM = 1.2  # times the fastest motion recorded, that the controller may ask for
LEAST_SWING = 0.5  # rad of travel, over which gravity is not a straight line
CLEARLY = 10.0  # by which Bayes' information criterion has to be better: very strong evidence (Kass & Raftery 1995)
BRISTLE = 1e-4  # of the travel, over which bristles bend where the law has none
LEAST_SHARE = 1e-9  # of the largest torque: friction so small stands for none

Path = tuple[str, ...]
"""Keys down to a value in an axis file."""


@dataclass(frozen=True)
class FirstAxis:
    """An axis file that nobody wrote, why each value is what it is (by its path), and what a person should look at."""

    file: AxisFile
    reasons: Mapping[Path, str]
    doubts: tuple[str, ...]
    comparison: Comparison


def first_axis(
    recordings: Sequence[Recording],
    name: str,
    kind: str,
    signals: SignalMap,
    progress: Callable[[Generation], None] = lambda _: None,
) -> FirstAxis:
    """Fit a first axis file to recordings, one data set with common physics.

    Raises InputError when the axis never moves, or no torque is ever applied.
    """
    motion = prepare(recordings)
    if not np.ptp(motion.position) > 0.0 or np.abs(motion.velocity).max() <= motion.resolution:
        raise InputError(recordings[0].source, "the axis never moves", "a recording of motion")
    largest = max(float(np.abs(one.torque).max()) for one in recordings)
    if not largest > 0.0:
        raise InputError(recordings[0].source, "no torque is ever applied", "a recording of a driven axis")
    balance, spread, heavy = _balance(motion, kind)
    turned = _turned(balance, spread)
    if turned:
        balance = -balance
        recordings = [replace(one, torque=-one.torque) for one in recordings]
        signals = replace(signals, torque=replace(signals.torque, scale=-signals.torque.scale))
    guess = _axis(name, kind, balance, heavy, largest)
    guess = replace(guess, torque_unit=same_torque_unit(recordings))
    comparison = compare_laws(recordings, guess, progress=progress, names=LAWS)
    found = _plainest(comparison)
    noise, step = _encoder(recordings)
    sensors, drive = Sensors(noise=noise, resolution=step), Drive(limit=largest)
    axis = replace(identified_axis(guess, found), sensors=sensors, drive=drive)
    fastest = float(np.abs(motion.velocity).max())
    control = _cautious(axis, fastest, float(np.ptp(motion.position)))
    return FirstAxis(
        AxisFile(axis, signals, control),
        _reasons(axis, found, comparison, recordings, fastest, turned),
        _doubts(found, turned),
        comparison,
    )


def _axis(name: str, kind: str, balance: np.ndarray, gravity: bool, largest: float) -> Axis:
    """What a search starts from: the values of `linear_balance`."""
    coulomb = float(max(abs(balance[1]), LEAST_SHARE * largest))
    friction = instance(law("coulomb_viscous"), {"coulomb": coulomb, "viscous": 0.0})
    effects = []
    if gravity:
        sine, cosine = map(float, balance[-2:])
        effects.append(instance(effect("imbalance"), {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine)}))
    return Axis(name, float(abs(balance[0])) or largest, friction, tuple(effects), kind)


def _balance(motion: Motion, kind: str) -> tuple[np.ndarray, np.ndarray, bool]:
    """Values and standard errors of `linear_balance`, and whether gravity is in it.

    It is where a rotary axis covers enough of a turn and gravity earns its two numbers.
    """
    plain = linear_balance(motion)
    if kind == "rotary" and np.ptp(motion.position) >= LEAST_SWING:
        heavy = linear_balance(motion, gravity=True)
        if heavy[2] < plain[2] - CLEARLY:
            return *heavy[:2], True
    return *plain[:2], False


def _turned(balance: np.ndarray, spread: np.ndarray) -> bool:
    """Whether inertia and friction both come out negative, or one clearly so while the other does not speak against it."""
    scores = balance[:2] / np.maximum(spread[:2], 1e-300)
    return bool(scores.min() < -LIKELY_TURNED and scores.max() < LIKELY_TURNED)


def _plainest(comparison: Comparison) -> Identification:
    """The first law in LAWS that errs as little on held-out samples as the best, but for AS_GOOD; the first if there are none."""
    most = (1.0 + AS_GOOD) * comparison.rows[0].held_out
    good = [row.law for row in comparison.rows if math.isnan(most) or row.held_out <= most]
    return comparison.found[min(good, key=LAWS.index)]


def _encoder(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Noise (rad rms) and step (rad) of the position, as far as they show."""
    noises = [choose_cutoff(one.position, float(np.median(np.diff(one.t))))[1] for one in recordings]
    return float(np.median(noises)), float(max(step_of(one.position) for one in recordings))


def _cautious(axis: Axis, fastest: float, travel: float) -> Control:
    control = default_control(axis)
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


def _reasons(
    axis: Axis, found: Identification, comparison: Comparison, recordings: Sequence[Recording], fastest: float, turned: bool
) -> dict[Path, str]:
    rows = ", ".join(
        [*(f"{row.law} {row.held_out:.3g}" for row in comparison.rows), *(f"{law} not fitted" for law in comparison.left_out)]
    )
    unit, length = axis.unit("N m"), axis.unit("rad")
    reasons: dict[Path, str] = {
        ("axis", "kind"): "",
        ("axis", "inertia"): _estimated(found.inertia),
        ("axis", "friction", "law"): f"held-out residual of each: {rows} {unit}",
        ("axis", "sensors", "noise"): f"{length} rms, from the position's spectrum where nothing moves",
        ("axis", "sensors", "resolution"): f"{length}, of which all positions are multiples",
        ("axis", "drive", "limit"): f"{unit}, the largest recorded: whether it can do more is not known",
        ("control", "controller", "velocity_limit"): f"{length}/s, {HEADROOM:g} times the fastest recorded ({fastest:.3g})",
        ("control", "controller", "torque_limit"): f"{unit}, as the drive's",
        ("control", "controller", "position_proportional"): "1/s, cautious: the position loop crosses over at 3 Hz",
        ("control", "controller", "velocity_proportional"): "60 times the inertia: the speed loop crosses over at 10 Hz",
        ("control", "controller", "velocity_integral"): "1000 times the inertia",
        ("control", "controller", "inertia_feedforward"): "the inertia above",
        ("control", "compensator"): "the friction above, as LuGre's; `./tcs identify --law lugre` fits it",
        ("signals", "torque", "scale"): "turned over: friction would drive the motion otherwise" if turned else "",
    }
    for name, estimate in found.parameters.items():
        reasons["axis", "friction", name] = _estimated(estimate)
    seconds = sum(one.duration for one in recordings)
    reasons["axis",] = f"from {seconds:.4g} s in {', '.join(one.source for one in recordings)}"
    return {path: text for path, text in reasons.items() if text}


def _estimated(estimate: Estimate) -> str:
    if not estimate.determined:
        return f"{estimate.unit}, not determined: {estimate.reason}".lstrip(", ")
    spread = f"± {estimate.std:.2g} " if math.isfinite(estimate.std) else ""
    return f"{spread}{estimate.unit}".strip()


def _doubts(found: Identification, turned: bool) -> tuple[str, ...]:
    lines = []
    if not found.inertia.determined:
        lines.append("the inertia, and with it the controller's gains, is not determined: record quicker motion first")
    lacking = [name for name, one in found.parameters.items() if not one.determined]
    if lacking:
        lines.append(f"not determined by this motion: {', '.join(lacking)} of {found.law}")
    if turned:
        lines.append("the recorded torque was turned over, since friction and inertia came out negative")
    return tuple(lines)
