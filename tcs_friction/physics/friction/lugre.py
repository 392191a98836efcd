"""LuGre friction (Canudas de Wit et al. 1995; paper eqs. 2 to 4 with the errata of docs/paper-errata.md).

    dz/dt = v - stiffness |v| / g(v) z
    g(v)  = coulomb + (static - coulomb) exp(-(v / stribeck_velocity)^2)
    F     = stiffness z + damping dz/dt + viscous v

Between two instants the bristle equation is linear, so its step is exact: z relaxes exponentially to g(v)/stiffness sign(v)
over the travel g/stiffness, and follows a level that changes. The step is stable at any stiffness and step length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numba import njit

from tcs_friction.physics.terms import (
    DRY,
    DRY_SCALE,
    EXTRA_LEVEL,
    LEVEL,
    MOBILISED,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Feature,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
    spring_rate,
)

VANISHED = 40.0  # exponent beyond which a bell curve is below rounding
SHORT = 0.1  # bristle widths that a short step travels
NARROWEST = 10.0  # times the position's noise: the travel of a bristle that a recording resolves
MISJUDGED = (1.0, 3.0, 1.0 / 3.0, 1.0 / 9.0, 1.0 / 27.0)  # a slow rest of presliding makes bristles seem long
USUAL_STATIC = (
    1.4  # times Coulomb friction, where a search starts: 1.1 to 2 are reported (Armstrong-Helouvry 1994)
)


@njit(cache=True, error_model="numpy")
def stribeck_level(velocity: float, coulomb: float, static: float, stribeck_velocity: float) -> float:
    """Dry friction available at this velocity, N m (paper eq. 3)."""
    ratio = velocity / stribeck_velocity
    return coulomb + (static - coulomb) * bell(ratio * ratio)


@njit(cache=True, error_model="numpy")
def bell(square: float) -> float:
    """exp(-square), 0 where that is less than one can be told from."""
    return math.exp(-square) if square < VANISHED else 0.0


@njit(cache=True, error_model="numpy")
def scaled(motion: Any, level: float) -> float:
    """The level after the SCALE terms, N m; it stays positive whatever they do."""
    return float(max((level + motion[EXTRA_LEVEL]) * motion[DRY_SCALE], 1e-3 * level))


@njit(cache=True, error_model="numpy")
def relaxation(x: float) -> tuple[float, float]:
    """exp(-x) for x >= 0 and its mean between 0 and x, to rounding; a short step takes the mean's series."""
    if x > SHORT:
        decay = math.exp(-x)
        return decay, (1.0 - decay) / x
    mean = 1.0 - x / 9.0
    for share in (1.0 / 8.0, 1.0 / 7.0, 1.0 / 6.0, 1.0 / 5.0, 1.0 / 4.0, 1.0 / 3.0, 1.0 / 2.0):
        mean = 1.0 - x * share * mean
    return 1.0 - x * mean, mean


@njit(cache=True, error_model="numpy")
def bristle_step(deflection: float, travel: float, before: float, level: float, stiffness: float) -> float:
    """Bristle deflection (rad) after `travel` (rad), while the level went from `before` to `level` (N m).

    The exact solution of eq. 2 for a level that changes in proportion to the travel. A step at constant level would put
    the bristle where it ends up and lose the rate at which it follows, which the damping feels.
    """
    if travel == 0.0:
        return deflection
    direction = 1.0 if travel > 0.0 else -1.0
    decay, mean = relaxation(stiffness * abs(travel) * 2.0 / (before + level))
    return deflection * decay + direction / stiffness * (before * (mean - decay) + level * (1.0 - mean))


@njit(cache=True, error_model="numpy")
def level_before(motion: Any, level: float) -> float:
    """The level at the instant before, which a law finds where it will write its own; at the first instant its own."""
    return float(motion[LEVEL] if motion[LEVEL] > 0.0 else level)


@njit(cache=True, error_model="numpy", inline="always")
def bristle_friction(motion: Any, state: Any, level: float, sigma0: float, sigma1: float, sigma2: float) -> float:
    """Friction (N m) of LuGre's bristle at a dry level (N m) that SCALE terms may still change. State: deflection z, rad."""
    v = motion[VELOCITY]
    g = scaled(motion, level)
    z = bristle_step(state[0], motion[TRAVEL], level_before(motion, g), g, sigma0)
    state[0] = z
    share = sigma0 * z / g
    motion[DRY] = sigma0 * z + sigma1 * (v - abs(v) * share)
    motion[VISCOUS] = sigma2 * v * motion[VISCOUS_SCALE]
    motion[LEVEL] = g
    motion[MOBILISED] = min(max(share, -1.0), 1.0)
    return float(motion[DRY] + motion[VISCOUS])


