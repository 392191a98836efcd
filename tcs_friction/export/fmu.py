"""FMU for co-simulation, FMI 3.0 or 2.0, from the C code: the whole axis, or its friction along a motion.

Its sources are in it. With a C compiler here, so is the binary of this machine; without one an importer has to compile it.
"""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from tcs_friction.errors import JobError
from tcs_friction.export import c
from tcs_friction.export.code import AxisCode, identifier
from tcs_friction.export.fmu_code import Block, Variable, block_of, glue
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.telling import in_newton_metres

COMPILERS = ("cc", "gcc", "clang")
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # of every file in it: the same axis gives the same bytes


def export(request: Request) -> Exported:
    """One file, --kind fmi3-axis, fmi3-friction, fmi2-axis or fmi2-friction."""
    in_newton_metres(request, "an FMU")
    version, _, kind = (request.kind or "fmi3-axis").partition("-")
    number = int(version[-1])
    name = identifier(request.output.stem)
    code = AxisCode(name, request.axis, request.period, request.compensation)
    block = block_of(code, kind)
    sources = {f"{name}.h": c.header(code), f"{name}.c": c.source(code)}
    digest = hashlib.sha256("".join([*sources.values(), version, kind]).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16])}}}"
    sources[f"{name}_fmu.c"] = glue(code, block, number, token)
    binary, line = _compiled(name, sources)
    units = [name for name in sources if name.endswith(".c")]
    entries: dict[str, bytes] = {"modelDescription.xml": _description(code, block, number, token, units).encode()}
    entries |= {f"sources/{file}": text.encode() for file, text in sources.items()}
    if number == 3:
        entries["sources/buildDescription.xml"] = _build(name, units).encode()
    if binary is not None:
        entries[f"binaries/{_place(number)}/{name}{_suffix()}"] = binary
    shown = ", ".join(variable.name for variable in block.variables)
    steps = f"in periods of {request.period:g} s; an importer's step is a multiple of them"
    lines = [line, f"FMI {number}.0 co-simulation of the {kind} {steps}", f"variables: {shown}", *c.said(request)]
    return Exported({request.output: _zipped(entries)}, lines)


def _compiled(name: str, sources: Mapping[str, str]) -> tuple[bytes | None, str]:
    """The shared library of this machine, None without a compiler; and what is said of it."""
    compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
    if compiler is None:
        return None, "no C compiler here (cc, gcc, clang): it holds sources only, which an importer has to compile"
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text)
        library = f"{name}{_suffix()}"
        units = [file for file in sources if file.endswith(".c")]
        command = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-o", library, *units, "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise JobError(compiler, f"does not compile the FMU: {done.stderr.strip()[:500]}")
        return Path(folder, library).read_bytes(), f"compiled by {compiler} for {_place(3)}"


def _suffix() -> str:
    return {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")


def _place(version: int) -> str:
    """The folder of this machine's binary."""
    system = {"darwin": "darwin", "win32": "windows"}.get(sys.platform, "linux")
    machine = platform.machine().lower()
    arch = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{arch}-{system}" if version == 3 else {"windows": "win64"}.get(system, f"{system}64")


def _zipped(entries: Mapping[str, bytes]) -> bytes:
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(zipfile.ZipInfo(name, LONG_AGO), content, zipfile.ZIP_DEFLATED)
    return memory.getvalue()


def _build(name: str, units: list[str]) -> str:
    files = "".join(f'<SourceFile name="{unit}"/>' for unit in units)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">'
        f'<BuildConfiguration modelIdentifier="{name}">'
        f'<SourceFileSet language="C99">{files}</SourceFileSet></BuildConfiguration></fmiBuildDescription>\n'
    )


def _description(code: AxisCode, block: Block, version: int, token: str, units: list[str]) -> str:
    variables = "\n".join(_variable(k, one, version) for k, one in enumerate(block.variables, 1))
    outputs = [k for k, one in enumerate(block.variables, 1) if one.causality == "output"]
    step = f'stepSize="{code.period!r}"'
    named, described = quoteattr(f"{code.axis.name} {block.kind}"), quoteattr(c.heading(code))
    head = f'modelName={named} description={described} generationTool="tcs-friction"'
    can = f'modelIdentifier="{code.name}" canHandleVariableCommunicationStepSize="true"'
    if version == 3:
        time = '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>\n'
        structure = "".join(f'<{tag} valueReference="{k}"/>' for tag in ("Output", "InitialUnknown") for k in outputs)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" {head} instantiationToken="{token}">
  <CoSimulation {can} canGetAndSetFMUState="true" fixedInternalStepSize="{code.period!r}"/>
  <DefaultExperiment startTime="0" {step}/>
  <ModelVariables>
{time}{variables}
  </ModelVariables>
  <ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>
"""
    files = "".join(f'<File name="{unit}"/>' for unit in units)
    unknown = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" {head} guid="{token}">
  <CoSimulation {can} canGetAndSetFMUstate="true"><SourceFiles>{files}</SourceFiles></CoSimulation>
  <DefaultExperiment startTime="0" {step}/>
  <ModelVariables>
{variables}
  </ModelVariables>
  <ModelStructure><Outputs>{unknown}</Outputs><InitialUnknowns>{unknown}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def _variable(place: int, one: Variable, version: int) -> str:
    variability = "fixed" if one.causality == "parameter" else "continuous"
    said = f'name="{one.name}" valueReference="{place}" causality="{one.causality}" variability="{variability}"'
    said += f' description="{one.unit}"' if one.unit else ""
    start = "" if one.causality == "output" else f' start="{one.start!r}"'
    initial = ' initial="calculated"' if one.causality == "output" else ""
    if version == 3:
        return f"    <Float64 {said}{initial}{start}/>"
    return f"    <ScalarVariable {said}{initial}><Real{start}/></ScalarVariable>"
