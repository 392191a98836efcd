"""Structure that a fit leaves in the residual: smooth maps over one or two coordinates, and slow torque over time.

In: a fit. Out: the `Structure` that remains, or None.

A map is a penalised regression on whitened chunk means with the fit's own numbers projected out. The quadratic form of a
linear smoother is a weighted sum of chi-squared (Box 1954), approximated by a scaled chi-squared with the same two moments,
so that penalties and maps are compared by p-value with Bonferroni's correction. Significance alone finds what discretisation
leaves behind; a map has to predict, too: its gain on pieces of time that it was not fitted to has to be a share of the noise
floor, and not from one piece alone. What no map predicts but rises above the noise towards low frequencies is structure in
time: a torque of unknown cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats

from tcs_friction.diagnose.dataset.basis import Basis, Even, Hats, Odd, One, Product, Wave
from tcs_friction.diagnose.dataset.coordinates import values_of
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise import NoiseModel
from tcs_friction.diagnose.fit.noise_estimate import driven_part, noise_floor
from tcs_friction.diagnose.fit.parameters import Part
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.remainder.chunk_means import ChunkMeans, slow_excess
from tcs_friction.diagnose.search.matched_filter import padded_length
from tcs_friction.physics.terms import Table

MAP_FALSE_ALARM = 1e-3  # chance that any map is found where nothing remains
PREDICTED_SHARE = 0.25  # of the noise floor: rms of the torque that a map must predict where it was not fitted
SLOW_SHARE = 0.5  # of the noise floor: rms that slow torque must have in excess of noise that is flat towards low frequencies
PENALTIES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)  # relative to the mean number of observations of a coefficient
FOLDS = 5  # of the cross-validation
PIECES = 20  # of the recording, in order, that maps must predict from the others
SEVERAL_PIECES = 0.25  # of a map's gain must come from other pieces than the two best in a row: what happens once is no map
ORDERS_TRIED = 2  # of a spectrum that are tried
FINE, ACROSS_ZERO = 40, 31  # nodes of maps over one coordinate: an odd number has one at zero speed
RARE = (0.2, 99.8)  # percentiles of a coordinate beyond which a map is constant
BEYOND_FASTEST = 1.5  # times the fastest speed, up to which a map that grows with speed goes on
MOST_REPEATS = 4000.0  # over the travel, of a map that repeats
SIMPLER = 0.9  # of the best map's explained power is enough for one over fewer coordinates, or of fewer columns
FEWEST_ROWS = 100  # of chunk means: fewer carry no map


@dataclass(frozen=True)
class Structure:
    """What remains in a residual.

    coordinates: of the map, or ("time",). p_value: corrected for all maps. torque_rms: N m, of what the map predicts on
    unseen data (in time: of the excess). share: of the residual's power below the chunks' rate. period: in position, rad, if
    it repeats. table: opposing torque for a learned map; None where nothing predicts.
    """

    coordinates: tuple[str, ...]
    p_value: float
    torque_rms: float
    share: float
    period: float | None
    table: Table | None


@dataclass(frozen=True)
class _Judged:
    """A map after its regression: corrected log p, power (N^2 m^2) predicted on unseen pieces, coefficients."""

    product: Product
    log_p: float
    power: float
    coefficients: np.ndarray
    constant: float  # N m, that goes with them


@dataclass(frozen=True, eq=False)
class _Fold:
    """Rows that are left for maps to predict: where they are, how the base follows the others, what it leaves of them (N m)."""

    left: np.ndarray  # (rows,) bool
    inverse: np.ndarray  # (k, others) of the base
    before: np.ndarray


class _Rows:
    """Rows that maps are fitted to and have to predict, raw and whitened, and a base that is fitted beside the map."""

    def __init__(self, raw: np.ndarray, white: np.ndarray, base: np.ndarray, white_base: np.ndarray) -> None:
        self.white = white  # (rows,) of the residual
        self.base, self.white_base = base, white_base  # (rows, k)
        self.pieces = np.arange(len(white)) * PIECES // len(white)
        self.folds = []
        for fold in range(FOLDS):
            left = self.pieces % FOLDS == fold
            inverse = np.linalg.pinv(white_base[~left], rcond=1e-9)
            self.folds.append(_Fold(left, inverse, raw[left] - base[left] @ (inverse @ white[~left])))

    def predicted(self, raw: np.ndarray, white: np.ndarray, roughness: np.ndarray) -> np.ndarray:
        """For each penalty the power (N^2 m^2) that a map's columns (rows, k) take away on pieces that nothing was fitted to.

        Zero when one piece and the next give nearly all of it: what happens once is no map.
        """
        gains = np.zeros((len(PENALTIES), PIECES))
        for fold in self.folds:
            rest = ~fold.left
            follow = fold.inverse @ white[rest]
            some = white[rest] - self.white_base[rest] @ follow
            normal, scores = some.T @ some, some.T @ self.white[rest]
            fits = np.stack([np.linalg.solve(normal + p * roughness, scores) for p in PENALTIES])
            after = fold.before - fits @ (raw[fold.left] - self.base[fold.left] @ follow).T
            for k, change in enumerate(fold.before**2 - after**2):
                gains[k] += np.bincount(self.pieces[fold.left], change, minlength=PIECES)
        total, most = gains.sum(axis=1), (gains[:, 1:] + gains[:, :-1]).max(axis=1)
        return np.where((total > 0.0) & (total - most > SEVERAL_PIECES * total), total / len(raw), 0.0)


class _SlowResidual:
    """Chunk means of a fit's residual with its own numbers projected out, raw (c,) and whitened (m,)."""

    def __init__(self, balance: TorqueBalance, fit: Fit, noise: NoiseModel) -> None:
        residual = balance.residual(fit.axis, noise)
        self.balance = balance
        self.residual = residual
        self.chunks = ChunkMeans(balance, noise, residual)
        derivatives = balance.derivatives(fit.axis, fit.free, noise, residual)
        for k, number in enumerate(fit.free):
            if number.part is Part.INERTIA:  # beside a map it would take the noise in the acceleration
                derivatives[:, k] = driven_part(noise, derivatives[:, k])
        self.base = np.column_stack([np.ones(self.chunks.count), self.chunks.mean(derivatives)])  # a constant torque is no map
        self.white_base = self.chunks.whiten(self.base)
        norms = np.linalg.norm(self.white_base, axis=0)
        keep = norms > 0.0
        self.base, self.white_base = self.base[:, keep] / norms[keep], self.white_base[:, keep] / norms[keep]
        self.inverse = np.linalg.pinv(self.white_base, rcond=1e-9)
        raw = self.chunks.mean(residual)
        self.mean = raw
        self.raw, self.white = self.project(raw)
        self.floor = noise_floor(balance, residual)
        rows, none = self.chunks.rows, np.zeros((len(self.white), 0))
        self.projected = _Rows(self.raw, self.white, none, none)  # the base has seen all rows
        self.whole = _Rows(raw[rows], self.chunks.whiten(raw), self.base[rows], self.white_base)  # it sees what a map sees

    def project(self, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Raw and whitened rows of chunk means (chunks,) or (chunks, k) without what the base explains."""
        white = self.chunks.whiten(raw)
        amounts = self.inverse @ white
        rows = self.chunks.rows
        return raw[rows] - self.base[rows] @ amounts, white - self.white_base @ amounts

    def constant(self, map_torque: np.ndarray) -> float:
        """The base's constant when a map's chunk means (chunks,) are taken away; it is the first column."""
        return float((self.inverse @ self.chunks.whiten(self.mean - map_torque))[0] * self.base[0, 0])

    def values(self, coordinate: str) -> np.ndarray:
        """A coordinate at the samples of the chunks."""
        return values_of(self.balance.data, coordinate)[self.chunks.samples]


def remaining_structure(balance: TorqueBalance, fit: Fit, noise: NoiseModel) -> Structure | None:
    """The structure that a fit leaves in the train data beside noise like this, or None."""
    slow = _SlowResidual(balance, fit, noise)
    if len(slow.white) < FEWEST_ROWS:
        return None
    products = list(_products(slow))
    judged = side_by_side(lambda pair: _judge(slow, *pair, len(products)), products)
    found = [j for j in judged if j.power > (PREDICTED_SHARE * slow.floor) ** 2]
    if not found:
        return _in_time(slow)
    best = max(j.power for j in found)
    close = (j for j in found if j.power >= SIMPLER * best)
    chosen = min(close, key=lambda j: (len(j.product.coordinates), j.product.count))
    period = 2.0 * math.pi / chosen.product.first.order if isinstance(chosen.product.first, Wave) else None
    return Structure(
        chosen.product.coordinates,
        math.exp(min(0.0, chosen.log_p)),
        math.sqrt(chosen.power),
        min(1.0, chosen.power / float(np.mean(slow.raw**2))),
        period,
        _table(chosen),
    )


def _hats(slow: _SlowResidual, coordinate: str, count: int) -> Hats | None:
    """Hats over what the coordinate does, its rare extremes left out; None if it does not vary."""
    values = slow.values(coordinate)
    lower, upper = (float(x) for x in np.percentile(values, RARE))
    if not upper - lower > 1e-9 * max(abs(lower), abs(upper), 1e-300):
        return None
    return Hats(coordinate, lower, upper, count)


def _products(slow: _SlowResidual) -> Iterator[tuple[Product, float]]:
    """Every map that is looked at, with the number of alternatives that a search looked at to find it.

    The torque is no coordinate: its noise is the residual's own.
    """
    data = slow.balance.data
    others = [*(["temperature"] if data.temperature else []), *(f"exogenous:{name}" for name in data.names)]
    singles: list[tuple[str, int]] = [("position", FINE), ("velocity", ACROSS_ZERO), ("time", FINE)]
    singles += [(name, 16) for name in others]
    for name, count in singles:
        hats = _hats(slow, name, count)
        if hats is not None:
            yield Product(hats, One()), 1.0
    fast = float(np.percentile(np.abs(slow.values("velocity")), RARE[1]))
    speeds: tuple[Basis, ...] = (Odd("velocity", BEYOND_FASTEST * fast), Even("velocity", BEYOND_FASTEST * fast))
    for name, count in [("position", 40), ("time", 30), *((name, 12) for name in others)]:
        hats = _hats(slow, name, count)
        for speed in speeds if hats is not None else ():
            assert hats is not None
            yield Product(hats, speed), 1.0
    pairs = [("position", 20, "velocity", 9), ("position", 16, "time", 12), ("velocity", 11, "time", 12)]
    pairs += [("acceleration", 9, "velocity", 15)]
    pairs += [(name, 9, "velocity", 11) for name in others]
    for one, rows, two, columns in pairs:
        first, second = _hats(slow, one, rows), _hats(slow, two, columns)
        if first is not None and second is not None:
            yield Product(first, second), 1.0
    position = _hats(slow, "position", 2)
    partners: list[Basis | None] = [One(), *speeds, _hats(slow, "velocity", 9), _hats(slow, "time", 40)]
    for partner in partners:
        if position is not None and partner is not None:
            margin = 0.5 * (position.upper - position.lower)  # waves go on where the axis has not been
            lower, upper = position.lower - margin, position.upper + margin
            orders, alternatives = _orders(slow, position, partner)
            for order in orders:
                yield Product(Wave("position", lower, upper, order), partner), alternatives


def _orders(slow: _SlowResidual, position: Hats, partner: Basis) -> tuple[list[float], float]:
    """Orders (rad per unit) at which waves in position times the partner promise most, and how many there are to choose from."""
    q = slow.values("position")
    other = np.zeros(len(q)) if not partner.coordinate else slow.values(partner.coordinate)
    index, value = partner.evaluate(other)
    speed = float(np.median(np.abs(slow.values("velocity"))))
    span = position.upper - position.lower
    highest = min(0.5 * math.pi / slow.chunks.period / max(speed, 1e-300), 2.0 * math.pi * MOST_REPEATS / span)
    lowest = 2.0 * math.pi / span
    if highest <= 2.0 * lowest:
        return [], 1.0
    step = 0.5 * math.pi / highest
    count = int((q.max() - q.min()) / step) + 1
    cell = np.minimum(((q - q.min()) / step).astype(np.int64), count - 1)
    y = slow.chunks.unwhiten(slow.white)
    sums = np.zeros(partner.count * count)
    norms = np.zeros(partner.count)
    for k in range(index.shape[1]):
        sums += np.bincount(index[:, k] * count + cell, value[:, k] * y, minlength=len(sums))
        norms += np.bincount(index[:, k], value[:, k] ** 2, minlength=partner.count)
    length = padded_length(count)
    power = np.abs(np.fft.rfft(sums.reshape(partner.count, count), length, axis=1)) ** 2
    score = np.sum(power / np.maximum(norms, 1e-3 * norms.max())[:, None], axis=0)
    grid = 2.0 * math.pi * np.arange(len(score)) / (length * step)
    inside = (grid >= lowest) & (grid <= highest)
    grid, score = grid[inside], score[inside].copy()
    orders = []
    for _ in range(ORDERS_TRIED):
        peak = int(np.argmax(score))
        orders.append(float(grid[peak]))
        score[np.abs(grid - grid[peak]) < 2.0 * lowest] = 0.0
    return orders, highest / lowest


def _chunks(slow: _SlowResidual, product: Product) -> np.ndarray:
    """Chunk means (chunks, k) of a map's columns."""
    x = slow.values(product.first.coordinate)
    second = product.second.coordinate
    index, value = product.evaluate(x, slow.values(second) if second else np.zeros(len(x)))
    return slow.chunks.scatter(index, value, product.count)


def _judge(slow: _SlowResidual, product: Product, alternatives: float, tests: int) -> _Judged:
    """Regression with every penalty: the best p-value and, where that is significant, the penalty that predicts best."""
    chunks = _chunks(slow, product)
    raw, white = slow.project(chunks)
    normal, scores = white.T @ white, white.T @ slow.white
    roughness = product.roughness() * max(float(np.trace(normal)) / product.count, 1e-300)
    weights, vectors = linalg.eigh(normal, roughness)
    weights = np.maximum(weights, 0.0)
    seen = weights > 1e-9 * max(float(weights[-1]), 1e-300)
    squares = np.where(seen, (vectors.T @ scores) ** 2 / np.where(seen, weights, 1.0), 0.0)
    rest = max(len(slow.white) - int(seen.sum()), 1)
    variance = max(1.0, (float(slow.white @ slow.white) - float(squares.sum())) / rest)
    log_p = min(_log_p(weights / (weights + penalty), squares / variance) for penalty in PENALTIES)
    log_p += math.log(tests * len(PENALTIES) * alternatives)
    if log_p > math.log(MAP_FALSE_ALARM):
        return _Judged(product, log_p, 0.0, np.zeros(product.count), 0.0)
    powers = np.minimum(  # what of a map the base has, too, may go on differently; without a map it may fit the rest less
        slow.projected.predicted(raw, white, roughness),
        slow.whole.predicted(chunks[slow.chunks.rows], slow.chunks.whiten(chunks), roughness),
    )
    penalty = PENALTIES[int(np.argmax(powers))]
    coefficients = np.linalg.solve(normal + penalty * roughness, scores)
    constant = slow.constant(chunks @ coefficients)
    return _Judged(product, log_p, float(powers.max()), coefficients, constant)


def _log_p(share: np.ndarray, squares: np.ndarray) -> float:
    """Log survival of sum(share * squares), squares chi-squared of one each, by a scaled chi-squared of the same two moments."""
    mean, half_variance = float(share.sum()), float((share**2).sum())
    if mean <= 0.0:
        return 0.0
    scale = half_variance / mean
    return float(stats.chi2.logsf(float(share @ squares) / scale, mean / scale))


def _table(judged: _Judged) -> Table:
    """The map as a table; values to five digits."""
    used = [b for b in (judged.product.first, judged.product.second) if b.coordinate]
    values = judged.product.grid(judged.coefficients) + judged.constant
    digits = 5 - math.ceil(math.log10(max(float(np.abs(values).max()), 1e-300)))
    return Table(
        judged.product.coordinates,
        tuple(b.lower for b in used),
        tuple(b.upper for b in used),
        np.round(values, digits),
    )


def _in_time(slow: _SlowResidual) -> Structure | None:
    """Structure in time: slow power in excess of a noise that does not rise towards low frequencies."""
    excess = slow_excess(slow.chunks, slow.residual, slow.raw)
    if math.sqrt(excess.power) < SLOW_SHARE * excess.floor or excess.p_value > MAP_FALSE_ALARM:
        return None
    share = excess.power / float(np.mean(slow.raw**2))
    return Structure(("time",), excess.p_value, math.sqrt(excess.power), share, None, None)
