"""Runs as users start them, on real workers: kept rows, resumption, equality, interrupts, schedulers."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from distributed import Client
from fleet_cases import START, write_axes, write_bag

from tcs_friction.cli import main
from tcs_friction.errors import InputError, JobError
from tcs_friction.fleet import engine
from tcs_friction.fleet.axes import read_axes
from tcs_friction.fleet.cluster import workers_here, workers_of
from tcs_friction.fleet.plan import Plan
from tcs_friction.fleet.rows import DONE, FAILED, Row
from tcs_friction.fleet.sources import find
from tcs_friction.fleet.store import Store

DAY = 86_400 * 10**9
PATIENCE = 200.0  # s
pytestmark = [pytest.mark.filterwarnings("ignore::ResourceWarning"), pytest.mark.filterwarnings("ignore::DeprecationWarning")]


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with workers_here(2) as one:
        yield one


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Two axes, three bags each in two months, and a file that is no bag."""
    write_axes(tmp_path, ["a", "b"])
    for number in range(6):
        write_bag(tmp_path / f"bags/bag{number}", "ab"[number % 2], number, START + 12 * number * DAY)
    (tmp_path / "bags/broken.mcap").write_bytes(b"\x89MCAP0\r\n")
    return tmp_path


def run(client: Client, folder: Path, out: str = "out", **more: Any) -> engine.Summary:
    plan = Plan(read_axes(folder / "AXES.yaml"), "AXES.yaml", **{"diagnosed": False, **more})
    return engine.run(client, find([str(folder / "bags")]), plan, Store(str(folder / out)), lambda *_: None)


def rows(out: Path) -> list[Row]:
    store = Store(str(out))
    months = {(kept.axis, kept.month): kept for kept in store.kept()}
    found = [row for kept in months.values() for row in store.rows_beside(kept)]
    return sorted(found, key=lambda row: (row.recording, row.piece))


def kept_files(out: Path) -> list[Path]:
    """Of recordings that belong to an axis. Others may be in the making."""
    return [path for path in out.glob("rows/*/*/*.parquet") if "axis=_none" not in str(path)]


def files(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.glob("rows/*/*/*"))}


def test_every_recording_is_a_row_and_nothing_is_done_twice(client: Client, fleet: Path) -> None:
    first = run(client, fleet)
    assert (first.recordings, first.now, first.before, first.failed) == (7, 7, 0, 1)
    found = rows(fleet / "out")
    assert [row.axis for row in found] == ["a", "b", "a", "b", "a", "b", "_none"]
    assert [row.status for row in found] == [DONE] * 6 + [FAILED]
    assert "nothing whole in it" in (found[-1].reason or "")
    kept = files(fleet / "out")
    assert {name.rpartition("/")[0] for name in kept} >= {"rows/axis=a/month=2026-03", "rows/axis=b/month=2026-04"}
    again = run(client, fleet)
    assert (again.now, again.before, again.failed, again.seconds) == (0, 7, 1, 0.0)
    assert files(fleet / "out") == kept
    retried = run(client, fleet, retry=True)
    assert (retried.now, retried.before) == (1, 6)


def test_what_changes_is_done_anew_and_what_only_moves_is_not(client: Client, fleet: Path) -> None:
    run(client, fleet)
    (fleet / "bags/bag0").rename(fleet / "bags/moved")
    shutil.rmtree(fleet / "bags/bag1")
    write_bag(fleet / "bags/bag1", "b", 77, START)
    os.utime(fleet / "bags/bag2/bag2_0.mcap", (1, 1))
    summary = run(client, fleet)
    assert (summary.now, summary.before) == (1, 6)
    assert [Path(row.recording).name for row in rows(fleet / "out")] == [
        "bag1", "bag2", "bag3", "bag4", "bag5", "broken.mcap", "moved"
    ]  # fmt: skip


def test_long_recordings_become_pieces(client: Client, fleet: Path) -> None:
    run(client, fleet, samples=1500)
    pieces = [(row.piece, row.start) for row in rows(fleet / "out") if row.recording.endswith("bag0")]
    assert pieces == [(0, START), (1, START + 10 * 10**9)]
    run(client, fleet)
    assert [row.piece for row in rows(fleet / "out") if row.recording.endswith("bag0")] == [0]


def cli(*words: str) -> subprocess.Popen[str]:
    """The command in a process group of its own that hears SIGINT, also where this process was told not to."""

    def hears() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)

    command = [sys.executable, "-P", "-m", "tcs_friction.cli", "fleet", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=hears)


def started(fleet: Path, out: str, *more: str) -> subprocess.Popen[str]:
    """The command, once it has kept a first row of its own."""
    before = len(kept_files(fleet / out))
    process = cli(str(fleet / "bags"), "--axes", str(fleet / "AXES.yaml"), "-o", str(fleet / out), "--no-diagnose", *more)
    deadline = time.monotonic() + PATIENCE
    while len(kept_files(fleet / out)) <= before:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return process


def children(process: subprocess.Popen[str]) -> list[int]:
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout.split()
    return [int(pid) for pid, parent in zip(listed[::2], listed[1::2], strict=True) if int(parent) == process.pid]


