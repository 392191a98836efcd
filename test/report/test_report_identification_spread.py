"""identification.json as how sure an axis' numbers are: what it says, and what is said of a damaged one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcs_friction.control.pid import PidConfig
from tcs_friction.control.spread import FRICTION, INERTIA, NOISE, drawn
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis, Drive
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import instance
from tcs_friction.report.identification_spread import spread_by

FRICTION_LAW = instance(law("coulomb_viscous"), {"coulomb": 10.0, "viscous": 3.0})
BIAS = instance(effect("torque_bias"), {"bias": 0.5})


def axis(*effects: Any) -> Axis:
    return Axis("axis", 2.0, FRICTION_LAW, effects)


def number(value: float | None, std: float | None, determined: bool = True) -> dict[str, Any]:
    return {"value": value, "std": std, "unit": "", "determined": determined, "reason": None}


def content() -> dict[str, Any]:
    return {
        "schema": "tcs_friction/identification/1",
        "law": "coulomb_viscous",
        "parameters": {"coulomb": number(10.0, 0.1), "viscous": number(3.0, 0.2)},
        "inertia": number(2.0, 0.05),
        "offset": number(0.5, 0.01),
        "correlation": {"names": ["coulomb", "viscous", "offset"], "matrix": [[1, -0.8, 0.1], [-0.8, 1, 0.0], [0.1, 0.0, 1]]},
    }


def written(path: Path, made: dict[str, Any]) -> Path:
    path.write_text(json.dumps(made))
    return path


def test_standard_errors_and_correlations_become_a_covariance(tmp_path: Path) -> None:
    spread, notes = spread_by(written(tmp_path / "a.json", content()), axis(BIAS))
    assert spread.unknowns == ((FRICTION, "coulomb"), (FRICTION, "viscous"), INERTIA, ("torque_bias", "bias"))
    assert np.sqrt(np.diag(spread.covariance)) == pytest.approx([0.1, 0.2, 0.05, 0.01])
    assert spread.covariance[0, 1] == pytest.approx(-0.8 * 0.1 * 0.2)
    assert spread.covariance[0, 3] == pytest.approx(0.1 * 0.1 * 0.01)
    assert not spread.covariance[2, [0, 1, 3]].any(), "nothing is said of the inertia"
    assert notes == ()


def test_an_offset_has_no_place_where_the_axis_has_no_bias(tmp_path: Path) -> None:
    spread, _ = spread_by(written(tmp_path / "a.json", content()), axis())
    assert spread.unknowns == ((FRICTION, "coulomb"), (FRICTION, "viscous"), INERTIA)


def test_what_is_not_determined_is_taken_as_exact_and_said(tmp_path: Path) -> None:
    made = content()
    made["inertia"], made["parameters"]["viscous"] = number(None, None, False), number(3.0, None)
    spread, (note,) = spread_by(written(tmp_path / "a.json", made), axis())
    assert spread.unknowns == ((FRICTION, "coulomb"),)
    assert note.endswith("not determined, and taken as exact: viscous, inertia")


def test_values_that_the_axis_file_has_otherwise_are_said(tmp_path: Path) -> None:
    made = content()
    made["parameters"]["coulomb"]["value"] = 11.0
    made["inertia"]["value"] = 2.0 + 1e-9
    spread, (note,) = spread_by(written(tmp_path / "a.json", made), axis())
    assert note.endswith("the axis file has other values, which count: coulomb 10, identified 11")
    assert len(spread.unknowns) == 3


def test_noise_of_the_drive_is_as_unsure_as_it_is_told(tmp_path: Path) -> None:
    made = content() | {"drive": {"noise": number(0.2, 0.01)}}
    noisy = replace(axis(), drive=Drive(noise=0.2))
    spread, notes = spread_by(written(tmp_path / "a.json", made), noisy)
    assert spread.unknowns[-1] == NOISE
    assert spread.covariance[-1, -1] == pytest.approx(1e-4)
    assert notes == ()
    assert {one.drive.noise for one, _ in drawn(noisy, PidConfig(), spread, 5, 0)} != {0.2}
    quiet, _ = spread_by(written(tmp_path / "a.json", made), axis())
    assert NOISE not in quiet.unknowns
    assert NOISE not in spread_by(written(tmp_path / "a.json", content() | {"drive": None}), noisy)[0].unknowns


def change(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Put a value at the end of a way of keys."""

    def apply(made: dict[str, Any]) -> None:
        *way, last = key.split("/")
        for one in way:
            made = made[one]
        if value is None:
            del made[last]
        else:
            made[last] = value

    return apply


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (change("schema", "tcs_friction/diagnosis/1"), "has the schema 'tcs_friction/diagnosis/1', expected the identif"),
        (change("law", "lugre"), "identifies lugre, expected the law of the axis file, coulomb_viscous"),
        (change("law", 3), "law: 3, expected a text"),
        (change("parameters", None), "parameters is missing"),
        (change("parameters/static", number(1.0, 1.0)), "coulomb_viscous has no such parameter"),
        (change("parameters/coulomb/std", None), "coulomb: std is missing"),
        (change("parameters/coulomb/std", "x"), "coulomb: std: 'x', expected a number from 0"),
        (change("parameters/coulomb/std", -1), "coulomb: std: -1, expected a number from 0"),
        (change("parameters/coulomb/std", 10**400), "expected a number from 0"),
        (change("parameters/coulomb/value", []), r"coulomb: value: \[\], expected a finite number"),
        (change("parameters/coulomb/determined", "yes"), "coulomb: determined: 'yes', expected true or false"),
        (change("inertia", [1]), r"inertia: \[1\], expected a mapping"),
        (change("offset", None), "offset is missing"),
        (change("correlation", None), "correlation is missing"),
        (change("correlation/names", ["coulomb"]), "matrix: 3 rows, expected 1 rows and columns"),
        (change("correlation/names", ["coulomb", "viscous", "x"]), "names: 'x', expected"),
        (change("correlation/matrix", [[1, 0, 0], [0, 1, 0], [0, 2, 1]]), r"matrix\[2\]\[1\]: 2, expected a number from -1 to 1"),
        (change("correlation/matrix", [[1, 0, 0], [0, 1], [0, 0, 1]]), "matrix: 3 rows, expected 3 rows and columns"),
    ],
)
def test_each_damage_is_one_line(damage: Callable[[dict[str, Any]], None], expected: str, tmp_path: Path) -> None:
    made = content()
    damage(made)
    with pytest.raises(InputError, match=expected) as caught:
        spread_by(written(tmp_path / "a.json", made), axis(BIAS))
    assert str(caught.value).startswith(str(tmp_path / "a.json"))
    assert "\n" not in str(caught.value)
