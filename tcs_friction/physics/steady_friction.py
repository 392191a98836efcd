"""Friction of an axis in steady sliding, over the speed."""

from __future__ import annotations

import numpy as np

from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place

SETTLED = 60  # bristle lengths: what is left of a start is exp(-60)
SHORTEST_WAY = 1e-6  # rad, of a law without bristles
OVER_SPEED = ("velocity", "direction")
SLIDING = 1e-9  # rad/s, over which a law's jump at rest is spread: less than any speed that is asked for


def over_speed(axis: Axis) -> tuple[Instance, ...]:
    """The effects that shape friction over the speed."""
    places = (Place.SCALE, Place.OPPOSING)
    return tuple(item for item in axis.effects if item.term.coordinate in OVER_SPEED and item.term.place in places)


def steady(axis: Axis, speeds: np.ndarray, temperature: float = 20.0, position: float = 0.0) -> np.ndarray:
    """Opposing torque (N m) of law and effects in steady sliding at speeds (n,), rad/s, other than 0, where the axis is given."""
    terms = [item for item in axis.terms if item.term.place in (Place.SCALE, Place.LAW, Place.OPPOSING)]
    signals = tuple(dict.fromkeys(name for item in terms for name in item.signals))
    way, found = max(axis.bristle, SHORTEST_WAY), np.empty(len(speeds))
    for k, speed in enumerate(speeds):
        machine = compiled.build(axis, 1e-3, signals=signals, terms=terms)
        t = np.arange(SETTLED) * way / abs(speed)
        q = position + speed * (t - t[-1])
        out, around = np.zeros((SETTLED, 8)), np.zeros((1 + len(signals), SETTLED))
        around[0] = temperature
        compiled.evaluate(machine, t, q, np.full(SETTLED, speed), np.zeros(SETTLED), np.zeros(SETTLED), around, SLIDING, out)
        found[k] = out[-1, compiled.REQUIRED]
    return found
