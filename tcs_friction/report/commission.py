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
from matplotlib.figure import Figure

from tcs_friction.control.compensator import LugreParameters
from tcs_friction.control.guard import Gain
from tcs_friction.control.tracking import ARCSEC, TrackingErrors
from tcs_friction.physics.registry import law
from tcs_friction.report import published
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MUTED,
    TRUTH,
    Array,
    drawn,
    label,
    legend,
    panels,
)
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
    Stage,
    TrackingRun,
    draw_costs,
    draw_errors,
    draw_friction,
    draw_spectra,
    draw_speed,
    simulated_friction,
)

TRACKING, TORQUE = "tracking", "torque"


@dataclass(frozen=True)
class Judged:
    """An effect that a diagnosis has found: whether it is cancelled, why not, and what that was measured to be worth.

    name: as the model has it; words: what tells it from others of its kind. gain: None where it was not tried.
    of: what the gain is about. TRACKING: the tracking error, rad. TORQUE, of an effect of the encoder, which measures that error
    itself: the torque that the model leaves unexplained in a fresh recording, in standard deviations of the noise.
    """

    name: str
    words: str
    kept: bool
    why: str
    gain: Gain | None
    of: str = TRACKING


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

    @property
    def stages(self) -> list[Stage]:
        """The tracking runs in the order of what was compensated, as pictures show them."""
        every = (
            ("not compensated", MUTED, self.before),
            ("friction compensated", BELIEVED, self.after),
            ("ideal", TRUTH, self.ideal),
            ("friction and what was found", IMPROVED, self.found),
        )
        return [Stage(name, color, run) for name, color, run in every if run is not None]

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
    """rms without and with the effect's cancellation, in `unit`; ratio: of the two in equal windows, with its 90 % interval."""
    content: dict[str, Any] = {"name": one.name, "cancelled": one.kept, "why_not": one.why or None, "gain": None}
    if one.gain is not None:
        found, unit = one.gain.improvement, ARCSEC if one.of == TRACKING else 1.0
        content["gain"] = {
            "of": one.of,
            "unit": "arcsec" if one.of == TRACKING else "standard deviations of the noise",
            "rms_without": one.gain.without / unit,
            "rms_with": one.gain.cancelled / unit,
            "ratio": found.ratio,
            "between": [found.lowest, found.highest],
        }
    return content


def cut(before: float, after: float) -> float:
    """By which share an error was cut."""
    return 1.0 - abs(after) / abs(before)


def table_3(before: TrackingErrors, after: TrackingErrors, found: TrackingErrors | None = None) -> list[tuple[str, ...]]:
    """Table 3's rows: quantity, ours before, after and cut, with what was found and cut, the paper's before, after and cut."""
    rows = []
    names = (
        ("positive peak at zero crossings", "peak_positive"),
        ("negative peak at zero crossings", "peak_negative"),
        ("tracking RMS", "rms"),
    )
    for name, key in names:
        first = getattr(before, key)
        cells = [name, f"{first:.4f}″"]
        for last in (after, found) if found is not None else (after,):
            cells += [f"{getattr(last, key):.4f}″", f"{100.0 * cut(first, getattr(last, key)):.1f} %"]
        b, a = getattr(published.BEFORE, key), getattr(published.AFTER, key)
        rows.append((*cells, f"{b:.4f}″", f"{a:.4f}″", f"{100.0 * cut(b, a):.1f} %"))
    return rows


def table_3_head(found: bool = False) -> tuple[str, ...]:
    """Above the rows of `table_3`."""
    more = ("with what was found", "cut by") if found else ()
    return ("", "before", "after", "cut by", *more, "paper before", "paper after", "paper cut by")


def tables(result: CommissionResult) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of Table 3 for a commissioning."""
    found = None if result.found is None else result.found.errors(result.settle)
    rows = table_3(result.before.errors(result.settle), result.after.errors(result.settle), found)
    return table_3_head(found is not None), rows


def effect_rows(result: CommissionResult) -> list[tuple[str, ...]]:
    """What was found: its name, what cancelling it was measured to be worth, and what became of it."""
    rows: list[tuple[str, ...]] = []
    for one in result.judged:
        worth = "not tried"
        if one.gain is not None:
            between = one.gain.improvement
            worth = f"{one.gain.without / ARCSEC:.4f}″ to {one.gain.cancelled / ARCSEC:.4f}″ rms"
            if one.of == TORQUE:
                size = f"{one.gain.without:.2f} to {one.gain.cancelled:.2f} times the noise"
                worth = f"torque unexplained in a fresh recording: {size}"
            worth += f" (times {between.lowest:.3f} to {between.highest:.3f})"
        rows.append((one.words, worth, "cancelled" if one.kept else one.why))
    return rows


EFFECT_HEAD = ("effect", "tracking error without and with its cancellation", "")


def console_table(result: CommissionResult) -> str:
    """The before/after table beside the paper's, and what was found, for a terminal."""
    head, rows = tables(result)
    lines = aligned([head, *rows])
    if result.judged:
        width = max(len(row[0]) for row in effect_rows(result))
        lines += ["", "found, and what cancelling it is worth on this run:"]
        for name, worth, what in effect_rows(result):
            lines.append(f"  {name.ljust(width)}  {worth}, {what}" if worth != "not tried" else f"  {name.ljust(width)}  {what}")
    return "\n".join(lines)


