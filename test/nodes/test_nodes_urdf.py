"""What a robot's description says of a joint, and what becomes of a description that is none or is meant to do harm."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.control.torque_gate import TorqueLimits
from tcs_friction.errors import InputError
from tcs_friction.nodes.drivers.urdf import DEEPEST, LARGEST, JointLimits, joint_limits, load_joint_limits

OWN = TorqueLimits(torque_limit=10.0, overspeed=1.0, travel_from=-2.0, travel_to=2.0)
LIMIT = '<limit effort="20" velocity="0.5" lower="-1" upper="3"/>'


def robot(inside: str = LIMIT, kind: str = "revolute", name: str = "a", rest: str = "") -> str:
    """A description with one joint of that inside, and the same name where it is of no meaning."""
    strange = f'<ros2_control><joint name="{name}"><limit effort="1" velocity="1"/></joint></ros2_control>'
    return f'<?xml version="1.0"?><robot name="r">{strange}<joint name="{name}" type="{kind}">{inside}</joint>{rest}</robot>'


def test_a_joint_is_read() -> None:
    dynamics = '<origin xyz="0 0 1"/><dynamics friction="1.5" damping="2"/>'
    assert joint_limits(robot(LIMIT + dynamics), "a", "here") == JointLimits("rotary", 20.0, 0.5, -1.0, 3.0, 1.5, 2.0)
    assert joint_limits(robot(kind="continuous").encode(), "a", "here") == JointLimits("rotary", 20.0, 0.5)
    assert joint_limits(robot(kind="prismatic"), "a", "here").kind == "linear"
    assert math.isinf(JointLimits("rotary", 1.0, 1.0).upper)


@given(*[st.floats(0.1, 100.0)] * 4)
def test_the_smaller_limits_hold(effort: float, speed: float, lower: float, upper: float) -> None:
    held = JointLimits("rotary", effort, speed, -lower, upper).within(OWN, "here")
    assert (held.torque_limit, held.overspeed) == (min(effort, 10.0), min(speed, 1.0))
    assert (held.travel_from, held.travel_to) == (max(-lower, -2.0), min(upper, 2.0))
    assert held.watchdog == OWN.watchdog


def test_travel_that_has_nothing_in_common_is_refused() -> None:
    with pytest.raises(InputError, match=r"here: travel from 3 to 4, expected some of it within travel_from \(-2\) to 2"):
        JointLimits("rotary", 1.0, 1.0, 3.0, 4.0).within(OWN, "here")


BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>' + robot().partition("?>")[2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "here: no XML"),
        ("<robot>", "here: no XML"),
        ("joint: azimuth", "here: no XML"),
        ('<?xml version="1.0" encoding="nonsense"?><robot/>', "here: no joint a"),
        (BOMB, "here: has a DOCTYPE, expected a URDF, which has none"),
        ("<robot>" * (DEEPEST + 1), f"here: tags {DEEPEST} deep"),
        (" " * (LARGEST + 1), "here: more than 16 MiB"),
        (robot(name="b"), "here: no joint a, expected one of b"),
        (robot(rest='<joint name="a" type="fixed"/>'), "here: joint a twice"),
        (robot(kind="floating"), "here: joint a: type 'floating', expected one of revolute, continuous, prismatic"),
        (robot(LIMIT + '<mimic joint="b"/>'), "here: joint a: mimics another"),
        (robot(""), "here: joint a: no <limit>"),
        (robot('<limit velocity="1"/>'), "here: joint a: limit: effort '', expected a number"),
        (robot('<limit effort="nan" velocity="1" upper="1"/>'), "limit: effort 'nan', expected a number"),
        (robot('<limit effort="0" velocity="1" upper="1"/>'), "limits of effort 0, velocity 1, expected positive ones"),
        (robot('<limit effort="1" velocity="1"/>'), "limits of travel 0 to 0, expected lower below upper"),
        (robot(LIMIT + '<dynamics damping="much"/>'), "dynamics: damping 'much', expected a number"),
    ],
)
def test_what_cannot_be_used_is_named(text: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        joint_limits(text, "a", "here")
    assert words in str(refused.value)


@given(st.text() | st.binary())
def test_nothing_that_is_no_urdf_crashes(data: str | bytes) -> None:
    with pytest.raises(InputError):
        joint_limits(data, "a", "here")


def test_a_file_is_read_or_named(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    with pytest.raises(InputError, match=r"cannot be read \(No such file or directory\), expected a URDF file"):
        load_joint_limits(path, "a")
    path.write_text(robot())
    assert load_joint_limits(path, "a").effort == 20.0
