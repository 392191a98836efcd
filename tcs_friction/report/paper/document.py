"""All experiments of the paper, one after the other, and the page that shows them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.report import published
from tcs_friction.report.commission import cut
from tcs_friction.report.html import Cell, Html, Number, key_numbers, page, section, table, write_page
from tcs_friction.report.paper import identification, measurement, observers, plant, tasks, tracking
from tcs_friction.report.paper.stand import Stand

Progress = Callable[[str, float], None]  # what is being done, share of the whole that is done


@dataclass(frozen=True)
class PaperResult:
    """What every experiment gave."""

    plant: plant.PlantResult
    measurement: measurement.MeasurementResult
    observers: observers.ObserversResult
    search: identification.SearchResult
    tracking: tracking.TrackingResult
    tasks: tuple[tasks.Task, ...]
    seconds: float

    def to_mapping(self) -> dict[str, Any]:
        """The numbers, ours beside the paper's (None where the paper has none)."""
        return {
            "schema": "tcs_friction/paper/1",
            "comparisons": [
                {"name": row.name, "value": row.value, "unit": row.unit, "paper": row.paper}
                for row in comparisons(self)
            ],
            "seconds": self.seconds,
        }


@dataclass(frozen=True)
class Row:
    """One number beside the paper's; `higher` is better, or lower."""

    name: str
    value: float
    unit: str
    paper: float | None
    higher: bool
    remark: str = ""


def measure(stand: Stand, progress: Progress = lambda _what, _share: None) -> PaperResult:
    """Make all experiments."""
    began = time.perf_counter()
    progress("frequency response", 0.0)
    response = plant.measure(stand)
    progress("friction at ten speeds", 0.1)
    friction = measurement.measure(stand)
    progress("observers compared", 0.2)
    compared = observers.measure(stand)
    progress("identification", 0.3)
    searches = identification.SEEDS * len(identification.METHODS)
    shares = [0.0]

    def searching(share: float) -> None:
        if share < shares[-1]:
            shares.append(share)  # the next search begins
        shares[-1] = share
        progress("identification", min(0.3 + 0.5 * (len(shares) - 1 + share) / searches, 0.8))

    search = identification.measure(stand, friction.run, lambda g: searching(g.share))
    compensator = search.compensator(stand.control.compensator)
    progress("compensation", 0.8)
    tracks = tracking.measure(stand, compensator)
    progress("four tasks", 0.9)
    jobs = tasks.measure(stand, compensator)
    progress("report", 0.95)
    return PaperResult(response, friction, compared, search, tracks, jobs, time.perf_counter() - began)


def comparisons(result: PaperResult) -> list[Row]:
    """Our numbers beside the paper's."""
    before, after = published.BEFORE, published.AFTER
    ours = result.tracking.errors
    none, both = ours[tracking.NONE], ours[tracking.BOTH]
    median = {method: float(np.median(values)) for method, values in result.search.spread.items()}
    calibration = result.measurement.calibration
    simulated = "a simulated axis and dynamometer beside real ones"
    return [
        Row("accuracy of the observer", 100 * calibration.accuracy, "%", 100 * published.DOB_ACCURACY, True, simulated),
        Row("accuracy of the observer in uniform motion", 100 * calibration.accuracy_uniform, "%", None, True, simulated),
        Row("identification RMSE, PSO-GA", median["pso-ga"], "N m", published.RMSE_PSO_GA, False,
            "not comparable: other friction data"),
        Row("identification RMSE, PSO alone", median["pso"], "N m", published.RMSE_PSO, False,
            "not comparable: other friction data"),
        Row("identification RMSE, swarm and Levenberg-Marquardt", median["default"], "N m", None, False),
        Row("positive peaks cut by", 100 * cut(none.peak_positive, both.peak_positive), "%",
            100 * cut(before.peak_positive, after.peak_positive), True),
        Row("negative peaks cut by", 100 * cut(none.peak_negative, both.peak_negative), "%",
            100 * cut(before.peak_negative, after.peak_negative), True),
        Row("tracking RMS cut by", 100 * cut(none.rms, both.rms), "%", 100 * cut(before.rms, after.rms), True),
        Row("peaks cut by, parameters 5 % off", 100 * result.tracking.peak_cut(tracking.OFF), "%", None, True),
        Row("RMS cut by, parameters 5 % off", 100 * result.tracking.rms_cut(tracking.OFF), "%", None, True),
    ]  # fmt: skip


def write_report(directory: Path, result: PaperResult) -> Path:
    """Write DIR/report.html and its pictures; returns the page's path."""
    tracks = result.tracking
    ours, none = tracks.errors[tracking.BOTH], tracks.errors[tracking.NONE]
    chapters = (
        tasks.chapter(result.tasks),
        plant.chapter(result.plant),
        measurement.chapter(result.measurement),
        observers.chapter(result.observers),
        identification.chapter(result.search),
        tracking.chapter(tracks),
    )
    sentence = (
        f"On an axis made to show the paper's tracking errors, the paper's method as built here cuts the peaks at zero "
        f"crossings by {100 * tracks.peak_cut(tracking.BOTH):.0f} % (paper: 74.8 and 55.1 %) and the tracking RMS by "
        f"{100 * tracks.rms_cut(tracking.BOTH):.0f} % (paper: 36.2 %)."
    )
    numbers = key_numbers(
        [
            Number("peak before", f"{none.peak_positive:.3f}″", "paper 0.893″"),
            Number("peak after", f"{ours.peak_positive:.3f}″", "paper 0.225″", True),
            Number("RMS before", f"{none.rms:.3f}″", "paper 0.116″"),
            Number("RMS after", f"{ours.rms:.3f}″", "paper 0.074″", True),
            Number(
                "observer's accuracy",
                f"{100 * result.measurement.calibration.accuracy:.2f} %",
                "paper 96.94 %",
            ),
        ]
    )
    document = page(
        "The paper's section 5 on a simulated axis",
        sentence,
        numbers,
        section("Ours beside theirs", _table(result), *WORDS),
        *(chapter.html for chapter in chapters),
        remark=f"Made in {result.seconds:.0f} s. What is damaged in the paper, and what is built instead: docs/paper-errata.md.",
    )
    pictures = [image for chapter in chapters for image in chapter.pictures]
    return write_page(directory / "report.html", document, pictures)


WORDS = (
    "Comparable are the cuts: the simulated axis has the paper's friction (Table 2) and, uncompensated, the paper's errors. "
    "Not comparable are numbers that depend on the telescope itself: the noise of its observed friction, the units of eq. 10, "
    "the errors that are left when friction is gone.",
)


def _table(result: PaperResult) -> Html:
    rows: list[list[str | Cell]] = []
    for row in comparisons(result):
        shown = f"{row.value:.4g} {row.unit}"
        if row.paper is None:
            rows.append([row.name, shown, "–", row.remark])
        elif row.remark.startswith("not"):
            rows.append([row.name, shown, f"{row.paper:.4g} {row.unit}", row.remark])
        else:
            better = row.value > row.paper if row.higher else row.value < row.paper
            rows.append([row.name, Cell(shown, better), f"{row.paper:.4g} {row.unit}", row.remark])
    return table(["", "ours", "paper", ""], rows)
