"""Every effect of the vocabulary as a hypothesis about the torque residual, and where to start fitting it.

A hypothesis is judged jointly with the base parameters: what retuning explains is projected out of residual and columns first.
Effects linear in an amplitude are judged by their columns, others by the residual that they leave. Orders, frequencies and
places are found by matched filters first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.fit.parameters import pairs
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.matched_filter import excess, local_scans, same_wave, spectrum
from tcs_friction.diagnose.search.projection import Background, probe, survey, unit_size
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Place, Role, Survey, Term, instance

SUBMULTIPLE = 0.05  # of a peak's gain, that an order of which it is a harmonic must add
LEADING = 0.5  # of the largest harmonic, that the first one must have
CLIMB_FROM, CLIMBS = 0.13, 16  # first step of a pattern search, log units, and its rounds
PEAKS = 3  # of a spectrum that are tried exactly


@dataclass(frozen=True, eq=False)
class Start:
    """Where a joint fit of one more effect, or of two, may start; `gain` is the drop of the whitened squares that it promises."""

    instances: tuple[Instance, ...]
    gain: float
    count: int  # of free numbers
    looks: float  # how many alternatives were looked at to find it
    columns: np.ndarray  # (rows, k) projected and whitened, of its linear numbers; none where the gain is not linear
    excess: float = 1.0  # how much chance gives near its order, over what the noise estimate says

    @property
    def instance(self) -> Instance:
        """The effect, the first of two."""
        return self.instances[0]

    @property
    def name(self) -> str:
        """Ids, with the signals they act through."""
        return "+".join(map(name_of, self.instances))


def name_of(item: Instance) -> str:
    """An effect's id, with the signal it acts through."""
    return item.term.id + (f":{item.signal}" if item.signal else "")


def eligible(axis: Axis, balance: Balance) -> list[tuple[Term, str | None]]:
    """Effects that could be missing, with the recorded signal each would act through."""
    data, law = balance.data, axis.friction.term
    names = {p.name for p in law.parameters}
    bristles = law.states != 0 or any(e.term.id == "presliding" for e in axis.effects)
    present = {(e.term.id, e.signal) for e in axis.effects}
    result: list[tuple[Term, str | None]] = []
    for term in effects().values():
        if (
            term.tabulated
            or (term.rotary and axis.kind != "rotary")
            or (term.temperature and not data.temperature)
        ):
            continue
        if (term.id == "stribeck" and "static" in names) or (term.id == "presliding" and bristles):
            continue
        if term.signals:
            result += [(term, s) for s in data.names if _fits(term.id, s) and (term.id, s) not in present]
        elif term.periodic or (term.id, None) not in present:
            result.append((term, None))
    return result


def _fits(term: str, name: str) -> bool:
    """Wind torque wants a wind; another axis' acceleration wants anything else; plain signals are always possible."""
    windy = any(word in name.lower() for word in ("wind", "gust", "anemo"))
    return {"wind_torque": windy, "cross_axis_coupling": not windy}.get(term, True)


def starts(background: Background, term: Term, signal_name: str | None) -> list[Start]:
    """Promising starts for one effect, best first; more than one where the search has several peaks."""
    view = survey(background.balance, background.axis)
    if term.periodic:
        return _periodic_starts(background, term, view)
    scans = list(term.scan(view))
    looks = float(len(scans))
    linear = [p for p in term.parameters if p.role is Role.LINEAR]
    if term.local:
        looks *= view.span / min(scan["width"] for scan in scans)
        scans = local_scans(background, scans, term)
    judge = _judge_linear if linear else _judge_directly
    judged = side_by_side(lambda values: judge(background, term, values, signal_name, looks), scans)
    found = sorted((s for s in judged if s is not None and s.gain > 0.0), key=lambda s: -s.gain)
    if term.jagged:
        found = _peaks(found)
    return found[:2]


def _peaks(found: Sequence[Start]) -> list[Start]:
    """Starts, best first, that are better than those beside them along the first shape, within its range."""
    if not found:
        return []
    name = next(p.name for p in found[0].instance.term.parameters if p.role is Role.SHAPE)
    row = sorted(found, key=lambda s: s.instance.values[name])
    inner = [b for a, b, c in zip(row, row[1:], row[2:], strict=False) if a.gain <= b.gain > c.gain]
    return sorted(inner, key=lambda s: -s.gain)


