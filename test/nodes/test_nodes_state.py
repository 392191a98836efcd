"""What nodes keep: series of samples, counters of health."""

from __future__ import annotations

import numpy as np

from tcs_friction.nodes.core.health import Health, Judgement
from tcs_friction.nodes.core.log_lines import Problems, Warnings
from tcs_friction.nodes.core.series import Series


def test_series_keeps_each_stamp_once_in_order() -> None:
    series = Series(2)
    assert series.append(0, 1.0, 2.0)
    assert not series.append(0, 9.0, 9.0)
    assert series.append(10**9, 3.0, 4.0)
    t, first, second = series.arrays()
    assert t.tolist() == [0.0, 1.0]
    assert first.tolist() == [1.0, 3.0]
    assert second.tolist() == [2.0, 4.0]


def test_series_starts_anew_when_the_clock_goes_back() -> None:
    series = Series(1)
    for stamp in (5, 6, 7):
        series.append(stamp, float(stamp))
    series.append(1, 1.0)
    assert len(series) == 1
    assert series.arrays()[1].tolist() == [1.0]


def test_series_memory_is_bounded() -> None:
    series = Series(1, limit=100)
    sizes = []
    for stamp in range(10_000):
        series.append(stamp, float(stamp))
        sizes.append(len(series))
    assert max(sizes) <= 200
    assert series.arrays()[1].tolist() == np.arange(9900.0, 10_000.0).tolist()


def test_health_reports_the_rate_between_reports() -> None:
    health = Health()
    health.report(10.0)
    health.ticks = 500
    assert health.report(10.5)["rate [1/s]"] == "1000.0"


def test_health_shows_the_limits_beside_what_they_limit() -> None:
    health = Health()
    assert not [name for name in health.report(1.0) if "limit" in name], "lock-step has none"
    health.judge(2.0, Judgement(period=0.01, age_limit=0.1))
    values = health.report(2.0)
    assert values["rate, limits [1/s]"] == "90.0 to 110.0"
    assert values["overruns, limit [1/s]"] == "5.0"
    assert values["age of inputs, limit [s]"] == "0.100"


def test_a_second_problem_is_logged_while_another_stands() -> None:
    lines = Problems()
    assert lines.lines({"a": "no reference for 1.0 s"}) == ["no reference for 1.0 s"]
    assert lines.lines({"a": "no reference for 2.0 s", "b": "no joint_states"}) == ["no joint_states"]
    assert lines.lines({"b": "no joint_states"}) == []
    assert lines.lines({"a": "no reference", "b": "two drivers"}) == ["no reference", "two drivers"]
    assert lines.lines({}) == []
    assert not lines.any


def test_warnings_that_were_held_back_are_counted_and_the_last_is_logged() -> None:
    lines = Warnings(every=10.0)
    assert lines.line("late by 3 ms", 0.0) == "late by 3 ms"
    assert lines.line("late by 4 ms", 1.0) == ""
    assert lines.line("refused", 2.0) == ""
    assert lines.line("refused again", 3.0) == ""
    assert lines.line("", 4.0) == ""
    assert lines.line("", 10.0) == "refused again (the last of 2 different warnings since the line before)"
    assert lines.line("", 30.0) == ""
    assert lines.line("late by 5 ms", 31.0) == "late by 5 ms"


def test_health_remembers_why_an_input_was_refused() -> None:
    health = Health()
    health.refuse("torque_command of nan N m")
    assert health.refused == 1
    assert health.warning == "torque_command of nan N m"
