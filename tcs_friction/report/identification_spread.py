"""What an identification.json says of how sure the numbers of an axis file are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tcs_friction.control.model_compensator import effect_names
from tcs_friction.control.spread import FRICTION, INERTIA, NOISE, Spread, Unknown
from tcs_friction.errors import InputError, nearest
from tcs_friction.identify.result import SCHEMA
from tcs_friction.json_files import Json, load_json
from tcs_friction.physics.axis import Axis

DRIVE_NOISE = "noise of the drive"
LATENESS = "lateness"  # of the logged torque: no number of an axis
SAME = 1e-6
"""Relative difference of two numbers of which one was written as text."""


def spread_by(path: Path, axis: Axis) -> tuple[Spread, tuple[str, ...]]:
    """Joint spread of an axis' friction law, inertia and offset (its bias), about the values of the axis file, and notes.

    Where the identification tells the noise of the drive (`drive: {noise: {value, std}}`), that is as unsure as it says.

    Raises InputError for a file that is no identification, a damaged one, and one of another law.
    """
    content = load_json(path, "the identification.json of ./tcs identify", SCHEMA)
    law = content.at("law").text()
    if law != axis.friction.term.id:
        raise InputError(str(path), f"identifies {law}", f"the law of the axis file, {axis.friction.term.id}")
    known = _numbers(content, axis)
    stds = {name: entry.at("std").number(0.0) for name, entry in known.items() if _determined(entry)}
    values = {name: entry.at("value").number() for name, entry in known.items() if name in stds}
    places = {name: place for name in stds if (place := _place(axis, name)) is not None}
    size = np.array([stds[name] for name in places])
    covariance = _correlations(content.at("correlation"), list(places), known) * np.outer(size, size)
    notes = []
    others = [name for name in known if name not in stds]
    if others:
        notes.append(f"{path}: not determined, and taken as exact: {', '.join(others)}")
    file = {**axis.friction.values, "inertia": axis.inertia, DRIVE_NOISE: axis.drive.noise}
    moved = [name for name in places if name in file and not math.isclose(values[name], file[name], rel_tol=SAME)]
    if moved:
        stated = ", ".join(f"{name} {file[name]:.6g}, identified {values[name]:.6g}" for name in moved)
        notes.append(f"{path}: the axis file has other values, which count: {stated}")
    return Spread(tuple(places.values()), covariance), tuple(notes)


def _numbers(content: Json, axis: Axis) -> dict[str, Json]:
    """The entries of all identified numbers by name."""
    parameters = content.at("parameters").mapping()
    for name, entry in parameters.items():
        if name not in axis.friction.values:
            expected = nearest(name, list(axis.friction.values))
            raise InputError(entry.where, f"{axis.friction.term.id} has no such parameter", expected)
    rest = {"inertia": content.at("inertia"), "offset": content.at("offset")}
    drive = content.mapping().get("drive")
    return {**parameters, **rest, **({DRIVE_NOISE: drive.at("noise")} if drive is not None and drive.value is not None else {})}


def _determined(entry: Json) -> bool:
    value = entry.at("determined").value
    if not isinstance(value, bool):
        raise InputError(f"{entry.where}: determined", repr(value)[:40], "true or false")
    return value and entry.at("std").value is not None


def _place(axis: Axis, name: str) -> Unknown | None:
    """What of an axis has this identified number; None of an offset where it has no bias."""
    if name == "inertia":
        return INERTIA
    if name == DRIVE_NOISE:
        return NOISE if axis.drive.noise > 0.0 else None
    if name != "offset":
        return FRICTION, name
    biases = ((effect, item.term.offset) for effect, item in effect_names(axis).items() if item.term.offset)
    return next(biases, None)


def _correlations(entry: Json, wanted: list[str], known: Mapping[str, Json]) -> np.ndarray:
    """(k, k) of the wanted numbers; those of which nothing is said are independent."""
    names = [name.text() for name in entry.at("names").entries()]
    rows = [[value.number(-1.0, 1.0) for value in row.entries()] for row in entry.at("matrix").entries()]
    if len(rows) != len(names) or any(len(row) != len(names) for row in rows):
        raise InputError(f"{entry.where}: matrix", f"{len(rows)} rows", f"{len(names)} rows and columns, as there are names")
    for name in names:
        if name not in known and name != LATENESS:
            raise InputError(f"{entry.where}: names", repr(name)[:40], nearest(name, list(known)))
    place = {name: k for k, name in enumerate(names)}
    result = np.eye(len(wanted))
    for i, one in enumerate(wanted):
        for j, other in enumerate(wanted):
            if i != j and one in place and other in place:
                result[i, j] = 0.5 * (rows[place[one]][place[other]] + rows[place[other]][place[one]])
    return result
