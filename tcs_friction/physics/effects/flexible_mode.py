"""Flexible mode: part of the inertia hangs on the shaft through a spring (drive and encoder on the shaft's side).

`frequency` is the resonance that a frequency response from torque to acceleration shows. With the shaft held, the
second body rings lower, at w = 2 pi frequency sqrt(1 - inertia_ratio), the antiresonance, with a damping ratio zeta that
is lower by the same factor. Its deflection d from the shaft obeys d'' + 2 zeta w d' + w^2 d = -shaft acceleration.
Between two instants the shaft has constant acceleration, for which the step below is exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba import njit

from tcs_friction.physics.terms import (
    INERTIA,
    VELOCITY,
    Need,
    Parameter,
    Place,
    Survey,
    Term,
    geometric,
    kernel,
)

DAMPED = 0.5  # ratio from which nothing is seen to swing


@njit(cache=True, error_model="numpy")
def oscillate(deflection: float, rate: float, omega: float, damping: float, dt: float) -> tuple[float, float]:
    """Free damped oscillation (damping < 1) over dt: deflection and its rate."""
    decay = damping * omega
    ringing = omega * math.sqrt(1.0 - damping * damping)
    c, s, e = math.cos(ringing * dt), math.sin(ringing * dt), math.exp(-decay * dt)
    sine = (rate + decay * deflection) / ringing
    after = e * (deflection * c + sine * s)
    return after, e * (sine * ringing * c - deflection * ringing * s) - decay * after


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: started, deflection (rad) and its rate (rad/s), velocity of the shaft before (rad/s)."""
    ratio = parameters[2]
    lower = math.sqrt(1.0 - ratio)
    omega, damping = 2.0 * math.pi * parameters[0] * lower, parameters[1] * lower
    carried = ratio * motion[INERTIA]
    motion[INERTIA] -= carried
    shaft = motion[VELOCITY]
    if state[0] == 0.0 or dt <= 0.0:
        state[0], state[1], state[2], state[3] = 1.0, 0.0, 0.0, shaft
        return 0.0
    at_rest = -(shaft - state[3]) / dt / (omega * omega)
    deflection, rate = oscillate(state[1] - at_rest, state[2], omega, damping, dt)
    state[1], state[2], state[3] = deflection + at_rest, rate, shaft
    return float(-carried * (omega * omega * state[1] + 2.0 * damping * omega * rate))


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Resonances up to the highest frequency with a signal, for a small and a large second body."""
    lowest = max(10.0 / survey.duration, 0.03 * survey.cutoff)
    frequencies = geometric(lowest, 1.3 * survey.cutoff, 26)
    return [{"frequency": f, "damping": 0.04, "inertia_ratio": r} for f in frequencies for r in (0.05, 0.3)]


def transfer(values: Mapping[str, float], s: np.ndarray) -> np.ndarray:
    frequency, damping = rings(values)
    omega = 2.0 * math.pi * frequency
    return np.asarray(-values["inertia_ratio"] * s**2 / (s**2 + 2.0 * damping * omega * s + omega**2))


def rings(values: Mapping[str, float]) -> tuple[float, float]:
    """The antiresonance: frequency (Hz) and damping ratio of the second body while the shaft is held."""
    lower = math.sqrt(1.0 - values["inertia_ratio"])
    return values["frequency"] * lower, values["damping"] * lower


def warnings(values: Mapping[str, float]) -> list[str]:
    """What hardly swings is no mode."""
    damping = values["damping"]
    return [f"a mode with a damping ratio of {damping:.3g} shows no resonance"] if damping > DAMPED else []


def rate(values: Mapping[str, float], inertia: float) -> float:
    return 2.0 * math.pi * values["frequency"]


TERM = Term(
    id="flexible_mode",
    place=Place.BODY,
    form="ratio J on a spring: d'' + 2 zeta w d' + w^2 d = -a, x = ratio J (a + d'')",
    parameters=(
        Parameter("frequency", "Hz", "free resonance, the peak of acceleration over torque", lower=1e-6),
        Parameter(
            "damping",
            "",
            "damping ratio at that resonance",
            lower=0.0,
            upper=0.99,
            default=0.02,
        ),
        Parameter(
            "inertia_ratio", "", "share of the inertia behind the spring", lower=0.0, upper=0.95, stated=False
        ),
    ),
    kernel=torque,
    reads=(),
    states=4,
    coordinate="frequency",
    subsystem="structure",
    scan=scan,
    transfer=transfer,
    warn=warnings,
    needs=frozenset({Need.ACCELERATION}),
    rate=rate,
    frequency="frequency",
    rings=rings,
)
