"""The C file between an axis' code and an importer of FMUs: the functions of FMI 3.0 and 2.0 for co-simulation."""

# ruff: noqa: E501 the declarations of the standard stand on one line each

from __future__ import annotations

from dataclasses import dataclass

from tcs_friction.export.code import AxisCode, identifier


@dataclass(frozen=True)
class Variable:
    """A number that an importer sets or reads. value: in C, of the instance `self`."""

    name: str
    causality: str
    unit: str
    start: float = 0.0
    value: str = ""


@dataclass(frozen=True)
class Block:
    """What an FMU is: its variables, how it begins and what a period does, in C."""

    kind: str
    variables: tuple[Variable, ...]
    begin: str
    step: str


def block_of(code: AxisCode, kind: str) -> Block:
    """The whole axis ("axis") or its friction along a motion ("friction")."""
    name, unit = code.name, code.axis.unit
    position, speed, torque = unit("rad"), unit("rad/s"), unit("N m")
    surroundings = [Variable("temperature", "input", "degC", 20.0)]
    for signal in code.signals:
        surroundings += [Variable(f"signal_{identifier(signal)}", "input", "1"), Variable(f"signal_{identifier(signal)}_rate", "input", "1/s")]
    first = {"axis": 3, "friction": 6}[kind]  # of the signals among the values
    passed = f", &self->values[{first}]" if code.signals else ""
    if kind == "axis":
        inputs = [Variable("torque", "input", torque), *surroundings]
        out = [("position", position), ("velocity", speed), ("acceleration", unit("rad/s^2")), ("friction", torque),
               ("others", torque), ("measured", position)]  # fmt: skip
        outputs = [Variable(word, "output", one, value=f"self->state.{word}") for word, one in out]
        parameter = [Variable("start_position", "parameter", position)]
        start = len(inputs) + 1
        begin = f"{name}_axis_start(&self->state, self->values[{start}]);"
        step = f"{name}_axis_step(&self->state, self->values[1], self->values[2]{passed});"
        return Block("axis", (*inputs, *parameter, *outputs), begin, step)
    motion = (("position", position), ("velocity", speed), ("acceleration", unit("rad/s^2")), ("torque", torque))
    inputs = [*(Variable(word, "input", one) for word, one in motion), *surroundings]
    outputs = [Variable("friction", "output", torque, value="self->torque")]
    values = ", ".join(f"self->values[{k}]" for k in range(1, 6))
    step = f"self->torque = {name}_friction_step(&self->state, self->time, {values}{passed});"
    return Block("friction", (*inputs, *outputs), f"{name}_friction_start(&self->state); self->torque = 0.0;", step)


def glue(code: AxisCode, block: Block, version: int, token: str) -> str:
    """The C file."""
    count = len(block.variables) + 1
    starts = ", ".join(repr(variable.start) for variable in block.variables)
    outputs = "\n".join(
        f"    self->values[{k}] = {variable.value};"
        for k, variable in enumerate(block.variables, 1)
        if variable.causality == "output"
    )
    writable = ", ".join("0" if v.causality == "output" else "1" for v in block.variables)
    return COMMON.format(
        name=code.name, kind=block.kind, count=count, starts=starts, outputs=outputs, writable=writable, begin=block.begin,
        step=block.step, period=repr(code.period), token=token,
    ) + (FMI3 if version == 3 else FMI2) + _absent(version)  # fmt: skip


def _absent(version: int) -> str:
    """The rest of the standard's functions, which some importers look for: each returns an error, or no instance."""
    errors = [
        f"FMI_EXPORT int fmi{version}{name}(void) {{ return FMI_ERROR; }}"
        for name in (ABSENT3 if version == 3 else ABSENT2).split()
    ]
    none = ("ModelExchange", "ScheduledExecution") if version == 3 else ()
    return "\n".join(["", *errors, *(f"FMI_EXPORT void *fmi3Instantiate{name}(void) {{ return NULL; }}" for name in none), ""])


ABSENT3 = """
ActivateModelPartition CompletedIntegratorStep DeserializeFMUState EnterConfigurationMode EnterContinuousTimeMode
EnterEventMode EvaluateDiscreteStates ExitConfigurationMode GetAdjointDerivative GetBinary GetClock
GetContinuousStateDerivatives GetContinuousStates GetDirectionalDerivative GetEventIndicators GetIntervalDecimal
GetIntervalFraction GetNominalsOfContinuousStates GetNumberOfContinuousStates GetNumberOfEventIndicators
GetNumberOfVariableDependencies GetOutputDerivatives GetShiftDecimal GetShiftFraction GetVariableDependencies
SerializeFMUState SerializedFMUStateSize SetBinary SetClock SetContinuousStates SetIntervalDecimal SetIntervalFraction
SetShiftDecimal SetShiftFraction SetTime UpdateDiscreteStates
"""
ABSENT2 = """
CompletedIntegratorStep DeSerializeFMUstate EnterContinuousTimeMode EnterEventMode GetBooleanStatus GetContinuousStates
GetDerivatives GetDirectionalDerivative GetEventIndicators GetIntegerStatus GetNominalsOfContinuousStates
GetRealOutputDerivatives GetRealStatus GetStatus GetStringStatus NewDiscreteStates SerializeFMUstate
SerializedFMUstateSize SetContinuousStates SetRealInputDerivatives SetTime
"""

