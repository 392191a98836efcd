"""What cancelling the friction law and the effects of an axis model is worth on a run, predicted before anything acts.

The axis is simulated under its controller: without compensation, with the friction law's, with each effect's beside it, and with
all. A compensator has the numbers of the file, while those of the axis are known within a spread only. So the prediction is made
of draws: in each, axis and controller have numbers drawn from that spread, and noise of drive and encoder is another. A stage is
its median over the draws and its 90 % interval; its gain is taken within each draw, where the axis is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, Wanted, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names, obstacles
from tcs_friction.control.observer import ObserverConfig
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.reference import Reference
from tcs_friction.control.shaper import NONE, ZVD, Shaper
from tcs_friction.control.spread import Spread, drawn
from tcs_friction.control.swing import swing
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics.axis import Axis

Array = NDArray[np.float64]
Interval = tuple[float, float]

NOTHING, LAW, ALL = "nothing", "friction law", "everything"
"""Stages: no compensation, that of the law alone, of all effects too."""
BOUNDS = (5.0, 95.0)
"""Percentiles of the draws. Of n draws the r-th smallest is exceeded by a further one with the probability 1 - r / (n + 1)."""
LEAST_DRAWS = 19
"""Between the least and the greatest of n draws a further one lies with the probability (n - 1) / (n + 1): 90 %."""


class Errors(NamedTuple):
    """Tracking errors of a run after settling, rad (m): rms and largest true one, rms of the one that the encoder shows."""

    rms: float
    peak: float
    measured: float


@dataclass(frozen=True)
class Stage:
    """One way to compensate. Errors in rad (m), as in `Errors`; gain, measured_gain: rms and measured rms over those without
    compensation.

    Values are medians over the draws; `_between` are 90 % intervals, None without draws. run: the draw in which the last stage
    has its median.
    """

    name: str
    rms: float
    peak: float
    measured: float
    gain: float
    measured_gain: float
    between: Interval | None
    measured_between: Interval | None
    gain_between: Interval | None
    measured_gain_between: Interval | None
    run: LoopRun


@dataclass(frozen=True)
class Shaping:
    """What a shaped reference is worth to a body behind a spring, which the encoder does not see.

    swing, shaped: rms and peak (rad, m) of its deflection from the shaft on the run as it is and on the shaped one.
    """

    effect: str
    shaper: Shaper
    swing: tuple[float, float]
    shaped: tuple[float, float]


@dataclass(frozen=True)
class Worth:
    """The stages in the order nothing, law, each effect beside it, everything; why other effects are not cancelled.

    Without effects to cancel the law is the last. settle: s at the start of the run that do not count. torque: largest
    compensation, N m. shaping: of each effect that swings. draws: how many. beyond: rms with all effects over that with the law
    alone and its 90 % interval, taken within each draw.
    """

    stages: tuple[Stage, ...]
    not_cancelled: Mapping[str, str]
    settle: float
    torque: float
    shaping: tuple[Shaping, ...] = ()
    draws: int = 0
    beyond: tuple[float, Interval | None] | None = None

    def stage(self, name: str) -> Stage:
        """The stage of that name."""
        return next(stage for stage in self.stages if stage.name == name)


@dataclass(frozen=True)
class Task:
    """A run: the reference and its controller, temperature (degC) and exogenous signals at its ticks, the seed of all noise.

    settle: s at the start that do not count.
    """

    reference: Wanted
    controller: PidConfig
    loop: LoopConfig
    observer: ObserverConfig
    temperature: Array | float = 20.0
    exogenous: Mapping[str, Array] = field(default_factory=dict)
    seed: int = 0
    settle: float = 2.0


@dataclass(frozen=True)
class Beside:
    """The tracking error of a recording beside the simulated one of the stage that it shows: rms by the encoder, rad (m)."""

    stage: str
    recorded: float
    simulated: float
    between: Interval | None

    @property
    def agrees(self) -> bool | None:
        """Whether the recorded error lies in the simulated one's 90 % interval; None where it has none."""
        return None if self.between is None else self.between[0] <= self.recorded <= self.between[1]


