"""Identify an axis: friction law, inertia and offset from recordings, or the law alone from friction estimates."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.identify import operators, pso_ga
from tcs_friction.identify.conclusions import UNCERTAINTIES, Conclusions, refit, rms
from tcs_friction.identify.cost import AnyCost, Box, LuGreCost, SearchCost, ShapeCost
from tcs_friction.identify.determined import Verdicts, judge
from tcs_friction.identify.extended_law import search_extended
from tcs_friction.identify.linear_balance import likely_inertia
from tcs_friction.identify.models import AnyModel
from tcs_friction.identify.motion import Data, prepare
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.problem import Problem, pose, settled
from tcs_friction.identify.profile import profiles
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.refine import Refined, Space
from tcs_friction.identify.result import Identification
from tcs_friction.identify.sharpen import Sharpened, sharpen
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.identify.uncertainty import noise_floor
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law as law_named
from tcs_friction.physics.registry import offset
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.mending import mendings
from tcs_friction.recording.recording import Recording

WORSE = 1.2  # times the torque residual: predictions that raise it by more contradict the torques
NOISELESS = 1e-4  # of the torque: residuals so small bias nothing
CONTRADICTED = "predictions contradict the fit of torques, which is kept: the model lacks something"
WIDER, SHIFT_STEPS = 1.6, 4  # times the low pass' bandwidth, for another opinion; steps of its fit
SAME_VALLEY = 1.01  # times the least cost: another search that ends so near has found the same
MOST_SEARCHES = 10  # until the least cost is found twice
VALLEY_STEPS, VALLEY_GAIN = 30, 1e-3  # of the fit that ends each: steps, and the relative gain that ends it
METHODS = ("default", "pso-ga", "pso", "ga", "paper")
QUICK = SwarmOptions(
    population=48, generations=1, swarm_generations=24, genetic_generations=0, velocity_limit=0.1
)


@dataclass(frozen=True)
class IdentifyOptions:
    """What a caller may choose.

    hold_inertia: keep the axis file's. offset: allow a constant torque. loss: `squares` or `huber` (outliers count less).
    bandwidth: Hz of the low pass; None: from the position's noise. swarm: settings of the population methods;
    box: where they search. uncertainty: `sandwich`, or `bootstrap` of blocks of the residual. profile: add the profile
    likelihood of each parameter.
    """

    hold_inertia: bool = False
    offset: bool = True
    loss: str = "squares"
    bandwidth: float | None = None
    swarm: SwarmOptions = field(default_factory=SwarmOptions)
    box: Box | None = None
    uncertainty: str = "sandwich"
    profile: bool = False

    def __post_init__(self) -> None:
        if self.loss not in ("squares", "huber"):
            raise InputError("identification: loss", repr(self.loss), "squares or huber")
        if self.uncertainty not in UNCERTAINTIES:
            raise InputError("identification: uncertainty", repr(self.uncertainty), "sandwich or bootstrap")
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
    for one in data:
        if isinstance(one, Recording) and not np.ptp(one.torque) > 0.0:
            raise InputError(one.source, f"the torque is constant ({one.torque[0]:g})", "the torque applied to the axis")
    free_inertia = not options.hold_inertia and not motion.measured
    if free_inertia:
        axis = replace(axis, inertia=likely_inertia(axis.inertia, motion))
    problem = pose(axis, motion)
    free_offset = options.offset
    space = space_of(problem, free_inertia, free_offset)
    unshown: Mapping[int, str] = {}
    if axis.friction.term.extends and method == "default":
        simpler = pose(replace(axis, friction=_law_instance(axis, axis.friction.term.extends)), motion)
        shapes = ShapeCost(simpler, free_inertia, free_offset, believed_start(simpler))
        found, unknowns, unshown = search_extended(
            shapes, simpler, problem, space, seed, QUICK, options.loss, progress, cancel
        )
    else:
        cost = _cost(problem, method, free_inertia, free_offset, believed_start(problem), options)
        found, unknowns = _search(cost, problem, space, method, seed, options, progress, cancel)
    problem = settled(problem, unknowns)
    polish = method == "default" and found.outcome is not Outcome.CANCELLED
    verdicts = judge(problem, unknowns, space, believed, options.loss, polish, unshown, cancel)
    sharp = None
    if polish:
        verdicts, sharp = _sharpened(problem, verdicts, options.loss, cancel)
    refined = verdicts.refined
    shift = None
    if polish and sharp is None and motion.bandwidth > 0.0 and isinstance(problem.model, AnyModel):
        wider = prepare(data, WIDER * motion.bandwidth, despike=options.loss == "huber")
        shift = _shifted(pose(axis, wider), verdicts, options.loss)
    concluded = Conclusions(problem, verdicts, sharp, options.loss, options.uncertainty, shift)
    return Identification(
        law=axis.friction.term.id,
        method=method,
        parameters=concluded.parameters(),
        inertia=concluded.estimate(problem.inertia_index),
        offset=concluded.estimate(problem.offset_index),
        directions=concluded.directions(),
        rmse=concluded.errors(polish),
        noise_floor=noise_floor(refined.residual),
        cost=refined.cost,
        evaluations=found.evaluations + verdicts.evaluations,
        seconds=time.perf_counter() - began,
        outcome=refined.outcome if polish else found.outcome,
        history=found.history,
        fit=concluded.fit(),
        by_speed=concluded.by_speed(believed),
        correlation=concluded.correlation(),
        bound=concluded.bounds(),
        seed=seed,
        profiles=profiles(concluded, cancel) if options.profile and polish else {},
        notes=(*_mended(data), *motion.notes, *verdicts.notes),
    )


def _mended(data: Sequence[Data]) -> tuple[str, ...]:
    """What was mended in the recordings on reading them."""
    return mendings([one for one in data if isinstance(one, Recording)])


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
    problem: Problem,
    space: Space,
    method: str,
    seed: int,
    options: IdentifyOptions,
    progress: Callable[[Generation], None],
    cancel: Callable[[], bool],
) -> tuple[pso_ga.SearchResult, np.ndarray]:
    """A search and the unknowns (p,) that it found; for laws with many valleys, the best of several that were refined."""
    settings, count = {"pso-ga": options.swarm, "paper": operators.PAPER}.get(method), len(cost.box.lower)
    if method == "default":
        settings = _for_dimensions(count) if isinstance(cost, AnyCost) else QUICK
    if settings is None:
        settings = operators.alone(options.swarm, method)
    found = pso_ga.search(cost, count, seed, settings, progress=progress, cancel=cancel)
    if method != "default" or not isinstance(cost, AnyCost):
        return found, cost.unknowns(found.position)
    ends: list[tuple[pso_ga.SearchResult, Refined]] = []
    while found.outcome is not Outcome.CANCELLED:
        start = cost.unknowns(found.position)
        ends.append((found, refit(problem, start, space, options.loss, VALLEY_STEPS, VALLEY_GAIN)))
        costs = np.array([end.cost for _, end in ends])
        if np.count_nonzero(costs <= SAME_VALLEY * costs.min()) == 2 or len(ends) == MOST_SEARCHES:
            break
        found = pso_ga.search(cost, count, (seed, len(ends)), settings, progress=progress, cancel=cancel)
    if not ends:
        return found, cost.unknowns(found.position)
    best, refined = ends[int(np.argmin(costs))]
    evaluations = sum(one.evaluations + end.evaluations for one, end in ends)
    return replace(best, evaluations=evaluations, outcome=found.outcome), refined.unknowns


def _for_dimensions(count: int) -> SwarmOptions:
    """A swarm for a law whose evaluation is not cheap: no larger than its search space asks for."""
    sizes = {"population": min(40, 12 * count + 4), "swarm_generations": min(30, 8 * count + 6)}
    return replace(QUICK, **sizes, velocity_limit=1.0)


def _sharpened(
    problem: Problem, verdicts: Verdicts, loss: str, cancel: Callable[[], bool]
) -> tuple[Verdicts, Sharpened | None]:
    """The fit of predictions, where it can be made and does not contradict that of torques."""
    fine, size = problem.fine, problem.law_size + 2
    unknowns, counted = verdicts.refined.unknowns.copy(), verdicts.refined.weights > 0.0
    before = rms(verdicts.refined.residual[counted])
    if fine is None or before < NOISELESS * float(np.std(problem.target)):
        return verdicts, None
    sharp = sharpen(fine, unknowns[:size], verdicts.space.first(size), before, loss, cancel)
    if sharp is None:
        return verdicts, None
    unknowns[:size] = sharp.unknowns[:size]
    torque, jacobian = problem.linearised(unknowns)
    residual = problem.target - torque
    if not (rms(residual[counted]) < WORSE * before and sharp.sound):
        return replace(verdicts, notes=(*verdicts.notes, CONTRADICTED)), None
    cost = 0.5 * float(verdicts.refined.weights @ residual**2)
    refined = replace(verdicts.refined, unknowns=unknowns, residual=residual, jacobian=jacobian, cost=cost)
    notes = (
        *verdicts.notes,
        f"torque acts {1e3 * sharp.delay:.3g} ms after its stamp, as the predictions have it",
    )
    evaluations = verdicts.evaluations + sharp.evaluations
    return replace(verdicts, refined=refined, evaluations=evaluations, notes=notes), sharp


def _shifted(wider: Problem, verdicts: Verdicts, loss: str) -> np.ndarray:
    """(p,) By how much the unknowns move when the low pass lets more through: smoothing moves reversals, noise bends them."""
    unknowns, space = verdicts.refined.unknowns, verdicts.space
    refined = refit(
        wider, unknowns, space.holding(np.arange(len(unknowns)) > wider.offset_index), loss, SHIFT_STEPS
    )
    return np.where(np.isfinite(refined.unknowns), refined.unknowns - unknowns, 0.0)


def identified_axis(axis: Axis, found: Identification) -> Axis:
    """The axis with what was identified: friction, inertia if it was determined, a bias for a determined offset.

    A bias that the axis already has grows by the offset.
    """
    friction = instance(law_named(found.law), found.friction())
    inertia = found.inertia.value if found.inertia.determined else axis.inertia
    result = replace(axis, friction=friction, inertia=inertia)
    if not found.offset.determined:
        return result
    others = tuple(item for item in axis.effects if not item.term.offset)
    known = sum(item.values[item.term.offset] for item in axis.effects if item.term.offset)
    bias = instance(offset(), {offset().offset: known + found.offset.value})
    return replace(result, effects=(*others, bias))
