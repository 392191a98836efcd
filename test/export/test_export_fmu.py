"""FMU and Modelica from the same C: called as an importer calls them, equal to the kernels to 1e-9."""

from __future__ import annotations

import ctypes
import io
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from export_axes import axis

from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.errors import InputError, JobError
from tcs_friction.export import fmu
from tcs_friction.export.code import AxisCode
from tcs_friction.export.formats import format_named
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.vectors import Vectors, vectors

OF = axis("lugre", "cogging", "torque_ripple", "wind_torque", "encoder_periodic_error", "temperature_dependent_friction")
PERIOD, OK, ERROR = 1e-3, 0, 3
needs_compiler = pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler here")


def made(kind: str, to: str = "fmu") -> Exported:
    name = "made.fmu" if to == "fmu" else "made.mo"
    return format_named(to).export(Request(OF, Path("axis.yaml"), Path(name), kind=kind, period=PERIOD))


def archive(kind: str) -> zipfile.ZipFile:
    (content,) = made(kind).files.values()
    assert isinstance(content, bytes)
    return zipfile.ZipFile(io.BytesIO(content))


@pytest.fixture(scope="module")
def known() -> Vectors:
    return vectors(AxisCode("made", OF, PERIOD, CancellationConfig()), 300, speed=0.5)


class Importer:
    """An FMU's functions and variables, of either version."""

    def __init__(self, kind: str, folder: Path) -> None:
        with archive(kind) as packed:
            packed.extractall(folder)
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.version = int(root.attrib["fmiVersion"][0])
        variables = (one for one in root.iter() if "valueReference" in one.attrib and "name" in one.attrib)
        self.places = {one.attrib["name"]: int(one.attrib["valueReference"]) for one in variables}
        (library,) = (folder / "binaries").rglob("made.so")
        self.library, prefix = ctypes.CDLL(str(library)), f"fmi{self.version}"
        self.call = lambda name: getattr(self.library, prefix + name)
        make = self.call("InstantiateCoSimulation" if self.version == 3 else "Instantiate")
        make.restype = ctypes.c_void_p
        token = root.attrib["instantiationToken" if self.version == 3 else "guid"].encode()
        rest: tuple[Any, ...] = (False, False, False, False, None, ctypes.c_size_t(0), None, None, None)
        more = (b"i", token, None, *rest) if self.version == 3 else (b"i", 1, token, None, None, False, False)
        self.instance = ctypes.c_void_p(make(*more))
        wrong = (b"i", b"other", *more[2:]) if self.version == 3 else (b"i", 1, b"other", *more[3:])
        assert make(*wrong) is None, "of another model"

    def numbers(self, way: str, names: tuple[str, ...], values: list[float]) -> tuple[int, list[float]]:
        places = (ctypes.c_uint * len(names))(*(self.places[name] for name in names))
        given = (ctypes.c_double * len(names))(*values)
        count = (ctypes.c_size_t(len(names)),) if self.version == 3 else ()
        word = f"{way}{'Float64' if self.version == 3 else 'Real'}"
        return self.call(word)(self.instance, places, ctypes.c_size_t(len(names)), given, *count), list(given)

    def begin(self, **values: float) -> None:
        if self.version == 3:
            self.call("EnterInitializationMode")(
                self.instance, 0, ctypes.c_double(0.0), ctypes.c_double(0.0), 0, ctypes.c_double(0.0)
            )
        else:
            self.call("EnterInitializationMode")(self.instance)
        assert self.numbers("Set", tuple(values), list(values.values()))[0] == OK
        assert self.call("ExitInitializationMode")(self.instance) == OK

    def step(self, time: float, size: float = PERIOD) -> int:
        more = [ctypes.byref(ctypes.c_ubyte()) for _ in range(3)] if self.version == 3 else []
        reached = [ctypes.byref(ctypes.c_double())] if self.version == 3 else []
        return int(self.call("DoStep")(self.instance, ctypes.c_double(time), ctypes.c_double(size), 0, *more, *reached))


@pytest.fixture
def importer(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Importer]:
    made = Importer(request.param, tmp_path)
    yield made
    made.call("FreeInstance").restype = None
    made.call("FreeInstance")(made.instance)


SURROUNDINGS = ("temperature", "signal_wind_speed", "signal_wind_speed_rate")


@needs_compiler
@pytest.mark.parametrize("importer", ["fmi3-axis", "fmi2-axis"], indirect=True)
def test_an_axis_moves_as_the_simulated_one(importer: Importer, known: Vectors) -> None:
    importer.begin(start_position=known.motion[0, 1])
    for k, row in enumerate(known.motion):
        importer.numbers("Set", ("torque", *SURROUNDINGS), [row[4], row[5], *known.signals[k]])
        assert importer.step(row[0]) == OK
        found = importer.numbers("Get", ("position", "velocity", "friction"), [0.0] * 3)[1]
        assert found == pytest.approx(known.moved[k], rel=1e-9, abs=1e-9 * np.abs(known.moved).max())


@needs_compiler
@pytest.mark.parametrize("importer", ["fmi3-friction", "fmi2-friction"], indirect=True)
def test_friction_along_a_motion_is_that_of_the_kernels(importer: Importer, known: Vectors) -> None:
    importer.begin()
    names = ("position", "velocity", "acceleration", "torque", *SURROUNDINGS)
    for k, row in enumerate(known.motion):
        importer.numbers("Set", names, [*row[1:6], *known.signals[k]])
        assert importer.step(row[0]) == OK
        assert importer.numbers("Get", ("friction",), [0.0])[1][0] == pytest.approx(known.friction[k], rel=1e-9, abs=1e-7)


