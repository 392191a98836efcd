"""Friction laws on recordings of real axes: what each leaves unexplained, drawn, and where it lies. Nothing is tuned away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tcs_friction.identify.result import Identification
from tcs_friction.physics.terms import unit_on
from tcs_friction.recording.recording import Recording
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    Array,
    Picture,
    label,
    legend,
    line,
    panels,
    picture_of,
    thin,
)
from tcs_friction.report.html import Cell, Html, page, picture, section, table, write_page

SIMPLEST = "coulomb_viscous"
BINS = 240
MOST_BENT = 0.1  # of the travel: bristles that bend further are no friction
NOTABLE = 0.05  # share of a residual's power


@dataclass(frozen=True, eq=False)
class Subject:
    """One recording of a real axis, and what each law made of it (by name, in any order)."""

    name: str
    what: str
    kind: str
    recording: Recording
    found: dict[str, Identification]

    @property
    def ranking(self) -> list[str]:
        """Laws, least residual on held-out samples first."""
        return sorted(self.found, key=lambda law: self.found[law].rmse.held_out)

    @property
    def best(self) -> Identification:
        """The law with the least residual on samples that no fit saw."""
        return self.found[self.ranking[0]]

    def unexplained(self, law: str) -> float:
        """Residual rms on held-out samples over the torque's own rms about its mean."""
        item = self.found[law]
        return item.rmse.held_out / float(np.std(item.fit.measured))

    def position(self, law: str) -> Array:
        """(m,) the position at the compared samples; of a rotary axis that turned more than once, within the turn."""
        t = self.found[law].fit.t
        position: Array = np.interp(t, self.recording.t, self.recording.position)
        turned = self.kind == "rotary" and np.ptp(position) > 2.0 * np.pi
        return np.mod(position, 2.0 * np.pi) if turned else position


