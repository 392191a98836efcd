"""The report of a predicted compensation: the tracking error in each way to compensate, over the run and in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from tcs_friction.control.shown_controller import Shown
from tcs_friction.control.worth import ALL, LAW, NOTHING, Beside, Interval, Stage, Worth
from tcs_friction.physics.axis import Axis
from tcs_friction.report.compensation_words import (
    doubt,
    effects_sentence,
    encoder_sentences,
    gains_words,
    sentence,
    shaping,
    stage_words,
)
from tcs_friction.report.error_units import UNITS, Unit, plain, unit_for
from tcs_friction.report.error_units import between as words_of
from tcs_friction.report.figures import BELIEVED, IMPROVED, MUTED, TRUTH, Picture, drawn, label, panels
from tcs_friction.report.html import Html, Number, key_numbers, page, picture, section, table, write_page
from tcs_friction.report.numbers import aligned
from tcs_friction.report.plot import Curve, Panel, Plot, Scale
from tcs_friction.report.plot_picture import drawn_plot

SCHEMA = "tcs_friction/compensation/1"
HEAD = ("cancelled", "rms", "90 %", "of no compensation", "90 %", "largest")
FAR = 20.0
"""Times the smallest bar that the longest one is, from where on lengths say nothing of the smallest."""


@dataclass(frozen=True)
class Prediction:
    """What compensation is worth; the controller that a recording shows, and its error beside the simulated one."""

    worth: Worth
    controller: Shown | None = None
    beside: Beside | None = None


def to_mapping(found: Prediction, axis: Axis) -> dict[str, Any]:
    """compensation.json. Errors are in the first of the units of the axis' kind, whatever the report is in."""
    unit = UNITS[axis.kind][0]
    worth = found.worth

    def scaled(values: Sequence[float]) -> list[float]:
        return [value / unit.size for value in values]

    def stage(one: Stage) -> dict[str, Any]:
        return {
            "name": one.name,
            "rms": one.rms / unit.size,
            "peak": one.peak / unit.size,
            "rms_between": None if one.between is None else scaled(one.between),
            "measured_rms": one.measured / unit.size,
            "measured_rms_between": None if one.measured_between is None else scaled(one.measured_between),
            "gain": one.gain,
            "gain_between": None if one.gain_between is None else list(one.gain_between),
            "measured_gain": one.measured_gain,
            "measured_gain_between": None if one.measured_gain_between is None else list(one.measured_gain_between),
        }

    return {
        "schema": SCHEMA,
        "axis": axis.name,
        "statement": " ".join(lines(found, axis)),
        "unit": unit.name,
        "settle": worth.settle,
        "draws": worth.draws,
        "largest_compensation": worth.torque,
        "stages": [stage(one) for one in worth.stages],
        "beyond_law": None if worth.beyond is None else {"ratio": worth.beyond[0], "between": worth.beyond[1]},
        "not_cancelled": dict(worth.not_cancelled),
        "recording": None if found.beside is None else _recording(found.beside, unit),
        "controller": None if found.controller is None else _controller(found.controller),
        "shaping": [
            {
                "effect": one.effect,
                "shaper": asdict(one.shaper),
                "delay": one.shaper.delay,
                "swing": dict(zip(("rms", "peak"), scaled(one.swing), strict=True)),
                "swing_shaped": dict(zip(("rms", "peak"), scaled(one.shaped), strict=True)),
            }
            for one in worth.shaping
        ],
    }


def _recording(beside: Beside, unit: Unit) -> dict[str, Any]:
    between = None if beside.between is None else [bound / unit.size for bound in beside.between]
    return {
        "stage": beside.stage,
        "rms": beside.recorded / unit.size,
        "simulated_rms": beside.simulated / unit.size,
        "simulated_rms_between": between,
        "agrees": beside.agrees,
    }


def _controller(shown: Shown) -> dict[str, Any]:
    names = ("derivative", "proportional", "integral", "inertia", "viscous")
    return {
        "from": "recording" if shown.estimated else "axis file",
        "explained": shown.explained if np.isfinite(shown.explained) else None,
        "explained_by_file": shown.by_file if np.isfinite(shown.by_file) else None,
        "gains": {name: {"value": value, "std": std} for name, (value, std) in zip(names, shown.gains.tolist(), strict=True)},
    }


def unit_of(found: Prediction, axis: Axis) -> Unit:
    """The unit of a report."""
    beside = [] if found.beside is None else [found.beside.recorded, found.beside.simulated]
    return unit_for(axis.kind, [*(stage.rms for stage in found.worth.stages), *beside])


def lines(found: Prediction, axis: Axis) -> list[str]:
    """What a control engineer would say of it: the gain, what effects add to it, and whether the recording agrees."""
    unit = unit_of(found, axis)
    said = [sentence(found.worth, unit), effects_sentence(found.worth, unit), *encoder_sentences(found.worth, unit)]
    said += [gains_words(found.controller, axis.unit)] if found.controller else []
    return said + ([doubt(found.beside, unit)] if found.beside else [])


def rows(found: Worth, unit: Unit) -> list[list[str]]:
    """Each way to compensate: as HEAD says."""

    def between(interval: Interval | None, size: float) -> str:
        return "" if interval is None else words_of(interval[0] / size, interval[1] / size)

    return [
        [
            stage_words(stage),
            plain(stage.rms / unit.size),
            between(stage.between, unit.size),
            f"{plain(100.0 * stage.gain)} %",
            "" if stage.name == NOTHING else between(stage.gain_between, 0.01),
            plain(stage.peak / unit.size),
        ]
        for stage in found.stages
    ]