@kernel
def friction(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: deflection z, rad."""
    level = stribeck_level(motion[VELOCITY], parameters[0], parameters[1], parameters[2])
    return bristle_friction(motion, state, level, parameters[3], parameters[4], parameters[5])


def warnings(values: Mapping[str, float]) -> list[str]:
    """Conditions the values break: static above Coulomb, and the passivity of Barahona and Canudas de Wit (2000)."""
    found = []
    if values["static"] < values["coulomb"]:
        found.append(
            f"static ({values['static']:g}) is below coulomb ({values['coulomb']:g}): friction rises with speed"
        )
    needed = values["damping"] * (values["static"] - values["coulomb"]) / values["coulomb"]
    if values["viscous"] < needed:
        found.append(
            f"LuGre is not passive: viscous ({values['viscous']:g}) < damping * (static - coulomb) / coulomb ({needed:g});"
            " it can create energy at velocities where the Stribeck curve falls"
        )
    return found


def rate(values: Mapping[str, float], inertia: float) -> float:
    """Of the inertia on the bristles, with all the damping that is declared."""
    damping = values.get("damping", 0.0) + values["viscous"]
    return spring_rate(values["stiffness"], damping, inertia)


def bristle(values: Mapping[str, float]) -> float:
    """Deflection (rad) of a bristle that slides."""
    return values["coulomb"] / values["stiffness"]


def bristle_widths(survey: Survey) -> list[float]:
    """Travels (rad) over which friction may build up: about that of the axis' own bristles, else from the position's noise on.

    A law that is wrong says badly how far its bristles bend.
    """
    if survey.bristle > 0.0:
        return [survey.bristle * factor for factor in MISJUDGED]
    return geometric(max(NARROWEST * survey.resolution, 1e-7 * survey.span), 0.1 * survey.span, 9)


def stribeck_velocities(survey: Survey) -> list[float]:
    """Speeds (rad/s) over which friction may fall from static to Coulomb: those that the axis moves at, but the fastest."""
    return geometric(max(survey.slow, 1e-4 * survey.fast), 0.3 * survey.fast, 6)


def damping_shares() -> tuple[float, float]:
    """Bristle damping over sqrt(stiffness inertia): hardly any, and half the critical one."""
    return 0.01, 1.0


def starts(survey: Survey, shares: Sequence[float]) -> Sequence[Mapping[str, float]]:
    """Where to start a search for a damped bristle under a Stribeck curve; shares: damping over sqrt(stiffness inertia)."""
    return [
        {
            "static": USUAL_STATIC * survey.level,
            "stribeck_velocity": velocity,
            "stiffness": survey.level / width,
            "damping": share * math.sqrt(survey.level / width * survey.inertia),
        }
        for width in bristle_widths(survey)
        for share in shares
        for velocity in stribeck_velocities(survey)
    ]


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Starts with hardly any damping, and with half the critical one."""
    return starts(survey, damping_shares())


COULOMB = Parameter("coulomb", "N m", "friction torque of steady sliding", lower=1e-12, feature=Feature.DRY)
STATIC = Parameter(
    "static", "N m", "largest friction torque before sliding", lower=1e-12, feature=Feature.STRIBECK
)
STRIBECK_VELOCITY = Parameter(
    "stribeck_velocity",
    "rad/s",
    "velocity over which static falls to coulomb",
    lower=1e-12,
    feature=Feature.STRIBECK,
)
STIFFNESS = Parameter(
    "stiffness", "N m/rad", "bristle stiffness, sigma0", lower=1e-9, feature=Feature.PRESLIDING
)
DAMPING = Parameter(
    "damping", "N m s/rad", "bristle damping, sigma1", lower=0.0, feature=Feature.PRESLIDING
)
VISCOUS_COEFFICIENT = Parameter(
    "viscous",
    "N m s/rad",
    "viscous coefficient, sigma2",
    lower=0.0,
    role=Role.LINEAR,
    feature=Feature.VISCOUS,
)

TERM = Term(
    id="lugre",
    place=Place.LAW,
    form="F = sigma0 z + sigma1 dz/dt + sigma2 v, dz/dt = v - sigma0 |v|/g(v) z",
    parameters=(COULOMB, STATIC, STRIBECK_VELOCITY, STIFFNESS, DAMPING, VISCOUS_COEFFICIENT),
    kernel=friction,
    reads=(),
    states=1,
    warn=warnings,
    scan=scan,
    rate=rate,
    bristle=bristle,
    usual=True,
)
