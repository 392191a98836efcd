"""The axis in motion: a simulator that advances by control periods, and whole open-loop runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import TEMPERATURE, set_surroundings

LONGEST_STEP = 1e-4  # s
NOISE_BLOCK = 4096


def substeps_for(axis: Axis, period: float) -> int:
    """Integration steps per control period (s): at most LONGEST_STEP long, and short against the axis' fastest dynamics."""
    longest = min(LONGEST_STEP, 0.2 / axis.fastest_rate())
    return max(1, math.ceil(period / longest - 1e-9))


class Simulator:
    """An axis that advances one control period at a time. Same axis, seed and commands: same motion, bit for bit.

    Parameters
    ----------
    axis: what is simulated.
    period: control period, s.
    seed: of torque and encoder noise.
    position: at the start, rad, at rest.
    signals: names of exogenous signals that `step` will be given.
    substeps: integration steps a period; by default fine enough for the axis.
    """

    def __init__(
        self,
        axis: Axis,
        period: float = 1e-3,
        seed: int = 0,
        position: float = 0.0,
        signals: tuple[str, ...] = (),
        substeps: int | None = None,
    ) -> None:
        if not period > 0.0:
            raise InputError("simulator: period", repr(period), "a positive number of seconds")
        self.axis = axis
        self.period = period
        count = substeps if substeps is not None else substeps_for(axis, period)
        self.machine = compiled.build(axis, period / count, count, signals, position)
        self._random = np.random.default_rng(seed)
        self._noise: list[list[float]] = []
        self._before: list[list[float]] = [[] for _ in signals]
        self.ticks = 0

    def step(
        self,
        command: float,
        temperature: float = 20.0,
        exogenous: tuple[float, ...] = (),
        rates: tuple[float, ...] | None = None,
    ) -> float:
        """Advance one period under `command` (N m, finite); returns the torque applied after saturation.

        exogenous: each signal's value. rates: of the signals, 1/s; None where a value comes every period: they follow from those.

        Raises InputError when the command is NaN or infinite; the axis then has not moved.
        """
        if not math.isfinite(command):
            raise InputError("simulator: torque command", repr(command), "a finite number of N m")
        if not self._noise:
            self._noise = self._random.standard_normal((NOISE_BLOCK, 2)).tolist()
        motion = self.machine.motion
        motion[TEMPERATURE] = temperature
        for s, signal in enumerate(exogenous):
            set_surroundings(motion, s + 1, signal, self._rate(s, signal) if rates is None else rates[s])
        self.ticks += 1
        return self._tick(command, *self._noise.pop())

    def _tick(self, command: float, torque_normal: float, encoder_normal: float) -> float:
        return float(compiled.tick(self.machine, command, torque_normal, encoder_normal))

    def _rate(self, s: int, value: float) -> float:
        """Rate (1/s) of a signal in the middle of the period that begins, on the parabola through its last three values.

        What comes next is not known, and the slope from the value before would be that of a whole period earlier.
        """
        known = self._before[s]
        slopes = np.diff([*known, value]) / self.period
        self._before[s] = [*known[-1:], value]
        return float(2.0 * slopes[-1] - slopes[0] if len(slopes) > 1 else slopes.sum())

    @property
    def measured_position(self) -> float:
        """rad, as the encoder gives it."""
        return float(self.machine.body[compiled.MEASURED])

    @property
    def measured_velocity(self) -> float:
        """rad/s, filtered difference of measured positions."""
        return float(self.machine.body[compiled.MEASURED_VELOCITY])

    @property
    def position(self) -> float:
        """rad, true."""
        return float(self.machine.body[compiled.TRUE_POSITION])

    @property
    def velocity(self) -> float:
        """rad/s, true."""
        return float(self.machine.body[compiled.TRUE_VELOCITY])

    @property
    def friction(self) -> float:
        """N m, true friction torque of the last integration step (law and effects that scale it)."""
        return float(self.machine.body[compiled.FRICTION])

    @property
    def opposing(self) -> float:
        """N m, true opposing torque of all other effects in the last integration step."""
        return float(self.machine.body[compiled.OTHERS])


@dataclass(frozen=True)
class OpenLoop:
    """Result of `simulate_open_loop`, each (n,), at the end of each control period."""

    t: np.ndarray  # s
    position: np.ndarray  # rad
    velocity: np.ndarray  # rad/s
    friction: np.ndarray  # N m
    opposing: np.ndarray  # N m


def simulate_open_loop(
    axis: Axis, torque: np.ndarray, period: float, substeps: int | None = None, position: float = 0.0
) -> OpenLoop:
    """Motion under a torque (n,) in N m, held over each control period (s), from rest. No drive or sensor noise."""
    count = substeps if substeps is not None else substeps_for(axis, period)
    machine = compiled.build(axis, period / count, count, position=position)
    out = np.empty((len(torque), 4))
    compiled.run(machine, np.ascontiguousarray(torque, dtype=np.float64), out)
    t = period * np.arange(1, len(torque) + 1)
    return OpenLoop(t, out[:, 0], out[:, 1], out[:, 2], out[:, 3])
