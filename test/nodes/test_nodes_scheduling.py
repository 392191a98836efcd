"""Real-time scheduling: what is granted and refused is said, threads that compute are ordinary, the controller answers first."""

from __future__ import annotations

import gc
import os
import resource
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from sensor_msgs.msg import JointState

from tcs_friction.cli import main
from tcs_friction.errors import InputError
from tcs_friction.nodes.core import scheduling
from tcs_friction.nodes.core.base import AxisNode
from tcs_friction.nodes.graph import LOOP

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="scheduling is set on Linux only")


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A system that permits two cores and notes what it is asked for; `refuse` makes it refuse."""
    asked: list[tuple[Any, ...]] = []
    made = SimpleNamespace(asked=asked, refuse=False, locks=0)

    def schedule(_: int, policy: int, parameter: Any) -> None:
        if made.refuse:
            raise PermissionError(1, "Operation not permitted")
        asked.append((policy, parameter.sched_priority))

    def lock(flags: int) -> int:
        asked.append(("lock", flags))
        return 0

    monkeypatch.setenv(scheduling.ASKED, "")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 3})
    monkeypatch.setattr(os, "sched_setaffinity", lambda _, cores: asked.append(tuple(sorted(cores))))
    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8192 * 1024, 8192 * 1024) if made.refuse else (-1, -1))
    monkeypatch.setattr(scheduling.ctypes, "CDLL", lambda *_, **__: SimpleNamespace(mlockall=lock))
    return made


def test_nothing_is_changed_unless_it_is_asked_for(system: SimpleNamespace) -> None:
    assert scheduling.prepare() == ""
    scheduling.ordinary()
    assert system.asked == []


def test_what_is_granted_is_said_in_one_line(system: SimpleNamespace) -> None:
    scheduling.ask("2,3")
    assert scheduling.prepare() == "real time granted: cores 2,3, SCHED_FIFO 40, locked memory"
    assert system.asked == [(2, 3), (os.SCHED_FIFO, 40), ("lock", 3)]


def test_what_is_refused_is_said_with_the_reason(system: SimpleNamespace) -> None:
    system.refuse = True
    scheduling.ask("all")
    words = "real time refused: SCHED_FIFO 40 (Operation not permitted), locked memory (the limit is 8192 kB)"
    assert scheduling.prepare() == words
    assert system.asked == []


@pytest.mark.parametrize("cores", ["1", "2,x", "2,,3", "", "-2"])
def test_cores_that_are_none_are_refused(system: SimpleNamespace, cores: str) -> None:
    with pytest.raises(InputError, match=f"real time: cores: '{cores}', expected all, or some of 2,3"):
        scheduling.ask(cores)
    assert not os.environ[scheduling.ASKED]
    assert system.asked == []


def test_cores_are_for_real_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", "--cores", "2"]) == 2
    assert capsys.readouterr().err == "tcs-friction: --cores: 2 without --realtime, expected --realtime beside it\n"


def test_a_thread_that_computes_is_ordinary(monkeypatch: pytest.MonkeyPatch) -> None:
    """Really, where this process may do it."""
    found: list[int] = []

    def work() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            pass
        else:
            scheduling.ordinary()
        found.append(os.sched_getscheduler(0))

    monkeypatch.setenv(scheduling.ASKED, scheduling.ALL)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [os.SCHED_OTHER]


@pytest.fixture
def collecting() -> Iterator[None]:
    """Garbage collection is afterwards as it was."""
    yield
    gc.enable()
    gc.unfreeze()


@pytest.mark.usefixtures("collecting")
def test_in_real_time_garbage_is_collected_by_the_clock_and_only_what_has_piled_up(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = together("-p", "run_until:=0.0", nodes=["reference"])
    scheduling.keep_memory_tidy(graph["reference"])
    assert gc.isenabled()
    monkeypatch.setenv(scheduling.ASKED, scheduling.ALL)
    monkeypatch.setattr(scheduling, "COLLECT_EVERY", 0.05)
    collected: list[int] = []
    monkeypatch.setattr(scheduling.gc, "collect", lambda: collected.append(sum(gc.get_count())))
    scheduling.keep_memory_tidy(graph["reference"])
    assert not gc.isenabled()
    collected.clear()
    garbage = [[] for _ in range(2 * scheduling.WORTH)]  # type: ignore[var-annotated]
    assert graph.until(lambda: bool(collected), 10.0)
    assert min(collected) > scheduling.WORTH
    assert garbage


def test_the_controller_answers_a_state_before_other_nodes_of_its_process_work_on_it(together: Callable[..., Any]) -> None:
    graph = together("-p", "clock:=real_time", "-p", "period:=0.02", nodes=LOOP)
    order: dict[bytes, list[str]] = {}
    for name in ("controller", "reference", "dob"):
        watch = graph[name]._driver
        take = watch._callback

        def hear(data: bytes, name: str = name, take: Callable[[bytes], None] = take) -> None:
            order.setdefault(data, []).append(name)
            take(data)

        watch._callback = hear
    assert graph.until(lambda: len(order) > 20)
    assert list(order.values())[1:20] == [["controller", "reference", "dob"]] * 19


def test_in_real_time_a_report_follows_a_state_and_comes_without_states_all_the_same(
    together: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One may be late, for this process does not have the machine to itself."""
    after: list[float] = []
    report = AxisNode._report

    def timed(node: AxisNode[Any]) -> None:
        heard = node.health.inputs.get("joint_states")
        if heard is not None and heard.last > 0.0:
            after.append(time.monotonic() - heard.last)
        report(node)

    monkeypatch.setattr(AxisNode, "_report", timed)
    graph = together("-p", "clock:=real_time", "-p", "period:=0.2", "-p", "age_limit:=1.0", nodes=LOOP)
    assert graph.until(lambda: len(after) >= 6, 20.0)
    assert sorted(after)[-2] < 0.05, after
    graph["plant"].destroy_publisher(graph["plant"]._states)
    graph["plant"]._states = graph["plant"].create_publisher(JointState, "nowhere", 10)
    assert graph.until(lambda: max(after) > 2.5, 20.0), "nobody says anything any more"