COMMON = """#include "{name}.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define FMI_EXPORT __declspec(dllexport)
#else
#define FMI_EXPORT
#endif
#define PERIOD {period}
#define COUNT {count}
#define TOKEN "{token}"
enum {{ FMI_OK = 0, FMI_ERROR = 3 }};

typedef struct {{
    {name}_{kind} state;
    double torque;
    double time;
    double values[COUNT];
}} Instance;

static const double STARTS[COUNT] = {{0.0, {starts}}};
static const int WRITABLE[COUNT] = {{0, {writable}}};

static void publish(Instance *self)
{{
    self->values[0] = self->time;
{outputs}
}}

static void begin(Instance *self)
{{
    {begin}
    publish(self);
}}

static Instance *make(const char *token)
{{
    Instance *self = (strcmp(token, TOKEN) == 0) ? (Instance *)calloc(1, sizeof(Instance)) : NULL;
    if (self != NULL) {{
        memcpy(self->values, STARTS, sizeof(STARTS));
        begin(self);
    }}
    return self;
}}

static int get(Instance *self, const unsigned int places[], size_t n, double values[])
{{
    size_t k;
    for (k = 0; k < n; k++) {{
        if (places[k] >= COUNT) {{ return FMI_ERROR; }}
        values[k] = self->values[places[k]];
    }}
    return FMI_OK;
}}

static int set(Instance *self, const unsigned int places[], size_t n, const double values[])
{{
    size_t k;
    for (k = 0; k < n; k++) {{
        if ((places[k] >= COUNT) || (WRITABLE[places[k]] == 0)) {{ return FMI_ERROR; }}
        self->values[places[k]] = values[k];
    }}
    return FMI_OK;
}}

/* Periods of the code, as many as the step of the importer has: it has to be a multiple of them. */
static int step(Instance *self, double time, double size)
{{
    const double periods = floor((size / PERIOD) + 0.5);
    double k;
    if ((periods < 1.0) || (fabs(size - (periods * PERIOD)) > (1e-6 * size))) {{ return FMI_ERROR; }}
    self->time = time;
    for (k = 0.0; k < periods; k += 1.0) {{
        {step}
        self->time = time + ((k + 1.0) * PERIOD);
    }}
    self->time = time + size;
    publish(self);
    return FMI_OK;
}}

static void *copy(const void *state)
{{
    void *other = malloc(sizeof(Instance));
    if (other != NULL) {{ memcpy(other, state, sizeof(Instance)); }}
    return other;
}}

static int reset(Instance *self)
{{
    memset(self, 0, sizeof(*self));
    memcpy(self->values, STARTS, sizeof(STARTS));
    begin(self);
    return FMI_OK;
}}
"""

FMI2 = """
typedef void *fmi2Component;
typedef unsigned int fmi2ValueReference;
#define C fmi2Component c
#define NONE(type, word) \\
    FMI_EXPORT int fmi2Get##word(C, const fmi2ValueReference r[], size_t n, type v[]) { (void)c; (void)r; (void)v; return n ? FMI_ERROR : FMI_OK; } \\
    FMI_EXPORT int fmi2Set##word(C, const fmi2ValueReference r[], size_t n, const type v[]) { (void)c; (void)r; (void)v; return n ? FMI_ERROR : FMI_OK; }

FMI_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
FMI_EXPORT int fmi2SetDebugLogging(C, int on, size_t n, const char *const words[]) { (void)c; (void)on; (void)n; (void)words; return FMI_OK; }
FMI_EXPORT fmi2Component fmi2Instantiate(const char *name, int type, const char *token, const char *where, const void *functions, int visible, int logging)
{
    (void)name; (void)where; (void)functions; (void)visible; (void)logging;
    return (type == 1) ? make(token) : NULL;
}
FMI_EXPORT void fmi2FreeInstance(C) { free(c); }
FMI_EXPORT int fmi2SetupExperiment(C, int tolerant, double tolerance, double start, int ends, double end)
{
    (void)tolerant; (void)tolerance; (void)ends; (void)end;
    ((Instance *)c)->time = start;
    return FMI_OK;
}
FMI_EXPORT int fmi2EnterInitializationMode(C) { (void)c; return FMI_OK; }
FMI_EXPORT int fmi2ExitInitializationMode(C) { begin((Instance *)c); return FMI_OK; }
FMI_EXPORT int fmi2Terminate(C) { (void)c; return FMI_OK; }
FMI_EXPORT int fmi2Reset(C) { return reset((Instance *)c); }
FMI_EXPORT int fmi2GetReal(C, const fmi2ValueReference r[], size_t n, double v[]) { return get((Instance *)c, r, n, v); }
FMI_EXPORT int fmi2SetReal(C, const fmi2ValueReference r[], size_t n, const double v[]) { return set((Instance *)c, r, n, v); }
NONE(int, Integer)
NONE(int, Boolean)
NONE(char *, String)
FMI_EXPORT int fmi2GetFMUstate(C, void **state) { *state = copy(c); return (*state != NULL) ? FMI_OK : FMI_ERROR; }
FMI_EXPORT int fmi2SetFMUstate(C, void *state) { memcpy(c, state, sizeof(Instance)); return FMI_OK; }
FMI_EXPORT int fmi2FreeFMUstate(C, void **state) { (void)c; free(*state); *state = NULL; return FMI_OK; }
FMI_EXPORT int fmi2DoStep(C, double time, double size, int kept) { (void)kept; return step((Instance *)c, time, size); }
FMI_EXPORT int fmi2CancelStep(C) { (void)c; return FMI_ERROR; }
"""

