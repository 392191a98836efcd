"""The next experiment: which motion would tell two effects apart that the recordings cannot.

For each motion of a small library both models, fitted to the same data, say what torque they would need. What retuning the one
to mimic the other absorbs is projected out, both ways; the motion whose predictions still differ most is
proposed, as a reference that `simulate` and the graph run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.dataset.excitation import FASTER
from tcs_friction.diagnose.fit.parameters import FreeNumber, free_parameters, moved
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Need

DURATION = 60.0  # s, of most motions
LONG = 300.0  # s, of the one that shows slow changes
USED = 0.9  # of the travel seen
SETTLED = 0.5  # s at the start that are not compared
WORTH_A_RECORDING = 0.05  # of the effects' own torque: predictions that differ by less are not worth a recording


@dataclass(frozen=True)
class Proposal:
    """One motion: its reference block, what it is in words, the torque by which the predictions differ, N m rms."""

    reference: Mapping[str, Any]
    words: str
    difference: float


def next_experiment(
    axis: Axis, a: Instance, b: Instance, data: DataSet, noise_floor: float = 0.0
) -> dict[str, Any] | None:
    """What to record to tell effect `a` from effect `b`; None when no motion within reach would.

    axis: without either of them. a, b: as fitted, each alone. data: whose travel, speeds and recorded signals bound the motion.
    noise_floor: N m rms; a difference below it is not proposed.

    Returns `{"reference": {...}, "separates": [a, b], "why": line, "difference": N m rms}`; `reference_text` makes the file.
    """
    own = _difference_rms(axis, a, data)
    slow = any(Need.DURATION in item.term.needs for item in (a, b))
    proposals = [
        _judge(axis, a, b, data, reference, words)
        for reference, words in library(data, axis)
        if slow or "duration" not in reference
    ]
    found = [p for p in proposals if p is not None]
    if not found:
        return None
    best = max(found, key=lambda p: p.difference)
    if best.difference < max(WORTH_A_RECORDING * own, 0.3 * noise_floor):
        return None
    unit = unit_of("torque", axis)
    why = f"{best.words}: {a.term.id} and {b.term.id} then differ by {best.difference:.3g} {unit} rms that no retuning absorbs"
    return {
        "reference": dict(best.reference),
        "separates": [a.term.id, b.term.id],
        "why": why,
        "difference": best.difference,
    }


def reference_text(experiment: Mapping[str, Any]) -> str:
    """The experiment as a reference file; why is a comment on top."""
    return f"# {experiment['why']}\n" + yaml.safe_dump(
        {"reference": experiment["reference"]}, sort_keys=False
    )


def library(data: DataSet, axis: Axis) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Motions within the travel seen and up to FASTER times the speed seen, each with its words."""
    position, speed = data.joined("position"), np.abs(data.joined("velocity"))
    lowest, highest = float(position.min()), float(position.max())
    middle, half = 0.5 * (lowest + highest), 0.5 * USED * (highest - lowest)
    moving = speed[data.moving()]
    if len(moving) < 20 or half <= 0.0:
        return
    slow, fast = (float(x) for x in np.percentile(moving, [5, 99]))
    hardest = float(np.percentile(np.abs(data.joined("acceleration")), 99))
    unit = unit_of("velocity", axis)
    speeds = (
        ("slow", slow),
        ("medium", math.sqrt(slow * fast)),
        ("fast", fast),
        ("twice as fast as recorded", FASTER * fast),
    )
    for name, top in speeds:
        period = min(max(10.0, 2.0 * math.pi * top / hardest), 2.0 * math.pi * half / top)
        yield (
            {
                "kind": "sinusoid",
                "amplitude": top * period / (2.0 * math.pi),
                "period": period,
                "center": middle,
            },
            f"{name} sinusoid, up to {top:.3g} {unit}",
        )
        reversal = 4.0 * top / hardest
        leg = min(10.0, half / top - reversal)
        if leg > 0.0:
            yield (
                {"kind": "legs", "speed": top, "leg": leg, "acceleration": hardest, "start": middle},
                f"{name} legs of constant speed, {top:.3g} {unit}, to and fro",
            )
    across = min(2.0 * half / (0.5 * DURATION - 2.0), fast)
    yield (
        {
            "kind": "legs",
            "speed": across,
            "leg": max(2.0 * half / across - 2.0 * across / hardest, 0.0),
            "acceleration": hardest,
            "start": lowest,
        },
        f"the whole travel at constant speed, {across:.3g} {unit}, there and back",
    )
    count = 20
    top = fast / math.sqrt(count)
    lowest_frequency = max(0.1, 2.0 * top / (2.0 * math.pi * half))
    for name, highest_frequency in (("slow", 2.0), ("fast", 0.6 * data.cutoff)):
        step = max((highest_frequency - lowest_frequency) / count, 1e-3)
        limit = hardest / (2.0 * math.pi * highest_frequency) * 2.0 / math.sqrt(count)
        yield (
            {
                "kind": "multisine",
                "velocity_amplitude": min(top, FASTER * limit),
                "lowest_frequency": lowest_frequency,
                "frequency_step": step,
                "components": count,
                "center": middle,
            },
            f"{name} multisine, {lowest_frequency:.2g} to {highest_frequency:.2g} Hz",
        )
    yield (
        {
            "kind": "legs",
            "speed": fast,
            "leg": min(10.0, half / fast),
            "acceleration": hardest,
            "start": middle,
            "duration": LONG,
        },
        f"legs at {fast:.3g} {unit} for {LONG:g} s from a cold start",
    )


