"""Times of a table: words that are times, and the unit of numbers that nobody has told."""

from __future__ import annotations

import datetime
import re
from typing import Protocol

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording import units
from tcs_friction.recording.mending import mended
from tcs_friction.recording.recording import Column

FIRST_DATE, LAST_DATE = 1e9, 4e9  # s since 1970, the years 2001 and 2096; smaller times count from something else
LONGEST = 1e9  # s, thirty years; times that are farther apart are in another unit
FASTEST, SLOWEST = 2e-5, 1.0
"""s between samples of an axis: a current loop at 50 kHz, the fastest of drives; and a second, beyond which no motion shows."""

DAY = 86_400.0
FACTORS = {unit: units.SECONDS[unit][0] for unit in ("s", "ms", "us", "ns")}
_CLOCK = re.compile(r"\s*(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)\s*")


class TextTimes(Protocol):
    """Times in words, cell by cell."""

    start: int

    def __call__(self, cell: str) -> float:
        """s from the first, NaN for what is no such time."""

    def notes(self) -> list[str]:
        """What was assumed or mended."""


class Dates:
    """ISO 8601 with a zone or without. start: of the first, ns since 1970."""

    def __init__(self, first: datetime.datetime) -> None:
        self.first = first
        utc = first if first.tzinfo is not None else first.replace(tzinfo=datetime.UTC)
        since = utc - datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
        self.start = (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000

    @classmethod
    def of(cls, cell: str) -> Dates | None:
        """The reader of a column that begins with this cell, None if that is no date."""
        moment = _moment(cell)
        return cls(moment) if moment is not None else None

    def __call__(self, cell: str) -> float:
        moment = _moment(cell)
        try:
            return np.nan if moment is None else (moment - self.first).total_seconds()
        except TypeError:  # one has a zone, the other none
            return np.nan

    def notes(self) -> list[str]:
        return [] if self.first.tzinfo is not None else ["dates without a zone, taken as UTC"]


def _moment(cell: str) -> datetime.datetime | None:
    text = cell.strip()
    if re.match(r"\d{4}/", text):
        text = text.replace("/", "-")
    try:
        return datetime.datetime.fromisoformat(re.sub(r"\s*(UTC|GMT)$", "+00:00", text))
    except ValueError:
        return None


class Clock:
    """h:m:s or m:s of a day that nobody tells, past midnight as well."""

    start = 0

    def __init__(self, first: float) -> None:
        self.first = self.last = first
        self.days = 0

    @classmethod
    def of(cls, cell: str) -> Clock | None:
        """The reader of a column that begins with this cell, None if that is no time of a clock."""
        seconds = _of_clock(cell)
        return None if np.isnan(seconds) else cls(seconds)

    def __call__(self, cell: str) -> float:
        seconds = _of_clock(cell)
        if seconds < self.last - 0.5 * DAY:
            self.days += 1
        self.last = seconds if seconds == seconds else self.last
        return seconds + self.days * DAY - self.first

    def notes(self) -> list[str]:
        return [mended("the clock passes midnight, counted on")] if self.days else []


def _of_clock(cell: str) -> float:
    match = _CLOCK.fullmatch(cell)
    if match is None:
        return np.nan
    return 3600.0 * float(match[1] or 0) + 60.0 * float(match[2]) + float(match[3].replace(",", "."))


def unit_of_date(times: Column) -> str:
    """The unit in which numbers count from 1970, "" where they do not."""
    first = float(np.min(times, initial=np.inf))
    return next((unit for unit, factor in FACTORS.items() if FIRST_DATE <= first * factor <= LAST_DATE), "")


def unit_of_times(times: Column, name: str, where: str, pace: float, notes: list[str]) -> str:
    """The unit of times whose column has none.

    Told by dates since 1970, which no two units share; by the pace, the positions' motion over that of recorded speeds and the
    numbers' steps, 1 where they are seconds (NaN where nothing tells it); else by what an axis is sampled at: steps below 1 are
    seconds. Raises InputError where several units could be.
    """
    dated = unit_of_date(times)
    if dated:
        notes.append(mended(f"column {name!r} has no unit, counts {dated} since 1970") if dated != "s" else taken_as_si(name))
        return dated
    for unit, factor in FACTORS.items():
        if 0.5 < pace / factor < 2.0:  # the units lie three decades apart
            told = mended(f"column {name!r} has no unit, {unit} by positions and velocities")
            notes.append(told if unit != "s" else taken_as_si(name))
            return unit
    ordered = np.unique(times)
    step = float(np.median(np.diff(ordered))) if len(ordered) > 1 else 0.0
    if FASTEST <= step < SLOWEST or not step:
        notes.append(taken_as_si(name))
        return "s"
    fitting = [unit for unit, factor in FACTORS.items() if FASTEST <= step * factor <= SLOWEST]
    if len(fitting) == 1 and fitting != ["s"]:
        notes.append(mended(f"column {name!r} has no unit, {fitting[0]} by its steps of {step:g}"))
        return fitting[0]
    likely = " or ".join(fitting) or "nothing that an axis is sampled at"
    days = FASTEST <= step * DAY <= SLOWEST  # serial dates of a spreadsheet
    expected = f"the unit: --column time={name}:{'d' if days else next(iter(fitting[-1:]), 's')}"
    raise InputError(where, f"column {name!r} has no unit and steps of {step:g}, {likely}", expected)


def taken_as_si(name: str) -> str:
    """The note on a column whose unit nobody tells."""
    return f"column {name!r} has no unit, taken as SI"


def pace_of(times: Column, position: Column, velocity: Column) -> float:
    """Motion between samples over that which velocities and times make; NaN where there is none."""
    steps, speeds = np.diff(times), 0.5 * np.abs(velocity[1:] + velocity[:-1])
    moved = np.abs(np.diff(position))
    good = np.isfinite(steps) & np.isfinite(speeds) & np.isfinite(moved) & (steps > 0.0)
    if not good.any():
        return np.nan
    usual = steps <= 2.0 * np.median(steps[good])
    expected = float(np.sum((speeds * steps)[good & usual]))
    return float(np.sum(moved[good & usual])) / expected if expected > 0.0 else np.nan
