"""What others name over the network: results stay below one directory and overwrite nothing, answers quote no file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from tcs_friction_msgs.srv import Diagnose, Identify

from tcs_friction.errors import InputError
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.core.peers import new_results, result_directory
from tcs_friction.nodes.entry import DISCOVERY, PROFILES, RANGE, hear_over_udp, stay_local

SECRET = "root:$y$j9T$secret:19000:0:99999"


@pytest.mark.parametrize("name", ["/tmp/elsewhere", "../elsewhere", "a/../../b", ".", "a/..", "line\nbreak", "x" * 5000, "nul\0"])
def test_results_stay_below_their_directory(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"is not allowed|leads elsewhere") as caught:
        result_directory(str(tmp_path / "results"), name)
    assert len(str(caught.value)) < 500
    assert not (tmp_path / "elsewhere").exists()


def test_a_link_does_not_lead_out(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results/link").symlink_to(tmp_path)
    with pytest.raises(InputError, match="leads elsewhere"):
        result_directory(str(tmp_path / "results"), "link/new")
    assert not (tmp_path / "new").exists()


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    with new_results(str(tmp_path), "night/first") as path:
        assert path is not None
        (path / "axis.yaml").write_text("mine")
    with pytest.raises(InputError, match="holds something already"), new_results(str(tmp_path), "night/first"):
        raise AssertionError("not reached")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made"), new_results(str(tmp_path), "file/below"):
        raise AssertionError("not reached")


def test_a_job_that_fails_leaves_no_empty_directory(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="failed"), new_results(str(tmp_path), "first"):
        raise ValueError("failed")
    assert list(tmp_path.iterdir()) == []
    with new_results(str(tmp_path), "") as path:
        assert path is None


def call(graph: Any, kind: Any, name: str, request: Any) -> Any:
    client = graph.driver.create_client(kind, name)
    return graph.result(Waiter(graph.driver).call(client, request, 20.0), 20.0)


def test_no_answer_quotes_a_file(together: Callable[..., Any], tmp_path: Path) -> None:
    """Whichever file of the machine a peer names, as an axis, a reference or a bag, and in whatever way it fails."""
    graph = together("-p", f"results:={tmp_path / 'results'}", nodes=["identifier", "diagnoser", "reference", "commission"])
    nodes = [graph[name] for name in ("identifier", "reference")]
    answers: list[str] = []
    contents = [SECRET, f"{SECRET}: 1", f"axis: {{{SECRET!r}: 1}}", f"axis: {{friction: {SECRET!r}}}", "\0\1"]
    for number, text in enumerate(contents):
        secret = tmp_path / f"shadow{number}"
        secret.write_text(text)
        for kind, name in ((Identify, "identifier/identify"), (Diagnose, "diagnoser/diagnose")):
            answers.append(call(graph, kind, name, kind.Request(axis=str(secret))).message)
            answers.append(call(graph, kind, name, kind.Request(bags=[str(secret)])).message)
        for node in nodes:
            answers.append(node.set_parameters([Parameter("axis", value=str(secret))])[0].reason)
        answers.append(graph["reference"].set_parameters([Parameter("reference_file", value=str(secret))])[0].reason)
        answers.append(graph["commission"].set_parameters([Parameter("measure_file", value=str(secret))])[0].reason)
    assert all("shadow" in answer for answer in answers)
    assert not [answer for answer in answers if "$y$" in answer or "secret" in answer]
    for name in ("/etc/results", "../results"):
        assert "is not allowed" in call(graph, Identify, "identifier/identify", Identify.Request(directory=name)).message
    node = graph["identifier"]
    moved = node.set_parameters([Parameter("results", value="/")])[0]
    assert (moved.successful, "read-only" in moved.reason) == (False, True)
    assert node.set_parameters([Parameter("axis", value="azimuth_1p2m.yaml")])[0].successful
    assert node.config.results == str(tmp_path / "results"), "another axis does not bring another directory"


def test_the_own_terminal_hears_what_is_wrong_with_a_file(processes: Any, tmp_path: Path) -> None:
    (tmp_path / "axis.yaml").write_text("axis: {name: azimuth, inertia: 1.0, fricton: 3}\n")
    processes.start("reference", "-p", f"axis:={tmp_path / 'axis.yaml'}")
    processes._processes["reference"].wait(60.0)
    assert "unknown key 'fricton'" in processes.log("reference")


def test_discovery_stays_on_this_machine_unless_the_environment_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    for name in DISCOVERY:
        monkeypatch.delenv(name, raising=False)
    stay_local()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    stay_local()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "10.0.0.1:11811")
    stay_local()
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE" not in os.environ


@pytest.mark.parametrize(
    ("given", "over_udp"),
    [({RANGE: "LOCALHOST"}, True), ({RANGE: "SUBNET"}, False), ({}, False), ({RANGE: "LOCALHOST", PROFILES: "own.xml"}, False),
     ({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.1"}, False),
     ({RANGE: "LOCALHOST", "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, False)],
)  # fmt: skip
def test_a_page_hears_over_the_loopback_where_nobody_has_chosen_otherwise(
    given: dict[str, str], over_udp: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    for name in (*DISCOVERY, "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    hear_over_udp()
    assert (RANGE not in os.environ and os.environ.get(PROFILES, "").endswith("security/loopback_udp.xml")) is over_udp
    assert over_udp or {name: os.environ[name] for name in given} == given
    monkeypatch.delenv(PROFILES, raising=False)
