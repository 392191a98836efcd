"""The recordings of one axis as columns: what the statistics work on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NANOSECONDS_PER_DAY = 86400e9

SURROUNDINGS = ("temperature", "temperature_change")
PROGRAMME = ("position_from", "position_to", "travel", "speed_rms", "speed_max", "reversals", "duration")
"""How a recording was made, as columns: if these change together with a parameter, they may be why."""


@dataclass(frozen=True)
class Estimates:
    """One parameter in all n recordings of an axis: values and standard deviations (n,), NaN where not determined."""

    unit: str
    value: Array
    std: Array


@dataclass(frozen=True)
class Effect:
    """An effect that a recording was found to have.

    parameters: name -> (value, standard deviation, unit); a deviation that is not known is NaN. equivalent: effects that the
    recording could not tell from it. coordinate: where it shows. torque_rms: N m (N).
    """

    name: str
    parameters: Mapping[str, tuple[float, float, str]]
    equivalent: tuple[str, ...] = ()
    coordinate: str = ""
    torque_rms: float = 0.0


@dataclass(frozen=True)
class AxisRows:
    """All n recordings of one axis in order of time.

    day: (n,) days since 1970, UTC. done: which were identified. diagnosed: which have a verdict. reasons: of those that failed,
    "" otherwise. columns: name -> (n,), everything in SURROUNDINGS and PROGRAMME, NaN where not known. effects: of each.
    left_out: recordings that are not here, and why, one line each. unreadable: why there are none at all, "" where there are.
    """

    axis: str
    recording: tuple[str, ...]
    day: Array
    done: Mask
    diagnosed: Mask
    reasons: tuple[str, ...]
    version: tuple[str, ...]
    law: str
    estimates: Mapping[str, Estimates]
    effects: tuple[tuple[Effect, ...], ...]
    columns: Mapping[str, Array]
    left_out: tuple[str, ...] = field(default=())
    unreadable: str = ""

    def __len__(self) -> int:
        return len(self.day)


def rows_of(axis: str, content: Sequence[Mapping[str, Any]]) -> AxisRows:
    """The rows of one axis, given as mappings with the columns of the data set, in any order.

    What was stored twice counts once. Rows whose time is not known, and those of another law than most, are left out.
    """
    kept = {_key(row): row for row in sorted(content, key=_order)}
    rows = sorted(kept.values(), key=lambda row: (row["start"], str(row["recording"]), row["piece"]))
    left_out = []
    if len(kept) < len(content):
        left_out.append(f"recordings stored twice, which count once: {len(content) - len(kept)}")
    timed = [row for row in rows if row["start"] > 0]
    if len(timed) < len(rows):
        left_out.append(f"recordings of unknown time, left out: {len(rows) - len(timed)}")
    law = _usual([row["law"] for row in timed if row["law"] is not None])
    same = [row for row in timed if row["law"] in (None, law)]
    if len(same) < len(timed):
        left_out.append(f"recordings identified with another law than {law}, left out: {len(timed) - len(same)}")
    return _columns(axis, law, same, tuple(left_out))


def unreadable(axis: str, why: str) -> AxisRows:
    """An axis of whose recordings nothing is known, and why."""
    return replace(rows_of(axis, ()), unreadable=why)


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """What tells one recording from another: its content where that is known, so that copies count once."""
    return (row["input_hash"] or row["recording"], row["piece"])


def _order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """The row that is kept comes last: a done one over a failed one, then the last version and name."""
    return (row["status"] == "done", str(row["version"]), str(row["recording"]))


def _usual(words: Sequence[str]) -> str:
    """The most frequent one, the first by name among equals; "" of none."""
    return min(set(words), key=lambda word: (-words.count(word), word)) if words else ""


def _columns(axis: str, law: str, rows: Sequence[Mapping[str, Any]], left_out: tuple[str, ...]) -> AxisRows:
    done = np.array([row["status"] == "done" for row in rows], dtype=bool)
    names = dict.fromkeys(name for row in rows for name in row["parameter_names"])
    return AxisRows(
        axis,
        tuple(str(row["recording"]) for row in rows),
        np.array([row["start"] / NANOSECONDS_PER_DAY for row in rows], dtype=np.float64),
        done,
        done & np.array([row["verdict"] is not None for row in rows], dtype=bool),
        tuple("" if ok else str(row["reason"] or "failed") for ok, row in zip(done, rows, strict=True)),
        tuple(str(row["version"]) for row in rows),
        law,
        {name: _estimates(name, rows) for name in names},
        tuple(tuple(row["effects"]) for row in rows),
        {name: np.array([float(row[name]) for row in rows]) for name in (*SURROUNDINGS, *PROGRAMME)},
        left_out,
    )


def _estimates(name: str, rows: Sequence[Mapping[str, Any]]) -> Estimates:
    value, std, unit = np.full(len(rows), np.nan), np.full(len(rows), np.nan), ""
    for k, row in enumerate(rows):
        if row["status"] != "done" or name not in row["parameter_names"]:
            continue
        at = list(row["parameter_names"]).index(name)
        unit = unit or row["parameter_units"][at]
        if row["parameter_determined"][at]:
            value[k], std[k] = row["parameter_values"][at], row["parameter_stds"][at]
    known = np.isfinite(value) & np.isfinite(std) & (std > 0.0)
    return Estimates(unit, np.where(known, value, np.nan), np.where(known, std, np.nan))
