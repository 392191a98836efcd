"""Which SYNC a PDO answers, also when it is read after the next one."""

from __future__ import annotations

import random

import pytest

from tcs_friction.nodes.drivers.sync_times import SyncTimes

PERIOD, ANSWER = 0.004, 0.0006  # s


@pytest.mark.parametrize("offset", [0.0, 1.7e9, -90.0])
def test_an_answer_that_is_read_late_is_that_of_its_own_sync(offset: float) -> None:
    """Whatever epoch the adapter's clock has; threads read up to three periods late, three of four at once."""
    times, late = SyncTimes(), random.Random(0)
    reads: list[tuple[float, float, int]] = []
    for k in range(1, 400):
        began = 100.0 + k * PERIOD
        wait = late.uniform(0.0, 3.0 * PERIOD) if late.random() < 0.25 else 1e-4 * late.random()
        reads.append((began + ANSWER + wait, began + ANSWER + offset, k))
    reads.sort()
    sent, right = 0, 0
    for now, timestamp, k in reads:
        while 100.0 + (sent + 1) * PERIOD <= now:
            sent += 1
            times.sent(1000 * sent, 100.0 + sent * PERIOD)
        right += times.answered(timestamp, now) == (k, 1000 * k)
    assert right == len(reads)


def test_without_a_time_of_the_adapter_the_newest_sync_is_taken() -> None:
    times = SyncTimes()
    times.sent(10, 1.0)
    times.sent(20, 1.004)
    assert times.answered(0.0, 1.0045) == (2, 20)


def test_what_no_kept_sync_can_have_asked_for_belongs_to_none() -> None:
    times = SyncTimes()
    assert times.answered(5.0, 0.5) == (0, 0)
    for k in range(1, 30):
        times.sent(k, float(k))
    times.answered(100.0, 30.0)
    assert times.answered(75.0, 30.0) == (0, 0)
