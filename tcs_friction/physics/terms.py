"""What a torque term is: the one interface of friction laws and effects.

An axis is an inertia plus a list of terms. A term is a compiled kernel

    kernel(motion, parameters, state, dt) -> float

and the declaration of all else that is particular to it. The same kernel serves the simulation step and the evaluation of a
whole recording: both walk through instants, fill the `motion` vector for each, and call the kernels in the order of
their places. `state` is the term's own memory, zero before the first instant; `dt` is the time since the previous instant, s.

Where a term acts (its `Place`) says what the kernel returns:

    DRIVE     torque at the rotor, N m, from `motion[TORQUE]`
    SCALE     0; raises or multiplies the friction that the law will find: EXTRA_LEVEL, DRY_SCALE, VISCOUS_SCALE
    LAW       friction torque, N m; writes DRY, VISCOUS, LEVEL and MOBILISED as well
    OPPOSING  opposing torque, N m, from motion, time and recorded signals
    BODY      opposing torque, N m, of a second body; lowers or changes motion[INERTIA], what moves rigidly with the shaft
    SENSOR    error of the measured position, rad

Sign convention: `inertia * acceleration = torque - friction - other opposing torques`. SI units; for a linear axis
read m, N and kg for rad, N m and kg m^2.

A file that defines a term imports all that it needs from here.
"""

from __future__ import annotations

from tcs_friction.physics.declarations import (
    COORDINATES,
    Local,
    Need,
    Place,
    Survey,
    geometric,
    many_periods,
    no_scan,
    spring_rate,
)
from tcs_friction.physics.instance import Instance, instance
from tcs_friction.physics.motion import (
    ACCELERATION,
    ARREST,
    CYCLE,
    DRY,
    DRY_SCALE,
    EXOGENOUS,
    EXTRA_LEVEL,
    INERTIA,
    KERNEL_SIGNATURE,
    LEVEL,
    MOBILISED,
    POSITION,
    SLOTS,
    TEMPERATURE,
    TIME,
    TORQUE,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Kernel,
    kernel,
    rate_at,
    resolved,
    set_surroundings,
    signal_slot,
)
from tcs_friction.physics.parameters import Feature, Harmonic, Parameter, Role, unit_on
from tcs_friction.physics.table import Table
from tcs_friction.physics.term import Term

__all__ = [
    "ACCELERATION", "ARREST", "COORDINATES", "CYCLE", "DRY", "DRY_SCALE", "EXOGENOUS", "EXTRA_LEVEL", "INERTIA",
    "KERNEL_SIGNATURE", "LEVEL", "MOBILISED", "POSITION", "SLOTS", "TEMPERATURE", "TIME", "TORQUE", "TRAVEL", "VELOCITY",
    "VISCOUS", "VISCOUS_SCALE", "Feature", "Harmonic", "Instance", "Kernel", "Local", "Need", "Parameter", "Place", "Role",
    "Survey", "Table", "Term", "geometric", "instance", "kernel", "many_periods", "no_scan", "rate_at", "resolved",
    "set_surroundings", "signal_slot", "spring_rate", "unit_on",
]  # fmt: skip
