"""The report of the main job: measure, identify, compensate, measure again.

Whoever commissions an axis fills a `CommissionResult`; `to_mapping` is then commission.json, `console_table`
what the terminal shows, and `write_report` the page with its pictures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.control.compensator import LugreParameters
from tcs_friction.control.guard import Gain
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.physics.registry import law
from tcs_friction.report import published
from tcs_friction.report.figures import Array
from tcs_friction.report.html import (
    Cell,
    Html,
    Number,
    key_numbers,
    page,
    picture,
    section,
    table,
    write_page,
)
from tcs_friction.report.numbers import aligned
from tcs_friction.report.runs import (
    FrictionRun,
    TrackingRun,
    draw_costs,
    draw_errors,
    draw_friction,
    draw_spectra,
    draw_speed,
    simulated_friction,
)


@dataclass(frozen=True)
class Judged:
    """An effect that a diagnosis has found: whether it is cancelled, why not, and what that was measured to be worth.

    name: as the model has it; words: in words. gain: None where it was not tried.
    """

    name: str
    words: str
    kept: bool
    why: str
    gain: Gain | None


@dataclass(frozen=True)
class CommissionResult:
    """What commissioning measured.

    before, after: the same tracking run without and with compensation.
    friction_off: the same loop on the axis without friction; None on a real axis.
    measurement: friction observed while measuring, the filter's delay taken out, with the plant's own if any.
    identified: the friction law's parameters, SI; true: those of the simulated plant, empty on a real axis.
    costs: (generations,) best cost of each generation.
    settle: seconds at the start of the tracking runs that do not count.
    seconds: wall time of the whole job. notes: anything a reader should know, one line each.
    found: the same run while what was diagnosed is cancelled, too; None where nothing is. ideal: without friction and effects.
    judged: every effect that was found. statements: of the diagnoses.
    """

    axis: str
    before: TrackingRun
    after: TrackingRun
    measurement: FrictionRun
    identified: Mapping[str, float]
    costs: Array
    friction_off: TrackingRun | None = None
    true: Mapping[str, float] | None = None
    settle: float = 5.0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    found: TrackingRun | None = None
    ideal: TrackingRun | None = None
    judged: tuple[Judged, ...] = ()
    statements: tuple[str, ...] = ()

    @property
    def dob_relative_error(self) -> float | None:
        """RMS of observed less true friction over RMS of the true one; None where the truth is unknown."""
        run = self.measurement
        if run.truth is None:
            return None
        keep = run.t >= run.t[0] + self.settle
        return float(np.sqrt(np.mean((run.observed - run.truth)[keep] ** 2) / np.mean(run.truth[keep] ** 2)))

    def to_mapping(self) -> dict[str, Any]:
        """commission.json: tracking errors in arcsec, friction in SI units."""
        errors = {
            "before": self.before,
            "after": self.after,
            "found": self.found,
            "friction_off": self.friction_off,
            "ideal": self.ideal,
        }
        content: dict[str, Any] = {
            name: None if run is None else _error_mapping(run.errors(self.settle))
            for name, run in errors.items()
        }
        content["dob_relative_error"] = self.dob_relative_error
        content["identified"] = dict(self.identified)
        content["true"] = None if self.true is None else dict(self.true)
        content["effects"] = [_judged_mapping(one) for one in self.judged]
        content["statements"] = list(self.statements)
        return content


def _error_mapping(errors: TrackingErrors) -> dict[str, float | None]:
    """None for the peaks of a direction to which a run that lost messages never reversed."""
    values = {"peak_positive": errors.peak_positive, "peak_negative": errors.peak_negative, "rms": errors.rms}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _judged_mapping(one: Judged) -> dict[str, Any]:
    """rms in arcsec without and with the effect's cancellation; ratio: of the two in equal windows, with its 90 % interval."""
    content: dict[str, Any] = {"name": one.name, "cancelled": one.kept, "why_not": one.why or None, "gain": None}
    if one.gain is not None:
        found = one.gain.improvement
        content["gain"] = {
            "rms_without": one.gain.without / ARCSEC,
            "rms_with": one.gain.cancelled / ARCSEC,
            "ratio": found.ratio,
            "between": [found.lowest, found.highest],
        }
    return content


def cut(before: float, after: float) -> float:
    """By which share an error was cut."""
    return 1.0 - abs(after) / abs(before)


