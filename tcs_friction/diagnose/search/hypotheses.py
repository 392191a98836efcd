"""Every effect of the vocabulary as a hypothesis about the torque residual, and where to start fitting it.

In: a projected residual. Out: `Start`s, best first: one or two effects with values, and the gain that they promise in a joint
fit. Effects linear in an amplitude are judged by their columns, others by the residual that they leave. Orders, frequencies
and places are found by matched filters first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.parameters import amplitudes
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.matched_filter import local_scans, noise_excess, order_spectrum, same_wave
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes, small_amplitude, survey
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Place, Role, Survey, Term, instance

FUNDAMENTAL_GAIN = 0.05  # of a peak's gain, that an order of which it is a harmonic must add
FUNDAMENTAL_SIZE = 0.5  # of the largest harmonic, that the first one must have
FIRST_STEP, PATTERN_ROUNDS = 0.13, 16  # of a pattern search: log units, halved in every round without a gain
PEAKS = 3  # of a spectrum that are tried exactly
PEAK_SPACING = 3  # grid points between two of them: less is one peak
STARTS = 2  # of an effect that are kept
GAIN_PER_NUMBER = 12.0  # about what `chance` asks for each number of an effect that was found among a thousand alternatives


class Kind(NamedTuple):
    """What an effect is, whatever its values: its id and the recorded signal through which it acts."""

    effect: str
    signal: str | None = None


def kind_of(item: Instance) -> Kind:
    """The kind of an effect."""
    return Kind(item.term.id, item.signal)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a joint fit of one more effect, or of two, may start.

    gain: drop of the whitened squares that it promises. count: of free numbers. alternatives: how many were searched through to
    find it. columns (m, k): projected and whitened, of its linear numbers; none where the gain is not linear. noise_excess: how
    much chance gives near its order, over what the noise estimate says.
    """

    instances: tuple[Instance, ...]
    gain: float
    count: int
    alternatives: float
    columns: np.ndarray
    noise_excess: float = 1.0

    @property
    def instance(self) -> Instance:
        """The effect, the first of two."""
        return self.instances[0]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of its effects."""
        return tuple(map(kind_of, self.instances))

    @property
    def promise(self) -> float:
        """The gain in units of the noise near its order."""
        return self.gain / self.noise_excess


def eligible(axis: Axis, balance: TorqueBalance) -> list[tuple[Term, str | None]]:
    """Effects that could be missing, with the recorded signal each would act through."""
    data = balance.data
    present = {kind_of(item) for item in axis.effects}
    result: list[tuple[Term, str | None]] = []
    for term in effects().values():
        if (
            term.tabulated
            or (term.rotary and axis.kind != "rotary")
            or (term.temperature and not data.temperature)
            or _redundant(term, axis)
        ):
            continue
        if term.signals:
            signals = [name for name in data.names if term.suits(name)]
            result += [(term, name) for name in signals if Kind(term.id, name) not in present]
        elif term.periodic or Kind(term.id) not in present:
            result.append((term, None))
    return result


def _redundant(term: Term, axis: Axis) -> bool:
    """Whether an effect completes the friction law by parts that the axis has already."""
    return bool(term.features) and term.features <= axis.features


def all_starts(projected: ProjectedResidual, excluded: frozenset[str] = frozenset()) -> list[Start]:
    """Starts of every effect that could be missing and is not excluded, best promise first."""
    terms = [pair for pair in eligible(projected.axis, projected.balance) if pair[0].id not in excluded]
    found = side_by_side(lambda pair: starts(projected, *pair), terms)
    return sorted(itertools.chain.from_iterable(found), key=lambda start: -start.promise)


def starts(projected: ProjectedResidual, term: Term, signal_name: str | None) -> list[Start]:
    """Promising starts for one effect, best first; more than one where the search has several peaks."""
    view = survey(projected.balance, projected.axis)
    if term.periodic:
        return _periodic_starts(projected, term, view)
    scans = list(term.scan(view))
    alternatives, excess = float(len(scans)), [1.0] * len(scans)
    linear = [p for p in term.parameters if p.role is Role.LINEAR]
    if term.local is not None:
        alternatives *= view.span / min(scan[term.local.width] for scan in scans)
        placed = local_scans(projected, scans, term, term.local)
        scans, excess = [values for values, _ in placed], [more for _, more in placed]
    judge = _judge_linear if linear else _judge_directly
    judged = side_by_side(lambda values: judge(projected, term, values, signal_name, alternatives), scans)
    judged = [s and replace(s, noise_excess=x) for s, x in zip(judged, excess, strict=True)]
    found = sorted((s for s in judged if s is not None and s.gain > 0.0), key=lambda s: GAIN_PER_NUMBER * s.count - s.promise)
    return (_peaks(found) if term.discontinuous else found)[:STARTS]


def _peaks(found: Sequence[Start]) -> list[Start]:
    """Starts, best first, that are better than those beside them along the first shape, within its range."""
    if not found:
        return []
    name = next(p.name for p in found[0].instance.term.parameters if p.role is Role.SHAPE)
    row = sorted(found, key=lambda s: s.instance.values[name])
    inner = [b for a, b, c in zip(row, row[1:], row[2:], strict=False) if a.gain <= b.gain > c.gain]
    return sorted(inner, key=lambda s: -s.gain)


def pattern_search(projected: ProjectedResidual, start: Start) -> Start:
    """The start of an effect whose torque jumps with its shape, after a pattern search over the shape; others as they are."""
    term, signal_name = start.instance.term, start.instance.signal
    if not term.discontinuous or len(start.instances) > 1:
        return start
    names = [p.name for p in term.parameters if p.role is Role.SHAPE]
    step = FIRST_STEP
    for _ in range(PATTERN_ROUNDS):
        shape = {name: start.instance.values[name] for name in names}
        moves = [shape | {name: shape[name] * math.exp(way * step)} for name in names for way in (1, -1)]
        tried = [_judge_linear(projected, term, moved, signal_name, start.alternatives) for moved in moves]
        best = max((s for s in tried if s is not None), key=lambda s: s.gain, default=start)
        if best.gain > start.gain:
            start = best
        else:
            step *= 0.5
    return start


def _judge_linear(
    projected: ProjectedResidual,
    term: Term,
    shape: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
) -> Start | None:
    """The start with the best amplitudes for values of the shape."""
    columns = projected.columns(probes(term, shape, signal_name))
    start = _with_best_amplitudes(projected, term, shape, signal_name, alternatives, columns)
    if start is None or not follows_load(term):
        return start
    return replace(start, gain=min(start.gain, gain_by_load_from_motion(projected, start.instance)))


def follows_load(term: Term) -> bool:
    """Whether an effect scales friction by the logged torque, whose noise is the residual's own."""
    return term.place is Place.SCALE and "torque" in term.reads


