"""Axis-years with planted changes: what is said of them, what is ruled out, and what does not pretend to know."""

from __future__ import annotations

import random as shuffling
from dataclasses import replace

import numpy as np
import pytest
from fleet_rows import as_content, year

from tcs_friction.trends.compare import differences, standings
from tcs_friction.trends.fleet import AxisTrend, axis_trend, fleet_trend
from tcs_friction.trends.result import to_mapping
from tcs_friction.trends.rows import AxisRows, rows_of
from tcs_friction.trends.series import series_of


@pytest.fixture(scope="module")
def unchanged() -> AxisRows:
    return year(1)[0]


def of(rows: AxisRows) -> AxisTrend:
    return axis_trend(rows, 10.0)


def test_an_unchanged_axis_needs_nobody(unchanged: AxisRows) -> None:
    found = of(unchanged)
    assert found.events == ()
    assert found.reasons == ()
    assert found.trends["coulomb"].fit.value("temperature")[0] == pytest.approx(-0.23, abs=0.02)


def test_an_aged_lubricant_is_one_drift_of_both_parameters() -> None:
    (event,) = of(year(2, "lubricant")[0]).events
    assert event.kind == "drift"
    assert {change.parameter for change in event.changes} == {"coulomb", "viscous"}
    assert "lubricant" in event.cause
    assert "% up" in event.statement
    assert "not temperature" in event.statement
    assert event.needs_person


def test_a_preload_is_one_step_over_all_positions() -> None:
    rows, day = year(3, "preload")
    (event,) = of(rows).events
    assert event.earliest <= day <= event.latest
    assert event.statement.startswith("Coulomb friction ")
    assert "over all positions" in event.statement
    assert event.cause == "lubrication or preload"
    assert any(line.startswith("temperature") for line in event.ruled_out)
    assert any(line.startswith("way of recording") for line in event.ruled_out)


def test_a_bump_that_appears_is_of_the_bearing() -> None:
    rows, day = year(4, bump=True)
    (event,) = of(rows).events
    assert event.earliest <= day <= event.latest
    assert "local friction bump appeared" in event.statement
    assert "centre 0.06 rad" in event.statement
    assert "over all positions" not in event.statement
    assert event.cause.startswith("bearing")


def test_of_few_recordings_an_effect_explains_the_step_that_came_with_it() -> None:
    """The effect alone would be no event yet: of 14 recordings, whichever it is named in might be chance."""
    rows, day = year(8, bump=True, recordings=14)
    assert of(rows).events == ()
    one = rows.estimates["viscous"]
    raised = replace(one, value=one.value + np.where(rows.day > day, 150.0, 0.0))
    (event,) = of(replace(rows, estimates={**rows.estimates, "viscous": raised})).events
    assert [shown.effect for shown in event.presences] == ["local_friction_bump"]
    assert event.cause.startswith("bearing")


def test_recordings_that_never_reverse_say_nothing_of_friction(unchanged: AxisRows) -> None:
    """They claim a Coulomb friction half as large again, and claim it exactly."""
    still = unchanged.columns["reversals"] == 0
    assert np.nanmin(unchanged.estimates["coulomb"].value[still]) > 100.0
    series = of(unchanged).trends["coulomb"].series
    assert series.value.max() < 90.0
    assert series.left_out["never reverse, so they cannot tell it"] == still.sum()


def test_undetermined_values_are_left_out_and_counted(unchanged: AxisRows) -> None:
    one = unchanged.estimates["static"]
    value = one.value.copy()
    value[:20] = np.nan
    series = series_of(unchanged, "static", one.unit, value, one.std)
    assert series.left_out["do not determine it"] >= 20
    assert series.day[0] > unchanged.day[19]


def test_a_value_that_grew_far_beyond_the_usual_one_speaks_though_it_is_less_exact(
    unchanged: AxisRows,
) -> None:
    """As an offset does when a cable pulls that the law knows nothing of."""
    one = unchanged.estimates["offset"]
    late = unchanged.day > unchanged.day[30]
    value, std = one.value + np.where(late, 4.0, 0.0), np.where(late, 0.27, one.std)
    series = series_of(unchanged, "offset", one.unit, value, std)
    assert series.day[-1] == unchanged.day[np.isfinite(value)][-1]
    assert "determine it too vaguely" not in series.left_out


def test_one_wrong_value_is_set_aside_and_named(unchanged: AxisRows) -> None:
    one = unchanged.estimates["inertia"]
    value = one.value.copy()
    at = int(np.flatnonzero(np.isfinite(value))[10])
    value[at] *= 3.0
    series = series_of(unchanged, "inertia", one.unit, value, one.std)
    assert series.outlying == (unchanged.day[at],)
    assert series.value.max() < 1100.0


def test_a_programme_that_changed_with_the_parameter_is_said_and_calls_nobody() -> None:
    rows, day = year(5, "preload")
    late = rows.day > day
    columns = {
        **rows.columns,
        "speed_max": np.where(late, 0.3, 0.03),
        "speed_rms": np.where(late, 0.14, 0.014),
    }
    (event,) = of(replace(rows, columns=columns)).events
    assert not event.needs_person
    assert any("way of recording: speed max changed" in line for line in event.open)