FMI3 = """
typedef void *fmi3Instance;
typedef uint32_t fmi3ValueReference;
#define C fmi3Instance c
#define NONE(type, word) \\
    FMI_EXPORT int fmi3Get##word(C, const fmi3ValueReference r[], size_t n, type v[], size_t m) { (void)c; (void)r; (void)v; (void)m; return n ? FMI_ERROR : FMI_OK; } \\
    FMI_EXPORT int fmi3Set##word(C, const fmi3ValueReference r[], size_t n, const type v[], size_t m) { (void)c; (void)r; (void)v; (void)m; return n ? FMI_ERROR : FMI_OK; }

FMI_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
FMI_EXPORT int fmi3SetDebugLogging(C, int on, size_t n, const char *const words[]) { (void)c; (void)on; (void)n; (void)words; return FMI_OK; }
FMI_EXPORT fmi3Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, int visible, int logging, int events,
    int early, const fmi3ValueReference needed[], size_t n, void *environment, const void *log, const void *update)
{
    (void)name; (void)where; (void)visible; (void)logging; (void)early; (void)needed; (void)environment; (void)log; (void)update;
    return ((events == 0) && (n == 0)) ? make(token) : NULL;
}
FMI_EXPORT void fmi3FreeInstance(C) { free(c); }
FMI_EXPORT int fmi3EnterInitializationMode(C, int tolerant, double tolerance, double start, int ends, double end)
{
    (void)tolerant; (void)tolerance; (void)ends; (void)end;
    ((Instance *)c)->time = start;
    return FMI_OK;
}
FMI_EXPORT int fmi3ExitInitializationMode(C) { begin((Instance *)c); return FMI_OK; }
FMI_EXPORT int fmi3Terminate(C) { (void)c; return FMI_OK; }
FMI_EXPORT int fmi3Reset(C) { return reset((Instance *)c); }
FMI_EXPORT int fmi3GetFloat64(C, const fmi3ValueReference r[], size_t n, double v[], size_t m) { (void)m; return get((Instance *)c, r, n, v); }
FMI_EXPORT int fmi3SetFloat64(C, const fmi3ValueReference r[], size_t n, const double v[], size_t m) { (void)m; return set((Instance *)c, r, n, v); }
NONE(float, Float32)
NONE(int8_t, Int8)
NONE(uint8_t, UInt8)
NONE(int16_t, Int16)
NONE(uint16_t, UInt16)
NONE(int32_t, Int32)
NONE(uint32_t, UInt32)
NONE(int64_t, Int64)
NONE(uint64_t, UInt64)
NONE(unsigned char, Boolean)
NONE(char *, String)
FMI_EXPORT int fmi3GetFMUState(C, void **state) { *state = copy(c); return (*state != NULL) ? FMI_OK : FMI_ERROR; }
FMI_EXPORT int fmi3SetFMUState(C, void *state) { memcpy(c, state, sizeof(Instance)); return FMI_OK; }
FMI_EXPORT int fmi3FreeFMUState(C, void **state) { (void)c; free(*state); *state = NULL; return FMI_OK; }
FMI_EXPORT int fmi3EnterStepMode(C) { (void)c; return FMI_ERROR; }
FMI_EXPORT int fmi3DoStep(C, double time, double size, unsigned char kept, unsigned char *events, unsigned char *end, unsigned char *early, double *reached)
{
    const int result = step((Instance *)c, time, size);
    (void)kept;
    *events = 0;
    *end = 0;
    *early = 0;
    *reached = ((Instance *)c)->time;
    return result;
}
"""
