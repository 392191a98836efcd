"""The command line's promises: exit status, one line on stderr, never a traceback."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType

import pytest

from tcs_friction import cli
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics import registry


def command(monkeypatch: pytest.MonkeyPatch, run: object) -> None:
    """Put a command `probe` in place, whose `run` does as told."""
    module = ModuleType("tcs_friction.commands.probe")

    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--number", type=int)

    module.__dict__.update(add_arguments=add_arguments, run=run, __doc__="A probe.")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(cli.COMMANDS, "probe", "probe")


def raising(error: BaseException) -> object:
    def run(_: argparse.Namespace) -> int:
        raise error

    return run


@pytest.mark.parametrize(("returned", "status"), [(None, 0), (0, 0), (1, 1)])
def test_status_of_a_command(monkeypatch: pytest.MonkeyPatch, returned: int | None, status: int) -> None:
    command(monkeypatch, lambda _: returned)
    assert cli.main(["probe"]) == status


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (
            InputError("a.yaml", "no axis block", "axis: {...}"),
            2,
            "a.yaml: no axis block, expected axis: {...}",
        ),
        (JobError("bag", "never moves"), 1, "bag: never moves"),
        (InputError("a.yaml", "two\nlines"), 2, "a.yaml: two lines"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_errors_become_one_line_and_a_status(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    status: int,
    line: str,
) -> None:
    command(monkeypatch, raising(error))
    assert cli.main(["probe"]) == status
    assert capsys.readouterr().err == f"tcs-friction: {line}\n"


def test_wrong_option_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command(monkeypatch, lambda _: 0)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["probe", "--number", "many"])
    assert stopped.value.code == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "tcs-friction probe: " in message
    assert "'many'" in message


def test_unknown_command_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["diagnos"]) == 2
    message = capsys.readouterr().err
    assert "no command 'diagnos', expected diagnose" in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(("words", "status"), [(["--help"], 0), (["identify", "--help"], 0), (["identify"], 2)])
def test_a_reader_that_has_gone_is_no_error(words: list[str], status: int) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-P", "-m", "tcs_friction.cli", *words]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (ended.returncode, ended.stderr.count("\n")) == (status, 1 if status else 0), ended.stderr



def test_help_and_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    page = capsys.readouterr().out
    assert all(name in page for name in cli.COMMANDS)
    assert cli.main([]) == 2
    assert capsys.readouterr().out == page


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for name in cli.COMMANDS:
        module = importlib.import_module(f"tcs_friction.commands.{name}")
        for words in [[name], *([name, second] for second in getattr(module, "SUBCOMMANDS", {}))]:
            with pytest.raises(SystemExit) as ended:
                cli.main([*words, "--help"])
            assert ended.value.code == 0
            assert capsys.readouterr().out.startswith(f"usage: tcs-friction {' '.join(words)}"), words


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "/nowhere/bag", "--axis", "/nowhere/axis.yaml", "-o", "out"],
        ["simulate", "/nowhere/axis.yaml", "--reference", "/nowhere/r.yaml", "-o", "out"],
        ["diagnose", "/nowhere/bag", "--axis", "/nowhere/axis.yaml", "-o", "out"],
    ],
)
def test_missing_files_are_bad_input(words: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tcs_friction.cli", *words], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "no such file" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_command_begins_without_what_only_some_of_its_work_needs() -> None:
    program = (
        "import sys, importlib\n"
        "needed = {'fleet': 'numpy', 'bag': 'tcs_friction.identify', 'identify': 'matplotlib', 'new': 'matplotlib'}\n"
        "for name, late in needed.items():\n"
        "    importlib.import_module(f'tcs_friction.commands.{name}')\n"
        "    assert late not in sys.modules, (name, late)\n"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_closed_pipe_is_no_error() -> None:
    program = (
        "import sys; from tcs_friction import cli\n"
        "def run(arguments):\n    print('x' * 10 ** 6)\n    sys.stdout.flush()\n"
        "import types; m = types.ModuleType('p'); m.add_arguments = lambda parser: None; m.run = run\n"
        "sys.modules['tcs_friction.commands.probe'] = m; cli.COMMANDS['probe'] = ''\n"
        "sys.exit(cli.main(['probe']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 0
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()


def test_what_a_plug_in_raises_is_one_line_that_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command(monkeypatch, raising(ZeroDivisionError("two\nlines")))
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([EntryPoint("magnet", f"{__name__}:TERM", "g")]))
    assert cli.main(["probe"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("tcs-friction: entry point magnet of g: ZeroDivisionError: two lines, expected ")
    assert told.count("\n") == 1
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints(()))
    with pytest.raises(ZeroDivisionError):  # our own mistakes are to be seen
        cli.main(["probe"])
