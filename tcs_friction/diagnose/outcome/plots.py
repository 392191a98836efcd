"""The arrays behind a diagnosis, made from its parts: what a report draws and tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tcs_friction.diagnose.dataset.coordinates import unit_of, values_of
from tcs_friction.diagnose.dataset.preprocessing import Conditioned
from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.outcome.atlas import AtlasEntry
from tcs_friction.diagnose.outcome.plot_data import Evidence, Isolated, Look, Map, RunnerUp
from tcs_friction.diagnose.search.stepwise import Selection
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, unit_on

PLOTTED = 6000  # samples in pictures
CELLS = 80  # each way, in which a map is drawn
FOLDED = 4.0  # periods, from which an effect is drawn over one of them


def evidence_of(
    balance: Balance,
    selection: Selection,
    axis: Axis,
    residuals: Mapping[str, np.ndarray],
    located: Sequence[AtlasEntry],
) -> Evidence:
    """Evidence for an improved `axis`: residuals (n,) believed, retuned and improved, the atlas of the retuned one."""
    t, counted = balance.data.joined("t"), np.flatnonzero(balance.train | balance.held_out)  # without the ends of stretches
    thin = counted[:: max(1, len(counted) // PLOTTED)]
    looks = (Look(e.coordinate, e.unit, e.x, e.mean, e.band, e.share, e.p_value) for e in located if len(e.x) > 1)
    named = [item for item in axis.effects if not item.term.tabulated]
    return Evidence(
        t=t[thin],
        believed=residuals["believed"][thin],
        retuned=residuals["retuned"][thin],
        improved=residuals["improved"][thin],
        held_out=balance.held_out[thin],
        atlas=tuple(looks),
        isolated=tuple(_isolated(balance, axis, item, residuals["improved"], thin) for item in named),
        learned=_map(balance.data, axis),
        runners_up=_runners_up(selection, axis),
        torque_unit=unit_of("torque", axis.kind),
        position_unit=unit_of("position", axis.kind),
        notes=balance.data.notes,
    )


def _isolated(balance: Balance, axis: Axis, item: Instance, improved: np.ndarray, thin: np.ndarray) -> Isolated:
    """What is left when all but this effect is taken away, against the effect's coordinate; a wave over its period."""
    left = balance.residual(axis.without_effect(item))
    coordinate = _drawn_over(item)
    x, unit = values_of(balance.data, coordinate), unit_of(coordinate, axis.kind)
    period = where(item, axis)["period"]
    if period is not None and np.ptp(x) > FOLDED * period:
        coordinate, x = f"{coordinate}_within_a_period", x % period
    title, first = item.term.id.replace("_", " "), item.term.parameters[0]
    if item.term.periodic:
        title += f", {first.name} {item.values[first.name]:.4g} {unit_on(axis.kind, first.unit)}"
    return Isolated(item.term.id, title, coordinate, unit, x[thin], left[thin], (left - improved)[thin])


def _map(data: Conditioned, axis: Axis) -> Map | None:
    """The learned map, to be drawn where there was motion."""
    table = next((item.table for item in axis.effects if item.table is not None), None)
    if table is None:
        return None
    units = tuple(unit_of(name, axis.kind) for name in table.coordinates)
    samples = np.stack([values_of(data, name) for name in table.coordinates], axis=1)
    cells = np.histogramdd(samples, CELLS, list(zip(table.lower, table.upper, strict=True)))[0]
    return Map(table.coordinates, units, table.lower, table.upper, table.values, cells > 0.0)


def _runners_up(selection: Selection, axis: Axis) -> tuple[RunnerUp, ...]:
    """Hypotheses that lost, with the reason."""
    lost: dict[str, RunnerUp] = {}
    chosen = {item.term.id for item in axis.effects}
    for rivals in selection.rivals:
        for c in rivals.candidates:
            name = c.name.split(":")[0]
            if name in chosen or name in lost:
                continue
            behind = rivals.gain - c.gain
            lost[name] = RunnerUp(
                name, c.gain, f"explains {c.gain:.4g} of {rivals.gain:.4g}: {behind:.3g} behind"
            )
    beyond = "a learned map explains as much" if "learned_map" in chosen else "what is named may leave as much behind"
    for c in selection.rounds[-1] if selection.rounds else []:
        name = c.name.split(":")[0]
        if name not in chosen and name not in lost:
            by_chance = f"chance and smoothing may give {c.threshold:.3g}"
            lost[name] = RunnerUp(name, c.gain, f"gains {c.gain:.3g}; {beyond if c.score > 0.0 else by_chance}")
    return tuple(sorted(lost.values(), key=lambda r: -r.score)[:8])


def where(item: Instance, axis: Axis) -> dict[str, Any]:
    """Coordinate, range, period and frequency at which the effect shows."""
    place: dict[str, Any] = {
        "coordinate": item.term.coordinate,
        "range": None,
        "period": None,
        "frequency": None,
    }
    values = item.values
    if item.term.coordinate == "exogenous":
        place["coordinate"] = f"exogenous:{item.signal}"
    if item.term.periodic == "position":
        place["period"] = 2.0 * math.pi / (values["order"] * axis.cycle)
    if "frequency" in values:
        place["frequency"] = values["frequency"]
    if item.term.local:
        place["range"] = [values["centre"] - values["width"], values["centre"] + values["width"]]
    if item.term.id == "load_step":
        place["range"] = [values["time"], None]
    return place


def _drawn_over(item: Instance) -> str:
    """The coordinate to draw an effect over."""
    coordinate = {"direction": "velocity", "frequency": "time", "time_since_reversal": "time"}.get(
        item.term.coordinate, item.term.coordinate
    )
    return f"exogenous:{item.signal}" if coordinate == "exogenous" else coordinate
