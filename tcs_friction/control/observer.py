"""Linear disturbance observers: the kernel that the disturbance observer and the Kalman observer share.

An observer takes the torque and the measured speed and estimates the friction torque (positive when it
opposes positive motion). Whatever its design, it is a linear discrete system

    x[k] = F x[k-1] + g_new u_new + g_old u_old + h_0 v[k-1] + h_1 v[k],      friction[k] = c x[k]

where v is the measured speed and the torque acting during the tick that ends at k is u_old at first and u_new
from the known delay's fraction of a tick on.

Friction must not be cancelled twice. A compensator's torque is part of the torque, so `friction` is all of
it, cancelled or not: it is what identification wants. What may be fed back beside a compensator is only the
rest,

    rest = friction - Q(compensation),

with Q the observer's own response from torque to estimate, delay included. The second copy of x does this.
With an exact model rest = Q(friction - compensation), whatever the compensator gets right or wrong.

Calibration may have found that the torque that acts is `scale` times the logged one plus `offset`: both torques are
corrected on their way in, and the rest, which becomes a command, is divided by the scale on its way out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import expm

from tcs_friction.control.config_field import setting, validate

Array = NDArray[np.float64]

# state slots; then x, x of the compensation, the delay line of torque, the delay line of compensation
ESTIMATE, REST, _PRIMED, _SPEED, _HEAD = 0, 1, 2, 3, 4
_STATE_HEADER = 5
# parameter slots; then F, g_new, g_old, h_0, h_1, c, (I - F)^-1
_ORDER, _LINE, _SCALE, _OFFSET = 0, 1, 2, 3
_PARAMETER_HEADER = 4


@dataclass(frozen=True)
class NominalPlant:
    """From net torque u - friction to speed v: second * v'' + first * v' + constant * v = u - friction.

    An axis of inertia J with viscous friction B is (0, J, B). The paper's eq. 10 is `PAPER_PLANT`.
    Leave B at 0 to have viscous friction counted in the friction estimate.
    """

    second: float = setting(
        0.0, "N m s^3/rad", 0.0, 1e12, "nominal plant: torque per second derivative of speed"
    )
    first: float = setting(1000.0, "kg m^2", 1e-12, 1e12, "nominal plant: inertia, torque per acceleration")
    constant: float = setting(
        0.0, "N m s/rad", 0.0, 1e12, "nominal plant: viscous coefficient, torque per speed"
    )

    def validate(self, where: str = "nominal plant") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)


PAPER_PLANT = NominalPlant(second=0.0003, first=0.1082, constant=39.3918)


@dataclass(frozen=True)
class Design:
    """The matrices of an observer of order n: F (n, n), the others (n,). Read-only."""

    transition: Array
    torque_new: Array
    torque_old: Array
    speed_before: Array
    speed_now: Array
    output: Array
    delay_ticks: int
    torque_scale: float = 1.0
    torque_offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("transition", "torque_new", "torque_old", "speed_before", "speed_now", "output"):
            getattr(self, name).setflags(write=False)


def split_delay(delay: float, dt: float) -> tuple[int, float]:
    """A delay in whole ticks and the remaining fraction of a tick, in seconds."""
    ticks = math.floor(delay / dt + 1e-9)
    return ticks, max(delay - ticks * dt, 0.0)


def held_input(dynamics: Array, gain: Array, span: float) -> Array:
    """Integral of exp(A s) b over s from 0 to `span`: the exact effect of an input held that long."""
    order = len(gain)
    block = np.zeros((order + 1, order + 1))
    block[:order, :order] = dynamics
    block[:order, order] = gain
    result: Array = expm(block * span)[:order, order]
    return result


def delayed_torque(dynamics: Array, gain: Array, delay: float, dt: float) -> tuple[Array, Array, int]:
    """Exact gains of the torque that starts within the tick and of the one before; whole ticks of delay."""
    ticks, rest = split_delay(delay, dt)
    new = held_input(dynamics, gain, dt - rest)
    old = expm(dynamics * (dt - rest)) @ held_input(dynamics, gain, rest)
    return new, old, ticks


def pack(design: Design) -> tuple[Array, Array]:
    """The kernel's parameters and a fresh state for a design."""
    order = len(design.output)
    line = design.delay_ticks + 2
    settle = np.linalg.inv(np.eye(order) - design.transition)
    parts = (
        np.array([order, line, design.torque_scale, design.torque_offset], dtype=np.float64),
        design.transition.ravel(),
        design.torque_new,
        design.torque_old,
        design.speed_before,
        design.speed_now,
        design.output,
        settle.ravel(),
    )
    return np.concatenate(parts), np.zeros(_STATE_HEADER + 2 * order + 2 * line)


@njit("void(f8[::1], f8[::1], i8, f8, f8, f8)", cache=True)
def _settle(state: Array, parameters: Array, at: int, new: float, before: float, now: float) -> None:
    """Put the copy of x at `at` where it would come to rest under these inputs held for ever."""
    n = int(parameters[_ORDER])
    gains = _PARAMETER_HEADER + n * n
    inverse = gains + 5 * n
    for i in range(n):
        total = 0.0
        for j in range(n):
            drive = (parameters[gains + j] + parameters[gains + n + j]) * new
            drive += parameters[gains + 2 * n + j] * before + parameters[gains + 3 * n + j] * now
            total += parameters[inverse + i * n + j] * drive
        state[at + i] = total


