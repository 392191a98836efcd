"""Every effect of the vocabulary as a hypothesis about the torque residual, and where to start fitting it.

A hypothesis is judged jointly with the base parameters: what retuning explains is projected out of residual and columns first.
Effects linear in an amplitude are judged by their columns, others by the residual that they leave. Orders and frequencies come
from one spectrum over position or time: a matched filter for every order at once, each normalised by what
the whitening leaves of it at the speeds at which it was passed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.balance import Balance, Free, at_bound, pairs
from tcs_friction.diagnose.side_by_side import side_by_side
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Place, Role, Survey, Term, instance

PERIODS = 4.0  # over the travel, that make a torque periodic
MOST_PERIODS = 3e4  # over the travel, of the highest order searched
EXCESS_WIDTH = 2.0  # Hz
SUBMULTIPLE = 0.05  # of a peak's gain, that an order of which it is a harmonic must add
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


class Background:
    """The residual of an axis with everything that its own parameters can explain projected out.

    Attributes: axis, free numbers, residual (n,), its whitened and projected part (rows,), orthonormal base (rows, k).
    """

    def __init__(self, balance: Balance, axis: Axis, free: Sequence[Free]) -> None:
        self.balance = balance
        self.axis = axis
        self.free = list(free)
        self.residual = balance.residual(axis)
        base = balance.jacobian(axis, self.free, self.residual)
        kept = (
            np.linalg.norm(base, axis=0) * [not at_bound(axis, self.free, k) for k in range(len(self.free))]
            > 0.0
        )
        base = base[:, kept] / np.linalg.norm(base[:, kept], axis=0)
        left, singular, _ = np.linalg.svd(base, full_matrices=False)
        self.base = np.ascontiguousarray(left[:, singular > 1e-9 * singular[0]]) if base.size else base
        self.white = self.project(balance.whiten(self.residual))
        self.squares = float(self.white @ self.white)

    def project(self, x: np.ndarray) -> np.ndarray:
        """x (rows,) or (rows, k) without what the base parameters explain."""
        return np.asarray(x - self.base @ (self.base.T @ x))

    def column(self, item: Instance) -> np.ndarray:
        """Change of the residual (n,) when the effect is added as it is."""
        return np.asarray(self.balance.residual(self.axis.with_effect(item), remember=False) - self.residual)

    def columns(self, items: Sequence[Instance]) -> np.ndarray:
        """Those of several effects (rows, k), whitened and projected."""
        return self.project(np.stack([self.balance.whiten(self.column(item)) for item in items], axis=1))

    def gain(self, columns: np.ndarray) -> tuple[float, np.ndarray]:
        """Drop of squares for projected whitened columns (rows, k), and the amplitudes (k,) that give it."""
        gram = columns.T @ columns
        amplitudes = np.linalg.lstsq(gram, -(columns.T @ self.white), rcond=1e-12)[0]
        return float(-(columns.T @ self.white) @ amplitudes), amplitudes


def survey(balance: Balance, axis: Axis) -> Survey:
    """What the recordings can show."""
    data = balance.data
    position, speed = data.joined("position"), np.abs(data.joined("velocity"))
    moving = speed[speed > 3.0 * data.velocity_noise]
    moving = moving if len(moving) > 20 else speed
    values = axis.friction.values
    stiffness = values.get("stiffness", math.inf)
    begin = min(float(s.t[0]) for s in data.stretches)
    end = max(float(s.t[-1]) for s in data.stretches)
    return Survey(
        travel=(float(position.min()), float(position.max())),
        slow=float(np.percentile(moving, 5)),
        fast=float(np.percentile(moving, 99)),
        start=begin,
        duration=end - begin,
        cutoff=data.cutoff,
        resolution=data.position_noise,
        inertia=axis.inertia,
        level=values["coulomb"],
        bristle=values["coulomb"] / stiffness,
    )


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


def probe(term: Term, values: Mapping[str, float], signal_name: str | None, size: float) -> list[Instance]:
    """One instance per linear number of the effect, each with only that number at `size`."""
    result = []
    linear = [(p, phase) for p, phase in pairs(term.parameters) if p.role is Role.LINEAR]
    for p, phase in linear:
        off = {q.name: 0.0 for q, _ in linear}
        for angle in (0.0, 0.5 * math.pi) if phase else (0.0,):
            chosen = {**off, **values, p.name: size * _unit_size(p.unit)}
            result.append(instance(term, chosen | ({phase.name: angle} if phase else {}), signal=signal_name))
    return result


def _unit_size(unit: str) -> float:
    """A small amplitude for effects that are only nearly linear in it."""
    return {"": 0.01, "1/degC": 0.001, "rad": 1e-7}.get(unit, 1.0)


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
        scans = _local_scans(background, scans, term)
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
    return _judged(background, term, values, signal_name, looks, background.columns(probe(term, values, signal_name, 1.0)))


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
        value = next(numbers) * _unit_size(p.unit)
        if phase is not None:
            other = next(numbers) * _unit_size(p.unit)
            chosen[phase.name] = math.atan2(other, value) % (2.0 * math.pi)
            value = math.hypot(value, other)
        chosen[p.name] = min(max(value, p.lower), p.upper)
    return instance(term, chosen, signal=signal_name)


def _judge_directly(
    background: Background, term: Term, values: Mapping[str, float], signal_name: str | None, looks: float
) -> Start | None:
    item = instance(term, values, signal=signal_name)
    changed = background.project(background.balance.whiten(background.residual + background.column(item)))
    gain = background.squares - float(changed @ changed)
    return Start((item,), gain, len(values), looks, np.empty((len(changed), 0)))


def _local_scans(
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


def _periodic_starts(background: Background, term: Term, view: Survey) -> list[Start]:
    grid, score, looks = spectrum(background, term, view)
    if not len(grid):
        return []
    name = term.parameters[0].name
    excess = _excess(grid, score) if term.periodic == "time" else np.ones(len(score))
    tries: list[int] = []
    spacing = 3
    for index in np.argsort(score / excess)[::-1]:
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
            if fundamental < grid[0]:
                continue
            values = {name: fundamental}
            columns = background.columns(probe(term, values, None, 1.0))
            start = _judged(background, term, values, None, looks, columns)
            if start is None:
                continue
            start = replace(_pruned(background, start, columns), excess=float(excess[index]))
            if own is None or start.gain > (1.0 + SUBMULTIPLE) * own.gain:
                found.append(start)
            own = own or start
    return sorted(found, key=lambda start: 12.0 * start.count - start.gain / start.excess)[:2]


def _excess(grid: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Running median of a spectrum of gains over what its chi-squared of two would have, at least one.

    A noise spectrum that is too smooth for a narrow resonance of the noise shows here; a line and its side lobes are narrower.
    """
    width = max(round(EXCESS_WIDTH / (grid[1] - grid[0])), 101) if len(grid) > 1 else 1
    return np.asarray(
        np.maximum(ndimage.median_filter(score, width, mode="nearest") / (2.0 * math.log(2.0)), 1.0)
    )


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


