"""The benchmark of real time, short; growth of memory is told from its scatter."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.realtime import Heard, Memory, Together, growth
from tcs_friction.cli import main
from tcs_friction.errors import JobError

T = np.arange(60.0)


def test_what_grows_is_told_from_what_only_fills_up() -> None:
    random = np.random.default_rng(0)
    leak, error = growth([(T, 2.0 * T + random.integers(-3, 4, len(T)))], 60.0)
    assert abs(leak - 120.0) < 3.0 * error < 240.0
    filled = 1000.0 * (1.0 - np.exp(-T / 4.0))
    slope, error = growth([(T, filled)], 60.0)
    assert slope < 2.0, "in the first half it has filled"
    steepest, _ = growth([(T, filled), (T, 3.0 * T)], 60.0)
    assert steepest == pytest.approx(180.0)
    assert np.isnan(growth([(T[:4], T[:4])], 1.0)[0])


def test_states_without_an_answer_are_counted_and_too_many_are_an_error() -> None:
    said = np.arange(1000) * 1e-3
    heard = said + 2e-4
    heard[500] = np.nan
    found = Together.of([Heard(said, heard, (Memory("controller"),))])
    assert np.isnan(found.resident[0]), "two samples tell nothing"
    assert found.misses == 1e-3
    assert np.percentile(found.latency, [0, 100]) == pytest.approx(0.2)
    assert found.jitter.max() < 1e-9
    heard[:20] = np.nan
    with pytest.raises(JobError, match=r"2.1 % of the states had no answer"):
        Together.of([Heard(said, heard, ())])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--rates", "0"], "--rates: '0', expected whole numbers of 1/s from 1 to 10000"),
        (["--places", "two"], "--places: 'two', expected some of one,several"),
        (["--cores", "9999"], "real time: cores: '9999', expected all, or some of"),
    ],
)
def test_bad_options_are_refused_in_one_line(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rclpy")
    assert main(["bench", "realtime", *words]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.usefixtures("ros_domain")
def test_the_driver_hears_an_answer_to_each_of_its_states_and_when() -> None:
    rclpy = pytest.importorskip("rclpy")
    from benchmarks.realtime import Driver, _pair
    from tcs_friction.nodes.core.executor import close, make_executor, spin

    rclpy.init(args=["test"])
    executor, driver, pair = make_executor(), Driver(100.0, 1.0, 0.2), _pair()
    for node in (driver.node, pair):
        executor.add_node(node)
    try:
        spin(executor, driver.done)
        said, heard = driver.result()
    finally:
        close(executor, [driver.node, pair])
    assert len(said) == 100
    assert np.median(np.diff(said)) == pytest.approx(0.01, abs=0.002)
    assert np.all(heard > said), "each was answered, after it was said"
    assert np.median(heard - said) < 0.005
