"""The declaration of a friction law or an effect; `terms` says what its kernel is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tcs_friction.errors import InputError, nearest
from tcs_friction.physics.declarations import (
    COORDINATES,
    Completes,
    Extent,
    Implausible,
    InertiaOver,
    Local,
    Need,
    Orders,
    Place,
    Rate,
    Rings,
    Scan,
    Transfer,
    Values,
    Warn,
    always_plausible,
    any_signal,
    many_periods,
    no_law,
    no_rate,
    no_scan,
    no_travel,
    no_warnings,
)
from tcs_friction.physics.motion import Kernel
from tcs_friction.physics.parameters import Feature, Harmonic, Parameter, Role


@dataclass(frozen=True)
class Term:
    """A friction law or an effect. This is all that the package knows of it.

    Raises InputError for a declaration that contradicts itself.

    What it is
    ----------
    id: name in axis files, diagnoses and reports.
    place: where it acts.
    form: the formula, as the documentation prints it.
    parameters, kernel: see the module.
    states: number of state values, or a function of (parameter values, dt) giving it.
    signals: number of recorded signals the instance must name; the kernel finds their slots behind its parameters.
    temperature: whether it reads the recorded temperature.
    tabulated: whether an instance carries a `Table`.
    rank: order among terms of the same place; terms that change what others read come first.
    reads: what it reads beside motion, time and recorded signals: the "torque" at the rotor, what "friction" terms wrote.
    A term that reads nothing else adds the same torque whatever else the axis has.
    rotary: whether only a rotary axis can have it.
    rate: fastest rate (1/s) of the dynamics that it gives an axis, from its values and the axis' inertia: the integration
    step resolves it.
    transfer: where it is a linear filter, the complex amplitude that it adds at complex frequencies s (rad/s): to the torque,
    over that torque, for a DRIVE term; to the required torque, over inertia times acceleration, for a BODY.
    inertia_over: of a BODY that changes the inertia over the position: by which factor, from its values and angles (n,), rad.
    warn: what is doubtful about a set of values (a passivity condition, say), one line each.

    Of a friction law
    -----------------
    Exactly one parameter has the feature DRY: the level of the dry friction, N m.
    bristle: travel (rad) over which its dry friction builds up, from its values; 0 without bristles.
    stiffness: of its bristles where they begin to bend, N m/rad, from its values; None where a parameter has that name.
    usual: whether it is the one to take, among laws with the same features, where nobody names a law.
    extends: id of the law that it is where its further parameters have their defaults; few recordings determine those, and laws
    are compared without it unless it is named.

    Of an effect that completes a law
    ---------------------------------
    of_law: its parameters, as far as the values of a law that has its features give them.

    How a recording shows it
    ------------------------
    needs: what a recording must have for the effect to be told from others.
    suits: whether a recorded signal of this name may be what it acts through.
    scan: values of the SHAPE parameters to start a search from, given what a recording can show.
    periodic: "position" or "time" when the first parameter counts periods there and a spectrum finds it; its LINEAR parameters
    are then the amplitudes of its harmonics, the first one first.
    orders: lowest and highest order to search over the position, from the order with one period over the travel and whether
    the axis is rotary.
    local: the parameters that place it in the position, where a matched filter finds it.
    discontinuous: whether its torque jumps with its shape, as collisions do: a search then cannot follow derivatives.
    neutral: the parameter that is the place in which it exerts no torque. It is at its default until the data ask for it, and a
    constant torque beside such a term is its neutral place.
    whole: whether its order on a rotary axis is a whole number: it closes with the turn.
    implausible: why an effect with these values cannot be told in such a motion, in words, or nothing.
    alignment: the parameter (s) by which the torque is late, where that is all that the effect does: it then stands for torque
    and position of a log that are out of step.

    How a compensator cancels it
    ----------------------------
    What acts on the friction or opposes the motion is cancelled by the same kernel, run along the reference; a SENSOR term by
    taking its error from the measured position; what only delays the drive by commanding earlier.
    inverse: of another DRIVE term: a kernel with the same parameters and states that returns the command for which the term
    gives motion[TORQUE]. A DRIVE term without one is not cancelled.
    uncancelled: why it cannot be cancelled safely, in words, or nothing.
    rings: of a BODY behind a spring: frequency (Hz) and damping ratio, from its values, of its oscillation while the shaft keeps
    to its reference. No torque stops that; a shaped reference does not excite it.

    How it is told and drawn
    ------------------------
    coordinate: where it shows, one of COORDINATES.
    subsystem: what an engineer would look at (`bearing`, `actuator`, ...).
    frequency: the parameter that is the frequency (Hz) at which it shows, beside the first one of what is periodic in time.
    extent: from where to where along its coordinate it shows, from its values; None: to the end. `local` gives its own.
    """

    id: str
    place: Place
    form: str
    parameters: tuple[Parameter, ...]
    kernel: Kernel
    coordinate: str = "velocity"
    subsystem: str = "bearing"
    states: int | Callable[[Values, float], int] = 0
    signals: int = 0
    temperature: bool = False
    scan: Scan = no_scan
    periodic: str = ""
    local: Local | None = None
    transfer: Transfer | None = None
    warn: Warn = no_warnings
    rank: int = 0
    tabulated: bool = False
    reads: tuple[str, ...] = ("torque", "friction")
    rotary: bool = False
    discontinuous: bool = False
    offset: str = ""
    alignment: str = ""
    needs: frozenset[Need] = frozenset()
    suits: Callable[[str], bool] = any_signal
    orders: Orders = many_periods
    rate: Rate = no_rate
    bristle: Callable[[Values], float] = no_travel
    stiffness: Callable[[Values], float] | None = None
    usual: bool = False
    extends: str = ""
    of_law: Completes = no_law
    frequency: str = ""
    extent: Extent | None = None
    neutral: str = ""
    whole: bool = False
    implausible: Implausible = always_plausible
    inverse: Kernel | None = None
    uncancelled: str = ""
    rings: Rings | None = None
    inertia_over: InertiaOver | None = None

    def __post_init__(self) -> None:
        where = f"term {self.id}"
        if self.coordinate not in COORDINATES:
            raise InputError(where, f"unknown coordinate {self.coordinate!r}", nearest(self.coordinate, list(COORDINATES)))
        if self.periodic not in ("", "position", "time"):
            raise InputError(where, f"periodic is {self.periodic!r}", "position, time or nothing")
        known = [p.name for p in self.parameters]
        local = (self.local.centre, self.local.width) if self.local else ()
        for name in filter(None, (self.offset, self.alignment, self.frequency, self.neutral, *local)):
            if name not in known:
                raise InputError(where, f"no parameter {name!r}", nearest(name, known))
        if self.place is Place.LAW and sum(p.feature is Feature.DRY for p in self.parameters) != 1:
            raise InputError(where, "the level of its dry friction is unknown", "one parameter with the feature DRY")

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        return self.id.replace("_", " ")

    @property
    def features(self) -> frozenset[Feature]:
        """The parts of the friction that its parameters describe. An effect is redundant on an axis that has all of its."""
        return frozenset(p.feature for p in self.parameters if p.feature is not None)

    @property
    def level(self) -> Parameter:
        """The level of a law's dry friction."""
        return next(p for p in self.parameters if p.feature is Feature.DRY)

    @property
    def without_memory(self) -> bool:
        """Whether a law has no state: while the axis rests it only bounds the torque that holds it."""
        return self.place is Place.LAW and self.states == 0

    @property
    def order(self) -> Parameter:
        """What counts the periods of a periodic effect: an order (1/turn, 1/m) or a frequency (Hz)."""
        return self.parameters[0]

    @property
    def harmonics(self) -> tuple[Harmonic, ...]:
        """Amplitude and phase of harmonic 1, 2, ... of a periodic effect; none of another."""
        following = (*self.parameters[1:], None)
        return tuple(
            Harmonic(p, after if after is not None and after.role is Role.PHASE else None)
            for p, after in zip(self.parameters, following, strict=True)
            if self.periodic and p.role is Role.LINEAR
        )

    @property
    def filters(self) -> bool:
        """Whether it is a linear filter between the logged torque and the rotor."""
        return self.place is Place.DRIVE and self.transfer is not None

    @property
    def resonates(self) -> bool:
        """Whether it is a body with a linear response."""
        return self.place is Place.BODY and self.transfer is not None

    @property
    def obstacle(self) -> str:
        """Why no compensator can cancel it, in words; nothing where one can."""
        if self.place is Place.DRIVE and self.inverse is None and not self.alignment:
            return self.uncancelled or "no inverse of it is known"
        return self.uncancelled

    @property
    def collides(self) -> bool:
        """Whether it is a body that knocks: no collision comes at its exact time."""
        return self.place is Place.BODY and self.discontinuous

    @property
    def slow_over_position(self) -> bool:
        """Whether it is a torque of the position that has no order of its own and is no table, or a constant one."""
        over_position = bool(self.offset) or self.coordinate == "position"
        return over_position and self.place is Place.OPPOSING and not (self.periodic or self.tabulated)

    @property
    def event(self) -> bool:
        """Whether it begins at a moment."""
        return self.coordinate == "time" and self.extent is not None

    def parameter(self, name: str) -> Parameter:
        """The declared parameter of that name."""
        return next(p for p in self.parameters if p.name == name)

    def state_size(self, values: Values, dt: float) -> int:
        """Number of state values for instants `dt` (s) apart."""
        return self.states(values, dt) if callable(self.states) else self.states
