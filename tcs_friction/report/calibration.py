"""The report of an observer's calibration: observed and measured friction, before and after, and what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.identify.dob_calibration import Calibration
from tcs_friction.numerics.runs import runs
from tcs_friction.physics.axis import Unit
from tcs_friction.report import published
from tcs_friction.report.figures import BELIEVED, IMPROVED, MEASURED, TRUTH, Array, Picture
from tcs_friction.report.html import Html, Number, key_numbers, page, picture, section, table, write_page
from tcs_friction.report.numbers import with_error
from tcs_friction.report.plot import Curve, Panel, Plot, Scale
from tcs_friction.report.plot_picture import drawn_plot


def write_report(
    directory: Path, found: Calibration, before: ObserverSettings, unit_of: Unit, sources: Sequence[str]
) -> Path:
    """Write DIR/report.html and its picture; returns the page's path."""
    image = draw_calibration(found, unit_of)
    numbers = key_numbers(
        [
            Number("in uniform motion", _percent(found.accuracy_uniform), "paper: 96.94 %"),
            Number("over everything", _percent(found.accuracy), "reversals included"),
            Number("before calibration", _percent(found.accuracy_before), "over everything"),
            Number(
                "uniform motion",
                _percent(float(found.uniform.mean())),
                "of the recordings, found automatically",
            ),
        ]
    )
    notes = [section("Notes", *found.notes)] if found.notes else []
    document = page(
        "Calibration of the friction observer",
        sentence(found),
        picture(image),
        numbers,
        section("What was found", parameter_table(found, before, unit_of)),
        *notes,
        remark=", ".join(sources),
    )
    return write_page(directory / "report.html", document, [image])


def sentence(found: Calibration) -> str:
    """What a control engineer would say of the result."""
    better = "better" if found.accuracy_uniform > published.DOB_ACCURACY else "worse"
    return (
        f"In uniform motion the calibrated observer reads the dynamometer's torque to {_percent(found.accuracy_uniform)} "
        f"({better} than the paper's 96.94 %), over everything to {_percent(found.accuracy)}; before it was "
        f"{_percent(found.accuracy_before)}."
    )


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f} %"


def draw_calibration(found: Calibration, unit_of: Unit) -> Picture:
    """Series on top, difference below."""
    t, unit, time = _joined(found.t), unit_of("N m"), Scale("time", "s")
    spans = tuple((float(t[start]), float(t[stop - 1])) for start, stop in runs(found.uniform))
    series = (
        Curve("dynamometer", TRUTH, t, found.measured, size=2.4),
        Curve("observed, calibrated", MEASURED, t, found.after),
    )
    differences = (
        Curve("not calibrated", BELIEVED, t, found.before - found.measured),
        Curve("calibrated", IMPROVED, t, found.after - found.measured),
    )
    rows = (
        (Panel(time, Scale("friction", unit), series, spans=spans),),
        (Panel(time, Scale("difference", unit), differences, spans=spans),),
    )
    caption = (
        "Friction observed and friction measured by the dynamometer; below, the difference before and after calibration. "
        "Shaded: uniform motion, from which scale and offset come. Q's delay is taken out."
    )
    return drawn_plot(Plot("calibration", caption, rows, heights=(2.2,), linked=True))


def _joined(t: Array) -> Array:
    """Times of several recordings put one after the other."""
    steps = np.diff(t)
    steps[steps <= 0.0] = float(np.median(steps))
    return np.concatenate([[t[0]], t[0] + np.cumsum(steps)])


def parameter_table(found: Calibration, before: ObserverSettings, unit_of: Unit) -> Html:
    """Before and after."""
    after = found.observer
    unit, inertia = unit_of("N m"), unit_of("kg m²")
    rows = [
        ["torque that acts over torque logged", f"{before.torque_scale:g}",
         with_error(after.torque_scale, found.scale_std), ""],
        ["torque that acts while the logged one is 0", f"{before.torque_offset:g}",
         _known(after.torque_offset, found.offset_std), unit],
        ["nominal inertia", f"{before.plant.first:g}", _known(after.plant.first, found.inertia_std), inertia],
        ["delay of the dynamometer's readings", "–", f"{1e3 * found.dynamometer_delay:.1f}", "ms"],
    ]  # fmt: skip
    return table(["", "before", "found", "unit"], rows, "Value ± standard error")


def _known(value: float, std: float) -> str:
    return with_error(value, std) if np.isfinite(std) else f"{value:g} (kept)"
