"""The arrays behind a diagnosis, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.numerics.by_speed import TorqueBySpeed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CoordinateCurve:
    """The residual over one coordinate: bin centres x (k,), mean and its 95 % band (k,), torque unit."""

    coordinate: str
    unit: str
    x: Array
    mean: Array
    band: Array
    share: float  # of the residual's power
    p_value: float


@dataclass(frozen=True)
class Isolated:
    """One effect by itself over x (n,): what is left (n,) when all the rest is taken away, the fit (n,).

    Both as the torque that the effect demands: a spring's rises with the position. `title` tells it from others of its kind.
    named: not only described, nor believed all along.
    """

    effect: str
    title: str
    coordinate: str
    unit: str
    x: Array
    residual: Array
    fitted: Array
    named: bool = True


@dataclass(frozen=True)
class Map:
    """A learned map: torque (n,) or (n, m) on a regular grid over one or two coordinates between lower and upper.

    visited: (k,) or (k, k) of as many equal cells each way between these, whether the recordings were there.
    """

    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    values: Array
    visited: NDArray[np.bool_]


@dataclass(frozen=True)
class RunnerUp:
    """A hypothesis that lost: its gain (drop of squares in units of the noise) and why it lost."""

    effect: str
    score: float
    reason: str


@dataclass(frozen=True)
class Evidence:
    """The arrays behind a diagnosis.

    t (n,) s with the torque residuals (n,) of the model as believed, retuned, improved; `held_out` (n,) bool
    marks what no fit or choice saw. Decimated is fine. `torque_unit` is N m, N, A, ... as recorded. friction: against speed,
    with the models believed, retuned and improved; None without motion.
    """

    t: Array
    believed: Array
    retuned: Array
    improved: Array
    held_out: Array
    atlas: tuple[CoordinateCurve, ...] = ()
    isolated: tuple[Isolated, ...] = ()
    learned: Map | None = None
    runners_up: tuple[RunnerUp, ...] = ()
    torque_unit: str = "N m"
    position_unit: str = "rad"
    notes: tuple[str, ...] = ()
    friction: TorqueBySpeed | None = None
