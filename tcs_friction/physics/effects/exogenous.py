"""Any other recorded signal that pushes on the axis, linearly or with its signed square."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import Parameter, Place, Role, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    signal = motion[int(parameters[2])]
    return float(parameters[0] * signal + parameters[1] * signal * abs(signal))


TERM = Term(
    id="exogenous",
    place=Place.OPPOSING,
    form="x = linear s + squared s |s|",
    parameters=(
        Parameter("linear", "N m/1", "torque per unit of the signal", default=0.0, role=Role.LINEAR),
        Parameter(
            "squared", "N m/1^2", "torque per squared unit of the signal", default=0.0, role=Role.LINEAR
        ),
    ),
    kernel=torque,
    reads=(),
    signals=1,
    coordinate="exogenous",
    subsystem="environment",
)
