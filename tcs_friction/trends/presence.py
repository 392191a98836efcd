"""Effects that appear or vanish: of the diagnosed recordings, which name an effect, before and after some day."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import hypergeom

from tcs_friction.trends.rows import Array, AxisRows, Effect, Mask

SIDE = 3  # recordings on each side
FEWEST = 8
DIFFERENT = 0.5  # share of the recordings by which sides have to differ
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Presence:
    """An effect that appeared (or vanished) between `earliest` and `latest` (days since 1970).

    before, after: share of the diagnosed recordings that have it. example: the largest one; equivalent: what else it may be.
    """

    effect: str
    equivalent: tuple[str, ...]
    appears: bool
    day: float
    earliest: float
    latest: float
    before: float
    after: float
    p_value: float
    example: Effect
    torque_rms: float


def effects_named(rows: AxisRows) -> list[str]:
    """Every effect that some recording names, the most frequent first."""
    names = [item.name for found in rows.effects for item in found]
    return sorted(set(names), key=lambda name: (-names.count(name), name))


def has(found: Sequence[Effect], name: str) -> bool:
    """Whether a recording has the effect, or one that it cannot tell from it."""
    return any(name == item.name or name in item.equivalent for item in found)


def presences(rows: AxisRows, false_rate: float) -> list[Presence]:
    """The effects that appeared or vanished; `false_rate` is the chance of a false one, for each effect.

    Where in time the sides part is searched for; Fisher's exact test of each place, times their number, bounds the chance.
    Recordings that never reverse show few effects, and do not count.
    """
    kept = rows.diagnosed & (rows.columns["reversals"] > 0)
    at = np.flatnonzero(kept)
    found = []
    for name in effects_named(rows):
        present = np.array([has(rows.effects[k], name) for k in at], dtype=bool)
        one = _presence(name, rows, at, present)
        if one is not None and one.p_value < false_rate:
            found.append(one)
    return found


def _presence(name: str, rows: AxisRows, at: np.ndarray, present: Mask) -> Presence | None:
    count = len(at)
    if count < FEWEST:
        return None
    places = np.arange(SIDE, count - SIDE + 1)
    likelihood = np.array([_likelihood(present[:k]) + _likelihood(present[k:]) for k in places])
    k = int(places[np.argmax(likelihood)])
    before, after = float(np.mean(present[:k])), float(np.mean(present[k:]))
    examples = [item for j in at for item in rows.effects[j] if item.name == name]
    if abs(after - before) < DIFFERENT or not examples:
        return None
    allowed = -math.log(1.0 - math.sqrt(CONFIDENCE))  # of a log-likelihood: half of that of its ratio
    near = places[likelihood >= likelihood.max() - allowed]
    day: Array = rows.day[at]
    example = max(examples, key=lambda item: item.torque_rms)
    return Presence(
        name,
        tuple(dict.fromkeys(other for item in examples for other in item.equivalent)),
        after > before,
        float(0.5 * (day[k - 1] + day[k])),
        float(day[near.min() - 1]),
        float(day[near.max()]),
        before,
        after,
        min(len(places) * _fisher(present, k), 1.0),
        example,
        float(np.median([item.torque_rms for item in examples])),
    )


def _likelihood(present: Mask) -> float:
    """Logarithm of the likelihood of independent recordings that all have the effect with the share's probability."""
    count, some = len(present), int(np.count_nonzero(present))
    return sum(part * math.log(part / count) for part in (some, count - some) if part)


def _fisher(present: Mask, k: int) -> float:
    """Chance (two-sided) that so many of those that have it, or more, fall on one side of place k."""
    count, some, after = len(present), int(present.sum()), int(present[k:].sum())
    law = hypergeom(count, some, count - k)
    return min(2.0 * min(float(law.sf(after - 1)), float(law.cdf(after))), 1.0)
