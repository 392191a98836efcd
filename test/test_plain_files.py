"""Files that are none: pipes into which nobody writes, devices without end, folders."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tcs_friction.cli import main
from tcs_friction.errors import InputError
from tcs_friction.plain_files import plain_file, read_plain


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def device(path: Path) -> Path:
    path.symlink_to("/dev/zero")
    return path


def folder(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("make", "found"),
    [(pipe, "is no regular file"), (device, "is no regular file"), (folder, "is a directory"), (Path, "no such file")],
)
def test_what_is_no_file_is_refused_in_one_line(make: Callable[[Path], Path], found: str, tmp_path: Path) -> None:
    path = make(tmp_path / "file")
    with pytest.raises(InputError, match=f"file: {found}, expected a thing"):
        read_plain(path, 10, "a thing")
    with pytest.raises(InputError, match="cannot be read"):
        plain_file(tmp_path / ("x" * 300), "a thing")


def test_no_more_is_read_than_asked_for(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    assert read_plain(tmp_path / "file", 3, "a thing") == b"123"
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_plain(tmp_path / "link", 10, "a thing") == b"12345"


WORDS = {
    "identify": ["identify", "BAG", "--axis", "PIPE", "-o", "OUT"],
    "identify a pipe": ["identify", "PIPE", "--axis", "AXIS", "-o", "OUT"],
    "identify a table": ["identify", "PIPE.csv", "--axis", "AXIS", "-o", "OUT"],
    "diagnose": ["diagnose", "BAG", "--axis", "PIPE", "-o", "OUT"],
    "new": ["new", "PIPE.csv", "-o", "OUT.yaml"],
    "compensate": ["compensate", "AXIS", "--reference", "PIPE", "-o", "OUT"],
    "compensate a diagnosis": ["compensate", "AXIS", "--reference", "AXIS", "--diagnosis", "PIPE", "-o", "OUT"],
    "simulate": ["simulate", "AXIS", "--reference", "PIPE", "-o", "OUT"],
    "bag info": ["bag", "info", "PIPE"],
    "bag import": ["bag", "import", "PIPE.parquet", "-o", "OUT"],
    "fleet": ["fleet", "BAG", "--axes", "PIPE", "-o", "OUT"],
    "parameters of nodes": ["node", "plant", "--ros-args", "--params-file", "PIPE"],
    "parameters of a graph": ["graph", "AXIS", "--ros-args", "--params-file", "PIPE"],
    "the axis of a graph": ["graph", "PIPE"],
}


@pytest.mark.parametrize("name", WORDS)
@pytest.mark.timeout(60)
def test_no_command_waits_for_a_pipe(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = list(WORDS[name])
    axis = Path(__file__).parents[1] / "config" / "azimuth_1p2m.yaml"
    for place, word in enumerate(words):
        if "PIPE" in word:
            ending = word.rpartition("PIPE")[2]
            words[place] = word.replace(f"PIPE{ending}", str(pipe(tmp_path / f"pipe{ending}")))
        elif word.startswith(("OUT", "BAG", "AXIS")):
            words[place] = {"OUT": str(tmp_path / "out"), "BAG": str(axis), "AXIS": str(axis)}[word.partition(".")[0]]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1, told
    assert "regular file" in told or "pipe: no such file" in told
