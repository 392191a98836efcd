"""Matched filters: where over position or time an effect promises most, for all orders or places at once.

Each order or place is normalised by what the whitening leaves of it at the speeds at which it was passed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.fit.parameters import pairs
from tcs_friction.diagnose.search.projection import Background, probe, unit_size
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place, Role, Survey, Term

PERIODS = 4.0  # over the travel, that make a torque periodic
MOST_PERIODS = 3e4  # over the travel, of the highest order searched
EXCESS_WIDTH = 2.0  # Hz
APART = 0.5  # periods over the recording
SPREAD = 2.0  # times the noise estimate, from which a strong line is looked at as a cause of what is beside it


def spectrum(background: Background, term: Term, view: Survey) -> tuple[np.ndarray, np.ndarray, float]:
    """Expected gain over orders (per turn) or frequencies (Hz): grid (m,), gain (m,), number of independent looks.

    The carrier, what multiplies the wave, is the effect's own torque at its longest period.
    """
    balance = background.balance
    y = balance.unwhiten(background.white)
    if term.periodic == "time":
        return _time_spectrum(balance, y, view)
    cycle = background.axis.cycle
    position = balance.data.joined("position") * cycle
    speed = np.abs(balance.data.joined("velocity")) * cycle
    span = view.span * cycle
    lowest, highest = _order_range(term, span, view, cycle)
    if highest <= lowest:
        return np.zeros(0), np.zeros(0), 1.0
    looks = max((highest - lowest) * span / math.pi, 1.0)
    carrier = _carrier(background, term, {term.parameters[0].name: term.parameters[0].lower})
    bands = []
    while highest > lowest:
        seen = speed * highest * balance.data.dt < math.pi  # samples of a wave passed faster would pretend a slow one
        bands.append(
            _order_spectrum(balance, position, speed, np.where(seen, carrier, 0.0), y, (max(0.5 * highest, lowest), highest))
        )
        highest *= 0.5
    grid, gain = (np.concatenate(x[::-1]) for x in zip(*bands, strict=True))
    return grid, gain, looks


def same_wave(balance: Balance, axis: Axis, one: Instance, other: Instance) -> bool:
    """Whether two periodic effects are one wave: over the recording their phases part by less than APART periods.

    Of two of a kind the first harmonics count. One over time and one over the position are one where the axis moves steadily.
    """
    items = (one, other)
    if not (one.term.periodic and other.term.periodic):
        return False
    if one.term is other.term:
        orders = [[item.values[item.term.parameters[0].name]] for item in items]
    elif one.term.periodic != other.term.periodic:
        orders = [_orders(item) for item in items]
    else:
        return False
    angles = [angle(balance, axis, item.term)[balance.train] for item in items]
    return any(
        float(np.ptp(k * angles[0] - m * angles[1])) < 2.0 * math.pi * APART for k, m in itertools.product(*orders)
    )


def angle(balance: Balance, axis: Axis, term: Term) -> np.ndarray:
    """Angle (n,) of a wave of order one, or of 1 Hz, rad."""
    if term.periodic == "time":
        return np.asarray(2.0 * math.pi * balance.data.joined("t"))
    return np.asarray(axis.cycle * balance.data.joined("position"))


def _orders(item: Instance) -> list[float]:
    """Orders, or frequencies, of a periodic effect's harmonics."""
    waves = [p for p, phase in pairs(item.term.parameters) if phase is not None]
    first = item.values[item.term.parameters[0].name]
    return [first * number for number, p in enumerate(waves, 1) if item.values[p.name] != 0.0]


