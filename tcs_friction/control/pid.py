"""Double-loop PID: a position loop commands a speed, a speed loop commands a torque.

    speed command  c = k_ff v_ref + Kp e + Ki integral(e) + Kd d(e)/dt,   e = q_ref - q
    torque         u = J_ff a_ref + B_ff v_ref + kp w + ki integral(w) + kd d(w)/dt + added,
                   w = c - v - a_ref delay

The measured speed v is late by a known delay, by which an accelerating axis would seem to lag.

Derivatives pass through a first-order filter. Integrators and filters are exact for inputs held between two
ticks. Both commands are limited. While the torque is limited the speed loop's integrator is driven back by
back-calculation, and the position loop's integrator stops if its error would push further into a limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.control.config_field import setting, validate

Array = NDArray[np.float64]

# parameter slots
_POSITION_P, _POSITION_I, _POSITION_D = 0, 1, 2
_VELOCITY_P, _VELOCITY_I, _VELOCITY_D = 3, 4, 5
_VELOCITY_FORWARD, _ACCELERATION_FORWARD, _VISCOUS_FORWARD = 6, 7, 8
_VELOCITY_LIMIT, _TORQUE_LIMIT = 9, 10
_VELOCITY_DELAY, _FILTER, _FILTER_DECAY, _UNWIND, _DT = 11, 12, 13, 14, 15
PARAMETERS = 16

# state slots
_POSITION_INTEGRAL, _POSITION_FILTER, _VELOCITY_INTEGRAL, _VELOCITY_FILTER, _PRIMED = 0, 1, 2, 3, 4
STATES = 5

_SIGNATURE = "f8(f8[::1], f8[::1], f8, f8, f8, f8, f8, f8)"


@dataclass(frozen=True)
class PidConfig:
    """Gains and limits of the double loop. SI units; for a linear axis read N for N m and m for rad."""

    position_proportional: float = setting(20.0, "1/s", 0.0, 1e4, "position loop, proportional gain")
    position_integral: float = setting(0.0, "1/s^2", 0.0, 1e6, "position loop, integral gain")
    position_derivative: float = setting(0.0, "1", 0.0, 1e3, "position loop, derivative gain")
    velocity_proportional: float = setting(6e4, "N m s/rad", 0.0, 1e12, "speed loop, proportional gain")
    velocity_integral: float = setting(1e6, "N m/rad", 0.0, 1e14, "speed loop, integral gain")
    velocity_derivative: float = setting(0.0, "N m s^2/rad", 0.0, 1e9, "speed loop, derivative gain")
    derivative_filter: float = setting(0.01, "s", 1e-6, 10.0, "time constant of the derivatives' filter")
    velocity_feedforward: float = setting(1.0, "1", 0.0, 2.0, "share of the reference speed fed forward")
    inertia_feedforward: float = setting(0.0, "kg m^2", 0.0, 1e9, "torque per reference acceleration")
    viscous_feedforward: float = setting(0.0, "N m s/rad", 0.0, 1e9, "torque per reference speed")
    velocity_delay: float = setting(0.0, "s", 0.0, 0.1, "known delay of the measured speed (its filter)")
    velocity_limit: float = setting(1.0, "rad/s", 1e-9, 1e6, "largest speed the position loop may command")
    torque_limit: float = setting(1000.0, "N m", 1e-9, 1e12, "largest torque that may be commanded")

    def validate(self, where: str = "controller") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)


def pid_parameters(config: PidConfig, dt: float) -> Array:
    """The kernel's parameter array for a tick of `dt` seconds."""
    parameters = np.empty(PARAMETERS)
    parameters[:12] = (
        config.position_proportional,
        config.position_integral,
        config.position_derivative,
        config.velocity_proportional,
        config.velocity_integral,
        config.velocity_derivative,
        config.velocity_feedforward,
        config.inertia_feedforward,
        config.viscous_feedforward,
        config.velocity_limit,
        config.torque_limit,
        config.velocity_delay,
    )
    parameters[_FILTER] = config.derivative_filter
    parameters[_FILTER_DECAY] = math.exp(-dt / config.derivative_filter)
    # back-calculation unwinds at the speed loop's own integral rate, at most the whole excess in one tick
    has_rate = config.velocity_proportional > 0.0
    rate = config.velocity_integral / config.velocity_proportional if has_rate else 1.0 / dt
    parameters[_UNWIND] = min(rate * dt, 1.0)
    parameters[_DT] = dt
    return parameters


