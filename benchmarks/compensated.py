"""Tracking for having been diagnosed: concealed worlds diagnosed, what was named cancelled, and tracked on motions never seen.

Each axis hides one effect that can be cancelled, or two. It is diagnosed from a recording by the second simulator of
`concealed_physics`; then the product's loop moves the true axis on three other motions (sidereal tracking, a satellite's pass,
reversals), each with friction as believed, with what the diagnosis names, and with the effect switched off. The guard decides on
measured tracking as a commissioning does, and for errors of the encoder on a fresh recording, of a diagnosis as it is and of ones
that were spoilt: with other signs, other phases, and effects that are not there.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.compensated_tracking import Bench, Choice, Outcome, spoilt
from benchmarks.concealed_effects import EFFECTS, compatible
from benchmarks.worlds import World, draw_world
from tcs_friction.config import load_axis, shipped
from tcs_friction.control.model_compensator import effect_names, obstacles
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import TcsError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import instance

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


def true_axis(world: World) -> Axis:
    """The world's axis in the product's terms, with the shipped telescope's encoder and drive."""
    telescope = load_axis(shipped("azimuth_1p2m.yaml")).axis
    items = tuple(instance(effect(name), world.truth.parameters[name]) for name in world.truth.effects)
    friction = instance(law("lugre"), world.truth.friction)
    believed = world.believed.axis
    return replace(telescope, name=believed.name, inertia=world.truth.inertia, friction=friction, effects=items)


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