def _order_spectrum(
    balance: Balance, position: np.ndarray, speed: np.ndarray, carrier: np.ndarray, y: np.ndarray, band: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Orders of a band and the gain that each promises, from samples (n,): phase at order 1, its speed, carrier, score."""
    step = math.pi / band[1] / 2.0
    count = int(float(np.ptp(position)) / step) + 1
    index = np.minimum(((position - position.min()) / step).astype(np.int64), count - 1)
    binned = np.bincount(index, y * carrier, minlength=count)
    length = 1 << (4 * count - 1).bit_length()
    grid = 2.0 * math.pi * np.arange(length // 2) / (length * step)
    sums = np.abs(np.fft.rfft(binned, length)[: length // 2]) ** 2
    chosen = (grid >= band[0]) & (grid < band[1])
    grid, sums = grid[chosen], sums[chosen]
    if not len(grid) or not carrier[balance.train].any():
        return grid, np.zeros(len(grid))
    return grid, 2.0 * sums / _local_norm(balance, carrier, speed, grid)


def _order_range(term: Term, span: float, view: Survey, cycle: float) -> tuple[float, float]:
    """Lowest order: a period fits into the travel; highest: its frequency at the usual speeds has a signal."""
    once = 2.0 * math.pi / span
    middle = math.sqrt(view.slow * view.fast) * cycle
    highest = 2.0 * math.pi * view.cutoff / max(middle, 1e-300)
    highest = min(highest, 2.0 * math.pi * MOST_PERIODS / span)
    if term.id == "position_dependent_friction":
        return max(0.5 * once, 0.0), min(12.0 * max(once, 1.0), highest)
    return max(PERIODS * once, 1.5 if cycle == 1.0 else 0.0), highest


def _carrier(background: Background, term: Term, flat: Mapping[str, float]) -> np.ndarray:
    """Torque of the effect per unit of its shape, (n,), from values at which the shape is flat."""
    if term.place is Place.SENSOR:
        return np.asarray(background.axis.inertia * background.balance.data.joined("velocity") ** 2)
    unit = next(p for p in term.parameters if p.role is Role.LINEAR).unit
    return np.asarray(background.column(probe(term, flat, None, 1.0)[0]) / unit_size(unit))


def _local_norm(balance: Balance, carrier: np.ndarray, speed: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Whitened squared norm of the wave at each order, from the whitening's gain at the frequencies of its passing."""
    mask = balance.train
    edges = np.geomspace(max(float(speed.max()) * 1e-5, 1e-300), float(speed.max()) * 1.0001, 80)
    power = np.bincount(
        np.digitize(speed[mask], edges), carrier[mask] ** 2 * balance.local_weight[mask], minlength=81
    )
    centres = np.concatenate([[0.0], np.sqrt(edges[1:] * edges[:-1]), [edges[-1]]])
    coarse = np.geomspace(max(grid[0], 1e-9 * grid[-1]), grid[-1], 400)
    norm = np.zeros(len(coarse))
    for share, centre in zip(power, centres, strict=True):
        if share > 0.0:
            norm += share * balance.whitening_gain(coarse * centre / (2.0 * math.pi))
    norm = np.interp(grid, coarse, norm)
    return np.maximum(norm, max(1e-3 * float(norm.max()), 1e-300))


def _time_spectrum(balance: Balance, y: np.ndarray, view: Survey) -> tuple[np.ndarray, np.ndarray, float]:
    t = balance.data.joined("t")
    dt = balance.data.dt
    count = round((t.max() - t.min()) / dt) + 1
    index = np.minimum(np.round((t - t.min()) / dt).astype(np.int64), count - 1)
    series = np.bincount(index, y, minlength=count)
    length = 1 << (4 * count - 1).bit_length()
    grid = np.arange(length // 2) / (length * dt)
    chosen = (grid >= 5.0 / view.duration) & (grid <= 1.2 * view.cutoff)
    sums = np.abs(np.fft.rfft(series, length)[: length // 2][chosen]) ** 2
    weight = float(np.sum(balance.local_weight[balance.train]))
    norm = weight * balance.whitening_gain(grid[chosen])
    return grid[chosen], 2.0 * sums / np.maximum(norm, 1e-300), 2.0 * view.duration * view.cutoff


def excess(background: Background, term: Term, view: Survey, grid: np.ndarray, score: np.ndarray) -> np.ndarray:
    """By how much chance gives more near each frequency (m,) than the noise estimate says, at least one.

    A noise spectrum that is too smooth for a narrow resonance of the noise shows here, and a wave that is none over time. So
    would a strong line, which the gaps of held-out data spread over its neighbourhood: the strongest is taken out first.
    """
    found = _excess(grid, score)
    strongest = int(np.argmax(score))
    if found[strongest] < SPREAD:
        return found
    line = background.columns(probe(term, {term.parameters[0].name: float(grid[strongest])}, None, 1.0))
    line = np.linalg.qr(line)[0]
    rest = background.balance.unwhiten(background.white - line @ (line.T @ background.white))
    return _excess(grid, _time_spectrum(background.balance, rest, view)[1])


def _excess(grid: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Running median of a spectrum of gains over what its chi-squared of two would have, at least one."""
    width = max(round(EXCESS_WIDTH / (grid[1] - grid[0])), 101) if len(grid) > 1 else 1
    return np.asarray(
        np.maximum(ndimage.median_filter(score, width, mode="nearest") / (2.0 * math.log(2.0)), 1.0)
    )


def local_scans(
    background: Background, scans: Sequence[Mapping[str, float]], term: Term
) -> list[Mapping[str, float]]:
    """The best centres for each width, by a matched filter over binned positions."""
    balance = background.balance
    carrier = _carrier(background, term, {"centre": 0.0, "width": 1e12})
    position = balance.data.joined("position")
    y = balance.unwhiten(background.white) * carrier
    power = np.where(balance.train, carrier**2 * balance.local_weight, 0.0)
    speed = float(np.sqrt(np.mean(balance.data.joined("velocity")[balance.train] ** 2)))
    found: list[tuple[float, Mapping[str, float]]] = []
    for scan in scans:
        width = scan["width"]
        step = width / 4.0
        index = ((position - position.min()) / step).astype(np.int64)
        shape = np.exp(-((np.arange(-12, 13) / 4.0) ** 2))
        sums = np.convolve(np.bincount(index, y), shape, mode="same")
        norms = np.convolve(np.bincount(index, power), shape**2, mode="same")
        norms = norms * float(balance.whitening_gain(np.array(speed / (2.0 * math.pi * width))))
        score = np.where(norms > 1e-3 * norms.max(), sums**2 / np.maximum(norms, 1e-300), 0.0)
        for best in np.argsort(score)[::-1][:2]:
            found.append(
                (float(score[best]), {"centre": float(position.min() + step * (best + 0.5)), "width": width})
            )
    return [values for _, values in sorted(found, key=lambda pair: -pair[0])[:6]]
