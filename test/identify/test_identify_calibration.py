"""Calibration against a dynamometer: known scales, offsets, inertias and delays come back; the bars on the simulated axis."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.cli import main
from tcs_friction.config import default_control, load_axis, save_axis, shipped
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.observer import FrictionObserver
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.reference import ConstantSpeed, Legs, Reference, load_reference
from tcs_friction.errors import InputError, JobError
from tcs_friction.identify.dob_acceptance import accepted
from tcs_friction.identify.dob_calibration import (
    Calibration,
    Comparison,
    calibrate,
    comparisons_of,
    uniform_motion,
)
from tcs_friction.recording.encode import encoded, joint_states
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.write import EPOCH, write_bag

FILE = load_axis(shipped("azimuth_1p2m.yaml"))
CONTROL = FILE.control or default_control(FILE.axis)
DYNAMOMETER_NOISE = 1e-3 * 200.0  # N m: 0.1 % of full scale


def moved(reference: Reference) -> LoopRun:
    return simulate_loop(
        FILE.axis, reference, CONTROL.controller, CONTROL.loop, CONTROL.observer, CONTROL.compensator
    )


@pytest.fixture(scope="module")
def legs() -> LoopRun:
    """The tracking run: legs to and fro, four reversals."""
    return moved(load_reference(shipped("azimuth_1p2m_run.yaml")))


@pytest.fixture(scope="module")
def sinusoid() -> LoopRun:
    """The zero-crossing run."""
    return moved(load_reference(shipped("azimuth_1p2m_measure.yaml")))


def beside(run: LoopRun, scale: float = 1.0, offset: float = 0.0, delay: float = 0.0) -> Comparison:
    """The run with a torque that is logged wrongly and a dynamometer that is noisy and late."""
    noise = np.random.default_rng(0).standard_normal(len(run.t))
    true = np.interp(run.t - delay, run.t, run.friction + run.opposing)
    return Comparison(run.t, (run.torque - offset) / scale, run.velocity, true + DYNAMOMETER_NOISE * noise)


def wrong(estimator: str = "dob") -> ObserverSettings:
    return replace(CONTROL.observer, estimator=estimator, plant=replace(CONTROL.observer.plant, first=900.0))


@pytest.mark.parametrize("estimator", ["dob", "kalman"])
def test_bars_on_the_simulated_axis(estimator: str, legs: LoopRun, sinusoid: LoopRun) -> None:
    """Accuracy 99.5 % in uniform motion and 98 % over zero crossings; the calibrated observer keeps it on another run."""
    found = calibrate([beside(legs, 1.03, 1.5)], wrong(estimator))
    assert found.accuracy_uniform > 0.995
    assert found.accuracy > 0.98
    assert found.accuracy_before < 0.975
    other = beside(sinusoid, 1.03, 1.5)
    estimate = FrictionObserver(found.observer, other.period).over(other.torque, other.velocity)
    late = round(found.observer.filter_delay / other.period)
    error = estimate[1000 + late :] - other.dynamometer[1000 : len(other.t) - late]
    assert 1.0 - np.sqrt(np.mean(error**2) / np.mean(other.dynamometer**2)) > 0.98


def within(value: float, std: float, truth: float, times: float = 4.0) -> bool:
    return abs(value - truth) < times * std


@pytest.mark.parametrize("delay", [0.0, 0.06])
def test_what_was_wrong_is_found(legs: LoopRun, delay: float) -> None:
    found = calibrate([beside(legs, 1.03, 1.5, delay)], wrong())
    settings = found.observer
    assert settings.torque_scale == pytest.approx(1.03, rel=2e-3)
    assert settings.torque_offset == pytest.approx(1.5, abs=0.2)
    assert within(settings.plant.first, found.inertia_std, 1000.0)
    assert found.inertia_std < 50.0
    assert found.dynamometer_delay == pytest.approx(delay, abs=0.004)
    assert found.notes == ()


def test_a_right_observer_is_left_nearly_alone(legs: LoopRun) -> None:
    found = calibrate([beside(legs)], CONTROL.observer)
    assert found.accuracy_before > 0.995
    assert found.observer.torque_scale == pytest.approx(1.0, abs=2e-3)
    assert found.observer.torque_offset == pytest.approx(0.0, abs=0.2)


def test_a_nominal_plant_that_holds_the_viscous_friction_is_no_error(legs: LoopRun) -> None:
    """Such an observer's estimate leaves the viscous torque out, the dynamometer does not."""
    plant = replace(CONTROL.observer.plant, constant=572.0)
    found = calibrate([beside(legs)], replace(CONTROL.observer, plant=plant))
    assert found.accuracy_before > 0.99
    assert found.observer.torque_scale == pytest.approx(1.0, abs=3e-3)
    assert found.observer.plant.constant == 572.0