def gain_by_load_from_motion(projected: ProjectedResidual, item: Instance) -> float:
    """Gain of friction that follows the load when the load is taken from the motion: noise of the logged torque gives none."""
    column = projected.project(projected.noise.whiten(projected.change_by_load_from_motion(item)))
    gain, sizes = projected.gain(column[:, None])
    return gain if sizes[0] > 0.0 else 0.0


def _with_best_amplitudes(
    projected: ProjectedResidual,
    term: Term,
    shape: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
    columns: np.ndarray,
) -> Start | None:
    """The start with the best amplitudes for the probes' columns (m, k); None where they do nothing or cannot be."""
    norms = np.linalg.norm(columns, axis=0)
    keep = norms > 1e-9 * max(float(norms.max()), 1e-300)
    if not keep.any() or norms.max() == 0.0:
        return None
    gain, sizes = projected.gain(columns[:, keep] / norms[keep])
    multiples = np.zeros(len(norms))
    multiples[keep] = sizes / norms[keep]
    if _forbidden_sign(term, multiples):
        return None
    item = _with_multiples(term, shape, signal_name, multiples)
    kept = _single_precision(columns[:, keep] / norms[keep])
    return Start((item,), gain, int(keep.sum()) + len(shape), alternatives, kept)


def _single_precision(columns: np.ndarray) -> np.ndarray:
    """Columns to be kept while all hypotheses are compared: half the memory, and gains need no more."""
    return columns.astype(np.float32)


def _forbidden_sign(term: Term, multiples: np.ndarray) -> bool:
    """Whether the effect's only linear number has a sign that its declaration forbids."""
    linear = [p for p, phase in amplitudes(term.parameters) if p.role is Role.LINEAR and phase is None]
    return len(linear) == len(multiples) == 1 and linear[0].lower == 0.0 and multiples[0] <= 0.0


