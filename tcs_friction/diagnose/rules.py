"""Every rule that may refuse a name: what it asks, why, and where that is from.

An effect that explains torque is named if no rule refuses it. A rule that does hands its numbers on: what is described says why.
`without` leaves rules out and `ledger` tells which of a search's rules decided something, so that a benchmark can tell which
worlds need them (`./tcs bench concealed --without RULE`, `./tcs bench ablation`).
"""

from __future__ import annotations

import enum
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


class Family(enum.StrEnum):
    """The notions that rules stand for."""

    LEFT = "what is left could be it"
    LARGE = "large effects are known imperfectly"
    SAME = "two explanations are the same"
    BACK = "it must come back"
    NOISE = "noise imitates physics"
    ASTRAY = "the search lost its way"
    MOTION = "the recording must show it"
    MOVES = "a simulation must move better"


@dataclass(frozen=True)
class Rule:
    """One rule. question: what a name must answer with yes. source: of the rule, or of its numbers."""

    name: str
    family: Family
    question: str
    source: str

    @property
    def asked(self) -> bool:
        """Whether it is asked at all."""
        return self.name not in _left_out

    def decides(self) -> None:
        """Note that it refused something that would have been taken, or may have been."""
        for noted in _ledgers:
            noted.add(self.name)


@dataclass(frozen=True)
class Refusal:
    """A rule that refused a name. words: why, for a reader; numbers: behind it, SI units."""

    rule: Rule
    words: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        told = {"rule": self.rule.name, "family": str(self.rule.family), "question": self.rule.question}
        return {**told, "words": self.words, "numbers": dict(self.numbers)}


@dataclass(frozen=True)
class Refused:
    """An effect that a search did not take, or that a map stands for, and by which rule. effect: id, with its signal."""

    effect: str
    refusal: Refusal

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return {"effect": self.effect, **self.refusal.to_mapping()}


_left_out: set[str] = set()
_ledgers: list[set[str]] = []


@contextmanager
def ledger() -> Iterator[set[str]]:
    """Names of the rules that decide something in a search meanwhile, in the whole process.

    Those of finished fits say it themselves (`Found.refused`).
    """
    noted: set[str] = set()
    _ledgers.append(noted)
    try:
        yield noted
    finally:
        _ledgers.remove(noted)


@contextmanager
def without(names: Collection[str]) -> Iterator[None]:
    """Leave out the rules with these names, in the whole process: for a benchmark, which has processes of its own."""
    added = set(names) - _left_out
    _left_out.update(added)
    try:
        yield
    finally:
        _left_out.difference_update(added)


BEYOND_CHANCE = Rule(
    "beyond_chance", Family.NOISE, "Does it gain more than its numbers would by chance?", "Schwarz 1978 (BIC)"
)
COMES_BACK = Rule(
    "comes_back", Family.BACK, "Do pieces that were not fitted show it with the same size?",
    "DerSimonian and Laird 1986; Hartung and Knapp 2001",
)  # fmt: skip
LEFT = Rule(
    "left", Family.LEFT, "Is it larger than what is left and could be the same?", "parts built in MuJoCo, ./tcs bench concealed"
)
PREDICTS = Rule("predicts", Family.BACK, "Is the held-out residual no larger with it?", "error of a noise floor")
SIZE_TOLD = Rule("size_told", Family.NOISE, "Is its size told from zero?", "two standard deviations")
ECHO = Rule("echo", Family.LARGE, "Is it more than what the form of a larger one like it does not meet?", "worlds, see proof.py")
CANCELLED = Rule("cancelled", Family.SAME, "Is it known by itself, not only in a sum?", "Belsley, Kuh and Welsch 1980, 3.2")
SIGNAL_MEAN = Rule(
    "signal_mean", Family.SAME, "Can what acts through a recorded signal not do the same in another form?", "wind on a panel"
)
OUTSHONE = Rule(
    "outshone", Family.LARGE, "Is it more than what a larger named one does in another form?", "parts built in MuJoCo"
)
ALL_PREDICT = Rule("all_predict", Family.ASTRAY, "Do all effects together predict held-out data no worse than none?", "held out")
BELIEVED_BEST = Rule(
    "believed_best", Family.ASTRAY, "Does the axis as believed not move better than retuned and improved?", "Student's t, 1 %"
)
MOVES = Rule("moves", Family.MOVES, "Does a simulation move no worse with it than without?", "Student's t, 1 %")
MAP_INSTEAD = Rule(
    "map_instead", Family.SAME, "Does a map over two coordinates alone not do as well as all effects?", "Kennedy and O'Hagan 2001"
)
SPECTRUM = Rule(
    "spectrum", Family.NOISE, "Would a slow torque of unknown cause, as large as what remains, not explain it?", "chi-squared"
)

