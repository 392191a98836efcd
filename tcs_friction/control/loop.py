"""The closed loop offline: axis, controller, observer and compensator in one compiled loop.

A tick at t[k] reads the measurement, updates the observer with the torque held since t[k-1], the compensator
and the controller with the reference at t[k], and holds the new torque until t[k+1]: the same order, the same
kernels and so the same numbers as the nodes in lock-step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from tcs_friction.control.compensator import (
    STATES,
    CompensatorConfig,
    compensator_parameters,
    lugre_step,
    stribeck_step,
)
from tcs_friction.control.config_field import choice, setting, switch, validate
from tcs_friction.control.model_compensator import (
    CancellationConfig,
    ModelCompensator,
    check_drive,
    check_model,
)
from tcs_friction.control.observer import REST, ObserverConfig, observer_step, pack
from tcs_friction.control.pid import STATES as PID_STATES
from tcs_friction.control.pid import PidConfig, pid_parameters, pid_step
from tcs_friction.control.position_correction import PositionCorrection, correct
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.simulate import NOISE_BLOCK, Simulator, substeps_for
from tcs_friction.physics.terms import TEMPERATURE, instance

Array = NDArray[np.float64]

_NEGLIGIBLE = 1e-9  # N m, dry friction of an axis whose friction is switched off


class Wanted(Protocol):
    """What a loop needs of a reference: a `Reference`, or another course over time."""

    @property
    def duration(self) -> float: ...
    def over(self, times: ArrayLike) -> Array: ...


PlantMaker = Callable[[Axis, float, int, float], Simulator]
"""Makes what stands in for the simulated axis, of the axis, the period (s), a seed and the position (rad) at which it begins."""
COMPENSATIONS = ("none", "lugre", "stribeck", "model")


@dataclass(frozen=True)
class LoopConfig:
    """How the loop runs: what is compensated and fed back."""

    period: float = setting(1e-3, "s", 1e-5, 1.0, "control period")
    compensation: str = choice("none", COMPENSATIONS, "feed-forward of friction added to the command")
    feed_back: bool = switch(False, "add the observer's estimate of friction that is not yet cancelled")

    def validate(self, where: str = "loop") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)


@dataclass(frozen=True)
class Cancellation:
    """Compensation `model`: the axis model whose terms are cancelled, and which of them by how much."""

    model: Axis
    config: CancellationConfig = field(default_factory=CancellationConfig)


@dataclass(frozen=True)
class LoopRun:
    """What happened, each array (n,), read-only, at the ticks t. SI units.

    `torque` is the one applied (saturated) during the tick that ends at t, `compensation` the compensator's
    part of it; `position` and `velocity` are measured at t, without the encoder's errors that a model knows;
    `friction` and `opposing` are the plant's own.
    """

    t: Array
    reference: Array
    reference_velocity: Array
    position: Array
    velocity: Array
    torque: Array
    compensation: Array
    friction_estimate: Array
    rest_estimate: Array
    friction: Array
    opposing: Array
    true_position: Array
    true_velocity: Array

    def __post_init__(self) -> None:
        for entry in fields(self):
            getattr(self, entry.name).setflags(write=False)

    @property
    def error(self) -> Array:
        """Tracking error: reference less measured position (rad)."""
        return self.reference - self.position


def without_friction(axis: Axis) -> Axis:
    """The same axis with friction switched off, all its other effects kept."""
    nothing = instance(law("coulomb_viscous"), {"coulomb": _NEGLIGIBLE, "viscous": 0.0}, axis.name)
    return replace(axis, friction=nothing)


def simulate_loop(
    axis: Axis,
    reference: Wanted,
    controller: PidConfig,
    config: LoopConfig | None = None,
    observer: ObserverConfig | None = None,
    compensator: CompensatorConfig | None = None,
    seed: int = 0,
    temperature: Array | float = 20.0,
    exogenous: Mapping[str, Array] = MappingProxyType({}),
    cancellation: Cancellation | None = None,
    plant: PlantMaker | None = None,
) -> LoopRun:
    """Run the closed loop over the reference's duration, from rest at the reference's first position.

    `temperature` (degC) is one value or (n,), and each signal of `exogenous` is (n,), at the n ticks of
    `ticks(reference, config)`. Same arguments, same result, bit for bit. `plant` makes another simulator, which is moved in
    place of the axis by a loop that is not compiled as a whole.

    Raises
    ------
    InputError: a configuration is bad, a feedback or compensation is asked for without its configuration, or a model cannot be
    cancelled on this axis.
    JobError: the loop became unstable and left the range of numbers.
    """
    config = config or LoopConfig()
    _check(config, controller, observer, compensator, cancellation)
    period = config.period
    times = ticks(reference, config)
    count = len(times)
    targets = reference.over(times)
    surroundings = _surroundings(np.broadcast_to(temperature, count), exogenous, period)
    observing, observer_state = pack(observer.design(period)) if observer else (np.zeros(1), np.zeros(2))
    compensating = compensator_parameters(compensator or CompensatorConfig(), period)
    planned, correction = np.zeros(count), PositionCorrection(replace(axis, effects=()), period)
    if config.compensation == "model" and cancellation is not None:
        check_model(cancellation.model, axis)
        model = ModelCompensator(cancellation.model, period, cancellation.config, tuple(exogenous))
        planned = model.over(times, targets, surroundings)
        check_drive(planned, targets, cancellation.model, min(axis.drive.limit, controller.torque_limit))
        correction = PositionCorrection(cancellation.model, period)
        correction.configure(cancellation.config.left_out, cancellation.config.entry_time)
    controls = _Controls(
        pid_parameters(controller, period),
        np.zeros(PID_STATES),
        observing,
        observer_state,
        observer is not None,
        config.feed_back,
        compensating,
        np.zeros(STATES),
        COMPENSATIONS.index(config.compensation),
        planned,
        correction.machine,
        correction.shares,
        correction.wanted,
        correction.rise,
        targets,
        np.zeros(2),
    )
    start, out = float(targets[0, 0]), np.zeros((10, count))
    if plant is None:
        substeps = substeps_for(axis, period)
        machine = compiled.build(axis, period / substeps, substeps, tuple(exogenous), start)
        _run(machine, controls, surroundings, _normals(seed, count), out)
    else:
        _run_simulator(plant(axis, period, seed, start), controls, surroundings[:, 0], list(exogenous.values()), out)
    if not np.all(np.isfinite(out)):
        first = int(np.argmin(np.all(np.isfinite(out), axis=0)))
        raise JobError(f"axis {axis.name}", f"the loop became unstable at {times[first]:g} s", "lower gains")
    return LoopRun(times, targets[:, 0].copy(), targets[:, 1].copy(), *(row.copy() for row in out))


def _surroundings(temperature: Array, exogenous: Mapping[str, Array], period: float) -> Array:
    """Shape (n, 1 + 2 s), for the n ticks as the motion vector has them: temperature, then each signal and its rate, 1/s.

    A signal is held over a period; its rate is the slope from this tick to the next one, which is that of the period's middle.
    """
    columns = [temperature]
    for signal in exogenous.values():
        columns += [signal, np.diff(signal, append=signal[-1:]) / period]
    return np.column_stack(columns)


def ticks(reference: Wanted, config: LoopConfig) -> Array:
    """The instants (n,) of a run over the reference's duration, s."""
    count = round(reference.duration / config.period) + 1
    times: Array = config.period * np.arange(count, dtype=np.float64)
    return times