def spectrum(background: Background, term: Term, view: Survey) -> tuple[np.ndarray, np.ndarray, float]:
    """Expected gain over orders (per turn) or frequencies (Hz): grid (m,), gain (m,), number of independent looks.

    The carrier, what multiplies the wave, is the effect's own torque at its longest period.
    """
    balance = background.balance
    y = balance.unwhiten(background.white)
    if term.periodic == "time":
        return _time_spectrum(background, y, view)
    cycle = background.axis.cycle
    position = balance.data.joined("position") * cycle
    speed = np.abs(balance.data.joined("velocity")) * cycle
    span = view.span * cycle
    lowest, highest = _order_range(term, span, view, cycle)
    if highest <= lowest:
        return np.zeros(0), np.zeros(0), 1.0
    carrier = _carrier(background, term, {term.parameters[0].name: term.parameters[0].lower})
    step = math.pi / highest / 2.0
    count = int(span / step) + 1
    index = np.minimum(((position - position.min()) / step).astype(np.int64), count - 1)
    binned = np.bincount(index, y * carrier, minlength=count)
    length = 1 << (4 * count - 1).bit_length()
    grid = 2.0 * math.pi * np.arange(length // 2) / (length * step)
    sums = np.abs(np.fft.rfft(binned, length)[: length // 2]) ** 2
    chosen = (grid >= lowest) & (grid <= highest)
    grid, sums = grid[chosen], sums[chosen]
    return (
        grid,
        2.0 * sums / _local_norm(balance, carrier, speed, grid),
        max((highest - lowest) * span / math.pi, 1.0),
    )


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
    return np.asarray(background.column(probe(term, flat, None, 1.0)[0]) / _unit_size(unit))


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


def _time_spectrum(
    background: Background, y: np.ndarray, view: Survey
) -> tuple[np.ndarray, np.ndarray, float]:
    balance = background.balance
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