@needs_compiler
@pytest.mark.parametrize("importer", ["fmi3-axis", "fmi2-axis"], indirect=True)
def test_wrong_calls_are_errors_and_a_state_comes_back(importer: Importer) -> None:
    importer.begin(start_position=0.25)
    assert importer.numbers("Set", ("position",), [1.0])[0] == ERROR, "an output"
    assert importer.step(0.0, 1.5 * PERIOD) == ERROR, "no multiple of the period"
    importer.numbers("Set", ("torque",), [900.0])
    state, word = ctypes.c_void_p(), "FMUState" if importer.version == 3 else "FMUstate"
    assert importer.call(f"Get{word}")(importer.instance, ctypes.byref(state)) == OK
    runs = []
    for _ in range(2):
        assert importer.step(0.0, 40 * PERIOD) == OK
        runs.append(importer.numbers("Get", ("position",), [0.0])[1][0])
        importer.call(f"Set{word}")(importer.instance, state)
    importer.call(f"Free{word}")(importer.instance, ctypes.byref(state))
    assert runs[0] == runs[1] > 0.25
    assert importer.call("Reset")(importer.instance) == OK
    assert importer.numbers("Get", ("position",), [1.0])[1] == [0.0]
    assert importer.call("GetDirectionalDerivative")(importer.instance) == ERROR


@pytest.mark.parametrize("kind", ["fmi3-axis", "fmi2-friction"])
def test_an_fmu_has_its_sources_and_the_same_bytes_again(kind: str) -> None:
    names = archive(kind).namelist()
    assert {"modelDescription.xml", "sources/made.c", "sources/made.h", "sources/made_fmu.c"} <= set(names)
    assert ("sources/buildDescription.xml" in names) == kind.startswith("fmi3")
    assert made(kind).files == made(kind).files


@pytest.mark.parametrize("kind", ["fmi3-axis", "fmi3-friction", "fmi2-axis", "fmi2-friction"])
def test_fmpy_finds_no_problem(kind: str, tmp_path: Path, known: Vectors) -> None:
    fmpy = pytest.importorskip("fmpy", reason="an importer that is in no set of requirements")
    from fmpy.validation import validate_fmu

    (content,) = made(kind).files.values()
    path = tmp_path / "made.fmu"
    path.write_bytes(content)  # type: ignore[arg-type]
    assert validate_fmu(str(path)) == []
    if kind.endswith("axis"):
        names = ("torque", "temperature")
        series = np.array(
            [tuple(row) for row in known.motion[:, [0, 4, 5]]], dtype=[(name, float) for name in ("time", *names)]
        )
        found = fmpy.simulate_fmu(str(path), input=series, stop_time=0.05, step_size=PERIOD, output_interval=PERIOD)
        assert np.isfinite(found["position"]).all()


def test_without_a_compiler_it_holds_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu, "COMPILERS", ("no-such-compiler",))
    assert not any(name.startswith("binaries") for name in archive("fmi3-axis").namelist())
    assert made("fmi3-axis").lines[0].startswith("no C compiler here")


def test_a_compiler_that_refuses_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu, "COMPILERS", ("false",))
    with pytest.raises(JobError, match="does not compile the FMU"):
        made("fmi3-axis")


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(InputError, match="no kind 'fmi1' of fmu, expected one of fmi3-axis"):
        made("fmi1")


@needs_compiler
def test_modelica_includes_what_it_calls(tmp_path: Path) -> None:
    found = format_named("modelica").export(Request(OF, Path("axis.yaml"), tmp_path / "made.mo", period=PERIOD))
    for path, text in found.files.items():
        path.write_text(str(text))
    package = (tmp_path / "Made.mo").read_text()
    glue = (tmp_path / "made_modelica.h").read_text()
    for word in re.findall(r'external "C" (?:\w+ = )?(\w+)\(', package):
        assert f" {word}(" in glue or f"*{word}(" in glue
    for name, count in re.findall(r"(made_\w+_next)\(([^)]*)\)", package):
        declared = re.findall(rf"{name}\(([^)]*)\)", glue)[0]
        assert len(count.split(",")) == len(declared.split(","))
    assert package.count("algorithm") == package.count("end when;") == 2
    (tmp_path / "main.c").write_text("""#include "made_modelica.h"
int main(void) {
    void *axis = made_axis_new(0.5), *friction = made_friction_new();
    double out[6] = {0.0}, torque = 0.0; int k;
    for (k = 0; k < 50; k++) {
        made_axis_next(axis, 1e-3 * k, 1.0, 20.0, 0.0, 0.0, out, out + 1, out + 2, out + 3, out + 4, out + 5);
        made_friction_next(friction, 1e-3 * k, 5e-4 * k, 0.5, 0.0, 0.0, 20.0, 0.0, 0.0, &torque);
    }
    made_axis_free(axis); made_friction_free(friction);
    return (torque > 30.0 && out[0] > 0.4) ? 0 : 1;
}
""")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined"]
    subprocess.run(["cc", *flags, "main.c", "-lm", "-o", "main"], cwd=tmp_path, check=True, timeout=100)
    assert subprocess.run(["./main"], cwd=tmp_path, check=False, timeout=100).returncode == 0


def test_what_a_block_wants_is_said() -> None:
    lines = made("", "modelica").lines
    assert lines[0] == "sampled every 0.001 s: between two samples torque and motion are held"
    assert any("wants wind_speed" in line for line in lines)