def table_3(before: TrackingErrors, after: TrackingErrors) -> list[tuple[str, ...]]:
    """Table 3's rows: quantity, ours before, after and cut, the paper's before, after and cut."""
    rows = []
    names = (
        ("positive peak at zero crossings", "peak_positive"),
        ("negative peak at zero crossings", "peak_negative"),
        ("tracking RMS", "rms"),
    )
    for name, key in names:
        cells = [name]
        for first, second in ((before, after), (published.BEFORE, published.AFTER)):
            b, a = getattr(first, key), getattr(second, key)
            cells += [f"{b:.4f}″", f"{a:.4f}″", f"{100.0 * cut(b, a):.1f} %"]
        rows.append(tuple(cells))
    return rows


TABLE_3_HEAD = ("", "before", "after", "cut by", "paper before", "paper after", "paper cut by")


def console_table(result: CommissionResult) -> str:
    """The before/after table beside the paper's, for a terminal."""
    rows = [TABLE_3_HEAD, *table_3(result.before.errors(result.settle), result.after.errors(result.settle))]
    return "\n".join(aligned(rows))


def write_report(directory: Path, result: CommissionResult) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    before, after = result.before.errors(result.settle), result.after.errors(result.settle)
    speed = draw_speed(result.before)
    errors = draw_errors(result.before, result.after, result.friction_off)
    spectra = draw_spectra(result.before, result.after, result.friction_off)
    friction = draw_friction(_with_law(result))
    costs = draw_costs({"best of the generation": result.costs})
    worst = max(abs(after.peak_positive), abs(after.peak_negative))
    sentence = (
        f"With its friction measured, identified and compensated, {result.axis} crosses zero speed "
        f"within {worst:.3f}″ "
        f"instead of {max(before.peak_positive, -before.peak_negative):.2f}″, "
        f"and tracks to {after.rms:.3f}″ RMS instead of {before.rms:.3f}″."
    )
    document = page(
        f"Commissioning of {result.axis}",
        sentence,
        key_numbers(_numbers(result, before, after)),
        section(
            "Tracking error",
            picture(errors),
            table(TABLE_3_HEAD, table_3(before, after), "Table 3, ours and the paper's"),
        ),
        section("Over frequency", picture(spectra)),
        section("Friction", picture(friction), _parameters(result)),
        section("The search", picture(costs)),
        section("The run", picture(speed), *result.notes),
        remark=f"{result.seconds:.0f} s in all." if result.seconds else "",
    )
    return write_page(directory / "report.html", document, [speed, errors, spectra, friction, costs])


def _with_law(result: CommissionResult) -> FrictionRun:
    """The measurement with the identified law's friction beside it, where the law is complete."""
    run, names = result.measurement, [entry.name for entry in fields(LugreParameters)]
    if run.simulated is not None or not set(names) <= set(result.identified):
        return run
    parameters = LugreParameters(**{name: result.identified[name] for name in names})
    return replace(run, simulated=simulated_friction(run.t, run.velocity, parameters))


def _numbers(result: CommissionResult, before: TrackingErrors, after: TrackingErrors) -> list[Number]:
    numbers = [
        Number(
            f"{name} cut by",
            f"{100 * cut(getattr(before, key), getattr(after, key)):.0f} %",
            f"paper {paper}",
        )
        for name, key, paper in (
            ("positive peaks", "peak_positive", "74.8 %"),
            ("negative peaks", "peak_negative", "55.1 %"),
            ("tracking RMS", "rms", "36.2 %"),
        )
    ]
    if result.friction_off is not None:
        ratio = after.rms / result.friction_off.errors(result.settle).rms
        numbers.append(Number("RMS over that without friction", f"{ratio:.2f}", "1 is as good as it can be"))
    if result.dob_relative_error is not None:
        off = f"{100.0 * result.dob_relative_error:.1f} %"
        numbers.append(Number("friction observed to within", off, "RMS, against the plant's own"))
    return numbers


def _parameters(result: CommissionResult) -> Html:
    units = {p.name: p.unit for p in law("lugre").parameters}
    rows: list[list[str | Cell]] = []
    for name, value in result.identified.items():
        row: list[str | Cell] = [name, f"{value:.5g}"]
        if result.true:
            row += (
                [f"{result.true[name]:.5g}", f"{round(100.0 * (value / result.true[name] - 1.0), 1) + 0.0:+.1f} %"]
                if result.true.get(name)
                else ["–", "–"]
            )
        rows.append([*row, units.get(name, "")])
    head = ["parameter", "identified", *(["true", "off by"] if result.true else []), "unit"]
    return table(head, rows, "Friction law identified")
