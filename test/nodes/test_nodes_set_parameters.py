"""Every parameter of every node: set while the node runs it acts as if given at the start, or it is refused."""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from tcs_friction.control.config_field import Setting, flatten
from tcs_friction.nodes.core import parameters
from tcs_friction.nodes.core.plain_node import PlainNode
from tcs_friction.nodes.graph import CLASSES, GRAPH, OTHERS, PLANTS, module_of

REMEMBERED = {
    "_waiting",  # a reference that was set begins when the axis is heard
    "_said",
    "_accepted",
    "_order",  # stamps of recent states
    "_run",  # which run of a plant it is
    "_given",  # what users have set
}
"""Attributes that tell what has happened, and not how the node is set."""


def state_of(thing: Any, path: str = "", seen: tuple[int, ...] = ()) -> Iterator[tuple[str, str]]:
    """All that an object of this package holds, name by name; of what belongs to others only the type."""
    if id(thing) in seen:
        return
    if isinstance(thing, Mapping):
        inside = [(str(key), value) for key, value in thing.items()]
    elif isinstance(thing, list | tuple | deque):
        inside = [(str(index), value) for index, value in enumerate(thing)]
    elif type(thing).__module__.startswith("tcs_friction.") and not isinstance(thing, Enum):
        slots = getattr(type(thing), "__slots__", ())
        names = [name for name in (*slots, *vars(thing)) if name not in REMEMBERED and not name.startswith("_Node__")]
        inside = [(name, getattr(thing, name)) for name in names]
    else:
        plain = isinstance(thing, int | float | str | bytes | Enum | frozenset | set | np.ndarray | None)
        yield path, repr(thing) if plain else type(thing).__name__
        return
    if path:
        yield path, f"{len(inside)} entries"
    for name, value in inside:
        yield from state_of(value, f"{path}.{name}", (*seen, id(thing)))


def another(entry: Setting, value: Any) -> Any:
    """A value near this one, so that it goes with all the others."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        files = ("azimuth_1p2m_run.yaml", "azimuth_1p2m_measure.yaml") if entry.name.endswith("_file") else ()
        return next(option for option in (*entry.options, *files, "elsewhere") if option != value)
    if isinstance(value, tuple):
        return ("elsewhere",)
    step = 1 if isinstance(value, int) else abs(value) / 64 or 1e-3
    return value - step if value + step > (entry.upper or 0) else value + step


def made(monkeypatch: pytest.MonkeyPatch, name: str, given: Mapping[str, Any]) -> Any:
    """A node of the graph that is given these values at the start."""
    module = importlib.import_module(module_of(name))
    with monkeypatch.context() as patch:
        usual = module.defaults
        patch.setattr(module, "defaults", lambda file: parameters.changed(usual(file), given))
        return getattr(module, CLASSES[name])()


@pytest.fixture
def ros() -> Iterator[None]:
    """ROS without arguments: they would win over what a node is given here."""
    rclpy.init(args=["test"])
    yield
    rclpy.try_shutdown()


@pytest.mark.usefixtures("ros")
@pytest.mark.parametrize("clock", ["lock_step", "real_time"])
@pytest.mark.parametrize("name", GRAPH)
def test_a_parameter_acts_or_is_refused(monkeypatch: pytest.MonkeyPatch, name: str, clock: str) -> None:
    node = made(monkeypatch, name, {"clock": clock})

    def started(**given: Any) -> dict[str, str]:
        other = made(monkeypatch, name, {"clock": clock} | given)
        state = dict(state_of(other))
        other.destroy_node()
        return state

    usual, again = started(), started()
    steady = {path for path in usual if again.get(path) == usual[path]}  # the rest is the time of the day
    for entry, (declared, value) in flatten(node.config).items():
        wanted = another(declared, value)
        answer = node.set_parameters([Parameter(entry, value=wanted)])[0]
        if declared.fixed:
            assert "read-only" in answer.reason, entry
        if not answer.successful:
            assert answer.reason, entry
            assert node.get_parameter(entry).value == ((list(value) or [""]) if isinstance(value, tuple) else value)
            continue
        changed, expected = dict(state_of(node)), started(**{entry: wanted})
        lacking = {path for path in steady if changed.get(path) != expected.get(path)}
        assert not lacking, f"{entry} set while the node runs is not what it is at the start"
        assert any(expected[path] != usual[path] for path in steady & set(expected)), f"{entry} changes nothing"
        assert node.set_parameters([Parameter(entry, value=value)])[0].successful, entry
    node.destroy_node()


@pytest.mark.usefixtures("ros")
@pytest.mark.parametrize("name", [name for name in OTHERS if name not in PLANTS])
def test_what_a_node_uses_from_the_start_on_cannot_be_set(name: str) -> None:
    module = importlib.import_module(module_of(name))
    (kind,) = [entry for key, entry in vars(module).items() if key.lower() == f"{name}config"]
    node: PlainNode[Any] = PlainNode(f"{name}_test", kind())
    for entry, (declared, value) in flatten(node.config).items():
        wanted = another(declared, value)
        answer = node.set_parameters([Parameter(entry, value=list(wanted) if isinstance(wanted, tuple) else wanted)])[0]
        assert not answer.successful, entry
        assert "read-only" in answer.reason
    node.destroy_node()
