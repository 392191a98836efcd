"""What a torque term is: the one interface of friction laws and effects.

An axis is an inertia plus a list of terms. A term is a compiled kernel

    kernel(motion, parameters, state, dt) -> float

and the declaration of its parameters. The same kernel serves the simulation step and the evaluation of a whole
recording: both walk through instants, fill the `motion` vector for each, and call the kernels in the order of
their places. `state` is the term's own memory, zero before the first instant; `dt` is the time since the previous instant, s.

Where a term acts (its `Place`) says what the kernel returns:

    DRIVE     torque at the rotor, N m, from `motion[TORQUE]`
    SCALE     0; raises or multiplies the friction that the law will find: EXTRA_LEVEL, DRY_SCALE, VISCOUS_SCALE
    LAW       friction torque, N m; writes DRY, VISCOUS, LEVEL and MOBILISED as well
    OPPOSING  opposing torque, N m, from motion, time and recorded signals
    BODY      opposing torque, N m, of a second body; lowers or changes motion[INERTIA], what moves rigidly with the shaft
    SENSOR    error of the measured position, rad

Sign convention: `inertia * acceleration = torque - friction - other opposing torques`. SI units; for a linear axis
read m, N and kg for rad, N m and kg m^2.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numba import float64, njit

from tcs_friction.errors import InputError, nearest

# Slots of the motion vector. Recorded exogenous signals follow from EXOGENOUS on, in the order of their names.
TIME = 0  # s since the start of the recording or run
POSITION = 1  # rad
VELOCITY = 2  # rad/s
ACCELERATION = 3  # rad/s^2; zero while simulating, where it is the result
TORQUE = 4  # N m, applied by the drive: as logged before the DRIVE terms, at the rotor after them
ARREST = 5  # N m, friction that would stop the axis within this step; what a law without bristles compares its level with
DRY = 6  # N m, dry part of the friction, written by the law
VISCOUS = 7  # N m, viscous part of the friction, written by the law
INERTIA = 8  # kg m^2, what moves rigidly with the shaft
CYCLE = (
    9  # rad of phase per unit of position at order 1: 1 for a rotary axis, 2 pi per metre for a linear one
)
TRAVEL = 10  # rad, moved since the previous instant
LEVEL = 11  # N m, dry friction available here and now (the scaled Stribeck curve), written by the law
MOBILISED = 12  # -1 to 1, share of LEVEL that is mobilised: the direction of motion once the axis slides
EXTRA_LEVEL = 13  # N m, added to the law's level by SCALE terms
DRY_SCALE = 14  # factor on the level, by SCALE terms
VISCOUS_SCALE = 15  # factor on the viscous part, by SCALE terms
TEMPERATURE = 16  # degC
EXOGENOUS = 17

KERNEL_SIGNATURE = float64(float64[::1], float64[::1], float64[::1], float64)

Kernel = Callable[[Any, Any, Any, float], float]


def kernel(function: Kernel) -> Kernel:
    """Compile a term's kernel with the one signature all of them share, so that any list of them runs unrecompiled."""
    compiled: Kernel = njit(KERNEL_SIGNATURE, cache=True, error_model="numpy")(function)
    return compiled


@njit(cache=True, error_model="numpy")
def resolved(motion: Any, order: float) -> bool:
    """Whether less than half a period of a wave over the position was passed since the previous instant.

    A faster one averages out, and samples of it would pretend a slow one.
    """
    return bool(abs(order * motion[CYCLE] * motion[TRAVEL]) < math.pi)


class Place(enum.Enum):
    """Where a term acts on the axis."""

    DRIVE = "drive"
    SCALE = "friction scale"
    LAW = "friction law"
    OPPOSING = "opposing torque"
    BODY = "body"
    SENSOR = "sensor"


class Role(enum.Enum):
    """How the torque depends on a parameter: what a fit may exploit."""

    LINEAR = "linear"  # torque proportional to it
    PHASE = "phase"  # phase of the LINEAR parameter declared just before it, rad
    SHAPE = "shape"  # anything else; must be searched
    FIXED = "fixed"  # a convention or datum, never fitted


@dataclass(frozen=True)
class Parameter:
    """One declared parameter of a term. `unit` is that of a rotary axis; `unit_for` gives the linear one."""

    name: str
    unit: str
    description: str
    lower: float = -math.inf
    upper: float = math.inf
    default: float | None = None  # None: has to be given
    role: Role = Role.SHAPE

    def unit_for(self, kind: str) -> str:
        """Unit on an axis of this kind ("rotary" or "linear")."""
        return self.unit if self.role is Role.PHASE else unit_on(kind, self.unit)

    def check(self, value: object, where: str) -> float:
        """The value as a float.

        Raises
        ------
        InputError: not a number, not finite or out of the bounds.
        """
        number = float("nan")
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
        if not (math.isfinite(number) and self.lower <= number <= self.upper):
            bounds = f"a number from {self.lower:g} to {self.upper:g} {self.unit}".rstrip()
            raise InputError(where, f"{self.name} is {value!r}", bounds)
        return number


