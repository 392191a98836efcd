"""What a learning period shows of an axis: by how much its model is off, and by how much that varies.

The model is never exact. What a watch compares with is the mismatch of the learning period:

    r = sum_i b_i part_i + sum_k A_k cos(k q - p_k) + rest

part_i: the parts of the model's own torque (one that is 2 % off leaves 2 % of them), with a prior, fitted to means over whole
looks, where the acceleration is the motion's and not the noise's. k: periodic torques over the position that the model lacks.
The rest has, for every test, a mean, a scatter from look to look and one from stretch to stretch (random effects). What these
leave uncertain is a margin within which nothing is a change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import JobError
from tcs_friction.monitor.bank import (
    LINES,
    LOOK,
    WINDOW,
    Layout,
    empty_spectrum,
    empty_sums,
    judged_all,
    layout,
    looks,
    spectra,
)
from tcs_friction.monitor.residual import PARTS, PLACE, RESIDUAL, SLOWEST

Array = NDArray[np.float64]

PRIOR = (0.1, 0.1, 0.2, 0.2, 0.1, 0.2, 0.05)
"""Standard deviations of a model's relative errors: offset and direction (of the dry level), Stribeck and other extra dry
friction, viscous friction, inertia, other torques, and what it says of the temperature."""
FEWEST_LOOKS = 20
ROUNDS = 3  # of parts and waves in turns
MOST_WAVES = 6
CLEAR = 6.0  # standard deviations from which a wave is learned
FINE_BINS = 2000
FINE_STEP = 0.4  # rad over the travel, between orders of the search for waves
HIGHEST_ORDER = 0.5  # rad of phase within a fine bin
STRETCH = 30  # looks
SHRUNK = 20.0  # looks' worth of the other tests of its coordinate in the scatter of a test
TRUSTED = 8  # looks without which a test is not made
LEAST_WEIGHT = 10.0  # of a test at a look
SURE = 2.0  # standard deviations that the scatter's estimate is taken larger than it is


class Baseline(NamedTuple):
    """What was learned. Linear tests (j,), lines of the spectrum (f,)."""

    known: Layout
    shares: Array  # (p,) b
    covariance: Array  # (p, p) of b
    waves: Array  # (w, 3) order (rad/rad), cosine and sine amplitude (N m)
    noise: float  # N m rms of a block
    mean: Array  # (j,) N m
    variance: Array  # (j,) N^2 m^2, of the mean and between stretches
    scatter: Array  # (j,) from look to look, over that of white noise
    active: NDArray[np.bool_]  # (j,)
    level: Array  # (f,) N^2 m^2, of the spectrum


@dataclass(frozen=True)
class _Looks:
    """Means over looks: residual (l,), parts (l, p)."""

    residual: Array
    parts: Array


def moving(rows: Array) -> NDArray[np.bool_]:
    """In which blocks (n, COLUMNS) the axis slides, at whatever place and speed."""
    return np.asarray(rows[:, SLOWEST] > 0.0)


def learned(rows: Array, cycle: float) -> Baseline:
    """What blocks (n, COLUMNS) show. Raises JobError where the axis has moved too little."""
    sliding = rows[moving(rows)]
    if len(sliding) < FEWEST_LOOKS * LOOK:
        raise JobError("learning period", f"{len(sliding) * 0.02:.0f} s of motion", f"{FEWEST_LOOKS} s at least")
    known = layout(sliding, cycle)
    mask = judged_all(rows, known)
    used = rows[mask]
    if len(used) < FEWEST_LOOKS * LOOK:
        raise JobError("learning period", f"{len(used) * 0.02:.0f} s of motion", f"{FEWEST_LOOKS} s at least")
    waves = np.zeros((0, 3))
    for _ in range(ROUNDS):
        shares, covariance = _fitted_parts(_means(used, used[:, RESIDUAL] - wave_torque(waves, used[:, PLACE])))
        waves = _found_waves(used[:, PLACE], used[:, RESIDUAL] - used[:, PARTS] @ shares, known)
    rest = used[:, RESIDUAL] - used[:, PARTS] @ shares - wave_torque(waves, used[:, PLACE])
    noise = math.sqrt(float(np.mean(rest**2))) or 1e-12
    mean, variance, scatter, active = _scatters(known, used, rest, noise)
    whole = np.zeros(len(rows))
    whole[mask] = rest
    level = _levels(whole, mask)
    return Baseline(known, shares, covariance, waves, noise, mean, variance, scatter, active, level)


def wave_torque(waves: Array, place: Array) -> Array:
    """Torque (n,), N m, of waves (w, 3) at positions (n,)."""
    total = np.zeros(len(place))
    for order, cosine, sine in waves:
        total += cosine * np.cos(order * place) + sine * np.sin(order * place)
    return total


def _means(rows: Array, residual: Array) -> _Looks:
    whole = len(rows) // LOOK * LOOK
    parts = rows[:whole, PARTS]
    return _Looks(
        residual[:whole].reshape(-1, LOOK).mean(axis=1), parts.reshape(-1, LOOK, parts.shape[1]).mean(axis=1)
    )


def _fitted_parts(means: _Looks) -> tuple[Array, Array]:
    """Shares (p,) of the parts by least squares with the prior, and their covariance."""
    precision = np.diag(1.0 / np.square(PRIOR))
    shares, variance = np.zeros(len(PRIOR)), float(np.var(means.residual)) or 1e-24
    covariance = np.linalg.inv(precision)
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(means.parts.T @ means.parts / variance + precision)
        shares = covariance @ (means.parts.T @ means.residual) / variance
        rest = means.residual - means.parts @ shares
        variance = float(rest @ rest) / max(len(rest) - len(shares), 1) or 1e-24
    return np.asarray(shares), np.asarray(covariance)


def _found_waves(place: Array, residual: Array, known: Layout) -> Array:
    """The clearest waves (w, 3) over the position, one after the other, fitted together."""
    low, high = known.travel
    travel = high - low
    bins = np.clip(((place - low) / travel * FINE_BINS).astype(int), 0, FINE_BINS - 1)
    weight = np.bincount(bins, minlength=FINE_BINS).astype(float)
    full = weight > 0
    at = low + (np.flatnonzero(full) + 0.5) * travel / FINE_BINS
    mean = np.bincount(bins, residual, FINE_BINS)[full] / weight[full]
    weight = weight[full]
    orders = np.arange(known.orders[0], HIGHEST_ORDER * FINE_BINS / travel, FINE_STEP / travel)
    found: list[float] = []
    fitted = np.zeros((0, 2))
    for _ in range(MOST_WAVES):
        rest = mean - wave_torque(_stacked(found, fitted), at)
        order, gain = _clearest(at, rest, weight, orders)
        deviation = np.sum(weight * rest**2) / max(len(rest), 1)
        if gain < CLEAR**2 * max(deviation, 1e-300):
            break
        found.append(order)
        waves = np.stack([f(k * at) for k in found for f in (np.cos, np.sin)], axis=1) * np.sqrt(weight)[:, None]
        fitted = np.linalg.lstsq(waves, mean * np.sqrt(weight), rcond=1e-8)[0].reshape(-1, 2)
    return _stacked(found, fitted)


def _stacked(orders: list[float], amplitudes: Array) -> Array:
    return np.column_stack([np.array(orders).reshape(-1, 1), amplitudes]) if orders else np.zeros((0, 3))


def _clearest(at: Array, rest: Array, weight: Array, orders: Array) -> tuple[float, float]:
    """The order at which a wave takes most off the squares of weighted means, and how much; refined between grid points."""
    best = _gains(at, rest, weight, orders)
    centre, step = orders[int(np.argmax(best))], orders[1] - orders[0] if len(orders) > 1 else 1.0
    fine = centre + step * np.linspace(-1.0, 1.0, 41)
    gains = _gains(at, rest, weight, fine)
    return float(fine[int(np.argmax(gains))]), float(gains.max())


def _gains(at: Array, rest: Array, weight: Array, orders: Array) -> Array:
    """By how much (o,) the weighted squares fall with a wave of each order: least squares of its cosine and sine."""
    gains = np.empty(len(orders))
    pull = weight * rest
    for i, order in enumerate(orders):
        c, s = np.cos(order * at), np.sin(order * at)
        cc, ss, cs = weight @ (c * c), weight @ (s * s), weight @ (c * s)
        a, b = pull @ c, pull @ s
        determinant = max(cc * ss - cs * cs, 1e-9 * cc * ss, 1e-300)
        gains[i] = (ss * a * a - 2.0 * cs * a * b + cc * b * b) / determinant
    return gains


def _scatters(known: Layout, rows: Array, rest: Array, noise: float) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Mean (j,), its variance with that between stretches (j,), scatter (j,) over white noise's, and which tests are made."""
    out = np.empty((len(rows) // LOOK + 1, 2, int(known.ends[-1])))
    count = looks(known, empty_sums(known, rows.shape[1] - PARTS.start), rows, rest, out)
    total, weight = out[:count, 0], out[:count, 1]
    enough = weight >= LEAST_WEIGHT
    seen = enough.sum(axis=0)
    mean = np.where(weight.sum(axis=0) > 0, total.sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300), 0.0)
    z = np.where(enough, (total - mean * weight) / (noise * np.sqrt(np.maximum(weight, 1e-300))), 0.0)
    squares = (z**2).sum(axis=0)
    scatter = np.empty(len(mean))
    between = np.empty(len(mean))
    for family in _families(known):
        pooled = squares[family].sum() / max(seen[family].sum() - 1, 1)
        effective = seen[family] + SHRUNK
        scatter[family] = np.sqrt((squares[family] + SHRUNK * pooled) / effective * (1.0 + SURE * np.sqrt(2.0 / effective)))
        between[family] = _between(total[:, family], weight[:, family], mean[family], noise**2 * scatter[family] ** 2)
    variance = between + noise**2 * scatter**2 / np.maximum(weight.sum(axis=0), 1e-300)
    return mean, variance, scatter, seen >= TRUSTED


def _families(known: Layout) -> list[slice]:
    return [slice(int(a), int(b)) for a, b in zip((0, *known.ends[:-1]), known.ends, strict=True)]


def _between(total: Array, weight: Array, mean: Array, block: Array) -> Array:
    """Variance (j,) of a test's mean between stretches of STRETCH looks, beyond what noise of variance `block` (j,) makes of it.

    DerSimonian and Laird's moments (1986), a test's own and those of all tests of its coordinate in equal shares.
    """
    count = len(total) // STRETCH * STRETCH
    if count < 2 * STRETCH:
        return np.zeros(len(mean))
    sums = total[:count].reshape(-1, STRETCH, len(mean)).sum(axis=1)
    weights = weight[:count].reshape(-1, STRETCH, len(mean)).sum(axis=1)
    heard = np.maximum(weights.sum(axis=0), 1e-300)
    deviations = np.where(weights > 0, (sums - mean * weights) ** 2 / np.maximum(weights, 1e-300), 0.0).sum(axis=0)
    expected = block * np.maximum((weights > 0).sum(axis=0) - 1, 0)
    scale = np.maximum(heard - (weights**2).sum(axis=0) / heard, 1e-300)
    own = (deviations - expected) / scale
    pooled = (deviations - expected).sum() / scale.sum()
    return np.maximum(0.5 * (own + pooled), 0.0)


def _levels(rest: Array, mask: NDArray[np.bool_]) -> Array:
    """Mean power (f,) of each line of the spectrum, surely not too small."""
    out = np.empty((len(rest) // WINDOW + 1, LINES))
    windows = spectra(empty_spectrum(), rest, mask, out)
    if windows < TRUSTED:
        return np.full(LINES, math.inf)
    own, pooled = out[:windows].mean(axis=0), out[:windows].mean()
    return (windows * own + SHRUNK * np.minimum(own, pooled)) / (windows + SHRUNK) * (1.0 + SURE / math.sqrt(windows))
