"""What a diagnosis is worth: its names beside what a world lacks, and its stated probabilities beside the share that is right.

One function judges worlds of every kind. A world says what is right in an `Expected`; `judge` compares a diagnosis with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tcs_friction.errors import InputError, nearest
from tcs_friction.physics.registry import effects as vocabulary

MAP = "learned_map"  # stands for physics without a name, so it is no name
NOTHING_MISSING = ("match", "parameters")
BINS = (
    0.0,
    0.5,
    0.8,
    0.9,
    0.95,
    0.99,
    1.0,
)  # edges of the reliability table; the last bins decide about trust
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Expected:
    """What a right diagnosis of a world says.

    effects: for each effect that is missing, the ids any of which is right (more than one where they are the same physics),
        the usual one first.
    tolerated: ids that are true of the world, too, but need not be named.
    outside: something is missing that no id describes; a right diagnosis says that something is unexplained.
    partial: the ids describe the effects only roughly; the rest may be called unexplained.
    noise_floor: rms of the torque noise, N m.

    Raises InputError for an id that is not in the vocabulary.
    """

    effects: tuple[tuple[str, ...], ...]
    noise_floor: float
    tolerated: frozenset[str] = frozenset()
    outside: bool = False
    partial: bool = False

    def __post_init__(self) -> None:
        known = sorted(set(vocabulary()) - {MAP})
        for name in sorted(self.tolerated.union(*self.effects)):
            if name not in known:
                raise InputError("expected effects", f"unknown name {name!r}", nearest(name, known))

    @property
    def nothing(self) -> bool:
        """Whether the belief lacks nothing."""
        return not self.effects and not self.outside

    def to_mapping(self) -> dict[str, Any]:
        """As the truth file has it."""
        return {
            "effects": [names[0] for names in self.effects],
            "accepted": [list(names) for names in self.effects],
            "tolerated": sorted(self.tolerated),
            "outside": self.outside,
            "partial": self.partial,
            "noise_floor": self.noise_floor,
        }


@dataclass(frozen=True)
class Named:
    """One name that a diagnosis gave: its stated probability, and whether it is true."""

    effect: str
    probability: float
    true: bool


@dataclass(frozen=True)
class Kept:
    """A name that a rule refused: the rule, the effect, and whether it would have been true."""

    rule: str
    effect: str
    true: bool


@dataclass(frozen=True)
class Judged:
    """What a diagnosis of one world is worth.

    right: the effects missing are named, no other, and the verdict is the one that follows.
    missed: ids of each effect that was not named, joined by a slash. held_out: rms over the floor, see `judge`.
    free_run: improved over retuned rms; None unless the verdict is that physics is missing. refused: names that rules refused.
    """

    world: str
    kind: str
    expected: Expected
    verdict: str
    names: tuple[Named, ...]
    missed: tuple[str, ...]
    said_unexplained: bool
    right: bool
    held_out: float
    free_run: float | None
    seconds: float
    refused: tuple[Kept, ...] = ()

    @property
    def false_names(self) -> tuple[str, ...]:
        """Names that are not true."""
        return tuple(name.effect for name in self.names if not name.true)


def judge(
    world: str,
    kind: str,
    expected: Expected,
    found: Mapping[str, Any],
    seconds: float,
    floor: float | None = None,
) -> Judged:
    """Compare a diagnosis, as diagnosis.json has it, with what is right.

    An entry is true if its id or one that it lists as equivalent belongs to a missing effect which no other entry stands for,
    or is tolerated. floor: N m, what the true model leaves on the held-out data (concealed_floor.py). Where no model of ours is
    true, it is the larger of the torque noise and the noise that the diagnosis reports: the torque noise lacks the share of the
    encoder, and a diagnosis alone may take what it did not explain for noise.
    """
    if floor is None:
        floor = max(float(found["fit"]["noise_floor"]), expected.noise_floor)
    entries = [entry for entry in found["effects"] if entry["effect"] != MAP]
    claims = [{entry["effect"], *entry["equivalent"]} for entry in entries]
    of_entry = matched(claims, expected.effects)
    names = tuple(
        Named(
            entry["effect"],
            float(entry["probability"]),
            of is not None or entry["effect"] in expected.tolerated,
        )
        for entry, of in zip(entries, of_entry, strict=True)
    )
    missed = tuple("/".join(ids) for i, ids in enumerate(expected.effects) if i not in of_entry)
    verdict = str(found["verdict"])
    said = verdict == "unexplained" or bool(found["unexplained"]["present"])
    free = found["free_run"]["position_rms"]
    return Judged(
        world,
        kind,
        expected,
        verdict,
        names,
        missed,
        said,
        not missed and all(name.true for name in names) and _follows(expected, verdict, said, names),
        float(found["fit"]["improved"]["held_out"]) / floor,
        float(free["improved"]) / float(free["retuned"]) if verdict == "missing_physics" else None,
        seconds,
        _refused(expected, found),
    )


def _refused(expected: Expected, found: Mapping[str, Any]) -> tuple[Kept, ...]:
    """Names that rules refused, of effects that were fitted and of those that a search did not take."""
    missing = set[str]().union(*expected.effects)
    described = [(refusal["rule"], entry["effect"]) for entry in found["described"] for refusal in entry["refused"]]
    candidates = [(entry["rule"], entry["effect"].split()[0]) for entry in found["refused"]]
    return tuple(Kept(rule, effect, effect in missing) for rule, effect in (*described, *candidates))


def failed(world: str, kind: str, expected: Expected, message: str, seconds: float) -> Judged:
    """Of a diagnosis that ended with an error: nothing was named, and nothing was right."""
    missed = tuple("/".join(ids) for ids in expected.effects)
    return Judged(
        world, kind, expected, f"error: {message}", (), missed, False, False, math.inf, None, seconds
    )


def _follows(expected: Expected, verdict: str, said: bool, names: Sequence[Named]) -> bool:
    """Whether the verdict is right, given that the names are."""
    if expected.outside:
        return said
    if expected.effects:
        return verdict == "missing_physics" or (expected.partial and verdict == "unexplained")
    if expected.partial or names:
        return True
    return verdict in NOTHING_MISSING


def matched(claims: Sequence[set[str]], wanted: Sequence[Sequence[str]]) -> list[int | None]:
    """For each claim the index of the wanted set that it stands for, one to one, as many as possible."""
    of_wanted: dict[int, int] = {}

    def place(claim: int, tried: set[int]) -> bool:
        for i, ids in enumerate(wanted):
            if i not in tried and claims[claim].intersection(ids):
                tried.add(i)
                if i not in of_wanted or place(of_wanted[i], tried):
                    of_wanted[i] = claim
                    return True
        return False

    for claim in range(len(claims)):
        place(claim, set())
    of_claim = {claim: i for i, claim in of_wanted.items()}
    return [of_claim.get(claim) for claim in range(len(claims))]


@dataclass(frozen=True)
class Bin:
    """Names whose stated probability lies in a bin: mean of what was stated, share that is true, Wilson's 95 % interval."""

    low: float
    high: float
    stated: float
    share: float
    interval: tuple[float, float]
    count: int


def reliability(names: Sequence[Named], edges: Sequence[float] = BINS) -> list[Bin]:
    """The bins that hold a name; the last one includes its upper edge."""
    bins = []
    for low, high in pairwise(edges):
        inside = [n for n in names if low <= n.probability < high or (high == edges[-1] == n.probability)]
        if inside:
            true = sum(name.true for name in inside)
            stated = sum(name.probability for name in inside) / len(inside)
            bins.append(Bin(low, high, stated, true / len(inside), wilson(true, len(inside)), len(inside)))
    return bins


def wilson(hits: int, count: int, quantile: float = NORMAL_95) -> tuple[float, float]:
    """Wilson's interval of a share (Wilson 1927), 95 % unless told; (0, 1) of nothing."""
    if count == 0:
        return 0.0, 1.0
    share, square = hits / count, quantile * quantile / count
    middle = (share + 0.5 * square) / (1.0 + square)
    half = quantile * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count) / (1.0 + square)
    return max(middle - half, 0.0), min(middle + half, 1.0)
