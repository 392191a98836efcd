"""C99: a header, a source and a main with test vectors; the same as a C++ class with a controller for ros2_control."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tcs_friction.control.model_compensator import obstacles
from tcs_friction.export import cpp
from tcs_friction.export.code import AxisCode, identifier, plain
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.vectors import vectors
from tcs_friction.physics.axis import Sensors
from tcs_friction.physics.terms import Place


def export(request: Request) -> Exported:
    """NAME.c, NAME.h, NAME_test.c, NAME.hpp and NAME_controller.cpp beside -o NAME.c."""
    name = identifier(request.output.stem)
    code = AxisCode(name, request.axis, request.period, request.compensation)
    folder = request.output.parent
    files = {
        folder / f"{name}.h": header(code),
        folder / f"{name}.c": source(code),
        folder / f"{name}_test.c": check(code, request.speed),
        folder / f"{name}.hpp": cpp.header(code),
        folder / f"{name}_controller.cpp": cpp.controller(code, request.joint),
    }
    return Exported(files, [*said(request), *said_of_compensator(request)])


def said(request: Request) -> Iterable[str]:
    """What friction and axis in motion have, and of each effect what they have not."""
    yield f"friction law and every effect as in the axis file, for a period of {request.period:g} s (--period)"
    for item in request.axis.effects:
        if item.signals or item.thermal:
            needed = [*(["temperature"] if item.thermal else []), *item.signals]
            yield f"{item.words}: wants {' and '.join(needed)} at every step"
    if request.axis.drive.noise or request.axis.sensors != Sensors():
        yield "noise and resolution of drive and encoder: left out of the axis in motion"


def said_of_compensator(request: Request) -> Iterable[str]:
    """The same of the compensator, and of single precision."""
    for name, why in obstacles(request.axis).items():
        yield f"{name}: not in the compensator ({why}); in friction and motion as in the axis file"
    for item in request.axis.effects:
        if item.term.place is Place.SENSOR:
            yield f"{item.words}: not in the compensator, it is the encoder's; in the measured position of the axis in motion"
    yield "float: positions within a few turns, for cogging of order 100 loses a digit in ten; the axis in motion is for double"


def heading(code: AxisCode) -> str:
    axis = code.axis
    effects = ", ".join(plain(item.words) for item in axis.effects) or "no effects"
    return f"{plain(axis.name)}: {axis.friction.term.words}, {effects}. Made by tcs-friction."


def header(code: AxisCode) -> str:
    """Types and functions."""
    guard, declared = f"{code.name.upper()}_H", []
    for head, (_, _, what) in code.declared().items():
        declared += [f"/* {what} */", f"{head};".replace("real ", f"{code.name}_real "), ""]
    structures = code.structures().replace("real ", f"{code.name}_real ")
    return f"""/* {heading(code)}
   C99, no heap, no globals that change. SI units ({code.axis.kind} axis). Control period: {code.period:g} s.
   Define {code.name.upper()}_FLOAT for single precision. */
#ifndef {guard}
#define {guard}

#ifdef {code.name.upper()}_FLOAT
typedef float {code.name}_real;
#else
typedef double {code.name}_real;
#endif

{structures}

{chr(10).join(declared)}#endif
"""


def source(code: AxisCode) -> str:
    """The functions."""
    return f"""/* {heading(code)} */
#include "{code.name}.h"

#include <math.h>

typedef {code.name}_real real;
#define REAL(value) ((real)(value))
#ifdef {code.name.upper()}_FLOAT
#define MATH(function) function##f
#else
#define MATH(function) function
#endif

{code.body()}"""


def check(code: AxisCode, speed: float, count: int = 400) -> str:
    """A main that runs test vectors and returns 0 where they are met."""
    known, name = vectors(code, count, speed=speed), code.name
    signals = code.signals
    moved = known.moved
    columns = np.column_stack([known.motion, known.signals, known.friction, known.compensation, moved])
    rows = ",\n".join("    {" + ", ".join(repr(float(x)) for x in row) + "}" for row in columns)
    first = 6 + known.signals.shape[1]
    passed = ", signals" if signals else ""
    copied = f"""
        {name}_real signals[{2 * len(signals)}];
        for (j = 0; j < {2 * len(signals)}; j++) {{ signals[j] = ({name}_real)VECTORS[k][6 + j]; }}"""
    copied = copied if signals else ""
    return f"""/* Checks {name}.c against the kernels it was made from: a random motion up to {speed:g} {code.axis.unit("rad/s")}.
   cc -std=c99 {name}.c {name}_test.c -lm && ./a.out
   Columns: t, position, speed, acceleration, torque, temperature{", signals" if signals else ""}; friction, compensation;
   position, speed and friction under that torque. */
#include "{name}.h"

#include <math.h>
#include <stdio.h>

#define ROWS {count}
#define FIRST {first}

#ifdef {name.upper()}_FLOAT
#define TOLERANCE 1e-4
#define CHECKED 2  /* an integrated motion loses more digits than that in float */
#define FEW (ROWS / 100)  /* a law that jumps may jump a step earlier or later */
#else
#define TOLERANCE 1e-9
#define CHECKED 5
#define FEW 0
#endif

static const double VECTORS[ROWS][FIRST + 5] = {{
{rows}
}};

int main(void)
{{
    static const char *const words[5] = {{"friction", "compensation", "position", "speed", "friction in motion"}};
    {name}_friction friction;
    {name}_compensator compensator;
    {name}_axis axis;
    double worst[5] = {{0.0, 0.0, 0.0, 0.0, 0.0}};
    double largest[5] = {{0.0, 0.0, 0.0, 0.0, 0.0}};
    int off[5] = {{0, 0, 0, 0, 0}};
    int failed = 0;
    int j;
    int k;
    for (k = 0; k < ROWS; k++) {{
        for (j = 0; j < 5; j++) {{ largest[j] = fmax(largest[j], fabs(VECTORS[k][FIRST + j])); }}
    }}
    {name}_friction_start(&friction);
    {name}_compensator_start(&compensator);
    {name}_axis_start(&axis, ({name}_real)VECTORS[0][1]);
    for (k = 0; k < ROWS; k++) {{
        const double *row = VECTORS[k];
        const {name}_real t = ({name}_real)row[0], q = ({name}_real)row[1];
        const {name}_real v = ({name}_real)row[2], a = ({name}_real)row[3];
        const {name}_real torque = ({name}_real)row[4], temperature = ({name}_real)row[5];
        double found[5];{copied}
        found[0] = (double){name}_friction_step(&friction, t, q, v, a, torque, temperature{passed});
        found[1] = (double){name}_compensator_step(&compensator, t, q, v, a, temperature{passed});
        {name}_axis_step(&axis, torque, temperature{passed});
        found[2] = (double)axis.position;
        found[3] = (double)axis.velocity;
        found[4] = (double)axis.friction;
        for (j = 0; j < 5; j++) {{
            const double error = fabs(found[j] - row[FIRST + j]);
            worst[j] = fmax(worst[j], error);
            off[j] += (error <= (TOLERANCE * largest[j])) ? 0 : 1;
        }}
    }}
    for (j = 0; j < CHECKED; j++) {{
        const double error = (largest[j] > 0.0) ? (worst[j] / largest[j]) : worst[j];
        const int good = (off[j] <= FEW);
        printf("%s: %.2g of the largest%s\\n", words[j], error, (good != 0) ? "" : ", too much");
        failed += (good != 0) ? 0 : 1;
    }}
    return failed;
}}
"""
