"""Places that cannot be written are refused before the work; a disk that fills in its midst costs one line and nothing else."""

from __future__ import annotations

import argparse
import importlib
import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from full_disk import full_beyond

from tcs_friction import cli, config, writable
from tcs_friction.commands.parser import parser_of
from tcs_friction.errors import InputError, JobError
from tcs_friction.recording import tables
from tcs_friction.recording.bags import Bag
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.record import BagRecorder
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.write import write_recording
from tcs_friction.report.figures import Picture

TABLE = "time,position,torque,velocity,reference\n" + "".join(
    f"{k * 1e-3},{np.sin(k)},{np.cos(k)},{np.sin(k / 3)},{np.cos(k / 3)}\n" for k in range(2000)
)
AXIS = "azimuth_1p2m.yaml"
CHECKED = (writable.output_directory, writable.output_file, writable.new_output)


@pytest.mark.parametrize("check", CHECKED)
def test_a_place_that_takes_nothing_is_refused_and_left_as_it_is(check: Callable[[Path], Path], tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert check(tmp_path / "new" / "deep") == tmp_path / "new" / "deep"
    for place in (tmp_path / "file" / "out", Path("/proc/out"), tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="cannot be written"):
            check(place)
    with full_beyond(writable.ROOM // 2), pytest.raises(InputError, match=r"deep: cannot be written \(File too large\)"):
        check(tmp_path / "new" / "deep")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_wrong_kind_of_output_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    assert writable.output_directory(tmp_path) == tmp_path
    assert writable.output_file(tmp_path / "file") == tmp_path / "file"
    for check, name, reason in (
        (writable.output_directory, "file", "is a file"),
        (writable.output_file, "", "is a directory"),
        (writable.output_file, "/dev/null", "is no ordinary file"),
        (writable.new_output, "file", "exists already"),
        (writable.new_output, "link", "exists already"),
    ):
        with pytest.raises(InputError, match=reason):
            check(tmp_path / name)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("check", [*CHECKED, writable.output_place])
def test_no_name_is_not_the_working_directory(check: Callable[[str], object]) -> None:
    with pytest.raises(InputError, match="output: '', expected a "):
        check("")


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o007, 0o000])
def test_the_umask_says_who_may_read(umask: int, tmp_path: Path) -> None:
    recording = Recording(np.arange(9) / 100.0, np.zeros(9), np.ones(9))
    signals = tables.default_signals("axis", ("position", "torque"), ())
    before = os.umask(umask)
    try:
        config.write_whole(tmp_path / "text", "x")
        tables.export_table(recording, tmp_path / "table.csv")
        tables.export_table(recording, tmp_path / "table.parquet")
        write_recording(tmp_path / "bag", recording, signals)
        with writable.staged(tmp_path / "made") as part:
            (part / "file").touch()
    finally:
        os.umask(before)
    assert (tmp_path / "bag").stat().st_mode & 0o777 == 0o777 & ~umask
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == 6
    assert {path.stat().st_mode & 0o777 for path in files} == {0o666 & ~umask}


def test_results_are_swapped_when_all_are_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")

    def interrupted() -> None:
        with writable.staged(tmp_path) as part:
            (part / "a").write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").read_text() == "old"
    with writable.staged(tmp_path) as part:
        (part / "a").write_text("new")
        assert (tmp_path / "a").read_text() == "old"
    assert (tmp_path / "a").read_text() == "new"


def killed(change: int, folder: Path) -> None:
    """In a process of its own: a run that is killed at one of its changes of a name."""
    left = itertools.count(change, -1)

    def counted(work: Callable[..., None]) -> Callable[..., None]:
        def last(*words: Any, **more: Any) -> None:
            if next(left) == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            work(*words, **more)

        return last

    os.replace, Path.unlink = counted(os.replace), counted(Path.unlink)  # type: ignore[assignment, method-assign]
    with writable.staged(folder, "only_some.*") as part:
        for name in ("b.json", "a.html", "c.png"):
            (part / name).write_text("new")
    os._exit(0)


def test_who_kills_a_run_while_it_writes_leaves_files_of_one_run(tmp_path: Path) -> None:
    for change in range(8):  # four old files go, three new ones come; then nothing is left to kill
        folder = tmp_path / str(change)
        folder.mkdir()
        for name in ("a.html", "b.json", "c.png", "only_some.yaml", "mine.txt"):
            (folder / name).write_text("old")
        child = os.fork()
        if child == 0:
            killed(change, folder)
        assert os.WIFSIGNALED(os.waitpid(child, 0)[1]) == (change < 7)
        found = {path.read_text() for path in folder.iterdir() if path.is_file() and path.name != "mine.txt"}
        assert len(found) <= 1, change
        assert found == ({"old"} if change < 4 else set() if change == 4 else {"new"})
        assert (folder / "mine.txt").read_text() == "old"
        assert (folder / "a.html").exists() == (change in (0, 7))  # what shows the others is there with all of them alone


