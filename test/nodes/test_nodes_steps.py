"""One rule: whatever is set, called or switched on a moving axis, the torque makes no step beyond what the axis does by itself.

Every declared parameter of every node of the loop and of drivers is set while the axis moves, and set back, in lock-step and in
real time. The largest change of `torque_command` from tick to tick is at most twice that before, and the tracking error at most
1.2 times its peak of before, with compensation; where that becomes another one, 1.2 times the peak without. A new parameter is in
this test by itself. What begins, ends or replaces a motion is measured by a motion with the same limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from std_srvs.srv import Trigger
from virtual import Loop

from tcs_friction.commissioning.setup import MODES
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.config_field import Setting, changed, flatten
from tcs_friction.nodes.commissioning.modes import Modes
from tcs_friction.nodes.core.convert import SECOND, lugre_message
from tcs_friction.nodes.core.remote import Remotes
from tcs_friction.nodes.drivers.canopen_drive import CanopenDriveConfig
from tcs_friction.nodes.drivers.driver_node import DriverNode
from tcs_friction.nodes.drivers.hardware import Hardware, Measured
from tcs_friction.nodes.drivers.ros2_control_driver import Ros2ControlConfig
from tcs_friction.nodes.graph import LOOP
from tcs_friction.physics.simulate import Simulator

PERIOD = 0.005  # s
SETTINGS = {
    "period": PERIOD,
    "position_proportional": 12.0,
    "velocity_proportional": 6e4,
    "velocity_integral": 6e5,
    "bandwidth": 6.0,
    "following_limit": 0.05,
    "begin_at_once": "true",
    "switch1": "true",
}
SEEN = 1.0  # s
"""Of motion after each change; what comes later is seen after the next ones."""
STEP, ERROR = 2.0, 1.2
"""Times the largest step, and the peak of the error, of before."""
SHARE = 1.25
"""By which numbers are changed."""
FROM_ZERO = {"s": 2e-3, "N m s/rad": 500.0, "N m": 1.0}
"""By unit, what takes the place of a zero; else the 1e-3rd of the range."""
BEGINS_ANEW = {
    ("plant", "seed"): "the simulated axis begins anew at time 0",
    ("plant", "start_position"): "the simulated axis begins anew at time 0",
    ("plant", "period"): "the simulated axis begins anew at time 0",
    ("plant", "run_until"): "lock-step: time stands still there",
}
"""Beside them: another reference, and the services that start and stop it. In lock-step it is a function of the stamps; in real
time see `test_a_motion_begins_and_ends_as_gently_as_it_goes_on`."""
LAGS = "controller velocity_feedforward"
"""Whose meaning it is that the axis lags by a share of its speed."""
COMPENSATES_OTHERWISE = (
    "controller viscous_feedforward",
    "dob compensator",
    "dob plant.constant",
    "lugre_compensator model",
    "lugre_compensator share",
    "lugre_compensator switch3",
    "lugre_compensator ramp_time",  # after Switch3
    "lugre_compensator positive.",
    "lugre_compensator negative.",
)
"""What is compensated becomes another torque, over a time: the axis tracks between as without compensation and as with it.
In lock-step the compensation is that of the simulated friction itself, and the peak with it a 70th of that without."""
PERIODS = 1.05 * 40.0
"""Seconds in which the axis reverses both ways."""
ARCSEC = 206264.8


def another(declared: Setting, value: Any) -> Any:
    """Another value that somebody may want."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return next((option for option in declared.options if option != value), "azimuth_1p2m.yaml")
    if isinstance(value, tuple):
        return ["elsewhere"]
    if isinstance(value, int):
        return value + 1
    assert declared.upper is not None
    if value == 0.0:
        return FROM_ZERO.get(declared.unit, 1e-3 * min(declared.upper, 1.0))
    return value * SHARE if value * SHARE <= declared.upper else value / SHARE


class SimulatedDrive(Hardware):
    """An axis that a driver drives; time goes on with its ticks."""

    def __init__(self, simulator: Simulator, period: float, begin: int) -> None:
        self.simulator, self._period, self._stamp, self._torque = simulator, round(period * SECOND), begin, 0.0

    def open(self, heard: Callable[[Measured], None]) -> None:
        self._heard = heard

    def apply(self, torque: float) -> None:
        self._torque = torque

    def stop(self, reason: str, exceeded: bool = False) -> None:  # noqa: ARG002
        self._torque = 0.0

    def tick(self) -> None:
        applied = self.simulator.step(self._torque)
        self._stamp += self._period
        self._heard(Measured(self._stamp, self.simulator.measured_position, self.simulator.measured_velocity, applied))

    def reset(self) -> None:
        pass

    def close(self) -> None:
        pass


class SimulatedDriver(DriverNode[Ros2ControlConfig]):
    """With every setting of a driver that can be changed while it runs."""

    def __init__(self) -> None:
        super().__init__(Ros2ControlConfig)

    def make(self, config: Ros2ControlConfig) -> Hardware:
        later = 10_000 * SECOND  # than the clock of ROS, which this test does not wait for: no state is old when it comes
        simulator = Simulator(self.file.axis, config.period)
        return SimulatedDrive(simulator, config.period, self.get_clock().now().nanoseconds + later)


