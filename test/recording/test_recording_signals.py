"""The `signals:` block: what is accepted, and what is said about what is not."""

from __future__ import annotations

from typing import Any

import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording.signals import SignalMap, SignalSource

POSITION = {"topic": "/joint_states", "field": "position", "joint": "azimuth"}
TORQUE = {"topic": "/joint_states", "field": "effort", "joint": "azimuth", "scale": 2}


def test_a_block_is_read_and_written_back_the_same() -> None:
    block = {
        "position": POSITION,
        "torque": TORQUE,
        "temperature": {"topic": "/temperature", "field": "temperature"},
        "exogenous": {"wind_speed": {"topic": "/wind", "field": "vector.x"}},
    }
    signals = SignalMap.from_mapping(block, "axis.yaml")
    assert signals.torque == SignalSource("/joint_states", "effort", "azimuth", 2.0)
    assert signals.topics == ("/joint_states", "/temperature", "/wind")
    assert [name for name, _ in signals.named()] == ["position", "torque", "temperature", "wind_speed"]
    assert SignalMap.from_mapping(signals.to_mapping(), "again").to_mapping() == signals.to_mapping()


def test_paths_have_names_and_indices() -> None:
    assert SignalSource("/a", "points[0].positions[12]").steps == ("points", 0, "positions", 12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"velocty": POSITION}, "axis.yaml: signals: unknown key 'velocty', expected velocity"),
        ({"position": {**POSITION, "scal": 2}}, "signals.position: unknown key 'scal', expected scale"),
        ({"position": None}, "position is missing"),
        ({"position": "/joint_states"}, "'/joint_states', expected a mapping"),
        ({"position": {"topic": "/a"}}, "field is None"),
        ({"position": {**POSITION, "field": "pose..x"}}, "'' is no field name"),
        ({"position": {**POSITION, "field": "position[0]"}}, "joint azimuth and an index"),
        ({"position": {**POSITION, "joint": 3}}, "quote it"),
        ({"torque": {**TORQUE, "scale": 0}}, "scale is 0"),
        ({"torque": {**TORQUE, "scale": float("nan")}}, "scale is nan"),
        ({"torque": {**TORQUE, "scale": True}}, "scale is True"),
        ({"exogenous": {"torque": TORQUE}}, "torque is a signal of the axis"),
        ({"exogenous": 3}, "3, expected a mapping"),
    ],
)
def test_a_wrong_block_says_where_and_what(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as caught:
        SignalMap.from_mapping({"position": POSITION, "torque": TORQUE} | change, "axis.yaml")
    assert said in str(caught.value)


def test_position_and_torque_are_needed() -> None:
    with pytest.raises(InputError, match="torque is missing"):
        SignalMap.from_mapping({"position": POSITION}, "axis.yaml")
