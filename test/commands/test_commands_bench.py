"""./tcs bench: finds benchmarks, prints a table or one JSON object."""

from __future__ import annotations

import ast
import json
import types
from pathlib import Path

import pytest

from tcs_friction.cli import main
from tcs_friction.commands import bench


def fake() -> types.ModuleType:
    module = types.ModuleType("benchmarks.fake", "A fake.")
    module.add_arguments = lambda parser: parser.add_argument("--size", type=float, default=2.0)  # type: ignore[attr-defined]
    module.run = lambda options: [  # type: ignore[attr-defined]
        {
            "name": "speed",
            "value": options.size * 1e6,
            "unit": "1/s",
            "beside": 1e5,
            "ratio": options.size * 10.0,
        },
        {"name": "error", "value": 1e-9, "unit": "rad", "error": 2.34e-10},
    ]
    return module


@pytest.fixture
def one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "available", lambda: {"fake": "nothing"})
    monkeypatch.setattr(bench.importlib, "import_module", lambda _name: fake())


@pytest.mark.usefixtures("one")
@pytest.mark.parametrize("words", [["fake", "--json"], ["--json", "fake"], ["--json"]])
def test_json_is_one_object(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    import argparse

    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    bench.run(parser.parse_args(words))
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {"benchmark", "results", "machine"}
    assert report["results"][0]["ratio"] == 20.0
    assert report["machine"]["cores"] >= 1


@pytest.mark.usefixtures("one")
def test_options_after_the_name_are_the_benchmark_s(capsys: pytest.CaptureFixture[str]) -> None:
    import argparse

    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    bench.run(parser.parse_args(["fake", "--size", "3"]))
    lines = capsys.readouterr().out.splitlines()
    assert "3,000,000 1/s" in lines[2]
    assert "30 x" in lines[2]
    assert lines[3].split() == ["error", "1e-09", "±", "2.3e-10", "rad"]


def test_unknown_benchmark_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "simulat"]) == 2
    assert "simulate" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["concealed", "--limits", "coggin"], "'coggin'"),
        (["concealed", "--only", "six"], "'six'"),
        (["concealed", "--jobs", "0"], "'0' is no whole number from 1 on"),
        (["cost", "--points", "many"], "'many' is no whole number from 1 on"),
    ],
)
def test_wrong_options_of_a_benchmark_are_one_line(
    words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["bench", *words])
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert error.count("\n") == 1
    assert named in error


def test_every_benchmark_of_the_checkout_has_the_two_functions() -> None:
    import benchmarks

    known = bench.available()
    assert "simulate" in known
    for name in known:
        source = Path(benchmarks.__path__[0], f"{name}.py").read_text(encoding="utf-8")
        functions = {node.name for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}
        assert {"add_arguments", "run"} <= functions, name


def test_outside_a_checkout_there_are_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(_name: str) -> types.ModuleType:
        raise ModuleNotFoundError("benchmarks")

    monkeypatch.setattr(bench.importlib, "import_module", missing)
    with pytest.raises(bench.InputError, match="no benchmarks here"):
        bench.available()
    assert capsys.readouterr().out == ""
