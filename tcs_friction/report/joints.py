"""One page over the joints of a recording: a row for each, what was found and where."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from tcs_friction.report.html import Cell, Html, page, section, table, write_page

INDEX = "index.html"


@dataclass(frozen=True)
class JointRow:
    """A joint: its name, what was found in a sentence, whether that is a result, and the page of it, relative, "" for none."""

    joint: str
    found: str
    good: bool
    link: str = ""


def write_joints(directory: Path, title: str, sources: Sequence[str], rows: Sequence[JointRow]) -> Path:
    """The page; returns its path."""
    bad = sum(not row.good for row in rows)
    sentence = f"{len(rows)} joints" + (f", {bad} of them without a result." if bad else ".")
    lines = [[str(number), _linked(row), row.found if row.good else Cell(row.found, False)] for number, row in enumerate(rows)]
    document = page(f"{title}: {', '.join(sources)}", sentence, section("Joints", table(["number", "joint", "found"], lines)))
    return write_page(directory / INDEX, document)


def _linked(row: JointRow) -> Html:
    name = html.escape(row.joint)
    return Html(f'<a href="{html.escape(quote(row.link))}">{name}</a>' if row.link else name)
