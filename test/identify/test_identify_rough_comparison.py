"""Laws compared roughly: the same order as the whole fits, quickly, and who is as good as whom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import axis_of, recording

from tcs_friction.conditioning.motion import Motion, prepare
from tcs_friction.errors import InputError
from tcs_friction.identify import rough_comparison
from tcs_friction.identify.first_axis import LAWS
from tcs_friction.identify.rough_comparison import BLOCKS, RoughFit, compare_roughly

PLAIN = {"coulomb": 60.0, "viscous": 0.0}


def moved(values: dict[str, float] | None = None, name: str = "lugre", seconds: float = 36.0) -> Motion:
    return prepare([recording(axis_of(values, name), seconds=seconds)])


def guess(inertia: float = 900.0) -> object:
    return axis_of(PLAIN, "coulomb_viscous", inertia)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("lugre", None),
        ("dahl_viscous", {"coulomb": 60.0, "stiffness": 3e5, "viscous": 500.0}),
        ("stribeck_static", {"coulomb": 40.0, "static": 80.0, "stribeck_velocity": 1e-3, "viscous": 500.0, "exponent": 2.0}),
    ],
)
def test_the_law_of_the_axis_errs_least_or_as_little_as_one_that_contains_it(name: str, values: dict[str, float] | None) -> None:
    told: list[str] = []
    rows, left_out = compare_roughly(moved(values, name), guess(), LAWS, told.append)  # type: ignore[arg-type]
    assert not left_out
    held_out = {one.law: one.held_out for one in rows}
    assert list(held_out.values()) == sorted(held_out.values())
    assert held_out[name] < 1.1 * rows[0].held_out
    assert held_out[name] < 0.6 * held_out["coulomb_viscous"]
    assert told[1:] == list(LAWS)


def test_of_a_long_recording_windows_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rough_comparison, "SAMPLES", 6000)
    rows, _ = compare_roughly(moved(seconds=60.0), guess(), LAWS)  # type: ignore[arg-type]
    assert rows[0].law == "lugre"
    assert all(np.isfinite(one.held_out) for one in rows)
    assert rows[-1].held_out < 100.0, "no start of a window that nobody knows"


def fit(residual: np.ndarray, law: str = "a") -> RoughFit:
    return RoughFit(law, residual, np.arange(len(residual)) % 5 < 4, 3, 0.0)


def test_what_held_out_samples_do_not_prefer_is_as_good() -> None:
    random = np.random.default_rng(0)
    one, other = (fit(random.standard_normal(4000)) for _ in range(2))
    assert one.as_good(other)
    assert one.as_good(one)
    worse = replace(other, residual=1.3 * other.residual)
    assert not one.as_good(worse)
    assert not worse.as_good(one)


def test_of_too_few_samples_nothing_is_preferred() -> None:
    few = fit(np.ones(BLOCKS))
    assert few.as_good(fit(np.full(BLOCKS, 9.0)))
    none = RoughFit("a", np.ones(20), np.ones(20, dtype=bool), 3, 0.0)
    assert np.isnan(none.held_out)
    assert none.as_good(none)
    assert none.to_mapping()["rmse"] == {"train": 1.0, "held_out": None}


def test_a_law_that_cannot_be_fitted_is_left_out_and_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, whole = moved(seconds=24.0), rough_comparison._fitted

    def refusing(of: Motion, starts: object, name: str) -> object:
        if name != "lugre":
            raise InputError("identification", "no sample is left", "a longer run")
        return whole(of, starts, name)  # type: ignore[arg-type]

    monkeypatch.setattr(rough_comparison, "_fitted", refusing)
    rows, left_out = compare_roughly(motion, guess(), ("coulomb_viscous", "lugre"))  # type: ignore[arg-type]
    assert [one.law for one in rows] == ["lugre"]
    assert left_out == {"coulomb_viscous": "identification: no sample is left, expected a longer run"}
    with pytest.raises(InputError, match="no sample is left"):
        compare_roughly(motion, guess(), ("coulomb_viscous",))  # type: ignore[arg-type]
