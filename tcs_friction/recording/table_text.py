"""Text tables as loggers, spreadsheets and scripts write them: columns of numbers and times by name."""

from __future__ import annotations

import array
import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording import units
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.mending import mended
from tcs_friction.recording.table import MAX_COLUMNS, MAX_NAME, RUN_BY_SPREADSHEETS, Table, checked
from tcs_friction.recording.table_times import Clock, Dates, TextTimes

BLOCK = 1 << 20
"""Characters read at a time."""

HEAD = 1 << 16
"""Bytes by which the encoding is told."""

CHARACTERS_PER_STEP = 8
"""Of a text, in a step (see Allowance): a number and its comma."""

MAX_LINE = MAX_COLUMNS * MAX_NAME
"""Characters of a line."""

SEPARATORS = ("\t", ";", ",")
"""Between cells, those first that are never part of a number; blanks where there is none of them."""

NO_VALUE = ("", "-", "--", "?", "na", "n/a", "nan", "null", "none")
"""What stands in a cell without a value."""

MOST_SHOWN = 40
"""Characters of a cell in a message."""
_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}(?:[.,' ]\d{3})+(?:[.,]\d+)?\s*")
_BLANK_HEAD = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")


def read_text(path: Path) -> Table:
    """Columns of a text table: `,` `;` tab or blanks between cells, decimal points or commas, with a heading or without; .gz too.

    Lines that are blank or begin with # are passed over. Cells that are no number are NaN, dates and h:m:s become seconds. A row
    of units may follow the heading. Raises InputError naming the row that does not fit.
    """
    try:
        with ExitStack() as stack:
            raw: Any = stack.enter_context(path.open("rb"))
            if path.suffix.lower() == ".gz":
                raw = stack.enter_context(gzip.open(raw))
            reader = io.BufferedReader(raw, BLOCK)
            stream = io.TextIOWrapper(reader, _encoding(reader.peek(BLOCK)[:HEAD]))
            return _TextTable(path).read(_lines(stream, path))
    except (OSError, EOFError, UnicodeError, csv.Error, zlib.error) as error:
        raise InputError(str(path), f"cannot be read ({error})", "a text table") from None


def _encoding(head: bytes) -> str:
    """UTF-8, UTF-16 by its mark or its zeros, else Latin-1, in which ° and µ are one byte."""
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    pairs = len(head) // 2
    if pairs and head[1::2].count(0) > 0.9 * pairs:
        return "utf-16-le"
    if pairs and head[0::2].count(0) > 0.9 * pairs:
        return "utf-16-be"
    try:
        head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return "utf-8-sig" if error.start > len(head) - 4 else "latin-1"  # a letter may be cut at the end
    return "utf-8-sig"


def _lines(stream: io.TextIOWrapper, path: Path) -> Iterator[str]:
    """Lines without their ends, never more than one and a block in memory. What is packed may unpack to 32 times its size."""
    allowance, rest = Allowance(str(path), path.stat().st_size), ""
    while block := stream.read(BLOCK):
        allowance.spend(len(block) // CHARACTERS_PER_STEP)
        lines = (rest + block).split("\n")
        rest = lines.pop()
        if len(rest) > MAX_LINE:
            raise InputError(str(path), f"a line of more than {MAX_LINE} characters", "a line for each row")
        yield from lines
    if rest:
        yield rest


@dataclass
class _TextTable:
    """A table while it is read."""

    path: Path
    notes: list[str] = field(default_factory=list)
    cells: array.array[float] = field(default_factory=lambda: array.array("d"))
    times: dict[int, TextTimes] = field(default_factory=dict)
    texts: dict[int, str] = field(default_factory=dict)
    rows: int = 0

    def read(self, lines: Iterator[str]) -> Table:
        head, comment = self._head(lines)
        split = _splitter(head)
        names = next(split.rows([head]), [])
        headless = bool(names) and all(_is_number(name) or not name.strip() for name in names)
        rows = split.rows(line for line in lines if line.strip() and not line.startswith("#"))
        if headless:
            told = _splitter(comment).names(comment) if comment else []
            rows, headless = _before([names], rows), len(told) != len(names)
            names = told if not headless else [str(number) for number in range(1, len(names) + 1)]
        else:
            names = split.names(head)
        checked([name for name in names if name], self.path)
        told_units = self._body(names, rows)
        if not self.rows:
            raise InputError(str(self.path), f"{int(bool(head))} lines", "a line of column names and rows of numbers")
        return self._table(names, told_units, headless)

    def _head(self, lines: Iterator[str]) -> tuple[str, str]:
        """The first line that is none of comments, and the comment before it."""
        comment = ""
        for line in lines:
            if line.startswith("#"):
                comment = line.lstrip("# ").rstrip()
            elif line.strip():
                return line.rstrip("\r"), comment
        return "", comment

    def _body(self, names: Sequence[str], rows: Iterator[list[str]]) -> list[str]:
        """Take all rows; the units, where the first one holds them."""
        told: list[str] = []
        first = next(rows, None)
        if first is None:
            return told
        if _is_units(first):
            told, first = [cell.strip().strip("[]()").strip() for cell in first], next(rows, None)
        if first is None:
            return told
        self._look(first)
        width, numbers = len(names), self.cells
        for row in _before([first], rows):
            if len(row) != width:
                fitted = self._fitted(row, names, rows)
                if fitted is None:
                    break
                row = fitted
            self.rows += 1
            if self.times:
                numbers.extend([self.times[k](cell) if k in self.times else self._number(cell) for k, cell in enumerate(row)])
                continue
            try:
                numbers.extend([*map(float, row)])
            except ValueError:
                numbers.extend(map(self._number, row))
        return told

    def _number(self, cell: str) -> float:
        """A number, NaN for anything else. Raises InputError for one that separates thousands: others then look like decimals."""
        value = _number(cell)
        if value != value and _THOUSANDS.fullmatch(cell):
            found = f"{cell.strip()[:MOST_SHOWN]!r} separates thousands"
            raise InputError(f"{self.path}: row {self.rows + 1}", found, "numbers that do not")
        return value

    def _look(self, first: Sequence[str]) -> None:
        """Find the columns whose cells are times in words."""
        kinds: tuple[Callable[[str], TextTimes | None], ...] = (Dates.of, Clock.of)
        for place, cell in enumerate(first):
            if _is_number(cell) or cell.strip().lower() in NO_VALUE:
                continue
            found = next((time for kind in kinds if (time := kind(cell)) is not None), None)
            if found is not None:
                self.times[place] = found
            else:
                self.texts[place] = cell

    def _fitted(self, row: list[str], names: Sequence[str], rest: Iterator[list[str]]) -> list[str] | None:
        """The row with a cell for each name, where only empty ones are too many or too few; None for a last one cut short."""
        width = len(names)
        if not any(cell.strip() for cell in row[width:]) and not any(names[len(row) :]):
            return [*row[:width], *[""] * (width - len(row))]
        if len(row) < width and self.rows and next(rest, None) is None:
            self.notes.append(mended("the last row is cut, left out"))
            return None
        raise InputError(f"{self.path}: row {self.rows + 2}", f"{len(row)} cells", f"{width} as in the first line")

    def _table(self, names: Sequence[str], told: Sequence[str], headless: bool) -> Table:
        table = np.frombuffer(self.cells).reshape(self.rows, len(names))
        columns = {name: np.ascontiguousarray(table[:, place]) for place, name in enumerate(names) if name}
        unit = {name: told[place] for place, name in enumerate(names) if place < len(told) and told[place]}
        starts = {}
        for place, time in self.times.items():
            unit[names[place]], starts[names[place]] = "s", time.start
            self.notes += [f"column {names[place]!r}: {note}" for note in time.notes()]
        texts = {names[place]: cell for place, cell in self.texts.items()}
        return Table(columns, unit, starts, tuple(self.notes), headless, texts)


@dataclass(frozen=True)
class _Splitter:
    """What stands between cells, "" for blanks."""

    separator: str

    def rows(self, lines: Iterator[str] | Sequence[str]) -> Iterator[list[str]]:
        """The cells of each line, decimal commas as points where they are no separator."""
        if not self.separator:
            return (line.replace(",", ".").split() for line in lines)
        if self.separator == ",":
            return csv.reader(lines)
        return csv.reader((line.replace(",", ".") for line in lines), delimiter=self.separator)

    def names(self, head: str) -> list[str]:
        """Names of columns. The apostrophe that `write_csv` puts in front of some is taken away."""
        found = next(csv.reader([head], delimiter=self.separator), []) if self.separator else _BLANK_HEAD.findall(head)
        names = [name.strip() for name in found]
        return [name[1:] if name.startswith("'") and name[1:].startswith(RUN_BY_SPREADSHEETS) else name for name in names]


def _splitter(head: str) -> _Splitter:
    counts = {separator: head.count(separator) for separator in SEPARATORS}
    return _Splitter(max(SEPARATORS, key=lambda one: counts[one]) if _has_words(head) and any(counts.values()) else _sure(counts))


def _sure(counts: dict[str, int]) -> str:
    """Of a line of numbers, in which commas may be decimal ones."""
    return next((separator for separator in SEPARATORS if counts[separator]), "")


def _has_words(head: str) -> bool:
    return any(letter.isalpha() for letter in head)


def _before(first: Sequence[list[str]], rest: Iterator[list[str]]) -> Iterator[list[str]]:
    yield from first
    yield from rest


def _is_units(row: Sequence[str]) -> bool:
    """Whether no cell is a number and one at least a unit."""
    words = [cell.strip().strip("[]()").strip() for cell in row]
    plain = [word for word in words if word not in units.WITHOUT and word.lower() not in NO_VALUE]
    return not any(map(_is_number, plain)) and any(units.is_unit(units.spelled(word)) for word in plain)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _number(cell: str) -> float:
    """A number with a decimal point or, in a cell of its own, a decimal comma; NaN for anything else."""
    try:
        return float(cell)
    except ValueError:
        pass
    try:
        return float(cell.replace(",", ".")) if cell.count(",") == 1 and "." not in cell else np.nan
    except ValueError:
        return np.nan
