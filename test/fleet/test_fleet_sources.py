"""Recordings found and looked at."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from fleet_cases import START, axis_file, recording, write_axes, write_bag

from tcs_friction.errors import InputError
from tcs_friction.fleet.axes import read_axes
from tcs_friction.fleet.look import look_at
from tcs_friction.fleet.rows import DONE, FAILED
from tcs_friction.fleet.sources import Found, StoredFile, find
from tcs_friction.fleet.work import Task, work
from tcs_friction.recording.pieces import Span
from tcs_friction.recording.tables import export_table


def names(found: tuple[Found, ...], root: Path) -> list[str]:
    return [str(Path(one.name).relative_to(root)) for one in found]


def test_folders_files_and_tables_are_found_and_results_are_not(tmp_path: Path) -> None:
    write_bag(tmp_path / "deep/one", "a")
    write_bag(tmp_path / "two", "a")
    (tmp_path / "two/metadata.yaml").unlink()
    shutil.copy(tmp_path / "two/two_0.mcap", tmp_path / "loose.mcap")
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "table.csv").write_text("time\n")
    (tmp_path / "notes.txt").write_text("no recording")
    (tmp_path / "out/rows").mkdir(parents=True)
    (tmp_path / "out/rows/x.parquet").write_bytes(b"")
    found = find([str(tmp_path)], str(tmp_path / "out"))
    assert names(found, tmp_path) == ["deep/one", "loose.mcap", "old.bag", "table.csv", "two"]
    assert [one.table for one in found] == [False, False, False, True, False]
    assert names(find([f"{tmp_path}/t*", f"{tmp_path}/two"]), tmp_path) == ["table.csv", "two"]


def test_files_that_are_called_after_their_folder_are_parts_only_if_rosbag2_numbers_so(tmp_path: Path) -> None:
    (tmp_path / "az").mkdir()
    parts, alone = ["az_0.mcap", "az_12.mcap"], ["az_20250101.mcap", "az_007.mcap", "az_3.bag"]
    for name in (*parts, *alone):
        (tmp_path / "az" / name).write_bytes(b"x")
    found = find([str(tmp_path)])
    assert names(found, tmp_path) == ["az", *(f"az/{name}" for name in sorted(alone))]
    assert [Path(file.path).name for file in found[0].files] == parts


def test_nothing_found_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recordings, expected bags"):
        find([str(tmp_path)])
    with pytest.raises(InputError, match="nowhere: does not exist"):
        find([str(tmp_path / "nowhere")])
    with pytest.raises(InputError, match="cannot be read"):
        find(["nosuchprotocol://x"])


def test_the_hash_is_of_the_bytes(tmp_path: Path) -> None:
    write_bag(tmp_path / "a/bag", "a")
    shutil.copytree(tmp_path / "a/bag", tmp_path / "b/bag")
    first, second = find([str(tmp_path / "a"), str(tmp_path / "b")])
    assert first.hash() == second.hash()
    assert first.look != second.look
    file = tmp_path / "b/bag/bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-1])
    (second,) = find([str(tmp_path / "b")])
    assert first.hash() != second.hash()


@pytest.mark.parametrize(
    ("mark", "of_content"),
    [
        ('"9e107d9d372bb6826bd81d3542a419d6"', True),  # S3
        ('"9e107d9d372bb6826bd81d3542a419d6-3"', True),  # S3, written in three parts
        ("nhB9nTcrtoJr2B01QqQZ1g==", True),  # Google's md5Hash
        ('"6733f1a0-e2d40"', False),  # nginx: time and size
        ('W/"6733f1a0-e2d40"', False),
    ],
)
def test_a_stores_mark_stands_for_the_hash_of_one_file_or_of_its_copies(mark: str, of_content: bool) -> None:
    one, other = (Found(name, "http", (StoredFile(name, 9, "", mark),)) for name in ("http://x/a.mcap", "http://x/b.mcap"))
    assert (one.hash() == other.hash()) is of_content


def test_a_recording_belongs_to_the_axis_whose_joint_it_has(tmp_path: Path) -> None:
    axes = read_axes(write_axes(tmp_path, ["a", "b"]))
    write_bag(tmp_path / "bags/one", "b")
    (found,) = find([str(tmp_path / "bags")])
    look = look_at(found, axes, "key")
    assert (look.axes, look.starts, look.samples, look.reason) == (("b",), (START,), (2000,), "")


def test_an_axis_of_another_time_does_not_fit_and_that_is_said(tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/one", "a")
    (found,) = find([str(tmp_path / "bags")])
    look = look_at(found, [replace(axis, since=START + 10**12)], "key")
    assert (look.axes, look.reason) == ((), "no axis fits: one has its signals, but another path, topic or time")


def test_what_belongs_to_no_axis_or_is_no_bag_says_why(tmp_path: Path) -> None:
    axes = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/one", "b")
    (tmp_path / "bags/two.mcap").write_bytes(b"\x89MCAP0\r\n")
    one, two = (look_at(found, axes, "key") for found in find([str(tmp_path / "bags")]))
    assert one.reason == "no axis fits: its topics are /b/joint_states, /b/temperature"
    assert "nothing whole in it" in two.reason
    assert two.axes == ()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_worked_on_too(suffix: str, tmp_path: Path) -> None:
    dated = replace(recording(), t=recording().t + START * 1e-9)
    export_table(dated, tmp_path / f"bags/table{suffix}")
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    (found,) = find([str(tmp_path / "bags")])
    look = look_at(found, [axis], "key")
    assert (look.axes, look.samples) == (("a",), (2000,))
    row = work(Task(found, axis, look.input_hash, "v", diagnosed=False)).row
    assert (row.status, row.month, row.start) == (DONE, "2026-03", START)


def test_a_row_has_what_was_identified_and_how_it_moved(tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/one", "a")
    (found,) = find([str(tmp_path / "bags")])
    row = work(Task(found, axis, "h", "v", diagnosed=False)).row
    truth = axis_file("a").axis
    value = dict(zip(row.parameter_names, row.parameter_values, strict=True))
    std = dict(zip(row.parameter_names, row.parameter_stds, strict=True))
    assert value["inertia"] == pytest.approx(truth.inertia, rel=0.01)
    assert value["coulomb"] == pytest.approx(5.0, rel=0.01)
    count = len(row.parameter_names)
    for k, name in enumerate(row.parameter_names):
        assert row.parameter_covariance[k * count + k] == pytest.approx(std[name] ** 2)
    assert (row.axis, row.month, row.start, row.status) == ("a", "2026-03", START, DONE)
    assert row.temperature == pytest.approx(20.1, abs=0.05)
    assert row.temperature_change == pytest.approx(0.2, abs=0.01)
    assert row.speed_rms == pytest.approx(0.47, abs=0.05)
    assert row.reversals > 5
    assert 0.49 < row.position_to < 0.51
    assert row.residual_believed != row.residual_believed  # not diagnosed


def test_a_piece_of_a_recording_is_the_same_as_a_recording_of_it(tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/one", "a", seconds=60.0)
    (found,) = find([str(tmp_path / "bags")])
    row = work(Task(found, axis, "h", "v", 1, Span(2000, 4000), diagnosed=False)).row
    assert (row.piece, row.start - START, row.status) == (1, 20 * 10**9, DONE)
    assert row.duration == pytest.approx(19.99)
    coulomb = row.parameter_values[row.parameter_names.index("coulomb")]
    assert coulomb == pytest.approx(5.0, rel=0.02)


def test_what_is_damaged_is_worked_on_as_far_as_it_goes_and_else_is_a_row(tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    file = write_bag(tmp_path / "bags/one", "a", seconds=60.0) / "one_0.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    (found,) = find([str(tmp_path / "bags")])
    assert look_at(found, [axis], "key").axes == ("a",)
    row = work(Task(found, axis, "h", "v", diagnosed=False)).row
    assert row.status == DONE
    assert 10.0 < row.duration < 50.0
    file.write_bytes(file.read_bytes()[:100])
    row = work(Task(found, axis, "h", "v", start=START, diagnosed=False)).row
    assert (row.status, row.axis, row.month) == (FAILED, "a", "2026-03")
    assert row.reason
    assert str(tmp_path) not in row.reason
