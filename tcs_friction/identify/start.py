"""Where a fit begins and where its unknowns may go."""

from __future__ import annotations

import numpy as np

from tcs_friction.conditioning.timing import LONGEST
from tcs_friction.identify.cost import scales, widest
from tcs_friction.identify.models import LuGreModel, first_directions
from tcs_friction.identify.problem import MOST_INITIAL_STATES, Problem
from tcs_friction.identify.refine import Space
from tcs_friction.physics.terms import Role


def believed_start(problem: Problem) -> np.ndarray:
    """Unknowns (p,) as believed: the axis' values, no offset, the torque in time, stretches that start in motion sliding."""
    values = problem.axis.friction.values
    law = [values[p.name] for p in problem.axis.friction.term.parameters]
    initial = first_directions(problem.axis, problem.motion) * values.get("coulomb", 0.0)
    return np.array([*law, problem.axis.inertia, 0.0, 0.0, *initial])


def with_sliding_states(problem: Problem, unknowns: np.ndarray) -> np.ndarray:
    """The same unknowns with the initial bristle torque of stretches that start in motion at the law's Coulomb torque."""
    result = unknowns.copy()
    names = problem.names
    if "coulomb" in names:
        coulomb = unknowns[names.index("coulomb")]
        result[problem.states_index :] = first_directions(problem.axis, problem.motion) * coulomb
    return result


def space_of(problem: Problem, free_inertia: bool, free_offset: bool, free_timing: bool) -> Space:
    """Bounds within which the data can tell a parameter; positive ones move by factors; free initial bristle torques."""
    parameters = problem.axis.friction.term.parameters
    states = len(problem.motion.bounds) - 1
    free_states = isinstance(problem.model, LuGreModel) and states <= MOST_INITIAL_STATES
    farthest = max(LONGEST, 3.0 * problem.fine.period) if problem.fine else LONGEST
    box = widest(parameters, scales(problem, problem.axis.inertia))
    lower = np.array(
        [
            *np.where(box.logarithmic, box.lower, [p.lower for p in parameters]),
            1e-300,
            -np.inf,
            -farthest,
            *[-np.inf] * states,
        ]
    )
    upper = np.array(
        [
            *np.where(box.logarithmic, box.upper, [p.upper for p in parameters]),
            np.inf,
            np.inf,
            farthest,
            *[np.inf] * states,
        ]
    )
    logarithmic = np.array([*(p.lower > 0.0 for p in parameters), True, False, False, *[False] * states])
    free = np.array(
        [*(p.role is not Role.FIXED for p in parameters), free_inertia, free_offset, free_timing, *[free_states] * states]
    )
    return Space(lower, upper, logarithmic, free)