@njit(_SIGNATURE, cache=True)
def pid_step(
    state: Array,
    parameters: Array,
    position: float,
    velocity: float,
    q_ref: float,
    v_ref: float,
    a_ref: float,
    added: float,
) -> float:
    """One tick: the limited torque command. `state` is updated in place; `added` is torque to cancel."""
    dt = parameters[_DT]
    error = q_ref - position
    if state[_PRIMED] == 0.0:  # the filters start at the first error, so that it makes no derivative kick
        state[_POSITION_FILTER] = error
    slope = (error - state[_POSITION_FILTER]) / parameters[_FILTER]
    command = (
        parameters[_VELOCITY_FORWARD] * v_ref
        + parameters[_POSITION_P] * error
        + state[_POSITION_INTEGRAL]
        + parameters[_POSITION_D] * slope
    )
    limit = parameters[_VELOCITY_LIMIT]
    limited = min(max(command, -limit), limit)

    lag = limited - parameters[_VELOCITY_DELAY] * a_ref - velocity
    if state[_PRIMED] == 0.0:
        state[_VELOCITY_FILTER] = lag
        state[_PRIMED] = 1.0
    lag_slope = (lag - state[_VELOCITY_FILTER]) / parameters[_FILTER]
    wanted = (
        parameters[_ACCELERATION_FORWARD] * a_ref
        + parameters[_VISCOUS_FORWARD] * v_ref
        + parameters[_VELOCITY_P] * lag
        + state[_VELOCITY_INTEGRAL]
        + parameters[_VELOCITY_D] * lag_slope
        + added
    )
    limit = parameters[_TORQUE_LIMIT]
    torque = min(max(wanted, -limit), limit)

    fresh = 1.0 - parameters[_FILTER_DECAY]
    state[_POSITION_FILTER] += fresh * (error - state[_POSITION_FILTER])
    state[_VELOCITY_FILTER] += fresh * (lag - state[_VELOCITY_FILTER])
    pushing = (command - limited) * error > 0.0 or (wanted - torque) * error > 0.0
    if not pushing:
        state[_POSITION_INTEGRAL] += parameters[_POSITION_I] * error * dt
    if parameters[_VELOCITY_I] > 0.0:
        state[_VELOCITY_INTEGRAL] += parameters[_VELOCITY_I] * lag * dt
        state[_VELOCITY_INTEGRAL] -= parameters[_UNWIND] * (wanted - torque)
    return float(torque)


class DoubleLoopPid:
    """The controller, one `step` a tick. A changed configuration keeps the state."""

    def __init__(self, config: PidConfig, dt: float) -> None:
        self._state = np.zeros(STATES)
        self._left = 0  # ticks until the configuration has been reached
        self._limit, self._share = 0.0, 1.0  # torque limit, and what share of it may be used
        self.parameters = np.zeros(PARAMETERS)
        self.dt = dt
        self.configure(config)

    def configure(self, config: PidConfig, dt: float | None = None, time: float = 0.0) -> None:
        """Use another configuration; a bad one raises InputError and changes nothing.

        dt: s of a tick, the same as before by default. time: s in which a controller that acts gets there, along a straight line
        in all its numbers, so that the torque makes no step. An integrator without a gain is emptied in it.
        """
        config.validate()
        self.config, self.dt = config, dt or self.dt
        self._origin, self._target = self.parameters.copy(), pid_parameters(config, self.dt)
        self._origin[_TORQUE_LIMIT] = self._limit
        acts = self._state[_PRIMED] != 0.0 and time > 0.0
        self._ticks = self._left = max(1, round(time / self.dt)) if acts else 1
        if not acts:
            self._approach()

    def _approach(self) -> None:
        """One tick closer to the configuration."""
        self._left -= 1
        share = self._left / self._ticks
        self.parameters = self._target + share * (self._origin - self._target)
        keep = self._left / (self._left + 1)
        for slot, gain in ((_POSITION_INTEGRAL, _POSITION_I), (_VELOCITY_INTEGRAL, _VELOCITY_I)):
            if self._target[gain] == 0.0:
                self._state[slot] *= keep
        if not self._left:
            self._origin, self._ticks = self._target, 1
        self._limit = float(self.parameters[_TORQUE_LIMIT])
        self.parameters[_TORQUE_LIMIT] = self._share * self._limit

    def share_limit(self, share: float) -> None:
        """Use a share (0 to 1) of the torque limit from the next tick on."""
        self._share = share
        self.parameters[_TORQUE_LIMIT] = share * self._limit

    def give_up(self, torque: float) -> None:
        """Torque comes from elsewhere from now on: as far as the speed loop's integrator has held it, it does so no more."""
        held = self._state[_VELOCITY_INTEGRAL]
        if self._target[_VELOCITY_I] > 0.0 and held * torque > 0.0:
            self._state[_VELOCITY_INTEGRAL] = held - torque if abs(torque) < abs(held) else 0.0

    def take_over(self, torque: float) -> None:
        """Torque that came from elsewhere comes from the speed loop's integrator from now on."""
        if self._target[_VELOCITY_I] > 0.0:
            self._state[_VELOCITY_INTEGRAL] += torque

    def reset(self) -> None:
        """Forget the integrators and filters."""
        self._state[:] = 0.0
        if self._left:
            self._left = 1
            self._approach()

    def step(
        self, position: float, velocity: float, q_ref: float, v_ref: float, a_ref: float, added: float = 0.0
    ) -> float:
        """The torque command (N m), within the torque limit, for this tick's measurement and reference.

        `added` is torque put on top: friction compensation and the disturbance observer's feedback.
        """
        if self._left:
            self._approach()
        torque: float = pid_step(self._state, self.parameters, position, velocity, q_ref, v_ref, a_ref, added)
        return torque
