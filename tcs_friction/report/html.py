"""One self-contained HTML page: a sentence on top, key numbers, sections with text, tables, plots and pictures.

The page needs nothing beside itself: style, pictures, and the script that makes plots move are inside. It prints, and follows the
reader's light or dark setting. Text given as `str` is escaped; what these functions return is `Html` and is taken as it is.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tcs_friction.config import write_whole
from tcs_friction.report.figures import Picture
from tcs_friction.report.plot_page import MARK, plot_figure, plot_foot, plot_head

STYLE = """
:root{color-scheme:light dark;--ink:#1b1f24;--soft:#59636e;--paper:#fff;--card:#f5f7f9;--line:#d5dbe1;
--accent:#0072b2;--good:#00704f;--bad:#b34700;--panel:#fff;--grid:#e3e7eb;--span:#eceff2;--select:rgba(0,114,178,.15)}
@media(prefers-color-scheme:dark){:root{--ink:#e4e8ec;--soft:#a3adb8;--paper:#15181c;
--card:#1e2328;--line:#39414a;--accent:#6cb8ea;--good:#4cc9a0;--bad:#ff9a5c;--panel:#1a1e22;--grid:#2d343b;--span:#252b31;
--select:rgba(108,184,234,.2)}}
*{box-sizing:border-box}
body{margin:0 auto;padding:2rem 1.2rem 4rem;max-width:62rem;background:var(--paper);color:var(--ink);
font:16px/1.5 system-ui,-apple-system,"Segoe UI","DejaVu Sans",sans-serif}
header{border-bottom:3px solid var(--accent);margin-bottom:1.5rem;padding-bottom:1rem}
h1{font-size:1rem;font-weight:600;color:var(--soft);margin:0 0 .4rem}
.sentence{font-size:1.45rem;line-height:1.3;font-weight:600;margin:0}
.note{color:var(--soft);font-size:.9rem;margin:.4rem 0}
h2{font-size:1.2rem;margin:2.2rem 0 .5rem}
p{margin:.5rem 0;max-width:48rem}
.numbers{display:grid;grid-template-columns:repeat(auto-fit,minmax(11rem,1fr));gap:.7rem;margin:1rem 0}
.number{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.7rem .9rem}
.number b{display:block;overflow-wrap:anywhere;font-size:1.4rem;line-height:1.2;font-variant-numeric:tabular-nums}
.number span{display:block;font-size:.85rem;color:var(--soft)}
.good b,td.good{color:var(--good)}.bad b,td.bad{color:var(--bad)}
.wide{overflow-x:auto}
table{border-collapse:collapse;margin:.8rem 0;font-size:.92rem;font-variant-numeric:tabular-nums}
th,td{padding:.3rem .8rem .3rem 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{color:var(--soft);font-weight:600;border-bottom-width:2px}
th.n,td.n{text-align:right}
td.n{white-space:nowrap}
caption{caption-side:top;text-align:left;color:var(--soft);padding-bottom:.2rem}
figure{margin:1rem 0;break-inside:avoid}
figure img{display:block;width:100%;height:auto;background:#fff;border:1px solid var(--line);
border-radius:8px;padding:.4rem}
figcaption{font-size:.9rem;color:var(--soft);margin-top:.3rem;max-width:52rem}
@media screen and (prefers-color-scheme:dark){figure img{filter:invert(.9) hue-rotate(180deg)}}
@media screen and (max-width:40rem){figure img{width:auto;min-width:30rem;max-width:none}}
@media screen and (max-width:40rem){.sentence{font-size:1.15rem}}
@media print{body{max-width:none;padding:0;font-size:11pt}h2,caption{break-after:avoid}tr,.number{break-inside:avoid}
.wide{overflow:visible;break-inside:avoid}table{font-size:9pt}th,td{padding-right:.5rem}}
"""


class Html(str):
    """Markup that is put into the page as it is."""

    __slots__ = ()


@dataclass(frozen=True)
class Number:
    """A key number: `good` colours it (None: neutral); `note` is the small print under it."""

    label: str
    value: str
    note: str = ""
    good: bool | None = None


@dataclass(frozen=True)
class Cell:
    """A table cell that is judged: green when `good`, orange when not."""

    text: str
    good: bool


def text(content: str) -> Html:
    """Escaped, unless it is markup already."""
    return content if isinstance(content, Html) else Html(html.escape(content))


def paragraph(content: str) -> Html:
    """A paragraph."""
    return Html(f"<p>{text(content)}</p>")


def note(content: str) -> Html:
    """Small print."""
    return Html(f'<p class="note">{text(content)}</p>')


def section(title: str, *parts: str) -> Html:
    """A heading and what belongs under it; a plain string is a paragraph."""
    inner = "\n".join(part if isinstance(part, Html) else paragraph(part) for part in parts)
    return Html(f"<section><h2>{text(title)}</h2>\n{inner}</section>")


def key_numbers(numbers: Sequence[Number]) -> Html:
    """The few numbers that a reader should take away, as a row of cards."""
    judged = {True: " good", False: " bad", None: ""}
    cards = [
        f'<div class="number{judged[n.good]}"><span>{text(n.label)}</span><b>{text(n.value)}</b>'
        f"<span>{text(n.note)}</span></div>"
        for n in numbers
    ]
    return Html(f'<div class="numbers">{"".join(cards)}</div>')


def table(head: Sequence[str], rows: Iterable[Sequence[str | Cell]], caption: str = "") -> Html:
    """A table. A column whose every filled cell starts like a number is set flush right."""
    body = [list(row) for row in rows]
    numeric = [all(_is_number(row[i]) for row in body) for i in range(len(head))]
    top = "".join(f"<th{' class=n' if numeric[i] else ''}>{text(name)}</th>" for i, name in enumerate(head))
    lines = "".join(
        f"<tr>{''.join(_cell(entry, numeric[i]) for i, entry in enumerate(row))}</tr>" for row in body
    )
    label = f"<caption>{text(caption)}</caption>" if caption else ""
    inner = f"{label}<thead><tr>{top}</tr></thead><tbody>{lines}</tbody>"
    return Html(f'<div class="wide"><table>{inner}</table></div>')


def _cell(entry: str | Cell, numeric: bool) -> str:
    classes = ["n"] if numeric else []
    if isinstance(entry, Cell):
        classes.append("good" if entry.good else "bad")
    attribute = f' class="{" ".join(classes)}"' if classes else ""
    return f"<td{attribute}>{text(_words(entry))}</td>"


def _words(entry: str | Cell) -> str:
    return entry.text if isinstance(entry, Cell) else entry


def _is_number(entry: str | Cell) -> bool:
    words = _words(entry).strip()
    return words in ("", "–") or words.lstrip("+-−<>≤≥±≈ ")[:1].isdigit()


def picture(drawn: Picture) -> Html:
    """A picture inside the page, with its caption; one of a plot can be zoomed and read off on a screen."""
    if drawn.plot is not None:
        return Html(plot_figure(drawn.plot, drawn.png))
    data = base64.b64encode(drawn.png).decode("ascii")
    image = f'<img alt="{html.escape(drawn.caption)}" src="data:image/png;base64,{data}">'
    return Html(f'<figure><div class="wide">{image}</div><figcaption>{text(drawn.caption)}</figcaption></figure>')


def page(title: str, sentence: str, *parts: str, remark: str = "") -> str:
    """The whole document: `title` in the tab and above, `sentence` the message, `remark` small under it."""
    small = note(remark) if remark else ""
    body = "\n".join(part if isinstance(part, Html) else paragraph(part) for part in parts)
    head, foot = (plot_head(), plot_foot()) if MARK in body else ("", "")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{text(title)}</title>'
        f"<style>{STYLE}</style>{head}</head>\n<body><header><h1>{text(title)}</h1>"
        f'<p class="sentence">{text(sentence)}</p>{small}</header>\n{body}\n{foot}</body></html>\n'
    )


def write_page(path: Path, document: str, pictures: Sequence[Picture] = ()) -> Path:
    """Write the page, and each picture as NAME.png beside it, whole or not at all; returns its path."""
    for drawn in pictures:
        drawn.save(path.parent)
    write_whole(path, document)
    return path