def text_table(found: Prediction, axis: Axis) -> str:
    """The rows for a terminal."""
    unit = unit_of(found, axis)
    hindered = (f"not cancelled: {name}, {why}" for name, why in found.worth.not_cancelled.items())
    return "\n".join([*aligned([_head(unit), *rows(found.worth, unit)]), *hindered, *shaping(found.worth, unit)])


def _head(unit: Unit) -> list[str]:
    return [f"{name} ({unit.name})" if name in ("rms", "largest") else name for name in HEAD]


def write_report(directory: Path, found: Prediction, axis: Axis, reference: str, notes: Sequence[str] = ()) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    unit, worth = unit_of(found, axis), found.worth
    image, over_time = draw(worth, unit), draw_errors(worth, unit)
    hindered: list[Html] = []
    if worth.not_cancelled:
        words = [[name.replace("_", " "), why] for name, why in worth.not_cancelled.items()]
        hindered = [section("Not cancelled", table(["effect", "why"], words))]
    caption = "True tracking error in simulation: medians of the draws, and between which 90 % of them lie"
    headline, *others = lines(found, axis)
    document = page(
        f"What compensation is worth on axis {axis.name}",
        headline,
        *others,
        picture(image),
        key_numbers(_numbers(worth, axis, unit)),
        section("Tracking error", picture(over_time)),
        section("Each way to compensate", table(_head(unit), rows(worth, unit), caption)),
        *hindered,
        *([section("What the encoder does not see", *shaping(worth, unit))] if worth.shaping else []),
        *([section("Notes", *notes)] if notes else []),
        remark=f"predicted on {reference}; the axis is simulated as its file describes it, {worth.draws or 'no'} draws",
    )
    return write_page(directory / "report.html", document, [image, over_time])


def _numbers(worth: Worth, axis: Axis, unit: Unit) -> list[Number]:
    shown = [worth.stage(name) for name in (NOTHING, LAW, *([ALL] if worth.beyond else []))]
    return [
        *(Number(stage_words(stage), f"{plain(stage.rms / unit.size)} {unit.name}", "rms tracking error") for stage in shown),
        Number("largest compensation", f"{worth.torque:.4g} {axis.unit('N m')}", "of the drive's torque"),
    ]


@drawn("compensation", "Rms of the tracking error in each way to compensate (bars: 90 % of the draws).")
def draw(found: Worth, unit: Unit) -> Figure:
    """Rms of every stage, and how many times less than without compensation."""
    stages = found.stages
    figure, (bars,) = panels(height=1.2 + 0.34 * len(stages))
    sizes = np.array([stage.rms for stage in stages]) / unit.size
    ends = np.array([stage.between or (stage.rms, stage.rms) for stage in stages]).T / unit.size
    reach = np.stack([np.maximum(sizes - ends[0], 0.0), np.maximum(ends[1] - sizes, 0.0)])
    colors = [{NOTHING: BELIEVED, ALL: IMPROVED, LAW: IMPROVED}.get(stage.name, MUTED) for stage in stages]
    places = np.arange(len(stages))[::-1]
    bars.barh(places, sizes, 0.65, xerr=reach, color=colors, error_kw={"lw": 1.0, "capsize": 2})
    bars.set_yticks(places, [stage_words(stage) for stage in stages])
    if sizes.max() > FAR * sizes.min():
        bars.set_xscale("log")
        bars.set_xlim(0.5 * min(sizes.min(), float(ends.min())), 4.0 * float(ends.max()))
    else:
        bars.set_xlim(0.0, 1.3 * float(ends.max()))
    bars.xaxis.set_major_formatter(lambda value, _: f"{value:.10g}")
    bars.xaxis.set_minor_formatter(NullFormatter())
    bars.grid(axis="y", visible=False)
    for place, stage, size, high in zip(places, stages, sizes, ends[1], strict=True):
        words = f" {plain(size)} {unit.name}" + ("" if stage.name == NOTHING else f", {_times(stage.gain)}")
        bars.annotate(words, (high, place), va="center", fontsize=8.5, xytext=(3, 0), textcoords="offset points")
    label(bars, f"rms tracking error ({unit.name})", "")
    return figure


def _times(gain: float) -> str:
    return f"{plain(1.0 / gain, 2)} times less" if gain < 1.0 else f"{plain(gain, 2)} times as much"


def draw_errors(found: Worth, unit: Unit) -> Picture:
    """Error over the run: without compensation and with the law's, below it with the law's and with all effects cancelled too."""
    last = [name for name in (LAW, ALL) if any(stage.name == name for stage in found.stages)]

    def panel(names: Sequence[str], colors: Sequence[str]) -> Panel:
        curves = []
        for name, color in zip(names, colors, strict=True):
            run = found.stage(name).run
            counted = run.t >= found.settle
            error = (run.reference - run.true_position)[counted] / unit.size
            curves.append(Curve(stage_words(found.stage(name)), color, run.t[counted], error, size=0.9))
        return Panel(Scale("time", "s"), Scale("tracking error", unit.name), tuple(curves))

    rows = ((panel([NOTHING, LAW], [BELIEVED, IMPROVED]),), (panel(last, [IMPROVED, TRUTH][: len(last)]),))
    caption = "Tracking error over the run without compensation and with it; below on a scale of its own with what is cancelled."
    return drawn_plot(Plot("tracking_error", caption, rows, linked=True))
