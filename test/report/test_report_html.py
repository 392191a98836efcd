"""Pages: self-contained, escaped, numbers to the right."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tcs_friction.report import figures
from tcs_friction.report.html import (
    Cell,
    Html,
    Number,
    key_numbers,
    page,
    paragraph,
    picture,
    section,
    table,
    write_page,
)
from tcs_friction.report.numbers import with_error

PNG = b"\x89PNG\r\n\x1a\n"
VOID = {"meta", "img", "br", "link"}


class Checker(HTMLParser):
    """Fails on a tag that is not closed in order; collects what the page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def checked(document: str) -> Checker:
    checker = Checker()
    checker.feed(document)
    assert checker.open == []
    return checker


@figures.drawn("wave", "A wave of <5 N m>.")
def draw_wave(count: int) -> Figure:
    figure, (axes,) = figures.panels()
    x = np.linspace(0.0, 1.0, count)
    figures.line(axes, x, np.sin(40.0 * x), figures.IMPROVED, "wave")
    figures.label(axes, "time (s)", "torque (N m)")
    figures.legend(axes)
    return figure


def test_page_refers_to_nothing_outside_itself() -> None:
    document = page(
        "t", "s", section("head", "words", picture(draw_wave(50))), key_numbers([Number("a", "1")])
    )
    sources = checked(document).sources
    assert len(sources) == 1
    assert sources[0].startswith("data:image/png;base64,")
    assert base64.b64decode(sources[0].partition(",")[2]).startswith(PNG)
    assert "http" not in document


def test_text_is_escaped_and_markup_is_not() -> None:
    document = page(
        "a <b>", "x < y & z", paragraph("<script>"), Html("<p>kept</p>"), table(["<h>"], [["<c>"]])
    )
    assert "<script>" not in document
    assert "x &lt; y &amp; z" in document
    assert "<p>kept</p>" in document
    assert "&lt;h&gt;" in document
    assert "&lt;c&gt;" in document
    checked(document)


def test_the_sentence_stands_on_top() -> None:
    document = page("title", "The message.", section("later", "words"), remark="small")
    assert document.index("The message.") < document.index("small") < document.index("later")


def test_numeric_columns_are_flush_right_and_words_are_not() -> None:
    made = table(["name", "value"], [["a", "1.5 N m"], ["b", "–"], ["c", "-2"]])
    assert made.count("class=n") == 1
    assert made.count('class="n"') == 3


def test_judged_cells_are_coloured() -> None:
    made = table(["x"], [[Cell("1", True)], [Cell("2", False)]])
    assert re.findall(r'class="n (good|bad)"', made) == ["good", "bad"]


def test_written_page_brings_its_pictures_and_leaves_nothing_else(tmp_path: Path) -> None:
    wave = draw_wave(50)
    path = write_page(tmp_path / "new" / "report.html", page("t", "s", picture(wave)), [wave])
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["report.html", "wave.png"]
    assert (path.parent / "wave.png").read_bytes() == wave.png


def test_same_drawing_gives_the_same_bytes() -> None:
    assert draw_wave(500).png == draw_wave(500).png


def test_drawing_leaves_no_trace_in_matplotlib() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw_wave(10)
    assert dict(matplotlib.rcParams) == before


def test_envelope_keeps_a_single_spike() -> None:
    y = np.zeros(100_000)
    y[31_415] = 7.0
    kept = figures.envelope(y, most=1000)
    assert len(kept) <= 1002
    assert y[kept].max() == 7.0
    assert (np.diff(kept) > 0).all()
    assert (kept[0], kept[-1]) == (0, 99_999)


def test_envelope_of_few_points_is_all_of_them() -> None:
    assert (figures.envelope(np.arange(10.0), most=20) == np.arange(10)).all()


def test_thin_keeps_about_the_number_asked_for() -> None:
    assert 3000 <= len(np.arange(123_456)[figures.thin(123_456, 4000)]) <= 8000


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (72.0013, 0.012, "72.001 ± 0.012"),
        (296123.0, 1234.0, "296100 ± 1200"),
        (0.5, None, "0.5"),
        (0.5, 0.0, "0.5"),
        (0.5, float("nan"), "0.5"),
        (2.5e-9, 1.2e-10, "2.5e-09 ± 1.2e-10"),
    ],
)
def test_a_value_is_shown_to_the_second_digit_of_its_error(
    value: float, std: float | None, shown: str
) -> None:
    assert with_error(value, std) == shown