def _with_multiples(
    term: Term, shape: Mapping[str, float], signal_name: str | None, multiples: np.ndarray
) -> Instance:
    """The instance whose linear numbers are the probes' multiples."""
    values, numbers = dict(shape), iter(multiples)
    for parameter, phase in amplitudes(term.parameters):
        if parameter.role is not Role.LINEAR:
            continue
        value = next(numbers) * small_amplitude(parameter.unit)
        if phase is not None:
            sine = next(numbers) * small_amplitude(parameter.unit)
            values[phase.name] = math.atan2(sine, value) % (2.0 * math.pi)
            value = math.hypot(value, sine)
        values[parameter.name] = min(max(value, parameter.lower), parameter.upper)
    return instance(term, values, signal=signal_name)


def _judge_directly(
    projected: ProjectedResidual,
    term: Term,
    values: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
) -> Start | None:
    """The start of an effect without an amplitude, by the residual that it leaves."""
    item = instance(term, values, signal=signal_name)
    change = projected.change_by_body(item) if term.resonates else projected.change(item)
    left = projected.project(projected.noise.whiten(projected.residual + change))
    gain = projected.squares - float(left @ left)
    return Start((item,), gain, len(values), alternatives, np.empty((len(left), 0)))


def _periodic_starts(projected: ProjectedResidual, term: Term, view: Survey) -> list[Start]:
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
            start = None if order < grid[0] else _wave_start(projected, term, order, alternatives)
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


def _wave_start(
    projected: ProjectedResidual, term: Term, order: float, alternatives: float
) -> Start | None:
    """The start of a wave of this order, None where the axis has that wave."""
    values = {term.order.name: order}
    wave = probes(term, values, None)
    present = (same_wave(projected.balance, projected.axis, wave[0], item) for item in projected.axis.effects)
    if any(present):
        return None
    columns = projected.columns(wave)
    start = _with_best_amplitudes(projected, term, values, None, alternatives, columns)
    return None if start is None else _without_idle_harmonics(projected, start, columns)


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
    shape = {p.name: start.instance.values[p.name] for p in term.parameters if p.role is Role.SHAPE}
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
    item = _with_multiples(term, shape, start.instance.signal, multiples)
    kept_columns = _single_precision(columns[:, _pairs(kept)])
    return Start((item,), gain, 2 * len(kept) + 1, start.alternatives, kept_columns)


def _pairs(waves: Sequence[int]) -> list[int]:
    """Columns of the cosine and sine of some waves."""
    return [column for k in waves for column in (2 * k, 2 * k + 1)]


def pairs_of_starts(projected: ProjectedResidual, found: Sequence[Start]) -> list[Start]:
    """Pairs of starts that promise more together than the two apart, best first.

    Two effects may hide each other: a bias and an imbalance over a short travel, say. One at a time, neither shows.
    """
    linear = list({start.kinds: start for start in reversed(found) if start.columns.shape[1]}.values())
    ends = np.cumsum([0, *(start.columns.shape[1] for start in linear)])
    columns = [start.columns for start in linear]
    white = projected.white.astype(np.float32)
    gram = np.block([[a.T @ b for b in columns] for a in columns]) if linear else np.empty((0, 0))
    scores = np.concatenate([a.T @ white for a in columns]) if linear else np.empty(0)
    number = math.comb(max(len(linear), 2), 2)
    result = []
    for i, j in itertools.combinations(range(len(linear)), 2):
        one, two = linear[i], linear[j]
        if one.instance.term is two.instance.term:
            continue
        both = [*range(ends[i], ends[i + 1]), *range(ends[j], ends[j + 1])]
        sizes = np.linalg.lstsq(gram[np.ix_(both, both)], -scores[both], rcond=1e-8)[0]
        gain = float(-scores[both] @ sizes)
        if gain > one.gain + two.gain:
            result.append(
                Start(
                    one.instances + two.instances,
                    gain,
                    one.count + two.count,
                    number * one.alternatives * two.alternatives,
                    np.empty((0, 0)),
                    max(one.noise_excess, two.noise_excess),
                )
            )
    return sorted(result, key=lambda start: -start.promise)
