"""What determined numbers owe to undetermined ones.

A fit that holds what the data do not determine finds the rest as sure as if that were known. It is not: an undetermined
unknown may be anything up to what takes over all of the torque. Given that width it is part of the fit as one that is known
no better (a prior in the sense of Bayes), and what could trade torque with it is as unsure as it is.

A Stribeck velocity is not linear enough for that. The fit is made anew with others, up to beyond the speeds that were recorded;
where the recording is explained as well, the difference counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.identify.problem import Problem
from tcs_friction.identify.refine import Refined, Space, refine
from tcs_friction.identify.uncertainty import independent_samples

DROP = "stribeck_velocity"
DROPS = 3  # other Stribeck velocities that are tried
BEYOND = 10.0  # times the top speed, up to which they lie
DROPPED = 0.5  # times the Coulomb torque found, where their fits start
STEPS, GAIN = 8, 1e-4  # of each of these fits, and the relative gain that ends it
CHI_95 = 3.84  # 95 % quantile of chi squared with one degree of freedom
LEAST_PART = 0.1  # of a variance: an unknown that has less of it is not worth a word


@dataclass(frozen=True, eq=False)
class Owed:
    """directions (d, p): standard deviations in which unknowns move together. owners (d,): the undetermined unknown of each."""

    directions: np.ndarray
    owners: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """(p, p)"""
        return np.asarray(self.directions.T @ self.directions)

    def creditors(self, k: int) -> list[int]:
        """The undetermined unknowns to which unknown k owes most of its variance."""
        part = self.directions[:, k] ** 2
        return sorted(set(self.owners[part > LEAST_PART * part.sum()].tolist()))


def owed(
    problem: Problem,
    found: Refined,
    space: Space,
    undetermined: Sequence[int],
    loss: str,
    cancel: Callable[[], bool] = lambda: False,
) -> tuple[Owed, int]:
    """What a fit owes to unknowns that are undetermined, and evaluations. space: what may move, nothing held for want of data."""
    counted = found.weights > 0.0
    if not undetermined or not found.residual[counted].any():
        return Owed(np.zeros((0, len(found.unknowns))), np.zeros(0, dtype=int)), 0
    residual = found.residual[counted]
    independent = independent_samples(residual)
    directions = _traded(problem, found, space, undetermined, 2.0 * found.cost / independent)
    owners, evaluations = list(undetermined), 0
    if DROP in problem.names and problem.names.index(DROP) in undetermined and not cancel():
        drop = problem.names.index(DROP)
        moved, evaluations = _other_drops(problem, found, space, drop, independent, loss)
        directions, owners = np.vstack([directions, moved]), [*owners, *[drop] * len(moved)]
    return Owed(directions, np.array(owners)), evaluations


def _traded(
    problem: Problem, found: Refined, space: Space, undetermined: Sequence[int], power: float
) -> np.ndarray:
    """(d, p) How far all move with each undetermined one, which moves as far as data and torque let it.

    power: squared error of an independent sample.
    """
    root = np.sqrt(found.weights)
    size = float(np.sqrt(np.sum(found.weights * problem.target**2)))
    slopes = found.jacobian * root[:, None]
    lengths = np.linalg.norm(slopes, axis=0)
    kept = np.flatnonzero(space.free & (lengths > 0.0) & ~np.isin(np.arange(len(lengths)), undetermined))
    result = np.zeros((len(undetermined), len(lengths)))
    for row, k in enumerate(undetermined):
        if not lengths[k] > 0.0:
            continue
        shares, *_ = np.linalg.lstsq(slopes[:, kept] / lengths[kept], slopes[:, k], rcond=None)
        apart = slopes[:, k] - slopes[:, kept] / lengths[kept] @ shares
        width = 1.0 / math.hypot(float(np.linalg.norm(apart)) / math.sqrt(power), lengths[k] / size)
        result[row, kept], result[row, k] = -width * shares / lengths[kept], width
    return result


def _other_drops(
    problem: Problem, found: Refined, space: Space, drop: int, independent: float, loss: str
) -> tuple[np.ndarray, int]:
    """(0 or 1, p) The farthest that the unknowns move where a drop at another speed explains the recording as well."""
    speeds = np.abs(problem.velocity[found.weights > 0.0])
    speeds = speeds[speeds > problem.motion.resolution]
    if not len(speeds):
        return np.zeros((0, len(found.unknowns))), 0
    start, upper = found.unknowns.copy(), space.upper.copy()
    upper[drop] = BEYOND * speeds.max()
    space = replace(space, upper=upper).holding(np.arange(len(upper)) == drop)
    start[problem.names.index("coulomb")] *= DROPPED
    observed = problem.target, problem.weights
    ends, evaluations = [], 0
    for velocity in np.geomspace(np.quantile(speeds, 0.02), upper[drop], DROPS):
        start[drop] = velocity
        end = refine(problem.linearised, problem.torque, *observed, start, space, loss, STEPS, GAIN)
        evaluations += end.evaluations
        ends.append(end)
    worst = min(found.cost, *(end.cost for end in ends)) * math.exp(CHI_95 / independent)
    moved = np.array([end.unknowns - found.unknowns for end in ends if end.cost <= worst])
    if not len(moved):
        return np.zeros((0, len(found.unknowns))), evaluations
    return moved[np.abs(moved).argmax(axis=0), np.arange(moved.shape[1])][None, :], evaluations
