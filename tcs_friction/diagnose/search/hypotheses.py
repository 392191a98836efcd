"""Every effect of the vocabulary as a hypothesis about the torque residual, and where to start fitting it.

In: a projected residual. Out: `Start`s, best first: one or two effects with values, and the gain that they promise in a joint
fit. Effects linear in an amplitude are judged by their columns, others by the residual that they leave. Orders, frequencies
and places are found by matched filters first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.matched_filter import local_scans
from tcs_friction.diagnose.search.projection import ProjectedResidual, survey
from tcs_friction.diagnose.search.start import (
    GAIN_PER_NUMBER,
    STARTS,
    Kind,
    Start,
    judged_directly,
    judged_linear,
    kind_of,
)
from tcs_friction.diagnose.search.waves import periodic_starts
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Role, Term

FIRST_STEPS = (-0.13, 0.5, -0.5)  # of a search without derivatives, log units: half a step of the scan, and far beside it
SIMPLEX_TRIALS = 100  # of such a search
FARTHEST = 3.0  # from its start that it goes, log units


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
            or redundant(term, axis)
        ):
            continue
        if term.signals:
            signals = [name for name in data.names if term.suits(name)]
            result += [(term, name) for name in signals if Kind(term.id, name) not in present]
        elif term.periodic or Kind(term.id) not in present:
            result.append((term, None))
    return result


def redundant(term: Term, axis: Axis) -> bool:
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
        return periodic_starts(projected, term, view)
    scans = list(term.scan(view))
    alternatives, excess = float(len(scans)), [1.0] * len(scans)
    linear = [p for p in term.parameters if p.role is Role.LINEAR]
    if term.local is not None:
        alternatives *= view.span / min(scan[term.local.width] for scan in scans)
        placed = local_scans(projected, scans, term, term.local)
        scans, excess = [values for values, _ in placed], [more for _, more in placed]
    judge = judged_linear if linear else judged_directly
    judged = side_by_side(lambda values: judge(projected, term, values, signal_name, alternatives), scans)
    judged = [s and replace(s, noise_excess=x) for s, x in zip(judged, excess, strict=True)]
    found = sorted((s for s in judged if s is not None and s.gain > 0.0), key=lambda s: GAIN_PER_NUMBER * s.count - s.promise)
    return (_peaks(found) if term.discontinuous else found)[:STARTS]


def _peaks(found: Sequence[Start]) -> list[Start]:
    """Starts, best first, that are better than those beside them along the first shape, within its range.

    Starts that differ in another shape are looked at apart, and each of these rows has its share of what is kept.
    """
    rows: dict[tuple[float, ...], list[Start]] = {}
    for start in found:
        _, *others = start.instance.shape.values()
        rows.setdefault(tuple(others), []).append(start)
    kept = list[Start]()
    for row in rows.values():
        row.sort(key=lambda start: list(start.instance.shape.values()))
        inner = [b for a, b, c in zip(row, row[1:], row[2:], strict=False) if a.gain <= b.gain > c.gain]
        kept += sorted(inner, key=lambda start: -start.gain)[: max(STARTS // len(rows), 1)]
    return sorted(kept, key=lambda start: -start.gain)


def refined(projected: ProjectedResidual, start: Start) -> Start:
    """The start of an effect whose torque jumps with its shape, after a search without derivatives; others as they are.

    Over the logarithms of the shape, by the simplex method of Nelder and Mead.
    """
    term, signal_name = start.instance.term, start.instance.signal
    if not term.discontinuous or len(start.instances) > 1:
        return start
    upper = {name: term.parameter(name).upper for name in start.instance.shape}
    best = start

    def cost(logarithms: np.ndarray) -> float:
        nonlocal best
        shape = {name: min(float(x), upper[name]) for name, x in zip(upper, np.exp(logarithms), strict=True)}
        tried = judged_linear(projected, term, shape, signal_name, start.alternatives)
        if tried is None:
            return 0.0
        if tried.gain > best.gain:
            best = tried
        return -tried.gain

    centre = np.log(list(start.instance.shape.values()))
    corners = centre + np.diag(FIRST_STEPS[: len(centre)])
    settings = {"initial_simplex": np.vstack([centre, corners]), "maxfev": SIMPLEX_TRIALS}
    near = optimize.Bounds(centre - FARTHEST, centre + FARTHEST)
    optimize.minimize(cost, centre, method="Nelder-Mead", bounds=near, options=settings)
    return best


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
