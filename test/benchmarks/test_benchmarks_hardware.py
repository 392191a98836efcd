"""Laws on real recordings: what is left is measured right, said plainly, and drawn; the benchmark's report and its errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import hardware
from tcs_friction.cli import main
from tcs_friction.config import load_axis, save_axis, shipped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.report.hardware import SIMPLEST, dependence, draw_time, draw_where, remarks, sentence

COGGING = {"order": 8000.0, "amplitude": 15.0, "phase": 0.3}


def test_dependence_is_the_share_of_power() -> None:
    random = np.random.default_rng(0)
    x = random.uniform(0.0, 1.0, 20_000)
    noise = random.standard_normal(len(x))
    wave = np.sqrt(2.0) * np.sin(20.0 * x)
    assert dependence(noise, x) < 0.01
    assert dependence(wave + noise, x) == pytest.approx(np.var(wave) / (np.var(wave) + 1.0), abs=0.02)
    assert dependence(wave, x) > 0.95
    assert dependence(noise, np.zeros(len(x))) == 0.0
    assert dependence(noise[:15], x[:15]) == 0.0
    assert dependence(np.zeros(1000), x[:1000]) == 0.0


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like that of the real recordings: an axis with cogging that nobody tells the laws of."""
    folder = tmp_path_factory.mktemp("data")
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    true = replace(file.axis, effects=(instance(effect("cogging"), COGGING),))
    (folder / "rig").mkdir()
    save_axis(folder / "rig" / "axis.yaml", replace(file, axis=true))
    reference = folder / "reference.yaml"
    reference.write_text("reference: {kind: sinusoid, amplitude: 2.2e-3, period: 8.0, duration: 16.0}\n")
    words = ["simulate", str(folder / "rig" / "axis.yaml"), "--reference", str(reference)]
    assert main([*words, "-o", str(folder / "rig" / "recording")]) == 0
    save_axis(folder / "rig" / "axis.yaml", replace(file, axis=replace(file.axis, effects=())))
    (folder / "rig" / "README.md").write_text("# A rig on a bench\nAnd more.\n")
    return folder


def test_a_torque_over_position_is_left_and_named(data: Path) -> None:
    subject = hardware.subject_of(data / "rig", [SIMPLEST, "lugre"], 0)
    assert subject.what == "A rig on a bench"
    assert subject.ranking[0] == "lugre"
    residual = subject.found["lugre"].fit.residual
    assert np.std(residual) > 0.6 * COGGING["amplitude"] / np.sqrt(2.0), "cogging must not be fitted away"
    assert dependence(residual, subject.position("lugre")) > 0.7
    words = " ".join(remarks(subject))
    assert "lugre does best" in words
    assert "goes with position" in words
    assert "imitate" not in words
    assert "on 1 of them" in sentence([subject])
    assert draw_time(subject).name == "rig_time"
    assert draw_where(subject).png.startswith(b"\x89PNG")


def test_the_benchmark_writes_table_and_report(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["bench", "hardware", "--data", str(data), "--laws", "lugre", "-o", str(tmp_path / "out")]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "rig: lugre" in printed
    assert "rig: coulomb_viscous" in printed
    document = (tmp_path / "out" / "report.html").read_text()
    assert "A rig on a bench" in document
    assert "goes with position" in document
    assert (tmp_path / "out" / "rig_where.png").is_file()


def test_bristles_that_imitate_gravity_are_called_so(shared_data: Path) -> None:
    """A pendulum: its weight is hidden from the model, and a law with soft bristles takes it for friction."""
    subject = hardware.subject_of(shared_data / "data" / "bam_sin_sin_kp200", [SIMPLEST, "lugre"], 0)
    assert "imitate a torque that depends on position" in " ".join(remarks(subject))
    assert subject.unexplained(SIMPLEST) > 0.8


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "rik"], "no recording 'rik'"),
        (["--laws", "lugree"], "lugre"),
        (["--data", "nowhere"], "no recordings"),
    ],
)
def test_errors_are_one_line(
    data: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    given = [] if "--data" in words else ["--data", str(data)]
    assert main(["bench", "hardware", *given, *words, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
