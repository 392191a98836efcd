"""Identify an axis: friction law, inertia and offset from recordings, or the law alone from friction estimates."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tcs_friction.conditioning.checks import check_torque
from tcs_friction.conditioning.motion import Data, Motion, Timing, prepare, resmoothed, timed
from tcs_friction.conditioning.noise_floor import noise_floor
from tcs_friction.errors import InputError, nearest
from tcs_friction.identify import operators, pso_ga
from tcs_friction.identify.conclusions import UNCERTAINTIES, Conclusions, refit, rms
from tcs_friction.identify.cost import AnyCost, Box, LuGreCost, SearchCost, ShapeCost
from tcs_friction.identify.determined import Verdicts, beforehand, companions, judge
from tcs_friction.identify.extended_law import search_extended
from tcs_friction.identify.fine import Fine
from tcs_friction.identify.linear_balance import likely_inertia
from tcs_friction.identify.minimum import End, end_of_search
from tcs_friction.identify.models import AnyModel
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.owed import DROP, DROPS
from tcs_friction.identify.problem import Problem, pose, settled
from tcs_friction.identify.profile import profiles
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.refine import Refined, Space
from tcs_friction.identify.result import Identification, TorqueTiming
from tcs_friction.identify.sharpen import Sharpened, sharpen
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.identify.timing import likely_timing
from tcs_friction.identify.words import AS_STATED, rising, when_torque_acts
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law as law_named
from tcs_friction.physics.registry import offset
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.mending import mendings
from tcs_friction.recording.recording import Recording

WORSE = 1.2  # times the torque residual: predictions that raise it by more contradict the torques
OCTAVE = 0.5
"""Of the low pass' frequency: a bristle that swings faster answers a step with a rate whose power lies to a third above it.