def _judge(
    axis: Axis, a: Instance, b: Instance, data: DataSet, reference: Mapping[str, Any], words: str
) -> Proposal | None:
    placed = _placed({"duration": DURATION, **reference}, data)
    if placed is None:
        return None
    block, t, motion = placed
    signals = _signals(data, len(t))
    demanded = _balance(axis, data, t, motion, signals, np.zeros(len(t)))
    command = -demanded  # the torque that the axis without either would need

    def residual(candidate: Axis) -> np.ndarray:
        return _balance(candidate, data, t, motion, signals, command)

    first, second = axis.with_effect(a), axis.with_effect(b)
    of_first, of_second = residual(first), residual(second)
    kept = np.flatnonzero(t > SETTLED)[:: data.stride]
    apart = (of_first - of_second)[kept]
    differences = [
        float(np.sqrt(np.mean(_without(apart, _columns(residual, model, here, kept)) ** 2)))
        for model, here in ((first, of_first), (second, of_second))
    ]
    difference = min(differences)  # that remains when either is retuned to mimic the other
    return Proposal(block, words, difference) if math.isfinite(difference) else None


def _columns(residual: Any, axis: Axis, here: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Derivatives (kept, k) of the residual by everything that a joint fit of this axis would change."""
    free: list[FreeNumber] = free_parameters(axis, 1e-3 * max(float(np.std(here)), 1e-12))
    columns = np.empty((len(kept), len(free)))
    for k, f in enumerate(free):
        columns[:, k] = (residual(moved(axis, free, k, f.step)) - here)[kept] / f.step
    return columns


def _without(x: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """x (n,) without what the columns (n, k) explain."""
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0.0] / norms[norms > 0.0]
    if not columns.shape[1]:
        return x
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    left = left[:, singular > 1e-6 * singular[0]]
    return np.asarray(x - left @ (left.T @ x))


def _placed(
    block: Mapping[str, Any], data: DataSet
) -> tuple[dict[str, Any], np.ndarray, np.ndarray] | None:
    """The reference block in the middle of the travel, times (n,) and motion (n, 3); None when it does not fit."""
    position = data.joined("position")
    lowest, highest = float(position.min()), float(position.max())
    fastest = float(np.abs(data.joined("velocity")).max())
    step = data.dt / data.stride
    t = step * np.arange(round(float(block["duration"]) / step))
    motion = reference_from_mapping(block, "next experiment").over(t)
    middle = 0.5 * (motion[:, 0].min() + motion[:, 0].max())
    shift = 0.5 * (lowest + highest) - middle
    where = "start" if "start" in block else "center"
    placed = {name: float(f"{x:.6g}") if isinstance(x, float) else x for name, x in block.items()}
    placed[where] = float(f"{block[where] + shift:.9g}")
    motion[:, 0] += shift
    if motion[:, 0].min() < lowest or motion[:, 0].max() > highest:
        return None
    if np.abs(motion[:, 1]).max() > FASTER * 1.01 * fastest:
        return None
    return placed, t, motion


def _signals(data: DataSet, count: int) -> np.ndarray:
    """Recorded temperature and exogenous signals (1 + s, count), repeated as often as needed."""
    recorded = max((s.signals for s in data.stretches), key=lambda x: x.shape[1])
    return np.ascontiguousarray(recorded[:, np.arange(count) % recorded.shape[1]])


def _balance(
    axis: Axis, data: DataSet, t: np.ndarray, motion: np.ndarray, signals: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Torque at the rotor less what the motion requires, (n,)."""
    out = np.empty((len(t), 8))
    compiled = machine.build(axis, data.dt / data.stride, signals=data.names, position=float(motion[0, 0]))
    position, velocity, acceleration = (np.ascontiguousarray(motion[:, k]) for k in range(3))
    resolution = data.speed_resolution
    machine.evaluate(compiled, t, position, velocity, acceleration, torque, signals, resolution, out)
    return np.asarray(out[:, machine.ROTOR] - out[:, machine.REQUIRED])


def _difference_rms(axis: Axis, a: Instance, data: DataSet) -> float:
    """Torque rms of the effect over the recordings' longest stretch."""
    s = max(data.stretches, key=lambda stretch: len(stretch.t))
    motion = np.stack([s.position, s.velocity, s.acceleration], axis=1)
    parts = [_balance(x, data, s.t, motion, s.signals, s.torque) for x in (axis, axis.with_effect(a))]
    return float(np.sqrt(np.mean((parts[1] - parts[0]) ** 2)))
