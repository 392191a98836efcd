"""The compensator with an axis model: switched at run time, refused where it cannot be, without what nobody measures."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from tcs_friction.config import AxisFile, load_axis, save_axis
from tcs_friction.control.model_compensator import ModelCompensator
from tcs_friction.nodes.core.wire import REFERENCE, TORQUE
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.signals import SignalMap, SignalSource

CONFIG = Path(__file__).resolve().parents[2] / "config"
PERIOD_NS = 1_000_000
SPEED = 0.01  # rad/s
FRICTION = 78.1 + 572.0 * SPEED


def written(path: Path, effects: Mapping[str, Mapping[str, float]], **changes: Any) -> str:
    """The shipped axis with these effects alone."""
    file = load_axis(CONFIG / "azimuth_1p2m.yaml")
    items = tuple(
        instance(effect(name), values, signal="wind" if effect(name).signals else None) for name, values in effects.items()
    )
    save_axis(path, AxisFile(replace(file.axis, effects=items, **changes), None, file.control))
    return str(path)


class Asked:
    """A compensator in lock-step that is asked tick by tick at constant speed."""

    def __init__(self, together: Callable[..., Any], *words: str) -> None:
        self.graph = together(*(w for word in ("switch3:=true", *words) for w in ("-p", word)), nodes=("lugre_compensator",))
        self.node = self.graph["lugre_compensator"]
        self._tick = 0

    def torques(self, ticks: int) -> np.ndarray:
        result = []
        for _ in range(ticks):
            self.node._on_reference(REFERENCE.write(self._tick * PERIOD_NS, 1e-3 * SPEED * self._tick, SPEED, 0.0))
            result.append(TORQUE.read(self.node._message)[1][0])
            self._tick += 1
        return np.array(result)

    def set(self, **values: Any) -> str:
        """Why a change was refused, "" when it was not."""
        given = [Parameter(name, value=value) for name, value in values.items()]
        return str(self.node.set_parameters_atomically(given).reason)


def test_a_model_and_its_effects_come_and_go_without_a_step(together: Callable[..., Any], tmp_path: Path) -> None:
    model = written(tmp_path / "model.yaml", {"torque_bias": {"bias": 50.0}})
    asked = Asked(together, "entry_time:=0.1")
    before = asked.torques(3000)[-1]
    assert before == pytest.approx(FRICTION, rel=0.05)
    assert asked.set(model=model) == ""
    coming = asked.torques(3000)
    assert coming[-1] == pytest.approx(before + 50.0, rel=0.02)
    assert np.max(np.abs(np.diff([before, *coming]))) < 4.0, "its bristles bend, and 50 N m come in 100 ticks"
    assert asked.set(left_out=["torque_bias"]) == ""
    leaving = asked.torques(200)
    assert leaving[-1] == pytest.approx(before, rel=0.02)
    assert np.max(np.abs(np.diff([coming[-1], *leaving]))) < 0.6, "50 N m in 100 ticks"
    assert asked.set(left_out=[""]) == ""
    assert asked.torques(200)[-1] == pytest.approx(coming[-1])
    assert asked.set(effect_limit=20.0) == ""
    limited = asked.torques(120)
    assert limited[-1] == pytest.approx(before + 20.0, rel=0.02)
    assert np.max(np.abs(np.diff([coming[-1], *limited]))) < 0.6, "30 N m in 100 ticks"
    assert asked.set(effect_limits=["torque_bias=10.0"]) == ""
    assert asked.torques(120)[-1] == pytest.approx(before + 10.0, rel=0.02), "its own limit instead of that of all"
    assert asked.set(effect_limits=[""], effect_limit=1e12, total_limit=90.0) == ""
    assert asked.torques(120)[-1] == 90.0
    assert asked.set(model="", total_limit=500.0) == ""
    assert asked.torques(3000)[-1] == pytest.approx(before, rel=1e-6)


def test_a_correction_of_the_encoder_comes_and_goes_without_a_step(together: Callable[..., Any], tmp_path: Path) -> None:
    """Of the position that controller and observer are given; before the first state it is there at once."""
    error = {"order": 3000.0, "amplitude": 1e-5, "phase": 0.5}
    models = [written(tmp_path / f"{k}.yaml", {"encoder_periodic_error": {**error, "amplitude": k * 1e-5}}) for k in (1, 2)]
    graph = together("-p", "entry_time:=0.1", "-p", f"model:={models[0]}", nodes=("controller", "dob"))
    for node in (graph["controller"], graph["dob"]):

        def positions(ticks: int, node: Any = node) -> list[float]:
            return [node._motion.at(0.0, 0.0)[0] for _ in range(ticks)]

        there = positions(2)
        assert there[0] == there[1] == pytest.approx(-1e-5 * math.sin(0.5), rel=0.05)
        for model, wanted in ((models[1], 2.0 * there[0]), ("", 0.0), (models[0], there[0])):
            assert node.set_parameters_atomically([Parameter("model", value=model)]).successful
            passed = positions(120)
            assert np.max(np.abs(np.diff([there[-1], *passed]))) < 2.2e-7, "1e-5 rad in 100 ticks"
            assert passed[-1] == pytest.approx(wanted, rel=0.1, abs=1e-12)
            there = passed
        node._motion.reset()
        assert node.set_parameters_atomically([Parameter("model", value="")]).successful
        assert positions(1) == [0.0], "a new run begins with it"


@pytest.mark.parametrize(
    ("effects", "changes", "expected"),
    [
        ({}, {"kind": "linear"}, "of a linear axis, expected one of the rotary axis azimuth"),
        ({}, {"name": "altitude"}, "of another joint, expected one of joint azimuth"),
        ({"transport_delay": {"delay": 0.5}}, {}, "it has to act 50"),
        ({"imbalance": {"amplitude": 5e3}}, {}, "cancelling what it has takes 5"),
    ],
)
def test_a_model_that_cannot_be_cancelled_is_refused_and_changes_nothing(
    together: Callable[..., Any], tmp_path: Path, effects: Any, changes: Any, expected: str
) -> None:
    asked = Asked(together)
    reason = asked.set(model=written(tmp_path / "model.yaml", effects, **changes))
    assert expected in reason
    assert "\n" not in reason
    assert asked.node.config.model == ""
    assert asked.torques(3000)[-1] == pytest.approx(FRICTION, rel=0.05)


def test_effects_that_nobody_knows_are_refused(together: Callable[..., Any], tmp_path: Path) -> None:
    asked = Asked(together, f"model:={written(tmp_path / 'model.yaml', {'torque_bias': {'bias': 50.0}})}")
    assert "no effect 'torque_bais'" in asked.set(left_out=["torque_bais"])
    assert "effect_limits: model azimuth has no effect 'torque_bais'" in asked.set(effect_limits=["torque_bais=1.0"])
    for wrong in ("torque_bias", "torque_bias=", "torque_bias=-1", "torque_bias=nan", "=1"):
        assert f"effect_limits: {wrong!r}, expected NAME=LIMIT" in asked.set(effect_limits=[wrong])
    assert "effect_limits: of torque_bias without a model" in asked.set(model="", effect_limits=["torque_bias=1.0"])
    assert "no such file" in asked.set(model="nowhere.yaml")
    assert "without a model" in asked.set(model="", left_out=["torque_bias"])


def test_a_model_is_refused_for_another_axis_and_the_one_in_use_goes_on(together: Callable[..., Any], tmp_path: Path) -> None:
    model = written(tmp_path / "model.yaml", {"torque_bias": {"bias": 50.0}})
    asked = Asked(together, f"model:={model}")
    in_use = asked.node._model
    reason = asked.set(axis=written(tmp_path / "altitude.yaml", {}, name="altitude"), model=model)
    assert "of another joint, expected one of joint altitude" in reason
    assert "of another joint" in asked.set(model=written(tmp_path / "other.yaml", {}, name="altitude"))
    assert asked.set(entry_time=0.2) == ""
    assert asked.node._model is in_use


def test_without_a_thermometer_what_depends_on_it_leaves_and_is_reported(together: Callable[..., Any], tmp_path: Path) -> None:
    effects = {"temperature_dependent_friction": {"dry": 0.02}, "wind_torque": {"coefficient": 1.0}}
    path = written(tmp_path / "model.yaml", effects)
    asked = Asked(together, "clock:=real_time", "temperature_age:=0.3", f"model:={path}")
    node = asked.node
    assert "temperature_dependent_friction (no temperature), wind_torque (no wind)" in node.health.warning
    node._on_temperature(Temperature(temperature=30.0))
    assert "not cancelled: wind_torque (no wind)" in node.health.warning
    assert node._model.plan.wanted.sum() == 2.0, "the law and the friction's temperature"
    node._on_temperature(Temperature(temperature=1e9))
    assert node.health.refused == 1
    time.sleep(0.35)
    node._watch(time.monotonic())
    assert "temperature_dependent_friction (no temperature)" in node.health.warning
    assert node._model.plan.wanted.sum() == 1.0


def test_lock_step_waits_for_the_temperature_that_a_model_needs(together: Callable[..., Any], tmp_path: Path) -> None:
    asked = Asked(together, f"model:={written(tmp_path / 'model.yaml', {'temperature_dependent_friction': {'dry': 0.02}})}")
    asked.node._on_reference(REFERENCE.write(0, 0.0, SPEED, 0.0))
    assert asked.node._message == b""
    assert asked.node.missing() == "temperature"
    asked.node._on_temperature(Temperature(temperature=30.0))
    assert asked.node._message
    assert asked.node.missing() == ""
    assert asked.torques(3000)[-1] == pytest.approx(1.2 * 78.1 + 5.72, rel=0.02)


def windy(path: Path, topic: str = "/wind", field: str = "data", joint: str | None = None) -> str:
    """A model with a torque of 2 N m for a wind of 1 (m/s)^2, and where the wind is measured."""
    file = load_axis(Path(written(path, {"wind_torque": {"coefficient": 2.0}})))
    place = SignalSource(f"{topic}_state", "position")
    signals = SignalMap(place, SignalSource(f"{topic}_state", "effort"), exogenous={"wind": SignalSource(topic, field, joint)})
    save_axis(path, replace(file, signals=signals))
    return str(path)


def test_a_signal_is_heard_on_the_topic_that_the_model_names_and_leaves_when_it_is_old(
    together: Callable[..., Any], tmp_path: Path
) -> None:
    path = windy(tmp_path / "model.yaml")
    asked = Asked(together, "clock:=real_time", "signal_age:=0.5", "ramp_time:=0.0", "entry_time:=0.0", f"model:={path}")
    node, graph = asked.node, asked.graph
    assert "wind_torque (no wind)" in node.health.warning
    wind = graph.driver.create_publisher(Float64, "/wind", 10)

    def hears() -> bool:
        wind.publish(Float64(data=3.0))
        node._watch(time.monotonic())
        return bool(node._signals.heard("wind"))

    assert graph.until(hears)
    node.health.forget_events()
    assert "wind_torque" not in node.health.warning
    assert node._signals.values(["wind"])[0] == 3.0
    node._model.reset()
    calm = ModelCompensator(load_axis(Path(path)).axis, 1e-3, signals=("wind",))
    still = calm.step(0.0, 0.0, SPEED, 0.0)
    assert node._source.step(0.0, 0.0, SPEED, 0.0, 20.0) == pytest.approx(still + 18.0)
    wind.publish(Float64(data=float("nan")))
    assert graph.until(lambda: node.health.refused == 1)
    assert node._signals.values(["wind"])[0] == 3.0
    time.sleep(0.55)
    node._watch(time.monotonic())
    assert "wind_torque (no wind)" in node.health.warning


def test_a_signal_of_another_joint_has_the_rate_between_its_stamps(together: Callable[..., Any], tmp_path: Path) -> None:
    path = windy(tmp_path / "model.yaml", "/others", "velocity", "elevation")
    asked = Asked(together, f"model:={path}")
    node, graph = asked.node, asked.graph
    asked.node._on_reference(REFERENCE.write(0, 0.0, SPEED, 0.0))
    assert (node._message, node.missing()) == (b"", "wind"), "in lock-step a run begins when all has come"
    states = graph.driver.create_publisher(JointState, "/others", 10)

    def say(nanoseconds: int, speed: float, names: tuple[str, ...] = ("focus", "elevation")) -> None:
        message = JointState(name=list(names), position=[0.0] * len(names), velocity=[7.0, speed][-len(names) :])
        message.header.stamp.nanosec = nanoseconds
        states.publish(message)

    node._signals.look()

    def hears() -> bool:
        node._signals.look()
        say(1_000_000, 1.0)
        return bool(node._signals.heard("wind"))

    assert graph.until(hears)
    assert node._message, "the reference that waited was answered"
    say(11_000_000, 1.5)
    assert graph.until(lambda: node._signals.values(["wind"]) == pytest.approx([1.5, 50.0]))
    say(12_000_000, 9.0, ("focus",))
    assert graph.until(lambda: node.health.refused > 0)
    assert node._signals.values(["wind"])[0] == 1.5
    asked.set(model="")
    assert node._signals._subscriptions == {}