def write_report(directory: Path, result: CommissionResult) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    before, after = result.before.errors(result.settle), result.after.errors(result.settle)
    speed, errors, spectra = draw_speed(result.before), draw_errors(result.stages), draw_spectra(result.stages)
    friction = draw_friction(_with_law(result))
    costs = draw_costs({"best of the generation": result.costs})
    pictures = [speed, errors, spectra, friction, costs]
    found: list[Html] = []
    if result.judged:
        content: list[Any] = list(result.statements)
        if any(one.gain is not None and one.of == TRACKING for one in result.judged):
            pictures.append(draw_worth(result))
            content.append(picture(pictures[-1]))
        words = "Measured on the run to be tracked; times: 90 % interval of the error's ratio, window by window"
        found = [section("What was found beside friction", *content, table(EFFECT_HEAD, effect_rows(result), words))]
    document = page(
        f"Commissioning of {result.axis}",
        sentence(result),
        picture(errors),
        key_numbers(_numbers(result, before, after)),
        section("Tracking error", table(*tables(result), "Table 3, ours and the paper's")),
        *found,
        section("Over frequency", picture(spectra)),
        section("Friction", picture(friction), _parameters(result)),
        section("The search", picture(costs)),
        section("The run", picture(speed), *result.notes),
        remark=f"{result.seconds:.0f} s in all." if result.seconds else "",
    )
    return write_page(directory / "report.html", document, pictures)


def sentence(result: CommissionResult) -> str:
    """What came of it, in a sentence or two."""
    before, after = result.before.errors(result.settle), result.after.errors(result.settle)
    worst = max(abs(after.peak_positive), abs(after.peak_negative))
    words = (
        f"With its friction measured, identified and compensated, {result.axis} crosses zero speed "
        f"within {worst:.3f}″ "
        f"instead of {max(before.peak_positive, -before.peak_negative):.2f}″, "
        f"and tracks to {after.rms:.3f}″ RMS instead of {before.rms:.3f}″."
    )
    if result.found is not None:
        kept = ", ".join(dict.fromkeys(one.words for one in result.judged if one.kept))
        found = result.found.errors(result.settle).rms
        words += f" With {kept or 'the diagnosed friction'} cancelled, too, it tracks to {found:.3f}″."
    return words


@drawn("effects", "What cancelling each effect is worth on the run that is tracked, as measured (bars: 90 % interval).")
def draw_worth(result: CommissionResult) -> Figure:
    """Rms tracking error without and with each effect that was tried on it."""
    tried = [(one, one.gain) for one in result.judged if one.gain is not None and one.of == TRACKING]
    figure, (axes,) = panels(height=0.9 + 0.5 * len(tried))
    places = np.arange(len(tried))[::-1].astype(float)
    without = np.array([gain.without for _, gain in tried]) / ARCSEC
    share = np.array([[gain.improvement.lowest, gain.improvement.ratio, gain.improvement.highest] for _, gain in tried])
    size = np.array([gain.cancelled for _, gain in tried]) / ARCSEC
    reach = np.clip(without[:, None] * np.abs(share[:, [0, 2]] - share[:, [1]]), 0.0, 10.0 * without.max()).T
    axes.barh(places + 0.19, without, 0.36, color=BELIEVED, label="without its cancellation")
    axes.barh(places - 0.19, size, 0.36, xerr=reach, color=IMPROVED, error_kw={"lw": 1.0, "capsize": 2}, label="with it")
    axes.set_yticks(places, [f"{one.words}\n({'kept' if one.kept else 'put back'})" for one, _ in tried])
    axes.set_xlim(0.0, 1.15 * without.max())
    axes.grid(visible=False, axis="y")
    label(axes, "rms tracking error (arcsec)", "")
    legend(axes)
    return figure


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
    if result.ideal is not None:
        ratio = (result.found or result.after).errors(result.settle).rms / result.ideal.errors(result.settle).rms
        numbers.append(Number("RMS over the ideal", f"{ratio:.2f}", "of an axis without friction and effects"))
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
