"""Encoders whose angle begins anew after a turn: the loop passes north as it passes any other place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from encoder_cases import as_it_is, from_zero, symmetric
from rclpy.parameter import Parameter
from test_nodes_steps import SETTINGS
from virtual import Loop

from tcs_friction.config import shipped
from tcs_friction.control.turns import TURN, beside
from tcs_friction.nodes.drivers.driver_node import DriverConfig, DriverNode
from tcs_friction.nodes.drivers.hardware import Hardware, Measured

NORTH = 0.02  # rad before a turn is full at the start
PASS = {
    "kind": "constant_speed",
    "constant_speed.velocity": 0.05,
    "constant_speed.duration": 100.0,
    "start_position": TURN - NORTH,
    "clock": "real_time",
}


@pytest.fixture
def wrapped(tmp_path: Path, ros_domain: None) -> Iterator[Callable[..., Loop]]:  # noqa: ARG001
    """Runs a programme that begins at 0, of an axis that stands just before it, with an encoder of some kind."""
    loops: list[Loop] = []
    with pytest.MonkeyPatch.context() as patch:

        def run(encoder: Callable[[float], float], continuous: bool = True, limits: str = "", **given: Any) -> Loop:
            text = shipped("azimuth_1p2m.yaml").read_text()
            text = text.replace("  kind: rotary\n", f"  kind: rotary\n  continuous: {str(continuous).lower()}\n")
            (tmp_path / "axis.yaml").write_text(text.replace("control:\n", f"control:\n  limits: {{{limits}}}\n"))
            loop = Loop(patch, SETTINGS | PASS | {"axis": tmp_path / "axis.yaml"} | given)
            loops.append(loop)
            plant: Any = loop.nodes["plant"]
            write = plant._wire.write
            patch.setattr(plant._wire, "write", lambda stamp, position, *more: write(stamp, encoder(position), *more))
            loop.run(3.0)
            return loop

        yield run
        for loop in loops:
            loop.close()


@pytest.mark.parametrize("encoder", [from_zero, symmetric])
def test_a_programme_passes_north(wrapped: Callable[..., Loop], encoder: Callable[[float], float]) -> None:
    loop = wrapped(encoder)
    plant: Any = loop.nodes["plant"]
    assert plant._simulator.position > TURN + 0.02
    away = [beside(error, 0.0) for error in loop.errors[len(loop.errors) // 2 :]]
    assert np.abs(away).max() < 1e-4
    assert loop.nodes["reference"].health.values["phase"] == "running"


def test_without_continuous_it_is_abandoned(wrapped: Callable[..., Loop]) -> None:
    loop = wrapped(from_zero, continuous=False, **{"constant_speed.start": TURN - NORTH})
    assert loop.nodes["reference"].health.values["phase"] != "running"


def test_the_programme_takes_the_turn_that_the_cables_allow(wrapped: Callable[..., Loop]) -> None:
    """Just past the travel's end there is no way on: it goes back to the 0 that lies within."""
    loop = wrapped(as_it_is, limits="travel_from: -4.0, travel_to: 6.3", start_position=0.01)
    assert loop.nodes["reference"].health.values["phase"] == "running"
    assert abs(loop.errors[-1]) < 1e-4


def test_a_programme_that_no_turn_has_room_for_is_refused(wrapped: Callable[..., Loop]) -> None:
    inside = {"kind": "hold", "hold.position": 1.0, "start_position": 1.0}
    loop = wrapped(from_zero, limits="travel_from: 0.05, travel_to: 6.0", **inside)
    assert loop.nodes["reference"].health.values["phase"] == "running"
    assert not loop.set("reference", kind="constant_speed")


class Drive(Hardware):
    """Says whatever the test wants."""

    def open(self, heard: Callable[[Measured], None]) -> None:
        self.heard = heard

    def apply(self, torque: float) -> None:
        self.torque = torque

    def stop(self, reason: str, exceeded: bool = False) -> None:  # noqa: ARG002
        self.torque = 0.0

    def tick(self) -> None:
        pass

    def reset(self) -> None:
        pass

    def close(self) -> None:
        pass


class Driver(DriverNode[DriverConfig]):
    def __init__(self) -> None:
        super().__init__(DriverConfig)

    def make(self, config: DriverConfig) -> Drive:  # noqa: ARG002
        return Drive()


@pytest.fixture
def driver(tmp_path: Path, ros_domain: None) -> Iterator[Callable[..., Driver]]:  # noqa: ARG001
    """Makes a driver of a continuous axis whose cables allow a turn and a half."""
    made: list[Driver] = []

    def make(*words: str) -> Driver:
        text = shipped("azimuth_1p2m.yaml").read_text().replace("  kind: rotary\n", "  kind: rotary\n  continuous: true\n")
        limits = "control:\n  limits: {travel_from: -4.7, travel_to: 4.7}\n"
        (tmp_path / "axis.yaml").write_text(text.replace("control:\n", limits))
        rclpy.init(args=["test", "--ros-args", "-p", f"axis:={tmp_path / 'axis.yaml'}", *words])
        made.append(Driver())
        return made[0]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def hear(driver: Driver, angle: float) -> None:
    drive: Any = driver.hardware
    drive.heard(Measured(driver.get_clock().now().nanoseconds, angle, 0.0, 0.0))
    driver._on_timer()


def test_a_driver_lets_no_torque_on_before_it_knows_the_turn(driver: Callable[..., Driver]) -> None:
    node = driver()
    hear(node, 4.0)
    assert "may be at -2.283 or 4 rad, within its travel: set start_near" in node.health.warning
    node.set_parameters([Parameter("start_near", value=-2.0)])
    hear(node, 4.0)
    assert node._measured.position == pytest.approx(4.0 - TURN)
    assert "start_near" not in node.health.warning
    for angle in (3.5, 3.2, 3.1, from_zero(-3.3)):
        hear(node, symmetric(angle))  # an encoder of the other kind goes on as well
    assert node._measured.position == pytest.approx(-3.3)


def test_a_driver_is_told_the_turn_at_its_start(driver: Callable[..., Driver]) -> None:
    node = driver("-p", "start_near:=4.5")
    hear(node, symmetric(4.0))
    assert node._measured.position == pytest.approx(4.0)
    assert "start_near" not in node.health.warning