ALIGNMENT = Rule("alignment", Family.SAME, "Is it more than what stamps of the log may mean?", "half a renewal of the torque")
SAMPLING = Rule("sampling", Family.MOTION, "Is it slower than half the rate of new samples?", "Shannon 1949")
TWICE = Rule("twice", Family.SAME, "Is it another wave than the other effects are?", "phases over the recording")
WARNED = Rule("warned", Family.MOTION, "Are its values physical?", "each effect's own file")
TOO_SMALL = Rule("too_small", Family.ASTRAY, "Is its torque large enough for its gain?", "half the least gain that counts")
TOO_LARGE = Rule("too_large", Family.ASTRAY, "Is its torque no larger than the drive's?", "a balance of torques")
QUANTISATION = Rule("quantisation", Family.NOISE, "Does it move the axis by half a step of the encoder?", "error of rounding")
AT_BOUND = Rule("at_bound", Family.ASTRAY, "Did its fit end within its bounds?", "each effect's own file")
SIDE_LINE = Rule("side_line", Family.LARGE, "Is it more than the changing amplitude of another wave?", "modulation, in periods")
COLLISIONS = Rule("collisions", Family.SAME, "Can collisions not look like it?", "worlds with a backlash")
NOT_WHOLE = Rule("not_whole", Family.MOTION, "Does its order close with the turn?", "geometry")
DRIVEN = Rule("driven", Family.SAME, "Is its frequency no line of motion and logged torque?", "Astrom and Murray 2008, 12.2")
ENERGY = Rule(
    "energy", Family.MOTION, "Does friction with it take energy up to twice the fastest speed?", "second law of thermodynamics"
)
STEADY = Rule("steady", Family.SAME, "Does the axis move so unevenly that no wave over its position looks alike?", "phases")
SUMMED = Rule("summed", Family.SAME, "Do others not cancel it?", "Belsley, Kuh and Welsch 1980, 3.2")
IMPLAUSIBLE = Rule("implausible", Family.MOTION, "Can it be told in such a motion?", "each effect's own file")
NOT_RESOLVED = Rule("not_resolved", Family.MOTION, "Can the recording show it with such values?", "each effect's own search")

RULES = (
    BEYOND_CHANCE, COMES_BACK, LEFT, PREDICTS, SIZE_TOLD, ECHO, CANCELLED, SIGNAL_MEAN, OUTSHONE, ALL_PREDICT, BELIEVED_BEST,
    MOVES, MAP_INSTEAD, SPECTRUM, ALIGNMENT, SAMPLING, TWICE, WARNED, TOO_SMALL, TOO_LARGE, QUANTISATION, AT_BOUND, SIDE_LINE,
    COLLISIONS, NOT_WHOLE, DRIVEN, ENERGY, STEADY, SUMMED, IMPLAUSIBLE, NOT_RESOLVED,
)  # fmt: skip
"""All of them: those of finished fits, then those of a search."""
OF_SEARCH = RULES[RULES.index(MAP_INSTEAD) :]
"""Those that a search asks; the others are asked of finished fits."""
