"""How an axis tracks with what is cancelled of it, and what a commissioning would leave it with.

In: a true axis, a model and which of its effects are cancelled. Out: true tracking errors on motions that no diagnosis has seen,
and the choice of the guard, which sees measured tracking, and for errors of the encoder a fresh recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcs_friction.config import default_control
from tcs_friction.control.guard import choose, judged, windowed
from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names
from tcs_friction.control.reference import Reference, reference_from_mapping
from tcs_friction.diagnose.verification import sensor_effects, sensor_gains
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Role, instance
from tcs_friction.recording.recording import Recording

SETTLE = 3.0  # s
RUNS = 2  # of each motion, by which the guard decides


def motions(centre: float) -> list[Reference]:
    """About a position: sidereal tracking, a pass of up to 1.5 deg/s, reversals."""
    tracking: dict[str, object] = {"kind": "constant_speed", "velocity": 7.3e-5, "start": centre, "duration": 40.0}
    to_and_fro = [
        {"kind": "sinusoid", "amplitude": size, "period": period, "duration": seconds, "phase": -0.5 * math.pi, "center": centre}
        for size, period, seconds in ((0.5, 120.0, 60.0), (1e-3, 10.0, 30.0))
    ]
    return [reference_from_mapping(each, "motion") for each in (tracking, *to_and_fro)]


@dataclass(frozen=True)
class Choice:
    """What is cancelled: a model, and which of its effects."""

    model: Axis
    chosen: tuple[str, ...]

    def __hash__(self) -> int:
        return hash((id(self.model), self.chosen))


@dataclass(frozen=True)
class Tracking:
    """True tracking errors over all motions, rad: rms and largest."""

    rms: float
    peak: float


class Bench:
    """One true axis under the controller that its believed inertia implies. fresh: a recording that no diagnosis has seen."""

    def __init__(self, true: Axis, believed: Axis, centre: float, fresh: Recording) -> None:
        self.true, self.fresh = true, fresh
        self.references = motions(centre)
        self.controller = default_control(replace(believed, drive=true.drive)).controller

    def runs(self, choice: Choice, axis: Axis | None = None) -> list[LoopRun]:
        """RUNS of each motion of an axis (default: the true one) that is compensated."""
        left_out = tuple(name for name in effect_names(choice.model) if name not in choice.chosen)
        loop, cancelling = LoopConfig(compensation="model"), Cancellation(choice.model, CancellationConfig(left_out=left_out))
        return [
            simulate_loop(axis or self.true, reference, self.controller, loop, seed=seed, cancellation=cancelling)
            for reference in self.references
            for seed in range(RUNS)
        ]

    def measured(self, choice: Choice) -> np.ndarray:
        """Rms error (w,) in every window of every run, as the encoder says: what the guard is shown."""
        return np.concatenate([windowed(run.t, run.error, SETTLE) for run in self.runs(choice)])

    def tracking(self, choice: Choice, axis: Axis | None = None) -> Tracking:
        """The true errors."""
        runs = self.runs(choice, axis)
        errors = [(run.reference - run.true_position)[run.t >= SETTLE] for run in runs]
        windows = np.concatenate([windowed(run.t, run.reference - run.true_position, SETTLE) for run in runs])
        return Tracking(float(np.sqrt(np.mean(windows**2))), max(float(np.max(np.abs(error))) for error in errors))

    def guarded(self, start: Choice, model: Axis, names: Sequence[str]) -> Choice:
        """What a commissioning would leave the axis with."""
        sensed = [name for name in sensor_effects(model) if name in names]
        gains = sensor_gains([self.fresh], model, sensed) if sensed else {}
        sensed = [name for name in sensed if gains[name].proven]
        others = [name for name in names if name not in sensor_effects(model)]
        found = judged(choose(others, self.measured(start)), lambda effects: self.measured(Choice(model, (*effects, *sensed))))
        if found.effects is not None:
            return Choice(model, (*found.effects, *sensed))
        items = tuple(item for name, item in effect_names(model).items() if name in sensed)
        return Choice(replace(start.model, effects=items), tuple(effect_names(replace(start.model, effects=items))))


@dataclass(frozen=True)
class Outcome:
    """Tracking of one world over its ideal, and the worst that the guard let pass over what was before."""

    named: bool  # all of them, and nothing else
    before: float
    after: float
    peak_before: float
    peak_after: float
    worst: float
    line: str


def spoilt(model: Axis, rng: np.random.Generator) -> dict[str, Axis]:
    """Models that are wrong: amplitudes with the other sign, phases a quarter off, an effect that is not there."""

    def changed(change: Callable[[Any, float], float]) -> Axis:
        items = tuple(
            item.replace(**{p.name: min(max(change(p, item.values[p.name]), p.lower), p.upper) for p in item.term.parameters})
            for item in model.effects
        )
        return replace(model, effects=items)

    ghost = instance(effect("cogging"), {"order": 113.0, "amplitude": rng.uniform(2.0, 10.0), "phase": 1.0})
    error = instance(effect("encoder_periodic_error"), {"order": 29.0, "amplitude": rng.uniform(1e-6, 1e-5), "phase": 1.0})
    return {
        "sign": changed(lambda p, value: -value if p.role is Role.LINEAR else value),
        "phase": changed(lambda p, value: value + 0.5 * math.pi if p.role is Role.PHASE else value),
        "ghost": model.with_effect(ghost),
        "ghost of the encoder": model.with_effect(error),
    }
