"""An axis in C99: its friction and effects, their compensation, and its motion, put together from translated kernels.

Each step is what `physics.machine` and `control.model_compensator` do, with the calls of their loops written out one by one.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from tcs_friction.control.model_compensator import AT_REST, CancellationConfig, ModelCompensator, signals_of
from tcs_friction.export.translate import SLOTS, Library, number
from tcs_friction.physics.axis import Axis, Sensors
from tcs_friction.physics.machine import (
    MASS,
    PHASE_PER_UNIT,
    STEP,
    SUBSTEPS,
    TORQUE_LIMIT,
    Machine,
    arrest_per_speed,
    build,
)
from tcs_friction.physics.motion import EXOGENOUS, PER_SIGNAL
from tcs_friction.physics.simulate import substeps_for
from tcs_friction.physics.terms import Instance, Place

RESISTING = (Place.SCALE, Place.LAW, Place.OPPOSING, Place.BODY)
INPUTS = "real t, real position, real velocity, real acceleration"


def identifier(text: str) -> str:
    """A name as C has it.

    >>> identifier("Joint 1-left")
    'joint_1_left'
    """
    word = re.sub(r"\W+", "_", text.lower(), flags=re.ASCII).strip("_")
    return word if word and not word[0].isdigit() else f"axis_{word}".rstrip("_")


def plain(text: str) -> str:
    """A name from elsewhere as a comment or a text in code can hold it.

    >>> plain("azimuth */ (left)")
    'azimuth __ (left)'
    """
    return re.sub(r"[^\w .:/()+-]|/(?=\*)|(?<=\*)/|\*", "_", text, flags=re.ASCII)


@dataclass
class Terms:
    """Some terms of an axis as a block of the C file calls them: one table of parameters, one array of states."""

    table: str
    terms: Sequence[Instance]
    machine: Machine
    library: Library

    def call(self, k: int) -> str:
        """A call of term number k."""
        m, kernel = self.machine, self.terms[k].term.kernel
        found = self.library.kernel(kernel)
        size = m.state_ends[k + 1] - m.state_ends[k]
        given = ["motion", f"&{self.table}[{m.parameter_ends[k]}]", f"&self->states[{m.state_ends[k]}]", "dt"]
        words = list(inspect.signature(getattr(kernel, "py_func", kernel)).parameters)
        known = dict(zip(words, given, strict=True)) | {f"{word}_size": str(size) for word in words}
        return f"{found.name}({', '.join(known[word] for word, _ in found.arguments)})"

    @property
    def text(self) -> str:
        """The table, named by what its numbers are."""
        entries = []
        for k, item in enumerate(self.terms):
            values = self.machine.parameters[self.machine.parameter_ends[k] : self.machine.parameter_ends[k + 1]]
            names = [f"{p.name}{f', {p.unit}' if p.unit else ''}" for p in item.term.parameters]
            for n, value in enumerate(values):
                entries.append(f"    {number(value)}, /* {item.term.words}: {names[n] if n < len(names) else 'slot or table'} */")
        entries = entries or [f"    {number(0.0)} /* nothing */"]
        return "\n".join([f"static const real {self.table}[{max(len(entries), 1)}] = {{", *entries, "};"])

    @property
    def states(self) -> int:
        return max(len(self.machine.states), 1)

    def of(self, *places: Place) -> list[int]:
        return [k for k, item in enumerate(self.terms) if item.term.place in places]


@dataclass
class AxisCode:
    """The C file of an axis for control periods of `period` seconds.

    Raises JobError for a kernel that is not translated, InputError for what the compensator refuses.
    """

    name: str
    axis: Axis
    period: float
    config: CancellationConfig = field(default_factory=CancellationConfig)

    def __post_init__(self) -> None:
        self.signals = signals_of(self.axis)
        self.library = Library()
        self.compensator = ModelCompensator(self.axis, self.period, self.config, self.signals)
        own = [item for item in self.axis.terms if item.term.place in RESISTING]
        resisting = build(self.axis, self.period, signals=self.signals, terms=own)
        self.friction = Terms("FRICTION", own, resisting, self.library)
        self.cancelled = Terms("COMPENSATOR", self.compensator.acting, self.compensator.machine, self.library)
        substeps = substeps_for(self.axis, self.period)
        moved = build(self.axis, self.period / substeps, substeps, self.signals)
        self.moved = Terms("MOTION", self.axis.terms, moved, self.library)

    @property
    def quiet(self) -> Axis:
        """The axis that moves: without noise and resolution."""
        return replace(self.axis, drive=replace(self.axis.drive, noise=0.0), sensors=Sensors())

    @property
    def given(self) -> str:
        """What comes from outside, behind the other inputs."""
        return "real temperature" + (", const real *signals" if self.signals else "")

    def surroundings(self) -> list[str]:
        count = PER_SIGNAL * len(self.signals)
        lines = ["motion[SLOT_TEMPERATURE] = temperature;"]
        return lines + [f"motion[SLOT_EXOGENOUS + {k}] = signals[{k}];" for k in range(count)]

    def step_friction(self) -> list[str]:
        """The body of the friction step."""
        f = self.friction
        slope = arrest_per_speed(f.machine, AT_REST)
        return [
            "real *motion = self->motion;",
            f"const real dt = (self->begun != 0) ? {number(self.period)} : {number(0.0)};",
            f"real opposing = {number(0.0)};",
            "self->begun = 1;",
            "motion[SLOT_TIME] = t;",
            f"motion[SLOT_TRAVEL] = {number(0.5)} * (velocity + motion[SLOT_VELOCITY]) * dt;",
            "motion[SLOT_POSITION] = position;",
            "motion[SLOT_VELOCITY] = velocity;",
            "motion[SLOT_ACCELERATION] = acceleration;",
            f"motion[SLOT_INERTIA] = {number(self.axis.inertia)};",
            f"motion[SLOT_ARREST] = {number(slope)} * velocity;",
            "motion[SLOT_TORQUE] = torque;",
            *self.surroundings(),
            *self.unscaled(),
            *[f"(void){f.call(k)};" for k in f.of(Place.SCALE)],
            *[f"opposing += {f.call(k)};" for k in f.of(Place.LAW, Place.OPPOSING, Place.BODY)],
            f"return opposing + ((motion[SLOT_INERTIA] - {number(self.axis.inertia)}) * acceleration);",
        ]

    def unscaled(self) -> list[str]:
        return [
            f"motion[SLOT_EXTRA_LEVEL] = {number(0.0)};",
            f"motion[SLOT_DRY_SCALE] = {number(1.0)};",
            f"motion[SLOT_VISCOUS_SCALE] = {number(1.0)};",
        ]

    def step_compensator(self) -> list[str]:
        """The body of the compensator's step: `control.model_compensator.compensate`, term by term."""
        c, count, inertia = self.cancelled, len(self.cancelled.terms), number(self.axis.inertia)
        lead = [f"lead += self->shares[{count + d}] * {number(delay)};" for d, delay in enumerate(self.compensator.plan.delays)]
        return [
            "real *motion = self->motion;",
            f"const real dt = {number(self.period)};",
            f"const real rigid = {inertia} * acceleration;",
            f"real lead = {number(self.axis.actuation_delay + 0.5 * self.period)};",
            f"real added = {number(0.0)};",
            "real ahead;",
            "int k;",
            f"for (k = 0; k < {max(count + len(lead), 1)}; k++) {{",
            "    self->shares[k] = approach(self->shares[k], self->wanted[k], self->rise, self->begun);",
            "}",
            "self->shared = approach(self->shared, self->share, self->rise, self->begun);",
            *lead,
            "ahead = velocity + (lead * acceleration);",
            "motion[SLOT_TIME] = t + lead;",
            f"motion[SLOT_POSITION] = position + (lead * (velocity + ({number(0.5)} * lead * acceleration)));",
            f"motion[SLOT_TRAVEL] = {number(0.5)} * (((self->begun != 0) ? self->speed : ahead) + ahead) * dt;",
            "motion[SLOT_VELOCITY] = ahead;",
            "motion[SLOT_ACCELERATION] = acceleration;",
            *self.surroundings(),
            f"motion[SLOT_INERTIA] = {inertia};",
            f"motion[SLOT_ARREST] = {number(arrest_per_speed(c.machine, AT_REST))} * ahead;",
            "motion[SLOT_TORQUE] = (self->begun != 0) ? self->required : rigid;",
            "self->begun = 1;",
            "self->speed = ahead;",
            *self.unscaled(),
            *[line for k in c.of(Place.SCALE) for line in self.scaling(k)],
            *[line for k in c.of(Place.LAW) for line in (f"self->parts[{k}] = {c.call(k)};", f"added += self->parts[{k}];")],
            "added = rested(added, ahead, self->rest_speed, self->rest_torque);",
            *[line for k in c.of(Place.OPPOSING, Place.BODY) for line in self.opposing(k)],
            "self->required = rigid + added;",
            "motion[SLOT_TORQUE] = rigid + added;",
            *[line for k in reversed(c.of(Place.DRIVE)) for line in self.inverted(k)],
            "return bounded(self->shared * added, self->limit);",
        ]

    def scaling(self, k: int) -> list[str]:
        return [
            "{",
            "    const real extra = motion[SLOT_EXTRA_LEVEL], dry = motion[SLOT_DRY_SCALE];",
            "    const real viscous = motion[SLOT_VISCOUS_SCALE];",
            "    real part, share, torque;",
            f"    (void){self.cancelled.call(k)};",
            "    torque = MATH(fabs)((motion[SLOT_EXTRA_LEVEL] - extra) + ((motion[SLOT_DRY_SCALE] - dry) * motion[SLOT_LEVEL])",
            "        + ((motion[SLOT_VISCOUS_SCALE] - viscous) * MATH(fabs)(motion[SLOT_VISCOUS])));",
            f"    part = self->shares[{k}] * torque;",
            f"    share = (part <= self->limits[{k}]) ? self->shares[{k}] : (self->limits[{k}] / torque);",
            "    motion[SLOT_EXTRA_LEVEL] = extra + (share * (motion[SLOT_EXTRA_LEVEL] - extra));",
            "    motion[SLOT_DRY_SCALE] = dry + (share * (motion[SLOT_DRY_SCALE] - dry));",
            "    motion[SLOT_VISCOUS_SCALE] = viscous + (share * (motion[SLOT_VISCOUS_SCALE] - viscous));",
            f"    self->parts[{k}] = MATH(copysign)(share * torque, ahead);",
            "}",
        ]

    def opposing(self, k: int) -> list[str]:
        return [
            "{",
            "    const real before = motion[SLOT_INERTIA];",
            f"    const real torque = {self.cancelled.call(k)};",
            "    const real whole = torque + ((motion[SLOT_INERTIA] - before) * acceleration);",
            f"    self->parts[{k}] = bounded(self->shares[{k}] * whole, self->limits[{k}]);",
            f"    added += self->parts[{k}];",
            "}",
        ]

    def inverted(self, k: int) -> list[str]:
        return [
            "{",
            "    const real torque = motion[SLOT_TORQUE];",
            f"    const real command = {self.cancelled.call(k)};",
            f"    self->parts[{k}] = bounded(self->shares[{k}] * (command - torque), self->limits[{k}]);",
            f"    motion[SLOT_TORQUE] = torque + self->parts[{k}];",
            f"    added += self->parts[{k}];",
            "}",
        ]

    def step_motion(self) -> list[str]:
        """One control period of the axis in motion: `physics.machine.tick` without noise and resolution."""
        m = self.moved
        dt, inertia = m.machine.constants[STEP], number(m.machine.constants[MASS])
        half, limit = f"{number(0.5)} * dt", min(float(m.machine.constants[TORQUE_LIMIT]), 1e30)
        inner = [
            f"real middle = self->velocity + ({half} * self->acceleration);",
            f"real friction = {number(0.0)};",
            f"real others = {number(0.0)};",
            f"if ((middle * self->velocity) < {number(0.0)}) {{",
            f"    middle = {number(0.0)};",
            "}",
            f"motion[SLOT_TIME] = self->clock + ({half});",
            f"motion[SLOT_POSITION] = self->position + ({half} * self->velocity);",
            "motion[SLOT_VELOCITY] = middle;",
            "motion[SLOT_TRAVEL] = motion[SLOT_POSITION] - self->last_middle;",
            "self->last_middle = motion[SLOT_POSITION];",
            f"motion[SLOT_INERTIA] = {inertia};",
            f"motion[SLOT_TORQUE] = bounded(torque, {number(limit)});",
            *[f"motion[SLOT_TORQUE] = {m.call(k)};" for k in m.of(Place.DRIVE)],
            f"motion[SLOT_ARREST] = (({inertia} * self->velocity) / dt) + motion[SLOT_TORQUE] - self->others;",
            *self.unscaled(),
            *[f"(void){m.call(k)};" for k in m.of(Place.SCALE)],
            *[f"friction += {m.call(k)};" for k in m.of(Place.LAW)],
            *[f"others += {m.call(k)};" for k in m.of(Place.OPPOSING, Place.BODY)],
            "self->acceleration = (motion[SLOT_TORQUE] - friction - others) / motion[SLOT_INERTIA];",
            "self->others = others;",
            "self->friction = friction;",
            f"self->position += dt * (self->velocity + ({half} * self->acceleration));",
            "self->velocity += dt * self->acceleration;",
            "self->clock += dt;",
        ]
        return [
            "real *motion = self->motion;",
            f"const real dt = {number(dt)};",
            "int step;",
            *self.surroundings(),
            f"for (step = 0; step < {int(m.machine.constants[SUBSTEPS])}; step++) {{",
            *[f"    {line}" for line in inner],
            "}",
            "motion[SLOT_POSITION] = self->position;",
            "self->measured = self->position;",
            *[f"self->measured += {m.call(k)};" for k in m.of(Place.SENSOR)],
            "self->measured_velocity = self->velocity;",
        ]

    def start(self, terms: Terms, position: bool = False) -> list[str]:
        """What every block begins with: memory at rest."""
        slots = EXOGENOUS + PER_SIGNAL * len(self.signals)
        return [
            "int k;",
            f"for (k = 0; k < {slots}; k++) {{ self->motion[k] = {number(0.0)}; }}",
            f"for (k = 0; k < {terms.states}; k++) {{ self->states[k] = {number(0.0)}; }}",
            f"self->motion[SLOT_CYCLE] = {number(terms.machine.constants[PHASE_PER_UNIT])};",
            f"self->motion[SLOT_INERTIA] = {number(self.axis.inertia)};",
            f"self->motion[SLOT_TEMPERATURE] = {number(20.0)};",
            *(["self->motion[SLOT_POSITION] = position;"] if position else []),
        ]

    def start_compensator(self) -> list[str]:
        plan, config = self.compensator.plan, self.config
        lines = [*self.start(self.cancelled), f"self->speed = {number(0.0)};", f"self->required = {number(0.0)};"]
        lines += ["self->begun = 0;", f"self->share = {number(config.share)};", f"self->shared = {number(0.0)};"]
        lines += [f"self->rest_speed = {number(config.rest_speed)};", f"self->rest_torque = {number(config.rest_torque)};"]
        lines += [f"self->limit = {number(config.total_limit)};"]
        lines += [f"self->rise = {number(min(self.period / config.entry_time, 1.0) if config.entry_time > 0.0 else 1.0)};"]
        for k, (wanted, limit) in enumerate(zip(plan.wanted, plan.limits, strict=True)):
            lines += [f"self->wanted[{k}] = {number(wanted)};", f"self->limits[{k}] = {number(min(float(limit), 1e30))};"]
            lines += [f"self->shares[{k}] = {number(0.0)};", f"self->parts[{k}] = {number(0.0)};"]
        return lines

    def structures(self) -> str:
        """The states of the three blocks."""
        slots = EXOGENOUS + PER_SIGNAL * len(self.signals)
        count = max(len(self.compensator.plan.shares), 1)
        terms = [*self.compensator.acting, *self.compensator.delays]
        which = "; ".join(f"{k} {plain(item.words)}" for k, item in enumerate(terms))
        axis_unit = self.axis.unit
        return f"""/* Friction and effects along a motion. */
typedef struct {{
    real motion[{slots}];
    real states[{self.friction.states}];
    int begun;
}} {self.name}_friction;

/* Their compensation along a reference. `wanted`, `limits`, `share`, `limit`, `rest_speed` and `rest_torque` may be
   changed between two steps: shares follow at `rise` a step, so that torque does not come in a step.
   Terms: {which}. */
typedef struct {{
    real wanted[{count}];  /* 0 or 1 for each term: whether it is cancelled */
    real limits[{count}];  /* {axis_unit("N m")}, of each term */
    real share;  /* 0 to 1, of the whole compensation */
    real limit;  /* {axis_unit("N m")}, of the whole compensation */
    real rise;  /* 1, change of a share in a step */
    real rest_speed;  /* {axis_unit("rad/s")}, below it friction falls to rest_torque; 0: no rest band */
    real rest_torque;  /* {axis_unit("N m")}, most friction compensated at rest */
    real parts[{count}];  /* {axis_unit("N m")}, torque of each term in the last step */
    real shares[{count}];
    real shared;
    real speed;
    real required;
    real motion[{slots}];
    real states[{self.cancelled.states}];
    int begun;
}} {self.name}_compensator;

/* The axis in motion under a torque. */
typedef struct {{
    real position;  /* {axis_unit("rad")} */
    real velocity;  /* {axis_unit("rad/s")} */
    real acceleration;  /* {axis_unit("rad/s^2")} */
    real friction;  /* {axis_unit("N m")} */
    real others;  /* {axis_unit("N m")}, opposing torque of effects */
    real measured;  /* {axis_unit("rad")}, what the encoder says */
    real measured_velocity;  /* {axis_unit("rad/s")} */
    real clock;
    real last_middle;
    real motion[{slots}];
    real states[{self.moved.states}];
}} {self.name}_axis;"""

    def declared(self) -> dict[str, tuple[str, list[str], str]]:
        """The functions: head, body and what it does."""
        n, torque = self.name, self.axis.unit("N m")
        friction, compensator, axis = f"{n}_friction *self", f"{n}_compensator *self", f"{n}_axis *self"
        moved = [*self.start(self.moved, position=True), *(f"self->{word} = position;" for word in ("position", "measured",
                 "last_middle")), *(f"self->{word} = {number(0.0)};" for word in ("velocity", "acceleration", "friction",
                 "others", "measured_velocity", "clock"))]  # fmt: skip
        signals = ", ".join(f"{plain(name)} and its rate" for name in self.signals)
        around = f"temperature in degC{f'; signals: {signals}' if signals else ''}"
        return {
            f"void {n}_friction_start({friction})": ("void", [*self.start(self.friction), "self->begun = 0;"], "At rest."),
            f"real {n}_friction_step({friction}, {INPUTS}, real torque, {self.given})": (
                "real",
                self.step_friction(),
                f"Opposing torque ({torque}) of friction and effects at the next instant; torque: the drive's; {around}.",
            ),
            f"void {n}_compensator_start({compensator})": (
                "void",
                self.start_compensator(),
                "At rest, with the settings exported.",
            ),
            f"real {n}_compensator_step({compensator}, {INPUTS}, {self.given})": (
                "real",
                self.step_compensator(),
                f"Torque ({torque}) to add to the command, for a reference now; t in s; {around}.",
            ),
            f"void {n}_axis_start({axis}, real position)": ("void", moved, "At rest at a position."),
            f"void {n}_axis_step({axis}, real torque, {self.given})": (
                "void",
                self.step_motion(),
                f"A control period under a torque ({torque}); {around}.",
            ),
        }

    def body(self) -> str:
        """Everything behind the declarations: helpers, kernels, tables, functions."""
        functions = [
            f"{head}\n{{\n" + "\n".join(f"    {line}" for line in lines) + "\n}"
            for head, (_, lines, _) in self.declared().items()
        ]
        slots = "\n".join(f"    SLOT_{name} = {value}," for name, value in sorted(SLOTS.items(), key=lambda pair: pair[1])
                          if name not in ("PER_SIGNAL", "SLOTS"))  # fmt: skip
        tables = "\n\n".join(terms.text for terms in (self.friction, self.cancelled, self.moved))
        return f"""/* What terms read of an instant and write for one another. */
enum {{
{slots}
}};

{HELPERS}

{self.library.text}

{tables}

{f"{chr(10)}{chr(10)}".join(functions)}
"""


HELPERS = """static real bounded(real value, real limit)
{
    if (value > limit) { return limit; }
    return (value < -limit) ? -limit : value;
}

/* A share on its way to another one; at once in the first step. */
static real approach(real share, real wanted, real rise, int begun)
{
    return (begun != 0) ? (share + bounded(wanted - share, rise)) : (share + (wanted - share));
}

/* Friction in the rest band: bounded at rest, whole from its speed on. */
static real rested(real torque, real velocity, real rest_speed, real rest_torque)
{
    real moving;
    if (MATH(fabs)(velocity) >= rest_speed) { return torque; }
    moving = MATH(fabs)(velocity) / rest_speed;
    return (moving * torque) + ((REAL(1.0) - moving) * bounded(torque, rest_torque));
}"""
