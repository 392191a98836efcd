"""Measured beside simulated: a model that is right fits, one without friction does not, and the residual says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.config import AxisFile, default_control
from tcs_friction.control.loop import LoopConfig, simulate_loop
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.errors import InputError
from tcs_friction.export import compare
from tcs_friction.export.compare import against_fmu, against_model, against_recording
from tcs_friction.export.formats import format_named
from tcs_friction.export.request import Request
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

AXIS = Axis("azimuth", 2.0, instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.5}))
MODEL = """<mujoco><compiler angle="radian"/><option timestep="5e-4" gravity="0 0 0"/><worldbody><body>
<joint name="azimuth" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="2 2 2"/></body></worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def real() -> Recording:
    """The axis under a cautious controller, to and fro."""
    mapping = {"kind": "sinusoid", "amplitude": 0.4, "period": 3.0, "duration": 12.0}
    reference = reference_from_mapping(mapping, "test")
    run = simulate_loop(AXIS, reference, default_control(AXIS).controller, LoopConfig())
    return Recording(run.t, run.position, run.torque, run.velocity, source="real")


def test_a_recording_fits_itself(real: Recording) -> None:
    found = against_recording([real], [real], AXIS)
    assert [one.signal for one in found] == ["position", "velocity", "torque"]
    assert all(one.fit == 100.0 and one.rms == 0.0 and one.white == one.driven == 0.0 for one in found)


def test_a_residual_is_told_by_size_and_place(real: Recording) -> None:
    direction = np.sign(real.velocity if real.velocity is not None else real.position)
    other = replace(real, torque=real.torque - 0.3 * np.convolve(direction, np.ones(9) / 9.0, "same"))
    torque = against_recording([real], [other], AXIS)[2]
    assert torque.rms == pytest.approx(0.3, rel=0.1)
    spread = float(np.std(real.torque))
    assert torque.fit == pytest.approx(100.0 * (1.0 - 0.3 / spread), abs=3.0)
    means = torque.over["velocity"][2]
    assert means[0] == pytest.approx(-0.3, abs=0.03)
    assert means[-1] == pytest.approx(0.3, abs=0.03)
    assert torque.white > 0.5
    assert torque.driven > 0.5
    assert torque.to_mapping()["over"]["velocity"]["mean"] == means


def test_white_noise_is_white(real: Recording) -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.2, len(real.t))
    torque = against_recording([real], [replace(real, torque=real.torque + noise)], AXIS)[2]
    assert torque.white < 0.15
    assert torque.driven < 0.15


@pytest.mark.parametrize(
    ("other", "words"),
    [("none", "0 recordings of a simulation, expected 1"), ("later", "no time in common with the real recording")],
)
def test_recordings_that_do_not_go_together_are_refused(real: Recording, other: str, words: str) -> None:
    simulated = [] if other == "none" else [replace(real, t=real.t + 100.0)]
    with pytest.raises(InputError, match=words):
        against_recording([real], simulated, AXIS)


def test_the_exported_model_is_nearer_than_the_users(real: Recording, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="of the optional set mujoco")
    before, after = tmp_path / "user.xml", tmp_path / "better.xml"
    before.write_text(MODEL)
    exported = format_named("mjcf").export(Request(AXIS, Path("axis.yaml"), after, before, "azimuth"))
    after.write_text(str(exported.files[after]))
    worse, better = (against_model([real], AxisFile(AXIS), path, "", 1.0) for path in (before, after))
    assert [one.signal for one in better] == ["position", "velocity", "torque"]
    for one, other in zip(worse, better, strict=True):
        assert other.fit > max(one.fit, 90.0), other


def test_fmus_are_driven_by_the_torque_or_along_the_motion(real: Recording, tmp_path: Path) -> None:
    pytest.importorskip("fmpy", reason="an importer that is in no set of requirements")
    for kind, signals in (("fmi3-axis", ["position", "velocity"]), ("fmi2-friction", ["torque"])):
        path = tmp_path / f"{kind}.fmu"
        (content,) = format_named("fmu").export(Request(AXIS, Path("a.yaml"), path, kind=kind)).files.values()
        path.write_bytes(content)  # type: ignore[arg-type]
        found = against_fmu([real], AxisFile(AXIS), path)
        assert [one.signal for one in found] == signals
        assert found[-1].fit > 90.0


def test_fmus_that_are_none_are_refused(real: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Package:
        """Stands in for an importer."""

        @staticmethod
        def read_model_description(path: str) -> object:
            if "broken" in path:
                raise ValueError("bad zip")
            return type("Description", (), {"modelVariables": []})()

    monkeypatch.setattr(compare, "_fmpy", lambda: Package)
    with pytest.raises(InputError, match="not read as an FMU"):
        against_fmu([real], AxisFile(AXIS), tmp_path / "broken.fmu")
    with pytest.raises(InputError, match="its variables are no axis"):
        against_fmu([real], AxisFile(AXIS), tmp_path / "other.fmu")


def test_without_an_importer_it_says_how_to_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "fmpy", None)
    with pytest.raises(InputError, match="FMPy: the package is not installed, expected pip install fmpy"):
        compare._fmpy()
