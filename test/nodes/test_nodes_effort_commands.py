"""Commands to several joints of which one is the axis: order, what the others keep, what is not clear enough."""

from __future__ import annotations

import math

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray

from tcs_friction.errors import InputError
from tcs_friction.nodes.drivers.effort_commands import EffortCommand, objection, others_of

ARM = ("shoulder", "axis", "elbow")


def test_only_the_number_of_the_axis_changes() -> None:
    command = EffortCommand(ARM, "axis", {"elbow": 2.0, "shoulder": 1.0})
    for torque, sent in ((5.0, 5.0), (-3.0, -3.0), (math.nan, 0.0), (math.inf, 0.0)):
        message = deserialize_message(command.write(torque), Float64MultiArray)
        assert list(message.data) == [1.0, sent, 2.0]
        assert not message.layout.dim


def test_others_are_read() -> None:
    assert others_of(["a=1.5", " b = measured "], "here") == {"a": 1.5, "b": None}
    assert others_of([], "here") == {}


@pytest.mark.parametrize("text", ["a", "a=", "=1", "a=nan", "a=much", ""])
def test_an_other_that_is_not_clear_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=f"here: '{text}', expected JOINT=EFFORT in N m, or JOINT=measured"):
        others_of([text], "here")
    with pytest.raises(InputError, match="a twice"):
        others_of(["a=1", "a=2"], "here")


@pytest.mark.parametrize(
    ("joints", "interface", "others", "words"),
    [
        (("axis",), "effort", {}, ""),
        (ARM, "", {"shoulder": 1.0, "elbow": None}, ""),
        ((), "effort", {}, "/c names 0 joints, expected axis"),
        (("axis", "axis"), "effort", {}, "/c names a joint twice"),
        (("axis",), "velocity", {}, "/c commands velocity, expected effort"),
        (("elbow",), "effort", {}, "/c commands elbow, expected axis"),
        (ARM, "effort", {"elbow": 0.0}, "/c commands shoulder as well: say in parameter others what each keeps, as JOINT=EFFORT"),
        (("axis",), "effort", {"elbow": 0.0}, "parameter others names elbow, which /c does not command beside axis"),
        (("axis",), "effort", {"axis": 0.0}, "parameter others names axis, which /c does not command beside axis"),
    ],
)
def test_a_controller_that_the_axis_cannot_be_driven_through_is_named(
    joints: tuple[str, ...], interface: str, others: dict[str, float | None], words: str
) -> None:
    assert objection(joints, interface, "axis", others, "/c") == words


def test_many_joints_are_not_all_named() -> None:
    assert len(objection([f"joint_{k}" for k in range(900)], "effort", "axis", {}, "/c")) < 200
