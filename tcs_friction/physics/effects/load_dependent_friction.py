"""Dry friction that grows with the load torque: gears, worms, loaded bearings."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import EXTRA_LEVEL, TORQUE, Need, Parameter, Place, Role, Term, kernel


@kernel
def scale(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    motion[EXTRA_LEVEL] += parameters[0] * abs(motion[TORQUE])
    return 0.0


TERM = Term(
    id="load_dependent_friction",
    place=Place.SCALE,
    form="level + coefficient |u|; sliding, x = coefficient |u| sign(v)",
    parameters=(
        Parameter(
            "coefficient", "", "friction torque per load torque", lower=-0.5, upper=0.5, role=Role.LINEAR
        ),
    ),
    kernel=scale,
    reads=("torque",),
    coordinate="torque",
    needs=frozenset({Need.MEASURED_INERTIA}),  # its load is mostly the inertia's torque
)
