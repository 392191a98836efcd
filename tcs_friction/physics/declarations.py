"""What a term may declare beside its parameters and its kernel: where it acts and shows, what it needs, how it is searched."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

Values = Mapping[str, float]  # a term's parameters by name


class Place(enum.Enum):
    """Where a term acts on the axis."""

    DRIVE = "drive"
    SCALE = "friction scale"
    LAW = "friction law"
    OPPOSING = "opposing torque"
    BODY = "body"
    SENSOR = "sensor"


class Need(enum.Enum):
    """What a recording must have for an effect to be told from others. An effect whose needs are not met is never named."""

    MOTION = "motion that stands out of the noise"
    BOTH_DIRECTIONS = "motion in both directions"
    REVERSALS = "several reversals"
    SPEEDS = "several speeds"
    ACCELERATION = "an inertial torque that stands out of the noise"
    FREE_ACCELERATION = "acceleration that does not just follow the position, as in one sinusoid, or an inertia that is known"
    MEASURED_INERTIA = "acceleration that does not just follow the position, from which the inertia is measured"
    TRAVEL = "a tenth of a turn of travel"
    DURATION = "tens of seconds, in which slow changes show"


# The coordinates at which a term may show, and the recorded one that it is then drawn over. "exogenous": its signal.
COORDINATES: Mapping[str, str] = MappingProxyType(
    {
        **{name: name for name in ("time", "position", "velocity", "acceleration", "torque", "temperature", "exogenous")},
        "direction": "velocity",
        "frequency": "time",
        "time_since_reversal": "time",
    }
)


@dataclass(frozen=True)
class Local:
    """Names of the parameters that say where in the position an effect is, and how wide (1/e half width of a bell curve)."""

    centre: str = "centre"
    width: str = "width"


def never_turns(_: float) -> Sequence[tuple[float, float]]:
    """Of an axis that never turns back."""
    return ()


@dataclass(frozen=True)
class Survey:
    """What a recording can show: from it an effect proposes values of its SHAPE parameters to start a search from.

    travel: lowest and highest position. slow, fast: speeds that the axis moves at (5th and 99th percentile). duration: s.
    start: time of the first sample, s. cutoff: highest frequency with a signal, Hz. resolution: noise of the position.
    inertia, level: the axis' inertia and dry friction. bristle: travel over which that friction turns over, 0 without bristles.
    cycle: rad of phase per unit of position at order 1. turns: for a travel over which friction builds up, when the axis turns
    back, from the last motion one way until that friction is built up the other way, s. period: time in which the motion usually
    comes back, s; inf if it never does. acceleration: rms.
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
    cycle: float = 1.0
    turns: Callable[[float], Sequence[tuple[float, float]]] = never_turns
    period: float = 0.0
    acceleration: float = 0.0

    @property
    def span(self) -> float:
        """Width of the travel."""
        return self.travel[1] - self.travel[0]


Scan = Callable[[Survey], Sequence[Values]]
Transfer = Callable[[Values, np.ndarray], np.ndarray]
Warn = Callable[[Values], list[str]]
Rate = Callable[[Values, float], float]
InertiaOver = Callable[[Values, np.ndarray], np.ndarray]
Rings = Callable[[Values], tuple[float, float]]
Orders = Callable[[float, bool], tuple[float, float]]
Completes = Callable[[Values], Values]
Extent = Callable[[Values], tuple[float, float | None]]
Implausible = Callable[[Values, Survey], str]

PERIODS = 4.0  # over the travel, that make a torque periodic
ABOVE_ONE = 1.5  # lowest order per turn: once per turn is gravity's


def geometric(lowest: float, highest: float, count: int) -> list[float]:
    """`count` values from lowest to highest, each the same factor above the one before."""
    return [lowest * (highest / lowest) ** (i / (count - 1)) for i in range(count)]


def no_scan(survey: Survey) -> Sequence[Values]:
    """Nothing to search."""
    return ({},)


def no_warnings(values: Values) -> list[str]:
    """Nothing is doubtful."""
    return []


def no_rate(values: Values, inertia: float) -> float:
    """No dynamics of its own."""
    return 0.0


def no_travel(values: Values) -> float:
    """No bristles."""
    return 0.0


def no_law(values: Values) -> Values:
    """It completes no law."""
    return {}


def any_signal(name: str) -> bool:
    """It may act through any recorded signal."""
    return True


def many_periods(once: float, rotary: bool) -> tuple[float, float]:
    """Orders of which several periods fit into the travel; `once` is the order with one."""
    return max(PERIODS * once, ABOVE_ONE if rotary else 0.0), math.inf


def always_plausible(values: Values, survey: Survey) -> str:
    """Nothing speaks against any values in any motion."""
    return ""


def spring_rate(stiffness: float, damping: float, inertia: float) -> float:
    """Fastest rate (1/s) of an inertia on a spring (N m/rad) with a damper (N m s/rad): it swings or it decays."""
    return max(math.sqrt(max(stiffness, 0.0) / inertia), damping / inertia)