def test_motion_one_way_leaves_the_offset_and_the_inertia_alone() -> None:
    run = moved(Reference(ConstantSpeed(1.745e-3, duration=12.0)))
    found = calibrate([beside(run, 1.03)], wrong())
    assert found.observer.torque_scale == pytest.approx(1.03, rel=5e-3)
    assert (found.observer.torque_offset, found.observer.plant.first) == (0.0, 900.0)
    assert any("one way" in note for note in found.notes)
    assert any("hardly accelerate" in note for note in found.notes)
    assert found.dynamometer_delay == 0.0
    assert found.to_mapping()["inertia"]["std"] is None


def test_two_recordings_are_one_calibration(legs: LoopRun, sinusoid: LoopRun) -> None:
    found = calibrate([beside(legs, 1.03), beside(sinusoid, 1.03)], wrong())
    assert found.observer.torque_scale == pytest.approx(1.03, rel=2e-3)
    assert len(found.t) > len(legs.t)


def test_uniform_motion_is_found_under_sensor_noise() -> None:
    t = 1e-3 * np.arange(10_000)
    velocity = np.where(t < 5.0, 1.0, 1.0 + np.sin(3.0 * t))
    velocity = velocity + 0.02 * np.random.default_rng(0).standard_normal(len(t))
    steady = uniform_motion(t, velocity)
    assert steady[300:4500].all()
    assert not steady[5300:].any()
    assert not uniform_motion(t, 0.0 * t).any()
    assert not uniform_motion(t[:100], velocity[:100]).any()


def test_without_uniform_motion_there_is_no_calibration() -> None:
    t = 1e-3 * np.arange(10_000)
    wave = np.sin(9.0 * t)
    with pytest.raises(InputError, match="uniform motion"):
        calibrate([Comparison(t, wave, wave, wave)], ObserverSettings())
    with pytest.raises(InputError, match="no recording"):
        calibrate([], ObserverSettings())


def test_bad_columns_are_refused() -> None:
    t = 1e-3 * np.arange(10_000)
    with pytest.raises(InputError, match="dynamometer"):
        Comparison(t, t, t, np.where(t > 1.0, np.nan, t))
    with pytest.raises(InputError, match="too short"):
        Comparison(t[:100], t[:100], t[:100], t[:100])
    with pytest.raises(InputError, match="no usable reading"):
        comparisons_of(Recording(t, t, t))
    with pytest.raises(InputError, match="every stretch is too short"):
        comparisons_of(Recording(t[:1000], t[:1000], t[:1000], exogenous={"dynamometer": t[:1000]}))


