"""Stretches in which a position stays as it was while the axis moves on: a reading that has stopped, and no axis at rest.

An axis at rest says the same value, too. It is told apart by what comes next: it starts slowly, while a reading that comes back
is far from where it stopped, and moving. A velocity tells it as well, where one is recorded.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcs_friction.numerics.integral import travelled
from tcs_friction.recording.clock import GAP_PERIODS
from tcs_friction.recording.columns import Mask, counted
from tcs_friction.recording.position_steps import FEWEST, HALF, LARGER
from tcs_friction.recording.recording import Column

LEAST = int(GAP_PERIODS)
"""Samples for which nothing changes: as long as no signal is held or interpolated over."""


def frozen(
    seconds: Column, position: Column, velocity: Column | None = None, restarts: Sequence[int] = ()
) -> tuple[Mask | None, tuple[str, ...]]:
    """Which samples of a position (n,) are only repeated, None where none are, and what to say of them.

    seconds: (n,) strictly increasing. position, velocity: NaN where unknown; velocity: (n,) or None. restarts: samples with which
    a clock begins anew; there and after gaps a position may have come from anywhere. The first of the equal samples is good.
    """
    thin = position[:: LEAST // 2]
    if len(position) < FEWEST or not (thin[1:] == thin[:-1]).any():
        return None, ()  # the usual case, at the price of a fifth of a pass
    steps, spans = np.diff(position), np.diff(seconds)
    edges = np.concatenate(([0], np.flatnonzero(steps) + 1, [len(position)]))
    long = np.flatnonzero(np.diff(edges) > LEAST)
    first, after = edges[long], edges[long + 1]
    leaving = np.zeros(len(steps), dtype=np.bool_)
    leaving[after[after < len(position)] - 1] = True
    steps[spans > GAP_PERIODS * np.median(spans)] = 0.0
    steps[np.asarray(restarts, dtype=np.intp) - 1] = 0.0
    usual = float(np.nanmax(np.abs(steps[~leaving]), initial=0.0))
    ways = None if velocity is None else travelled(seconds, np.where(np.isfinite(velocity), velocity, 0.0))
    stopped = [
        (a, b)
        for a, b in zip(first.tolist(), after.tolist(), strict=True)
        if _comes_back_elsewhere(steps, b, usual) or (ways is not None and _goes_on(seconds[a:b], ways[a:b], usual))
    ]
    if not stopped or usual == 0.0:
        return None, ()
    repeated = np.zeros(len(position), dtype=np.bool_)
    for a, b in stopped:
        repeated[a + 1 : b] = True
    a, b = max(stopped, key=lambda one: seconds[one[1] - 1] - seconds[one[0]])
    longest = f"{seconds[b - 1] - seconds[a]:.4g} s from {seconds[a] - seconds[0]:.4g} s on"
    where = f"for {longest}" if len(stopped) == 1 else f"at {counted(len(stopped), 'place')}, longest for {longest}"
    return repeated, (f"position: frozen {where}, as no axis rests; cut out",)


def _comes_back_elsewhere(steps: Column, after: int, usual: float) -> bool:
    """Whether the first new value is further away than a sample takes an axis, and the motion goes on from there."""
    on = steps[after : after + LEAST]
    moving = np.count_nonzero(on) > HALF * LEAST
    return bool(moving) and abs(float(steps[after - 1])) > LARGER * usual


def _goes_on(seconds: Column, way: Column, usual: float) -> bool:
    """Whether the way, but for the constant speed that an offset of a velocity would make, is more than a freeze hides at most.

    That is LEAST of the largest steps of the position.
    """
    return float(np.ptp(way - np.interp(seconds, seconds[[0, -1]], way[[0, -1]]))) > LEAST * usual