def unit_on(kind: str, unit: str) -> str:
    """The unit that a "rotary" or "linear" axis has where a rotary one has `unit`.

    >>> unit_on("linear", "N m s/rad"), unit_on("linear", "kg m^2"), unit_on("rotary", "1/turn")
    ('N s/m', 'kg', '1/turn')
    """
    if kind == "rotary":
        return unit
    for rotary, linear in (("kg m^2", "kg"), ("kg m²", "kg"), ("N m", "N"), ("turn", "m")):
        unit = unit.replace(rotary, linear)
    return unit.replace("rad", "m")


Validate = Callable[[Mapping[str, float]], list[str]]


@dataclass(frozen=True)
class Survey:
    """What a recording can show: from it an effect proposes values of its SHAPE parameters to start a search from.

    travel: lowest and highest position. slow, fast: speeds that the axis moves at (5th and 99th percentile). duration: s.
    start: time of the first sample, s. cutoff: highest frequency with a signal, Hz. resolution: noise of the position.
    inertia, level: the axis' inertia and dry friction. bristle: travel over which that friction turns over, 0 without bristles.
    """

    travel: tuple[float, float]
    slow: float
    fast: float
    start: float
    duration: float
    cutoff: float
    resolution: float
    inertia: float
    level: float
    bristle: float

    @property
    def span(self) -> float:
        """Width of the travel."""
        return self.travel[1] - self.travel[0]


Scan = Callable[[Survey], Sequence[Mapping[str, float]]]


def geometric(lowest: float, highest: float, count: int) -> list[float]:
    """`count` values from lowest to highest, each the same factor above the one before."""
    return [lowest * (highest / lowest) ** (i / (count - 1)) for i in range(count)]


