"""Fixtures shared by all tests."""

from __future__ import annotations

import importlib.util
import itertools
import os
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest

from tcs_friction.diagnose.parallel import alone, cores

ROOT = Path(__file__).resolve().parent.parent
MISSING = [name for name in ("rclpy", "tcs_friction_msgs") if importlib.util.find_spec(name) is None]
if MISSING:
    collect_ignore_glob = ["nodes/test_*.py"]


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Where everything has to be tested, leaving tests out is a failure."""
    if MISSING and os.environ.get("CI"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line about what was left out."""
    if MISSING:
        terminalreporter.line(f"test/nodes left out: no {' and no '.join(MISSING)}; ./tcs test brings them")


LONGEST = (
    "nodes_cancelling",
    "diagnose_recordings",
    "commands_new",
    "benchmarks_concealed",
    "benchmarks_faults",
    "nodes_conduct",
    "nodes_ros2_control",
    "diagnose_pipeline",
    "live_browser",
    "nodes_axes",
    "nodes_commission",
    "fleet_runs",
    "nodes_real_time",
    "diagnose_laws",
    "nodes_processes",
    "bootstrap_setup",
    "nodes_restart",
    "commands_mujoco",
    "nodes_monitor",
    "diagnose_foreign_terms",
    "nodes_mujoco",
    "identify_profile",
    "nodes_canopen",
    "benchmarks_compensated_mujoco",
)
"""Files that take longest, those that wait and those that compute in turn; a worker that gets one last is waited for."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long come first, so that the workers end together (with --no-loadscope-reorder)."""
    place = {f"test_{name}": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


def domains() -> Iterator[int]:
    """ROS domains that no other worker of this run uses: each has its own share of 1 to 100."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    share = 100 // max(int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")), worker + 1)
    return itertools.cycle(1 + worker * share + (os.getpid() + k) % share for k in range(share))


DOMAINS = domains()


@pytest.fixture(autouse=True)
def one_thread_for_each_worker() -> Iterator[None]:
    """Where the workers of this run occupy all cores already, a diagnosis in several threads only takes more time."""
    busy = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")) >= cores()
    with alone() if busy else nullcontext():
        yield


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test has a ROS domain to itself: a killed node of the one before is remembered there for many seconds."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(next(DOMAINS)))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recordings that lies beside the checkout or where TCS_FRICTION_DATA says."""
    named = os.environ.get("TCS_FRICTION_DATA")
    folder = Path(named) if named else ROOT.parent / "shared"
    if folder.is_dir():
        return folder
    reason = f"no recordings at {folder}; set TCS_FRICTION_DATA to the folder that holds data/ and practice/"
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)
