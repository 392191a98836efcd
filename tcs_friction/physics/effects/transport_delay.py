"""The torque acts later than the log says: a bus, a buffer, a slow loop."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tcs_friction.physics.terms import TORQUE, Need, Parameter, Place, Survey, Term, geometric, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """State: how many samples came, then a ring of the last torques; the torque between two samples is on their line.

    A fit to a log may find the torque early by a little: it goes on along the last line then.
    """
    size = len(state) - 1
    count = int(state[0])
    if count == 0:
        state[1:] = motion[TORQUE]
    state[1 + count % size] = motion[TORQUE]
    state[0] = count + 1.0 if count < 2 * size else count + 1.0 - size
    back = min(parameters[0] / dt, size - 2.0) if dt > 0.0 else 0.0
    whole = max(int(back), 0)
    part = back - whole
    newer = state[1 + (count + size - whole) % size]
    older = state[1 + (count + 2 * size - whole - 1) % size]
    return float(newer + part * (older - newer))


def _ring(values: Mapping[str, float], dt: float) -> int:
    return 4 + math.ceil(max(values["delay"], 0.0) / dt)


def scan(survey: Survey) -> Sequence[Mapping[str, float]]:
    return [{"delay": delay} for delay in geometric(0.01 / survey.cutoff, 1.0 / survey.cutoff, 12)]


def transfer(values: Mapping[str, float], s: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-s * values["delay"]) - 1.0)


TERM = Term(
    id="transport_delay",
    place=Place.DRIVE,
    form="u(t - delay)",
    parameters=(Parameter("delay", "s", "time by which the torque is late", lower=0.0, upper=10.0),),
    kernel=torque,
    reads=("torque",),
    states=_ring,
    coordinate="frequency",
    subsystem="timing",
    scan=scan,
    transfer=transfer,
    alignment="delay",
    needs=frozenset({Need.ACCELERATION}),
)
