"""Test vectors: what the Python kernels make of a random motion, against which code that was exported checks itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcs_friction.control.model_compensator import AT_REST
from tcs_friction.export.code import RESISTING, AxisCode
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.motion import rate_at
from tcs_friction.physics.simulate import Simulator

WAVES = 4  # of a random speed
CYCLES = (1.0, 12.0)  # of each wave in the motion


@dataclass(frozen=True)
class Vectors:
    """A random motion of n control periods, and what the kernels make of it.

    motion: (n, 6) time, position, speed, acceleration, torque and temperature. signals: (n, 2 s), each value and its rate.
    friction, compensation: (n,) N m, along that motion. moved: (n, 3) position, speed and friction of the axis under that torque.
    """

    motion: np.ndarray
    signals: np.ndarray
    friction: np.ndarray
    compensation: np.ndarray
    moved: np.ndarray


def random_motion(period: float, count: int, speed: float, seed: int) -> np.ndarray:
    """Position, speed and acceleration (count, 3): slow and fast, to and fro, smooth, at most `speed` (rad/s)."""
    rng = np.random.default_rng(seed)
    t, length = period * np.arange(count), period * count
    rates = 2.0 * np.pi * rng.uniform(*CYCLES, WAVES) / length
    phases, shares = rng.uniform(0.0, 2.0 * np.pi, WAVES), rng.dirichlet(np.ones(WAVES))
    angle = rates * t[:, None] + phases
    wave, slope = np.cos(angle) @ shares, -np.sin(angle) @ (shares * rates)
    velocity, acceleration = speed * wave**3, 3.0 * speed * wave**2 * slope
    steps = 0.5 * period * (velocity[1:] + velocity[:-1])
    position = rng.uniform(-1.0, 1.0) + np.concatenate([[0.0], np.cumsum(steps)])
    return np.column_stack([position, velocity, acceleration])


def vectors(code: AxisCode, count: int = 400, seed: int = 0, speed: float = 1.0) -> Vectors:
    """A random motion and what the Python kernels make of it."""
    axis, period, rng = code.axis, code.period, np.random.default_rng(seed + 1)
    motion = random_motion(period, count, speed, seed)
    t = period * np.arange(count)
    level = axis.dry_level
    torque = axis.inertia * motion[:, 2] + level * rng.uniform(-2.0, 2.0, WAVES)[np.arange(count) * WAVES // count]
    temperature = 20.0 + 10.0 * np.sin(2.0 * np.pi * t / (period * count))
    values = [np.interp(t, t[:: max(count // 8, 1)], rng.uniform(-2.0, 2.0, len(t[:: max(count // 8, 1)]))) for _ in code.signals]
    rates = [np.array([rate_at(series, i, period if i else 0.0) for i in range(count)]) for series in values]
    pairs = [column for pair in zip(values, rates, strict=True) for column in pair]
    signals = np.column_stack(pairs) if pairs else np.zeros((count, 0))
    own = [item for item in axis.terms if item.term.place in RESISTING]
    machine = compiled.build(axis, period, signals=code.signals, terms=own)
    out, around = np.zeros((count, 8)), np.array([temperature, *values])
    columns = (np.ascontiguousarray(motion[:, k]) for k in range(3))
    compiled.evaluate(machine, t, *columns, torque, around, AT_REST, out)
    friction = out[:, compiled.REQUIRED] - axis.inertia * motion[:, 2]
    compensation = code.compensator.over(np.asarray(t, np.float64), motion, np.column_stack([temperature, signals]))
    return Vectors(
        np.column_stack([t, motion, torque, temperature]), signals, friction, compensation,
        _moved(code, torque, temperature, signals, float(motion[0, 0])),
    )  # fmt: skip


def _moved(code: AxisCode, torque: np.ndarray, temperature: np.ndarray, signals: np.ndarray, start: float) -> np.ndarray:
    simulator = Simulator(code.quiet, code.period, position=start, signals=code.signals)
    body, rows = simulator.machine.body, []
    for k in range(len(torque)):
        simulator.step(torque[k], temperature[k], tuple(signals[k, ::2]), tuple(signals[k, 1::2]))
        rows.append([body[compiled.TRUE_POSITION], body[compiled.TRUE_VELOCITY], body[compiled.FRICTION]])
    return np.array(rows)
