"""The local end of a fit, and which parameters the data cannot determine, with the reason."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.identify.owed import Owed, owed
from tcs_friction.identify.problem import Problem
from tcs_friction.identify.refine import Refined, Space, refine
from tcs_friction.identify.start import with_sliding_states
from tcs_friction.identify.uncertainty import sandwich
from tcs_friction.physics.terms import Feature

LARGEST_RELATIVE = 0.5  # relative standard deviation above which a number would mean nothing
NEGLIGIBLE = 0.02  # of the torque's size: a parameter whose uncertainty matters less is known well enough
LEAST_EFFECT = 1e-6  # of the torque's size: a parameter that moves less than this does not act at all
SHARES = 5  # Coulomb torques that are tried between two
PRESLIDING = ("stiffness", "damping", "presliding_distance", "stiffness_1")


@dataclass(frozen=True, eq=False)
class Verdicts:
    """refined: the final fit. space: what could not be determined is held. reasons: index of unknown -> why undetermined.

    owed (p, p): covariance of what depends on values that were only held.
    """

    refined: Refined
    space: Space
    reasons: Mapping[int, str]
    evaluations: int
    notes: tuple[str, ...]
    owed: np.ndarray


def judge(
    problem: Problem,
    unknowns: np.ndarray,
    space: Space,
    believed: Mapping[str, float],
    loss: str,
    polish: bool,
    unshown: Mapping[int, str],
    cancel: Callable[[], bool] = lambda: False,
) -> Verdicts:
    """Refine from `unknowns` (p,), hold what the data do not determine at what is believed (or found), and refine again.

    `polish` False leaves the numbers where the search put them and only judges. `unshown`: what the search found undetermined.
    """
    reasons: dict[int, str] = beforehand(problem, space) | dict(unshown)
    unknowns = with_sliding_states(problem, unknowns)
    evaluations = 0
    size = float(np.std(problem.target)) or 1.0
    for _ in range(problem.law_size + 2):
        held = np.isin(np.arange(len(unknowns)), list(reasons))
        if polish:
            unknowns = _without_drop(
                problem, _with_believed(problem, unknowns, space, reasons, believed), reasons
            )
        current = space.holding(held)
        refined = refine(
            problem.linearised, problem.torque, problem.target, problem.weights, unknowns,
            current if polish else _states_only(problem, current), loss,
            tolerance=problem.tolerance, cancel=cancel,
        )  # fmt: skip
        evaluations += refined.evaluations
        unknowns = refined.unknowns.copy()
        more = _undetermined(problem, refined, current, size)
        if not more:
            break
        reasons.update(more)
        reasons.update(companions(problem, reasons))
    names = problem.names
    if "static" in names and names.index("static") in reasons and "static" not in believed:
        unknowns[names.index("static")] = unknowns[names.index("coulomb")]
        refined = replace(refined, unknowns=unknowns)
    debt, more_evaluations = owed(
        problem, refined, space, sorted(k for k in reasons if space.free[k]) if polish else [], loss, cancel
    )
    undetermined = np.isin(np.arange(len(unknowns)), list(reasons))
    reasons.update(_indebted(problem, refined, current.holding(undetermined), debt, size))
    evaluations += more_evaluations
    return Verdicts(refined, current, reasons, evaluations, _notes(problem, reasons), debt.covariance)


def _states_only(problem: Problem, space: Space) -> Space:
    """Only the initial bristle torques, which no global search looks for, may move."""
    return space.holding(np.arange(len(space.free)) < problem.states_index)


def beforehand(problem: Problem, space: Space) -> dict[int, str]:
    """What the motion rules out without a fit."""
    reasons: dict[int, str] = {}
    motion, names = problem.motion, problem.names
    if motion.measured:
        reasons[problem.inertia_index] = "friction estimates hold no inertia"
    elif not space.free[problem.inertia_index]:
        reasons[problem.inertia_index] = "held at the axis file's value"
    if not space.free[problem.offset_index]:
        reasons[problem.offset_index] = "held at zero"
    if not motion.reverses:
        reasons[problem.offset_index] = (
            "the recording never reverses, so a constant torque cannot be told from Coulomb torque"
        )
        for name in PRESLIDING:
            if name in names:
                reasons[names.index(name)] = "the recording never reverses"
    return reasons


def _with_believed(
    problem: Problem,
    unknowns: np.ndarray,
    space: Space,
    reasons: Mapping[int, str],
    believed: Mapping[str, float],
) -> np.ndarray:
    """Undetermined unknowns as believed; where nothing is, so that they act as little as can be."""
    result = unknowns.copy()
    for k in reasons:
        if k == problem.inertia_index:
            result[k] = problem.axis.inertia
        elif k == problem.offset_index:
            result[k] = 0.0
        elif problem.names[k] in believed:
            result[k] = believed[problem.names[k]]
        elif problem.names[k] == "stribeck_velocity":
            result[k] = space.lower[k]  # so slow that the drop is over whenever the axis moves
        elif problem.names[k] == "damping":
            result[k] = 0.0
        elif k < problem.law_size and (default := problem.axis.friction.term.parameters[k].default) is not None:
            result[k] = default
    return result


def _without_drop(problem: Problem, unknowns: np.ndarray, reasons: Mapping[int, str]) -> np.ndarray:
    """Where a drop from static to Coulomb torque has been given up: the Coulomb torque between both that explains most."""
    names = problem.names
    if "stribeck_velocity" not in names or names.index("stribeck_velocity") not in reasons:
        return unknowns
    coulomb, static = (names.index(name) for name in ("coulomb", "static"))
    if coulomb in reasons:
        return unknowns
    trials = [unknowns.copy() for _ in range(SHARES)]
    for trial, share in zip(trials, np.linspace(0.0, 1.0, SHARES), strict=True):
        trial[coulomb] = (1.0 - share) * unknowns[coulomb] + share * unknowns[static]
    costs = [float(problem.weights @ (problem.target - problem.torque(trial)) ** 2) for trial in trials]
    return trials[int(np.argmin(costs))]


def companions(problem: Problem, reasons: Mapping[int, str]) -> dict[int, str]:
    """What means nothing without its companion: a drop without its velocity, damping without stiffness."""
    names = problem.names
    drop = [p.name for p in problem.axis.friction.term.parameters if p.feature is Feature.STRIBECK]
    pairs = [("static", "stribeck_velocity"), ("stiffness", "damping"), *(("stribeck_velocity", name) for name in drop)]
    known = [
        (names.index(one), names.index(other)) for one, other in pairs if one in names and other in names
    ]
    return {other: reasons[one] for one, other in known if one in reasons and other not in reasons}


def _undetermined(problem: Problem, refined: Refined, space: Space, size: float) -> dict[int, str]:
    """The least determined unknown of a fit, if it means nothing: one at a time, since holding one may save the others."""
    index = np.flatnonzero(space.free)
    covariance = sandwich(refined.jacobian[:, index], refined.residual, refined.weights)
    falling = _still_falling(problem, refined, space)
    if falling:
        return falling
    worst, which = LARGEST_RELATIVE, -1
    for k, variance in zip(index.tolist(), np.diag(covariance), strict=True):
        if k > problem.inertia_index:
            continue
        value, std = abs(refined.unknowns[k]), float(np.sqrt(max(variance, 0.0)))
        at_bound = not space.lower[k] * 1.001 < value < space.upper[k] / 1.001
        acting = float(np.abs(refined.jacobian[:, k]).max())
        if (space.logarithmic[k] and at_bound) or acting * max(value, std) < LEAST_EFFECT * size:
            return {k: _reason(problem, k)}
        matters = space.logarithmic[k] or acting * std > NEGLIGIBLE * size
        relative = std / max(value, 1e-300)
        if matters and relative > worst:
            worst, which = relative, k
    return {which: _reason(problem, which)} if which >= 0 else {}


def _indebted(
    problem: Problem, refined: Refined, space: Space, debt: Owed, size: float
) -> dict[int, str]:
    """What would mean nothing if the undetermined unknowns, which `space` holds, were others."""
    reasons = {}
    index = np.flatnonzero(space.free)
    variances = np.diag(debt.covariance).copy()
    variances[index] += np.diag(sandwich(refined.jacobian[:, index], refined.residual, refined.weights))
    for k in index[index <= problem.offset_index].tolist():
        if not debt.covariance[k, k] > 0.0:
            continue
        std = float(np.sqrt(variances[k]))
        acting = float(np.abs(refined.jacobian[:, k]).max())
        matters = space.logarithmic[k] or acting * std > NEGLIGIBLE * size
        if matters and std > LARGEST_RELATIVE * abs(refined.unknowns[k]):
            others = " and ".join(problem.names[other].replace("_", " ") for other in debt.creditors(k))
            reasons[k] = f"cannot be told from {others}, which this motion does not determine"
    return reasons


def _still_falling(problem: Problem, refined: Refined, space: Space) -> dict[int, str]:
    """A Coulomb torque of nothing: the whole friction has been taken for a Stribeck drop that outlasts the top speed."""
    names = problem.names
    if "coulomb" not in names or "stribeck_velocity" not in names:
        return {}
    coulomb, drop = names.index("coulomb"), names.index("stribeck_velocity")
    if space.free[drop] and refined.unknowns[coulomb] < 1.01 * space.lower[coulomb]:
        return {drop: "the torque still falls at the top speed, which cannot be told from viscous friction"}
    return {}


def _reason(problem: Problem, k: int) -> str:
    name = problem.names[k]
    if name == "inertia":
        return "the axis hardly accelerates"
    if name in ("stribeck_velocity", "static", "exponent"):
        motion = problem.motion
        sliding = np.abs(motion.velocity[np.abs(motion.velocity) > motion.resolution])
        slow = float(np.quantile(sliding, 0.02)) if len(sliding) else 0.0
        unit = problem.axis.unit("rad/s")
        return f"no drop from static to Coulomb torque shows; slowest sliding is about {slow:.3g} {unit}"
    if name in PRESLIDING:
        return "its share of the torque at reversals does not rise above the residual"
    return "its effect on the torque does not rise above the residual"


def _notes(problem: Problem, reasons: Mapping[int, str]) -> tuple[str, ...]:
    notes = []
    if problem.inertia_index not in reasons:
        notes.append(
            "inertia and torque constant cannot be told apart: all torques are in units of the logged torque"
        )
    return tuple(notes)
