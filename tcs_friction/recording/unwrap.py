"""Positions that wrap at a turn, or wherever a counter ends, made continuous; single spikes and new zeros are told apart.

A position wraps where one sample takes it over more than half of its range, and where the same step, folded by a modulus, is as
small as the steps around it or as the velocity says. The modulus is that of a known kind, whose range the position fills, or what
at least two such steps have in common while the axis moves through them the other way. No modulus is smaller than the range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError
from tcs_friction.recording.columns import Mask, counted
from tcs_friction.recording.position_steps import (
    FEWEST,
    HALF,
    ISOLATED,
    LARGER,
    NEAR_HALF,
    USUAL,
    Steps,
    median_around,
    shown,
    too_quick,
)
from tcs_friction.recording.recording import Column

LONGEST_SPIKE = 3
"""Samples after which a reading that was wrong is right again; longer, and the position was set."""
RARE = 0.01
"""Share of the samples beyond which there-and-back is a motion, not damage."""
ROUNDS = 8
"""Sizes of spikes that are taken out one after the other: larger ones hide smaller ones."""
TURNS = {360.0: "deg", 400.0: "gon", 21600.0: "arcmin", 1296000.0: "arcsec", 2000.0 * math.pi: "mrad"}
LEAST_BITS, SAME = 7.5, 1e-9
"""Of counters that encoders have: 8 and more; by how much a modulus may be off, relative."""


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """position: (n,) continuous, in its own unit; velocity: (n,) without what a driver makes of wraps, None if there is none.

    spikes: (n,) true where a sample is no position, left as it is. cuts: samples before which the position was set anew.
    modulus: 0 where nothing wraps; places: how often it does. notes: what was found, one line each.
    """

    position: Column
    velocity: Column | None
    spikes: Mask
    cuts: tuple[int, ...] = ()
    modulus: float = 0.0
    places: int = 0
    notes: tuple[str, ...] = ()

    def beside(self, reference: Column) -> Column:
        """Another position of the same axis in the turn of this one."""
        if not self.modulus:
            return reference
        turns = np.rint((self.position - reference) / self.modulus)
        return reference + self.modulus * np.where(np.isfinite(turns), turns, 0.0)


def unwrapped(seconds: Column, position: Column, velocity: Column | None = None, where: str = "recording") -> Unwrapped:
    """A position as it was recorded, continuous.

    seconds: (n,) strictly increasing. position: (n,) finite, any unit. velocity: (n,) per second, NaN where unknown, or None;
    believed where it agrees with the steps between wraps. Raises InputError (about `where`) if the position wraps and moves so
    far within a sample that nobody can tell the turns.
    """
    unchanged = Unwrapped(position, velocity, np.zeros(len(position), dtype=np.bool_))
    if len(position) < FEWEST:
        return unchanged
    with np.errstate(over="ignore", invalid="ignore"):  # of damage that is beyond all numbers
        span = float(np.ptp(position))
        steps = np.diff(position)
        if not 0.0 < span < np.inf or max(float(steps.max()), -float(steps.min())) < HALF * span:
            return unchanged  # the usual case, at the price of three passes
        return _unwrapped(unchanged, seconds, where)


def refuse_other_unit(modulus: float, where: str) -> None:
    """Raises InputError where a position that is taken for rad or m wraps at a turn of another unit, or where a counter ends."""
    unit = next((unit for turn, unit in TURNS.items() if math.isclose(modulus, turn, rel_tol=SAME)), "")
    bits = math.log2(modulus) if modulus > 0.0 else 0.0
    if unit:
        raise InputError(where, f"the position wraps at {shown(modulus)}: it is in {unit}", f"the unit {unit} to be said for it")
    if bits > LEAST_BITS and abs(bits - round(bits)) < SAME:
        expected = "signals: position: {scale: of a count}, in the axis file"
        raise InputError(where, f"the position wraps at {shown(modulus)}: it holds counts", expected)


def _unwrapped(unchanged: Unwrapped, seconds: Column, where: str) -> Unwrapped:
    position, velocity = unchanged.position, unchanged.velocity
    whole = Steps(seconds, position, velocity)
    modulus, kept = whole.modulus(where), np.arange(len(position))
    if not modulus:
        kept = _without_spikes(whole)
        if len(kept) < len(position):
            whole = Steps(seconds[kept], position[kept], None if velocity is None else velocity[kept])
            modulus = whole.modulus(where)
    if not modulus:
        return _not_wrapping(unchanged, whole, kept)
    return _continuous(unchanged, whole, kept, modulus, where)


def _without_spikes(whole: Steps) -> NDArray[np.intp]:
    """The samples without those that go over half of the range and are back at once; all where that is no exception."""
    position = whole.position
    kept = everything = np.arange(len(position))
    for _ in range(ROUNDS):
        values = position[kept]
        steps = np.diff(values)
        large = np.abs(steps) >= HALF * np.ptp(values)
        if not large.any() or np.count_nonzero(large) > max(2.0, 2 * RARE * len(position)):
            break
        large &= np.abs(steps) > LARGER * np.quantile(np.abs(steps[~large]), USUAL)
        wrong = np.zeros(len(kept), dtype=np.bool_)
        for place in np.flatnonzero(large):
            after = values[place + 2 : place + 2 + LONGEST_SPIKE]
            back = np.flatnonzero(np.abs(after - values[place]) <= 0.1 * abs(steps[place]))
            if len(back) and not wrong[place]:
                wrong[place + 1 : place + 2 + back[0]] = True
        if not wrong.any():
            break
        kept = kept[~wrong]
    few = len(position) - len(kept) <= max(1.0, RARE * len(position))
    return kept if few else everything


def _not_wrapping(unchanged: Unwrapped, steps: Steps, kept: NDArray[np.intp]) -> Unwrapped:
    """The position as it is, with what no motion explains."""
    spikes = unchanged.spikes.copy()
    spikes[:] = True
    spikes[kept] = False
    cuts = _set_anew(steps.steps, steps.large)
    return Unwrapped(
        unchanged.position, unchanged.velocity, spikes, tuple(kept[cuts + 1].tolist()),
        notes=(*_said_of_spikes(spikes), *_said_of_cuts(steps.steps[cuts])),
    )  # fmt: skip


def _set_anew(steps: Column, large: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the large steps that nothing else in the recording comes near: the position was set, not moved."""
    others = np.ones(len(steps), dtype=np.bool_)
    others[large] = False
    usual = np.abs(steps[others]).max(initial=0.0)
    chosen = large[np.abs(steps[large]) > ISOLATED * usual]
    return chosen if len(chosen) == len(large) and len(large) <= max(1.0, RARE * len(steps)) else large[:0]


