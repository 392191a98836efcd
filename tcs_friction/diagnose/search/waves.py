"""Where to start fitting waves: at the peaks of a spectrum over position or time, or at orders of which these are harmonics.

In: a projected residual and a periodic effect. Out: its `Start`s, best first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tcs_friction.diagnose.search.matched_filter import noise_excess, order_spectrum, same_wave, wave_angle
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes
from tcs_friction.diagnose.search.start import (
    GAIN_PER_NUMBER,
    STARTS,
    Start,
    single_precision,
    with_best_amplitudes,
    with_multiples,
)
from tcs_friction.physics.terms import Instance, Place, Survey, Term

FUNDAMENTAL_GAIN = 0.05  # of a peak's gain, that an order of which it is a harmonic must add
FUNDAMENTAL_SIZE = 0.5  # of the largest harmonic, that the first one must have
BESIDE_TORQUE = 0.5  # of the gain of a wave of friction, that it must gain beside a torque with the same wave
PEAKS = 3  # of a spectrum that are tried exactly
PEAK_SPACING = 3  # grid points between two of them: less is one peak


def periodic_starts(projected: ProjectedResidual, term: Term, view: Survey) -> list[Start]:
    """Starts at the highest peaks of a spectrum, and at orders of which these are harmonics."""
    grid, gain, alternatives = order_spectrum(projected, term, view)
    if not len(grid):
        return []
    in_time = term.periodic == "time"
    excess = noise_excess(projected, term, view, grid, gain) if in_time else np.ones(len(gain))
    found: list[Start] = []
    for index in _highest_peaks(gain / excess):
        harmonics = max(1, len(term.harmonics)) if not found else 1
        own: Start | None = None
        for divisor in range(1, harmonics + 1):
            order = float(grid[index]) / divisor
            start = None if order < grid[0] else wave_start(projected, term, order, alternatives)
            if start is None:
                continue
            start = replace(start, noise_excess=float(excess[index]))
            if own is None or (start.gain > (1.0 + FUNDAMENTAL_GAIN) * own.gain and _leads(start.instance)):
                found.append(start)
            own = own or start
    return sorted(found, key=lambda start: GAIN_PER_NUMBER * start.count - start.promise)[:STARTS]


def _highest_peaks(gain: np.ndarray) -> list[int]:
    """Indices of the highest peaks of a spectrum, highest first."""
    peaks: list[int] = []
    for index in np.argsort(gain)[::-1]:
        if all(abs(int(index) - other) > PEAK_SPACING for other in peaks):
            peaks.append(int(index))
        if len(peaks) == PEAKS:
            break
    return peaks


def wave_start(
    projected: ProjectedResidual, term: Term, order: float, alternatives: float
) -> Start | None:
    """The start of a wave of this order, None where the axis has that wave."""
    values = {term.order.name: order}
    wave = probes(term, values, None)
    present = (same_wave(projected.balance, projected.axis, wave[0], item) for item in projected.axis.effects)
    if any(present):
        return None
    columns = projected.columns(wave)
    start = with_best_amplitudes(projected, term, values, None, alternatives, columns)
    return None if start is None else _without_idle_harmonics(projected, start, columns)


def told_from_torque(projected: ProjectedResidual, start: Start) -> bool:
    """Whether a wave of friction keeps half its gain beside a torque with the same wave: in motion one way they are the same."""
    item = start.instance
    if item.term.place is not Place.SCALE or item.term.periodic != "position":
        return True
    angle = item.order * wave_angle(projected.balance, projected.axis, item.term)
    torque = np.stack([projected.noise.whiten(wave(angle)) for wave in (np.cos, np.sin)], axis=1)
    basis = np.linalg.qr(projected.project(torque))[0]
    beside, _ = projected.gain(start.columns - basis @ (basis.T @ start.columns))
    return beside > BESIDE_TORQUE * start.gain


def _leads(item: Instance) -> bool:
    """Whether the first amplitude of an effect is large enough beside its largest for its harmonics to be harmonics."""
    sizes = [item.values[harmonic.amplitude.name] for harmonic in item.term.harmonics]
    return sizes[0] >= FUNDAMENTAL_SIZE * max(sizes)


def _without_idle_harmonics(projected: ProjectedResidual, start: Start, columns: np.ndarray) -> Start:
    """The start without harmonics that do not earn their two numbers (BIC); `columns` (m, k) of all probes."""
    term = start.instance.term
    waves = term.harmonics
    if len(waves) == 1:
        return start
    shape = start.instance.shape
    kept = list(range(len(waves)))
    needed = 2.0 * math.log(max(len(projected.white), 2)) * projected.dispersion
    while len(kept) > 1:
        gain, _ = projected.gain(columns[:, _pairs(kept)])
        losses = [gain - projected.gain(columns[:, _pairs([j for j in kept if j != k])])[0] for k in kept]
        weakest = int(np.argmin(losses))
        if losses[weakest] > needed:
            break
        kept.pop(weakest)
    gain, sizes = projected.gain(columns[:, _pairs(kept)])
    multiples = np.zeros(2 * len(waves))
    multiples[_pairs(kept)] = sizes
    item = with_multiples(term, shape, start.instance.signal, multiples)
    kept_columns = single_precision(columns[:, _pairs(kept)])
    return Start((item,), gain, 2 * len(kept) + 1, start.alternatives, kept_columns)


def _pairs(waves: Sequence[int]) -> list[int]:
    """Columns of the cosine and sine of some waves."""
    return [column for k in waves for column in (2 * k, 2 * k + 1)]
