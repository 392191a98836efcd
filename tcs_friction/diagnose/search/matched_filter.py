"""Matched filters: what a wave or a local effect promises for all orders, frequencies or places at once.

In: a projected residual and an effect. Out: the expected gain of the effect over a grid of orders (per turn), frequencies (Hz) or
places. With the adjoint-whitened residual y, a carrier c (the effect's torque per unit of its shape) and phases p(t),

    gain(k) = 2 |sum_t c y exp(-i k p)|^2 / N(k)        N(k): whitened squares of the carrier at order k

N(k) follows from the whitening filter's gain at the frequencies at which the wave was passed (Lomb 1976 for y(t) with even
steps).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage, optimize

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.noise import NoiseModel
from tcs_friction.diagnose.fit.parameters import small_amplitude
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Local, Place, Role, Survey, Term

MOST_PERIODS = 3e4  # over the travel, of the highest order searched: bounds the length of the transform
OVERSAMPLING = 4  # of the transform: the best order is met within a quarter of its resolution
NEIGHBOURHOOD = 2.0  # Hz, over which a local excess of the noise is estimated
FEWEST_NEIGHBOURS = 101  # grid points of that estimate, so that no single line is its median
FEWEST_PERIODS = 5.0  # of a wave in time: fewer do not show that it repeats
ONE_WAVE = 0.5  # periods over the recording, by which the phases of one and the same wave part at most
PLACED = 0.01  # steps of a spectrum's grid, to which a strong line is placed: a ten-thousandth of its power stays
SPEED_BINS = 80  # logarithmic, of the speeds at which a wave was passed
NORM_POINTS = 400  # logarithmic, at which the norm is computed; it is smooth over the order
LEAST_NORM = 1e-3  # of the largest norm: orders that the whitening removes are not divided by nothing
CELLS_PER_WIDTH = 4.0  # of a local effect, and how many widths its shape is followed
SHAPE_CELLS = np.arange(-12, 13)
LOCAL_STARTS = 6
CHI_SQUARED_MEDIAN = 0.455  # of one degree of freedom
EVERYWHERE = 1e12  # rad, a width beside which any travel is nothing


def order_spectrum(
    projected: ProjectedResidual, term: Term, view: Survey
) -> tuple[np.ndarray, np.ndarray, float]:
    """Expected gain over orders (per turn) or frequencies (Hz): grid (m,), gain (m,), number of independent alternatives.

    The carrier is the effect's own torque at its longest period.
    """
    balance, noise = projected.balance, projected.noise
    score = noise.unwhiten(projected.white)
    if term.periodic == "time":
        return _time_spectrum(balance, noise, score, view)
    cycle = projected.axis.cycle
    position = balance.data.joined("position") * cycle
    speed = np.abs(balance.data.joined("velocity")) * cycle
    span = view.span * cycle
    lowest, highest = term.orders(2.0 * math.pi / span, projected.axis.kind == "rotary")
    highest = min(highest, _highest_order(span, view, cycle))
    if highest <= lowest:
        return np.zeros(0), np.zeros(0), 1.0
    alternatives = max((highest - lowest) * span / math.pi, 1.0)
    carrier = _carrier(projected, term, {term.order.name: term.order.lower})
    bands = []
    while highest > lowest:
        seen = speed * highest * balance.data.dt < math.pi  # samples of a wave passed faster would feign a slow one
        band = (max(0.5 * highest, lowest), highest)
        visible = np.where(seen, carrier, 0.0)
        bands.append(_order_band(noise, position, speed, visible, score, band))
        highest *= 0.5
    grid, gain = (np.concatenate(x[::-1]) for x in zip(*bands, strict=True))
    return grid, gain, alternatives


def same_wave(balance: TorqueBalance, axis: Axis, one: Instance, other: Instance) -> bool:
    """Whether two periodic effects are one wave: over the recording their phases part by less than ONE_WAVE periods.

    Of two of a kind the first harmonics count. One over time and one over the position are one where the axis moves steadily.
    """
    if not (one.term.periodic and other.term.periodic):
        return False
    if one.term is other.term:
        return _in_step(balance, axis, one, other, [[item.order] for item in (one, other)])
    return one.term.periodic != other.term.periodic and in_step(balance, axis, one, other)


def in_step(balance: TorqueBalance, axis: Axis, one: Instance, other: Instance) -> bool:
    """Whether any harmonics of two periodic effects part by less than ONE_WAVE periods over the recording."""
    return _in_step(balance, axis, one, other, [_orders(item) for item in (one, other)])


def _in_step(
    balance: TorqueBalance, axis: Axis, one: Instance, other: Instance, orders: Sequence[Sequence[float]]
) -> bool:
    first, second = (wave_angle(balance, axis, item.term)[balance.train] for item in (one, other))
    return any(
        float(np.ptp(k * first - m * second)) < 2.0 * math.pi * ONE_WAVE for k, m in itertools.product(*orders)
    )


def wave_angle(balance: TorqueBalance, axis: Axis, term: Term) -> np.ndarray:
    """Angle (n,) of a wave of order one, or of 1 Hz, rad."""
    if term.periodic == "time":
        return np.asarray(2.0 * math.pi * balance.data.joined("t"))
    return np.asarray(axis.cycle * balance.data.joined("position"))


def _orders(item: Instance) -> list[float]:
    """Orders, or frequencies, of a periodic effect's harmonics."""
    waves = enumerate(item.term.harmonics, 1)
    return [item.order * number for number, wave in waves if item.values[wave.amplitude.name] != 0.0]


