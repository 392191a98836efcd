"""The arrays behind a diagnosis, made from its parts: what a report draws and tells."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose.dataset.coordinates import unit_of, values_of
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.outcome.atlas import AtlasEntry
from tcs_friction.diagnose.outcome.plot_data import CoordinateCurve, Evidence, Isolated, Map, RunnerUp
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.diagnose.search.rivals import Contest
from tcs_friction.diagnose.search.start import Kind, kind_of
from tcs_friction.numerics.by_speed import TorqueBySpeed
from tcs_friction.numerics.envelope import envelope
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import COORDINATES, Instance

PLOTTED = 6000  # samples in pictures
CELLS = 80  # each way, in which a map is drawn
MOST_RUNNERS_UP = 8  # in the table
FOLDED = 4.0  # periods, from which an effect is drawn over one of them


def evidence_of(
    balance: TorqueBalance,
    fit: Fit,
    rounds: Sequence[Sequence[Candidate]],
    contests: Sequence[Contest],
    residuals: Mapping[str, np.ndarray],
    located: Sequence[AtlasEntry],
    notes: tuple[str, ...],
    lacks: Sequence[Lack] = (),
    friction: TorqueBySpeed | None = None,
    named: Collection[int] = frozenset(),
) -> Evidence:
    """Evidence for the improved axis of a fit: residuals (n,) believed, retuned and improved, the atlas of the retuned one.

    lacks: of the believed friction law. friction: against speed. named: identities of effects that are.
    """
    axis = fit.axis
    apart = balance.held_out | balance.untouched
    t, counted = balance.data.joined("t"), np.flatnonzero(balance.train | apart)  # without the ends of stretches
    thin = counted[:: max(1, len(counted) // PLOTTED)]
    peaks = counted[np.unique(np.concatenate([envelope(x[counted], PLOTTED // 2) for x in residuals.values()]))]
    curves = (
        CoordinateCurve(e.coordinate, e.unit, e.x, e.mean, e.band, e.share, e.p_value) for e in located if len(e.x) > 1
    )
    found = [item for item in axis.effects if not item.term.tabulated]
    left = [(item, balance.residual(axis.without_effect(item), fit.noise)) for item in found]
    left += [(lack.effect, balance.residual(lack.without.axis, fit.noise)) for lack in lacks]
    return Evidence(
        t=t[peaks],
        believed=residuals["believed"][peaks],
        retuned=residuals["retuned"][peaks],
        improved=residuals["improved"][peaks],
        held_out=apart[peaks],
        atlas=tuple(curves),
        isolated=tuple(
            replace(_isolated(balance.data, axis, item, x, residuals["improved"], thin), named=item.identity in named)
            for item, x in left
        ),
        learned=_map(balance.data, axis),
        runners_up=_runners_up(rounds, contests, axis),
        torque_unit=unit_of("torque", axis),
        position_unit=unit_of("position", axis),
        notes=notes,
        friction=friction,
    )


def _isolated(
    data: DataSet, axis: Axis, item: Instance, left: np.ndarray, improved: np.ndarray, thin: np.ndarray
) -> Isolated:
    """What is `left` (n,) without this effect, against the effect's coordinate; a wave over its period."""
    coordinate = _drawn_over(item)
    x, unit = values_of(data, coordinate), unit_of(coordinate, axis)
    period = where(item, axis)["period"]
    if period is not None and np.ptp(x) > FOLDED * period:
        coordinate, x = f"{coordinate}_within_a_period", x % period
    title = item.term.words
    if item.term.periodic:
        title += f", {item.term.order.name} {item.order:.4g} {item.term.order.unit_for(axis.kind, axis.torque_unit)}"
    return Isolated(item.term.id, title, coordinate, unit, x[thin], left[thin], (left - improved)[thin])


def _map(data: DataSet, axis: Axis) -> Map | None:
    """The learned map, to be drawn where there was motion."""
    table = next((item.table for item in axis.effects if item.table is not None), None)
    if table is None:
        return None
    units = tuple(unit_of(name, axis) for name in table.coordinates)
    samples = np.stack([values_of(data, name) for name in table.coordinates], axis=1)
    cells = np.histogramdd(samples, CELLS, list(zip(table.lower, table.upper, strict=True)))[0]
    return Map(table.coordinates, units, table.lower, table.upper, table.values, cells > 0.0)


def _runners_up(
    rounds: Sequence[Sequence[Candidate]], contests: Sequence[Contest], axis: Axis
) -> tuple[RunnerUp, ...]:
    """Hypotheses that lost, with the reason."""
    lost: dict[str, RunnerUp] = {}
    chosen = {kind_of(item) for item in axis.effects}
    for contest in contests:
        for rival in contest.rivals:
            name = _words(rival.kinds)
            if rival.kinds[0] not in chosen and name not in lost:
                behind = contest.gain - rival.gain
                reason = f"explains {rival.gain:.4g} of {contest.gain:.4g}: {behind:.3g} behind"
                lost[name] = RunnerUp(name, rival.gain, reason)
    mapped = any(item.term.tabulated for item in axis.effects)
    beyond = "a learned map explains as much" if mapped else "what is named may leave as much behind"
    for candidate in rounds[-1] if rounds else []:
        name = _words(candidate.kinds)
        if candidate.kinds[0] not in chosen and name not in lost:
            by_chance = f"chance and smoothing may give {candidate.threshold:.3g}"
            reason = f"gains {candidate.gain:.3g}; {beyond if candidate.score > 0.0 else by_chance}"
            lost[name] = RunnerUp(name, candidate.gain, reason)
    return tuple(sorted(lost.values(), key=lambda r: -r.score)[:MOST_RUNNERS_UP])


def _words(kinds: Sequence[Kind]) -> str:
    """Effects with the signals they act through."""
    return " and ".join(kind.words for kind in kinds)


def where(item: Instance, axis: Axis) -> dict[str, Any]:
    """Coordinate, range, period and frequency at which the effect shows."""
    extent = item.extent
    return {
        "coordinate": _of_signal(item.term.coordinate, item),
        "range": None if extent is None else list(extent),
        "period": 2.0 * math.pi / (item.order * axis.cycle) if item.term.periodic == "position" else None,
        "frequency": item.frequency,
    }


def _drawn_over(item: Instance) -> str:
    """The coordinate to draw an effect over."""
    return _of_signal(COORDINATES[item.term.coordinate], item)


def _of_signal(coordinate: str, item: Instance) -> str:
    """A coordinate, or the recorded signal that it stands for."""
    return f"exogenous:{item.signal}" if coordinate == "exogenous" else coordinate
