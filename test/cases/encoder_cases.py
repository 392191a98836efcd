"""What absolute encoders say of a position, rad."""

from __future__ import annotations

import math

from tcs_friction.control.turns import TURN


def from_zero(position: float) -> float:
    """0 to 2 pi."""
    return position % TURN


def symmetric(position: float) -> float:
    """-pi to pi."""
    return (position + math.pi) % TURN - math.pi


def as_it_is(position: float) -> float:
    return position
