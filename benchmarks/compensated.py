"""Tracking for having been diagnosed: concealed worlds diagnosed, what was named cancelled, and tracked on motions never seen.

Each axis hides one effect that can be cancelled, or two. It is diagnosed from a recording by the second simulator of
`concealed_physics`; then the product's loop moves the true axis on three other motions (sidereal tracking, a satellite's pass,
reversals), each with friction as believed, with what the diagnosis names, and with the effect switched off. The guard decides on
measured tracking as a commissioning does, and for errors of the encoder on a fresh recording, of a diagnosis as it is and of ones
that were spoilt: with other signs, other phases, and effects that are not there.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.concealed_effects import EFFECTS, compatible
from benchmarks.worlds import World, draw_world
from tcs_friction.config import default_control, load_axis, shipped
from tcs_friction.control.guard import choose, judged, windowed
from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names, obstacles
from tcs_friction.control.reference import Reference, reference_from_mapping
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.verification import sensor_effects, sensor_gains
from tcs_friction.errors import TcsError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import Role, instance
from tcs_friction.recording.recording import Recording

SETTLE = 3.0  # s
RUNS = 2  # of each motion, by which the guard decides
SIZES = (1.5, 3.0, 6.0)  # torque rms over that of the noise
PAIRS = 0.3  # share of the worlds
WORSE = 1.02
PERCENT = 95.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--worlds", type=int, default=40, help="how many (default 40, about 15 minutes)")
    parser.add_argument("--seed", type=int, default=0, help="that they are drawn with (default 0)")
    plants = ("simulated", "mujoco")
    parser.add_argument("--plant", choices=plants, default=plants[0], help="mujoco: axes of an engine (minutes each)")
    parser.add_argument("--show", action="store_true", help="a line for each world")


def cancellable() -> list[str]:
    """Effects that a feed-forward cancels without a thermometer or another signal; parts of the law are the law's."""
    known = {name: term for name, term in effects().items() if not term.features}
    return [
        name
        for name in EFFECTS
        if name in known and not (known[name].obstacle or known[name].temperature or known[name].signals)
    ]


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


def true_axis(world: World) -> Axis:
    """The world's axis in the product's terms, with the shipped telescope's encoder and drive."""
    telescope = load_axis(shipped("azimuth_1p2m.yaml")).axis
    items = tuple(instance(effect(name), world.truth.parameters[name]) for name in world.truth.effects)
    friction = instance(law("lugre"), world.truth.friction)
    believed = world.believed.axis
    return replace(telescope, name=believed.name, inertia=world.truth.inertia, friction=friction, effects=items)


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


def outcome(world: World, rng: np.random.Generator) -> Outcome:
    """Diagnose one world and track with what came of it."""
    true, believed = true_axis(world), world.believed.axis
    found = diagnose([world.recording], world.believed)
    model = found.axis_file.axis
    named = {one.instance.identity for one in found.effects}
    hindered = obstacles(model)
    names = [name for name, item in effect_names(model).items() if item.identity in named and name not in hindered]
    bench = Bench(true, believed, float(np.median(world.recording.position)), world.recorded_again(rng))
    plain = replace(true, effects=())
    ideal = bench.tracking(Choice(plain, ()), plain)
    start = Choice(believed, ())
    before, after = bench.tracking(start), bench.tracking(bench.guarded(start, model, names))
    worst = after.rms / before.rms
    for wrong in spoilt(model, rng).values():
        try:
            kept = bench.guarded(start, wrong, [name for name in effect_names(wrong) if name not in obstacles(wrong)])
        except TcsError:
            continue  # refused before it acts
        worst = max(worst, bench.tracking(kept).rms / before.rms)
    right = sorted(one.effect for one in found.effects) == sorted(world.truth.effects)
    (rms, peak), (rms_after, peak_after) = ((one.rms / ideal.rms, one.peak / ideal.peak) for one in (before, after))
    line = (
        f"{'+'.join(world.truth.effects):50s} {'named' if right else 'not  '} rms {rms:6.3f} to {rms_after:6.3f} "
        f"peak {peak:6.3f} to {peak_after:6.3f} worst {worst:6.3f}"
    )
    return Outcome(right, rms, rms_after, peak, peak_after, worst, line)


def draw(count: int, seed: int) -> list[tuple[tuple[str, ...], float, np.random.Generator]]:
    """Effects, size and generator of each world."""
    known, result = cancellable(), []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        chosen: tuple[str, ...] = (known[number % len(known)],)
        if number >= (1.0 - PAIRS) * count:
            while True:
                chosen = tuple(str(name) for name in rng.choice(known, 2, replace=False))
                if compatible(chosen):
                    break
        result.append((chosen, SIZES[number % len(SIZES)], rng))
    return result


def made(arguments: argparse.Namespace) -> Iterator[Outcome]:
    """The outcome of each world in turn."""
    if arguments.plant == "mujoco":
        from benchmarks.compensated_mujoco import outcomes

        yield from outcomes(arguments.worlds, arguments.seed)
        return
    for chosen, size, rng in draw(arguments.worlds, arguments.seed):
        yield outcome(draw_world(rng, chosen, size), rng)


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: how many were named, tracking over the ideal before and after, the worst that the guard let pass."""
    outcomes = []
    for one in made(arguments):
        outcomes.append(one)
        if arguments.show:
            print(one.line, flush=True)
    named = [one for one in outcomes if one.named]
    rows: list[dict[str, Any]] = [{"name": "named right, of worlds", "value": len(named), "unit": "", "beside": len(outcomes)}]
    for words, some in (("named right", named), ("all", outcomes)):
        if not some:
            continue
        for quantity, names in (("rms", ("before", "after")), ("peak", ("peak_before", "peak_after"))):
            before, after = (np.array([getattr(one, name) for one in some]) for name in names)
            for kind, pick in (("median", np.median), (f"{PERCENT:g} %", lambda x: np.percentile(x, PERCENT))):
                row = {"name": f"{quantity} over ideal, {words}, {kind}, beside before", "value": float(pick(after)), "unit": ""}
                rows.append(row | {"beside": float(pick(before)), "ratio": float(pick(after) / pick(before))})
    worst = max(one.worst for one in outcomes)
    rows.append({"name": "worst over before, spoilt models too, beside the limit", "value": worst, "unit": "", "beside": WORSE})
    return rows
