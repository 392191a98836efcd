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
    Need,
    Parameter,
    Place,
    Role,
    Survey,
    Term,
    geometric,
    kernel,
)

CONTACTS = (
    (1.0, 0.15, 1.3),  # stiff, hardly damped: the moment of a collision tells the gap
    (0.3, 0.5, 1.7),  # soft, well damped, as gears, stops and couplings are: collisions last longer and tell it less
)
"""What the search tries at the ends of the gap: resonance over the cutoff, damping ratio, and the factor between gaps."""
SAME_STEP = 1e-6  # relative difference of steps that one solution of the contact serves


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: started, deflection (rad), velocity of the second body (rad/s); step for which the contact is solved, its
    number of pieces and the solution over one. Steps are cut to follow the contact.

    The torque is the contact's at this instant. Its mean over the step, an impulse over time, would be half a step late.
    """
    omega, damping = 2.0 * math.pi * parameters[2], parameters[3]
    half, ratio = 0.5 * parameters[0], parameters[1]
    carried = ratio * motion[INERTIA]
    motion[INERTIA] -= carried
    if state[0] == 0.0 or dt <= 0.0:
        state[0], state[1], state[2] = 1.0, 0.0, motion[VELOCITY]
        return 0.0
    if abs(state[3] - dt) > SAME_STEP * dt:
        state[3], state[4] = dt, min(max(math.ceil(omega * dt / 0.1), 1), 50)
        state[5], state[6] = oscillate(1.0, 0.0, omega, damping, dt / state[4])
        state[7], state[8] = oscillate(0.0, 1.0, omega, damping, dt / state[4])
    shaft = motion[TRAVEL] / dt
    step = dt / state[4]
    deflection, rate = state[1], state[2] - shaft
    for _ in range(int(state[4])):
        end = min(max(deflection, -half), half)
        beyond = deflection - end
        if beyond == 0.0:
            deflection += rate * step
        else:
            deflection = end + state[5] * beyond + state[7] * rate
            rate = state[6] * beyond + state[8] * rate
    state[1] = deflection
    state[2] = shaft + rate
    beyond = deflection - min(max(deflection, -half), half)
    if beyond == 0.0:
        return 0.0
    return float(-carried * (omega * omega * beyond + 2.0 * damping * omega * (state[2] - motion[VELOCITY])))


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    """Gaps close enough together for collisions to come in time, each with every contact."""
    lower, upper = max(20.0 * survey.resolution, 1e-6 * survey.span), 0.03 * survey.span
    return [
        {"gap": gap, "contact_frequency": stiffness * survey.cutoff, "contact_damping": damping}
        for stiffness, damping, fineness in CONTACTS
        for gap in geometric(lower, upper, max(2, math.ceil(math.log(upper / lower) / math.log(fineness)) + 1))
    ]


def implausible(values: Mapping[str, float], survey: Survey) -> str:
    """A contact that gives way further than the gap is wide, under the accelerations of the motion, is a spring and no stop."""
    gives_way = survey.acceleration / (2.0 * math.pi * values["contact_frequency"]) ** 2
    return "its contact is softer than the gap is wide" if gives_way > values["gap"] else ""


def rate(values: Mapping[str, float], inertia: float) -> float:
    """Both bodies swing on the contact faster than the second one against a shaft that is held."""
    return 2.0 * math.pi * values["contact_frequency"] / math.sqrt(1.0 - values["inertia_ratio"])


TERM = Term(
    id="backlash",
    place=Place.BODY,
    form="inertia_ratio J behind a gap: free inside, spring and damper at its ends",
    parameters=(
        Parameter("gap", "rad", "full width of the gap", lower=0.0),
        Parameter(
            "inertia_ratio",
            "",
            "share of the inertia behind the gap",
            role=Role.LINEAR,
            lower=0.0,
            upper=0.99,
            stated=False,
        ),
        Parameter(
            "contact_frequency",
            "Hz",
            "resonance of that share on the contact",
            lower=1e-3,
            default=50.0,
            stated=False,
        ),
        Parameter(
            "contact_damping",
            "",
            "damping ratio of the contact",
            lower=0.0,
            upper=0.99,
            default=0.1,
            stated=False,
        ),
    ),
    kernel=torque,
    reads=(),
    uncancelled="at which side of the gap the second body is cannot be seen, and no torque moves it while the gap is open",
    states=9,
    coordinate="time_since_reversal",
    subsystem="structure",
    scan=scan,
    discontinuous=True,
    needs=frozenset({Need.BOTH_DIRECTIONS, Need.REVERSALS, Need.ACCELERATION}),
    rate=rate,
    implausible=implausible,
)
