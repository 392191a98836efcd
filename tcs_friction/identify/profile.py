"""Profile likelihood: how much worse the data are explained where one parameter is held off its estimate and the others give way.

It needs no normal distribution: an interval is asymmetric, or open, where the data are (Venzon and Moolgavkar 1988).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tcs_friction.identify.conclusions import Conclusions
from tcs_friction.identify.refine import Refined, Space, refine
from tcs_friction.identify.result import Profile
from tcs_friction.identify.uncertainty import curvature_inverse

REACH = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)  # standard deviations at which a parameter is held
CHI_95 = 1.96  # square root of the 95 % quantile of chi squared with one degree of freedom
ITERATIONS = 8


def profiles(concluded: Conclusions, cancel: Callable[[], bool] = lambda: False) -> dict[str, Profile]:
    """Of every determined parameter of the law, of inertia and offset, by name."""
    size = concluded.problem.law_size + 2
    fit, space = concluded.end
    names = concluded.problem.names
    return {
        names[k]: _profile(concluded, fit, space, k)
        for k in np.flatnonzero(space.free[:size]).tolist()
        if k not in concluded.verdicts.reasons and not cancel()
    }


def _profile(concluded: Conclusions, fit: Refined, space: Space, k: int) -> Profile:
    index = np.flatnonzero(space.free)
    inverse = curvature_inverse(fit.jacobian[:, index], fit.weights)
    if concluded.sharp is not None:
        whole = np.zeros((len(fit.unknowns), len(fit.unknowns)))
        whole[np.ix_(index, index)] = inverse
        inverse = concluded.sharp.covariance_as_seen(whole)[np.ix_(index, index)]
    place = int(np.flatnonzero(index == k)[0])
    std = math.sqrt(concluded.covariance[k, k])
    scale = inverse[place, place] / std**2  # from cost to likelihood, residuals as coloured as they are
    trend = inverse[:, place] / inverse[place, place]
    centre = float(fit.unknowns[k])
    values, rise = [centre], [0.0]
    for far in REACH:
        value = centre * math.exp(far * std / centre) if space.logarithmic[k] else centre + far * std
        if not space.lower[k] <= value <= space.upper[k]:
            continue
        start = fit.unknowns.copy()
        start[index] += trend * (value - centre)
        start[k] = value
        cost = _held(concluded, start, space, k).cost
        values.append(value)
        rise.append(max(2.0 * (cost - fit.cost) * scale, 0.0))
    order = np.argsort(values)
    sorted_values, sorted_rise = np.array(values)[order], np.array(rise)[order]
    return Profile(sorted_values, sorted_rise, _interval(sorted_values, sorted_rise, centre))


def _held(concluded: Conclusions, start: np.ndarray, space: Space, k: int) -> Refined:
    aim = concluded.aim
    held = space.holding(np.arange(len(space.free)) == k)
    return refine(
        aim.linearised, aim.evaluated, aim.target, aim.weights, start, held, concluded.loss, ITERATIONS, 1e-7
    )


def _interval(values: np.ndarray, rise: np.ndarray, centre: float) -> tuple[float | None, float | None]:
    """Where the signed root of the rise crosses its 95 % quantile."""
    root = np.sign(values - centre) * np.sqrt(rise)
    root = np.maximum.accumulate(root)
    ends = [float(np.interp(far, root, values)) for far in (-CHI_95, CHI_95)]
    return (ends[0] if root[0] <= -CHI_95 else None, ends[1] if root[-1] >= CHI_95 else None)
