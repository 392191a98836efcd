"""Simulations in motion side by side, and which names they refuse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcs_friction.diagnose import rules
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.free_run import moves_worse, typical
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.rules import Refusal
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance


@dataclass(frozen=True)
class Moved:
    """Errors (w,) in windows of a simulation in motion: by name of an axis, and of any other axis."""

    of_axis: Callable[[Axis], np.ndarray]
    errors: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, of_axis: Callable[[Axis], np.ndarray], axes: Mapping[str, Axis]) -> Moved:
        return cls(of_axis, {name: of_axis(axis) for name, axis in axes.items()})

    @property
    def improved_is_worse(self) -> bool:
        """Whether the improved axis moves worse than the retuned one."""
        return moves_worse(self.errors["improved"], self.errors["retuned"])

    @property
    def believed_is_best(self) -> bool:
        """Whether the retuned and the improved axis both move worse than the believed one."""
        return all(moves_worse(self.errors[name], self.errors["believed"]) for name in ("retuned", "improved"))

    def typical(self) -> dict[str, float]:
        """The typical error of each axis by name."""
        return {name: typical(windows) for name, windows in self.errors.items()}

    def worse(self, axis: Axis) -> bool:
        """Whether an axis moves worse than the retuned one."""
        return moves_worse(self.of_axis(axis), self.errors["retuned"])


def refused_by_motion(
    every: Sequence[Found], proofs: Sequence[Moved], explanation: Explanation, unit: str
) -> tuple[Found, ...]:
    """The effects, those among named ones refused with which a simulation moves worse than retuned, and not without them.

    Where it moves worse collisions are always among them: none comes at its exact time, and the torque that they leave counts
    as their own, so that only a better motion proves them. Where the believed axis moves best all of them are: beside numbers
    that were led astray nothing is proven. unit: of the position.
    """
    best = [proof for proof in proofs if proof.believed_is_best] if rules.BELIEVED_BEST.asked else []
    if best:
        refusal = Refusal(rules.BELIEVED_BEST, "the axis as believed moves better than it does retuned", best[0].typical())
        return tuple(one.unless(refusal) if one.established else one for one in every)
    worse = [proof for proof in proofs if proof.improved_is_worse] if rules.MOVES.asked else []
    if worse and explanation.unmapped is not explanation.improved:  # otherwise it may be the map that moves worse
        worse = [proof for proof in worse if proof.worse(explanation.unmapped.axis)]

    def at_fault(item: Instance) -> bool:
        return item.term.collides or any(not proof.worse(explanation.without(item).axis) for proof in worse)

    def judged_by(one: Found) -> Refusal | None:
        if not (worse and one.established and at_fault(one.instance)):
            return None
        errors = worse[0].typical()
        words = f"a simulation moves worse with it: {errors['improved']:.2g} {unit} rms against {errors['retuned']:.2g}"
        return Refusal(rules.MOVES, words, errors)

    return tuple(one.unless(judged_by(one)) for one in every)
