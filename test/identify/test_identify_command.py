"""The command line of identify: files, exit statuses, one line for every error."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tcs_friction.cli import main
from tcs_friction.config import load_axis


def words(folder: Path, output: Path) -> list[str]:
    """The command for a folder of shared data."""
    return [
        "identify",
        str(folder / "recording"),
        "--axis",
        str(folder / "axis.yaml"),
        "-o",
        str(output),
        "--json",
    ]


def test_emps_from_bag_to_files(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shared_data / "data" / "emps"
    assert main(words(folder, tmp_path)) == 0
    captured = capsys.readouterr()
    printed = json.loads(captured.out)
    assert (
        captured.err == f"tcs-friction: {folder / 'recording'}: time base: header stamps of /joint_states\n"
    )
    written = json.loads((tmp_path / "identification.json").read_text())
    assert written == printed
    assert written["schema"] == "tcs_friction/identification/1"
    assert written["inertia"]["value"] == pytest.approx(95.109, rel=0.01)
    assert set(written["directions"]) == {"positive", "negative"}
    axis = load_axis(tmp_path / "axis.yaml").axis
    assert axis.friction.values["coulomb"] == written["parameters"]["coulomb"]["value"]
    assert [item.term.id for item in axis.effects] == ["torque_bias"]
    assert (tmp_path / "report.html").is_file()


def test_errors_are_one_line(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = shared_data / "data" / "emps"
    bag, axis = str(folder / "recording"), str(folder / "axis.yaml")
    bare = tmp_path / "bare.yaml"
    bare.write_text("axis: {inertia: 1.0, friction: {law: coulomb_viscous, coulomb: 1.0, viscous: 1.0}}\n")
    for given, message in (
        ([bag, "--axis", str(bare)], "no signals block"),
        ([bag, "--axis", axis, "--law", "lugr"], "lugre"),
        ([bag, "--axis", axis, "--bandwidth", "-3"], "bandwidth"),
        ([str(tmp_path / "none"), "--axis", axis], "none"),
        ([bag, "--axis", axis, "--swarm", "population=40"], "method default"),
        ([bag, "--axis", axis, "--compare", "--law", "all"], "one law"),
        ([bag, "--axis", axis, "--method", "pso", "--swarm", "populatoin=40"], "population"),
        ([bag, "--axis", axis, "--method", "pso", "--swarm", "population=4.5"], "a whole number"),
        ([bag, "--axis", axis, "--method", "pso", "--swarm", "population=2"], "at least 4"),
        ([bag, "--axis", axis, "--method", "pso", "--swarm", "crossover=nan"], "finite"),
    ):
        assert main(["identify", *given, "-o", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert error.startswith("tcs-friction: ")
        assert message in error
    assert not (tmp_path / "out").exists()


def test_settings_of_a_swarm(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--law", "lugre", "--method", "pso", "--swarm", "population=8", "--swarm", "budget=50"]
    assert main([*words(shared_data / "data" / "emps", tmp_path), *settings]) == 1
    captured = capsys.readouterr()
    printed = json.loads(captured.out)
    assert (printed["outcome"], printed["minimum"]) == ("budget spent", False)
    assert printed["evaluations"] < 100  # the rest judges what was found
    last = captured.err.splitlines()[-1]
    assert last.startswith("tcs-friction: --method pso: the search did not end at a minimum, expected --refine, ")
    assert json.loads((tmp_path / "identification.json").read_text()) == printed
    assert load_axis(tmp_path / "axis.yaml").axis.friction.values["coulomb"] == printed["parameters"]["coulomb"]["value"]
    assert "No value has an interval" in (tmp_path / "report.html").read_text()


def test_what_has_no_interval_says_so_on_the_terminal_and_a_switch_gives_it_one(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [word for word in words(shared_data / "data" / "emps", tmp_path) if word != "--json"]
    command += ["--law", "coulomb_viscous", "--method", "ga", "--swarm", "population=4", "--swarm", "generations=1"]
    assert main(command) == 1
    out = capsys.readouterr().out
    assert "N s/m, no interval: the search did not end at a minimum\n" in out
    assert "±" not in out
    assert "nan" not in out
    assert main([*command, "--refine"]) == 0
    out = capsys.readouterr().out
    assert out.count("±") == 4
    assert "no interval" not in out
    assert "inertia and torque constant cannot be told apart" in out, "notes are on the terminal, too"


def test_pso_beside_pso_ga(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [*words(shared_data / "data" / "emps", tmp_path), "--compare"]
    command += ["--swarm", "population=8", "--swarm", "generations=2", "--law"]
    assert main([*command, "coulomb_viscous"]) == 0, "the default method, whose result it is, has converged"
    printed = json.loads(capsys.readouterr().out)
    assert printed["method"] == "default"
    hybrid, swarm = printed["compare"]
    assert (hybrid["method"], swarm["method"]) == ("pso-ga", "pso")
    assert 0 <= hybrid["evaluations"] - swarm["evaluations"] < 8
    assert json.loads((tmp_path / "identification.json").read_text())["compare"] == printed["compare"]
    assert (tmp_path / "searches.png").is_file()
    assert "PSO-GA beside PSO" in (tmp_path / "report.html").read_text()
    assert main([*command, "lugre", "--method", "pso-ga"]) == 1
    hybrid, swarm = json.loads(capsys.readouterr().out)["compare"]
    command.remove("--json")
    assert main([*command, "lugre", "--method", "pso-ga"]) == 1
    out = capsys.readouterr().out
    assert re.search(r"\nwith as many evaluations +PSO-GA +PSO\n", out)
    assert re.search(rf"\nevaluations +{hybrid['evaluations']} +{swarm['evaluations']}\n", out)
    assert re.search(rf"\n  coulomb +{hybrid['values']['coulomb']:.6g} N, no interval", out), "PSO-GA's own result comes first"


def test_an_axis_file_without_an_inertia_gets_one(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (shared_data / "data/emps/axis.yaml").read_text().splitlines()
    results = []
    for value in (None, 1e-3, 1e5):
        folder = tmp_path / str(value)
        folder.mkdir()
        new = [line if "inertia:" not in line else f"  inertia: {value!r}" for line in lines if value or "inertia:" not in line]
        (folder / "axis.yaml").write_text("\n".join(new))
        recorded = str(shared_data / "data/emps/recording")
        assert main(["identify", recorded, "--axis", str(folder / "axis.yaml"), "-o", str(folder / "out"), "--json"]) == 0
        results.append(json.loads(capsys.readouterr().out)["inertia"]["value"])
    assert results == pytest.approx([results[0]] * 3, rel=1e-6)
    assert results[0] == pytest.approx(95.109, rel=0.01)


def test_an_inertia_that_neither_file_nor_recording_knows_is_refused(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shared_data / "data/odrive_slow"
    lines = [line for line in (folder / "axis.yaml").read_text().splitlines() if "inertia:" not in line]
    (tmp_path / "axis.yaml").write_text("\n".join(lines))
    words = ["identify", str(folder / "recording"), "--axis", str(tmp_path / "axis.yaml"), "-o", str(tmp_path / "out")]
    assert main(words) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert "axis.yaml: has no inertia, and" in error
    assert not (tmp_path / "out/axis.yaml").exists()
    assert main([*words, "--hold-inertia"]) == 2
    assert "inertia is missing" in capsys.readouterr().err