class SetInLoop(Remotes):
    """Sets the nodes of a loop as the services do, one by one while the axis moves. A node that is not in it takes all."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop

    async def get(self, node: str, names: Sequence[str], limit: float) -> dict[str, Any]:  # noqa: ARG002
        return {name: self._loop.nodes[node].get_parameter(name).value if node in self._loop.nodes else None for name in names}

    async def set(self, node: str, values: Mapping[str, Any], limit: float) -> None:  # noqa: ARG002
        if node in self._loop.nodes:
            assert self._loop.set(node, **values)
        self._loop.run(2 * PERIOD)


@pytest.fixture(params=["lock_step", "real_time"])
def moving(request: Any, tmp_path: Path, ros_domain: None) -> Iterator[Callable[..., Loop]]:  # noqa: ARG001
    """Makes a loop whose axis moves to and fro, and has done so for a while."""
    (tmp_path / "run.yaml").write_text("reference: {kind: sinusoid, amplitude: 0.2, period: 40.0, duration: 100000.0}\n")
    with pytest.MonkeyPatch.context() as patch:
        made: list[Loop] = []

        def make(*drivers: Any, **given: Any) -> Loop:
            file = {"clock": request.param, "reference_file": tmp_path / "run.yaml"}
            made.append(Loop(patch, SETTINGS | file | given, *drivers))
            made[0].run(12.0)
            return made[0]

        yield make
        for loop in made:
            loop.close()


def peaks(loop: Loop, seconds: float, begin: int = 0) -> tuple[float, float]:
    """Largest step of the torque (N m) and largest error (rad) while it goes on for so long, from tick `begin`, 0: now, on."""
    begin = begin or len(loop.torques) - 1
    loop.run(seconds)
    return loop.steps(begin), float(np.abs(loop.errors[begin:]).max())


def assert_no_step(found: list[tuple[str, float, float]], step: float, plain: float, compensated: float | None = None) -> None:
    """Every one within the rule: what was done, the largest step of the torque (N m) and the largest error (rad) after it.

    plain, compensated: the peak of the error (rad) before there was compensation, and with it.
    """
    wrong = []
    for name, largest, error in found:
        usual = plain if compensated is None or name.startswith(COMPENSATES_OTHERWISE) else compensated
        if largest > STEP * step or (error > ERROR * usual and not name.startswith(LAGS)):
            errors = f"error {ARCSEC * error:.2f} arcsec, {ARCSEC * usual:.2f} before"
            wrong.append(f"{name}: a step of {largest:.1f} N m, {step:.1f} before; {errors}")
    assert not wrong, "; ".join(wrong)


def begins_anew(loop: Loop, node: str, name: str) -> bool:
    return (node, name) in BEGINS_ANEW or (node == "reference" and (loop.lock_step or name.startswith("shaper.")))


def set_and_back(loop: Loop, node: str, found: list[tuple[str, float, float]]) -> int:
    """Set every parameter of a node that it takes, and set it back; how many there were."""
    acted = 0
    for name, (declared, value) in flatten(loop.nodes[node].config).items():
        if declared.fixed or begins_anew(loop, node, name) or not loop.set(node, **{name: another(declared, value)}):
            continue
        acted += 1
        found.append((f"{node} {name}", *peaks(loop, SEEN)))
        assert loop.set(node, **{name: list(value) or [""] if isinstance(value, tuple) else value}), name
        found.append((f"{node} {name} back", *peaks(loop, SEEN)))
    return acted


def test_no_parameter_makes_a_step(moving: Callable[..., Loop]) -> None:
    loop = moving()
    step, plain = peaks(loop, PERIODS)
    loop.set("lugre_compensator", switch3=True)
    found = [("lugre_compensator switch3", *peaks(loop, 3.0))]
    loop.set("controller", feed_back=True)
    found.append(("feed_back", *peaks(loop, 2.0)))
    _, compensated = peaks(loop, PERIODS)
    assert sum(set_and_back(loop, node, found) for node in LOOP) > 80
    assert_no_step(found, step, plain, compensated)


def changeable(kind: type[Any]) -> set[str]:
    """Names of the settings that can be changed while a node runs."""
    return {name for name, (declared, _) in flatten(kind()).items() if not declared.fixed}


@pytest.mark.parametrize("moving", ["real_time"], indirect=True)
def test_no_parameter_of_a_driver_makes_a_step_nor_does_its_life_cycle(moving: Callable[..., Loop]) -> None:
    """What CANopen drives and ros2_control add holds from the start of the node to its end."""
    assert changeable(CanopenDriveConfig) < changeable(Ros2ControlConfig)
    loop = moving(SimulatedDriver, lambda driver: driver.hardware.simulator, switch3="true")
    step, error = peaks(loop, PERIODS)
    found: list[tuple[str, float, float]] = []
    assert set_and_back(loop, "plant", found) > 8
    assert_no_step(found, step, error)
    assert_life_cycles_make_no_step(loop)


@pytest.mark.parametrize("moving", ["real_time"], indirect=True)
def test_life_cycles_make_no_step(moving: Callable[..., Loop]) -> None:
    assert_life_cycles_make_no_step(moving(switch3="true"))


def largest_applied(loop: Loop, seconds: float) -> float:
    """Largest change from tick to tick of the torque that acts, N m, while it goes on for so long.

    Where there is no torque on purpose the command is whatever it may be, and the error without a bound.
    """
    begin = len(loop.applied) - 1
    loop.run(seconds)
    return float(np.abs(np.diff(loop.applied[begin:])).max())


def assert_life_cycles_make_no_step(loop: Loop) -> None:
    """Torque comes and goes over `ramp_time`, whichever node is deactivated."""
    usual = largest_applied(loop, PERIODS)
    for node in ("plant", "controller"):
        for transition in ("deactivate", "activate"):
            before = abs(loop.applied[-1])
            getattr(loop.nodes[node], f"trigger_{transition}")()
            assert largest_applied(loop, 3.0) <= STEP * usual, f"{node}: {transition}"
            assert (before > 10.0) == (transition == "deactivate")
            assert (abs(loop.applied[-1]) > 10.0) == (transition == "activate")


def test_nothing_that_is_switched_sent_or_called_makes_a_step(moving: Callable[..., Loop]) -> None:
    loop = moving()
    step, error = peaks(loop, PERIODS)
    found = []

    def after(name: str, seconds: float = 2.0) -> None:
        found.append((name, *peaks(loop, seconds)))

    for coulomb in (60.0, 20.0, 78.1):
        loop.set("lugre_compensator", switch3=True)
        after("Switch3")
        config = changed(CompensatorConfig(), {f"{way}.coulomb": coulomb for way in ("positive", "negative")})
        loop.say("lugre_parameters", lugre_message(config, 0, "a test"))
        assert loop.nodes["lugre_compensator"].config.positive.coulomb == coulomb
        after(f"identified, {coulomb:g} N m")
    for mode in (*MODES, *reversed(MODES)):
        begin = len(loop.torques) - 1
        done = Modes(SetInLoop(loop)).set(mode, limit=1.0)
        with pytest.raises(StopIteration):  # as it waits for nobody, it is over at once
            done.send(None)
        found.append((f"set_mode {mode}", *peaks(loop, 2.0, begin)))
    loop.set("dob", switch1=True)
    loop.set("controller", feed_back=True)
    after("feed_back")
    for value in (False, True):
        loop.set("dob", switch1=value)
        after(f"Switch1 {value} under feed_back")
    for estimator in ("kalman", "dob"):
        loop.set("dob", estimator=estimator)
        after(estimator)
    assert_no_step(found, step, error)


@pytest.mark.parametrize("moving", ["real_time"], indirect=True)
def test_a_motion_begins_and_ends_as_gently_as_it_goes_on(moving: Callable[..., Loop]) -> None:
    """`~/start`, `~/stop` and other references, beside a motion that takes as much of speed and acceleration as they may.

    Half of the largest steps is friction that reverses within 0.1 s.
    """
    loop = moving()
    reference = loop.nodes["reference"]
    speed, acceleration = reference.config.speed_limit, reference.config.acceleration_limit
    motion = {"sinusoid.period": 2.0 * np.pi * speed / acceleration, "sinusoid.amplitude": 0.98 * speed**2 / acceleration}
    assert loop.set("reference", reference_file="", kind="sinusoid", **motion)
    loop.run(4.0)
    step, error = peaks(loop, 6.0)
    found = []
    for _ in range(2):
        for name, act in (("stop", reference._on_stop), ("start", reference._on_start)):
            assert act(Trigger.Request(), Trigger.Response()).success
            found.append((name, *peaks(loop, 1.7)))
    for kind in ("legs", "sinusoid", "hold", "constant_speed", "multisine"):
        assert loop.set("reference", kind=kind)
        found.append((kind, *peaks(loop, 1.7)))
    assert_no_step(found, step, error)


@pytest.mark.parametrize("gain", ["velocity_integral", "position_integral"])
def test_what_an_integrator_holds_goes_when_its_gain_is_zero(moving: Callable[..., Loop], gain: str) -> None:
    """Without compensation it holds all of the friction, more than 70 N m."""
    loop = moving(position_integral=5.0)
    step, _ = peaks(loop, 10.0)
    slots = {"velocity_integral": 2, "position_integral": 0}
    state = loop.nodes["controller"]._pid._state
    held = abs(state[slots[gain]])
    assert held > (50.0 if gain == "velocity_integral" else 1e-9)
    assert loop.set("controller", **{gain: 0.0})
    largest, _ = peaks(loop, 0.6)
    assert largest <= STEP * step
    assert state[slots[gain]] == 0.0


def test_a_controller_of_another_period_goes_on(moving: Callable[..., Loop]) -> None:
    loop = moving()
    held = loop.nodes["controller"]._pid._state.copy()
    assert loop.set("controller", period=0.004)
    assert np.array_equal(loop.nodes["controller"]._pid._state, held)
    assert loop.nodes["controller"]._pid.dt == 0.004
