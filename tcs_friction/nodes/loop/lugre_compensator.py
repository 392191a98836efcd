"""The feed-forward: answers every reference with the torque that the LuGre model, or all of an axis model, wants for it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial

from sensor_msgs.msg import Temperature
from tcs_friction_msgs.msg import AxisReference, AxisTorque, LugreParameters

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.compensator import CompensatorConfig, LugreCompensator
from tcs_friction.control.config_field import setting, switch
from tcs_friction.control.fading import Ramp
from tcs_friction.control.handover import Handover
from tcs_friction.control.model_compensator import (
    ROOM,
    CancellationConfig,
    ModelCompensator,
    check_names,
    check_torque,
    signals_of,
)
from tcs_friction.control.plausible import Ranges, compensation_limit, ranges
from tcs_friction.control.stamps import NEW_RUN, NEXT, REFUSED, REPEATED, FollowRule, Step
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived
from tcs_friction.nodes.core.convert import SECOND, friction_of, nanoseconds
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.qos import LATCHED, LISTEN
from tcs_friction.nodes.core.wire import REFERENCE, TORQUE, message_of
from tcs_friction.nodes.loop.live_signals import LiveSignals
from tcs_friction.nodes.loop.model import ModelConfig, ModelFile
from tcs_friction.physics.axis import Axis

HOTTEST, COLDEST = 300.0, -100.0  # degC, of a bearing


@dataclass(frozen=True)
class CompensatorNodeConfig(CompensatorConfig, CancellationConfig, ModelConfig, Ranges, ClockConfig):
    """Both directions' parameters, the model that takes their place, and Switch3 of the paper."""

    switch3: bool = switch(False, "Switch3: the compensation reaches the controller")
    ramp_time: float = setting(
        2.0, "s", 0.0, 60.0, "the compensation comes and goes with Switch3 over this time, at which a moving axis hardly feels it"
    )
    temperature_age: float = setting(60.0, "s", 0.1, 1e5, "real time: what an older temperature changes is not cancelled")
    signal_age: float = setting(1.0, "s", 0.001, 1e5, "real time: what an older signal of the model causes is not cancelled")


def defaults(file: AxisFile) -> CompensatorNodeConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    pid = control.controller
    limit = compensation_limit(file.axis, pid)
    return derived(CompensatorNodeConfig, control.loop, control.compensator, ranges(file.axis, pid), total_limit=limit)