def climbed(background: Background, start: Start) -> Start:
    """A jagged effect's start after a pattern search over its shape: CLIMBS rounds, steps from CLIMB_FROM down (log units)."""
    term, signal_name = start.instance.term, start.instance.signal
    if not term.jagged or len(start.instances) > 1:
        return start
    names = [p.name for p in term.parameters if p.role is Role.SHAPE]
    step = CLIMB_FROM
    for _ in range(CLIMBS):
        shape = {name: start.instance.values[name] for name in names}
        moves = [shape | {name: shape[name] * math.exp(way * step)} for name in names for way in (1, -1)]
        tried = [_judge_linear(background, term, moved, signal_name, start.looks) for moved in moves]
        best = max((s for s in tried if s is not None), key=lambda s: s.gain, default=start)
        if best.gain > start.gain:
            start = best
        else:
            step *= 0.5
    return start


def _judge_linear(
    background: Background, term: Term, values: Mapping[str, float], signal_name: str | None, looks: float
) -> Start | None:
    items = probe(term, values, signal_name, 1.0)
    start = _judged(background, term, values, signal_name, looks, background.columns(items))
    if start is None or not follows_load(term):
        return start
    return replace(start, gain=min(start.gain, gain_by_motion(background, start.instance)))


def follows_load(term: Term) -> bool:
    """Whether an effect scales friction by the logged torque, whose noise is the residual's own."""
    return term.place is Place.SCALE and "torque" in term.reads


def gain_by_motion(background: Background, item: Instance) -> float:
    """Gain of friction that follows the load when its column is made from the motion: noise of the logged torque gives none."""
    column = background.project(background.balance.whiten(background.column_by_motion(item)))
    gain, amplitudes = background.gain(column[:, None])
    return gain if amplitudes[0] > 0.0 else 0.0


def _judged(
    background: Background,
    term: Term,
    values: Mapping[str, float],
    signal_name: str | None,
    looks: float,
    columns: np.ndarray,
) -> Start | None:
    """The start with the best amplitudes for the probes' columns (rows, k)."""
    norms = np.linalg.norm(columns, axis=0)
    keep = norms > 1e-9 * max(float(norms.max()), 1e-300)
    if not keep.any() or norms.max() == 0.0:
        return None
    gain, amplitudes = background.gain(columns[:, keep] / norms[keep])
    full = np.zeros(len(norms))
    full[keep] = amplitudes / norms[keep]
    if _impossible(term, full):
        return None
    item = _with_amplitudes(term, values, signal_name, full)
    return Start((item,), gain, int(keep.sum()) + len(values), looks, _thrifty(columns[:, keep] / norms[keep]))


def _thrifty(columns: np.ndarray) -> np.ndarray:
    """Columns to be kept, in single precision."""
    return columns.astype(np.float32)


def _impossible(term: Term, amplitudes: np.ndarray) -> bool:
    """Whether the effect's only linear number has a sign that its declaration forbids."""
    linear = [p for p, phase in pairs(term.parameters) if p.role is Role.LINEAR and phase is None]
    return len(linear) == len(amplitudes) == 1 and linear[0].lower == 0.0 and amplitudes[0] <= 0.0


def _with_amplitudes(
    term: Term, values: Mapping[str, float], signal_name: str | None, amplitudes: np.ndarray
) -> Instance:
    """The instance whose linear numbers are the probes' multiples."""
    chosen, numbers = dict(values), iter(amplitudes)
    for p, phase in pairs(term.parameters):
        if p.role is not Role.LINEAR:
            continue
        value = next(numbers) * unit_size(p.unit)
        if phase is not None:
            other = next(numbers) * unit_size(p.unit)
            chosen[phase.name] = math.atan2(other, value) % (2.0 * math.pi)
            value = math.hypot(value, other)
        chosen[p.name] = min(max(value, p.lower), p.upper)
    return instance(term, chosen, signal=signal_name)


def _judge_directly(
    background: Background, term: Term, values: Mapping[str, float], signal_name: str | None, looks: float
) -> Start | None:
    item = instance(term, values, signal=signal_name)
    column = background.swung(item) if term.swings else background.column(item)
    changed = background.project(background.balance.whiten(background.residual + column))
    gain = background.squares - float(changed @ changed)
    return Start((item,), gain, len(values), looks, np.empty((len(changed), 0)))


