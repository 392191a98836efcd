"""AXES.yaml, and which axis a recording is of."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from fleet_cases import START, write_axes

from tcs_friction.errors import InputError
from tcs_friction.fleet.axes import fingerprint, read_axes
from tcs_friction.fleet.look import Look
from tcs_friction.fleet.plan import Plan, check, identity_of, jobs
from tcs_friction.fleet.sources import Found, StoredFile
from tcs_friction.fleet.work import Task


def changed(file: Path, **more: object) -> Path:
    entries = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump([{**entries[0], **more}, *entries[1:]]))
    return file


def test_an_entry_has_the_axis_file_and_limits(tmp_path: Path) -> None:
    path = changed(write_axes(tmp_path, ["a"]), path="night_*", topic="/a/*", **{"from": "2026-03-01", "to": "2026-04-01"})
    (axis,) = read_axes(path)
    assert axis.name == "a"
    assert axis.file.axis.inertia == 10.0
    assert axis.signals.position.joint == "a"
    assert axis.fits("/bags/night_1", ["/a/joint_states"], START)
    assert not axis.fits("/bags/day_1", ["/a/joint_states"], START)
    assert not axis.fits("/bags/night_1", ["/b/joint_states"], START)
    assert not axis.fits("/bags/night_1", ["/a/joint_states"], START + 40 * 86_400 * 10**9)
    assert not axis.fits("/bags/night_1", ["/a/joint_states"], 0)


def test_a_joint_takes_the_place_of_the_axis_files(tmp_path: Path) -> None:
    (axis,) = read_axes(changed(write_axes(tmp_path, ["a"]), joint="elbow"))
    assert {source.joint for source in (axis.signals.position, axis.signals.torque, axis.signals.velocity) if source} == {"elbow"}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"axis": 3}, r"\[0\]: axis is 3, expected a path"),
        ({"topik": "/a"}, r"\[0\]: unknown key 'topik', expected topic"),
        ({"from": "yesterday"}, r"\[0\]: from is 'yesterday', expected a date such as"),
        ({"from": "2026-03-01", "to": "2026-02-01"}, r"from 2026-03-01 to 2026-02-01, expected an earlier date first"),
        ({"topic": ["/a"]}, r"topic is \['/a'\], expected a text"),
    ],
)
def test_a_wrong_entry_is_named(entry: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_axes(changed(write_axes(tmp_path, ["a"]), **entry))


def test_axes_of_one_name_and_files_of_none_are_refused(tmp_path: Path) -> None:
    path = write_axes(tmp_path, ["a"])
    path.write_text(yaml.safe_dump([{"axis": "a.yaml"}, {"axis": "a.yaml"}]))
    with pytest.raises(InputError, match="a second axis named a"):
        read_axes(path)
    path.write_text("axis: a.yaml\n")
    with pytest.raises(InputError, match="expected a list of"):
        read_axes(path)


def test_the_fingerprint_changes_with_what_decides(tmp_path: Path) -> None:
    before = fingerprint(read_axes(write_axes(tmp_path, ["a"])))
    assert fingerprint(read_axes(write_axes(tmp_path, ["a"]))) == before
    assert fingerprint(read_axes(changed(write_axes(tmp_path, ["a"]), path="x"))) != before


def test_two_axes_of_one_recording_and_an_axis_of_none_are_named(tmp_path: Path) -> None:
    path = write_axes(tmp_path, ["a", "b"])
    twin = (tmp_path / "a.yaml").read_text().replace("name: a\n", "name: b\n", 1)  # with the signals of a
    (tmp_path / "b.yaml").write_text(twin)
    plan = Plan(read_axes(path), "AXES.yaml")
    with pytest.raises(InputError, match=r"x: axes a and b both match, expected one: topic, joint, path, from or to in AXES"):
        check([Look("x", "", "", "", ("a", "b"))], plan)
    with pytest.raises(InputError, match=r"AXES.yaml: axis b matches none of 1 recording, expected"):
        check([Look("x", "", "", "", ("a",))], plan)


def test_a_table_that_two_axes_fit_is_of_one_of_them(tmp_path: Path) -> None:
    plan = Plan(read_axes(write_axes(tmp_path, ["a", "b"])), "AXES.yaml")
    with pytest.raises(InputError, match=r"x: axes a and b both match"):
        check([Look("x", "", "", "", ("a", "b"), table=True)], plan)


def test_a_bag_of_a_whole_mount_is_a_recording_of_each_axis(tmp_path: Path) -> None:
    plan = Plan(read_axes(write_axes(tmp_path, ["a", "b"])), "AXES.yaml", samples=1000)
    found = Found("x", "file", (StoredFile("/x", 1, ""),))
    made = jobs([found], {"x": Look("x", "", "", "h", ("a", "b"), (START, START + 1), (900, 1900))}, plan)
    assert [(task.axis.name, task.start, task.piece) for task in made if isinstance(task, Task)] == [
        ("a", START, 0), ("b", START + 1, 0), ("b", START + 1, 1)
    ]  # fmt: skip
    assert len({identity_of(task) for task in made}) == 3, "each has a row of its own"


def test_a_long_recording_becomes_pieces(tmp_path: Path) -> None:
    plan = Plan(read_axes(write_axes(tmp_path, ["a"])), "AXES.yaml", samples=1000)
    found = Found("x", "file", (StoredFile("/x", 1, ""),))
    made = jobs([found], {"x": Look("x", "", "", "h", ("a",), (START,), (2500,))}, plan)
    assert [task.span and (task.span.start, task.span.stop) for task in made if isinstance(task, Task)] == [
        (0, 833), (833, 1666), (1666, 2500)
    ]  # fmt: skip
