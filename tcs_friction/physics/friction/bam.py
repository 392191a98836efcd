"""Load-dependent Stribeck friction, as Better Actuator Models has it for geared servos (Duclusaud et al. 2025, its model M4).

F = (c + (s - c) exp(-|v / stribeck_velocity|^exponent)) sign(v) + viscous v
c = coulomb + load |u|,   s - c = static - coulomb + load_stribeck |u|,   u the torque through the gear
"""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.friction.coulomb_viscous import static_friction, viscous_rate
from tcs_friction.physics.friction.lugre import COULOMB, STATIC, STRIBECK_VELOCITY, VISCOUS_COEFFICIENT
from tcs_friction.physics.friction.stribeck_static import EXPONENT, stribeck_fall
from tcs_friction.physics.terms import TORQUE, VELOCITY, Parameter, Place, Term, kernel


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    coulomb, static, stribeck_velocity, viscous, exponent, load, load_stribeck = parameters[:7]
    torque = abs(motion[TORQUE])
    drop = static - coulomb + load_stribeck * torque
    fall = stribeck_fall(motion[VELOCITY] / stribeck_velocity, exponent)
    return float(static_friction(motion, coulomb + load * torque + drop * fall, viscous))


TERM = Term(
    id="bam",
    place=Place.LAW,
    form="F = (c + (s - c) exp(-|v/stribeck_velocity|^exponent)) sign(v) + viscous v, c and s growing with |u|",
    parameters=(
        COULOMB,
        STATIC,
        STRIBECK_VELOCITY,
        VISCOUS_COEFFICIENT,
        EXPONENT,
        Parameter(
            "load",
            "",
            "share of the load torque that Coulomb friction grows by",
            lower=0.0,
            upper=1.0,
            default=0.0,
        ),
        Parameter(
            "load_stribeck",
            "",
            "share of the load torque that the Stribeck drop grows by",
            lower=0.0,
            upper=1.0,
            default=0.0,
        ),
    ),
    kernel=friction,
    reads=("torque",),
    rate=viscous_rate,
)
