"""What is normal for a parameter: a level, what temperature, warm-up and season add, and how recordings scatter.

    value = level + a (T - T0) + b (T - T0)^2 + warm-up + season + changes + scatter + measurement error

The standard deviations of identifications are often too small: a scatter between recordings is added as a random effect. Its
size is Paule and Mandel's (J. Res. NBS 87, 1982, 377; for regressions as by DerSimonian and Kacker, Contemp. Clin. Trials 28,
2007, 105): that with which the weighted squares have their expectation. Neighbours in time are alike: errors are AR(1) in time.
Which terms a model has depends on what was recorded and never on the values, so that no test is made on terms chosen by them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from tcs_friction.trends.rows import Array
from tcs_friction.trends.series import Series

YEAR = 365.25  # days
FEWEST = 8  # values for a slope over temperature
FEWEST_BENT = 20  # values for its curvature
TEMPERATURE_SPREAD, BENT_SPREAD = (
    1.0,
    3.0,
)  # degC, standard deviation, from which on slope and curvature are told
WARM_UP_SPREAD = 0.2  # degC, standard deviation of the change within recordings
SEASONS = 1.9  # years, from which on a course that repeats every year is no drift
SEASON_INSTEAD = 0.75  # years, from which on season stands for a temperature that was not recorded
MOST_ALIKE = 0.9  # largest correlation of neighbours
GAPS = (0.25, 20.0)  # of the median gap: nearer ones are not more alike, farther ones are not alike


@dataclass(frozen=True)
class Design:
    """Columns (n, p) of a linear model and what each is."""

    names: tuple[str, ...]
    columns: Array

    def __post_init__(self) -> None:
        self.columns.setflags(write=False)

    def with_columns(self, names: tuple[str, ...], columns: Array) -> Design:
        """The same model with further columns (n, k)."""
        return Design((*self.names, *names), np.column_stack([self.columns, columns]))


@dataclass(frozen=True)
class Noise:
    """How values scatter. std: (n,) of each, scatter between recordings included. scatter: that alone. alike: correlation of
    neighbours at the median gap; carried: (n - 1,) that of each pair of neighbours.
    """

    std: Array
    scatter: float
    alike: float
    carried: Array

    def whiten(self, columns: Array) -> Array:
        """The columns (n, k) or (n,) with errors made independent and of variance 1."""
        scaled = (columns.T / self.std).T
        rest = np.sqrt(1.0 - self.carried**2)
        out = scaled.copy()
        out[1:] = ((scaled[1:].T - self.carried * scaled[:-1].T) / rest).T
        return out


@dataclass(frozen=True)
class Fit:
    """Generalised least squares of a design. values: (p,); covariance: (p, p), scaled by what is left; squares: left, whitened;
    degrees: of freedom; residual: (n,) in the parameter's unit.
    """

    design: Design
    values: Array
    covariance: Array
    squares: float
    degrees: int
    residual: Array

    def value(self, name: str) -> tuple[float, float]:
        """A coefficient and its standard deviation."""
        at = self.design.names.index(name)
        return float(self.values[at]), math.sqrt(self.covariance[at, at])


def normal_design(series: Series, reference_temperature: float) -> Design:
    """What is normal: level, temperature (per degC), its square, warm-up and season, as far as the recordings reach."""
    count = len(series)
    names, columns = ["level"], [np.ones(count)]
    warmer = series.temperature - reference_temperature
    spread = float(np.std(warmer)) if count and np.isfinite(warmer).all() else 0.0
    known = count >= FEWEST and spread >= TEMPERATURE_SPREAD
    if known:
        names.append("temperature")
        columns.append(warmer)
    if known and count >= FEWEST_BENT and spread >= BENT_SPREAD:
        names.append("temperature squared")
        columns.append(warmer**2)
    warming = series.columns["temperature_change"]
    if count >= FEWEST_BENT and np.isfinite(warming).all() and np.std(warming) >= WARM_UP_SPREAD:
        names.append("warm-up")
        columns.append(warming)
    years = (series.day[-1] - series.day[0]) / YEAR if count else 0.0
    if count >= FEWEST_BENT and years >= (SEASONS if known else SEASON_INSTEAD):
        angle = 2.0 * math.pi * series.day / YEAR
        names += ["season, cosine", "season, sine"]
        columns += [np.cos(angle), np.sin(angle)]
    return Design(tuple(names), np.column_stack(columns))


def least_squares(design: Design, value: Array, noise: Noise) -> Fit:
    """The design's coefficients for values (n,) that scatter like `noise`."""
    columns, target = noise.whiten(design.columns), noise.whiten(value)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    inverse = np.linalg.pinv(columns / size)
    coefficients = inverse @ target / size
    left = target - columns @ coefficients
    degrees = max(len(value) - columns.shape[1], 1)
    squares = float(left @ left)
    covariance = squares / degrees * (inverse @ inverse.T) / np.outer(size, size)
    return Fit(design, coefficients, covariance, squares, degrees, value - design.columns @ coefficients)


