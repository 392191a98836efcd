"""What the command line refuses, in one line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tcs_friction.cli import main


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--host", "0.0.0.0"], "0.0.0.0 can be reached from other machines, expected --token-file FILE or TCS_LIVE_TOKEN"),
        (["--host", "::"], "--host: :: can be reached"),
        (["--token-file", "nowhere"], "nowhere: No such file or directory, expected a file with a token"),
    ],
)
def test_a_page_for_others_needs_a_token(
    words: Sequence[str], line: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TCS_LIVE_TOKEN", raising=False)
    assert main(["live", *words]) == 2
    said = capsys.readouterr().err
    assert line in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("command", ["live", "graph"])
@pytest.mark.parametrize("port", ["-1", "65536", "http"])
def test_a_port_that_is_none_is_refused(command: str, port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, f"--port={port}"])
    assert ended.value.code == 2
    assert "is no port" in capsys.readouterr().err


def test_a_graph_without_a_page_takes_no_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", "--port", "8000"]) == 2
    assert capsys.readouterr().err == "tcs-friction: --port: 8000 without --live, expected --live beside it\n"


@pytest.mark.parametrize("words", [["live"], ["graph", "--live"]])
def test_without_its_packages_it_says_how_to_get_them(
    words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert main(words) == 2
    expected = "tcs-friction: live: needs a package that is not installed (uvicorn), expected ./tcs live"
    assert capsys.readouterr().err.startswith(expected)
