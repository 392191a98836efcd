"""Atlas of a residual: over which coordinates it lives, how surely, how much of it, and where.

In: the residual (n,) of an axis, N m. Out: an `AtlasEntry` for each coordinate that varies.

Every coordinate is cut into bins of equal data; the means of all bins are one regression on whitened chunk means, so that
autocorrelated noise gives uniform p-values without permutations. Periods come from spectra over position and time, with their
number of independent orders as Bonferroni's factor. A constant belongs to no coordinate but the direction: it shows in the
other curves, not in their statistics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, stats

from tcs_friction.diagnose.dataset.coordinates import unit_of, values_of
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.noise import NoiseModel
from tcs_friction.diagnose.fit.noise_estimate import noise_spectrum, with_spectrum
from tcs_friction.diagnose.remainder.chunk_means import NOISE_LEEWAY, ChunkMeans, Regression, regress
from tcs_friction.diagnose.search.matched_filter import padded_length
from tcs_friction.physics.axis import Axis

BINS = 32  # of a coordinate at most
CHUNKS_PER_BIN = 40  # at least: its mean then scatters by a sixth of the noise
WIDE = 4  # fluctuations on either side of an edge that are searched for a quiet place; bins are twice as wide
FLUCTUATION_SECONDS = 2.0  # faster changes of a speed or torque count as fluctuations
CLEAR = 4.0  # standard errors by which a bin must differ to belong to the range
NAMED_BELOW = 1e-3  # p-value below which a range or period is named
BANDS = 200  # of the spectrum
RANGE_SHARE = 0.9  # of the power in excess of the noise, that the range of frequencies holds
LINE = 5.0  # resolutions, that a line is narrower than with one on either side
LINE_NEIGHBOURS = 401  # points of a spectrum, oversampled fourfold, whose median is the usual power beside a line
MOST_ORDERS = 2000  # independent ones in the travel of a spectrum at most


@dataclass(frozen=True, eq=False)
class AtlasEntry:
    """The residual over one coordinate.

    statistic: F of the bin means (chi-squared of two over the noise for a period). p_value: valid for autocorrelated noise,
    all alternatives at this coordinate counted. share: of the residual's power, 0 to 1, without what noise alone explains.
    range: smallest that holds the bins that differ, None if that is everywhere or nowhere. period: rad, m or s, None if it
    does not repeat. x, mean, band (k,): centres of the bins, mean residual in N m (N) and its 95 % half width.
    """

    coordinate: str
    unit: str
    statistic: float
    p_value: float
    share: float
    range: tuple[float, float] | None
    period: float | None
    x: np.ndarray
    mean: np.ndarray
    band: np.ndarray


def atlas(
    balance: TorqueBalance, noise: NoiseModel, axis: Axis, residual: np.ndarray
) -> tuple[AtlasEntry, ...]:
    """Where a torque residual (n,) of an axis lives; train data only, what does not vary is left out."""
    chunks = ChunkMeans(balance, noise, residual)
    if len(chunks.rows) < 2 * CHUNKS_PER_BIN:
        return ()
    data = balance.data
    made = {"direction": _direction(balance), "time_since_reversal": time_since_reversal(balance)}
    recorded = [*(["temperature"] if data.temperature else []), *(f"exogenous:{name}" for name in data.names)]
    names = ["time", "position", "velocity", "direction", "acceleration", "torque", "time_since_reversal", *recorded]
    coordinates = {name: made[name] if name in made else values_of(data, name) for name in names}
    entries = [_entry(chunks, residual, name, unit_of(name, axis), x) for name, x in coordinates.items()]
    found = [_with_period(balance, noise, entry, residual) for entry in entries if entry is not None]
    return (*found, _frequency(balance, residual))


def _direction(balance: TorqueBalance) -> np.ndarray:
    """Sign of the velocity where it is known, 0 elsewhere."""
    velocity = balance.data.joined("velocity")
    return np.asarray(np.sign(velocity) * (balance.data.moving()))


def time_since_reversal(balance: TorqueBalance) -> np.ndarray:
    """Seconds (n,) since the direction last changed, or since the stretch began."""
    parts = []
    for s, direction in zip(
        balance.data.stretches, np.split(_direction(balance), balance.samples.ends[1:-1]), strict=True
    ):
        t = s.t[:: balance.data.stride]
        known = np.flatnonzero(direction)
        changed = known[1:][direction[known[1:]] != direction[known[:-1]]]
        last = np.zeros(len(t), np.int64)
        last[changed] = changed
        parts.append(t - t[np.maximum.accumulate(last)])
    return np.concatenate(parts)


def _entry(
    chunks: ChunkMeans, residual: np.ndarray, name: str, unit: str, values: np.ndarray
) -> AtlasEntry | None:
    """Bin means of one coordinate as one whitened regression; None when it does not vary."""
    x = values[chunks.samples]
    bins = max(2, min(BINS, len(chunks.rows) // CHUNKS_PER_BIN))
    if name == "direction":
        edges = np.array([-1.5, -0.5, 0.5, 1.5])
    elif name in ("velocity", "acceleration", "torque"):
        edges = _quiet_edges(x, bins, round(FLUCTUATION_SECONDS / chunks.balance.data.dt))
    else:
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    counts = np.histogram(x, edges)[0]
    if np.count_nonzero(counts) < 2:
        return None
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    raw = chunks.scatter(index[:, None], np.ones((len(x), 1)), len(counts))[:, counts > 0]
    centres = (np.bincount(index, x, minlength=len(counts)) / np.maximum(counts, 1))[counts > 0]
    columns, white = chunks.whiten(raw), chunks.whiten(chunks.mean(residual))
    means = regress(columns, white)
    constant = chunks.whiten(np.ones(chunks.count))
    constant = constant / np.linalg.norm(constant)
    if name == "direction":  # equal friction both ways has been fitted: what they share is the asymmetry
        constant = 0.0 * constant
    fit = regress(columns - np.outer(constant, constant @ columns), white - constant * (constant @ white))
    deviation = np.sqrt(np.diag(means.covariance))
    keep = counts[counts > 0] >= 2 * chunks.width if name != "direction" else centres != 0.0
    return AtlasEntry(
        name,
        unit,
        fit.statistic,
        math.exp(fit.log_p),
        _share(raw[chunks.rows], fit, residual[chunks.balance.train], name != "direction"),
        _range(edges[:-1][counts > 0], edges[1:][counts > 0], means) if fit.log_p < math.log(NAMED_BELOW) else None,
        None,
        centres[keep],
        means.coefficients[keep],
        1.96 * deviation[keep],
    )


def _quiet_edges(x: np.ndarray, bins: int, window: int) -> np.ndarray:
    """Edges of bins for what torque noise itself moves: wide against its fluctuations, and where values are rare.

    Bins finer than the noise would sort the residual by its own sign.
    """
    fluctuation = x - ndimage.uniform_filter1d(x, max(window, 3))
    power = ndimage.uniform_filter1d(fluctuation**2, max(window, 3))
    scale = max(math.sqrt(float(np.median(power))), 1e-6 * float(np.ptp(x)), 1e-300)
    quantiles = np.quantile(x, np.linspace(0.0, 1.0, bins + 1))
    ordered = np.sort(x)
    edges = [quantiles[0]]
    for target in quantiles[1:-1]:
        tried = target + scale * np.arange(-WIDE, WIDE + 1)
        density = np.searchsorted(ordered, tried + scale) - np.searchsorted(ordered, tried - scale)
        edge = float(tried[int(np.argmin(density))])
        if edge - edges[-1] >= 2 * WIDE * scale and quantiles[-1] - edge >= 2 * WIDE * scale:
            edges.append(edge)
    return np.array([*edges, quantiles[-1]])


def _share(raw: np.ndarray, fit: Regression, residual: np.ndarray, centre: bool) -> float:
    """Power of the fitted bin means less what noise puts there, over that of the residual; without their constant if wanted."""
    centred = raw - raw.mean(axis=0) if centre else raw
    power = float(np.mean((centred @ fit.coefficients) ** 2))
    noise = float(np.sum(fit.covariance * (centred.T @ centred))) / len(raw)
    total = max(float(np.var(residual) if centre else np.mean(residual**2)), 1e-300)
    return min(1.0, max(0.0, (power - noise) / total))


def _range(lower: np.ndarray, upper: np.ndarray, means: Regression) -> tuple[float, float] | None:
    """Where bins differ from the median of all; None if that is nowhere or most of the coordinate."""
    deviation = np.sqrt(np.diag(means.covariance))
    if len(lower) < 4:
        return None
    clear = np.flatnonzero(
        np.abs(means.coefficients - np.median(means.coefficients)) > CLEAR * np.maximum(deviation, 1e-300)
    )
    if len(clear) == 0:
        return None
    here = (float(lower[clear[0]]), float(upper[clear[-1]]))
    return None if clear[-1] - clear[0] + 1 > 0.7 * len(lower) else here


def _with_period(
    balance: TorqueBalance, noise: NoiseModel, entry: AtlasEntry, residual: np.ndarray
) -> AtlasEntry:
    """Position: the entry with its period where a spectrum shows more than the bins do."""
    if entry.coordinate != "position":
        return entry
    own = with_spectrum(balance, noise, residual)
    period, statistic, p_value, share = _position_line(balance, own, residual)
    combined = min(1.0, 2.0 * min(entry.p_value, p_value))
    if p_value > NAMED_BELOW or share < entry.share:
        return replace(entry, p_value=combined)
    return replace(entry, p_value=combined, statistic=statistic, share=share, period=period, range=None)


def _position_line(
    balance: TorqueBalance, noise: NoiseModel, residual: np.ndarray
) -> tuple[float, float, float, float]:
    """Strongest period in position: the period, its chi-squared of two, p-value over all orders, share of the power."""
    q = balance.data.joined("position")
    white = noise.whiten(residual)
    span = float(np.ptp(q[balance.train]))
    moving = np.abs(balance.data.joined("velocity"))
    speed = max(float(np.median(moving[balance.train])), 1e-300)
    highest = min(2.0 * math.pi * balance.data.cutoff / speed, 2.0 * math.pi * MOST_ORDERS / span)
    lowest = 2.0 * math.pi / span
    if highest < 2.0 * lowest:
        return 0.0, 0.0, 1.0, 0.0
    constant = noise.whiten(np.ones(len(residual)))
    white = white - constant * float(constant @ white) / float(constant @ constant)
    step = 0.5 * math.pi / highest
    cell = ((q - q.min()) / step).astype(np.int64)
    binned = np.bincount(cell, noise.unwhiten(white))
    length = padded_length(len(binned))
    power = np.abs(np.fft.rfft(binned, length)) ** 2
    grid = 2.0 * math.pi * np.arange(len(power)) / (length * step)
    usual = ndimage.median_filter(power, LINE_NEIGHBOURS, mode="nearest")
    power = np.where((grid >= lowest) & (grid <= highest), power / np.maximum(usual, 1e-6 * usual.max()), 0.0)
    nearby = float(grid[int(np.argmax(power))]) + lowest * np.linspace(-0.2, 0.2, 21)
    sums = np.abs(np.exp(1j * np.outer(nearby, step * np.arange(len(binned)))) @ binned)
    order = float(nearby[int(np.argmax(sums))])
    waves = np.stack([np.cos(order * q), np.sin(order * q)], axis=1)
    columns = noise.whiten(waves)
    columns = columns - np.outer(constant, constant @ columns) / float(constant @ constant)
    amplitudes = np.linalg.lstsq(columns, white, rcond=None)[0]
    gain = float(white @ (columns @ amplitudes))
    variance = (float(white @ white) - gain) / balance.samples.effective_count
    statistic = gain / variance
    p_value = min(1.0, highest / lowest * float(stats.chi2.sf(statistic, 2)))
    fitted = waves[balance.train] @ amplitudes
    share = float(np.var(fitted) / max(np.var(residual[balance.train]), 1e-300))
    share *= max(0.0, 1.0 - 2.0 / max(statistic, 2.0))
    return 2.0 * math.pi / order, statistic, p_value, min(1.0, share)


def _frequency(balance: TorqueBalance, residual: np.ndarray) -> AtlasEntry:
    """The spectrum where it exceeds the noise's, in lines or in whole bands; the curve is it, N m per sqrt(Hz).

    The range holds RANGE_SHARE of that excess but for what gaps spread; one line has a period.
    """
    grid, power, filled = _whole_spectrum(balance, residual)
    resolution = float(grid[0]) / filled
    noise = np.interp(grid, *noise_spectrum(balance, residual))
    noise *= max(1.0, float(np.median(power / noise)) / math.log(2.0))  # a noise that is louder at times
    ratio = power / noise
    bands = np.array_split(np.arange(len(grid)), min(BANDS, len(grid)))
    wide = np.array([stats.gamma.logsf(filled * ratio[b].sum() / NOISE_LEEWAY, filled * len(b)) for b in bands])
    narrow = -ratio / NOISE_LEEWAY
    log_p = min(0.0, math.log(2.0) + min(wide.min() + math.log(len(bands)), narrow.min() + math.log(len(grid))))
    clear = ndimage.binary_dilation(narrow + math.log(len(grid) / NAMED_BELOW) < 0.0, iterations=2)
    for band, level in zip(bands, wide, strict=True):
        clear[band] |= level + math.log(len(bands) / NAMED_BELOW) < 0.0
    excess = np.where(clear, power - noise, 0.0)
    share, where, period = 0.0, None, None
    if log_p < math.log(NAMED_BELOW) and excess.sum() > 0.0:
        share = float(excess.sum() / power.sum())
        first, last = _narrowest(np.cumsum(excess), RANGE_SHARE * filled)
        where = (max(float(grid[first]) - resolution, 0.0), float(grid[last]) + resolution)
        if where[0] > 0.0 and where[1] - where[0] < LINE * resolution:
            period = 1.0 / float(grid[int(np.argmax(excess))])
    density = np.sqrt([power[b].mean() for b in bands])
    errors = np.array([1.96 / math.sqrt(4.0 * len(b)) for b in bands])
    return AtlasEntry(
        "frequency",
        "Hz",
        float(ratio.max()),
        math.exp(log_p),
        share,
        where,
        period,
        np.array([grid[b].mean() for b in bands]),
        density,
        density * errors,
    )


def _whole_spectrum(balance: TorqueBalance, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies below the cutoff (m,), Hz, power density there, N^2 m^2/Hz, and how much of their length the stretches fill.

    The train data of each stretch as long as the longest one, gaps zero.
    """
    dt, mean, length = balance.data.dt, residual[balance.train].mean(), max(s.stop - s.start for s in balance.samples.stretches)
    grid = np.fft.rfftfreq(length, dt)
    energy, counts = np.zeros(len(grid)), []
    for stretch in balance.samples.stretches:
        train = balance.train[stretch]
        energy += np.abs(np.fft.rfft(np.where(train, residual[stretch] - mean, 0.0), length)) ** 2
        counts.append(np.count_nonzero(train))
    inside = (grid > 0.0) & (grid <= balance.data.cutoff)
    filled = float(sum(n * n for n in counts) / (length * sum(counts)))
    return grid[inside], 2.0 * dt * energy[inside] / sum(counts), filled


def _narrowest(total: np.ndarray, share: float) -> tuple[int, int]:
    """First and last index of the narrowest interval that holds a share of a running total (m,) of what is not negative."""
    total = np.maximum.accumulate(total)
    begins = np.concatenate([[0.0], total[:-1]])
    ends = np.searchsorted(total, begins + share * total[-1])
    width = np.where(ends < len(total), ends - np.arange(len(total)), len(total))
    first = int(np.argmin(width))
    return first, int(min(ends[first], len(total) - 1))
