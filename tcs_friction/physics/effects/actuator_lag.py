"""The torque follows the command through a first-order lag: the current loop, an electrical time constant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tcs_friction.physics.terms import TORQUE, Need, Parameter, Place, Survey, Term, geometric, kernel

SHARE = 0.1  # of 1/time_constant: the kernel is exact for a command on a line, so a step may last two time constants


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: started, command before, output. Exact for a command that is a line between two instants."""
    command = motion[TORQUE]
    if state[0] == 0.0:
        state[0], state[1], state[2] = 1.0, command, command
    if dt <= 0.0 or parameters[0] <= 0.0:
        return float(command)
    decay = math.exp(-dt / parameters[0])
    slope = (command - state[1]) * parameters[0] / dt
    state[2] = command - slope + (state[2] - state[1] + slope) * decay
    state[1] = command
    return float(state[2])


BAND = 10.0  # of the lag's own band, up to which it is inverted: the inverse of a lag amplifies all that is faster


@kernel
def inverse(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """u = (1 + s T) / (1 + s T / BAND) u', as a filtered derivative. State: started, torque before, derivative."""
    wanted, constant = motion[TORQUE], parameters[0]
    if state[0] == 0.0:
        state[0], state[1] = 1.0, wanted
    if dt <= 0.0 or constant <= 0.0:
        return float(wanted)
    fast = max(constant / BAND, dt)
    decay = math.exp(-dt / fast)
    state[2] = decay * state[2] + (1.0 - decay) * (wanted - state[1]) / dt
    state[1] = wanted
    return float(wanted + max(constant - fast, 0.0) * state[2])


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"time_constant": tau} for tau in geometric(0.01 / survey.cutoff, 1.0 / survey.cutoff, 12)]


def transfer(values: Mapping[str, float], s: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + s * values["time_constant"]) - 1.0)


def rate(values: Mapping[str, float], inertia: float) -> float:
    return SHARE / values["time_constant"] if values["time_constant"] > 0.0 else 0.0


TERM = Term(
    id="actuator_lag",
    place=Place.DRIVE,
    form="time_constant du'/dt = u - u'",
    parameters=(Parameter("time_constant", "s", "of the lag", lower=0.0, upper=10.0),),
    kernel=torque,
    inverse=inverse,
    reads=("torque",),
    states=3,
    coordinate="frequency",
    subsystem="actuator",
    scan=scan,
    transfer=transfer,
    needs=frozenset({Need.ACCELERATION}),
    rate=rate,
)