def noise_of(design: Design, series: Series, searched: int = 0) -> Noise:
    """How the series scatters about a design. searched: changes whose place was chosen by these values.

    The correlation of neighbours comes out too small where a model was fitted, and a little more where the place of a change was
    searched for; both are made up for, and one standard error is added: who takes noise for too white finds changes in it.
    """
    std = _paule_mandel(design, series.value, series.std)
    white = independent(series, std)
    z = least_squares(design, series.value, white).residual / white.std
    count, free = len(z), design.columns.shape[1] + searched
    steps = gaps(series.day)
    near = steps <= 3.0
    total = float(z @ z)
    if count <= free + 2 or total == 0.0 or not near.any():
        return white
    found = float(np.sum(z[1:][near] * z[:-1][near])) / total * (count - 1) / np.count_nonzero(near)
    alike = found + (free + 3.0 * max(found, 0.0)) / count
    alike += math.sqrt(max(1.0 - alike**2, 0.0) / count)
    alike = min(max(alike, 0.0), MOST_ALIKE)
    return Noise(white.std, std, alike, alike**steps if alike > 0.0 else np.zeros(count - 1))


def independent(series: Series, scatter: float) -> Noise:
    """Errors with so much scatter between recordings (in the parameter's unit), each for itself."""
    return Noise(np.hypot(series.std, scatter), scatter, 0.0, np.zeros(max(len(series) - 1, 0)))


def gaps(day: Array) -> Array:
    """(n - 1,) times between neighbours over the median one, within GAPS."""
    between = np.diff(day)
    usual = float(np.median(between)) if len(between) else 1.0
    return np.clip(between / usual if usual > 0.0 else np.ones(len(between)), *GAPS)


def first_scatter(series: Series) -> float:
    """Scatter between recordings as neighbours show it, which steps and drifts hardly touch; where a search begins."""
    if len(series) < 3:
        return 0.0
    between = np.diff(series.value)
    variance = (1.4826 * float(np.median(np.abs(between)))) ** 2 / 2.0
    return math.sqrt(max(variance - float(np.median(series.std)) ** 2, 0.0))


def _paule_mandel(design: Design, value: Array, std: Array) -> float:
    """Scatter between recordings with which the weighted squares about the design have their expectation."""
    degrees = len(value) - design.columns.shape[1]
    if degrees < 1:
        return 0.0

    def excess(variance: float) -> float:
        noise = Noise(np.sqrt(std**2 + variance), 0.0, 0.0, np.zeros(len(value) - 1))
        return least_squares(design, value, noise).squares - degrees

    plain = Noise(np.full(len(value), 1.0), 0.0, 0.0, np.zeros(len(value) - 1))
    top = 10.0 * least_squares(design, value, plain).squares / degrees
    if top <= 0.0 or excess(0.0) <= 0.0:
        return 0.0
    while excess(top) > 0.0:
        top *= 10.0
    return math.sqrt(float(brentq(excess, 0.0, top, xtol=1e-12 * top, rtol=1e-6)))