class _Case(NamedTuple):
    """What could be true: an axis, its controller, and the seed of the noise."""

    axis: Axis
    controller: PidConfig
    seed: int


def worth(
    model: Axis,
    task: Task,
    left_out: Mapping[str, str] = MappingProxyType({}),
    spread: Spread | None = None,
    draws: int = LEAST_DRAWS,
    progress: Callable[[float], None] = lambda _: None,
) -> Worth:
    """Predict what compensation of an axis model gains on a run.

    left_out: effects that are not to be cancelled, and why. spread: of the model's numbers. draws: 0 for the model as it is.
    progress: is told the share that is done.

    Raises
    ------
    InputError: a name that is no effect of the axis, a settling time beyond the run, or a model that cannot be cancelled.
    JobError: the loop is unstable, or follows worse than an axis that stands still.
    """
    if not 0.0 <= task.settle < task.reference.duration:
        raise InputError("settle", f"{task.settle:g} s", f"less than the run's {task.reference.duration:g} s")
    why = {**obstacles(model), **left_out}
    ways = _ways(model, why)
    itself = _Case(model, task.controller, task.seed)
    last = list(ways)[-1]
    runs = {last: _run(task, itself, model, ways[last])}
    _follows(task, model, runs[last])
    cases, middle = _cases(model, task, spread, draws), itself
    found = np.empty((len(cases), len(ways), len(Errors._fields)))
    for k, case in enumerate(cases):
        found[k] = [_errors(task, _run(task, case, model, chosen)) for chosen in ways.values()]
        progress((k + 1) / len(cases))
    if cases:
        middle, runs = cases[int(np.argsort(found[:, -1, 0], kind="stable")[(len(cases) - 1) // 2])], {}
    runs = {name: runs.get(name) or _run(task, middle, model, chosen) for name, chosen in ways.items()}
    if not cases:
        found = np.array([[_errors(task, run) for run in runs.values()]])
    stages = tuple(_stage(name, found[:, k], found[:, 0], run) for k, (name, run) in enumerate(runs.items()))
    beyond = found[:, -1, 0] / np.maximum(found[:, 1, 0], np.finfo(float).tiny)
    return Worth(
        stages,
        why,
        task.settle,
        float(np.max(np.abs(runs[last].compensation))),
        _shaping(task, model, ways[last] or (), middle, runs[last]),
        len(cases),
        (float(np.median(beyond)), _between(beyond)) if ALL in ways else None,
    )


def shown_error(
    model: Axis,
    task: Task,
    stage: str,
    left_out: Mapping[str, str],
    spread: Spread | None,
    draws: int,
    known: Worth | None = None,
) -> tuple[float, Interval | None]:
    """Rms of the error that the encoder shows (rad, m) on a run in one stage of compensation, and its 90 % interval.

    known: what compensation is worth on the same run, where that has been computed.
    """
    if known is not None:
        same = next((one for one in known.stages if one.name == stage), known.stage(LAW))
        return same.measured, same.measured_between
    chosen = _way(model, stage, left_out)
    cases = _cases(model, task, spread, draws) or [_Case(model, task.controller, task.seed)]
    found = np.array([_errors(task, _run(task, case, model, chosen)).measured for case in cases])
    return float(np.median(found)), _between(found)


def compensation_along(model: Axis, task: Task, stage: str, left_out: Mapping[str, str]) -> tuple[Array, Array]:
    """Ticks (n,), s, and the torque (n,), N m, that compensation adds on a run in one stage."""
    run = _run(task, _Case(model, task.controller, task.seed), model, _way(model, stage, left_out))
    return run.t, run.compensation


def _way(model: Axis, stage: str, left_out: Mapping[str, str]) -> Collection[str] | None:
    """Which effects a stage cancels beside the law; everything is the law where nothing else can be cancelled."""
    ways = _ways(model, {**obstacles(model), **left_out})
    return ways.get(stage, ways[LAW])


def _ways(model: Axis, why: Mapping[str, str]) -> dict[str, Collection[str] | None]:
    """Which effects are cancelled beside the law in each stage; None: not even the law."""
    effects = [name for name in effect_names(model) if name not in why]
    ways: dict[str, Collection[str] | None] = {NOTHING: None, LAW: ()}
    ways |= {name: (name,) for name in effects} if len(effects) > 1 else {}
    return ways | ({ALL: effects} if effects else {})


def _cases(model: Axis, task: Task, spread: Spread | None, count: int) -> list[_Case]:
    """What could be true by the spread, each with noise of its own."""
    seeds = np.random.SeedSequence(task.seed).generate_state(max(count, 1)).tolist()
    found = drawn(model, task.controller, spread or Spread(), count, task.seed)
    return [_Case(axis, controller, seed) for (axis, controller), seed in zip(found, seeds, strict=False)]


def _stage(name: str, found: Array, nothing: Array, run: LoopRun) -> Stage:
    """Of the errors (d, 3) in each draw, and those without compensation."""
    gains = found[:, [0, 2]] / np.maximum(nothing[:, [0, 2]], np.finfo(float).tiny)
    rms, peak, measured, gain, measured_gain = np.median(np.hstack([found, gains]), axis=0).tolist()
    between, measured_between = (_between(found[:, column]) for column in (0, 2))
    gain_between, measured_gain_between = (_between(column) for column in gains.T)
    return Stage(
        name, rms, peak, measured, gain, measured_gain, between, measured_between, gain_between, measured_gain_between, run
    )


def _between(values: Array) -> Interval | None:
    """Between which a further draw lies with 90 %; None of a single one."""
    if len(values) < 2:
        return None
    low, high = np.percentile(values, BOUNDS, method="weibull")
    return float(low), float(high)


def _shaping(task: Task, model: Axis, effects: Collection[str], case: _Case, run: LoopRun) -> tuple[Shaping, ...]:
    """For each body behind a spring: how it swings on this run, and on one whose reference does not excite it."""
    reference = task.reference
    if not isinstance(reference, Reference) or reference.shaper.kind != NONE:
        return ()
    found = []
    for name, item in effect_names(model).items():
        if item.term.rings is None:
            continue
        shaper = Shaper(ZVD, *item.term.rings(item.values))
        shaped = _run(replace(task, reference=reference.shaped_unless(shaper)), case, model, effects)
        before, after = (_swing(task, one, shaper) for one in (run, shaped))
        found.append(Shaping(name, shaper, before, after))
    return tuple(found)


def _swing(task: Task, run: LoopRun, shaper: Shaper) -> tuple[float, float]:
    """Rms and largest deflection after settling."""
    return _size(task, run, swing(run.true_position, task.loop.period, shaper.frequency, shaper.damping))


def _run(task: Task, case: _Case, model: Axis, effects: Collection[str] | None) -> LoopRun:
    """One run of an axis while these effects of a model are cancelled beside its law; None: nothing at all."""
    left_out = tuple(name for name in effect_names(model) if name not in (effects or ()))
    return simulate_loop(
        case.axis,
        task.reference,
        case.controller,
        replace(task.loop, compensation="none" if effects is None else "model"),
        task.observer,
        seed=case.seed,
        temperature=task.temperature,
        exogenous=task.exogenous,
        cancellation=Cancellation(model, CancellationConfig(left_out=left_out)),
    )


def _follows(task: Task, axis: Axis, run: LoopRun) -> None:
    """Refuse a controller that follows the reference worse than if the axis stood still, though all that can be is cancelled."""
    rms = _errors(task, run).rms
    standing = _errors(task, replace(run, true_position=np.full_like(run.reference, run.reference[0]))).rms
    if 0.0 < standing < rms:
        told = f"misses the reference by {rms:.3g} rms with everything cancelled, and by {standing:.3g} if it stood still"
        raise JobError(f"axis {axis.name}", told, "a controller whose gains suit the delays and lags of the model")


def _errors(task: Task, run: LoopRun) -> Errors:
    """Tracking errors after settling."""
    return Errors(*_size(task, run, run.reference - run.true_position), _size(task, run, run.error)[0])


def _size(task: Task, run: LoopRun, values: Array) -> tuple[float, float]:
    """Rms and largest of values (n,) at the ticks of a run, after settling."""
    counted = values[run.t >= task.settle]
    return float(np.sqrt(np.mean(counted**2))), float(np.max(np.abs(counted)))
