"""Results under any umask, and of runs that are killed while they write: never of another mode, never of two runs."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import random
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.hostile_bags import Maker
from tcs_friction.cli import main
from tcs_friction.commands import diagnose, identify
from tcs_friction.config import write_whole
from tcs_friction.errors import InputError
from tcs_friction.report import diagnosis_files, identification_files
from tcs_friction.writable import staged

ROWS = 200
RUNS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "identify": (identify.WRITTEN, identification_files.SOMETIMES),
    "diagnose": (diagnose.WRITTEN, diagnosis_files.SOMETIMES),
    "new": (("axis.yaml",), ()),
}
"""Command -> files of every run, patterns of those of some."""


def umask(path: Path, size: int) -> Path:
    """A umask; the owner may read and write all the same."""
    path.write_text(json.dumps({"umask": size & 0o177}))
    return path


def kill(path: Path, size: int) -> Path:
    """A run of a command over the files of another, killed at one of its changes of a name."""
    chance = random.Random(f"kill {size}")
    path.write_text(json.dumps({"kill": chance.choice([*RUNS]), "change": chance.randint(0, 20), "size": size}))
    return path


def reading_writing(path: Path) -> list[Callable[[], object]]:
    """What was drawn, in a process of its own."""
    drawn = json.loads(path.read_text())
    folder = path.with_suffix(".out")
    folder.mkdir()
    return [lambda: _masked(folder, drawn["umask"]) if "umask" in drawn else _killed(folder, **drawn)]


def _masked(folder: Path, mask: int) -> None:
    table, bag, out = folder / "in.csv", folder / "bag", folder / "out.csv"
    table.write_text("time,position,torque\n" + "".join(f"{k / 100},{k * k / 1e4},{k % 7}\n" for k in range(ROWS)))
    table.chmod(0o600)
    before = os.umask(mask)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            status = main(["bag", "import", str(table), "-o", str(bag)])
        with staged(folder / "results") as part:
            write_whole(part / "axis.yaml", "axis: {}\n")
        write_whole(out, "time\n")
    finally:
        os.umask(before)
    wrong = [one for one in folder.rglob("*") if one.is_file() and one != table and one.stat().st_mode & 0o777 != 0o666 & ~mask]
    if status or wrong:
        raise AssertionError(f"status {status}, umask {mask:o}: {[(str(one), oct(one.stat().st_mode)) for one in wrong]}")
    raise InputError("umask", f"{mask:o} was kept")


def _killed(folder: Path, kill: str, change: int, size: int) -> None:
    chance = random.Random(size)
    always, sometimes = RUNS[kill]
    some = [name.replace("[0-9]*", "1_x") for name in sometimes]
    for name in {*always, *chance.sample(some, len(some) // 2)}:
        (folder / name).write_text("old")
    child = os.fork()
    if child == 0:
        _dies_writing(folder, kill, change, {*always, *chance.sample(some, len(some) // 2)})
    os.waitpid(child, 0)
    found = {one.read_text() for one in folder.iterdir() if one.is_file() and ".part" not in one.name}
    if len(found) > 1:
        raise AssertionError(f"{kill}, killed at change {change}: files of two runs")
    raise InputError(kill, f"was killed at change {change}")


def _dies_writing(folder: Path, command: str, change: int, names: set[str]) -> None:
    left = itertools.count(change, -1)

    def counted(work: Callable[..., Any]) -> Callable[..., Any]:
        def last(*words: Any, **more: Any) -> Any:
            if next(left) == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return work(*words, **more)

        return last

    try:
        for place, name in ((os, "replace"), (Path, "unlink"), (Path, "replace")):
            setattr(place, name, counted(getattr(place, name)))
        if command == "new":
            write_whole(folder / "axis.yaml", "new")
        else:
            with staged(folder, *RUNS[command][1]) as part:
                for name in names:
                    (part / name).write_text("new")
    finally:
        os._exit(0)


WRITING: dict[Maker, tuple[int, int]] = {umask: (1, 0o177), kill: (1, 1_000_000)}