def _periodic_starts(background: Background, term: Term, view: Survey) -> list[Start]:
    grid, score, looks = spectrum(background, term, view)
    if not len(grid):
        return []
    name = term.parameters[0].name
    in_time = term.periodic == "time"
    spread = excess(background, term, view, grid, score) if in_time else np.ones(len(score))
    tries: list[int] = []
    spacing = 3
    for index in np.argsort(score / spread)[::-1]:
        if all(abs(int(index) - other) > spacing for other in tries):
            tries.append(int(index))
        if len(tries) == PEAKS:
            break
    found: list[Start] = []
    for index in tries:
        order = float(grid[index])
        harmonics = max(1, sum(p.role is Role.PHASE for p in term.parameters)) if not found else 1
        own: Start | None = None
        for fundamental in (order / m for m in range(1, harmonics + 1)):
            values = {name: fundamental}
            wave = probe(term, values, None, 1.0)
            known = (same_wave(background.balance, background.axis, wave[0], item) for item in background.axis.effects)
            if fundamental < grid[0] or any(known):
                continue
            columns = background.columns(wave)
            start = _judged(background, term, values, None, looks, columns)
            if start is None:
                continue
            start = replace(_pruned(background, start, columns), excess=float(spread[index]))
            if own is None or (start.gain > (1.0 + SUBMULTIPLE) * own.gain and _leads(start.instance)):
                found.append(start)
            own = own or start
    return sorted(found, key=lambda start: 12.0 * start.count - start.gain / start.excess)[:2]


def _leads(item: Instance) -> bool:
    """Whether the first amplitude of an effect is no less than LEADING of its largest one: its harmonics are harmonics."""
    sizes = [item.values[p.name] for p, phase in pairs(item.term.parameters) if phase is not None]
    return sizes[0] >= LEADING * max(sizes)


def _pruned(background: Background, start: Start, columns: np.ndarray) -> Start:
    """Without harmonics that do not earn their two numbers; `columns` (rows, k) of all probes."""
    values = dict(start.instance.values)
    term = start.instance.term
    names = [
        (p.name, phase.name)
        for p, phase in pairs(term.parameters)
        if p.role is Role.LINEAR and phase is not None
    ]
    if len(names) == 1:
        return start
    shape = {p.name: values[p.name] for p in term.parameters if p.role is Role.SHAPE}
    kept = list(range(len(names)))
    need = 2.0 * math.log(max(len(background.white), 2)) * dispersion(background)
    while len(kept) > 1:
        gain, _ = background.gain(columns[:, [c for k in kept for c in (2 * k, 2 * k + 1)]])
        losses = []
        for k in kept:
            rest = [c for j in kept if j != k for c in (2 * j, 2 * j + 1)]
            losses.append(gain - background.gain(columns[:, rest])[0])
        weakest = int(np.argmin(losses))
        if losses[weakest] > need:
            break
        kept.pop(weakest)
    chosen = [c for k in kept for c in (2 * k, 2 * k + 1)]
    gain, some = background.gain(columns[:, chosen])
    amplitudes = np.zeros(2 * len(names))
    amplitudes[chosen] = some
    item = _with_amplitudes(term, shape, start.instance.signal, amplitudes)
    return Start((item,), gain, 2 * len(kept) + 1, start.looks, _thrifty(columns[:, chosen]))


def dispersion(background: Background) -> float:
    """Whitened squares per effective sample, at least one: how much larger than its estimate the noise is."""
    return max(1.0, background.squares / background.balance.effective_count)


def all_starts(background: Background, barred: frozenset[str] = frozenset()) -> list[Start]:
    """Starts of every effect that could be missing, best promise first."""
    terms = [(t, name) for t, name in eligible(background.axis, background.balance) if t.id not in barred]
    found = side_by_side(lambda pair: starts(background, *pair), terms)
    return sorted(itertools.chain.from_iterable(found), key=lambda start: -start.gain / start.excess)


def together(background: Background, found: Sequence[Start]) -> list[Start]:
    """Pairs of starts that promise more together than the two apart, best first.

    Two effects may hide each other: a bias and an imbalance over a short travel, say. One at a time, neither shows.
    """
    linear = list({start.name: start for start in reversed(found) if start.columns.shape[1]}.values())
    ends = np.cumsum([0, *(start.columns.shape[1] for start in linear)])
    columns = [start.columns for start in linear]
    white = background.white.astype(np.float32)
    gram = np.block([[a.T @ b for b in columns] for a in columns]) if linear else np.empty((0, 0))
    scores = np.concatenate([a.T @ white for a in columns]) if linear else np.empty(0)
    looks = math.comb(max(len(linear), 2), 2)
    result = []
    for i, j in itertools.combinations(range(len(linear)), 2):
        one, two = linear[i], linear[j]
        if one.instance.term is two.instance.term:
            continue
        both = [*range(ends[i], ends[i + 1]), *range(ends[j], ends[j + 1])]
        amplitudes = np.linalg.lstsq(gram[np.ix_(both, both)], -scores[both], rcond=1e-8)[0]
        gain = float(-scores[both] @ amplitudes)
        if gain > one.gain + two.gain:
            excess, count = max(one.excess, two.excess), one.count + two.count
            items = one.instances + two.instances
            result.append(Start(items, gain, count, looks * one.looks * two.looks, np.empty((0, 0)), excess))
    return sorted(result, key=lambda start: -start.gain / start.excess)