def _order_band(
    noise: NoiseModel,
    position: np.ndarray,
    speed: np.ndarray,
    carrier: np.ndarray,
    score: np.ndarray,
    band: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Orders of a band and the gain that each promises, from samples (n,): phase at order 1, its speed, carrier, score."""
    step = math.pi / band[1] / 2.0
    count = int(float(np.ptp(position)) / step) + 1
    index = np.minimum(((position - position.min()) / step).astype(np.int64), count - 1)
    binned = np.bincount(index, score * carrier, minlength=count)
    length = padded_length(count)
    grid = 2.0 * math.pi * np.arange(length // 2) / (length * step)
    sums = np.abs(np.fft.rfft(binned, length)[: length // 2]) ** 2
    chosen = (grid >= band[0]) & (grid < band[1])
    grid, sums = grid[chosen], sums[chosen]
    if not len(grid) or not carrier[noise.samples.train].any():
        return grid, np.zeros(len(grid))
    return grid, 2.0 * sums / _wave_norm(noise, carrier, speed, grid)


def padded_length(count: int) -> int:
    """Length of a transform of `count` values that oversamples the spectrum: a power of two."""
    return 1 << (OVERSAMPLING * count - 1).bit_length()


def _highest_order(span: float, view: Survey, cycle: float) -> float:
    """The order whose frequency at the usual speeds is the last one with a signal."""
    middle = math.sqrt(view.slow * view.fast) * cycle
    highest = 2.0 * math.pi * view.cutoff / max(middle, 1e-300)
    return min(highest, 2.0 * math.pi * MOST_PERIODS / span)


def _carrier(projected: ProjectedResidual, term: Term, flat: Mapping[str, float]) -> np.ndarray:
    """Torque of the effect per unit of its shape, (n,), from values at which the shape is flat."""
    if term.place is Place.SENSOR:
        velocity = projected.balance.data.joined("velocity")
        return np.asarray(projected.axis.inertia * velocity**2)  # inertia times the second derivative of a wave
    unit = next(p for p in term.parameters if p.role is Role.LINEAR).unit
    return np.asarray(projected.change(probes(term, flat, None)[0]) / small_amplitude(unit))


def _wave_norm(noise: NoiseModel, carrier: np.ndarray, speed: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Whitened squares of the wave at each order, from the whitening's gain at the frequencies at which it was passed."""
    mask, dt = noise.samples.train, noise.samples.dt
    fastest = float(speed.max())
    edges = np.geomspace(max(fastest * 1e-5, 1e-300), fastest * 1.0001, SPEED_BINS)
    power = np.bincount(
        np.digitize(speed[mask], edges), carrier[mask] ** 2 * noise.local_weight[mask], minlength=SPEED_BINS + 1
    )
    centres = np.concatenate([[0.0], np.sqrt(edges[1:] * edges[:-1]), [edges[-1]]])
    coarse = np.geomspace(max(grid[0], 1e-9 * grid[-1]), grid[-1], NORM_POINTS)
    norm = np.zeros(len(coarse))
    for share, centre in zip(power, centres, strict=True):
        if share > 0.0:
            norm += share * noise.whitening.squared_gain(coarse * centre / (2.0 * math.pi), dt)
    norm = np.interp(grid, coarse, norm)
    return np.maximum(norm, max(LEAST_NORM * float(norm.max()), 1e-300))


def _time_spectrum(
    balance: TorqueBalance, noise: NoiseModel, score: np.ndarray, view: Survey
) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies (m,), Hz, the gain that each promises, and the number of independent ones."""
    t, dt = balance.data.joined("t"), balance.data.dt
    count = round((t.max() - t.min()) / dt) + 1
    index = np.minimum(np.round((t - t.min()) / dt).astype(np.int64), count - 1)
    series = np.bincount(index, score, minlength=count)
    length = padded_length(count)
    grid = np.arange(length // 2) / (length * dt)
    chosen = (grid >= FEWEST_PERIODS / view.duration) & (grid <= 1.2 * view.cutoff)
    sums = np.abs(np.fft.rfft(series, length)[: length // 2][chosen]) ** 2
    weight = float(np.sum(noise.local_weight[balance.train]))
    norm = weight * noise.whitening.squared_gain(grid[chosen], dt)
    return grid[chosen], 2.0 * sums / np.maximum(norm, 1e-300), 2.0 * view.duration * view.cutoff


def noise_excess(
    projected: ProjectedResidual, term: Term, view: Survey, grid: np.ndarray, gain: np.ndarray
) -> np.ndarray:
    """Factor (m,), at least one, by which chance gives more near each frequency than the noise estimate says.

    A noise spectrum that is too smooth for a narrow resonance of the noise shows here, and a wave that is none over time. So
    would a strong line, which the gaps of held-out data spread over its neighbourhood: the strongest is taken out first.
    """
    if len(grid) < 2:
        return _excess(grid, gain)
    strongest = int(np.argmax(gain))
    line = np.linalg.qr(_line(projected, term, float(grid[strongest]), float(grid[1] - grid[0])))[0]
    rest = projected.noise.unwhiten(projected.white - line @ (line.T @ projected.white))
    return _excess(grid, _time_spectrum(projected.balance, projected.noise, rest, view)[1])


def _line(projected: ProjectedResidual, term: Term, frequency: float, step: float) -> np.ndarray:
    """Projected columns (m, 2) of the wave that takes away most, within a step of a frequency: beside it, a strong one stays."""

    def columns(at: float) -> np.ndarray:
        return projected.columns(probes(term, {term.order.name: at}, None))

    within, exactly = (frequency - step, frequency + step), {"xatol": PLACED * step}
    found = optimize.minimize_scalar(
        lambda at: -projected.gain(columns(at))[0], bounds=within, method="bounded", options=exactly
    )
    return columns(float(found.x))


def _excess(grid: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Running median of a spectrum of gains over that of a chi-squared of two, at least one."""
    width = max(round(NEIGHBOURHOOD / (grid[1] - grid[0])), FEWEST_NEIGHBOURS) if len(grid) > 1 else 1
    return np.asarray(
        np.maximum(ndimage.median_filter(gain, width, mode="nearest") / (2.0 * math.log(2.0)), 1.0)
    )


def local_scans(
    projected: ProjectedResidual, scans: Sequence[Mapping[str, float]], term: Term, place: Local
) -> list[tuple[Mapping[str, float], float]]:
    """The best centres for each width, by a matched filter over binned positions, and by how much chance gives more there."""
    carrier = _carrier(projected, term, {**scans[0], place.centre: 0.0, place.width: EVERYWHERE})
    found = [one for scan in scans for one in _best_centres(projected, scan, term, place, carrier)]
    return [(values, excess) for _, values, excess in sorted(found, key=lambda one: -one[0])[:LOCAL_STARTS]]


def _best_centres(
    projected: ProjectedResidual, scan: Mapping[str, float], term: Term, place: Local, carrier: np.ndarray
) -> list[tuple[float, Mapping[str, float], float]]:
    """The two best centres for one width: gain over chance, values, and by how much chance gives more than the noise estimate.

    Places differ by more than the torque's noise where a model is not exact. How much they do, the median of all places tells
    once the best one is taken out. `carrier` (n,): the effect's torque where its shape is one.
    """
    balance, noise, width = projected.balance, projected.noise, scan[place.width]
    position, step = balance.data.joined("position"), width / CELLS_PER_WIDTH
    index = ((position - position.min()) / step).astype(np.int64)
    shape = np.exp(-((SHAPE_CELLS / CELLS_PER_WIDTH) ** 2))
    power = np.where(balance.train, carrier**2 * noise.local_weight, 0.0)
    speed = float(np.sqrt(np.mean(balance.data.joined("velocity")[balance.train] ** 2)))
    passing = np.array(speed / (2.0 * math.pi * width))
    norms = np.convolve(np.bincount(index, power), shape**2, mode="same")
    norms = norms * float(noise.whitening.squared_gain(passing, noise.samples.dt))
    seen = norms > LEAST_NORM * norms.max()

    def gains(white: np.ndarray) -> np.ndarray:
        """Expected gain at each place for a projected residual (m,)."""
        sums = np.convolve(np.bincount(index, noise.unwhiten(white) * carrier), shape, mode="same")
        return np.where(seen, sums**2 / np.maximum(norms, 1e-300), 0.0)

    gain = gains(projected.white)
    best = np.argsort(gain)[::-1][:2]
    starts = [{**scan, place.centre: float(position.min() + step * (k + 0.5))} for k in best]
    own = np.linalg.qr(projected.columns(probes(term, starts[0], None)))[0]
    rest = gains(projected.white - own @ (own.T @ projected.white))[seen]
    excess = max(float(np.median(rest)) / CHI_SQUARED_MEDIAN, 1.0) if len(rest) else 1.0
    return [(float(gain[k]) / excess, start, excess) for k, start in zip(best, starts, strict=True)]
