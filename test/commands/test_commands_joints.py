"""--joint: a name or a number in every command, and all of them in folders of their own with one page over all."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.cli import main
from tcs_friction.commands.joints import Done, folders, for_each
from tcs_friction.config import AxisFile, load_axis, save_axis
from tcs_friction.errors import InputError, JobError
from tcs_friction.identify import first_axis
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording import bags
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.encode import joint_states
from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.write import EPOCH, write_bag

PLACE = "/joint_states"
INERTIA = {"shoulder": 4.0, "elbow": 1.5, "wrist": 0.4}
COULOMB, VISCOUS = 2.0, 1.0


def columns(seconds: float = 12.0) -> dict[str, dict[str, Column]]:
    """Each joint moves by itself, with an inertia of its own; `gripper` says where it is and never moves."""
    t, found = np.arange(round(100 * seconds)) / 100.0, {}
    for place, (joint, inertia) in enumerate(INERTIA.items()):
        a, b = 1.3 + 0.2 * place, 3.1 - 0.3 * place
        velocity = 0.5 * np.cos(a * t) + 0.6 * np.cos(b * t)
        acceleration = -0.5 * a * np.sin(a * t) - 0.6 * b * np.sin(b * t)
        noise = np.random.default_rng(place)
        torque = inertia * acceleration + COULOMB * np.sign(velocity) + VISCOUS * velocity + 0.02 * noise.standard_normal(len(t))
        position = 0.5 * np.sin(a * t) / a + 0.6 * np.sin(b * t) / b + 1e-6 * noise.standard_normal(len(t))
        found[joint] = {"position": position, "velocity": velocity, "effort": torque}
    still = np.zeros(len(t))
    return {**found, "gripper": {"position": still, "velocity": still, "effort": still}}


def times(count: int) -> np.ndarray:
    return EPOCH + 10_000_000 * np.arange(count)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "bag"
    found = columns()
    write_bag(path, [joint_states(PLACE, times(1200), found)])
    return path


@pytest.fixture(scope="module")
def table(bag: Path) -> Path:
    path = bag.with_name("arm.csv")
    found = {joint: one for joint, one in columns().items() if joint != "gripper"}
    names = [f"{joint}_{name}" for joint in found for name in ("position", "velocity", "torque")]
    cells = zip(*(one[name] for one in found.values() for name in ("position", "velocity", "effort")), strict=True)
    rows = [f"{k * 0.01:.2f},{','.join(map(repr, map(float, row)))}" for k, row in enumerate(cells)]
    path.write_text("\n".join([",".join(["time", *names]), *rows]))
    return path


@pytest.fixture(scope="module")
def axis(bag: Path) -> Path:
    signals = SignalMap(
        SignalSource(PLACE, "position", "shoulder"), SignalSource(PLACE, "effort", "shoulder"),
        SignalSource(PLACE, "velocity", "shoulder"),
    )  # fmt: skip
    friction = instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.5})
    path = bag.with_name("axis.yaml")
    save_axis(path, AxisFile(Axis(name="arm", inertia=1.0, friction=friction), signals))
    return path


def inertia(folder: Path) -> float:
    return float(json.loads((folder / "identification.json").read_text())["inertia"]["value"])


@pytest.mark.parametrize("joint", ["1", "elbow"])
@pytest.mark.parametrize("kind", ["bag", "table"])
def test_a_joint_is_meant_by_name_or_number(
    joint: str, kind: str, axis: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    recorded = str(request.getfixturevalue(kind))
    assert main(["identify", recorded, "--axis", str(axis), "--joint", joint, "-o", str(tmp_path)]) == 0
    assert inertia(tmp_path) == pytest.approx(INERTIA["elbow"], rel=0.02)
    signals = load_axis(tmp_path / "axis.yaml").signals
    assert signals is not None
    if kind == "bag":  # what is written describes the joint that was identified
        assert {source.joint for _, source in signals.named()} == {"elbow"}


@pytest.mark.parametrize("kind", ["bag", "table"])
def test_every_joint_has_a_folder_and_one_page_is_over_all(
    kind: str, axis: Path, tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = str(request.getfixturevalue(kind))
    status = main(["identify", recorded, "--axis", str(axis), "--joint", "all", "-o", str(tmp_path), "--json"])
    printed = capsys.readouterr()
    found = json.loads(printed.out)["joints"]
    for joint, true in INERTIA.items():
        assert inertia(tmp_path / joint) == pytest.approx(true, rel=0.02)
        assert found[joint]["inertia"]["value"] == inertia(tmp_path / joint)
    page = (tmp_path / "index.html").read_text()
    for joint in INERTIA:
        assert f'<a href="{joint}/report.html">{joint}</a>' in page
        assert (tmp_path / joint / "report.html").is_file()
    if kind == "bag":  # the gripper does not move: it is a row, and the others are none the worse
        assert status == 1
        assert "1 of 4 joints without a result, the first: gripper: " in printed.err
        assert "refused" in found["gripper"]
        assert "4 joints, 1 of them without a result." in page
        assert not (tmp_path / "gripper").exists()
    else:
        assert status == 0
        assert "3 joints." in page


def test_diagnose_goes_over_all_joints(bag: Path, axis: Path, tmp_path: Path) -> None:
    assert main(["diagnose", str(bag), "--axis", str(axis), "--joint", "all", "-o", str(tmp_path)]) == 1
    for joint in INERTIA:
        signals = load_axis(tmp_path / joint / "axis.yaml").signals
        assert signals is not None
        assert signals.position.joint == joint
        assert f'href="{joint}/report.html"' in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize("kind", ["bag", "table"])
def test_new_writes_an_axis_file_a_joint(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setattr(first_axis, "LAWS", ("coulomb_viscous",))
    recorded = str(request.getfixturevalue(kind))
    assert main(["new", recorded, "--joint", "all", "-o", str(tmp_path)]) == (1 if kind == "bag" else 0)
    for joint, true in INERTIA.items():
        assert load_axis(tmp_path / joint / "axis.yaml").axis.inertia == pytest.approx(true, rel=0.02)
        assert f'href="{joint}/axis.yaml"' in (tmp_path / "index.html").read_text()
    assert main(["new", recorded, "--joint", "all", "--name", "x", "-o", str(tmp_path)]) == 2
    (tmp_path / "file").touch()
    assert main(["new", recorded, "--joint", "all", "-o", str(tmp_path / "file")]) == 2


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        ("4", "no joint '4', expected 0 to 3 or a name"),
        ("hand", "joint"),
        ("99999999999", "no joint"),
        ("9" * 5000, "9' ..., expected 0 to 3 or a name"),
        ("\udcff", "is no text"),
    ],
)
def test_a_joint_that_is_none_is_one_line(
    joint: str, expected: str, bag: Path, axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["identify", str(bag), "--axis", str(axis), "--joint", joint, "-o", str(tmp_path)]
    with pytest.raises(SystemExit, match="2"):
        sys.exit(main(words))  # of words that are no text argparse ends the command itself
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert expected in told


@pytest.mark.parametrize("command", ["new", "bag info", "fleet"])
@pytest.mark.parametrize("kind", ["bag", "table"])
def test_a_number_of_any_length_is_one_line_in_every_command(
    command: str, kind: str, axis: Path, tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = str(request.getfixturevalue(kind))
    axes = tmp_path / "axes.yaml"
    axes.write_text(f"[{{axis: {axis}}}]\n")
    more = {"new": ["-o", str(tmp_path / "new.yaml")], "fleet": ["--axes", str(axes), "-o", str(tmp_path / "out")]}
    assert main([*command.split(), recorded, "--joint", "9" * 5000, *more.get(command, [])]) == 2
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert "no joint '999" in told
    assert len(told) < 500


def test_a_joints_number_is_looked_up_once(bag: Path, axis: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[str] = []
    real = bags.signals_of

    def counted(bag: bags.Bag, signals: SignalMap, joint: str) -> SignalMap:
        asked.append(joint)
        return real(bag, signals, joint)

    def refuse(_: object) -> None:
        raise JobError("here", "enough was read")

    monkeypatch.setattr(bags, "signals_of", counted)
    monkeypatch.setattr("tcs_friction.commands.identify.check_changes", refuse)
    assert main(["identify", str(bag), "--axis", str(axis), "--joint", "1", "-o", str(tmp_path)]) == 1
    assert asked == ["1"]


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        (["a", "b.c"], ["a", "b.c"]),
        (["..", "a/b", "", "a\nb"], ["joint_0", "joint_1", "joint_2", "joint_3"]),
        (["A", "a"], ["A", "joint_1"]),  # a file system may not tell them apart
        (["/", "joint_0"], ["joint_0_", "joint_0"]),
        (["x" * 300], ["joint_0"]),
    ],
)
def test_folders_are_plain_and_none_is_shared(joints: list[str], expected: list[str]) -> None:
    assert list(folders(joints)) == expected


def test_what_fails_after_it_is_written_is_linked_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def one(arguments: argparse.Namespace, _: Path) -> Done:
        return Done("text", {}, "found <b>", "report.html", JobError("x", "no minimum") if arguments.joint == "b" else None)

    given = argparse.Namespace(output=tmp_path, json=False)
    with pytest.raises(JobError, match="1 of 2 joints without a result, the first: b: x: no minimum"):
        for_each(given, "Title", [Path("bag")], ["a", "b"], one)
    page = (tmp_path / "index.html").read_text()
    assert "found &lt;b&gt;; x: no minimum" in page
    assert 'href="b/report.html"' in page
    assert capsys.readouterr().out.splitlines() == ["text", "text", str(tmp_path / "index.html")]


@pytest.mark.parametrize("kind", ["bag", "table"])
def test_a_fleet_takes_a_number_as_well(kind: str, axis: Path, request: pytest.FixtureRequest) -> None:
    pytest.importorskip("fsspec")
    from tcs_friction.commands.fleet import _signals
    from tcs_friction.fleet.sources import find

    (found,) = find([str(request.getfixturevalue(kind))])
    own = load_axis(axis).mapped(axis)
    for joint in ("1", "elbow"):
        assert _signals(found, own, Choice(joint=joint)).position.joint == "elbow"
    with pytest.raises(InputError, match="--joint: no joint '7', expected 0 to"):
        _signals(found, own, Choice(joint="7"))