def gone(numbers: list[int]) -> bool:
    deadline = time.monotonic() + PATIENCE
    while any(Path(f"/proc/{number}").exists() for number in numbers):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def test_a_run_that_is_killed_or_interrupted_goes_on_where_it_was(client: Client, fleet: Path) -> None:
    for number in range(6, 11):  # so that it is not over before it is killed
        shutil.copytree(fleet / "bags/bag0", fleet / f"bags/bag{number}")
        with (fleet / f"bags/bag{number}/bag0_0.mcap").open("ab") as file:
            file.write(bytes(number))
    process = started(fleet, "out", "--workers", "1")
    workers = children(process)
    process.kill()
    process.communicate()
    assert gone(workers)
    after_kill = {name: content for name, content in files(fleet / "out").items() if not name.endswith(".part")}
    process = started(fleet, "out", "--workers", "1")
    workers = children(process)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=PATIENCE)
    assert (process.returncode, told.splitlines()[-1:]) == (130, ["tcs-friction: interrupted"])
    assert "Traceback" not in told
    assert gone(workers)
    kept = files(fleet / "out")
    assert after_kill.items() <= kept.items()
    assert not [name for name in kept if name.endswith(".part")]
    summary = run(client, fleet)
    assert summary.before == len(kept)
    assert summary.now == 12 - len(kept) > 0
    run(client, fleet, out="whole")
    assert files(fleet / "whole") == files(fleet / "out")


def test_one_worker_of_a_scheduler_that_is_there_makes_the_same_rows(client: Client, fleet: Path) -> None:
    run(client, fleet)
    with workers_here(1) as other:
        words = [str(fleet / "bags"), "--axes", str(fleet / "AXES.yaml"), "-o", str(fleet / "other"), "--no-diagnose", "--json"]
        process = cli(*words, "--scheduler", str(other.scheduler.address))
        printed, told = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, told
        content = json.loads(printed)
        assert (content["done_now"], content["failed"]) == (7, 1)
        assert told.count("dashboard http://127.0.0.1:") == 1
        assert len(told.splitlines()) == 1
    assert list(map(repr, rows(fleet / "other"))) == list(map(repr, rows(fleet / "out")))
    assert files(fleet / "other") == files(fleet / "out")


CLUSTER = """
import time
from tcs_friction.fleet.cluster import workers_here
if __name__ == "__main__":
    with workers_here(1) as client:
        print(client.scheduler.address, flush=True)
        time.sleep(600)
"""


def test_a_scheduler_that_dies_is_said_and_what_was_done_is_kept(fleet: Path) -> None:
    script = fleet / "cluster.py"
    script.write_text(CLUSTER)
    process = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None

    def progress(stage: str, done: int, _: int, __: int) -> None:
        if stage == "working" and done == 3:
            process.kill()

    plan = Plan(read_axes(fleet / "AXES.yaml"), "AXES.yaml", diagnosed=False)
    try:
        with (
            pytest.raises(JobError, match=r"the scheduler has gone; \d of 7 are done and kept"),
            workers_of(process.stdout.readline().strip()) as client,
        ):
            engine.run(client, find([str(fleet / "bags")]), plan, Store(str(fleet / "out")), progress)
    finally:
        process.kill()
        process.communicate()
    assert len(files(fleet / "out")) >= 3


@pytest.mark.parametrize(
    ("more", "status", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], 1, "tcp://127.0.0.1:9: cannot be reached"),
        (["--scheduler", "nonsense://x"], 2, "--scheduler: 'nonsense://x'"),
        (["--scheduler", "tcp://127.0.0.1:9", "--workers", "2"], 2, "--workers: given with --scheduler"),
        (["--output", "/proc/no/such"], 2, "/proc/no/such: cannot be written"),
        (["--axes", "/no/axes.yaml"], 2, "/no/axes.yaml: no such file"),
    ],
)
def test_bad_input_is_one_line(
    more: list[str],
    status: int,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tcs_friction.fleet.cluster.REACHABLE", 1.0)
    write_axes(tmp_path, ["a"])
    write_bag(tmp_path / "bags/one", "a")
    words = ["fleet", str(tmp_path / "bags"), "--axes", str(tmp_path / "AXES.yaml"), "-o", str(tmp_path / "out"), *more]
    assert main(words) == status
    told = capsys.readouterr().err
    assert message in told
    assert len(told.splitlines()) == 1


def test_what_is_no_address_leaves_no_client_behind_that_complains(tmp_path: Path) -> None:
    write_axes(tmp_path, ["a"])
    write_bag(tmp_path / "bags/one", "a")
    words = [str(tmp_path / "bags"), "--axes", str(tmp_path / "AXES.yaml"), "-o", str(tmp_path / "out")]
    process = cli(*words, "--scheduler", "127.0.0.1")
    _, told = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert told.startswith("tcs-friction: --scheduler: '127.0.0.1' (missing port number")
    assert len(told.splitlines()) == 1


def test_a_second_run_into_the_same_folder_is_refused(tmp_path: Path) -> None:
    first, second = Store(str(tmp_path)), Store(str(tmp_path))
    with first.alone(), pytest.raises(InputError, match="another run is writing there"), second.alone():
        pass
    with second.alone():
        pass
