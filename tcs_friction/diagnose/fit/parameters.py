"""The free numbers of a joint fit: what of an axis may change, in which form, and between which bounds.

In: an axis. Out: a list of `FreeNumber`, and functions that read them from an axis and write them into one. Positive
quantities are fitted as logarithms. An amplitude A with a phase p is fitted as A cos(p) and A sin(p), in which the torque is
linear.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Parameter, Role

RELATIVE_STEP = 1e-4  # of differences in a logarithm: far above rounding errors (1e-16), far below curvature
AMPLITUDE_STEP = 1e-2  # of differences in a linear number, relative; its torque is linear, so a large step costs nothing
SMALL_AMPLITUDES = {"": 0.01, "1/degC": 0.001, "rad": 1e-7}  # by unit, of effects that are only nearly linear in them
SMALLEST = 1e-300  # stands for zero in logarithms
LARGEST_LOGARITHM = 700.0  # of a double


class Part(enum.Enum):
    """The part of an axis that a free number belongs to."""

    ALIGNMENT = "alignment"  # lateness of the logged torque
    INERTIA = "inertia"
    FRICTION = "friction"
    EFFECT = "effect"


class Form(enum.Enum):
    """How a free number stands for a parameter."""

    PLAIN = "plain"
    LOGARITHM = "logarithm"
    COSINE = "cosine"  # amplitude times the cosine of its phase
    SINE = "sine"  # the same with the sine; follows its cosine in every list


@dataclass(frozen=True)
class FreeNumber:
    """One free number of a fit.

    name: of the parameter. step: a small change of the number. effect: identity of the effect that it belongs to, None for other
    parts. phase: name of the phase that goes with an amplitude. bounds: of numbers that no term declares.
    """

    part: Part
    name: str
    form: Form
    step: float
    effect: int | None = None
    phase: str = ""
    bounds: tuple[float, float] = (-math.inf, math.inf)

    def item(self, axis: Axis) -> Instance | None:
        """The effect of the axis that the number belongs to, None for other parts."""
        return next((item for item in axis.effects if item.identity == self.effect), None)

    def is_order_of(self, item: Instance) -> bool:
        """Whether it is the order, or the frequency, of a periodic effect."""
        return bool(item.term.periodic) and self.effect == item.identity and self.name == item.term.order.name


INERTIA = FreeNumber(Part.INERTIA, "inertia", Form.LOGARITHM, RELATIVE_STEP, bounds=(SMALLEST, math.inf))


def amplitudes(parameters: Sequence[Parameter]) -> list[tuple[Parameter, Parameter | None]]:
    """Each parameter with its phase, None if it has none."""
    result: list[tuple[Parameter, Parameter | None]] = []
    for parameter in parameters:
        if parameter.role is Role.PHASE:
            result[-1] = (result[-1][0], parameter)
        else:
            result.append((parameter, None))
    return result


def free_parameters(axis: Axis, torque_step: float = 1.0) -> list[FreeNumber]:
    """What a joint fit of this axis may change: inertia, the law's parameters, every effect's active parameters.

    `torque_step`: change of the amplitude, N m, of a torque wave. A parameter at its default is switched off and stays there.
    """
    free = [INERTIA]
    for parameter in axis.friction.term.parameters:
        if parameter.role is not Role.FIXED and axis.friction.values[parameter.name] > 0.0:
            free.append(FreeNumber(Part.FRICTION, parameter.name, Form.LOGARITHM, RELATIVE_STEP))
    for item in axis.effects:
        for parameter, phase in amplitudes(item.term.parameters):
            value = item.values[parameter.name]
            switched_off = parameter.default is not None and value == parameter.default
            if parameter.role is not Role.FIXED and not switched_off:
                free += _numbers_of(item, parameter, phase, torque_step)
    return free


def _numbers_of(
    item: Instance, parameter: Parameter, phase: Parameter | None, torque_step: float
) -> list[FreeNumber]:
    """The free numbers of one parameter of an effect."""

    def number(form: Form, step: float, phase_name: str = "") -> FreeNumber:
        return FreeNumber(Part.EFFECT, parameter.name, form, step, item.identity, phase_name)

    value = abs(item.values[parameter.name])
    if phase is not None:
        step = small_amplitude(parameter.unit, torque_step)
        return [number(form, step, phase.name) for form in (Form.COSINE, Form.SINE)]
    if parameter.role is Role.LINEAR:
        return [number(Form.PLAIN, AMPLITUDE_STEP * max(value, 1e-12))]
    if parameter.lower >= 0.0:
        return [number(Form.LOGARITHM, RELATIVE_STEP)]
    return [number(Form.PLAIN, RELATIVE_STEP * max(1.0, value))]


def small_amplitude(unit: str, torque: float = 1.0) -> float:
    """An amplitude in which effects are linear, also those that are only nearly so; `torque`: of those that are a torque, N m."""
    return SMALL_AMPLITUDES.get(unit, torque)


def read_numbers(axis: Axis, free: Sequence[FreeNumber]) -> np.ndarray:
    """The free numbers (k,) of an axis."""
    return np.array([_read(axis, number) for number in free])


def _read(axis: Axis, number: FreeNumber) -> float:
    if number.part is Part.INERTIA:
        return _as_number(number, {number.name: axis.inertia})
    if number.part is Part.ALIGNMENT:
        return _as_number(number, {number.name: axis.lateness})
    item = axis.friction if number.part is Part.FRICTION else number.item(axis)
    assert item is not None
    return _as_number(number, item.values)


def _as_number(number: FreeNumber, values: Mapping[str, float]) -> float:
    """A free number from the values of what it belongs to."""
    value = values[number.name]
    if number.form is Form.COSINE:
        return value * math.cos(values[number.phase])
    if number.form is Form.SINE:
        return value * math.sin(values[number.phase])
    return math.log(max(value, SMALLEST)) if number.form is Form.LOGARITHM else value


def with_numbers(axis: Axis, free: Sequence[FreeNumber], numbers: np.ndarray) -> Axis:
    """The axis with those free numbers (k,), each kept within its declared bounds."""
    own = {"inertia": axis.inertia, "lateness": axis.lateness}
    law: dict[str, float] = {}
    effects: dict[int, dict[str, float]] = {}
    cosine = 0.0
    for number, value in zip(free, numbers, strict=True):
        if number.form is Form.COSINE:
            cosine = float(value)
        elif number.effect is not None:
            effects.setdefault(number.effect, {}).update(_values(number, float(value), cosine))
        else:
            (law if number.part is Part.FRICTION else own).update(_values(number, float(value)))
    items = tuple(_with_values(item, effects.get(item.identity, {})) for item in axis.effects)
    friction = _with_values(axis.friction, law)
    return replace(axis, inertia=own["inertia"], lateness=own["lateness"], friction=friction, effects=items)


def _values(number: FreeNumber, value: float, cosine: float = 0.0) -> dict[str, float]:
    """The parameters that a number stands for; `cosine`: the number before that of a sine."""
    if number.form is Form.SINE:
        return {number.name: math.hypot(cosine, value), number.phase: math.atan2(value, cosine) % (2.0 * math.pi)}
    if number.form is Form.LOGARITHM:
        value = math.exp(min(max(value, -LARGEST_LOGARITHM), LARGEST_LOGARITHM))
    return {number.name: min(max(value, number.bounds[0]), number.bounds[1])}


def _with_values(item: Instance, values: Mapping[str, float]) -> Instance:
    """The term with some values changed, as far as its bounds allow."""
    return item.replace(**_within_bounds(item, values)) if values else item


def _within_bounds(item: Instance, values: Mapping[str, float]) -> dict[str, float]:
    declared = {name: item.term.parameter(name) for name in values}
    return {name: min(max(v, declared[name].lower), declared[name].upper) for name, v in values.items()}


def bound_reached(axis: Axis, free: Sequence[FreeNumber], k: int) -> int:
    """Whether number k cannot grow (1), cannot shrink (-1) or can do both (0)."""
    own, place = _with_its_pair(free, k)
    numbers = read_numbers(axis, own)
    item = axis.friction if free[k].part is Part.FRICTION else free[k].item(axis)
    for sign in (1, -1):
        asked = numbers.copy()
        asked[place] += sign * free[k].step
        values = _values(own[-1], float(asked[-1]), float(asked[0]))
        kept = values if item is None else _within_bounds(item, values)
        if not sign * (_as_number(free[k], kept) - numbers[place]) > 0.0:
            return sign
    return 0


def moved(axis: Axis, free: Sequence[FreeNumber], k: int, step: float) -> Axis:
    """The axis with number k moved by a step, as far as its bounds allow, and all else as it is."""
    own, place = _with_its_pair(free, k)
    numbers = read_numbers(axis, own)
    numbers[place] += step
    return with_numbers(axis, own, numbers)


def _with_its_pair(free: Sequence[FreeNumber], k: int) -> tuple[Sequence[FreeNumber], int]:
    """The numbers that are written together with number k, itself or both of an amplitude with a phase, and its place there."""
    if free[k].form is Form.COSINE:
        return free[k : k + 2], 0
    return (free[k - 1 : k + 1], 1) if free[k].form is Form.SINE else (free[k : k + 1], 0)


def belongs_to(number: FreeNumber, items: Sequence[Instance]) -> bool:
    """Whether a free number is one of these effects' numbers."""
    return number.effect is not None and any(item.identity == number.effect for item in items)
