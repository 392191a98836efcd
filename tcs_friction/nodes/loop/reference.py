"""Where the axis should be: answers every joint state with the reference for its stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisReference

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control import reference as core
from tcs_friction.control.config_field import choice, switch, text
from tcs_friction.control.joining import JoinedReference, Phase, check_programme, extent
from tcs_friction.control.plausible import MotionLimits, Ranges, motion_limits, ranges
from tcs_friction.control.shaper import Shaper
from tcs_friction.control.stamps import NEW_RUN, REFUSED, REPEATED, Step
from tcs_friction.control.turns import Travel
from tcs_friction.errors import TcsError
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived
from tcs_friction.nodes.core.convert import SECOND
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import reference_file
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.qos import LISTEN
from tcs_friction.nodes.core.wire import REFERENCE
from tcs_friction.nodes.loop.gate import torque_limits


@dataclass(frozen=True)
class ReferenceConfig(Travel, MotionLimits, Ranges, ClockConfig):
    """Which reference, and how it may move the axis.

    While it is set, `reference_file` wins over `kind`; so does a shaper in that file over `shaper`.
    """

    reference_file: str = text("", "reference file, a path or a name in the package's config folder; empty for `kind`")
    begin_at_once: bool = switch(
        False, "real time: begin when the axis is heard; else by ~/start or by setting the reference", fixed=True
    )
    kind: str = choice("sinusoid", tuple(core.KINDS), "which of the references below")
    hold: core.Hold = field(default_factory=core.Hold)
    constant_speed: core.ConstantSpeed = field(default_factory=core.ConstantSpeed)
    sinusoid: core.Sinusoid = field(default_factory=core.Sinusoid)
    multisine: core.Multisine = field(default_factory=core.Multisine)
    swept_sine: core.SweptSine = field(default_factory=core.SweptSine)
    steps: core.Steps = field(default_factory=core.Steps)
    legs: core.Legs = field(default_factory=core.Legs)
    satellite_pass: core.SatellitePass = field(default_factory=core.SatellitePass)
    sidereal_track: core.SiderealTrack = field(default_factory=core.SiderealTrack)
    shaper: Shaper = field(default_factory=Shaper)


def chosen(config: ReferenceConfig) -> core.Reference:
    """The reference that a configuration means; raises InputError when that cannot be."""
    if config.reference_file:
        return reference_file(config.reference_file).shaped_unless(config.shaper)
    return core.Reference(getattr(config, config.kind), config.shaper)


def defaults(file: AxisFile) -> ReferenceConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    pid = control.controller
    return derived(ReferenceConfig, control.loop, ranges(file.axis, pid), motion_limits(file.axis, pid), torque_limits(file))


def programme_of(config: ReferenceConfig) -> tuple[object, ...]:
    """What makes two configurations mean the same reference."""
    if config.reference_file:
        return config.reference_file, config.shaper
    return config.kind, getattr(config, config.kind), config.shaper


class ReferenceNode(AxisNode[ReferenceConfig]):
    """In lock-step the reference's time is that of the stamps.

    In real time the reference rests where the axis is. A programme begins on the service ~/start, and when a parameter that
    says which reference is set, but not with another axis file; ~/stop brings it to rest.
    """

    def __init__(self) -> None:
        super().__init__("reference", defaults)
        self._publisher = self.create_publisher(AxisReference, "reference", self.publish_profile)
        self._message = b""
        self._state = JointInput(self.health, self.lock_step)
        self._joined = JoinedReference(self.config)
        self._origin = 0  # ns, time 0 of `_joined`
        self._waiting = self.config.begin_at_once  # to begin as soon as the axis is heard
        self.start()
        self.hear_driver(self._on_state, LISTEN)
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)

    def check(self, config: ReferenceConfig, file: AxisFile) -> None:  # noqa: ARG002
        wanted = self._chosen = chosen(config)
        if not self.lock_step:
            check_programme(wanted, config)
            if programme_of(config) != programme_of(self.config):  # one that nobody asked for may begin nowhere
                self._shift(wanted, config, wanted.at(0.0)[0])

    def configure(self, config: ReferenceConfig) -> None:
        before = self.config
        super().configure(config)
        self._reference = self._chosen
        self._state.configure(self.file.axis.name, config)
        self._period_ns = config.period * SECOND
        self._joined.limits = config
        other = programme_of(config) != programme_of(before) and "axis" not in self.changing
        if not self.lock_step and (other or "reference_file" in self.changing):
            self._begin()

    # Real time: begin and stop

    def _begin(self) -> str:
        """Join the programme, now or when the axis is heard; returns what will happen."""
        self._waiting = self._state.stamp < 0
        if self._waiting:
            return "begins when the axis is heard"
        try:
            now = self._seconds()
            shift = self._shift(self._reference, self.config, self._joined.at(now)[0])
            seconds = self._joined.join(now, self._reference, shift)
        except TcsError as error:
            self.health.note(str(error))
            return str(error)
        return f"joins its programme in {seconds:.3f} s"

    def _shift(self, programme: core.Reference, config: ReferenceConfig, here: float) -> float:
        """What the positions of a programme (rad) are turned by, of a continuous axis that is `here`."""
        lowest, highest = extent(programme)
        return config.shift(lowest, highest, programme.at(0.0)[0], here, config.continuous)

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin the programme anew."""
        if self.lock_step:
            response.message = "in lock-step the reference has the time of the plant's stamps: use plant/reset"
            return response
        response.message = self._begin()
        response.success = self._joined.phase is Phase.JOINING or self._waiting
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Come to rest."""
        if self.lock_step:
            response.message = "in lock-step the plant stops: set its run_until"
            return response
        self._waiting, response.success = False, True
        seconds = self._joined.stop(self._seconds()) if self._state.stamp >= 0 else 0.0
        response.message = f"at rest in {seconds:.3f} s"
        return response

    # Answers

    def _on_state(self, data: bytes) -> None:
        before = self._state.stamp
        step = self._state.take(data)
        stamp = self._state.stamp
        if step is REFUSED or (step is REPEATED and not self.lock_step):
            return
        if step is REPEATED:
            self.health.repeats += 1
        else:
            at = self._reference.at(self._lock_step_time(stamp)) if self.lock_step else self._safe(before, stamp, step)
            self._message = REFERENCE.write(stamp, *at)
            self.health.ticks += 1
        self._publisher.publish(self._message)

    def _lock_step_time(self, stamp: int) -> float:
        """Seconds of the reference: a whole number of periods, as in the offline loop, to the last bit."""
        return self.config.period * round(stamp / self._period_ns)

    def _seconds(self) -> float:
        """Seconds of the newest state."""
        return (self._state.stamp - self._origin) / SECOND

    def _safe(self, before: int, stamp: int, step: Step) -> tuple[float, float, float]:
        """Real time: the reference, begun anew where the axis is when it has lost the axis."""
        state, joined = self._state, self._joined
        if step is NEW_RUN:
            self._origin = stamp
            joined.begin_at(0.0, state.position, state.speed)
            if self._waiting:
                self._begin()
        elif stamp - before > self.config.age_limit * SECOND:
            self._give_up(f"no joint_states for {(stamp - before) / SECOND:.3g} s")
        at = joined.at(self._seconds())
        away = abs(at[0] - state.position)
        if away > self.config.following_limit:
            self._give_up(f"the axis was {away:.4g} away, following_limit is {self.config.following_limit:.4g}")
            at = joined.at(self._seconds())
        self.health.values["phase"] = joined.phase.value
        return at

    def _give_up(self, reason: str) -> None:
        """Begin anew where the axis is, and rest."""
        phase = self._joined.phase.value
        self._joined.begin_at(self._seconds(), self._state.position, self._state.speed)
        self.health.note(f"reference given up while {phase}: {reason}; it rests where the axis is")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ReferenceNode, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
