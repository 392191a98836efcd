"""Where the axis should be: answers every joint state with the reference for its stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sensor_msgs.msg import JointState
from tcs_friction_msgs.msg import AxisReference

from tcs_friction.config import AxisFile
from tcs_friction.control import reference as core
from tcs_friction.control.config_field import choice, text
from tcs_friction.nodes.base import LOCK_STEP, AxisNode, ClockConfig, config_file, control_of, derived
from tcs_friction.nodes.convert import SECOND
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.qos import LISTEN, PUBLISH
from tcs_friction.nodes.wire import REFERENCE, JointWire


@dataclass(frozen=True)
class ReferenceConfig(ClockConfig):
    """Which reference; `reference_file` wins over `kind` while it is set."""

    reference_file: str = text("", "reference file, a path or a name in the package's config folder; empty for `kind`")
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


def chosen(config: ReferenceConfig) -> core.Reference:
    """The reference that a configuration means; raises InputError when that cannot be."""
    if config.reference_file:
        return core.load_reference(Path(config_file(config.reference_file)))
    return core.Reference(getattr(config, config.kind))


def defaults(file: AxisFile) -> ReferenceConfig:
    """The settings that an axis file implies."""
    return derived(ReferenceConfig, control_of(file).loop)


class ReferenceNode(AxisNode[ReferenceConfig]):
    """In lock-step the reference's time is that of the stamps; in real time it starts with the first joint state."""

    def __init__(self) -> None:
        super().__init__("reference", defaults)
        self._publisher = self.create_publisher(AxisReference, "reference", PUBLISH)
        self._message = b""
        self._stamp = -1
        self._origin = 0
        self.start()
        self.create_subscription(JointState, "joint_states", self._on_state, LISTEN, raw=True)

    def check(self, config: ReferenceConfig, file: AxisFile) -> None:  # noqa: ARG002
        self._chosen = chosen(config)

    def configure(self, config: ReferenceConfig) -> None:
        super().configure(config)
        self._reference = self._chosen
        self._wire = JointWire(self.file.axis.name)
        self._period_ns = config.period * SECOND
        if config.clock != LOCK_STEP:
            self._stamp = -1  # a new reference starts at its own time 0

    def _on_state(self, data: bytes) -> None:
        stamp = self._wire.read(data)[0]
        if stamp == self._stamp:
            self.health.repeats += 1
        else:
            self._message = REFERENCE.write(stamp, *self._reference.at(self._time(stamp)))
            self._stamp = stamp
            self.health.ticks += 1
        self._publisher.publish(self._message)

    def _time(self, stamp: int) -> float:
        """Seconds of the reference. In lock-step a whole number of periods, as in the offline loop, to the last bit."""
        if self.config.clock == LOCK_STEP:
            return self.config.period * round(stamp / self._period_ns)
        if self._stamp < 0 or stamp < self._stamp:
            self._origin = stamp
        return (stamp - self._origin) / SECOND


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ReferenceNode, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
