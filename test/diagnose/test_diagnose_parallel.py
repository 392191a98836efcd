"""Maps over several cores: in order, nested, and with the caller's errors."""

from __future__ import annotations

import signal
import threading
import time

import pytest

from tcs_friction.diagnose import parallel


@pytest.fixture(autouse=True)
def one_thread_for_each_worker() -> None:
    """In place of the fixture of all tests: these are about several threads."""


def test_a_map_keeps_its_order_and_runs_on_several_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=10.0)

    def work(x: int) -> int:
        together.wait()
        return x * x

    assert parallel.side_by_side(work, range(4)) == [0, 1, 4, 9]


def test_a_thread_without_work_helps_in_a_map_within_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=10.0)

    def inner(x: int) -> int:
        together.wait()
        return x + 1

    def outer(x: int) -> list[int]:
        return parallel.side_by_side(inner, range(4)) if x == 1 else []

    assert parallel.side_by_side(outer, range(2)) == [[], [1, 2, 3, 4]]


@pytest.mark.parametrize("place", range(4))
def test_an_error_in_a_map_is_the_caller_s(place: int) -> None:
    with pytest.raises(ZeroDivisionError):
        parallel.side_by_side(lambda x: 1 // (x - place), range(4))
    assert parallel.side_by_side(lambda x: x, range(3)) == [0, 1, 2]


def test_after_an_interrupt_nothing_more_is_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    begun: list[int] = []

    def slow(item: int) -> None:
        begun.append(item)
        time.sleep(0.05)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    main = threading.main_thread().ident
    assert main is not None
    timer = threading.Timer(0.3, signal.pthread_kill, (main, signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            parallel.side_by_side(slow, range(1000))
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    assert len(begun) < 500
