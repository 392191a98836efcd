"""Modelica: a block of the friction and one of the axis in motion, sampled, around the C code.

NAME.mo lies beside NAME.h, NAME.c and NAME_modelica.h, which a tool includes; the package needs no library.
"""

from __future__ import annotations

from tcs_friction.export import c
from tcs_friction.export.code import AxisCode, identifier
from tcs_friction.export.fmu_code import Variable, block_of
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.telling import in_newton_metres


def export(request: Request) -> Exported:
    """The package and what it includes."""
    in_newton_metres(request, "Modelica")
    name = identifier(request.output.stem)
    code = AxisCode(name, request.axis, request.period, request.compensation)
    folder, package = request.output.parent, name.capitalize()
    files = {
        folder / f"{package}.mo": model(code, package),
        folder / f"{name}_modelica.h": glue(code),
        folder / f"{name}.h": c.header(code),
        folder / f"{name}.c": c.source(code),
    }
    lines = [f"sampled every {request.period:g} s: between two samples torque and motion are held"]
    return Exported(files, [*lines, *c.said(request)])


def glue(code: AxisCode) -> str:
    """Makes, frees and steps the states for Modelica's external objects."""
    parts = [f"/* For {code.name.capitalize()}.mo. */", "#include <stdlib.h>", f'#include "{code.name}.c"', ""]
    for kind in ("friction", "axis"):
        block, state = block_of(code, kind), f"{code.name}_{kind}"
        inputs = [one for one in block.variables if one.causality == "input"]
        outputs = [one for one in block.variables if one.causality == "output"]
        start = "double position" if kind == "axis" else "void"
        begun = f"{state}_start(self{', position' if kind == 'axis' else ''});"
        signals = [one.name for one in inputs if one.name not in FIXED]
        copied = [f"    const double signals[{len(signals)}] = {{{', '.join(signals)}}};"] if signals else []
        taken = "".join(f", {one.name}" for one in inputs if one.name in FIXED) + (", signals" if signals else "")
        arguments = "".join(f", double {one.name}" for one in inputs)
        if kind == "friction":
            results, step = "double *result", f"*result = {state}_step((({state} *)self), time{taken});"
        else:
            results = ", ".join(f"double *out_{one.name}" for one in outputs)
            values = " ".join(f"*out_{one.name} = (({state} *)self)->{one.name};" for one in outputs)
            step = f"(void)time; {state}_step((({state} *)self){taken}); {values}"
        parts += [
            f"static void *{state}_new({start})", "{",
            f"    {state} *self = ({state} *)malloc(sizeof({state}));",
            f"    if (self != NULL) {{ {begun} }}", "    return self;", "}", "",
            f"static void {state}_free(void *self) {{ free(self); }}", "",
            f"static void {state}_next(void *self, double time{arguments}, {results})", "{", *copied, f"    {step}", "}", "",
        ]  # fmt: skip
    return "\n".join(parts)


FIXED = ("position", "velocity", "acceleration", "torque", "temperature")


def model(code: AxisCode, package: str) -> str:
    """The package."""
    blocks = "\n".join(_block(code, package, kind) for kind in ("friction", "axis"))
    return f'package {package} "{c.heading(code)}"\n{blocks}\nend {package};\n'


def _block(code: AxisCode, package: str, kind: str) -> str:
    block, state = block_of(code, kind), f"{code.name}_{kind}"
    inputs = [one for one in block.variables if one.causality == "input"]
    outputs = [one for one in block.variables if one.causality == "output"]
    include = f'annotation(Include="#include \\"{code.name}_modelica.h\\"", IncludeDirectory="modelica://{package}")'
    word, start = kind.capitalize(), kind == "axis"
    results = [Variable("result", "output", outputs[0].unit)] if kind == "friction" else outputs
    given = ", ".join(one.name for one in inputs)
    called = ", ".join(f"{'' if kind == 'friction' else 'out_'}{one.name}" for one in results)
    received = ", ".join(one.name for one in outputs)
    return f"""
  class {word}State "Memory of the {kind}"
    extends ExternalObject;
    function constructor
{"      input Real start_position;" if start else ""}
      output {word}State state;
      external "C" state = {state}_new({"start_position" if start else ""}) {include};
    end constructor;
    function destructor
      input {word}State state;
      external "C" {state}_free(state) {include};
    end destructor;
  end {word}State;

  impure function {kind}Step "A period of {code.period:g} s"
    input {word}State state;
    input Real t;
{_declared(inputs, "    input Real")}
{chr(10).join(f"    output Real {name.strip()};" for name in called.split(","))}
    external "C" {state}_next(state, t, {given}, {called}) {include};
  end {kind}Step;

  block {word} "Sampled every {code.period:g} s"
{_declared(inputs, "    input Real")}
{_declared(outputs, "    discrete output Real")}
{"    parameter Real start_position = 0;" if start else ""}
  protected
    {word}State state = {word}State({"start_position" if start else ""});
  algorithm
    when sample(0, {code.period!r}) then
      {f"({received})" if len(outputs) > 1 else received} := {kind}Step(state, time, {given});
    end when;
  end {word};"""


def _declared(variables: list[Variable], before: str) -> str:
    return "\n".join(f'{before} {one.name} "{one.unit}";' for one in variables)