def _continuous(unchanged: Unwrapped, steps: Steps, kept: NDArray[np.intp], modulus: float, where: str) -> Unwrapped:
    turns, left = steps.turns(modulus)
    if not turns.any():
        return unchanged
    unsure = np.flatnonzero((np.abs(left) > NEAR_HALF * modulus) & steps.joined)
    cuts = _set_anew(left, unsure)
    if len(unsure) > len(cuts) and steps.believed(modulus) is None:
        raise too_quick(where, modulus, float(np.abs(left[unsure]).max()), "up to")
    offsets = np.concatenate(([0.0], np.cumsum(turns)))
    number = np.searchsorted(kept, np.arange(len(unchanged.position)), side="right") - 1
    position = unchanged.position - modulus * offsets[np.maximum(number, 0)]
    spikes, position = _restored(position, kept, modulus, LARGER * steps.usual)
    joined = turns[steps.joined]
    places = int(np.count_nonzero(joined)) + 2 * int(len(position) - len(kept) - np.count_nonzero(spikes))
    velocity, mended = _mended(unchanged.velocity, steps, kept, turns, modulus)
    notes = [f"position: wraps at {shown(modulus)}, unwrapped at {counted(places, 'place')}"]
    if mended:
        notes.append(f"velocity: {counted(mended, 'sample')} at wraps replaced by the velocity around them")
    notes += [*_said_of_spikes(spikes), *_said_of_cuts(left[cuts])]
    return Unwrapped(position, velocity, spikes, tuple(kept[cuts + 1].tolist()), modulus, places, tuple(notes))


def _restored(position: Column, kept: NDArray[np.intp], modulus: float, most: float) -> tuple[Mask, Column]:
    """Samples that were set aside as spikes and are whole moduli away from their neighbours come back."""
    spikes = np.ones(len(position), dtype=np.bool_)
    spikes[kept] = False
    places = np.flatnonzero(spikes)
    beside = position[kept[np.clip(np.searchsorted(kept, places) - 1, 0, None)]]
    moved = position[places] - modulus * np.rint((position[places] - beside) / modulus)
    back = np.abs(moved - beside) <= most
    position = position.copy()
    position[places[back]] = moved[back]
    spikes[places[back]] = False
    return spikes, position


def _mended(
    velocity: Column | None, steps: Steps, kept: NDArray[np.intp], turns: Column, modulus: float
) -> tuple[Column | None, int]:
    """The velocity without the spikes of one that was made from the wrapping position, and how many there were."""
    if velocity is None:
        return None, 0
    places = np.flatnonzero((turns != 0) & steps.joined)
    beside = np.unique(np.clip(places[:, None] + np.arange(-1, 3), 0, len(kept) - 1))
    own = velocity[kept]
    around = median_around(own)
    wrong = beside[np.abs(own[beside] - around[beside]) > HALF / 2 * modulus / np.median(steps.spans)]
    if not len(wrong):
        return velocity, 0
    result = velocity.copy()
    result[kept[wrong]] = around[wrong]
    return result, len(wrong)


def _said_of_spikes(spikes: Mask) -> list[str]:
    count = int(np.count_nonzero(spikes))
    return [f"position: {counted(count, 'sample')} far off and back at once, left out"] if count else []


def _said_of_cuts(jumps: Column) -> list[str]:
    if not len(jumps):
        return []
    size = np.abs(jumps).max()
    return [
        f"position: jumps by {size:.4g} within a sample ({counted(len(jumps), 'place')}), no motion and no wrap; cut there"
    ]