def test_gaps_divide_a_recording_and_speed_comes_from_position(legs: LoopRun) -> None:
    half = len(legs.t) // 2
    keep = np.r_[0 : half - 500, half : len(legs.t)]
    reading = beside(legs).dynamometer
    recording = Recording(
        legs.t[keep], legs.position[keep], legs.torque[keep], exogenous={"dynamometer": reading[keep]},
        segments=(slice(0, half - 500), slice(half - 500, len(keep))),
    )  # fmt: skip
    parts = comparisons_of(recording)
    assert [len(part.t) for part in parts] == [half - 500, len(legs.t) - half]
    assert calibrate(parts, wrong()).accuracy_uniform > 0.995


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Joint states at 1 kHz and a gauge at 50 Hz, as the recorder leaves them."""
    run = moved(Reference(Legs(speed=1.745e-3, leg=4.0, acceleration=5e-3, duration=20.0)))
    times = EPOCH + np.rint(run.t * 1e9).astype(np.int64)
    joint = {"position": run.position, "velocity": run.velocity, "effort": (run.torque - 1.5) / 1.03}
    few = slice(None, None, 20)
    wrench = {"wrench.torque.z": beside(run).dynamometer[few]}
    path = tmp_path_factory.mktemp("calibration") / "bag"
    topics = [
        joint_states("/azimuth/joint_states", times, {"azimuth": joint}),
        encoded(
            "/azimuth/reference", "tcs_friction_msgs/msg/AxisReference", times, {"position": run.reference}
        ),
        encoded("/azimuth/dynamometer", "geometry_msgs/msg/WrenchStamped", times[few], wrench),
    ]
    write_bag(path, topics)
    return path


def test_command_from_bag_to_files(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis = shipped("azimuth_1p2m.yaml")
    assert main(["calibrate", str(bag), "--axis", str(axis), "-o", str(tmp_path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "calibration.json").read_text())
    assert printed["accuracy"]["uniform_motion"] > 0.995
    assert printed["torque_scale"]["value"] == pytest.approx(1.03, rel=3e-3)
    control = load_axis(tmp_path / "axis.yaml").control
    assert control is not None
    assert control.observer.torque_scale == printed["torque_scale"]["value"]
    assert (tmp_path / "calibration.png").is_file()
    assert "uniform motion" in (tmp_path / "report.html").read_text()
    assert (
        main(["calibrate", str(bag), "--axis", str(tmp_path / "axis.yaml"), "-o", str(tmp_path / "again")])
        == 0
    )
    again = capsys.readouterr().out
    assert "torque scale" in again
    assert "99." in again.split("before")[1], "a calibrated axis file needs no calibration"


def test_command_names_what_is_missing(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis = shipped("azimuth_1p2m.yaml")
    bare = tmp_path / "bare.yaml"
    save_axis(bare, replace(FILE, signals=None))
    (tmp_path / "file").write_text("")
    for words, message in (
        (
            [str(bag), "--axis", str(axis), "--dynamometer", "/azimuth/gauge", "-o", "x"],
            "no topic /azimuth/gauge",
        ),
        ([str(bag), "--axis", str(axis), "--field", "wrench.torq.z", "-o", "x"], "torque"),
        ([str(bag), "--axis", str(bare), "-o", "x"], "no signals block"),
        ([str(bag), "--axis", str(axis), "-o", str(tmp_path / "file" / "out")], "cannot be written"),
    ):
        assert main(["calibrate", *words]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error


def test_a_calibration_that_is_none_is_refused_by_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A dynamometer that shows something else than the friction."""
    run = moved(Reference(Legs(speed=1.745e-3, leg=4.0, acceleration=5e-3, duration=12.0)))
    times = EPOCH + np.rint(run.t * 1e9).astype(np.int64)
    joint = {"position": run.position, "velocity": run.velocity, "effort": run.torque}
    wrench = {"wrench.torque.z": run.friction + 40.0 * np.sin(2.3 * run.t)}
    topics = [
        joint_states("/azimuth/joint_states", times, {"azimuth": joint}),
        encoded("/azimuth/reference", "tcs_friction_msgs/msg/AxisReference", times, {"position": run.reference}),
        encoded("/azimuth/dynamometer", "geometry_msgs/msg/WrenchStamped", times, wrench),
    ]
    write_bag(tmp_path / "bag", topics)
    words = [str(tmp_path / "bag"), "--axis", str(shipped("azimuth_1p2m.yaml")), "-o", str(tmp_path / "out")]
    assert main(["calibrate", *words]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("tcs-friction: calibration: observer and dynamometer agree to ")
    assert line.endswith("at best, expected at least 90 %")
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_a_worse_agreement_is_refused_and_one_that_is_the_same_is_not(legs: LoopRun) -> None:
    found = calibrate([beside(legs)], CONTROL.observer)
    assert accepted(found) is found
    again = calibrate([beside(legs)], found.observer)
    assert accepted(again) is again, "a calibrated observer may be calibrated again"
    error = 0.05 * np.sqrt(np.mean(found.measured**2))
    worse = replace(found, after=found.measured + error, accuracy=0.95, before=found.measured, accuracy_before=1.0)
    with pytest.raises(JobError, match=r"95\.00 % over everything, worse than the 100\.00 % over everything before"):
        accepted(worse)


def test_mapping_is_whole(legs: LoopRun) -> None:
    found: Calibration = calibrate([beside(legs)], CONTROL.observer)
    assert (
        json.loads(json.dumps(found.to_mapping(), allow_nan=False))["schema"] == "tcs_friction/calibration/1"
    )
