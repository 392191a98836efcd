"""What the first line says, and what wins where several things are so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tcs_friction.config import load_axis, shipped
from tcs_friction.live.headline import WARNING, WELL, WRONG, Situation, headline
from tcs_friction.live.hub import units_of
from tcs_friction.nodes.page.state import Condition, Job, Switches

NOW = 1000.0


def said(level: int, message: str = "", age: float = 0.5) -> Condition:
    return Condition(NOW - age, level, message, {})


FINE = Situation(NOW, NOW - 0.01, {"plant": said(0), "dob": said(0)}, Switches((False, False, True)), Job(), "0.02 arcsec")


@pytest.mark.parametrize(
    ("situation", "level", "state", "words"),
    [
        (FINE, WELL, "Well", "Tracking error 0.02 arcsec rms over the last 5 s; friction is compensated."),
        (replace(FINE, error=""), WELL, "Well", "Friction is compensated."),
        (replace(FINE, job=Job("commission", "measuring", 0.25, None)), WELL, "Well", "commission: measuring (25%)."),
        (replace(FINE, switches=Switches((True, False, True))), WELL, "Well", "one by one"),
        (replace(FINE, switches=Switches()), WELL, "Well", "not known"),
        (replace(FINE, conditions={"dob": said(1, "late")}), WARNING, "Running with warnings", "dob: late"),
        (
            replace(FINE, conditions={"dob": said(1, "late"), "monitor": said(1, "physics changed")}),
            WARNING,
            "Running with warnings",
            "monitor: physics changed; dob: late",
        ),
        (replace(FINE, conditions={"dob": said(2, "lost"), "plant": said(1, "late")}), WRONG, "Trouble", "dob: lost"),
        (replace(FINE, conditions={"plant": said(0), "dob": said(0, age=20)}), WRONG, "Node lost", "dob has not reported"),
        (replace(FINE, heard=NOW - 9), WRONG, "Standing still", "No joint states for 9 s."),
        (replace(FINE, heard=-1.0), WRONG, "Standing still", "No joint states yet."),
        (replace(FINE, heard=NOW - 9, conditions={"c": said(2, "no driver")}), WRONG, "Standing still", "c: no driver"),
        (
            replace(FINE, heard=NOW - 9, conditions={"plant": said(0, "waiting: run_until")}),
            WARNING,
            "Standing still",
            "on purpose. plant: waiting: run_until",
        ),
        (replace(FINE, heard=NOW - 9, conditions={"plant": said(0, age=20)}), WRONG, "Graph lost", "for 9 s"),
        (replace(FINE, heard=-1.0, conditions={}), WRONG, "No graph", "is its graph running?"),
    ],
)
def test_the_worst_comes_first(situation: Situation, level: str, state: str, words: str) -> None:
    found = headline(situation)
    assert (found.level, found.state) == (level, state)
    assert words in found.sentence


def test_an_axis_in_amperes_is_shown_in_amperes() -> None:
    file = load_axis(shipped("azimuth_geared.yaml"))
    assert units_of(file.axis).torque == "N m"
    assert units_of(replace(file.axis, torque_unit="A")).torque == "A"
    assert units_of(replace(file.axis, kind="linear")).torque == "N"
