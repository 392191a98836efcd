"""What of an axis a simulator can say with a few numbers: dry friction, damping, a spring; and how well they say it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from tcs_friction.control.model_compensator import AT_REST
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.steady_friction import over_speed, steady
from tcs_friction.physics.terms import Instance, Place

SPEEDS = 200  # at which friction is looked at, evenly up to the fastest
PLACES = 2001  # at which a torque over the position is looked at


def over_position(axis: Axis, items: tuple[Instance, ...], places: np.ndarray, speed: float = 0.0) -> np.ndarray:
    """Torque (N m) of some OPPOSING effects at positions (n,), rad, in this order, at a speed (rad/s)."""
    alone = replace(axis, effects=items)
    terms = [item for item in alone.terms if item.term.place is Place.OPPOSING]
    machine = compiled.build(alone, 1e-3, terms=terms)
    out, rest = np.zeros((len(places), 8)), np.zeros(len(places))
    t = 1e-3 * np.arange(len(places))
    compiled.evaluate(machine, t, places, np.full(len(places), speed), rest, rest, np.full((1, len(places)), 20.0), AT_REST, out)
    return out[:, compiled.OPPOSED].copy()


@dataclass(frozen=True)
class Fitted:
    """Friction over the speed with a simulator's numbers, up to `fastest` (rad/s).

    dry: N m. damping: of v, v|v| and v^3, as far as the simulator has them. off: largest difference over the friction there,
    and at which speed (rad/s). uneven: N m rms, of the difference between directions, which no simulator has.
    """

    dry: float
    damping: tuple[float, ...]
    off: float
    where: float
    uneven: float
    fastest: float


def fitted(axis: Axis, fastest: float, powers: int, known: Axis | None = None) -> Fitted:
    """The numbers that say an axis' steady friction best in least squares.

    powers: how many of v, v|v|, v^3 the simulator has. known: an axis whose dry friction it has already; None: a constant one.
    """
    axis = replace(axis, effects=over_speed(axis), actuation_delay=0.0)
    speeds = np.linspace(fastest / SPEEDS, fastest, SPEEDS)
    forward, back = steady(axis, speeds), steady(axis, -speeds)
    odd = 0.5 * (forward - back)
    columns = np.column_stack([np.ones(SPEEDS), *(speeds**power for power in range(1, powers + 1))])
    rest, free = (odd, columns) if known is None else (odd - steady(known, speeds), columns[:, 1:])
    scale = np.abs(free).max(axis=0)
    lower = np.full(free.shape[1], 0.0)
    lower[len(lower) - powers + 1 :] = -np.inf
    found = lsq_linear(free / scale, rest, (lower, np.full(len(lower), np.inf))).x / scale
    apart = np.abs(rest - free @ found) / np.abs(odd)
    worst = int(np.argmax(apart))
    values = found if known is None else np.concatenate([[0.0], found])
    uneven = float(np.sqrt(np.mean((0.5 * (forward + back)) ** 2)))
    return Fitted(float(values[0]), tuple(map(float, values[1:])), float(apart[worst]), float(speeds[worst]), uneven, fastest)


@dataclass(frozen=True)
class Spring:
    """A torque over the position as a spring: stiffness of x, x^2, x^3 about `neutral`; off: rms left over that of all."""

    stiffness: tuple[float, ...]
    neutral: float
    off: float


def spring(axis: Axis, items: tuple[Instance, ...], travel: tuple[float, float], powers: int) -> Spring:
    """The spring that says some effects' torque over a travel (rad) best."""
    places = np.linspace(*travel, PLACES)
    torque = over_position(axis, items, places)
    slope, at_zero = np.polyfit(places, torque, 1)
    own = [item.values[item.term.neutral] for item in items if item.term.neutral]
    neutral = own[0] if len(own) == len(items) == 1 else float(-at_zero / slope) if slope else 0.0
    x = places - neutral
    columns = np.column_stack([x**power for power in range(1, powers + 1)])
    found = np.linalg.lstsq(columns, torque, rcond=None)[0]
    left = np.sqrt(np.mean((torque - columns @ found) ** 2) / max(np.mean(torque**2), 1e-300))
    return Spring(tuple(map(float, found)), float(neutral), float(left))