def test_a_place_is_a_directory_or_a_url(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert writable.output_place(str(tmp_path / "new")) == str(tmp_path / "new")
    assert writable.output_place("s3://bucket/results") == "s3://bucket/results"
    with pytest.raises(InputError, match="is a file"):
        writable.output_place(str(tmp_path / "file"))


def outputs(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument called output, of the commands of a command too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                yield from outputs(inner)
        elif action.dest == "output":
            yield action


def test_every_command_looks_at_its_output_before_the_work() -> None:
    found = {}
    for name in cli.COMMANDS:
        module = importlib.import_module(f"tcs_friction.commands.{name}")
        for action in outputs(parser_of(name, module)):
            assert action.type in (*CHECKED, writable.output_path, writable.output_place), name
            assert action.default is None or isinstance(action.default, str), "argparse converts defaults that are text"
            found[name] = action
    assert {"demo", "simulate", "identify", "diagnose", "calibrate", "response", "paper", "bag"} <= set(found)


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "nowhere", "--axis", "nowhere"],
        ["diagnose", "nowhere", "--axis", "nowhere"],
        ["response", "nowhere", "--axis", "nowhere"],
        ["calibrate", "nowhere", "--axis", "nowhere"],
        ["simulate", "nowhere", "--reference", "nowhere"],
        ["bag", "export", "nowhere", "--axis", "nowhere"],
        ["bag", "import", "nowhere"],
        ["paper"],
        ["demo"],
    ],
)
def test_the_output_is_named_first(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    out = str(tmp_path / "file" / "out")
    assert cli.main([*words, "-o", out]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"tcs-friction: {out}: cannot be written (Not a directory)")
    assert error.count("\n") == 1


def test_a_disk_that_fills_while_a_command_writes_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(writable, "ROOM", 1)
    (tmp_path / "table.csv").write_text(TABLE)
    bag, axis = tmp_path / "bag", ["--axis", str(config.shipped(AXIS))]
    to_bag = ["bag", "import", str(tmp_path / "table.csv"), *axis, "-o"]
    assert cli.main([*to_bag, str(bag)]) == 0
    capsys.readouterr()
    before = set(tmp_path.iterdir())
    export = ["bag", "export", str(bag), *axis, "-o"]
    for words in ([*to_bag, str(tmp_path / "full")], [*export, f"{tmp_path}/full.csv"], [*export, f"{tmp_path}/full.parquet"]):
        with full_beyond(20_000):
            assert cli.main(words) == 1, capsys.readouterr().err
        error = capsys.readouterr().err
        assert error.startswith(f"tcs-friction: {words[-1]}: "), error
        assert "too large" in error
        assert error.count("\n") == 1
        assert set(tmp_path.iterdir()) == before


def test_files_of_results_are_named_and_whole_or_absent(tmp_path: Path) -> None:
    for write, name in (
        (lambda: config.write_whole(tmp_path / "a.json", "x" * 20_000), "a.json"),
        (lambda: Picture("b", "", b"x" * 20_000).save(tmp_path), "b.png"),
    ):
        with full_beyond(10_000), pytest.raises(JobError, match=rf"{name}: cannot be written \(File too large\)"):
            write()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux only")
@pytest.mark.parametrize("words", [["--help"], ["identify", "--help"]])
def test_a_full_standard_output_is_one_line(words: list[str]) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-P", "-m", "tcs_friction.cli", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "tcs-friction: standard output: cannot be written (No space left on device)\n"


def test_a_refusal_nobody_else_explains_names_the_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(_: object) -> int:
        raise PermissionError(13, "Permission denied", "some/file")

    monkeypatch.setattr(importlib.import_module("tcs_friction.commands.paper"), "run", refuse)
    assert cli.main(["paper"]) == 1
    assert capsys.readouterr().err == "tcs-friction: some/file: Permission denied\n"


CHANNEL = Channel("/t", "std_msgs/msg/Int64", "cdr", "int64 data", "ros2msg", "")
PAYLOAD = b"\0\1\0\0" + bytes(1000)


def write_tens(bag: BagRecorder, number: int) -> None:
    """A thousand messages in chunks of ten."""
    for k in range(1000):
        bag.write(number, k, PAYLOAD)
        if k % 10 == 9:
            bag.flush()


def recorded(bag: Path) -> int:
    return sum(1 for part in Bag(bag).batches(["/t"]) for _ in part.payloads())


@pytest.mark.parametrize("room", [30_000, 30_600, 200_000])
def test_a_full_disk_ends_a_recording_that_stays_readable(room: int, tmp_path: Path) -> None:
    """With room for the end of the file and without; the chunk that did not fit is not counted."""
    bag = BagRecorder(tmp_path / "bag")
    number = bag.add_topic(CHANNEL)
    with full_beyond(room):
        with pytest.raises(JobError, match=r"bag: cannot be written any more \(File too large\); what came before is kept"):
            write_tens(bag, number)
        bag.close()
    assert recorded(tmp_path / "bag") == bag.counts["/t"] > 15
    assert bag.counts["/t"] % 10 == 0


def test_a_disk_that_is_full_at_the_end_is_told(tmp_path: Path) -> None:
    bag = BagRecorder(tmp_path / "bag")
    number = bag.add_topic(CHANNEL)
    bag.write(number, 1, PAYLOAD)
    bag.flush()
    with full_beyond(1500), pytest.raises(JobError, match="cannot be written any more"):
        bag.close()
    assert recorded(tmp_path / "bag") == 1


def test_a_next_file_that_cannot_be_begun_leaves_the_others(tmp_path: Path) -> None:
    bag = BagRecorder(tmp_path / "bag", split_size=5000)
    number = bag.add_topic(CHANNEL)
    for k in range(4):
        bag.write(number, k, PAYLOAD)
    (tmp_path / "bag" / "bag_1.mcap").touch()  # in the way
    with pytest.raises(JobError, match="File exists"):
        write_tens(bag, number)
    bag.close()
    (tmp_path / "bag" / "bag_1.mcap").unlink()
    assert recorded(tmp_path / "bag") == bag.counts["/t"] >= 4
