"""What nodes keep: series of samples, counters of health."""

from __future__ import annotations

import numpy as np

from tcs_friction.nodes.health import Health
from tcs_friction.nodes.series import Series


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


def test_health_remembers_why_an_input_was_refused() -> None:
    health = Health()
    health.refuse("torque_command of nan N m")
    assert health.refused == 1
    assert health.warning == "torque_command of nan N m"
