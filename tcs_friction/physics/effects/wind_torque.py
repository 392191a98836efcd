"""Wind: torque that goes with the square of the recorded wind speed, signed."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import Parameter, Place, Role, Term, kernel

WORDS = ("wind", "gust", "anemo")  # in the name of a recorded wind


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    wind = motion[int(parameters[1])]
    return float(parameters[0] * wind * abs(wind))


def names_wind(name: str) -> bool:
    """Whether a recorded signal of this name is a wind."""
    return any(word in name.lower() for word in WORDS)


TERM = Term(
    id="wind_torque",
    place=Place.OPPOSING,
    form="x = coefficient w |w|",
    parameters=(Parameter("coefficient", "N m s^2/m^2", "torque per squared wind speed", role=Role.LINEAR),),
    kernel=torque,
    reads=(),
    signals=1,
    coordinate="exogenous",
    subsystem="environment",
    suits=names_wind,
)