def _normals(seed: int, count: int) -> Array:
    """Shape (count, 2): the noise of the simulator's ticks in the order in which it draws them."""
    generator = np.random.default_rng(seed)
    blocks = [generator.standard_normal((NOISE_BLOCK, 2))[::-1] for _ in range(-(-count // NOISE_BLOCK))]
    return np.ascontiguousarray(np.concatenate(blocks)[:count])


def _check(
    config: LoopConfig,
    controller: PidConfig,
    observer: ObserverConfig | None,
    compensator: CompensatorConfig | None,
    cancellation: Cancellation | None,
) -> None:
    config.validate()
    controller.validate()
    if observer is not None:
        observer.validate()
    elif config.feed_back:
        raise InputError("loop", "feed_back is on but there is no observer", "an observer's configuration")
    if compensator is not None:
        compensator.validate()
    if config.compensation == "none":
        return
    if (cancellation if config.compensation == "model" else compensator) is None:
        raise InputError(
            "loop", f"compensation is {config.compensation} without parameters", "a compensator configuration"
        )


class _Controls(NamedTuple):
    """What acts on a plant; arrays of states change as it runs."""

    pid: Array
    pid_state: Array
    observing: Array
    observer_state: Array
    observed: bool
    feed_back: bool
    compensating: Array
    compensator_state: Array
    compensation_kind: int
    planned: Array
    sensor: Any
    shares: Array
    wanted_shares: Array
    rise: float
    targets: Array
    held: Array  # torque applied since the last tick, and the compensator's part of it, N m


@njit(cache=True, error_model="numpy")
def _run(plant: Any, c: Any, surroundings: Array, normals: Array, out: Array) -> None:
    for k in range(len(c.targets)):
        command = _command(c, plant.body, k, out)
        plant.motion[TEMPERATURE:] = surroundings[k]
        c.held[0] = compiled.tick(plant, command, normals[k, 0], normals[k, 1])


def _run_simulator(plant: Simulator, c: _Controls, temperature: Array, exogenous: list[Array], out: Array) -> None:
    for k in range(len(c.targets)):
        command = _command(c, plant.machine.body, k, out)
        c.held[0] = plant.step(command, temperature[k], tuple(values[k] for values in exogenous))


@njit(cache=True, error_model="numpy")
def _command(c: Any, body: Array, k: int, out: Array) -> float:
    """Tick k up to the new command (N m); `out` gets what is recorded of it."""
    torque, cancelled = c.held[0], c.held[1]
    position, velocity = body[compiled.MEASURED], body[compiled.MEASURED_VELOCITY]
    if len(c.shares) > 0:
        position, velocity = correct(c.sensor, c.shares, c.wanted_shares, c.rise, position, velocity)
    estimate = 0.0
    if c.observed:
        estimate = observer_step(c.observer_state, c.observing, torque, velocity, cancelled)
    out[0, k], out[1, k], out[2, k], out[3, k] = position, velocity, torque, cancelled
    out[4, k], out[5, k] = estimate, c.observer_state[REST]
    out[6, k], out[7, k] = body[compiled.FRICTION], body[compiled.OTHERS]
    out[8, k], out[9, k] = body[compiled.TRUE_POSITION], body[compiled.TRUE_VELOCITY]
    q_ref, v_ref, a_ref = c.targets[k, 0], c.targets[k, 1], c.targets[k, 2]
    cancelled = 0.0
    if c.compensation_kind == 1:
        cancelled = lugre_step(c.compensator_state, c.compensating, v_ref, a_ref)
    elif c.compensation_kind == 2:
        cancelled = stribeck_step(c.compensator_state, c.compensating, v_ref, a_ref)
    elif c.compensation_kind == 3:
        cancelled = c.planned[k]
    added = cancelled
    if c.feed_back:
        added += c.observer_state[REST]
    c.held[1] = cancelled
    return float(pid_step(c.pid_state, c.pid, position, velocity, q_ref, v_ref, a_ref, added))
