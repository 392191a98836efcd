"""The free numbers of a joint fit: what of an axis may change, how, and between which bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Parameter, Role


@dataclass(frozen=True)
class Free:
    """One free number of a fit.

    owner: -3 actuation delay, -2 inertia, -1 friction law, else the index of the effect. kind: "log" (positive), "plain",
    or "cosine"/"sine": the two linear parts of an amplitude with a phase. scale: a step that is small for it.
    """

    owner: int
    name: str
    kind: str
    scale: float
    phase: str = ""
    bounds: tuple[float, float] = (-math.inf, math.inf)


INERTIA = Free(-2, "inertia", "log", 1e-4)


def pairs(parameters: Sequence[Parameter]) -> list[tuple[Parameter, Parameter | None]]:
    """Each parameter with its phase, if it has one."""
    result: list[tuple[Parameter, Parameter | None]] = []
    for parameter in parameters:
        if parameter.role is Role.PHASE:
            result[-1] = (result[-1][0], parameter)
        else:
            result.append((parameter, None))
    return result


def free_parameters(axis: Axis, torque_scale: float, hold: frozenset[str] = frozenset()) -> list[Free]:
    """What a joint fit of this axis may change: inertia, the law's parameters, every effect's active parameters."""
    free = [] if "inertia" in hold else [INERTIA]
    for parameter in axis.friction.term.parameters:
        value = axis.friction.values[parameter.name]
        if parameter.name in hold or parameter.name == "exponent" or value <= 0.0:
            continue
        free.append(Free(-1, parameter.name, "log", 1e-4))
    for index, item in enumerate(axis.effects):
        for parameter, phase in pairs(item.term.parameters):
            value = item.values[parameter.name]
            if parameter.role is Role.FIXED or (parameter.default is not None and value == parameter.default):
                continue
            if phase is not None:
                free.append(Free(index, parameter.name, "cosine", torque_scale, phase.name))
                free.append(Free(index, parameter.name, "sine", torque_scale, phase.name))
            elif parameter.role is Role.LINEAR:
                free.append(Free(index, parameter.name, "plain", max(abs(value), 1e-12) * 1e-2))
            elif parameter.lower >= 0.0:
                free.append(Free(index, parameter.name, "log", 1e-4))
            else:
                free.append(Free(index, parameter.name, "plain", 1e-4 * max(1.0, abs(value))))
    return free


def get(axis: Axis, free: Sequence[Free]) -> np.ndarray:
    """The free numbers of an axis."""
    own = {"inertia": axis.inertia, "actuation_delay": axis.actuation_delay}
    numbers = []
    for f in free:
        values: Mapping[str, float] = own
        if f.owner >= -1:
            values = (axis.friction if f.owner == -1 else axis.effects[f.owner]).values
        value = values[f.name]
        if f.kind == "cosine":
            value = value * math.cos(values[f.phase])
        elif f.kind == "sine":
            value = value * math.sin(values[f.phase])
        numbers.append(math.log(max(value, 1e-300)) if f.kind == "log" else value)
    return np.array(numbers)


def put(axis: Axis, free: Sequence[Free], numbers: np.ndarray) -> Axis:
    """The axis with those free numbers, each kept within its declared bounds."""
    own = {"inertia": axis.inertia, "actuation_delay": axis.actuation_delay}
    law: dict[str, float] = {}
    effects: dict[int, dict[str, float]] = {f.owner: {} for f in free if f.owner >= 0}
    cosine = 0.0
    for f, number in zip(free, numbers, strict=True):
        value = math.exp(min(max(number, -700.0), 700.0)) if f.kind == "log" else float(number)
        if f.owner < -1:
            own[f.name] = min(max(value, f.bounds[0]), f.bounds[1])
        elif f.owner == -1:
            law[f.name] = value
        elif f.kind == "cosine":
            cosine = value
        elif f.kind == "sine":
            effects[f.owner][f.name] = math.hypot(cosine, value)
            effects[f.owner][f.phase] = math.atan2(value, cosine) % (2.0 * math.pi)
        else:
            effects[f.owner][f.name] = value
    law = {name: _bounded(axis.friction.term.parameter(name), value) for name, value in law.items()}
    items = tuple(
        item.replace(**{n: _bounded(item.term.parameter(n), v) for n, v in effects[k].items()}) if k in effects else item
        for k, item in enumerate(axis.effects)
    )
    friction = axis.friction.replace(**law)
    inertia, delay = own["inertia"], own["actuation_delay"]
    return replace(axis, inertia=inertia, actuation_delay=delay, friction=friction, effects=items)


def _bounded(parameter: Parameter, value: float) -> float:
    return min(max(value, parameter.lower), parameter.upper)


def at_bound(axis: Axis, free: Sequence[Free], k: int) -> int:
    """Whether number k cannot grow (1), cannot shrink (-1) or is free to move (0)."""
    own, place = _together(free, k)
    number = get(axis, own)[place]
    for sign in (1, -1):
        if not sign * (get(moved(axis, free, k, sign * free[k].scale), own)[place] - number) > 0.0:
            return sign
    return 0


def moved(axis: Axis, free: Sequence[Free], k: int, step: float) -> Axis:
    """The axis with number k moved by a step, as far as its bounds allow, and all else as it is."""
    own, place = _together(free, k)
    numbers = get(axis, own)
    numbers[place] += step
    return put(axis, own, numbers)


def _together(free: Sequence[Free], k: int) -> tuple[Sequence[Free], int]:
    """What number k is put on an axis with, itself or both parts of an amplitude with a phase, and its place there."""
    if free[k].kind == "cosine":
        return free[k : k + 2], 0
    return (free[k - 1 : k + 1], 1) if free[k].kind == "sine" else (free[k : k + 1], 0)


def limited(step: np.ndarray, free: Sequence[Free]) -> np.ndarray:
    """No positive number changes by more than a factor of 2 in one step."""
    logs = np.array([f.kind == "log" for f in free])
    return np.where(logs, np.clip(step, -0.7, 0.7), step)
