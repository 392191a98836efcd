"""Which of the own worlds are drawn, and what is right to say of each."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.concealed_effects import EFFECTS, OUTSIDE
from benchmarks.concealed_score import Expected
from benchmarks.trials import Trial
from benchmarks.worlds import World, draw_world

CLASSES = ("none", "one", "two", "three", "outside")
SMALLEST, LARGEST = 1.0, 8.0  # sizes of concealed effects, torque rms over that of the noise floor
NATURAL = ("presliding",)  # effects that come as large as they are
LIMITED = [name for name in EFFECTS if name not in (*OUTSIDE, *NATURAL)]  # that have a detection limit


@dataclass(frozen=True)
class Case:
    """One world to draw: how many effects or which, seeds, length."""

    kind: str
    effects: tuple[str, ...] | int
    seed: tuple[int, ...]
    stretch: float
    size: float | None = None

    @property
    def name(self) -> str:
        """Class and number, by which `--only` finds it."""
        return f"{self.kind}-{self.seed[-1]}"


def draw_cases(seed: int, worlds: int, stretch: float, only: str | None = None) -> list[Case]:
    """Every effect alone so many times, and about as many others as their bars need."""
    known = [name for name in EFFECTS if name not in OUTSIDE]
    wanted: list[tuple[str, tuple[str, ...] | int]] = []
    wanted += [("one", (name,)) for name in known] * worlds
    wanted += [("none", ())] * 10 * worlds
    wanted += [("two", 2)] * 14 * worlds
    wanted += [("three", 3)] * 6 * worlds
    wanted += [("outside", (name,)) for name in OUTSIDE] * 2 * worlds
    cases = [Case(kind, effects, (seed, i), stretch) for i, (kind, effects) in enumerate(wanted)]
    return [case for case in cases if only in (None, case.kind, case.name)]


def world_of(case: Case) -> World:
    """The case's world; sizes between SMALLEST and LARGEST unless it says one."""
    rng = np.random.default_rng(case.seed)
    size = (
        case.size if case.size is not None else math.exp(rng.uniform(math.log(SMALLEST), math.log(LARGEST)))
    )
    return draw_world(rng, case.effects, size, case.stretch)


def expected_of(world: World) -> Expected:
    """What is right to say of one of the own worlds."""
    known = tuple((name,) for name in world.truth.effects if name not in OUTSIDE)
    return Expected(known, world.truth.noise_floor, outside=len(known) < len(world.truth.effects))


def own_trial(case: Case) -> Trial:
    """One of the own worlds as every kind of world is asked about."""
    world = world_of(case)
    details = asdict(world.truth)
    del details["effects"], details["noise_floor"]
    note = f"concealed: {', '.join(world.truth.effects) or 'nothing'}"
    return Trial(case.name, world.recording, world.believed, expected_of(world), note, details)
