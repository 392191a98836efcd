"""`./tcs bench compensated --plant mujoco`: axes on an engine that nobody here wrote, both recorded and tracked with.

Each is a telescope's axis of `mujoco_worlds` in which the engine makes one effect that a feed-forward can cancel: a motor that
cogs, a mass off centre, springs, a slipping cable, drag. The ideal is the same axis without it, its friction known.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.compensated_tracking import RUNS, Bench, Choice, Outcome, spoilt
from benchmarks.mujoco_axis import Model, run
from benchmarks.mujoco_effects import Truth
from benchmarks.mujoco_worlds import PARTS, believe, draw
from benchmarks.trials import rng_of, signals_of
from tcs_friction.config import AxisFile, load_axis, shipped
from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names, obstacles
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import TcsError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.physics.registry import law
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

KNOWN = ("cogging", "gravity", "spring", "drag", "bias", "mode", "cable-friction", "tendon", "slack-cable")
"""Parts of `mujoco_worlds` that need nothing but the model: what they do follows from the axis' motion."""
SIZES = (3.0, 6.0, 12.0)  # torque rms over that of the noise
STEP = 2.5e-4  # s, of the engine while tracking; with 1e-4 s the errors differ by less than 1 %


@dataclass(frozen=True)
class EngineWorld:
    """An axis on the engine: its recording, what is believed, what is right to say, and models with the effect and without."""

    name: str
    recording: Recording
    fresh: Recording
    believed: AxisFile
    truth: Truth
    friction: Axis  # the axis with its true friction and inertia, no effect
    model: str
    plain: str


def world(name: str, size: float, rng: np.random.Generator) -> EngineWorld:
    """A telescope's axis with one effect, `size` times as large as the noise."""
    seed = int(rng.integers(2**31))
    plain = draw(np.random.default_rng(seed), True, False, False)
    s = draw(np.random.default_rng(seed), True, False, False)
    s.size = size
    truth = PARTS[name](s)
    recording = run(s.model, s.motion, s.loop, s.rng)
    file = AxisFile(believe(s.rng, s, "lugre", None), signals_of(recording))
    telescope = load_axis(shipped("azimuth_1p2m.yaml")).axis
    friction = instance(law("lugre"), s.friction)
    true = replace(telescope, name=file.axis.name, inertia=s.inertia, friction=friction, effects=())
    fresh = run(s.model, s.motion, s.loop, s.rng)
    return EngineWorld(name, recording, fresh, file, truth, true, _text(s.model), _text(plain.model))


def _text(model: Model) -> str:
    """The model as the plant takes it: without its drive, for torque is applied to the joint."""
    return replace(model, drive="").xml(STEP)


class EngineBench(Bench):
    """The same tracking and guard on the engine. Runs of one choice are made once."""

    def __init__(self, made: EngineWorld, folder: Path) -> None:
        super().__init__(made.friction, made.believed.axis, float(np.median(made.recording.position)), made.fresh)
        self._models = {True: folder / "model.xml", False: folder / "plain.xml"}
        self._models[True].write_text(made.model)
        self._models[False].write_text(made.plain)
        self._runs = lru_cache(maxsize=4)(self._made)

    def runs(self, choice: Choice, axis: Axis | None = None) -> list[LoopRun]:
        """RUNS of each motion: of the model with its effect, or of that without where an `axis` is given, which is without it."""
        return self._runs(choice, axis is None)

    def _made(self, choice: Choice, whole: bool) -> list[LoopRun]:
        left_out = tuple(name for name in effect_names(choice.model) if name not in choice.chosen)
        loop, cancelling = LoopConfig(compensation="model"), Cancellation(choice.model, CancellationConfig(left_out=left_out))
        path = self._models[whole]

        def plant(of: Axis, period: float, seed: int, position: float) -> Simulator:
            return MujocoSimulator(of, path, "axis", period, seed, position)

        return [
            simulate_loop(self.true, reference, self.controller, loop, seed=seed, cancellation=cancelling, plant=plant)
            for reference in self.references
            for seed in range(RUNS)
        ]


def outcome(made: EngineWorld, rng: np.random.Generator) -> Outcome:
    """Diagnose one world and track with what came of it."""
    found = diagnose([made.recording], made.believed)
    with tempfile.TemporaryDirectory() as folder:
        return judged_on(EngineBench(made, Path(folder)), made, found, rng)


def judged_on(bench: EngineBench, made: EngineWorld, found: Diagnosis, rng: np.random.Generator) -> Outcome:
    """Tracking before and after, of the diagnosis as it is and of spoilt ones."""
    model, named = found.axis_file.axis, {one.instance.identity for one in found.effects}
    names = [name for name, item in effect_names(model).items() if item.identity in named and name not in obstacles(model)]
    ideal = bench.tracking(Choice(made.friction, ()), made.friction)
    start = Choice(made.believed.axis, ())
    before = bench.tracking(start)
    after = bench.tracking(bench.guarded(start, model, names))
    worst = after.rms / before.rms
    for wrong in spoilt(model, rng).values():
        try:
            kept = bench.guarded(start, wrong, [name for name in effect_names(wrong) if name not in obstacles(wrong)])
        except TcsError:
            continue  # refused before it acts
        worst = max(worst, bench.tracking(kept).rms / before.rms)
    right = named_right([one.effect for one in found.effects], made.truth)
    (rms, peak), (rms_after, peak_after) = ((one.rms / ideal.rms, one.peak / ideal.peak) for one in (before, after))
    line = (
        f"{made.name:50s} {'named' if right else 'not  '} rms {rms:6.3f} to {rms_after:6.3f} "
        f"peak {peak:6.3f} to {peak_after:6.3f} worst {worst:6.3f}  {', '.join(one.effect for one in found.effects)}"
    )
    return Outcome(right, rms, rms_after, peak, peak_after, worst, line)


def named_right(names: list[str], truth: Truth) -> bool:
    """Whether a diagnosis names the effect and nothing else, and the vocabulary has just this effect."""
    fits = len(names) == len(truth.effects) and all(set(one) & set(names) for one in truth.effects)
    return fits and not truth.partial


def outcomes(count: int, seed: int) -> Iterator[Outcome]:
    """Of `count` worlds: each of KNOWN in turn, in all sizes."""
    for number in range(count):
        rng = rng_of(f"engine-{number}", seed)
        made = world(KNOWN[number % len(KNOWN)], SIZES[number // len(KNOWN) % len(SIZES)], rng)
        yield outcome(made, rng)