def no_scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Nothing to search."""
    return ({},)


Transfer = Callable[[Mapping[str, float], np.ndarray], np.ndarray]


def _no_warnings(values: Mapping[str, float]) -> list[str]:
    return []


@dataclass(frozen=True)
class Term:
    """A friction law or an effect: identity, place, declared parameters and kernel.

    Attributes
    ----------
    id: name in axis files, diagnoses and reports.
    form: the formula, as the documentation prints it.
    coordinate: where it shows, one of the atlas coordinates (`position`, `velocity`, ...).
    subsystem: what an engineer would look at (`bearing`, `actuator`, ...).
    states: number of state values, or a function of (parameter values, dt) giving it.
    signals: number of recorded signals the instance must name; the kernel finds their slots behind its parameters.
    temperature: whether it reads the recorded temperature.
    scan: values of the SHAPE parameters to start a search from, given what a recording can show.
    periodic: "position" or "time" when the first parameter counts periods there and a spectrum finds it.
    local: it has a `centre` and a `width` in position, and a matched filter over the position finds the centre.
    transfer: where it is a linear filter, the complex amplitude that it adds at complex frequencies s (rad/s): to the torque,
    over that torque, for a DRIVE term; to the required torque, over inertia times acceleration, for a BODY.
    warn: what is doubtful about a set of values (a passivity condition, say), one line each.
    rank: order among terms of the same place; terms that change what others read come first.
    reads: what it reads beside motion, time and recorded signals: the "torque" at the rotor, what "friction" terms wrote.
    A term that reads nothing else adds the same torque whatever else the axis has.
    rotary: whether only a rotary axis can have it.
    jagged: whether its torque jumps with its shape, as collisions do: a search then cannot follow derivatives.
    """

    id: str
    place: Place
    form: str
    parameters: tuple[Parameter, ...]
    kernel: Kernel
    coordinate: str = "velocity"
    subsystem: str = "bearing"
    states: int | Callable[[Mapping[str, float], float], int] = 0
    signals: int = 0
    temperature: bool = False
    scan: Scan = no_scan
    periodic: str = ""
    local: bool = False
    transfer: Transfer | None = None
    warn: Validate = _no_warnings
    rank: int = 0
    tabulated: bool = False
    reads: tuple[str, ...] = ("torque", "friction")
    rotary: bool = False
    jagged: bool = False

    @property
    def filters(self) -> bool:
        """Whether it is a linear filter between the logged torque and the rotor."""
        return self.place is Place.DRIVE and self.transfer is not None

    @property
    def swings(self) -> bool:
        """Whether it is a body with a linear response."""
        return self.place is Place.BODY and self.transfer is not None

    @property
    def collides(self) -> bool:
        """Whether it is a body that knocks: no collision comes at its exact time."""
        return self.place is Place.BODY and self.jagged

    def parameter(self, name: str) -> Parameter:
        """The declared parameter of that name."""
        return next(p for p in self.parameters if p.name == name)

    def state_size(self, values: Mapping[str, float], dt: float) -> int:
        """Number of state values for instants `dt` (s) apart."""
        return self.states(values, dt) if callable(self.states) else self.states


@dataclass(frozen=True)
class Instance:
    """A term with values: what an axis is made of. Values are complete and checked; build with `instance`."""

    term: Term
    values: Mapping[str, float]
    signal: str | None = None
    table: Table | None = None

    def replace(self, **values: float) -> Instance:
        """The same instance with some values changed."""
        return instance(self.term, {**self.values, **values}, signal=self.signal, table=self.table)

    def packed(self, signals: tuple[str, ...] = ()) -> np.ndarray:
        """Parameters as the kernel reads them: declared values, then signal slots, then the table."""
        packed = [self.values[p.name] for p in self.term.parameters]
        if self.term.signals:
            if self.signal not in signals:
                known = ", ".join(signals) or "none"
                raise InputError(
                    f"effect {self.term.id}", f"no recorded signal named {self.signal!r}", f"one of: {known}"
                )
            packed.append(float(EXOGENOUS + signals.index(self.signal)))
        if self.table is not None:
            packed.extend(self.table.packed(signals))
        return np.array(packed, dtype=np.float64)


SLOTS = MappingProxyType(
    {
        "time": TIME,
        "position": POSITION,
        "velocity": VELOCITY,
        "acceleration": ACCELERATION,
        "torque": TORQUE,
        "temperature": TEMPERATURE,
    }
)


@dataclass(frozen=True)
class Table:
    """A table over one or two coordinates, for `learned_map`.

    Attributes
    ----------
    coordinates: names from SLOTS, or `exogenous:NAME`.
    lower, upper: range of each coordinate; outside, the edge value holds.
    values: torque on the regular grid, N m, shape (n,) or (n, m).
    """

    coordinates: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    values: np.ndarray

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for equal tables."""
        return self.coordinates, self.lower, self.upper, self.values.shape, self.values.tobytes()

    def slot(self, coordinate: str, signals: tuple[str, ...]) -> int:
        if coordinate in SLOTS:
            return SLOTS[coordinate]
        name = coordinate.removeprefix("exogenous:")
        if name not in signals:
            raise InputError(
                "effect learned_map",
                f"no coordinate {coordinate!r}",
                f"one of: {', '.join([*SLOTS, *signals])}",
            )
        return EXOGENOUS + signals.index(name)

    def packed(self, signals: tuple[str, ...]) -> list[float]:
        grid = self.values if self.values.ndim == 2 else self.values[:, None]
        coordinates = [*self.coordinates, "time"][:2]
        lower, upper = [*self.lower, 0.0][:2], [*self.upper, 1.0][:2]
        head: list[float] = []
        for name, low, high, size in zip(coordinates, lower, upper, grid.shape, strict=True):
            head += [float(self.slot(name, signals)), low, high, float(size)]
        return head + [float(x) for x in grid.ravel()]


def instance(
    term: Term,
    values: Mapping[str, object],
    where: str = "axis",
    signal: str | None = None,
    table: Table | None = None,
) -> Instance:
    """Check values against the term's declaration and fill defaults.

    Raises
    ------
    InputError: a parameter is unknown (names the nearest), missing, not finite or out of bounds.
    """
    where = f"{where} {term.id}" if term.id not in where else where
    names = [p.name for p in term.parameters]
    for name in values:
        if name not in names:
            raise InputError(where, f"unknown parameter {name!r}", nearest(name, names))
    checked = {}
    for parameter in term.parameters:
        value = values.get(parameter.name, parameter.default)
        if value is None:
            raise InputError(where, f"{parameter.name} is missing", f"a number in {parameter.unit or '1'}")
        checked[parameter.name] = parameter.check(value, where)
    if term.signals and signal is None:
        raise InputError(where, "signal is missing", "the name of a recorded exogenous signal")
    if term.tabulated and table is None:
        raise InputError(where, "table is missing", "coordinates, lower, upper and values")
    return Instance(term, MappingProxyType(checked), signal, table)