Of w^2 / ((1 - w^2)^2 + 4 d^2 w^2), 22 to 44 % lie beyond w = 2 for a damping d of 0.3 to 0.7 of the critical one.
"""
NOISELESS = 1e-4  # of the torque: residuals so small bias nothing
COLOURED = "errors of prediction are not white: the model lacks something, and its numbers stand for that, too"
CONTRADICTED = "predictions contradict the fit of torques, which is kept: the model lacks something"
WIDER, SHIFT_STEPS = 1.6, 4  # times the low pass' bandwidth, for another opinion; steps of its fit
SAME_VALLEY = 1.01  # times the least cost: another search that ends so near has found the same
DROPPING = 1.5  # static by Coulomb torque where fits of drops at other speeds start: of the paper's axis, 117.2 by 78.1 N m
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
    likelihood of each parameter. refine: a population method goes on as the default method does after its swarm.
    """

    hold_inertia: bool = False
    offset: bool = True
    loss: str = "squares"
    bandwidth: float | None = None
    swarm: SwarmOptions = field(default_factory=SwarmOptions)
    box: Box | None = None
    uncertainty: str = "sandwich"
    profile: bool = False
    refine: bool = False

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
        (the search alone), `paper` (pso-ga with the paper's settings). A search alone has intervals only where it ended at a
        minimum (`minimum.py`).
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
    known = _known_timing(data)
    motion = prepare(data, options.bandwidth, options.loss == "huber", known)
    if not np.ptp(motion.position) > 0.0 or np.abs(motion.velocity).max() <= motion.resolution:
        raise InputError("identification", "the axis never moves", "a recording of motion")
    recordings = [one for one in data if isinstance(one, Recording)]
    for one in recordings:
        check_torque(one)
    free_inertia = not options.hold_inertia and not motion.measured
    if free_inertia:
        axis = replace(axis, inertia=likely_inertia(axis.inertia, motion))
    free_timing = known is None and not motion.measured
    mended = mendings(recordings)
    task = _Task(axis, method, law, seed, options, believed, free_inertia, free_timing, mended, progress, cancel)
    found = _attempt(task, motion)
    for timing in _other_timings(task, motion, found):
        if not cancel():
            found = _likelier(found, _attempt(task, timed(motion, timing)))
    return _concluded(task, found, began)


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked for, whatever the timing of the torque. mended: in the recordings, on reading them."""

    axis: Axis
    method: str
    law: str | None
    seed: int
    options: IdentifyOptions
    believed: Mapping[str, float]
    free_inertia: bool
    free_timing: bool
    mended: tuple[str, ...]
    progress: Callable[[Generation], None]
    cancel: Callable[[], bool]


@dataclass(frozen=True, eq=False)
class _Found:
    """What came of it with one timing: the search, the judged fit of torques, that of predictions, and what is unsure beside."""

    problem: Problem
    search: pso_ga.SearchResult
    verdicts: Verdicts
    sharp: Sharpened | None
    polished: bool
    shifts: tuple[np.ndarray, ...]
    end: End


def _other_timings(task: _Task, motion: Motion, found: _Found) -> list[Timing]:
    """Timings to begin again from: that which predictions found, if the fit of torques began far off; else the likely one.

    A fit of torques with a wrong timing may end in another valley, from which predictions do not come back.
    """
    if not task.free_timing or task.method != "default":
        return []
    period = motion.grids[0].logged.period
    if found.sharp is not None and found.sharp.sound:
        late = float(found.verdicts.refined.unknowns[found.problem.lateness_index])
        return [replace(motion.timing, acts=motion.timing.acts + late)] if abs(late) > 0.75 * period else []
    likely = likely_timing(motion)
    return [likely] if abs(likely.acts - motion.timing.acts) > period else []


def _attempt(task: _Task, motion: Motion) -> _Found:
    """Search, refine and judge with the timing that a motion has."""
    axis, method, options, seed, cancel = task.axis, task.method, task.options, task.seed, task.cancel
    free_inertia, free_offset, loss = task.free_inertia, options.offset, options.loss
    problem = pose(axis, motion)
    space = space_of(problem, free_inertia, free_offset, task.free_timing)
    in_time = space.holding(np.arange(len(space.free)) == problem.lateness_index)
    unshown: Mapping[int, str] = {}
    if axis.friction.term.extends and method == "default":
        simpler = pose(replace(axis, friction=_law_instance(axis, axis.friction.term.extends)), motion)
        shapes = ShapeCost(simpler, free_inertia, free_offset, believed_start(simpler))
        found, unknowns, unshown = search_extended(
            shapes, simpler, problem, in_time, seed, QUICK, loss, task.progress, cancel
        )
    else:
        cost = _cost(problem, method, free_inertia, free_offset, believed_start(problem), options)
        found, unknowns = _search(cost, problem, in_time, method, seed, options, task.progress, cancel)
    problem = settled(problem, unknowns)
    polish = (method == "default" or options.refine) and found.outcome is not Outcome.CANCELLED
    verdicts = judge(problem, unknowns, in_time, task.believed, loss, polish, unshown, cancel)
    if not polish:
        end = end_of_search(problem, verdicts.refined, in_time, loss, found.outcome)
        return _Found(problem, found, verdicts, None, False, () if end.way is None else (end.way,), end)
    torques = verdicts
    verdicts, sharp = _sharpened(problem, verdicts, space, loss, cancel)
    shifts = []
    if sharp is not None and not sharp.sound:
        shifts.append(verdicts.refined.unknowns - torques.refined.unknowns)
    if sharp is None and motion.bandwidth > 0.0:
        if isinstance(problem.model, AnyModel):
            shifts.append(_shifted(pose(axis, resmoothed(motion, WIDER * motion.bandwidth)), verdicts, loss))
        elif CONTRADICTED in verdicts.notes:  # what the low pass takes from a bristle's motion, a narrower one takes more of
            shifts.append(_shifted(pose(axis, resmoothed(motion, motion.bandwidth / WIDER)), verdicts, loss))
        if task.free_timing:
            unsure = motion.grids[0].logged.period / math.sqrt(12.0)  # of what may be anywhere within a period
            later = timed(motion, replace(motion.timing, acts=motion.timing.acts + unsure))
            shifts.append(_shifted(pose(axis, later), verdicts, loss))
            shifts.append(_in_time(problem, verdicts, space, loss))
    end = End(True, verdicts.refined.outcome, None)
    return _Found(problem, found, verdicts, sharp, True, tuple(shifts), end)


def _likelier(one: _Found, other: _Found) -> _Found:
    """Of two timings the one whose predictions are likelier; without such, that leaves less torque."""
    if one.sharp is not None and other.sharp is not None:
        return one if one.sharp.likelier_than(other.sharp) else other
    return min(one, other, key=lambda found: found.verdicts.refined.cost)


def _concluded(task: _Task, done: _Found, began: float) -> Identification:
    """All that is said of it."""
    problem, verdicts, sharp, found, end = done.problem, done.verdicts, done.sharp, done.search, done.end
    refined, motion, options = verdicts.refined, problem.motion, task.options
    concluded = Conclusions(problem, verdicts, sharp, options.loss, options.uncertainty, done.shifts, end.minimum)
    parameters = concluded.parameters()
    timing = None if motion.measured else _timing(concluded, task.free_timing)
    period = problem.whole.grids[0].logged.period if problem.whole.grids else 0.0
    told = (*rising(task.axis, parameters), *when_torque_acts(timing, period))
    errors = concluded.errors(done.polished)
    left = [rest for rest in (errors.train, errors.held_out) if math.isfinite(rest)]
    return Identification(
        law=task.axis.friction.term.id,
        method=task.method,
        parameters=parameters,
        inertia=concluded.estimate(problem.inertia_index),
        offset=concluded.estimate(problem.offset_index),
        directions=concluded.directions(),
        rmse=errors,
        noise_floor=min(noise_floor(refined.residual), *left),
        cost=refined.cost,
        evaluations=found.evaluations + verdicts.evaluations,
        seconds=time.perf_counter() - began,
        outcome=end.outcome,
        history=found.history,
        evaluated=found.evaluated,
        minimum=end.minimum,
        fit=concluded.fit(),
        by_speed=concluded.by_speed(task.believed),
        correlation=concluded.correlation(),
        bound=concluded.bounds(),
        seed=task.seed,
        profiles=profiles(concluded, task.cancel) if options.profile and done.polished else {},
        notes=(*task.mended, *motion.notes, *verdicts.notes, *end.notes, *told),
        timing=timing,
        noise=None if sharp is None else sharp.noise,
    )


def _known_timing(data: Sequence[Data]) -> Timing | None:
    """The timing that all recordings state; None where one does not."""
    stated = {item.acts for item in data if isinstance(item, Recording)}
    acts = stated.pop() if len(stated) == 1 else None
    return None if acts is None else Timing(acts)


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
    if method == "default" and isinstance(cost, ShapeCost) and found.outcome is not Outcome.CANCELLED:
        return _other_drop(cost, found, problem, space, options.loss)
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


def _other_drop(
    cost: ShapeCost, found: pso_ga.SearchResult, problem: Problem, space: Space, loss: str
) -> tuple[pso_ga.SearchResult, np.ndarray]:
    """A search and what it found, or a drop of friction at another speed that a fit of all samples leads lower from.

    A search sees a part of the samples, and no static friction below Coulomb's; a fit goes to what is near, not to what is best.
    """
    coulomb, static, drop = (problem.names.index(name) for name in ("coulomb", "static", DROP))
    slow, top = (bound[cost.box.names.index(DROP)] for bound in (cost.box.lower, cost.box.upper))
    first = cost.unknowns(found.position)
    others = np.tile(first, (DROPS, 1))
    others[:, drop], others[:, static] = np.geomspace(slow, top, DROPS + 2)[1:-1], DROPPING * first[coulomb]
    ends = [refit(problem, start, space, loss, VALLEY_STEPS, VALLEY_GAIN) for start in (first, *others)]
    costs = np.array([end.cost for end in ends])
    evaluations = found.evaluations + sum(end.evaluations for end in ends)
    lower = SAME_VALLEY * costs.min() < costs[0]
    return replace(found, evaluations=evaluations), ends[int(np.argmin(costs))].unknowns if lower else first


def _for_dimensions(count: int) -> SwarmOptions:
    """A swarm for a law whose evaluation is not cheap: no larger than its search space asks for."""
    sizes = {"population": min(40, 12 * count + 4), "swarm_generations": min(30, 8 * count + 6)}
    return replace(QUICK, **sizes, velocity_limit=1.0)


def _sharpened(
    problem: Problem, verdicts: Verdicts, space: Space, loss: str, cancel: Callable[[], bool]
) -> tuple[Verdicts, Sharpened | None]:
    """The fit of predictions, where it can be made and does not contradict that of torques."""
    fine, torques = problem.fine, _Torques(problem, verdicts, space, loss)
    if fine is None or torques.left < NOISELESS * float(np.std(problem.target)):
        return verdicts, None
    sharp, held = _predicted(fine, torques, cancel)
    if sharp is None:
        return verdicts, None
    refined = torques.refitted(sharp)
    if sharp.hopeless or torques.contradict(sharp, refined):
        return replace(verdicts, notes=(*verdicts.notes, CONTRADICTED)), None
    freed = np.flatnonzero(~held & ~verdicts.space.free)
    reasons = {k: reason for k, reason in verdicts.reasons.items() if k not in freed}
    return replace(
        verdicts, refined=refined, space=space.holding(held),
        evaluations=verdicts.evaluations + sharp.evaluations,
        notes=verdicts.notes if sharp.sound else (*verdicts.notes, COLOURED), reasons=reasons,
        owed=verdicts.owed if reasons else np.zeros_like(verdicts.owed),
    ), sharp  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Torques:
    """A judged fit of torques, which predictions start from and must not contradict. space: where its unknowns may go."""

    problem: Problem
    verdicts: Verdicts
    space: Space
    loss: str

    @property
    def left(self) -> float:
        """N m rms, of the torque."""
        return rms(self._counted(self.verdicts.refined))

    def _counted(self, refined: Refined) -> np.ndarray:
        return refined.residual[self.verdicts.refined.weights > 0.0]

    def refitted(self, sharp: Sharpened, gain: float | None = None) -> Refined:
        """What law, inertia, offset and lateness of predictions leave of the torque, with the states that go with them.

        gain: relative, of a step that ends it.
        """
        size, unknowns = self.problem.states_index, self.verdicts.refined.unknowns.copy()
        unknowns[:size] = sharp.unknowns[:size]
        held = np.arange(len(unknowns)) < size
        return refit(self.problem, unknowns, self.space.holding(held), self.loss, VALLEY_STEPS, gain)

    def ruled_out(self, sharp: Sharpened) -> bool:
        """Whether predictions in time, with the law of the torques, leave more of the torque. Bent torques do not tell it."""
        return not self._bent(sharp) and not self._explained(self.refitted(sharp, VALLEY_GAIN))

    def hopeless(self, sharp: Sharpened) -> bool:
        """Whether predictions that are under way leave more of the torque, however that is told: the law is another."""
        return not self._explained(self.refitted(sharp, VALLEY_GAIN)) and not (self._bent(sharp) and self._undisturbed(sharp))

    def contradict(self, sharp: Sharpened, refined: Refined) -> bool:
        """Whether predictions leave more of the torque. Where that is bent, sound ones leave the disturbance that they need.

        refined: `refitted` of them.
        """
        return not (self._undisturbed(sharp) if self._bent(sharp) and sharp.sound else self._explained(refined))

    def _bent(self, sharp: Sharpened) -> bool:
        """Whether bristles swing about as fast as the low pass lets through: it bends what a model makes of the motion."""
        return sharp.aim.swing > OCTAVE * 2.0 * math.pi * self.problem.motion.bandwidth

    def _explained(self, refined: Refined) -> bool:
        return rms(self._counted(refined)) < WORSE * self.left

    def _undisturbed(self, sharp: Sharpened) -> bool:
        return sharp.disturbance(self.problem.motion.bandwidth) < WORSE * self.left


def _predicted(fine: Fine, torques: _Torques, cancel: Callable[[], bool]) -> tuple[Sharpened | None, np.ndarray]:
    """The fit of predictions, and which unknowns (p,) it holds: those that neither torques nor predictions determine."""
    problem, verdicts, space = torques.problem, torques.verdicts, torques.space
    unknowns, size, names = verdicts.refined.unknowns, problem.states_index, problem.names
    held = ~verdicts.space.free
    held[problem.lateness_index] = False
    bent = DROP in names and names.index(DROP) in verdicts.reasons  # what trades with a drop: `owed` tries others
    ruled_out = beforehand(problem, space)
    untold = [] if bent else [k for k in np.flatnonzero((held & space.free)[:size]).tolist() if k not in ruled_out]

    def from_start(start: np.ndarray) -> Sharpened | None:
        where = space.holding(held).first(size)
        return sharpen(fine, start[:size], where, torques, torques.loss, cancel)

    if untold:
        held[untold] = False
        start = unknowns.copy()
        start[untold] = np.clip(start[untold], 1.01 * space.lower[untold], space.upper[untold] / 1.01)
        sharp = from_start(start)
        unsure = dict.fromkeys((k for k in untold if sharp is None or not sharp.tells(k)), "")
        held[[*unsure, *companions(problem, unsure)]] = True
        if sharp is None or sharp.hopeless or not unsure:
            return sharp, held
    return from_start(unknowns), held


def _timing(concluded: Conclusions, free: bool) -> TorqueTiming:
    """When the torque acts: the timing of the motion and the lateness that was found on top."""
    problem, sharp = concluded.problem, concluded.sharp
    timing, late = problem.motion.timing, concluded.estimate(problem.lateness_index)
    untold = None if sharp is not None else "no predictions were made that tell it"
    reason = untold if free else AS_STATED
    acts = replace(late, value=timing.acts + late.value, determined=reason is None, reason=reason)
    between = timing.between if sharp is None else sharp.aim.fine.between
    return TorqueTiming(acts, problem.axis.actuation_delay, between.value)


def _shifted(wider: Problem, verdicts: Verdicts, loss: str) -> np.ndarray:
    """(p,) By how much the unknowns move when the low pass lets more through: smoothing moves reversals, noise bends them."""
    unknowns, space = verdicts.refined.unknowns, verdicts.space
    refined = refit(
        wider, unknowns, space.holding(np.arange(len(unknowns)) >= wider.states_index), loss, SHIFT_STEPS
    )
    return np.where(np.isfinite(refined.unknowns), refined.unknowns - unknowns, 0.0)


def _in_time(problem: Problem, verdicts: Verdicts, space: Space, loss: str) -> np.ndarray:
    """(p,) By how much the unknowns move at the timing that leaves least torque; a controller's answers to noise bend it, too."""
    unknowns, late = verdicts.refined.unknowns, np.arange(len(space.free)) == problem.lateness_index
    freed = replace(verdicts.space, free=verdicts.space.free | (late & space.free))
    refined = refit(problem, unknowns, freed, loss, VALLEY_STEPS)
    return np.where(np.isfinite(refined.unknowns) & ~late, refined.unknowns - unknowns, 0.0)


def identified_axis(axis: Axis, found: Identification) -> Axis:
    """The axis with what was identified: friction, inertia if it was determined, a bias for a determined offset.

    A bias that the axis already has grows by the offset.
    """
    friction = instance(law_named(found.law), found.friction())
    inertia = found.inertia.value if found.inertia.determined else axis.inertia
    result = _with_noise(replace(axis, friction=friction, inertia=inertia), found)
    if not found.offset.determined:
        return result
    others = tuple(item for item in axis.effects if not item.term.offset)
    known = sum(item.values[item.term.offset] for item in axis.effects if item.term.offset)
    bias = instance(offset(), {offset().offset: known + found.offset.value})
    return replace(result, effects=(*others, bias))


def _with_noise(axis: Axis, found: Identification) -> Axis:
    """The axis with the noise that was found of its drive, and of an encoder of which nothing is believed."""
    if found.noise is None:
        return axis
    drive = replace(axis.drive, noise=found.noise.drive, noise_bandwidth=found.noise.bandwidth)
    silent = not axis.sensors.noise and not axis.sensors.resolution
    return replace(axis, drive=drive, sensors=replace(axis.sensors, noise=found.noise.encoder) if silent else axis.sensors)