class LugreCompensatorNode(AxisNode[CompensatorNodeConfig]):
    """While Switch3 is off the torque published is 0; the bristle starts at rest when it is switched on."""

    def __init__(self) -> None:
        self._models = ModelFile()
        self._model: ModelCompensator | None = None
        super().__init__("lugre_compensator", defaults)
        self._publisher = self.create_publisher(AxisTorque, "friction_compensation", self.publish_profile)
        self._message = b""
        self._identified = 0  # ns, stamp of the parameters taken last
        self._stamp = -1
        self._lugre = LugreCompensator(self.config, self.config.period)
        self._source = Handover(partial(_lugre_torque, self._lugre), self._lugre.reset)
        self._temperature, self._measured = ROOM, -1.0  # degC, and steady time of the last one
        self._early = b""  # lock-step: the reference that waits for its surroundings
        self._complete = False  # lock-step: all that the model needs has come once
        self._signals = LiveSignals(self, self.health, self._on_surroundings)
        self._rule = FollowRule(self.lock_step)
        self._ramp = Ramp(self.config.ramp_time)
        if not self.lock_step:
            self.health.expect("reference")
        self.start()
        self.create_subscription(AxisReference, "reference", self._on_reference, LISTEN, raw=True)
        self.create_subscription(LugreParameters, "lugre_parameters", self._on_parameters, LATCHED, raw=True)
        self.create_subscription(Temperature, "temperature", self._on_temperature, LISTEN)

    def configure(self, config: CompensatorNodeConfig) -> None:
        super().configure(config)
        self._use_lugre(config)
        self._use(self._models.use(config), config)
        coulomb = f"{config.positive.coulomb:g} and {config.negative.coulomb:g} N m"
        left_out = f" without {', '.join(config.left_out)}" if config.left_out else ""
        acts = f"model {config.model}{left_out}" if config.model else f"LuGre friction, Coulomb {coulomb}"
        self.health.values["compensates"] = acts
        self._limits = config.reference_limits(self.file.axis.inertia)
        self._ramp.duration = config.ramp_time
        self._rule.configure(config.age_limit, config.patience, period=config.period)

    def _use_lugre(self, config: CompensatorNodeConfig) -> None:
        """Other friction parameters: what acts hands over to what goes on from its state, unless nothing has acted so far."""
        before = self._lugre
        if self._stamp < 0 or (_friction(config), config.period) == (_friction(before.config), before.dt):
            before.configure(config, config.period)
            return
        self._lugre = before.continued(config, config.period)
        if self._model is None:
            self._source.replace(partial(_lugre_torque, self._lugre), self._lugre.reset, config.entry_time / config.period)

    def _use(self, axis: Axis | None, config: CompensatorNodeConfig) -> None:
        """Cancel another model's effects, or the same one's with other switches or limits: torque never comes in a step."""
        before = self._model
        if axis is None:
            self._model = None
        elif before is not None and self._runs(axis, config):
            if _limits(config) == _limits(before.config):
                before.configure(config)
            else:
                self._model = before.continued(config)
        else:
            self._model = ModelCompensator(axis, config.period, config, signals_of(axis))
        self._signals.follow({name: self._models.signals[name] for name in self._asked() if name in self._models.signals})
        if self._model is not before:
            self._complete = False
            ticks = config.entry_time / config.period
            if self._model is None:
                self._lugre.reset()
                self._source.replace(partial(_lugre_torque, self._lugre), self._lugre.reset, ticks)
            else:
                self._source.replace(partial(_torque_of, self._model, self._signals), self._model.reset, ticks)
            if self._stamp < 0:
                self._source.reset()  # nothing has been compensated so far
        self._judge_surroundings()

    def _runs(self, axis: Axis, config: CompensatorNodeConfig) -> bool:
        """Whether the model in use is of this axis at this period."""
        return self._model is not None and self._model.model is axis and self._model.dt == config.period

    def check(self, config: CompensatorNodeConfig, file: AxisFile) -> None:
        axis, limits = self._models.read(config, file), config.limits()
        if axis is None and limits:
            raise InputError("effect_limits", f"of {', '.join(limits)} without a model", "parameter model")
        if axis is not None:
            check_names(axis, limits, "effect_limits")
        if axis is not None and not (self._runs(axis, config) and file is self.file):
            limit = min(file.axis.drive.limit, control_of(file).controller.torque_limit)
            check_torque(ModelCompensator(axis, config.period, signals=signals_of(axis)).largest(), axis, limit)
        for way in ("positive", "negative"):
            friction = getattr(config, way)
            objection = config.torque_objection(max(friction.coulomb, friction.static))
            if objection:
                raise InputError(f"{self.get_name()}: {way}", objection)

    hears = "reference"

    def _on_reference(self, data: bytes) -> None:
        stamp, numbers = REFERENCE.read(data)
        (position, speed, acceleration), (farthest, fastest, most) = numbers, self._limits
        if not (-farthest <= position <= farthest and -fastest <= speed <= fastest and -most <= acceleration <= most):
            self.health.refuse(f"reference refused: {self.config.reference_objection(self.file.axis.inertia, *numbers)}")
            return
        if self.lock_step and not self._complete:
            self._complete = not self._awaited()
            if not self._complete:
                self._early = data
                return
        step = self._rule.judge(stamp) if self.lock_step else self._judge_in_real_time(stamp)
        if step is REFUSED:
            return
        if step is REPEATED:
            if self.lock_step:
                self.health.repeats += 1
                self._publisher.publish(self._message)
            return
        self._message = TORQUE.write(stamp, self._torque(stamp, step, numbers))
        self._stamp = self.health.stamp = stamp
        self.health.ticks += 1
        self._publisher.publish(self._message)

    def _judge_in_real_time(self, stamp: int) -> Step:
        now = time.monotonic()
        step = self._rule.judge(stamp, 0.0, now)
        if step is REFUSED and self._rule.reason:
            self.health.disbelieve("reference", self._rule.reason)
            if self._stamp >= 0:
                self.health.refuse(f"reference refused: {self._rule.reason}")
        elif step is NEXT or step is NEW_RUN:
            self.health.heard("reference", now, self.config.period)
        return step

    def _torque(self, stamp: int, step: Step, reference: tuple[float, ...]) -> float:
        """The compensation, 0 while Switch3 is off; it comes and goes over `ramp_time`, in lock-step not where a run begins."""
        share = self._ramp.value
        if share != self.config.switch3:
            share = self._faded(stamp, step)
        if step is NEW_RUN or not share:
            self._source.reset()
        if not share:
            return 0.0
        torque = share * self._source.step(stamp / SECOND, *reference, self._temperature)
        limit = self.config.largest_torque
        if -limit <= torque <= limit:
            return torque
        self._source.reset()
        self.health.note(f"compensation reset: {self.config.torque_objection(torque)}")
        return 0.0

    def _faded(self, stamp: int, step: Step) -> float:
        """What of the compensation acts while it comes or goes."""
        begins = step is NEW_RUN or self._stamp < 0
        if self.lock_step and begins:
            self._ramp.value = float(self.config.switch3)
        late = begins or (not self.lock_step and stamp - self._stamp > self.config.age_limit * SECOND)
        return self._ramp.toward(self.config.switch3, 0.0 if late else (stamp - self._stamp) / SECOND)

    # Surroundings

    def missing(self) -> str:
        return " and ".join(self._awaited()) if self._early else ""

    def _asked(self) -> list[str]:
        """What the model's effects need to have measured: "temperature" and names of signals."""
        needs = self._model.needs.values() if self._model is not None else ()
        return list(dict.fromkeys(what for some in needs for what in some))

    def _awaited(self) -> list[str]:
        """Lock-step: what the model needs, has a topic and has yet to come, so that a run begins the same every time."""
        return [
            what
            for what in self._asked()
            if (self._measured < 0.0 if what == "temperature" else self._signals.named(what) and not self._signals.heard(what))
        ]

    def _on_temperature(self, message: Temperature) -> None:
        if not COLDEST <= message.temperature <= HOTTEST:
            self.health.refuse(f"temperature refused: {message.temperature:g} degC, expected {COLDEST:g} to {HOTTEST:g}")
            return
        self._temperature, self._measured = message.temperature, time.monotonic()
        self._on_surroundings()

    def _on_surroundings(self) -> None:
        self._judge_surroundings()
        if self._early:
            early, self._early = self._early, b""
            self._on_reference(early)

    def _judge_surroundings(self) -> None:
        """Take out what depends on a temperature or a signal that is too old or never came, and report it."""
        if self._model is None:
            self.health.well("surroundings")
            return
        missing = {
            name: [what for what in some if not self._fresh(what)] for name, some in self._model.needs.items()
        }
        missing = {name: some for name, some in missing.items() if some}
        self._model.without(missing)
        self.health.well("surroundings")
        if missing:
            words = ", ".join(f"{name} (no {' and '.join(some)})" for name, some in missing.items())
            self.health.doubt("surroundings", f"not cancelled: {words}")

    def _fresh(self, what: str) -> bool:
        """Whether a temperature or a signal is there and young enough; in lock-step it is enough that it has come."""
        if what != "temperature":
            return self._signals.heard(what, math.inf if self.lock_step else self.config.signal_age)
        if self.lock_step:
            return True
        return self._measured >= 0.0 and time.monotonic() - self._measured <= self.config.temperature_age

    def _watch(self, now: float) -> None:
        self._signals.look()
        self._judge_surroundings()
        super()._watch(now)

    def _on_parameters(self, data: bytes) -> None:
        """Identified parameters become this node's parameters, all of them or none."""
        message = message_of(data, LugreParameters)
        if message is None:
            self.health.refuse("lugre_parameters refused: not readable")
            return
        stamp = nanoseconds(message.header.stamp)
        if 0 < stamp < self._identified:
            return  # latched by another publisher, and replaced since
        self._identified = stamp
        values = friction_of(message)
        result = self.replace_given(values)
        if result.successful:
            unused = " but not used: parameter model is set" if self._model is not None else ""
            self.get_logger().info(f"LuGre parameters taken from {message.source or 'lugre_parameters'}{unused}")
        else:
            self.health.refuse(f"lugre_parameters refused: {result.reason}")
            self.get_logger().warning(f"lugre_parameters refused: {result.reason}")


def _friction(config: CompensatorConfig) -> tuple[object, ...]:
    return tuple(getattr(config, entry.name) for entry in fields(CompensatorConfig))


def _lugre_torque(lugre: LugreCompensator, _: float, __: float, speed: float, acceleration: float, ___: float) -> float:
    """LuGre's torque for a reference."""
    return lugre.step(speed, acceleration)


def _limits(config: CancellationConfig) -> tuple[object, ...]:
    return config.total_limit, config.effect_limit, config.effect_limits, config.share, config.rest_speed, config.rest_torque


def _torque_of(
    model: ModelCompensator, live: LiveSignals, t: float, q: float, v: float, a: float, temperature: float
) -> float:
    """A model's torque with the signals as they are now."""
    return model.step(t, q, v, a, temperature, live.values(model.signals))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(LugreCompensatorNode, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
