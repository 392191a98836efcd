"""Backlash: part of the inertia is coupled through a gap, at whose ends it meets a stiff, damped contact.

Inside the gap the second body coasts; beyond it the flexible mode's equation holds about the gap's end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.physics.effects.flexible_mode import oscillate
from tcs_friction.physics.terms import (
    INERTIA,
    TRAVEL,
    VELOCITY,
    Parameter,
    Place,
    Survey,
    Term,
    geometric,
    kernel,
)


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: started, deflection (rad), velocity of the second body (rad/s). Steps are cut to follow the contact."""
    half, ratio, omega, damping = (
        0.5 * parameters[0],
        parameters[1],
        2.0 * math.pi * parameters[2],
        parameters[3],
    )
    carried = ratio * motion[INERTIA]
    motion[INERTIA] -= carried
    if state[0] == 0.0 or dt <= 0.0:
        state[0], state[1], state[2] = 1.0, 0.0, motion[VELOCITY]
        return 0.0
    shaft = motion[TRAVEL] / dt
    pieces = min(max(math.ceil(omega * dt / 0.2), 1), 50)
    step = dt / pieces
    deflection, rate, impulse = state[1], state[2] - shaft, 0.0
    for _ in range(pieces):
        before = rate
        end = min(max(deflection, -half), half)
        if deflection == end:
            deflection += rate * step
        else:
            beyond, rate = oscillate(deflection - end, rate, omega, damping, step)
            deflection = end + beyond
        impulse += rate - before
    state[1] = deflection
    state[2] = shaft + rate
    return float(carried * impulse / dt)


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    gaps = geometric(max(20.0 * survey.resolution, 1e-6 * survey.span), 0.03 * survey.span, 8)
    return [{"gap": gap, "inertia_ratio": ratio} for gap in gaps for ratio in (0.05, 0.3)]


TERM = Term(
    id="backlash",
    place=Place.BODY,
    form="inertia_ratio J behind a gap: free inside, spring and damper at its ends",
    parameters=(
        Parameter("gap", "rad", "full width of the gap", lower=0.0),
        Parameter("inertia_ratio", "", "share of the inertia behind the gap", lower=0.0, upper=0.99),
        Parameter(
            "contact_frequency", "Hz", "resonance of that share on the contact", lower=1e-3, default=50.0
        ),
        Parameter("contact_damping", "", "damping ratio of the contact", lower=0.0, upper=0.99, default=0.1),
    ),
    kernel=torque,
    reads=(),
    states=3,
    coordinate="time_since_reversal",
    subsystem="structure",
    scan=scan,
)
