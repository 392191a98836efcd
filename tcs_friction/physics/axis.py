"""An axis: an inertia plus a list of torque terms, its drive and its sensors, as data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from tcs_friction.errors import InputError
from tcs_friction.physics.registry import alignment
from tcs_friction.physics.terms import Feature, Instance, Place, unit_on

Unit = Callable[[str], str]
"""How an axis writes a unit of a rotary one, as `Axis.unit` does; `str` for a rotary one whose torque is in N m."""

KINDS = ("rotary", "linear")
SLOWEST = 1.0  # 1/s, of the rates that an integration step resolves: no step needs to be longer


@dataclass(frozen=True)
class Sensors:
    """What the controller gets to see. The velocity is the difference of measured positions through a first-order filter."""

    resolution: float = 0.0  # rad, least step of the encoder; 0: none
    noise: float = 0.0  # rad rms, white, before rounding
    velocity_bandwidth: float = 0.0  # Hz, of the velocity filter; 0: plain difference


@dataclass(frozen=True)
class Drive:
    """How the commanded torque becomes torque at the rotor, apart from effects."""

    limit: float = math.inf  # N m, saturation
    noise: float = 0.0  # N m rms, coloured torque noise
    noise_bandwidth: float = 10.0  # Hz, of the first-order filter that colours it
    rated_torque: float = 0.0  # N m, of which torques in per cent are shares; 0: not known


@dataclass(frozen=True)
class Axis:
    """One axis as somebody believes or made it. Units as in `terms`; `kind` linear reads m, N, kg.

    lateness: s by which a logged torque acts later than its log was read, negative: sooner; of a fit to a log, never of a file.

    Raises InputError for an inertia that is not positive or terms in the wrong place.
    """

    name: str
    inertia: float
    friction: Instance
    effects: tuple[Instance, ...] = ()
    kind: str = "rotary"
    actuation_delay: float = 0.0  # s, known delay between logged torque and its action
    sensors: Sensors = field(default_factory=Sensors)
    drive: Drive = field(default_factory=Drive)
    torque_unit: str = ""  # A, V or % where torque is known up to a constant; "": N m or N
    lateness: float = 0.0
    continuous: bool = False  # its encoder's angle begins anew after a turn

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"axis {self.name}: kind", repr(self.kind), "rotary or linear")
        if self.continuous and self.kind != "rotary":
            raise InputError(f"axis {self.name}: continuous", "true of a linear axis", "kind: rotary")
        if not (self.inertia > 0.0 and math.isfinite(self.inertia)):
            raise InputError(f"axis {self.name}: inertia", repr(self.inertia), "a positive number")
        if not 0.0 <= self.actuation_delay <= 10.0:
            raise InputError(f"axis {self.name}: actuation_delay", repr(self.actuation_delay), "0 to 10 s")
        if self.friction.term.place is not Place.LAW:
            raise InputError(
                f"axis {self.name}: friction", f"{self.friction.term.id} is an effect", "a friction law"
            )
        for item in self.effects:
            if item.term.place is Place.LAW:
                raise InputError(
                    f"axis {self.name}: effects", f"{item.term.id} is a friction law", "an effect"
                )

    def unit(self, unit: str) -> str:
        """What this axis has where a rotary one whose torque is in N m has `unit`."""
        return unit_on(self.kind, unit, self.torque_unit)

    @property
    def cycle(self) -> float:
        """Radians of phase per unit of position at order 1."""
        return 1.0 if self.kind == "rotary" else 2.0 * math.pi

    @property
    def dry_level(self) -> float:
        """Dry friction (N m) of steady sliding, before effects."""
        return self.friction.values[self.friction.term.level.name]

    @property
    def bristle(self) -> float:
        """Travel (rad) in which the law's dry friction builds up, 0 for a law without bristles."""
        return self.friction.term.bristle(self.friction.values)

    @property
    def features(self) -> frozenset[Feature]:
        """The parts of the friction that its law and effects describe."""
        return self.friction.term.features.union(*(item.term.features for item in self.effects))

    @cached_property
    def terms(self) -> tuple[Instance, ...]:
        """All terms in the order they act: drive, scale, law, opposing, body, sensor."""
        order = list(Place)
        delay, late = alignment(), self.actuation_delay + self.lateness
        known = [Instance(delay, {delay.alignment: late})] if late != 0.0 else []
        every = [*known, self.friction, *self.effects]
        return tuple(sorted(every, key=lambda item: (order.index(item.term.place), item.term.rank)))

    def with_friction(self, values: Mapping[str, float]) -> Axis:
        """The axis with some values of its friction law changed."""
        return replace(self, friction=self.friction.replace(**values))

    def with_effect(self, item: Instance) -> Axis:
        """The axis with one more effect."""
        return replace(self, effects=(*self.effects, item))

    def without_effect(self, item: Instance) -> Axis:
        """The axis without this one of its effects."""
        return replace(self, effects=tuple(other for other in self.effects if other is not item))

    def warnings(self) -> list[str]:
        """What is doubtful about the values, one line each."""
        return [f"axis {self.name}: {line}" for item in self.terms for line in item.term.warn(item.values)]

    def fastest_rate(self) -> float:
        """Fastest rate (1/s) of the axis' own dynamics that the integration step has to resolve."""
        items = (self.friction, *self.effects)
        return max(SLOWEST, *(item.term.rate(item.values, self.inertia) for item in items))
