"""The kinds of worlds that `./tcs bench concealed` knows beside its own: their names, one of them made, one diagnosed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks import (
    law_worlds,
    logged_worlds,
    misspecified_worlds,
    mujoco_worlds,
    practice_worlds,
    real_worlds,
)
from benchmarks.concealed_floor import attainable
from benchmarks.concealed_score import Judged, failed, judge
from benchmarks.trials import Trial, save_trial
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.errors import TcsError

OWN, ALL = "own", "all"


@dataclass(frozen=True)
class Kind:
    """A kind of worlds: the names of all its worlds, and the world of a name and a seed.

    recorded: where they are recorded and not drawn, the folder of each; InputError where it is missing.
    """

    names: Callable[[], list[str]]
    world: Callable[[str, int], Trial]
    recorded: Callable[[str], Path] | None = None


KINDS: Mapping[str, Kind] = {
    "mujoco": Kind(mujoco_worlds.names, mujoco_worlds.world),
    "misspecified": Kind(misspecified_worlds.names, misspecified_worlds.world),
    "laws": Kind(law_worlds.names, law_worlds.world),
    "logged": Kind(logged_worlds.names, logged_worlds.world),
    "practice": Kind(practice_worlds.names, practice_worlds.world, practice_worlds.folder_of),
    "real": Kind(real_worlds.names, real_worlds.world, real_worlds.folder_of),
}
DRAWN = [OWN, *(name for name, kind in KINDS.items() if kind.recorded is None)]


@dataclass(frozen=True)
class Task:
    """One world to make: the kind, its name, the seed."""

    kind: str
    name: str
    seed: int


def tasks_of(kind: str, seed: int, only: str | None) -> list[Task]:
    """The worlds of that kind, or the one of that name. InputError where one is recorded and missing."""
    names = [name for name in KINDS[kind].names() if only in (None, name)]
    if (recorded := KINDS[kind].recorded) is not None:
        for name in names:
            recorded(name)
    return [Task(kind, name, seed) for name in names]


def solve(task: Task) -> Judged:
    """Make a world and judge the diagnosis of it. A diagnosis that refuses is a wrong one."""
    trial = KINDS[task.kind].world(task.name, task.seed)
    begin = time.perf_counter()
    try:
        found = diagnose([trial.recording], trial.believed).to_mapping()
    except TcsError as error:
        return failed(task.name, task.kind, trial.expected, str(error), time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    floor = attainable(trial.recording, trial.believed.axis, trial.true) if trial.true is not None else None
    return judge(task.name, task.kind, trial.expected, found, seconds, floor)


def save(task: Task, folder: Path) -> Path:
    """Write a world to FOLDER/KIND/NAME for `./tcs diagnose`; returns where it is."""
    place = folder / task.kind / task.name
    save_trial(KINDS[task.kind].world(task.name, task.seed), place)
    return place