def test_new_software_at_the_same_time_is_said_and_calls_nobody() -> None:
    rows, day = year(5, "preload")
    version = tuple("2" if one > day else "1" for one in rows.day)
    (event,) = of(replace(rows, version=version)).events
    assert not event.needs_person
    assert any(line.startswith("software") for line in event.open)


def test_without_temperature_it_is_left_open() -> None:
    rows, _ = year(3, "cable")
    nothing = np.full(len(rows), np.nan)
    event = of(replace(rows, columns={**rows.columns, "temperature": nothing})).events[0]
    assert "temperature: it was not recorded" in event.open
    assert "not temperature" not in event.statement


def test_the_order_of_rows_and_copies_change_nothing(unchanged: AxisRows) -> None:
    content = as_content(unchanged)
    first = to_mapping(fleet_trend([rows_of("a", content)]))
    copies = [*content, {**content[3], "recording": "a copy of it"}]
    shuffling.Random(0).shuffle(copies)
    again = to_mapping(fleet_trend([rows_of("a", copies)]))
    assert again["axes"][0].pop("notes") == ["recordings stored twice, which count once: 1"]
    assert first["axes"][0].pop("notes") == []
    assert again == first


def test_one_recording_and_none(unchanged: AxisRows) -> None:
    content = as_content(unchanged)
    assert to_mapping(fleet_trend([rows_of("a", content[:1])]))["axes"][0]["recordings"] == 1
    failed = [
        {**row, "status": "failed", "reason": "no motion", "law": None, "parameter_names": []}
        for row in content
    ]
    (axis,) = fleet_trend([rows_of("a", failed)]).axes
    assert "50 recordings in a row could not be identified" in axis.reasons[0]


def test_steps_before_a_day_call_nobody() -> None:
    rows, day = year(3, "preload")
    assert fleet_trend([rows], day - 60.0).needing
    assert not fleet_trend([rows], day + 60.0).needing


def test_the_axis_with_most_torque_changed_is_first(unchanged: AxisRows) -> None:
    axes = [
        replace(unchanged, axis="a"),
        replace(year(3, "cable")[0], axis="b"),
        replace(year(2, "preload")[0], axis="c"),
    ]
    fleet = fleet_trend(axes)
    assert [axis.name for axis in fleet.axes] == ["c", "b", "a"]
    assert [axis.name for axis in fleet.needing] == ["c", "b"]


def test_an_axis_far_from_its_fleet_is_outside_its_interval() -> None:
    levels = {name: (78.0 + k, 0.1) for k, name in enumerate("abcdef")} | {"new": (120.0, 0.5)}
    by_axis = {one.axis: one for one in standings("coulomb", "N m", levels)}
    new = by_axis["new"]
    assert not new.lower < new.value < new.upper
    assert new.p_value < 1e-4
    assert by_axis["c"].p_value > 0.1
    assert new.spread == pytest.approx(np.std(np.arange(6), ddof=1), rel=0.05)


def test_an_axis_that_changed_is_no_standard_for_the_others() -> None:
    levels = {name: (78.0 + 0.3 * k, 0.1) for k, name in enumerate("abcd")} | {"worn": (90.0, 0.1), "new": (100.0, 0.5)}
    by_axis = {one.axis: one for one in standings("coulomb", "N m", levels, ["worn"])}
    assert by_axis["new"].p_value < 1e-4 < standings("coulomb", "N m", levels)[4].p_value
    few = {"a": (78.0, 0.1), "b": (79.0, 0.1), "worn": (90.0, 0.1), "new": (100.0, 0.5)}
    assert standings("coulomb", "N m", few, ["worn"]) == standings("coulomb", "N m", few)


def test_a_change_that_was_dealt_with_is_not_told_as_a_strange_level(unchanged: AxisRows) -> None:
    rows, day = year(3, "preload")
    alike = [replace(unchanged, axis=name) for name in "bcde"]
    fleet = fleet_trend([replace(rows, axis="a"), *alike], day + 60.0)
    (changed,) = (axis for axis in fleet.axes if axis.name == "a")
    assert any(one.parameter == "coulomb" and one.p_value < 1e-4 for one in changed.standings)
    assert not any("Coulomb" in reason for reason in changed.reasons)


def test_the_interval_of_the_next_axis_holds_it_as_often_as_it_says() -> None:
    random = np.random.default_rng(11)
    held = 0
    for _ in range(400):
        values = 78.0 + 2.0 * random.standard_normal(6) + 0.5 * random.standard_normal(6)
        one = standings("coulomb", "N m", {str(k): (float(v), 0.5) for k, v in enumerate(values)})[0]
        held += one.lower < one.value < one.upper
    assert 0.91 < held / 400 < 0.99


def test_twins_that_differ_and_twins_that_do_not() -> None:
    (same,) = differences("coulomb", "N m", {"a": (78.0, 0.3), "b": (78.2, 0.3)})
    (other,) = differences("coulomb", "N m", {"a": (78.0, 0.3), "b": (82.0, 0.3)})
    assert same.p_value > 0.5
    assert other.p_value < 1e-9
    assert other.relative == pytest.approx(4.0 / 78.0)
    assert np.isnan(standings("coulomb", "N m", {"a": (78.0, 0.3), "b": (82.0, 0.3)})[0].lower)
