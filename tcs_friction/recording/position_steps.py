"""Steps of a position from sample to sample: which are too large for the motion around them, and by which modulus they wrap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording.columns import Mask
from tcs_friction.recording.recording import Column

TURN = 2.0 * np.pi
ANGLES = (TURN, 360.0, 400.0, 1.0, np.pi, 180.0)
"""Full scale of angles in rad, deg, gon and turns, and of half turns."""
COUNTERS = tuple(float(1 << bits) for bits in range(8, 33))
"""Full scale of counters of 8 to 32 bits, whose positions are whole numbers."""

FEWEST = 10
"""Samples that show what is usual around a step."""
HALF = 0.5
"""Of the range: a step over less is no wrap, since the motion within the sample would then be the longer way round."""
FILLED = 0.9
"""Share of a known modulus that a position has covered which crosses its end: it was seen on both sides of it, one step away."""
NEAR_HALF = 0.4
"""Of the modulus: beyond, with an acceleration of a tenth of it within a sample, the other way round is as likely."""
QUARTER = 0.25
"""Of the modulus: usual steps beyond it tell no modulus that nobody knows; a motion of four samples a period would look the same.
Share of steps near half of a known one from which on it is a wheel that turns quickly, not an accident."""
AGREEING = 0.9
"""Share of the large steps that one modulus has to explain."""
SAME = 0.05
"""Share by which what large steps have in common may differ: the motion within a sample changes by no more there."""
LARGER = 2.0
"""Times the largest usual step that a folded one may be: an axis speeds up through its wraps as elsewhere."""
USUAL = 0.999
"""Share of the steps that are usual; the rest may be damage too small to be told from motion."""
ISOLATED = 10.0
"""Times the largest other step from which on a step is no motion."""
GAP_STEPS = 10.0
"""Usual steps of time, as clock.GAP_PERIODS: across a longer one a position may have come from anywhere."""


class Steps:
    """The steps between samples, what each should be by the motion around it, and which are too large for that."""

    def __init__(self, seconds: Column, position: Column, velocity: Column | None) -> None:
        self.position = position
        self.steps, self.spans = np.diff(position), np.diff(seconds)
        self.joined = self.spans <= GAP_STEPS * np.median(self.spans)
        self.range = float(np.ptp(position))
        whole = velocity is not None and bool(np.isfinite(velocity).all())
        self.said = 0.5 * (velocity[1:] + velocity[:-1]) * self.spans if velocity is not None and whole else None
        large = np.abs(self.steps) >= HALF * self.range
        self.large = np.flatnonzero(large & self.joined & ~self._explained(large))
        others = self.joined.copy()
        others[self.large] = False
        self.usual = float(np.quantile(np.abs(self.steps[others]), USUAL)) if others.any() else 0.0
        self.expected = self._around(self.large)

    def believed(self, modulus: float) -> Column | None:
        """The steps that the velocity says, if it says most of what the joined ones do but for whole moduli."""
        if self.said is None:
            return None
        own = self.steps - modulus * np.rint(self.steps / modulus)
        left = self.steps - self.said
        left -= modulus * np.rint(left / modulus)
        usual = self.joined & (np.abs(self.said - median_around(self.said)) < HALF / 2 * modulus)  # no spikes
        return self.said if np.sum(left[usual] ** 2) <= QUARTER * np.sum(own[usual] ** 2) and usual.any() else None

    def _explained(self, large: Mask) -> Mask:
        """Large steps that the velocity says as well: quick motion. Where a driver differentiates a wrap it says a spike."""
        if self.said is None:
            return np.zeros(len(self.steps), dtype=np.bool_)
        alone = np.abs(self.said) > ISOLATED * np.abs(median_around(self.said))
        return large & (np.abs(self.steps - self.said) < HALF / 2 * self.range) & ~alone

    def _around(self, places: NDArray[np.intp]) -> Column:
        """The step that motion makes at each place: the median speed of two steps before and two after, for as long."""
        beside = np.clip(places[:, None] + np.array([-2, -1, 1, 2]), 0, len(self.steps) - 1)
        usable = self.joined[beside] & (beside != places[:, None])
        rates = np.where(usable, self.steps[beside] / self.spans[beside], np.nan)
        rates[~usable.any(axis=1)] = 0.0
        return np.asarray(np.nanmedian(rates, axis=1) * self.spans[places])

    def modulus(self, where: str) -> float:
        """Where the position wraps, 0 if it does not. Raises InputError if it does and no velocity tells the turns."""
        known = (*ANGLES, *COUNTERS) if np.all(self.position == np.rint(self.position)) else ANGLES
        filled = [s for s in known if FILLED * s <= self.range <= s * (1.0 + 1e-9) + min(self.usual, 1e-3 * s)]
        for scale in filled:
            if self._fits(scale):
                return scale
            if np.mean(np.abs(self.steps) > NEAR_HALF * scale) > QUARTER:
                if self.believed(scale) is None:
                    raise too_quick(where, scale, NEAR_HALF * scale, "more than")
                return scale
        found = self._common()
        found = next((scale for scale in known if abs(scale - found) <= min(self.usual, SAME * scale)), found)
        return found if found and self._fits(found) else 0.0

    def _common(self) -> float:
        """What the large steps have in common, 0 if that is nothing or the motion through them is not seen."""
        if len(self.large) < 2:
            return 0.0
        jumps = np.abs(self.steps[self.large] - self.expected)
        found = float(np.median(jumps))
        against = np.sign(self.expected) == -np.sign(self.steps[self.large])
        alike = np.abs(jumps - found) <= SAME * found
        few = np.count_nonzero(alike & against) < max(2.0, AGREEING * len(jumps))
        return 0.0 if few or self.range > found + self.usual or self.usual > QUARTER * found else found

    def _fits(self, modulus: float) -> bool:
        """Whether the large steps, folded, are steps like others: as small, and as expected."""
        if not len(self.large):
            return False
        steps = self.steps[self.large]
        turns = np.rint((steps - self.expected) / modulus)
        fine = np.abs(steps - modulus * turns) <= LARGER * max(self.usual, float(np.abs(self.expected).max()))
        return bool(np.count_nonzero(fine & (turns != 0)) >= AGREEING * len(steps))

    def turns(self, modulus: float) -> tuple[NDArray[np.float64], Column]:
        """How many moduli each step has too many, and what is left of it."""
        expected: Column | float = 0.0
        if (said := self.believed(modulus)) is not None:
            around = median_around(said)
            expected = np.where(np.abs(said - around) > HALF / 2 * modulus, around, said)
            expected = np.where(self.joined, expected, 0.0)
        turns = np.rint((self.steps - expected) / modulus)
        return turns, self.steps - modulus * turns


def too_quick(where: str, modulus: float, step: float, how: str) -> InputError:
    """The refusal of a position that wraps and moves `how` so far between two samples."""
    found = f"the position wraps at {shown(modulus)} and moves by {how} {step:.3g} within a sample"
    return InputError(where, f"{found}: which way round nobody can tell", "a higher rate, or the velocity beside it")


def median_around(values: Column) -> Column:
    """The median of the second to fourth before and after each value: it and its neighbours may be a spike."""
    framed = np.pad(values, 4, mode="edge")
    count = len(values)
    return np.asarray(np.median([framed[4 + shift : 4 + shift + count] for shift in (-4, -3, -2, 2, 3, 4)], axis=0))


def shown(modulus: float) -> str:
    """A modulus for people; of an angle in rad, which is what a turn is recorded in, with its unit."""
    if modulus in (TURN, np.pi):
        return f"{modulus:.5g} rad"
    return f"{modulus:.10g}" if modulus in (*ANGLES, *COUNTERS) else f"{modulus:.5g}"
