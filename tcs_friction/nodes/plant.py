"""The simulated axis: takes torque, gives joint states. In real time it behaves like a driver, watchdog included."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch
from tcs_friction.nodes.base import LOCK_STEP, AxisNode, ClockConfig, control_of, derived
from tcs_friction.nodes.convert import SECOND, set_stamp
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.qos import LISTEN, PUBLISH
from tcs_friction.nodes.wire import ESTIMATE, TORQUE, JointWire
from tcs_friction.physics.simulate import Simulator

REPEAT_AFTER = 0.25  # s of wall time without a command
TEMPERATURE_EVERY = 1.0  # s


@dataclass(frozen=True)
class PlantConfig(ClockConfig):
    """Settings of the simulated axis. A new seed, position, period or axis starts it anew at time 0."""

    seed: int = setting(0, "", 0, 2**31 - 1, "seed of torque and encoder noise")
    start_position: float = setting(0.0, "rad", -1e6, 1e6, "position at time 0, at rest")
    temperature: float = setting(20.0, "degC", -100.0, 300.0, "temperature of the bearing")
    command_limit: float = setting(1e4, "N m", 0.0, 1e12, "commands beyond this are refused")
    watchdog: float = setting(0.1, "s", 1e-3, 60.0, "real time: no torque when commands stop for longer")
    run_until: float = setting(1e9, "s", 0.0, 1e9, "lock-step: simulated time at which the axis waits")
    truth: bool = switch(False, "publish the true friction on true_friction")
    dynamometer: float = setting(0.0, "1/s", 0.0, 1e4, "readings of a simulated dynamometer; 0: none is mounted")
    dynamometer_noise: float = setting(0.2, "N m", 0.0, 1e9, "RMS noise of its readings; 0.1 % of 200 N m")


def defaults(file: AxisFile) -> PlantConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    return derived(PlantConfig, control.loop, command_limit=10.0 * control.controller.torque_limit)


class Plant(AxisNode[PlantConfig]):
    """Lock-step: advances one period when the command for its stamp has come. Real time: on a timer."""

    def __init__(self) -> None:
        super().__init__("plant", defaults)
        self._states = self.create_publisher(JointState, "joint_states", PUBLISH)
        self._truths = self.create_publisher(FrictionEstimate, "true_friction", PUBLISH)
        self._temperatures = self.create_publisher(Temperature, "temperature", PUBLISH)
        self._wrenches = self.create_publisher(WrenchStamped, "dynamometer", PUBLISH)
        self._made: tuple[object, ...] = ()
        self._timer = None
        self._command: float | None = None
        self._commanded = 0.0  # wall time of the last good command
        self.start()
        self.create_subscription(AxisTorque, "torque_command", self._on_command, LISTEN, raw=True)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_timer(REPEAT_AFTER, self._repeat)

    hears = "torque_command"

    def check(self, config: PlantConfig, file: AxisFile) -> None:
        self._make(config, file)

    def configure(self, config: PlantConfig) -> None:
        super().configure(config)
        self._until = round(config.run_until * SECOND)
        self._temperature_ticks = max(1, round(TEMPERATURE_EVERY / config.period))
        self._reading_ticks = max(1, round(1.0 / (config.dynamometer * config.period))) if config.dynamometer else 0
        identity = (self.file, config.seed, config.start_position, config.period, config.clock)
        if identity != self._made:
            self._made = identity
            self._restart()
            if self._timer is not None:
                self.destroy_timer(self._timer)
            real = config.clock != LOCK_STEP
            self._timer = self.create_timer(config.period, self._on_timer) if real else None
        elif self._command is not None and config.clock == LOCK_STEP:
            self._go_on()  # it may have been waiting at the old run_until

    def missing(self) -> str:
        if self._command is not None:
            return ""
        return f"acceptable torque_command for {self._stamp / SECOND:.6f} s{self._refusal}"

    def _make(self, config: PlantConfig, file: AxisFile) -> Simulator:
        signals = tuple(item.signal for item in file.axis.effects if item.signal is not None)
        return Simulator(file.axis, config.period, config.seed, config.start_position, signals)

    def _restart(self) -> None:
        self._simulator = self._make(self.config, self.file)
        self._wire = JointWire(self.file.axis.name)
        self._reading_noise = np.random.default_rng((self.config.seed, 1))
        self._index = self._stamp = 0
        self._applied = 0.0
        self._command = None
        self._refusal = ""
        self._publish(0)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Back to rest at the start position, time 0, the same noise."""
        self._restart()
        response.success = True
        return response

    def _on_command(self, data: bytes) -> None:
        stamp, (torque,) = TORQUE.read(data)
        lock_step = self.config.clock == LOCK_STEP
        if lock_step and stamp != self._stamp:
            return  # an answer to a repeated state that had been answered already
        if not -self.config.command_limit <= torque <= self.config.command_limit:
            self._refusal = f" ({torque:g} N m was refused, the limit is {self.config.command_limit:g})"
            self.health.refuse(f"torque_command{self._refusal}")
            return
        self._refusal = ""
        self._command = torque
        if lock_step:
            self._go_on()
        else:
            self._commanded = time.monotonic()

    def _go_on(self) -> None:
        """Lock-step: advance unless the end of the run is reached."""
        if self._stamp >= self._until or self._command is None:
            return
        command, self._command = self._command, None
        self._advance(command)
        self._stamp = round(self._index * self.config.period * SECOND)
        self._publish(self._stamp)

    def _on_timer(self) -> None:
        """Real time: one period under the latest command, or under none when that is too old."""
        now = time.monotonic()
        silent = self._command is None or now - self._commanded > self.config.watchdog
        if self.health.last_tick and now - self.health.last_tick > 2.0 * self.config.period:
            self.health.overruns += 1
        self._advance(0.0 if silent or self._command is None else self._command)
        self.health.last_tick = now
        if silent:
            self.health.warning = f"no torque_command for {self.config.watchdog:g} s: holding zero torque"
        self._publish(self.get_clock().now().nanoseconds)

    def _advance(self, torque: float) -> None:
        self._applied = self._simulator.step(torque, self.config.temperature)
        self._index += 1
        self.health.ticks += 1

    def _publish(self, stamp: int) -> None:
        simulator = self._simulator
        self._state = self._wire.write(
            stamp, simulator.measured_position, simulator.measured_velocity, self._applied
        )
        self._states.publish(self._state)
        if self.config.truth:
            truth = (simulator.friction, simulator.velocity, simulator.opposing, True)
            self._truths.publish(ESTIMATE.write(stamp, *truth))
        if self._reading_ticks and self._index % self._reading_ticks == 0:
            self._publish_reading(stamp)
        if self._index % self._temperature_ticks == 0:
            temperature = Temperature(temperature=self.config.temperature)
            set_stamp(temperature, stamp)
            self._temperatures.publish(temperature)

    def _publish_reading(self, stamp: int) -> None:
        """What a dynamometer would show that measures all that opposes the motion."""
        noise = self.config.dynamometer_noise * float(self._reading_noise.standard_normal())
        opposing = self._simulator.friction + self._simulator.opposing + noise
        message = WrenchStamped()
        set_stamp(message, stamp)
        if self.file.axis.kind == "rotary":
            message.wrench.torque.z = opposing
        else:
            message.wrench.force.x = opposing
        self._wrenches.publish(message)

    _repeated = -1

    def _repeat(self) -> None:
        """Lock-step: say again what nobody has answered, for a message may be lost and a node may have started late."""
        if self.config.clock != LOCK_STEP or self._command is not None:
            return
        if self._repeated == self._stamp:
            self.health.repeats += 1
            self._states.publish(self._state)
        self._repeated = self._stamp


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Plant, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
