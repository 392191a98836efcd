"""What cancelling the effects of an axis model is worth on a run, predicted before anything acts.

The axis is simulated as its file describes it, under its own controller: without compensation, with the friction law's, with each
effect's beside it, and with all. How sure that is follows from draws: in each the axis has parameters drawn from their standard
deviations, while the compensator keeps those of the file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tcs_friction.control.loop import Cancellation, LoopConfig, LoopRun, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names, obstacles
from tcs_friction.control.observer import ObserverConfig
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.reference import Reference
from tcs_friction.control.shaper import NONE, ZVD, Shaper
from tcs_friction.control.swing import swing
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance

Array = NDArray[np.float64]

NOTHING, LAW, ALL, IDEAL = "nothing", "friction law", "everything", "ideal"
"""Stages: no compensation, that of the law alone, of all effects too, and an axis that has none of the effects."""
BOUNDS = (5.0, 95.0)  # percentiles of the draws

Deviations = Mapping[str, Mapping[str, float]]
"""Standard deviations of parameters, by effect and parameter."""


@dataclass(frozen=True)
class Stage:
    """One way to compensate. Errors in rad (m): rms, largest, and between which rms the draws lie (None without draws)."""

    name: str
    rms: float
    peak: float
    between: tuple[float, float] | None
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
    """The stages in the order nothing, law, each effect beside it, everything, ideal; why other effects are not cancelled.

    settle: s at the start of the run that do not count. torque: largest compensation, N m. shaping: of each effect that swings.
    """

    stages: tuple[Stage, ...]
    not_cancelled: Mapping[str, str]
    settle: float
    torque: float
    shaping: tuple[Shaping, ...] = ()

    def stage(self, name: str) -> Stage:
        """The stage of that name."""
        return next(stage for stage in self.stages if stage.name == name)


@dataclass(frozen=True)
class Task:
    """A run: the reference and its controller, temperature (degC) and exogenous signals at its ticks, the seed of all noise.

    settle: s at the start that do not count.
    """

    reference: Reference
    controller: PidConfig
    loop: LoopConfig
    observer: ObserverConfig
    temperature: Array | float = 20.0
    exogenous: Mapping[str, Array] = field(default_factory=dict)
    seed: int = 0
    settle: float = 2.0


def worth(
    model: Axis,
    task: Task,
    left_out: Mapping[str, str] = MappingProxyType({}),
    deviations: Deviations = MappingProxyType({}),
    draws: int = 16,
) -> Worth:
    """Predict what compensation of an axis model gains on a run.

    left_out: effects that are not to be cancelled, and why. Draws are made where standard deviations are known.

    Raises
    ------
    InputError: a name that is no effect of the axis, a settling time beyond the run, or a model that cannot be cancelled.
    JobError: the loop is unstable, or follows worse than an axis that stands still.
    """
    if not 0.0 <= task.settle < task.reference.duration:
        raise InputError("settle", f"{task.settle:g} s", f"less than the run's {task.reference.duration:g} s")
    why = {**obstacles(model), **left_out}
    effects = [name for name in effect_names(model) if name not in why]
    ways: dict[str, Collection[str] | None] = {NOTHING: None, LAW: ()}
    ways |= {name: (name,) for name in effects} if len(effects) > 1 else {}
    ways[ALL] = effects
    drawn = _draws(model, deviations, draws, task.seed)
    runs = {name: _run(task, model, model, chosen) for name, chosen in ways.items()}
    _follows(task, model, runs[ALL])
    spread = {
        name: np.array([_errors(task, _run(task, axis, model, chosen))[0] for axis in drawn]) for name, chosen in ways.items()
    }
    runs[IDEAL] = _run(task, _without(model, effects), model, ())
    stages = tuple(Stage(name, *_errors(task, run), _between(spread.get(name)), run) for name, run in runs.items())
    shaping = _shaping(task, model, effects, runs[ALL])
    return Worth(stages, why, task.settle, float(np.max(np.abs(runs[ALL].compensation))), shaping)


def _shaping(task: Task, model: Axis, effects: Sequence[str], run: LoopRun) -> tuple[Shaping, ...]:
    """For each body behind a spring: how it swings on this run, and on one whose reference does not excite it."""
    if task.reference.shaper.kind != NONE:
        return ()
    found = []
    for name, item in effect_names(model).items():
        if item.term.rings is None:
            continue
        shaper = Shaper(ZVD, *item.term.rings(item.values))
        shaped = _run(replace(task, reference=task.reference.shaped_unless(shaper)), model, model, effects)
        before, after = (_swing(task, one, shaper) for one in (run, shaped))
        found.append(Shaping(name, shaper, before, after))
    return tuple(found)


def _swing(task: Task, run: LoopRun, shaper: Shaper) -> tuple[float, float]:
    """Rms and largest deflection after settling."""
    return _size(task, run, swing(run.true_position, task.loop.period, shaper.frequency, shaper.damping))


def _run(task: Task, axis: Axis, model: Axis, effects: Collection[str] | None) -> LoopRun:
    """One run of an axis while these effects of a model are cancelled beside its law; None: nothing at all."""
    left_out = tuple(name for name in effect_names(model) if name not in (effects or ()))
    return simulate_loop(
        axis,
        task.reference,
        task.controller,
        replace(task.loop, compensation="none" if effects is None else "model"),
        task.observer,
        seed=task.seed,
        temperature=task.temperature,
        exogenous=task.exogenous,
        cancellation=Cancellation(model, CancellationConfig(left_out=left_out)),
    )


def _follows(task: Task, axis: Axis, run: LoopRun) -> None:
    """Refuse a controller that follows the reference worse than if the axis stood still, though all that can be is cancelled."""
    rms = _errors(task, run)[0]
    standing = _errors(task, replace(run, true_position=np.full_like(run.reference, run.reference[0])))[0]
    if 0.0 < standing < rms:
        told = f"misses the reference by {rms:.3g} rms with everything cancelled, and by {standing:.3g} if it stood still"
        raise JobError(f"axis {axis.name}", told, "a controller whose gains suit the delays and lags of the model")


def _errors(task: Task, run: LoopRun) -> tuple[float, float]:
    """Rms and largest true tracking error after settling."""
    return _size(task, run, run.reference - run.true_position)


def _size(task: Task, run: LoopRun, values: Array) -> tuple[float, float]:
    """Rms and largest of values (n,) at the ticks of a run, after settling."""
    counted = values[run.t >= task.settle]
    return float(np.sqrt(np.mean(counted**2))), float(np.max(np.abs(counted)))


def _without(axis: Axis, effects: Sequence[str]) -> Axis:
    return replace(axis, effects=tuple(item for name, item in effect_names(axis).items() if name not in effects))


def _draws(axis: Axis, deviations: Deviations, count: int, seed: int) -> list[Axis]:
    """The axis with parameters drawn from their standard deviations, within their bounds."""
    generator = np.random.default_rng(seed)
    if not any(values for values in deviations.values()):
        return []
    named = effect_names(axis)
    return [
        replace(axis, effects=tuple(_drawn(item, deviations.get(name, {}), generator) for name, item in named.items()))
        for _ in range(count)
    ]


def _drawn(item: Instance, deviations: Mapping[str, float], generator: np.random.Generator) -> Instance:
    values = {}
    for name, deviation in deviations.items():
        parameter = item.term.parameter(name)
        value = item.values[name] + deviation * float(generator.standard_normal())
        values[name] = min(max(value, parameter.lower), parameter.upper)
    return item.replace(**values) if values else item


def _between(errors: Array | None) -> tuple[float, float] | None:
    if errors is None or not len(errors):
        return None
    low, high = np.percentile(errors, BOUNDS)
    return float(low), float(high)
