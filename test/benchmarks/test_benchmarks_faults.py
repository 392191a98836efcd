"""The benchmark of faults, short, with all its checks; garbled messages are garbled."""

from __future__ import annotations

import itertools
import json
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.faulty_companions import Surroundings, companions
from benchmarks.faulty_nodes import GARBLED_COUNT, Faulty, Loop, beyond_doubt, garbled
from benchmarks.faulty_watch import REFUSED, Watch
from benchmarks.listening import Report, wait_until
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.core.wire import JointWire
from tcs_friction.nodes.graph import LOOP


@pytest.mark.usefixtures("ros_domain")
def test_the_loop_keeps_its_limits_and_resumes_after_faults() -> None:
    command = [
        sys.executable,
        "-P",
        "-m",
        "tcs_friction.cli",
        "bench",
        "faults",
        "--minutes",
        "0.2",
        "--json",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=250, check=False)
    assert ended.returncode == 0, ended.stderr
    results = {entry["name"]: entry for entry in json.loads(ended.stdout)["results"]}
    assert sum(entry["value"] for name, entry in results.items() if name.startswith("faults")) >= 2
    limited = [entry for name, entry in results.items() if name.startswith("largest")]
    assert len(limited) == 3
    for entry in limited:
        assert 0.0 < entry["value"] <= entry["beside"] * (1.0 + 1e-6)
    assert {f"killed or stopped: {name}" for name in (*LOOP, *companions())} <= set(results)
    refused = [entry for name, entry in results.items() if name.startswith("inputs refused by")]
    assert len(refused) == 5
    assert sum(entry["value"] for entry in refused) >= sum(entry["beside"] for entry in refused) > 0


@pytest.mark.usefixtures("ros_domain")
def test_a_node_that_ends_by_itself_is_named_with_its_last_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TCS_FRICTION_CRASHES", raising=False)  # CI need not tell of this one
    loop = Loop(0)
    try:
        loop.start("dob")
        assert wait_until(lambda: loop._words("dob").exists(), 100.0)
        assert loop.revive() == []
        loop.signal("dob", signal.SIGSEGV)
        assert wait_until(lambda: loop._processes["dob"].exitcode is not None)
        (said,) = loop.revive()
        assert said.startswith("node dob was killed by SIGSEGV by itself; its last words are in ")
        words = Path(said.rpartition(" ")[2])
        assert "Segmentation fault" in words.read_text()
        assert wait_until(loop._words("dob").exists, 100.0), "it was started anew"
    finally:
        loop.end()
    assert words.exists()
    for path in (*words.parent.iterdir(), words.parent):
        path.unlink() if path.is_file() else path.rmdir()


def test_garbled_messages_differ_and_never_grow() -> None:
    data = JointWire("azimuth").write(5 * 10**9, 0.1, 0.2, 0.3)
    chance = random.Random(0)
    made = [garbled(data, chance) for _ in range(200)]
    assert all(len(item) <= len(data) for item in made)
    assert sum(item != data for item in made) > 190


def test_messages_are_doubled_swapped_and_lost() -> None:
    class Sent(list[bytes]):
        publish = list.append
        health = Health()

    wire, sent = JointWire("azimuth"), Sent()
    faulty = Faulty(sent, sent, random.Random(0))
    good = [wire.write(10**18 + k * 10**7, 0.1, 0.2, 0.3) for k in range(1, 5001)]
    for data in good:
        faulty.publish(data)
    came = [data for data in sent if data in set(good)]
    first = list(dict.fromkeys(came))
    assert 30 < len(good) - len(first) < 70, "lost"
    assert 60 < len(came) - len(first) < 140, "twice, or once more when old"
    numbers = [good.index(data) for data in first]
    assert 30 < sum(later < earlier for earlier, later in itertools.pairwise(numbers)) < 70, "swapped"


def test_garbled_beyond_doubt_is_what_every_node_has_to_refuse() -> None:
    wire = JointWire("azimuth")
    good = wire.write(10**18, 0.1, 0.2, 0.3)
    assert not beyond_doubt(good, wire.write(10**18 + 10**9, 0.1, 0.2, 1e6))
    assert beyond_doubt(good, wire.write(0, 0.1, 0.2, 0.3))
    assert beyond_doubt(good, good[:-1])


@pytest.mark.usefixtures("ros_domain")
def test_the_judge_measures_steps_of_the_reference_and_counts_over_restarts() -> None:
    watch = Watch()
    try:
        wire, begin = watch._wire, 10**18
        def hear(*samples: tuple[int, float, float, float]) -> float:
            for tick, position, speed, axis in samples:
                watch._on_reference(wire.write(begin + tick * 10**7, position, speed, axis))
            return watch.stepped

        assert hear((0, 0.0, 0.0, 0.0), (1, 5e-4, 0.0, 0.0), (2, 0.5, 0.09, 0.5)) == pytest.approx(0.05)
        assert hear((3, 0.50088, 0.085, 0.49)) == pytest.approx(0.05), "it may begin at the axis, and slow down from its speed"
        assert hear((4, 0.5017, 0.07, 0.49), (5, 0.503, 0.07, 0.49)) == pytest.approx(0.13)
        for refused, sent in ((5, 2), (7, 3), (1, 0), (2, 4)):
            watch._on_report("plant", Report(0.0, 1, "", {REFUSED: str(refused)}))
            watch._on_report("controller", Report(0.0, 1, "", {GARBLED_COUNT: str(sent)}))
        assert watch.refusals()[0] == ("plant", 7 + 2, 3 + 4)
        assert watch.until_silent("plant", 1.0)
        assert not watch.until_silent("dob", 0.1), "which has never reported"
    finally:
        watch.close()


def test_a_recording_that_cannot_be_read_counts_as_none(tmp_path: Path) -> None:
    surroundings = Surroundings(tmp_path)
    assert surroundings.recorded(tmp_path / "played") == 500
    surroundings.parameters("recorder")
    assert surroundings.recorded(surroundings.recordings[-1]) == 0
