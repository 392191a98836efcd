"""The report of a predicted compensation: the tracking error in each way to compensate, over the run and in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tcs_friction.control.tracking import ARCSEC
from tcs_friction.control.worth import ALL, IDEAL, LAW, NOTHING, Stage, Worth
from tcs_friction.physics.axis import Axis
from tcs_friction.report.figures import BELIEVED, IMPROVED, MUTED, TRUTH, Picture, drawn, label, panels
from tcs_friction.report.html import Html, Number, key_numbers, page, picture, section, table, write_page
from tcs_friction.report.numbers import aligned
from tcs_friction.report.plot import Curve, Panel, Plot, Scale
from tcs_friction.report.plot_picture import drawn_plot

SCHEMA = "tcs_friction/compensation/1"
GAINED = 0.9
"""Share of its largest swing to which a body must come down before a shaped reference is advised."""


def unit_of_error(axis: Axis) -> tuple[float, str]:
    """How many rad (m) the unit of a tracking error is, and its name."""
    return (ARCSEC, "arcsec") if axis.kind == "rotary" else (1e-6, "um")


def to_mapping(found: Worth, axis: Axis) -> dict[str, Any]:
    """compensation.json."""
    scale, unit = unit_of_error(axis)
    return {
        "schema": SCHEMA,
        "axis": axis.name,
        "unit": unit,
        "settle": found.settle,
        "largest_compensation": found.torque,
        "stages": [
            {
                "name": stage.name,
                "rms": stage.rms / scale,
                "peak": stage.peak / scale,
                "rms_between": None if stage.between is None else [bound / scale for bound in stage.between],
            }
            for stage in found.stages
        ],
        "not_cancelled": dict(found.not_cancelled),
        "shaping": [
            {
                "effect": one.effect,
                "shaper": asdict(one.shaper),
                "delay": one.shaper.delay,
                "swing": dict(zip(("rms", "peak"), (value / scale for value in one.swing), strict=True)),
                "swing_shaped": dict(zip(("rms", "peak"), (value / scale for value in one.shaped), strict=True)),
            }
            for one in found.shaping
        ],
    }


def sentence(found: Worth, axis: Axis) -> str:
    """What a control engineer would say of it."""
    scale, unit = unit_of_error(axis)
    before, law, after, ideal = (found.stage(name).rms / scale for name in (NOTHING, LAW, ALL, IDEAL))
    gain = 100.0 * (1.0 - after / law)
    words = f"Cancelling what is known takes the tracking error from {law:.3g} to {after:.3g} {unit} rms"
    if abs(gain) < 1.0:
        words = f"Cancelling what is known changes the tracking error by less than 1 %, {law:.3g} {unit} rms"
    return f"{words}; without any compensation it is {before:.3g}, without these effects {ideal:.3g}."


def rows(found: Worth, axis: Axis) -> list[list[str]]:
    """Each way to compensate: rms, between which it is, largest error."""
    scale, _ = unit_of_error(axis)

    def between(stage: Stage) -> str:
        return "" if stage.between is None else f"{stage.between[0] / scale:.3g} to {stage.between[1] / scale:.3g}"

    return [[_words(stage), f"{stage.rms / scale:.3g}", between(stage), f"{stage.peak / scale:.3g}"] for stage in found.stages]


def _words(stage: Stage) -> str:
    names = {NOTHING: "no compensation", LAW: "friction law", ALL: "law and all effects", IDEAL: "ideal: without these effects"}
    return names.get(stage.name, f"law and {stage.name.replace('_', ' ')}")


def shaping(found: Worth, axis: Axis) -> list[str]:
    """What a shaped reference is worth, a line for each body behind a spring; the encoder does not see how that swings."""
    scale, unit = unit_of_error(axis)
    lines = []
    for one in found.shaping:
        (rms, peak), (shaped_rms, shaped_peak), shaper = one.swing, one.shaped, one.shaper
        words = f"the body behind {one.effect.replace('_', ' ')} swings {rms / scale:.3g} {unit} rms, at most {peak / scale:.3g}"
        if shaped_peak > GAINED * peak:
            lines.append(f"{words}; a shaped reference would hardly change that")
            continue
        block = f"shaper: {{kind: {shaper.kind}, frequency: {shaper.frequency:.4g}, damping: {shaper.damping:.3g}}}"
        less = f"{shaped_rms / scale:.3g} rms, at most {shaped_peak / scale:.3g}"
        lines.append(f"{words}; with `{block}` in the reference file {less}, {1e3 * shaper.delay:.3g} ms later")
    return lines


def text_table(found: Worth, axis: Axis) -> str:
    """The rows for a terminal."""
    head = ["cancelled", f"rms ({unit_of_error(axis)[1]})", "5 to 95 %", "largest"]
    hindered = (f"not cancelled: {name}, {why}" for name, why in found.not_cancelled.items())
    return "\n".join([*aligned([head, *rows(found, axis)]), *hindered, *shaping(found, axis)])


def write_report(directory: Path, found: Worth, axis: Axis, reference: str, notes: Sequence[str] = ()) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    scale, unit = unit_of_error(axis)
    image, over_time = draw(found, axis), draw_errors(found, axis)
    law, after = found.stage(LAW), found.stage(ALL)
    numbers = [
        Number("friction law alone", f"{law.rms / scale:.3g} {unit}", "rms tracking error"),
        Number("all that is known", f"{after.rms / scale:.3g} {unit}", "rms tracking error"),
        Number("largest compensation", f"{found.torque:.4g} {axis.unit('N m')}", "of the drive's torque"),
    ]
    hindered: list[Html] = []
    if found.not_cancelled:
        lines = [[name.replace("_", " "), why] for name, why in found.not_cancelled.items()]
        hindered = [section("Not cancelled", table(["effect", "why"], lines))]
    caption = "True tracking error in simulation. 5 to 95 %: with parameters drawn from their standard deviations"
    head = ["cancelled", f"rms ({unit})", "5 to 95 %", f"largest ({unit})"]
    document = page(
        f"What compensation is worth on axis {axis.name}",
        sentence(found, axis),
        picture(image),
        key_numbers(numbers),
        section("Tracking error", picture(over_time)),
        section("Each effect by itself", table(head, rows(found, axis), caption)),
        *hindered,
        *([section("What the encoder does not see", *shaping(found, axis))] if found.shaping else []),
        *([section("Notes", *notes)] if notes else []),
        remark=f"predicted on {reference}; the axis is simulated as its file describes it",
    )
    return write_page(directory / "report.html", document, [image, over_time])


@drawn("compensation", "Rms of the tracking error in each way to compensate (bars: 5 to 95 % of the draws).")
def draw(found: Worth, axis: Axis) -> Figure:
    """Rms of every stage."""
    scale, unit = unit_of_error(axis)
    stages = found.stages
    figure, (bars,) = panels(height=1.2 + 0.34 * len(stages))
    sizes = np.array([stage.rms / scale for stage in stages])
    ends = np.array([stage.between or (stage.rms, stage.rms) for stage in stages]).T / scale
    reach = np.abs(np.stack([sizes - np.minimum(ends[0], sizes), np.maximum(ends[1], sizes) - sizes]))
    colors = [{NOTHING: MUTED, LAW: BELIEVED, ALL: IMPROVED, IDEAL: TRUTH}.get(stage.name, MUTED) for stage in stages]
    places = np.arange(len(stages))[::-1]
    bars.barh(places, sizes, 0.65, xerr=reach, color=colors, error_kw={"lw": 1.0, "capsize": 2})
    bars.set_yticks(places, [_words(stage) for stage in stages])
    if sizes.max() > 20.0 * sizes.min():
        bars.set_xscale("log")
        bars.set_xlim(0.5 * sizes.min(), 1.5 * max(sizes.max(), float(ends.max())))
    bars.grid(axis="y", visible=False)
    for place, size, high in zip(places, sizes, np.maximum(ends[1], sizes), strict=True):
        bars.annotate(f" {size:.3g}", (high, place), va="center", fontsize=8.5, xytext=(3, 0), textcoords="offset points")
    label(bars, f"rms tracking error ({unit})", "")
    return figure


def draw_errors(found: Worth, axis: Axis) -> Picture:
    """Error over the run with the friction law cancelled and with all that is known."""
    scale, unit = unit_of_error(axis)
    curves = []
    for name, color, words in ((LAW, BELIEVED, "friction law"), (ALL, IMPROVED, "law and all effects")):
        run = found.stage(name).run
        counted = run.t >= found.settle
        error = (run.reference - run.true_position)[counted] / scale
        curves.append(Curve(words, color, run.t[counted], error, size=0.9))
    panel = Panel(Scale("time", "s"), Scale("tracking error", unit), tuple(curves))
    caption = "Tracking error over the run with the friction law cancelled and with all that is known."
    return drawn_plot(Plot("tracking_error", caption, ((panel,),)))
