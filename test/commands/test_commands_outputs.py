"""No command writes over what it reads, whatever the file is called and however it is named on the command line."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tcs_friction.cli import COMMANDS, main
from tcs_friction.commands.parser import parser_of
from tcs_friction.config import shipped

INTO_A_DIRECTORY = ("identify", "diagnose", "response", "calibrate")
INTO_A_NEW_PLACE = ("simulate", "demo")
WITHOUT_INPUTS = ("paper",)  # but for files of the package
AXIS = str(shipped("azimuth_1p2m.yaml"))
REFERENCE = str(shipped("azimuth_1p2m_run.yaml"))


def names(command: str) -> tuple[str, ...]:
    """What a command may write into its directory, and a picture."""
    return (*importlib.import_module(f"tcs_friction.commands.{command}").WRITTEN, "residual.png")


def itself(path: Path, _: Path) -> Path:
    return path


def roundabout(path: Path, _: Path) -> Path:
    return path.parent / ".." / path.parent.name / path.name


def symbolic(path: Path, link: Path) -> Path:
    link.symlink_to(path)
    return link


def hard(path: Path, link: Path) -> Path:
    os.link(path, link)
    return link


def test_every_command_that_writes_is_tested_here() -> None:
    parsers = {name: parser_of(name, importlib.import_module(f"tcs_friction.commands.{name}")) for name in COMMANDS}
    writing = {name for name, parser in parsers.items() if any(action.dest == "output" for action in parser._actions)}
    elsewhere = {"compensate", "export", "fleet", "new"}  # in tests of their own
    assert writing == {*INTO_A_DIRECTORY, *INTO_A_NEW_PLACE, *WITHOUT_INPUTS, *elsewhere}, "bag has commands of its own"


@pytest.mark.parametrize("named", [itself, roundabout, symbolic, hard])
@pytest.mark.parametrize(("command", "name"), [(command, name) for command in INTO_A_DIRECTORY for name in names(command)])
def test_results_replace_no_input(
    command: str, name: str, named: Callable[[Path, Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("# mine\n")
    (tmp_path / "bag").mkdir()
    given = str(named(out / name, tmp_path / "given"))
    inside = str(tmp_path / "bag")
    os.link(out / name, tmp_path / "bag" / "metadata.yaml")
    for words in ([given, "--axis", AXIS], [inside, "--axis", AXIS], ["bag", "--axis", given]):
        assert main([command, *words, "-o", str(out)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"tcs-friction: {out / name}: would be written over the input "), error
        assert error.count("\n") == 1
    assert (out / name).read_text() == "# mine\n"
    assert [path.name for path in out.iterdir()] == [name]


def test_a_simulation_that_is_compared_with_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "report.html").write_text("mine")
    words = ["diagnose", "bag", "--against", str(tmp_path / "report.html"), "-o", str(tmp_path)]
    assert main(words) == 2
    assert "would be written over the input" in capsys.readouterr().err


@pytest.mark.parametrize("file", ["table.csv", "axis.yaml", "bag/bag_0.mcap", "bag/metadata.yaml"])
def test_a_table_replaces_no_input(file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bag").mkdir()
    path = tmp_path / file
    path.write_text("mine")
    bag, axis = str(tmp_path / "bag"), str(tmp_path / "axis.yaml")
    for words in (["export", bag, "--axis", axis], ["export", str(path), "--axis", AXIS]):
        if str(path) in words or path.parent == tmp_path / "bag":
            assert main(["bag", *words, "-o", str(path)]) == 2
            assert "would be written over the input" in capsys.readouterr().err
    for words in (["import", str(path)], ["import", str(path), "--axis", axis]):
        assert main(["bag", *words, "-o", str(path)]) == 2
        assert "exists already" in capsys.readouterr().err
    assert path.read_text() == "mine"


@pytest.mark.parametrize("command", INTO_A_NEW_PLACE)
def test_what_wants_a_new_place_takes_no_other(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(Path(AXIS).read_text())
    words = ["simulate", str(mine), "--reference", REFERENCE] if command == "simulate" else ["demo", "--axis", str(mine)]
    for output in (mine, tmp_path):
        assert main([*words, "-o", str(output)]) == 2
        error = capsys.readouterr().err
        assert any(why in error for why in ("exists already", "is a file", "is not empty")), error
    assert mine.read_text() == Path(AXIS).read_text()