def dependence(residual: Array, coordinate: Array) -> float:
    """Share of the residual's power that goes with one coordinate (correlation ratio, corrected for chance).

    Two coordinates may share it: on a motion that repeats, position and speed go together.
    """
    bins = int(min(BINS, len(residual) // 10))
    if bins < 2 or not np.ptp(coordinate) > 0.0:
        return 0.0
    edges = np.quantile(coordinate, np.linspace(0.0, 1.0, bins + 1)[1:-1])
    place = np.searchsorted(edges, coordinate)
    count = np.bincount(place, minlength=bins)
    filled = count > 0
    mean = np.bincount(place, residual, minlength=bins)[filled] / count[filled]
    within = float(np.sum((residual - mean[np.cumsum(filled)[place] - 1]) ** 2)) / max(
        len(residual) - filled.sum(), 1
    )
    total = float(np.var(residual, ddof=1))
    return max(0.0, 1.0 - within / total) if total > 0.0 else 0.0


def remarks(subject: Subject) -> list[str]:
    """What an engineer should know of the best law's fit."""
    best, law = subject.best, subject.ranking[0]
    unit = best.offset.unit
    share = 100.0 * subject.unexplained(law)
    words = [
        f"{law} does best: on samples that no fit saw it leaves {best.rmse.held_out:.3g} {unit} rms, {share:.1f} % of the "
        f"torque; {SIMPLEST} leaves {100.0 * subject.unexplained(SIMPLEST):.1f} %. The noise is at least "
        f"{best.noise_floor:.2g} {unit}."
    ]
    shares = {
        "position": dependence(best.fit.residual, subject.position(law)),
        "speed": dependence(best.fit.residual, best.fit.velocity),
    }
    named = [f"{100.0 * value:.0f} % goes with {name}" for name, value in shares.items() if value > NOTABLE]
    if named:
        words.append(f"Of what is left {' and '.join(named)}: physics that no friction law has.")
    bent = [_bent(subject, name) for name in dict.fromkeys((law, "lugre"))]
    return [*words, *filter(None, bent)]


def _bent(subject: Subject, law: str) -> str:
    """A remark where bristles bend over a good part of the travel: then they imitate a spring or gravity."""
    values = subject.found[law].friction() if law in subject.found else {}
    if not {"coulomb", "stiffness"} <= set(values):
        return ""
    travel = float(np.ptp(subject.recording.position))
    bend = values["coulomb"] / values["stiffness"]
    if bend < MOST_BENT * travel:
        return ""
    unit = unit_on(subject.kind, "rad")
    return (
        f"The bristles of {law} bend by {bend:.2g} {unit}, {100.0 * bend / travel:.0f} % of the whole travel: they imitate a "
        "torque that depends on position, such as gravity. That is not friction, however well it fits."
    )


def draw_time(subject: Subject) -> Picture:
    """Torque measured and modelled; the residuals of the simplest law and of the best."""
    simple, best = subject.found[SIMPLEST], subject.best
    unit = _unit(subject)

    def draw() -> Figure:
        figure, (top, bottom) = panels(2, height=2.1, sharex=True)
        line(top, best.fit.t, best.fit.measured, MEASURED, "measured", lw=1.6)
        line(top, best.fit.t, best.fit.modelled, IMPROVED, best.law, lw=0.9)
        line(bottom, simple.fit.t, simple.fit.residual, BELIEVED, SIMPLEST, lw=0.7)
        if best.law != SIMPLEST:
            line(bottom, best.fit.t, best.fit.residual, IMPROVED, best.law, lw=0.7)
        label(top, "", f"torque ({unit})")
        label(bottom, "time (s)", f"residual ({unit})")
        legend(top)
        legend(bottom)
        return figure

    caption = f"{subject.name}: torque measured and modelled by the best law; below, what the simplest and the best law leave."
    return picture_of(f"{subject.name}_time", caption, draw)


def draw_where(subject: Subject) -> Picture:
    """The best law's residual over position and over speed, with its mean in narrow bins."""
    best, law = subject.best, subject.ranking[0]
    unit = _unit(subject)
    coordinates = (
        (subject.position(law), f"position ({unit_on(subject.kind, 'rad')})"),
        (best.fit.velocity, f"speed ({unit_on(subject.kind, 'rad/s')})"),
    )

    def draw() -> Figure:
        figure, (left, right) = panels(1, 2, height=2.4, width=9.4, sharey=True)
        for axes, (coordinate, words) in zip((left, right), coordinates, strict=True):
            few = thin(len(coordinate), 8000)
            axes.plot(coordinate[few], best.fit.residual[few], ".", ms=1.6, color=MUTED)
            _mean_line(axes, coordinate, best.fit.residual)
            label(axes, words, "")
        left.set_ylabel(f"residual ({unit})")
        return figure

    caption = f"{subject.name}: what {best.law} leaves, over position and over speed; line: its mean there."
    return picture_of(f"{subject.name}_where", caption, draw)


def _mean_line(axes: Axes, coordinate: Array, residual: Array) -> None:
    bins = int(min(BINS, max(2, len(residual) // 20)))
    order = np.argsort(coordinate, kind="stable")
    parts = np.array_split(order, bins)
    x, y = ([float(np.mean(values[part])) for part in parts] for values in (coordinate, residual))
    axes.plot(x, y, color=IMPROVED, lw=1.0)


def _unit(subject: Subject) -> str:
    return f"{subject.best.offset.unit}, as logged"


def summary_table(subjects: Sequence[Subject]) -> Html:
    """One line a recording, one column a law: what is left of the torque on held-out samples, the least marked."""
    laws = sorted({law for subject in subjects for law in subject.found})
    rows: list[list[str | Cell]] = []
    for subject in subjects:
        row: list[str | Cell] = [subject.name]
        for law in laws:
            text = f"{100.0 * subject.unexplained(law):.1f} %" if law in subject.found else "–"
            row.append(Cell(text, True) if law == subject.ranking[0] else text)
        rows.append(row)
    caption = "Torque left unexplained on samples that no fit saw, rms over rms; green: the least of the line"
    return table(["recording", *laws], rows, caption)


def law_table(subject: Subject) -> Html:
    """Laws, best first, with residuals and what is left in dependence on position and speed."""
    unit = subject.best.offset.unit
    rows = []
    for law in subject.ranking:
        item = subject.found[law]
        by_position = dependence(item.fit.residual, subject.position(law))
        by_speed = dependence(item.fit.residual, item.fit.velocity)
        lost = [name.replace("_", " ") for name, value in item.parameters.items() if not value.determined]
        row = [law, f"{item.rmse.held_out:.4g}", f"{item.rmse.train:.4g}", f"{100 * by_position:.0f} %"]
        rows.append([*row, f"{100 * by_speed:.0f} %", f"{item.seconds:.1f}", ", ".join(lost) or "–"])
    head = [
        "law",
        f"held out ({unit})",
        f"train ({unit})",
        "left with position",
        "left with speed",
        "time (s)",
    ]
    return table([*head, "undetermined"], rows)


def sentence(subjects: Sequence[Subject]) -> str:
    """The message of the page."""
    shares = [100.0 * subject.unexplained(subject.ranking[0]) for subject in subjects]
    structured = [
        item.name for item in subjects
        if dependence(item.best.fit.residual, item.position(item.ranking[0])) > NOTABLE
        or dependence(item.best.fit.residual, item.best.fit.velocity) > NOTABLE
    ]  # fmt: skip
    count = "one recording" if len(subjects) == 1 else f"{len(subjects)} recordings"
    return (
        f"On {count} of real axes the best friction law leaves {min(shares):.1f} to {max(shares):.1f} % of the torque; on "
        f"{len(structured)} of them what is left still goes with position or speed, which ./tcs diagnose is for."
    )


def write_report(directory: Path, subjects: Sequence[Subject]) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    parts: list[Html] = [section("All recordings, all laws", summary_table(subjects))]
    pictures: list[Picture] = []
    for subject in subjects:
        drawn = [draw_time(subject), draw_where(subject)]
        pictures += drawn
        notes = [subject.what] if subject.what else []
        parts.append(
            section(subject.name, *notes, *remarks(subject), *map(picture, drawn), law_table(subject))
        )
    document = page("Friction laws on real axes", sentence(subjects), *parts)
    return write_page(directory / "report.html", document, pictures)
