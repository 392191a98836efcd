"""Angles that begin anew after a turn, as absolute encoders give them: which turn is meant, and what of the travel is left.

An angle is put into the turn in which it is nearest to where the axis is expected. Where the axis begins only the travel tells
it; over more than a turn, as cables allow, an angle may have several places, and then somebody has to say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tcs_friction.control.config_field import setting
from tcs_friction.errors import InputError

TURN = 2.0 * math.pi
MOST_TURNS = 2.0**50
"""Beyond it a number has no digits left for an angle."""
UNBOUNDED = 1e8
"""rad: a travel from here on says that there is none; the defaults are ten times as far."""
SHOWN = 4
"""Places named in one line."""


def beside(position: float, expected: float) -> float:
    """An angle (rad) in the turn in which it is nearest to an expected one; as it is where one of them is no angle."""
    away = (expected - position) / TURN
    return position + TURN * round(away) if abs(away) < MOST_TURNS else position


@dataclass(frozen=True)
class Travel:
    """How far an axis may go. Of a continuous axis it may be several turns: what its cables allow."""

    travel_from: float = setting(-1e9, "rad", -1e9, 1e9, "real time: no torque downwards below this position, no programme there")
    travel_to: float = setting(1e9, "rad", -1e9, 1e9, "real time: no torque upwards above this position, no programme there")

    def conflict(self) -> list[str]:
        """What does not go together."""
        empty = self.travel_from > self.travel_to
        return [f"travel_from is {self.travel_from:g}, expected at most travel_to ({self.travel_to:g})"] if empty else []

    @property
    def bounded(self) -> bool:
        """Whether there is an end either way."""
        return self.travel_from > -UNBOUNDED and self.travel_to < UNBOUNDED

    def places(self, position: float) -> tuple[float, ...]:
        """Where within a bounded travel an angle (rad) may be."""
        first = math.ceil((self.travel_from - position) / TURN)
        last = math.floor((self.travel_to - position) / TURN)
        return tuple(position + TURN * turn for turn in range(first, last + 1))

    def placed(self, position: float) -> float:
        """The first angle (rad) of an axis whose turn nobody has told: as it is, or else nearest to the travel's middle."""
        inside = self.travel_from <= position <= self.travel_to
        return position if inside or not self.bounded else beside(position, 0.5 * (self.travel_from + self.travel_to))

    def shift(self, lowest: float, highest: float, begin: float, here: float, continuous: bool) -> float:
        """What is to be added to the positions of a programme (rad) so that it stays within the travel.

        Whole turns of a continuous axis, as few from `here` to where it begins as the travel allows; else 0. Raises InputError
        where the programme leaves the travel in any case.
        """
        near = beside(begin, here) - begin if continuous else 0.0
        nearest = round(near / TURN)
        first = math.ceil((self.travel_from - lowest) / TURN)
        last = math.floor((self.travel_to - highest) / TURN)
        turn = min(max(nearest, first), last)
        if turn < first or not (continuous or first <= 0 <= last):
            found = f"a programme from {lowest:.4g} to {highest:.4g} rad"
            wanted = f"within the travel, {self.travel_from:.4g} to {self.travel_to:.4g} rad"
            raise InputError("reference", found, f"{wanted}{', in any turn' if continuous else ''}")
        return TURN * turn if continuous else 0.0


class Turns:
    """A driver's: the position of a continuous axis over its turns, from angles that begin anew after each.

    `unknown` says why the turn is not known, "" when it is: there must be no torque near the ends of a travel that nobody knows.
    """

    def __init__(self) -> None:
        self.unknown = ""
        self._last: tuple[float, float, float] | None = None  # time in s, position, speed
        self._near: float | None = None
        self._told: float | None = None
        self._travel = Travel()
        self.configure(Travel(), 1.0)

    def configure(self, travel: Travel, reach: float, near: float | None = None) -> None:
        """reach: largest speed, rad/s. near: where the axis is, within half a turn: counts once, for the next angle."""
        told = near is not None and near != self._near
        if told:
            self._told = near
        if told or self.unknown or (near is None and travel.bounded and not self._travel.bounded):
            self._last = None
        self._travel, self._reach, self._near = travel, reach, near

    def follow(self, at: float, position: float, speed: float) -> float:
        """The position over the turns (rad) of an angle at a time (s) that is later than the one before."""
        last = self._last
        if last is None:
            position = self._begin(position)
        else:
            span = at - last[0]
            position = beside(position, last[1] + 0.5 * (last[2] + speed) * span)
            if self._reach * span >= 0.5 * TURN:
                self.unknown = self._objection(position, f"after {span:.3g} s without a position")
                position = self._travel.placed(position)
        self._last = (at, position, speed)
        return position

    def _begin(self, position: float) -> float:
        self.unknown = ""
        if self._told is not None:
            told, self._told = self._told, None
            return beside(position, told)
        self.unknown = self._objection(position, "at the start")
        return self._travel.placed(position)

    def _objection(self, position: float, when: str) -> str:
        """Why the travel does not tell the turn, "" when it does or nobody needs it."""
        if not self._travel.bounded:
            return ""
        places = self._travel.places(position)
        if len(places) == 1:
            return ""
        above = position + TURN * math.ceil((self._travel.travel_to - position) / TURN)
        told = " or ".join(f"{place:.4g}" for place in places[:SHOWN] or (above - TURN, above))
        where = "within" if places else "beyond"
        return f"{when} the axis may be at {told} rad, {where} its travel: set start_near to where it is"
