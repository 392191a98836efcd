"""Identify an axis: friction law, inertia and offset from recordings, or the law alone from friction estimates."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.identify import pso_ga
from tcs_friction.identify.cost import AnyCost, Box, LuGreCost, SearchCost, ShapeCost
from tcs_friction.identify.determined import Verdicts, judge
from tcs_friction.identify.motion import Data, prepare
from tcs_friction.identify.problem import Problem, pose
from tcs_friction.identify.pso_ga import Generation, SwarmOptions
from tcs_friction.identify.refine import Outcome, Refined, Space, refine
from tcs_friction.identify.result import Errors, Estimate, Fit, Identification
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.identify.uncertainty import correlations, cramer_rao, noise_floor, sandwich
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect as effect_named
from tcs_friction.physics.registry import law as law_named
from tcs_friction.physics.terms import Instance, instance, linear_unit

LEAST_ONE_WAY = 50  # compared samples of motion one way, for a fit of their own
METHODS = ("default", "pso-ga", "pso", "ga", "paper")
QUICK = SwarmOptions(population=48, generations=1, swarm_generations=24, genetic_generations=0)
QUICK_GENERIC = SwarmOptions(population=40, generations=1, swarm_generations=30, genetic_generations=0)


@dataclass(frozen=True)
class IdentifyOptions:
    """What a caller may choose.

    hold_inertia: keep the axis file's. offset: allow a constant torque. loss: `squares` or `huber` (outliers count less).
    bandwidth: Hz of the low pass; None: from the position's noise. swarm: settings of the population methods;
    box: where they search.
    """

    hold_inertia: bool = False
    offset: bool = True
    loss: str = "squares"
    bandwidth: float | None = None
    swarm: SwarmOptions = field(default_factory=SwarmOptions)
    box: Box | None = None

    def __post_init__(self) -> None:
        if self.loss not in ("squares", "huber"):
            raise InputError("identification: loss", repr(self.loss), "squares or huber")
        if self.bandwidth is not None and not self.bandwidth > 0.0:
            raise InputError("identification: bandwidth", repr(self.bandwidth), "a positive number of Hz")


def identify(
    data: Sequence[Data],
    axis: Axis,
    method: str = "default",
    law: str | None = None,
    seed: int = 0,
    progress: Callable[[Generation], None] = lambda _: None,
    cancel: Callable[[], bool] = lambda: False,
    options: IdentifyOptions | None = None,
) -> Identification:
    """Fit a friction law, inertia and offset.

    Parameters
    ----------
    data: recordings, or friction series of an observer (then there is no inertia to find), one data set with common physics.
    axis: what is believed; its effects and known delay are taken into account, its values start the search.
    method: `default` (swarm over the shape, linear part solved for, Levenberg-Marquardt), `pso-ga`, `pso`, `ga`
        (the search alone), `paper` (pso-ga with the paper's settings).
    law: name of the law to fit; None: the axis' own.
    seed: same data, seed and settings: same result.
    progress, cancel: called once a generation.

    Raises InputError for wrong settings or data too short. A numerical outcome is part of the result.
    """
    began = time.perf_counter()
    options = options or IdentifyOptions()
    if method not in METHODS:
        raise InputError("identification: method", repr(method), nearest(method, list(METHODS)))
    believed = axis.friction.values if law in (None, axis.friction.term.id) else {}
    axis = replace(axis, friction=_law_instance(axis, law))
    motion = prepare(data, options.bandwidth, despike=options.loss == "huber")
    if not np.ptp(motion.position) > 0.0 or np.abs(motion.velocity).max() <= motion.resolution:
        raise InputError("identification", "the axis never moves", "a recording of motion")
    problem = pose(axis, motion)
    start = believed_start(problem)
    free_inertia = not options.hold_inertia and not motion.measured
    free_offset = options.offset
    cost = _cost(problem, method, free_inertia, free_offset, start, options)
    found = _search(cost, method, seed, options, progress, cancel)
    unknowns = cost.unknowns(found.position)
    space = space_of(problem, free_inertia, free_offset)
    held = _training_mask(problem)
    polish = method == "default" and found.outcome is not Outcome.CANCELLED
    verdicts = judge(problem, unknowns, space, believed, options.loss, polish, cancel)
    refined = verdicts.refined
    errors = _errors(problem, verdicts, held, options.loss, polish)
    covariance = _covariance(refined, verdicts.space.free)
    directions = _directions(problem, verdicts, options.loss) if problem.motion.reverses else {}
    evaluations = found.evaluations + verdicts.evaluations
    return Identification(
        law=axis.friction.term.id,
        method=method,
        parameters={
            p.name: _estimate(problem, verdicts, covariance, k)
            for k, p in enumerate(axis.friction.term.parameters)
        },
        inertia=_estimate(problem, verdicts, covariance, problem.inertia_index),
        offset=_estimate(problem, verdicts, covariance, problem.offset_index),
        directions=directions,
        rmse=errors,
        noise_floor=noise_floor(refined.residual),
        cost=refined.cost,
        evaluations=evaluations,
        seconds=time.perf_counter() - began,
        outcome=refined.outcome if polish else found.outcome,
        history=found.history,
        fit=_fit(problem, refined),
        correlation=_correlation(problem, verdicts, covariance),
        bound=_bounds(problem, verdicts),
        seed=seed,
        notes=(*motion.notes, *verdicts.notes),
    )


def _law_instance(axis: Axis, law: str | None) -> Instance:
    """The axis' own friction, or the named law with values that only have to be valid."""
    if law is None or law == axis.friction.term.id:
        return axis.friction
    term = law_named(law, "identification")
    known = axis.friction.values
    values = {
        p.name: known.get(p.name, p.default if p.default is not None else max(p.lower, min(1.0, p.upper)))
        for p in term.parameters
    }
    return instance(term, values)


def _cost(
    problem: Problem,
    method: str,
    free_inertia: bool,
    free_offset: bool,
    start: np.ndarray,
    options: IdentifyOptions,
) -> SearchCost:
    if problem.axis.friction.term.id != "lugre":
        return AnyCost(problem, free_inertia, free_offset, start)
    if method == "default":
        return ShapeCost(problem, free_inertia, free_offset, start)
    return LuGreCost(problem, free_inertia, free_offset, start, options.box)


def _search(
    cost: SearchCost,
    method: str,
    seed: int,
    options: IdentifyOptions,
    progress: Callable[[Generation], None],
    cancel: Callable[[], bool],
) -> pso_ga.SearchResult:
    settings = {"pso-ga": options.swarm, "paper": pso_ga.PAPER}.get(method)
    if method == "default":
        settings = QUICK_GENERIC if isinstance(cost, AnyCost) else QUICK
    if settings is None:
        settings = pso_ga.alone(options.swarm, method)
    return pso_ga.search(cost, len(cost.box.lower), seed, settings, progress=progress, cancel=cancel)


def _training_mask(problem: Problem) -> np.ndarray:
    """(m,) True for samples that train: all recordings but the last, or, with one, eight of ten blocks of it."""
    motion, centres = problem.motion, problem.thin.centres
    owner = np.asarray(motion.sources)[np.searchsorted(motion.bounds, centres, side="right") - 1]
    if len(set(motion.sources)) > 1:
        return np.asarray(owner != max(motion.sources))
    block = np.arange(len(centres)) * 10 // len(centres)
    return np.asarray(~np.isin(block, (3, 7)))


def _errors(problem: Problem, verdicts: Verdicts, training: np.ndarray, loss: str, polish: bool) -> Errors:
    """Residuals of a fit that saw only the training samples; a search without local end has seen all, and says so by both."""
    if polish:
        part = problem.masked(training)
        fitted = refine(
            part.linearised,
            part.torque,
            part.target,
            part.weights,
            verdicts.refined.unknowns,
            verdicts.space,
            loss,
            iterations=8,
        )
        residual = fitted.residual
    else:
        residual = verdicts.refined.residual
    counted = problem.weights > 0.0
    return Errors(_rms(residual[training & counted]), _rms(residual[~training & counted]))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _covariance(refined: Refined, free: np.ndarray) -> np.ndarray:
    """(p, p) with zeros for what was held."""
    index = np.flatnonzero(free)
    result = np.zeros((len(free), len(free)))
    result[np.ix_(index, index)] = sandwich(refined.jacobian[:, index], refined.residual, refined.weights)
    return result


def _unit(problem: Problem, k: int) -> str:
    declared = [p.unit for p in problem.axis.friction.term.parameters]
    rotary = [*declared, "kg m^2", "N m"][k]
    return rotary if problem.axis.kind == "rotary" else linear_unit(rotary)


def _estimate(problem: Problem, verdicts: Verdicts, covariance: np.ndarray, k: int) -> Estimate:
    reason = verdicts.reasons.get(k)
    std = float(np.sqrt(max(covariance[k, k], 0.0)))
    return Estimate(float(verdicts.refined.unknowns[k]), std, _unit(problem, k), reason is None, reason)


def _directions(problem: Problem, verdicts: Verdicts, loss: str) -> Mapping[str, Mapping[str, Estimate]]:
    """The law fitted to each direction of motion on its own; inertia and offset are those of both together."""
    result = {}
    size = problem.law_size
    law_only = np.arange(len(verdicts.space.free)) < size
    space = Space(
        verdicts.space.lower, verdicts.space.upper, verdicts.space.logarithmic, verdicts.space.free & law_only
    )
    for way, sign in (("positive", 1.0), ("negative", -1.0)):
        part = problem.masked(sign * problem.velocity > 0.0)
        if np.count_nonzero(part.weights) < LEAST_ONE_WAY:
            continue
        fitted = refine(
            part.linearised,
            part.torque,
            part.target,
            part.weights,
            verdicts.refined.unknowns,
            space,
            loss,
            iterations=20,
        )
        covariance = _covariance(fitted, space.free)
        chosen = replace(verdicts, refined=fitted)
        result[way] = {
            p.name: _estimate(part, chosen, covariance, k)
            for k, p in enumerate(problem.axis.friction.term.parameters)
        }
    return result


def _fit(problem: Problem, refined: Refined) -> Fit:
    inertia, offset = refined.unknowns[problem.inertia_index], refined.unknowns[problem.offset_index]
    rest = inertia * problem.acceleration + offset
    modelled = problem.target - refined.residual
    bounds = np.searchsorted(problem.thin.centres, problem.motion.bounds)
    return Fit(
        problem.times,
        problem.velocity,
        problem.target,
        modelled,
        problem.target - rest,
        modelled - rest,
        bounds,
    )


def _correlation(
    problem: Problem, verdicts: Verdicts, covariance: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    index = [k for k in np.flatnonzero(verdicts.space.free) if k < problem.law_size + 2]
    names = tuple(problem.names[k] for k in index)
    return names, correlations(covariance[np.ix_(index, index)])


def _bounds(problem: Problem, verdicts: Verdicts) -> dict[str, float]:
    """Cramer-Rao bound for Gaussian errors with the residual's own autocovariance."""
    refined = verdicts.refined
    residual = refined.residual[refined.weights > 0.0]
    index = np.flatnonzero(verdicts.space.free)
    if not len(residual) or not residual.any():
        return {}
    centred = residual - residual.mean()
    lags = min(len(centred) // 4, 60)
    noise = np.array([float(centred[k:] @ centred[: len(centred) - k]) for k in range(lags)]) / len(centred)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(lags) / lags)
    covariance = cramer_rao(refined.jacobian[np.ix_(refined.weights > 0.0, index)], noise * taper)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    kept = problem.law_size + 2
    return {problem.names[k]: float(std) for k, std in zip(index, deviation, strict=True) if k < kept}


def identified_axis(axis: Axis, found: Identification) -> Axis:
    """The axis with what was identified: friction, inertia if it was determined, a bias for a determined offset.

    A bias that the axis already has grows by the offset.
    """
    friction = instance(law_named(found.law), found.friction())
    inertia = found.inertia.value if found.inertia.determined else axis.inertia
    result = replace(axis, friction=friction, inertia=inertia)
    if not found.offset.determined:
        return result
    others = tuple(item for item in axis.effects if item.term.id != "torque_bias")
    known = sum(item.values["bias"] for item in axis.effects if item.term.id == "torque_bias")
    bias = instance(effect_named("torque_bias"), {"bias": known + found.offset.value})
    return replace(result, effects=(*others, bias))
