"""The simulated axis: takes torque, gives joint states. In real time it behaves like a driver, watchdog included.

In real time the simulation follows the steady clock: what is late is caught up under the torque that would have acted
meanwhile, and stamps are simulated time since the start, so that position, speed and stamps always agree. A step of ROS
time changes nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisTorque, FrictionEstimate

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting, switch, texts
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.control.stamps import AnswerRule, RecentStates
from tcs_friction.control.torque_gate import Situation, TorqueGate, TorqueLimits
from tcs_friction.nodes.core.base import derived
from tcs_friction.nodes.core.convert import SECOND, set_stamp
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.managed import ManagedConfig, ManagedNode
from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.core.rivals import Rivals
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.core.wire import ESTIMATE, TORQUE, JointWire, Numbers
from tcs_friction.nodes.loop.gate import LimitsPublisher, say, torque_limits
from tcs_friction.nodes.loop.surroundings import Surroundings
from tcs_friction.physics.simulate import Simulator

COMMAND = "torque_command"
REPEAT_AFTER = 0.25  # s of steady time without a command
CATCH_UP = 2.0  # s of simulated time that are caught up at once
TEMPERATURE_EVERY = 1.0  # s


@dataclass(frozen=True)
class PlantConfig(TorqueLimits, ManagedConfig):
    """Settings of the simulated axis. A new seed, position, period or axis starts it anew at time 0."""

    seed: int = setting(0, "", 0, 2**31 - 1, "seed of torque and encoder noise")
    start_position: float = setting(0.0, "rad", -1e6, 1e6, "position at time 0, at rest")
    temperature: float = setting(20.0, "degC", -100.0, 300.0, "temperature of the bearing")
    run_until: float = setting(1e9, "s", 0.0, 1e9, "lock-step: simulated time at which the axis waits")
    truth: bool = switch(False, "publish the true friction on true_friction")
    dynamometer: float = setting(0.0, "1/s", 0.0, 1e4, "readings of a simulated dynamometer; 0: none is mounted")
    beside: tuple[str, ...] = texts("namespaces of other simulated axes: may act on it, in lock-step in one time", fixed=True)
    dynamometer_noise: float = setting(0.2, "N m", 0.0, 1e9, "RMS noise of its readings; 0.1 % of 200 N m")


def defaults(file: AxisFile) -> PlantConfig:
    """The settings that an axis file implies."""
    return derived(PlantConfig, control_of(file).loop, torque_limits(file))


class Plant(ManagedNode[PlantConfig]):
    """Lock-step: advances one period when the command for its stamp has come. Real time: on a timer."""

    def __init__(self, implied: Callable[[AxisFile], PlantConfig] | None = None) -> None:
        super().__init__("plant", implied or defaults)
        self._states = self.create_publisher(JointState, "joint_states", self.publish_profile)
        self._truths = self.create_publisher(FrictionEstimate, "true_friction", self.publish_profile)
        self._temperatures = self.create_publisher(Temperature, "temperature", self.publish_profile)
        self._wrenches = self.create_publisher(WrenchStamped, "dynamometer", self.publish_profile)
        self._timer = None
        self._command: float | None = None  # lock-step: of the stamp
        self._recent = RecentStates(self.config.age_limit)
        self._answers = AnswerRule(self._recent)
        self._gate = TorqueGate(self.config, self.config.ramp_time)
        self._limits = LimitsPublisher(self)
        if not self.lock_step:
            self.health.expect(COMMAND, Level.WARN)
        self._surroundings = Surroundings(self, self.health, self.config.beside, self._join, self._go_on)
        self.start()
        self.create_subscription(AxisTorque, "torque_command", self._on_command, LISTEN, raw=True)
        self.create_service(Trigger, "~/reset", self._on_reset)
        steady_timer(self, REPEAT_AFTER, self._repeat)
        self.rivals = Rivals(self, {COMMAND: self._answers}, exclusive={COMMAND})

    hears = COMMAND
    _made: tuple[object, ...] = ()

    def check(self, config: PlantConfig, file: AxisFile) -> None:
        if self._identity(config, file) != self._made:
            self._make(config, file)

    def configure(self, config: PlantConfig) -> None:
        super().configure(config)
        self._recent.configure(config.age_limit)
        self._gate.configure(config, config.ramp_time)
        self._limits.tell(self.file.axis.name, config)
        self._until = round(config.run_until * SECOND)
        self._temperature_ticks = max(1, round(TEMPERATURE_EVERY / config.period))
        self._reading_ticks = max(1, round(1.0 / (config.dynamometer * config.period))) if config.dynamometer else 0
        identity = self._identity(config, self.file)
        if identity != self._made:
            self._made = identity
            self._restart()
            if self._timer is not None:
                self.destroy_timer(self._timer)
            self._timer = None if self.lock_step else steady_timer(self, config.period, self._on_timer)
        elif self._command is not None and self.lock_step:
            self._go_on()  # it may have been waiting at the old run_until

    def missing(self) -> str:
        if not self.active:
            return ""
        if self._command is not None:
            return self._surroundings.missing(self._stamp)
        return f"acceptable torque_command for {self._stamp / SECOND:.6f} s{self._refusal}"

    def waits(self) -> str:
        reached = self.lock_step and self._stamp >= self._until
        if not reached and self.lock_step and self._command is not None:
            return self._surroundings.waits(self._stamp)
        return f"run_until ({self.config.run_until:g} s) is reached, it can be set later" if reached else ""

    def _identity(self, config: PlantConfig, file: AxisFile) -> tuple[object, ...]:
        """What a simulator is made of: when it changes, the axis begins anew."""
        return file, config.seed, config.start_position, config.period, config.clock

    def _others(self) -> tuple[tuple[str, ...], Callable[[], tuple[Numbers, Numbers]]]:
        """Joints that are published beside the axis, and what tells their positions and speeds. For subclasses."""
        return (), lambda: ((), ())

    def _make(self, config: PlantConfig, file: AxisFile) -> Simulator:
        return Simulator(file.axis, config.period, config.seed, config.start_position, signals_of(file.axis))

    def _restart(self) -> None:
        """From rest at the start position; in lock-step the axes beside begin anew as well."""
        self._surroundings.begin()
        self._begin_run()

    def _join(self) -> None:
        """An axis beside has begun a new run."""
        if self.lock_step:
            self._begin_run()

    def _begin_run(self) -> None:
        self._surroundings.follow(self.file)
        self._simulator = self._make(self.config, self.file)
        others, self._beside = self._others()
        self._wire = JointWire(self.file.axis.name, others)
        self._reading_noise = np.random.default_rng((self.config.seed, 1))
        self._index = self._stamp = 0
        self._applied = 0.0
        self._command = None
        self._refusal = ""
        self._began = time.monotonic()
        self._origin = 0 if self.lock_step else self.get_clock().now().nanoseconds
        self._gate.restart()
        self._publish(self._origin)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Back to rest at the start position, time 0, the same noise."""
        self._restart()
        response.success = True
        return response

    def state_changed(self) -> None:
        if self.active:
            self._command = None
            self._gate.forget()

    def _on_command(self, data: bytes) -> None:
        stamp, numbers = TORQUE.read(data)
        if not (self.active or self._gate.share) or (self.lock_step and stamp != self._stamp):
            return  # in lock-step, an answer to a repeated state that had been answered already
        torque, now = numbers[0], time.monotonic()
        objection = self._gate.objection(torque) or ("" if self.lock_step else self._answers.objection(stamp, numbers, now))
        if objection:
            self._refusal = f" ({objection})"
            self.health.refuse(f"{COMMAND}{self._refusal}")
            return
        self._refusal = ""
        if self.lock_step:
            self._command = torque
            self._go_on()
        else:
            self._gate.command(torque, now)
            self.health.heard(COMMAND, now)

    def _go_on(self) -> None:
        """Lock-step: advance unless the end of the run is reached, or an axis beside has not come as far."""
        if not self.lock_step or self._stamp >= self._until or self._command is None:
            return
        if self._surroundings.behind(self._stamp):
            return
        command, self._command = self._command, None
        self._advance(command)
        self._publish(round(self._index * self.config.period * SECOND))

    def _on_timer(self) -> None:
        """Real time: all the periods that are over, under the torque that acted in each of them."""
        now, period = time.monotonic(), self.config.period
        if not (self.configured or self._gate.share):
            self._began = now - self._index * period
            return
        due = math.floor((now - self._began) / period)
        if due == self._index:
            return
        if due - self._index > round(CATCH_UP / period):
            late = now - self._began - self._index * period
            self.health.note(f"the simulation stood still for {late:.3g} s and is late by that: this run is void")
            self._began += late - CATCH_UP
            due = self._index + round(CATCH_UP / period)
        elif due - self._index > 2:
            self.health.overruns += 1
        while self._index < due:
            self._advance(self._torque_at(self._began + self._index * period))
            self._stamp = self._origin + round(self._index * period * SECOND)
            self._publish_others(self._stamp)
        self._publish_state(self._stamp)

    def _torque_at(self, moment: float) -> float:
        """What acts in the period that begins at a steady time."""
        simulator, rivals = self._simulator, f"two publishers of {COMMAND}" if self.rivals.topics else ""
        motion = (simulator.measured_position, simulator.measured_velocity, moment)
        verdict = self._gate.at(Situation(moment, *motion, self.active, rivals), self.config.period)
        say(verdict, self.health)
        return verdict.torque

    def _advance(self, torque: float) -> None:
        around = self._surroundings.at(self._stamp) if self.lock_step else self._surroundings.now(self.config.age_limit)
        self._applied = self._simulator.step(torque, self.config.temperature, *around)
        self._index += 1
        self.health.ticks += 1

    def _publish(self, stamp: int) -> None:
        self._stamp = stamp
        self._publish_state(stamp)
        self._publish_others(stamp)

    def _publish_state(self, stamp: int) -> None:
        simulator = self._simulator
        self._state = self._wire.write(
            stamp, simulator.measured_position, simulator.measured_velocity, self._applied, *self._beside()
        )
        if not self.lock_step:
            self._recent.add(stamp)
        self._states.publish(self._state)
        self._surroundings.say(stamp, simulator.position, simulator.velocity, self._applied)
        if self.config.truth:
            truth = (simulator.friction, simulator.velocity, simulator.opposing, True)
            self._truths.publish(ESTIMATE.write(stamp, *truth))

    def _publish_others(self, stamp: int) -> None:
        """What comes at a rate of its own."""
        if self._reading_ticks and self._index % self._reading_ticks == 0:
            self._publish_reading(stamp)
        if self._index % self._temperature_ticks == 0:
            self._publish_temperature(stamp)

    def _publish_temperature(self, stamp: int) -> None:
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

    def _watch(self, now: float) -> None:
        self._surroundings.judge()
        super()._watch(now)

    _repeated = -1

    def _repeat(self) -> None:
        """Lock-step: say again what nobody has answered, for a message may be lost and a node may have started late."""
        if not self.lock_step or self._command is not None:
            return
        if self._repeated == self._stamp:
            self.health.repeats += 1
            self._states.publish(self._state)
            self._publish_temperature(self._stamp)
        self._repeated = self._stamp


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Plant, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
