"""The numbers that sum up diagnoses of many worlds, and the report with the reliability diagram."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.concealed_score import BINS, Bin, Judged, Named, reliability
from tcs_friction.config import write_whole
from tcs_friction.diagnose.rules import RULES
from tcs_friction.report.figures import IMPROVED, MUTED, drawn, label, panels
from tcs_friction.report.html import page, picture, section, table, write_page

SURE = 0.95  # stated probability from which a name is taken for granted
FLOORS = 1.2  # held-out residual over the noise floor at which nothing is left to find
RIGHT, FALSE, SAID, FALSE_BESIDE, SURE_TRUE, LAWS = 90.0, 2.0, 95.0, 10.0, 95.0, 95.0  # bars, %

MOST_WORLDS = 12  # of each sort, named beside a rule

Row = dict[str, Any]


def row(name: str, value: float, unit: str = "1", beside: float | None = None) -> Row:
    """One result; the ratio is of the value to what stands beside it."""
    ratio = value / beside if beside else None
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": ratio}


def summary(kind: str, judged: Sequence[Judged]) -> list[Row]:
    """What each kind of worlds has to show, beside its bar where it has one."""
    inside = [j for j in judged if not j.expected.outside]
    outside = [j for j in judged if j.expected.outside]
    found = _share(f"{kind}: right and no name too many", judged, lambda j: j.right, RIGHT)
    found += _share(
        f"{kind}: nothing missing, said so", [j for j in inside if j.expected.nothing], lambda j: j.right
    )
    found += _share(
        f"{kind}: all that is missing named",
        [j for j in inside if j.expected.effects],
        lambda j: not j.missed,
    )
    found.append(row(f"{kind}: effects missed", float(sum(len(j.missed) for j in judged))))
    found += _share(f"{kind}: recordings with a false name", judged, lambda j: bool(j.false_names), FALSE)
    found += _share(f"{kind}: outside the vocabulary, said so", outside, lambda j: j.said_unexplained, SAID)
    found += _share(
        f"{kind}: outside, a false name beside it", outside, lambda j: bool(j.false_names), FALSE_BESIDE
    )
    moving = [j for j in judged if j.free_run is not None]
    found += _share(
        f"{kind}: free run better than retuned", moving, lambda j: (j.free_run or 0.0) < 1.0, 100.0
    )
    found += _share(f"{kind}: held out within {FLOORS} floors", inside, lambda j: j.held_out <= FLOORS, LAWS)
    floors = [j.held_out for j in inside if np.isfinite(j.held_out)]
    if floors:
        found.append(row(f"{kind}: held-out residual over noise floor, median", float(np.median(floors))))
        found.append(row(f"{kind}: held-out residual over noise floor, worst", max(floors)))
    if judged:
        found.append(
            row(f"{kind}: time per recording, median", float(np.median([j.seconds for j in judged])), "s")
        )
        found.append(row(f"{kind}: time per recording, longest", max(j.seconds for j in judged), "s"))
    return found + [row(f"{kind}: {line(j)}", j.held_out, "floors left") for j in judged if not j.right]


def _share(
    label: str, judged: Sequence[Judged], counted: Callable[[Judged], bool], bar: float | None = None
) -> list[Row]:
    if not judged:
        return []
    share = 100.0 * sum(counted(j) for j in judged) / len(judged)
    return [row(label, share, f"% of {len(judged)}", bar)]


def line(j: Judged) -> str:
    """A world and what was said of it, for the list of failures."""
    names = ", ".join(f"{n.effect}{'' if n.true else ' (false)'} {n.probability:.2f}" for n in j.names)
    missed = f"; missed {', '.join(j.missed)}" if j.missed else ""
    return f"{j.world} is called {j.verdict}: {names or 'no name'}{missed}"


def reliability_rows(judged: Sequence[Judged]) -> list[Row]:
    """Of all names: share that is true for each bin of stated probability, and of those that are stated as sure."""
    names = [name for j in judged for name in j.names]
    sure = [name for name in names if name.probability >= SURE]
    found = [_bin_row(f"names stated with {b.low:.2f} to {b.high:.2f}, true", b) for b in reliability(names)]
    if sure:
        share = 100.0 * sum(name.true for name in sure) / len(sure)
        found.append(row(f"names stated with at least {SURE}, true", share, f"% of {len(sure)}", SURE_TRUE))
    return found


def rule_rows(judged: Sequence[Judged]) -> list[list[str]]:
    """Rules by how many worlds they kept a false name from, and a true one: rule, worlds, worlds, which they are."""
    found = []
    for rule in RULES:
        false, true = (
            [j.world for j in judged if any(one.rule == rule.name and one.true is sort for one in j.refused)]
            for sort in (False, True)
        )
        if false or true:
            worlds = ", ".join([*false[:MOST_WORLDS], *(f"{name} (true)" for name in true[:MOST_WORLDS])])
            found.append([rule.name, rule.family, str(len(false)), str(len(true)), worlds])
    return found


def _bin_row(label: str, b: Bin) -> Row:
    low, high = b.interval
    unit = f"% of {b.count} (95 %: {100.0 * low:.0f} to {100.0 * high:.0f})"
    return row(label, 100.0 * b.share, unit, 100.0 * b.stated)


@drawn(
    "reliability",
    "Share of names that is true (points, with Wilson's 95 % interval and the count) beside the probability stated (grey).",
)
def reliability_diagram(names: Sequence[Named]) -> Figure:
    """One place for each bin of the table; points below the grey bar claim too much."""
    figure, (axes,) = panels(height=4.2, width=6.0)
    for b in reliability(names):
        place, (low, high) = BINS.index(b.low), b.interval
        axes.plot([place - 0.35, place + 0.35], [b.stated, b.stated], color=MUTED, linewidth=3.0)
        axes.plot([place, place], [low, high], color=IMPROVED)
        axes.plot([place], [b.share], "o", color=IMPROVED)
        axes.annotate(
            str(b.count), (place, low), textcoords="offset points", xytext=(0, -4), ha="center", va="top"
        )
    axes.set_xticks(range(len(BINS) - 1), [f"{low:g} to {high:g}" for low, high in pairwise(BINS)])
    axes.set_xlim(-0.5, len(BINS) - 1.5)
    axes.set_ylim(-0.1, 1.05)
    label(axes, "stated probability", "share that is true")
    return figure


def write_report(folder: Path, judged: Sequence[Judged], rows: Sequence[Row]) -> Path:
    """report.html, reliability.png and judged.json, what was said of each world; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for j in judged for name in j.names]
    diagram = reliability_diagram(names)
    wrong = [(j.kind, line(j), f"{j.held_out:.3g}") for j in judged if not j.right]
    right = sum(j.right for j in judged)
    document = page(
        "Diagnosis of concealed physics",
        f"{right} of {len(judged)} worlds are diagnosed right, with no name too many.",
        section("Can the stated probability be believed?", picture(diagram)),
        section("Results", table(("what", "value", "unit", "bar"), [_cells(entry) for entry in rows])),
        section(
            "What each rule refused",
            table(("rule", "family", "worlds with a false name refused", "with a true one", "worlds"), rule_rows(judged)),
        ),
        section(
            "Worlds that were not diagnosed right", table(("kind", "world", "held-out over floor"), wrong)
        ),
    )
    write_whole(folder / "judged.json", json.dumps([_plain(j) for j in judged], indent=1) + "\n")
    return write_page(folder / "report.html", document, [diagram])


def _cells(entry: Row) -> tuple[str, str, str, str]:
    beside = "" if entry["beside"] is None else f"{entry['beside']:.4g}"
    return entry["name"], f"{entry['value']:.4g}", "" if entry["unit"] == "1" else entry["unit"], beside


def _plain(j: Judged) -> dict[str, Any]:
    held_out = j.held_out if np.isfinite(j.held_out) else None
    return asdict(j) | {"expected": j.expected.to_mapping(), "held_out": held_out}
