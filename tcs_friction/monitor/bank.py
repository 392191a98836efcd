"""The tests of a watch: weights g over the motion, so that the mean of g r over a while is what one coordinate shows.

    time        1                             a torque that is there everywhere
    direction   s, s in either direction      friction (s: sign of the speed)
    speed       s within a band, v            friction at a speed, viscous friction
    position    1 and s within a bin          torque, or friction, in one place
    order       cos(k q - p)                  a periodic torque over the position
    frequency   exp(2 pi i f t)               a vibration; its power counts

All but the last are linear in the residual and have a sign. `Layout` says which weights a motion gets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.monitor.residual import BLOCK, PARTS, PLACE, SLOWEST, SPEED

Array = NDArray[np.float64]

COORDINATES = ("time", "direction", "speed", "position", "order", "frequency")
LINEAR = len(COORDINATES) - 1
DIRECTIONS = ("both directions", "positive direction", "negative direction")
SPEED_BANDS = 6
BINS = 48
ORDERS = 96
PHASES = 4  # of each order, over half a period: with either sign one is within 22.5 degrees of any wave's
LOWEST_ORDER = 1.5  # periods over the travel; slower waves are a matter of the bins
ORDER_STEP = 2.0  # rad over the travel: at the ends of the travel the nearest order is off by half a radian at most
WINDOW = 200  # blocks of a spectrum
LOWEST_LINE, LINE_STEP, LINES = 2, 1, 76  # in cycles per window: 0.5 to 19.25 Hz
LOOK = 50  # judged blocks between two looks at the evidence
OUTSIDE = 0.02  # of the travel learned, by which a position may lie outside
FASTER = 1.1  # times the fastest speed learned

ENDS = np.cumsum([1, len(DIRECTIONS), SPEED_BANDS + 1, 2 * BINS, PHASES * ORDERS])
"""Where the tests of each linear coordinate end."""


class Layout(NamedTuple):
    """What was learned of the motion, and the tests that follow from it."""

    travel: Array  # (2,) rad, lowest and highest position
    speeds: Array  # (SPEED_BANDS + 1,) rad/s, edges of the bands; slower than the first is not judged, nor FASTER than the last
    orders: Array  # (k,) rad of phase per rad
    ends: NDArray[np.int64]  # (LINEAR,) where the tests of each coordinate end


class Sums(NamedTuple):
    """What the blocks since the last look add up to, for each of the linear tests (j,)."""

    residual: Array  # sum of g r
    weight: Array  # sum of g^2
    parts: Array  # (j, p) sum of g times the parts of the model's torque


@dataclass(frozen=True)
class Test:
    """One test in words: its coordinate, what it is about there, and from where to where (in the unit)."""

    coordinate: str
    what: str
    low: float = math.nan
    high: float = math.nan
    unit: str = ""


def layout(rows: Array, cycle: float) -> Layout:
    """The tests for blocks (n, COLUMNS) of a learning period whose motion is judged; `cycle`: rad of phase per unit of position.

    A turn closes an axis: where a rotary axis has seen all of it, only whole orders are tested.
    """
    speed = np.abs(rows[:, SPEED])
    low, high = np.quantile(rows[:, PLACE], (0.001, 0.999))
    slow, fast = np.quantile(speed, (0.05, 0.999))
    slow = max(slow, 0.05 * float(np.median(speed)), 1e-3 * fast)
    edges = np.geomspace(slow, max(fast, 1.2 * slow), SPEED_BANDS + 1)
    travel = max(high - low, 1e-12)
    first, step = LOWEST_ORDER * 2.0 * math.pi / travel, ORDER_STEP / travel
    if cycle == 1.0 and travel >= 2.0 * math.pi:
        first, step = 2.0, 1.0
    orders = first + step * np.arange(ORDERS)
    return Layout(np.array([low, high]), edges, orders, ENDS.copy())


def described(known: Layout, number: int, cycle: float, kind: str) -> Test:
    """What a linear test is about."""
    length = "rad" if kind == "rotary" else "m"
    coordinate = int(np.searchsorted(known.ends, number, side="right"))
    at = number - (int(known.ends[coordinate - 1]) if coordinate else 0)
    name = COORDINATES[coordinate]
    if name == "time":
        return Test(name, "torque")
    if name == "direction":
        return Test(name, f"friction in {'the ' if at else ''}{DIRECTIONS[at]}")
    if name == "speed":
        if at == SPEED_BANDS:
            return Test(name, "friction in proportion to speed")
        return Test(name, "friction", known.speeds[at], known.speeds[at + 1], f"{length}/s")
    if name == "position":
        width = (known.travel[1] - known.travel[0]) / BINS
        low = known.travel[0] + (at % BINS) * width
        return Test(name, "torque" if at < BINS else "friction", low, low + width, length)
    order = known.orders[at // PHASES] / cycle
    step = (known.orders[1] - known.orders[0]) / cycle
    return Test(name, "periodic torque", order - step, order + step, "1/turn" if kind == "rotary" else "1/m")


@njit(cache=True, error_model="numpy")
def judged(row: Any, known: Any) -> bool:
    """Whether a block is one of a motion like those that were learned: the axis slides one way, at a known place and speed."""
    leeway = OUTSIDE * (known.travel[1] - known.travel[0])
    inside = known.travel[0] - leeway <= row[PLACE] <= known.travel[1] + leeway
    speed = abs(row[SPEED])
    return bool(inside and row[SLOWEST] >= known.speeds[0] and speed <= FASTER * known.speeds[-1])


@njit(cache=True, error_model="numpy")
def judged_all(rows: Any, known: Any) -> Any:
    """Which blocks (n, COLUMNS) are."""
    out = np.zeros(len(rows), np.bool_)
    for i in range(len(rows)):
        out[i] = judged(rows[i], known)
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _add(sums: Any, j: int, g: float, r: float, parts: Any) -> None:
    sums.residual[j] += g * r
    sums.weight[j] += g * g
    for p in range(len(parts)):
        sums.parts[j, p] += g * parts[p]


@njit(cache=True, error_model="numpy")
def add(sums: Any, known: Any, row: Any, r: float) -> None:
    """A judged block, with the residual r (N m) that is left of what was learned, into the sums of the tests."""
    q, v, parts = row[PLACE], row[SPEED], row[PARTS]
    s = 1.0 if v > 0.0 else -1.0
    _add(sums, 0, 1.0, r, parts)
    at = known.ends[0]
    _add(sums, at, s, r, parts)
    _add(sums, at + (1 if v > 0.0 else 2), s, r, parts)
    at, bands = known.ends[1], len(known.speeds) - 1
    _add(sums, at + min(max(np.searchsorted(known.speeds, abs(v)) - 1, 0), bands - 1), s, r, parts)
    _add(sums, at + bands, v / known.speeds[-1], r, parts)
    at = known.ends[2]
    place = int(BINS * (q - known.travel[0]) / (known.travel[1] - known.travel[0]))
    if 0 <= place < BINS:
        _add(sums, at + place, 1.0, r, parts)
        _add(sums, at + BINS + place, s, r, parts)
    at = known.ends[3]
    for k in range(len(known.orders)):
        order = known.orders[k]
        if abs(order * v) * BLOCK > 0.5 * math.pi:
            break  # so fast that the wave is not seen
        phase = order * (q - known.travel[0])
        c, d = math.cos(phase), math.sin(phase)
        for p in range(PHASES):
            turn = math.pi * p / PHASES
            _add(sums, at + PHASES * k + p, c * math.cos(turn) + d * math.sin(turn), r, parts)


def empty_sums(known: Layout, parts: int) -> Sums:
    """Sums of nothing."""
    count = int(known.ends[-1])
    return Sums(np.zeros(count), np.zeros(count), np.zeros((count, parts)))


@njit(cache=True, error_model="numpy")
def looks(known: Any, sums: Any, rows: Any, residual: Any, out: Any) -> int:
    """Sums (l, 2, j) of g r and g^2 at every look at blocks (n, COLUMNS) that are judged, with residuals (n,); returns l."""
    count = 0
    for i in range(len(rows)):
        add(sums, known, rows[i], residual[i])
        if (i + 1) % LOOK == 0:
            out[count, 0], out[count, 1] = sums.residual, sums.weight
            sums.residual[:], sums.weight[:], sums.parts[:] = 0.0, 0.0, 0.0
            count += 1
    return count


class Spectrum(NamedTuple):
    """The running transform of the residual over a window."""

    turn: Array  # (f, 2) cosine and sine of a line's phase per block
    phase: Array  # (f, 2) at the next block
    sums: Array  # (f, 2)
    seen: Array  # (2,) blocks in the window, judged ones among them


def frequencies() -> Array:
    """The lines (f,), Hz."""
    return (LOWEST_LINE + LINE_STEP * np.arange(LINES)) / (WINDOW * BLOCK)


def empty_spectrum() -> Spectrum:
    """A transform at the beginning of its window."""
    angle = 2.0 * math.pi * frequencies() * BLOCK
    start = np.stack([np.ones(LINES), np.zeros(LINES)], axis=1)
    return Spectrum(np.stack([np.cos(angle), np.sin(angle)], axis=1), start, np.zeros((LINES, 2)), np.zeros(2))


@njit(cache=True, error_model="numpy")
def transform(x: Any, r: float, counts: bool, power: Any) -> bool:
    """A block into the transform; whether a window has ended whose `power` (f,), N^2 m^2, may be judged."""
    x.seen[0] += 1.0
    if counts:
        x.seen[1] += 1.0
    for f in range(len(x.turn)):
        c, d = x.phase[f, 0], x.phase[f, 1]
        if counts:
            x.sums[f, 0] += c * r
            x.sums[f, 1] += d * r
        x.phase[f, 0] = c * x.turn[f, 0] - d * x.turn[f, 1]
        x.phase[f, 1] = d * x.turn[f, 0] + c * x.turn[f, 1]
    if x.seen[0] < WINDOW:
        return False
    enough = x.seen[1] >= 0.75 * WINDOW
    for f in range(len(x.turn)):
        power[f] = (x.sums[f, 0] ** 2 + x.sums[f, 1] ** 2) / max(x.seen[1], 1.0)
        x.sums[f, 0] = x.sums[f, 1] = 0.0
        x.phase[f, 0], x.phase[f, 1] = 1.0, 0.0
    x.seen[:] = 0.0
    return bool(enough)


@njit(cache=True, error_model="numpy")
def spectra(x: Any, residual: Any, counts: Any, out: Any) -> int:
    """Powers (w, f) of all windows of residuals (n,) of which only those that count (n,) are judged; returns w."""
    windows = 0
    for i in range(len(residual)):
        if transform(x, residual[i], counts[i], out[windows]):
            windows += 1
    return windows
