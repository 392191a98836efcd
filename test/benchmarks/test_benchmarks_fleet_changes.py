"""The score of planted changes: found, of the right size, at the right date, and nothing where nothing was planted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import fleet_changes
from benchmarks.fleet_bags import YEAR, Change, Truth

PLANTED = (
    Change("east", "drift", "", "coulomb", 78.0, 88.0, 0.0),
    Change("south", "step", "local_friction_bump", "amplitude", 0.0, 0.25, 213.0),
)


def trend(name: str, *events: Any) -> Any:
    day = fleet_changes.FIRST_DAY + np.array([0.0, YEAR / 2, YEAR])
    series = SimpleNamespace(series=SimpleNamespace(day=day))
    return SimpleNamespace(name=name, events=events, trends={"coulomb": series})


def grown(size: float, kind: str = "drift") -> Any:
    change = SimpleNamespace(parameter="coulomb", kind=kind, size=size, std=0.5)
    return SimpleNamespace(presences=(), changes=(change,))


def bump(day: float, appears: bool = True) -> Any:
    when = fleet_changes.FIRST_DAY + day
    one = SimpleNamespace(
        effect="position_dependent_friction", equivalent=("local_friction_bump",), appears=appears,
        earliest=when - 5.0, latest=when + 5.0,
    )  # fmt: skip
    return SimpleNamespace(presences=(one,), changes=())


@pytest.mark.parametrize(
    ("east", "south", "north", "values"),
    [
        (grown(10.2), bump(210.0), (), [2, 2, 0]),
        (grown(20.0), bump(190.0), (), [2, 0, 0]),
        (grown(10.2, "step"), bump(213.0, appears=False), (grown(3.0),), [0, 0, 1]),
    ],
)
def test_changes_are_counted(
    east: Any, south: Any, north: tuple[Any, ...], values: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    axes = (trend("north", *north), trend("east", east), trend("south", south))
    monkeypatch.setattr(fleet_changes, "read_axes", lambda _: ())
    monkeypatch.setattr(fleet_changes, "fleet_trend", lambda _: SimpleNamespace(axes=axes))
    rows = fleet_changes.score(Path("out"), Truth(PLANTED, ()))
    assert [row["value"] for row in rows] == values
    assert ("east coulomb" in rows[0]["name"]) == (values[0] == 0), "what is missing is named"
