"""The command response: files, what is said without a reference, one line for every error."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.cli import main
from tcs_friction.config import load_axis, save_axis, shipped
from tcs_friction.recording.encode import joint_states
from tcs_friction.recording.write import EPOCH, write_bag

INERTIA = 50.0


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """White torque on a free inertia at 500 Hz, held through the period that ends with its stamp; no reference."""
    random = np.random.default_rng(1)
    period, n = 2e-3, 15_000
    torque = random.standard_normal(n)
    speed = np.concatenate([[0.0], np.cumsum(torque[1:] * period / INERTIA)])
    position = np.concatenate([[0.0], np.cumsum(period * 0.5 * (speed[:-1] + speed[1:]))])
    times = EPOCH + np.arange(n) * 2_000_000
    path = tmp_path_factory.mktemp("response") / "bag"
    write_bag(path, [joint_states("/azimuth/joint_states", times, {"azimuth": {"position": position, "effort": torque}})])
    return path


@pytest.fixture
def axis(tmp_path: Path) -> Path:
    """The shipped axis file without reference, velocity and delay."""
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    assert file.signals is not None
    signals = replace(file.signals, reference=None, velocity=None)
    save_axis(tmp_path / "axis.yaml", replace(file, signals=signals, axis=replace(file.axis, actuation_delay=0.0)))
    return tmp_path / "axis.yaml"


def test_from_bag_to_files(bag: Path, axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["response", str(bag), "--axis", str(axis), "-o", str(tmp_path / "out"), "--lowest", "2"]) == 0
    said = capsys.readouterr().out
    assert "no resonance" in said
    assert "no reference recorded" in said
    written = json.loads((tmp_path / "out" / "response.json").read_text())
    assert written["response"]["frequency"][-1] == pytest.approx(50.0, rel=0.02), "a tenth of the sample rate"
    model = written["models"]["second_order"]
    first = model["parameters"]["first"]
    assert abs(first["value"] - INERTIA) < 4.0 * first["std"] + 0.001 * INERTIA
    assert model["misfit"] < 0.05
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_run_that_tells_nothing_ends_with_status_1(
    axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Speed and torque go together, but as in no plant: the torque is the speed's third derivative."""
    random = np.random.default_rng(1)
    speed = np.convolve(random.standard_normal(15_000), np.ones(4), "same")
    times = EPOCH + np.arange(len(speed)) * 2_000_000
    joint = {"position": np.cumsum(speed) * 2e-3, "effort": np.gradient(np.gradient(np.gradient(speed)))}
    write_bag(tmp_path / "bag", [joint_states("/azimuth/joint_states", times, {"azimuth": joint})])
    words = ["response", str(tmp_path / "bag"), "--axis", str(axis), "-o", str(tmp_path / "out"), "--lowest", "2"]
    assert main(words) == 1
    captured = capsys.readouterr()
    assert "Neither model explains" in captured.out
    assert captured.err.count("\n") == 1
    assert "neither model fits" in captured.err
    assert (tmp_path / "out" / "response.json").is_file()


def test_errors_are_one_line(bag: Path, axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = tmp_path / "bare.yaml"
    save_axis(bare, replace(load_axis(axis), signals=None))
    (tmp_path / "file").write_text("")
    out = ["-o", str(tmp_path / "out")]
    for words, message in (
        (["--axis", str(bare), *out], "no signals block"),
        (["--axis", str(axis), *out, "--lowest", "0.1"], "of recording"),
        (["--axis", str(axis), *out, "--highest", "400"], "half the sample rate"),
        (["--axis", str(axis), "-o", str(tmp_path / "file" / "out")], "cannot be written"),
    ):
        assert main(["response", str(bag), *words]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error
