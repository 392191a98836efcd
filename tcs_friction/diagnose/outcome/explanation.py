"""What search and remainder hand to the outcome."""

from __future__ import annotations

from dataclasses import dataclass

from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.remainder.maps import Structure
from tcs_friction.diagnose.rules import Refusal, Refused
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.diagnose.search.rivals import Contest
from tcs_friction.physics.terms import Instance


@dataclass(frozen=True, eq=False)
class Explanation:
    """What search and remainder found.

    retuned: fit of what the model has alone. unmapped: fit with the effects. improved: fit with effects and map. structure: what
    the effects leave, or what a map stands for. rounds: candidates of each round. contests: of every effect found. lacks: of the
    believed friction law. dropped: effects that were found and are not among them.
    """

    retuned: Fit
    unmapped: Fit
    improved: Fit
    structure: Structure | None
    rounds: tuple[tuple[Candidate, ...], ...] = ()
    contests: tuple[Contest, ...] = ()
    lacks: tuple[Lack, ...] = ()
    dropped: tuple[Refused, ...] = ()

    @property
    def refused(self) -> tuple[Refused, ...]:
        """Effects that were dropped, then those that gained more than chance in the last round, were they what they say."""
        found = {one.effect: one for one in self.dropped}
        for candidate in self.rounds[-1] if self.rounds else ():
            why, words = candidate.doubt, " and ".join(kind.words for kind in candidate.kinds)
            if why is not None and candidate.doubted > candidate.threshold and words not in found:
                numbers = {"gain": candidate.doubted, "by_chance": candidate.threshold}
                found[words] = Refused(words, Refusal(why.value, f"it would gain {candidate.doubted:.3g}", numbers))
        return tuple(found.values())

    def contest(self, item: Instance) -> Contest | None:
        """The contest of an effect, None if there was none."""
        return next((c for c in self.contests if c.effect == item.identity), None)

    def without(self, item: Instance) -> Fit:
        """The fit without an effect, all else refitted: of its contest, of the believed law, or else the retuned one."""
        fits = {lack.effect.identity: lack.without for lack in self.lacks}
        fits |= {contest.effect: contest.without for contest in self.contests}
        return fits.get(item.identity, self.retuned)
