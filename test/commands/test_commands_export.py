"""`export` and `compare` on the command line."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from tcs_friction import cli
from tcs_friction.commands.export import above_zero, number, numbers, share, span
from tcs_friction.config import load_axis, shipped

AXIS = shipped("azimuth_1p2m.yaml")
URDF = '<robot name="r"><joint name="azimuth" type="revolute"><limit effort="1" velocity="1"/></joint></robot>\n'


def exported(*words: str) -> int:
    return cli.main(["export", str(AXIS), *words])


def test_dry_run_shows_the_difference_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, better = tmp_path / "user.urdf", tmp_path / "better.urdf"
    model.write_text(URDF)
    words = ["--to", "urdf", "--into", str(model), "-o", str(better), "--speed", "0.05"]
    assert exported(*words, "--dry-run") == 0
    shown = capsys.readouterr().out
    assert f"--- {model}\n+++ {better}\n" in shown
    assert "<dynamics damping=" in shown
    assert "cogging of order 72: not expressed (amplitude 0.5 N m)" in shown
    assert not better.exists()
    assert exported(*words) == 0
    assert better.read_text().count("<dynamics") == 1
    assert model.read_text() == URDF


def test_a_table_can_be_had_as_json_with_its_notes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "friction.csv"
    assert exported("--to", "table", "-o", str(out), "--json", "--temperatures", "0,20", "--share", "0.8") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["format"] == "table"
    assert told["files"] == [str(out)]
    assert told["notes"][0] == "all torque times 0.8 (--share)"
    assert out.read_text().startswith("speed (rad/s),temperature (degC),torque (N m)\n-1,0,")


def test_code_takes_its_name_and_period(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exported("--to", "c", "-o", str(tmp_path / "My axis.c"), "--period", "5e-4") == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        f"my_axis{end}" for end in (".c", ".h", ".hpp", "_test.c", "_controller.cpp")
    }
    assert "for a period of 0.0005 s" in capsys.readouterr().out
    assert exported("--to", "fmu", "-o", str(tmp_path / "a.fmu"), "--dry-run") == 0
    assert " bytes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--to", "mcjf"], "--to: no format 'mcjf', expected mjcf"),
        (["--to", "mjcf"], "--into: is missing, expected the model that gets the axis"),
        (["--to", "c", "--into", "x.xml"], "--into: given for c, which makes files of its own"),
        (["--to", "c", "--kind", "x"], "--kind: no kind 'x' of c, expected nothing for c"),
        (["--to", "urdf", "--into", str(AXIS)], "no XML"),
    ],
)
def test_wrong_usage_is_one_line(
    words: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exported(*words, "-o", str(tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_users_model_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "user.urdf"
    model.write_text(URDF)
    assert exported("--to", "urdf", "--into", str(model), "-o", str(model)) == 2
    assert "would be written over the input" in capsys.readouterr().err
    assert model.read_text() == URDF


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        (number, "1e-3", ["-1", "x", "inf", "1e999", ""]),
        (above_zero, "1e-3", ["0", "-1", "x"]),
        (share, "0.5", ["1.1", "-1"]),
        (numbers, "1,2", ["1,x", "nan", ""]),
        (span, "-1:2", ["1", "2:1", "1:2:3", "a:b"]),
    ],
)
def test_arguments_are_checked(kind: object, good: str, bad: list[str]) -> None:
    assert callable(kind)
    kind(good)
    for word in bad:
        with pytest.raises(argparse.ArgumentTypeError):
            kind(word)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    (folder / "run.yaml").write_text("reference: {kind: sinusoid, amplitude: 0.02, period: 4.0, duration: 8.0}\n")
    assert cli.main(["simulate", str(AXIS), "--reference", str(folder / "run.yaml"), "-o", str(folder / "bag")]) == 0
    return folder / "bag"


def test_compare_says_how_well_a_bag_fits(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["compare", str(bag), "--axis", str(AXIS), "--with", str(bag)]
    assert cli.main(words) == 0
    assert "torque     100.00 %" in capsys.readouterr().out
    assert cli.main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["compared"][str(bag)]
    assert [one["fit"] for one in found] == [100.0] * 3
    for more, expected in (
        (["--joint", "a"], "--joint: given with the bag"),
        (["--horizon", "0"], "--horizon: 0, expected"),
    ):
        assert cli.main([*words, *more]) == 2
        assert expected in capsys.readouterr().err


def test_compare_drives_a_model_before_and_after(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Somebody's MJCF and a bag become his better MJCF, as the tutorial in docs/export.md has it."""
    pytest.importorskip("mujoco", reason="of the optional set mujoco")
    user, better = tmp_path / "user.xml", tmp_path / "better.xml"
    user.write_text("""<mujoco><compiler angle="radian"/><option timestep="5e-4" gravity="0 0 0"/><worldbody><body>
<joint name="azimuth" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="900 900 900"/></body></worldbody></mujoco>""")
    assert load_axis(AXIS).axis.name == "azimuth"
    assert exported("--to", "mjcf", "--into", str(user), "-o", str(better), "--speed", "0.1") == 0
    capsys.readouterr()
    assert cli.main(["compare", str(bag), "--axis", str(AXIS), "--with", str(user), "--with", str(better), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["compared"]
    before, after = ({one["signal"]: one["fit"] for one in found[str(path)]} for path in (user, better))
    assert all(after[signal] > before[signal] for signal in before), (before, after)
    assert after["torque"] > 80.0
    assert after["position"] > 80.0