@njit("f8(f8[::1], f8[::1], i8, f8, f8, f8, f8)", cache=True)
def _advance(
    state: Array, parameters: Array, at: int, new: float, old: float, before: float, now: float
) -> float:
    """Advance the copy of x at `at` by one tick and return its output."""
    n = int(parameters[_ORDER])
    gains = _PARAMETER_HEADER + n * n
    x0, x1, x2 = state[at], 0.0, 0.0
    if n > 1:
        x1 = state[at + 1]
    if n > 2:
        x2 = state[at + 2]
    output = 0.0
    for i in range(n):
        row = _PARAMETER_HEADER + i * n
        value = parameters[row] * x0
        if n > 1:
            value += parameters[row + 1] * x1
        if n > 2:
            value += parameters[row + 2] * x2
        value += parameters[gains + i] * new + parameters[gains + n + i] * old
        value += parameters[gains + 2 * n + i] * before + parameters[gains + 3 * n + i] * now
        state[at + i] = value
        output += parameters[gains + 4 * n + i] * value
    return output


@njit("f8(f8[::1], f8[::1], f8, f8, f8)", cache=True)
def observer_step(
    state: Array, parameters: Array, torque: float, velocity: float, compensation: float
) -> float:
    """One tick: the friction estimate, also in state[ESTIMATE]; state[REST] the command that would cancel the rest.

    `torque` is the one held during the tick that ends now, `compensation` the compensator's part of it,
    `velocity` the speed measured now.
    """
    n = int(parameters[_ORDER])
    line = int(parameters[_LINE])
    scale = parameters[_SCALE]
    torque = scale * torque + parameters[_OFFSET]
    compensation = scale * compensation
    torques = _STATE_HEADER + 2 * n
    if state[_PRIMED] == 0.0:
        state[_PRIMED] = 1.0
        state[_SPEED] = velocity
        for i in range(line):
            state[torques + i] = torque
            state[torques + line + i] = compensation
        _settle(state, parameters, _STATE_HEADER, torque, velocity, velocity)
        _settle(state, parameters, _STATE_HEADER + n, compensation, 0.0, 0.0)
    head = int(state[_HEAD])
    state[torques + head] = torque
    state[torques + line + head] = compensation
    after = head + 1
    if after == line:
        after = 0
    old = after  # the oldest entry of the line: delay_ticks + 1 ticks before the newest
    new = old + 1
    if new == line:
        new = 0
    estimate = _advance(
        state, parameters, _STATE_HEADER, state[torques + new], state[torques + old], state[_SPEED], velocity
    )
    cancelled = _advance(
        state,
        parameters,
        _STATE_HEADER + n,
        state[torques + line + new],
        state[torques + line + old],
        0.0,
        0.0,
    )
    state[_HEAD] = after
    state[_SPEED] = velocity
    state[ESTIMATE] = estimate
    state[REST] = (estimate - cancelled) / scale
    return float(estimate)


@njit("void(f8[::1], f8[::1], f8[:, ::1])", cache=True)
def _replay(state: Array, parameters: Array, heard: Array) -> None:
    """Torques, speeds and compensations (n, 3) of so many ticks, one after the other."""
    for k in range(len(heard)):
        observer_step(state, parameters, heard[k, 0], heard[k, 1], heard[k, 2])


@njit("f8[::1](f8[::1], f8[::1], f8[::1], f8[::1])", cache=True)
def _observe(state: Array, parameters: Array, torque: Array, velocity: Array) -> Array:
    """The friction estimates (n,) over a whole recording."""
    out = np.empty(len(torque))
    for k in range(len(torque)):
        out[k] = observer_step(state, parameters, torque[k], velocity[k], 0.0)
    return out


class ObserverConfig(Protocol):
    """A configuration that can be turned into an observer."""

    def validate(self, where: str = ...) -> None:
        """Raises InputError for any bad value."""

    def design(self, dt: float) -> Design:
        """The observer's matrices for a tick of `dt` seconds."""


class FrictionObserver:
    """A disturbance observer of either design, one `step` a tick."""

    def __init__(self, config: ObserverConfig, dt: float) -> None:
        self.dt = dt
        self.configure(config)

    def configure(self, config: ObserverConfig) -> None:
        """Start anew with another configuration; raises InputError and changes nothing if it is bad."""
        config.validate()
        self.parameters, self._state = pack(config.design(self.dt))
        self.config = config

    def continued(self, config: ObserverConfig, dt: float, heard: Array) -> FrictionObserver:
        """Another observer in place of this one, as if it had been here for the last ticks.

        heard: torques, speeds and compensations (n, 3) of those ticks, as `step` was given them; n may be 0.
        """
        other = FrictionObserver(config, dt)
        _replay(other._state, other.parameters, np.ascontiguousarray(heard, dtype=np.float64))
        return other

    def reset(self) -> None:
        """Forget the past; the next tick is the first."""
        self._state[:] = 0.0

    def step(self, torque: float, velocity: float, compensation: float = 0.0) -> float:
        """The friction estimate (N m) now, from the torque held during the tick that ends now.

        `torque` is the torque really applied (after saturation); `compensation` is the compensator's share
        of it, 0 when none is active. `rest` is then the part to feed back.
        """
        estimate: float = observer_step(self._state, self.parameters, torque, velocity, compensation)
        return estimate

    def over(self, torque: Array, velocity: Array) -> Array:
        """The friction estimates (n,) from torques and speeds (n,) of as many ticks, one after the other."""
        estimates: Array = _observe(
            self._state,
            self.parameters,
            np.array(torque, dtype=np.float64),
            np.array(velocity, dtype=np.float64),
        )
        return estimates

    @property
    def estimate(self) -> float:
        """All the friction, as of the last step (N m)."""
        return float(self._state[ESTIMATE])

    @property
    def rest(self) -> float:
        """The friction that the compensator has not cancelled, as of the last step (N m)."""
        return float(self._state[REST])
