"""Rivals: which other effects these data cannot tell from one that was chosen.

In: a selection. Out: the fit in which every effect is the best for its place, and for each effect its `Contest`: all rivals
fitted in its place, best first. A rival takes the place where it does better, or as well through the same recorded signal
with fewer numbers.

A rival is as good if the noise alone could make the difference. It also is if it explains nearly as much and does better in some
piece of the data than noise allows: the effect in place is not the truth there, and what else is wrong may decide between them.
The same holds for waves over the position of one order, one of which explains more beside the other than that has ahead of it,
and for gravity and springs over a short travel, or where more than noise is left.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from tcs_friction.diagnose.dataset.excitation import lacking
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, fit_untimed, fit_without, settle, taken_out
from tcs_friction.diagnose.fit.noise_estimate import NO_NOISE, misfit
from tcs_friction.diagnose.search.candidates import (
    STILL_WINNING,
    Candidate,
    fitted_candidates,
    squares_gained,
)
from tcs_friction.diagnose.search.cross_validation import squares_as_fitted, with_best_confirmed
from tcs_friction.diagnose.search.hypotheses import eligible, starts
from tcs_friction.diagnose.search.matched_filter import in_step
from tcs_friction.diagnose.search.plausibility import doubt, doubtful_size
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.significance import (
    DISTINGUISHABLE,
    FEEDBACK_SHARE,
    IMPERFECT,
    ODDS,
    threshold,
)
from tcs_friction.diagnose.search.start import Kind, Start, follows_load, kind_of
from tcs_friction.diagnose.search.stepwise import Progress, Selection, close_behind
from tcs_friction.diagnose.search.waves import wave_start
from tcs_friction.physics.terms import Instance, Need, Place, Term

MOST_RIVALS = 6
IN_PLACE_ITERATIONS = 6  # of a rival's joint fit from the numbers beside the effect, which are nearly right
NEARLY = 0.9  # of an effect's gain, from which a rival that does better in a piece of the data is as good


@dataclass(frozen=True, eq=False)
class Contest:
    """One chosen effect against others in its place.

    effect: its identity. kind: what it is. without: the fit without it. gain: its own, in units of the noise. same: difference of
    gains below which two cannot be told apart. rivals: fitted in its place, best first. tied: those of them between
    which and the effect what else is wrong may decide.
    """

    effect: int
    kind: Kind
    without: Fit
    gain: float
    same: float
    rivals: tuple[Candidate, ...]
    tied: tuple[Candidate, ...] = ()

    @property
    def equivalent(self) -> tuple[Candidate, ...]:
        """Rivals of another kind that these data cannot tell from the effect, each kind once, best first."""
        close = [
            rival for rival in self.rivals if rival.gain > self.gain - self.same or any(rival is one for one in self.tied)
        ]
        first = {kind: rival for rival in reversed(close) for kind in rival.kinds if kind != self.kind}
        return tuple(rival for rival in close if any(rival is chosen for chosen in first.values()))

    @property
    def bent(self) -> Contest:
        """The same with the rivals that are slow torques of the position, too, among the tied ones."""
        return replace(self, tied=(*self.tied, *filter(_is_slow, _near(self.rivals, self.gain))))


def contested(balance: TorqueBalance, selection: Selection, progress: Progress) -> tuple[Fit, tuple[Contest, ...]]:
    """Let what was promising in any round compete for the place of every effect found."""
    fit, contests = selection.chosen, list[Contest]()
    for found in selection.found:
        item = next(x for x in fit.axis.effects if x.identity == found.identity)
        progress(0.8, f"rivals of {item.term.id}")
        fit, contest = contest_for_place(balance, fit, item, _challengers(selection, fit, item))
        contests.append(contest)
    return fit, tuple(contests)


def _challengers(selection: Selection, fit: Fit, item: Instance) -> list[Start]:
    """Where rivals of an effect may start: candidates of the round that brought it, then of others, each effect once."""
    own, present = kind_of(item), {kind_of(other) for other in fit.axis.effects}
    rounds = sorted(selection.rounds, key=lambda candidates: all(own not in c.kinds for c in candidates))
    best: dict[Kind, Start] = {}
    for candidate in itertools.chain.from_iterable(rounds):
        if len(candidate.items) > 1:
            continue
        (kind,), (rival,) = candidate.kinds, candidate.items
        if kind not in present or (rival.term.periodic and kind != own):
            best.setdefault(kind, replace(candidate.start, instances=(rival.again(),)))
    return list(best.values())[:MOST_RIVALS]


def contest_for_place(
    balance: TorqueBalance, fit: Fit, item: Instance, challengers: Sequence[Start]
) -> tuple[Fit, Contest]:
    """Let rivals compete for one effect's place; the fit with the winner in it."""
    alone = fit_without(balance, fit, item)
    dispersion = fit.squares.dispersion
    gain = squares_gained(balance, alone, fit, [item]) / dispersion
    starting = [*challengers, *_acting_like(balance, alone, item, challengers)]
    fitted = fitted_candidates(balance, alone, close_behind(starting), dispersion)
    gains = {id(candidate.fit): candidate.gain for candidate in fitted}
    confirmed = with_best_confirmed(balance, alone, fitted, dispersion)
    rivals = [  # the effect in place had its own confirmation: gains are compared as fitted
        replace(c, gain=gains[id(c.fit)]) if c.gain > STILL_WINNING * gains[id(c.fit)] else c for c in confirmed
    ]
    rivals = _with_better(rivals, _in_place(balance, fit, item, alone, dispersion))
    count = fit.numbers_of(item)
    all_noise = balance.samples.effective_count
    tie = max(DISTINGUISHABLE * misfit(balance, balance.residual(fit.axis, fit.noise)), min(IMPERFECT * gain, all_noise))
    same = max(tie, min(FEEDBACK_SHARE * gain, all_noise))
    better = [rival for rival in rivals[:1] if rival.score > gain - threshold(balance, [item.term], count) + same]
    better += [r for r in rivals if r.items[0].signal and r.start.count < count and r.gain > gain - tie]
    for winner in better[:1]:
        settled = settle(balance, winner.fit.axis, winner.fit.noise, rounds=1)
        (placed,) = (x for x in settled.axis.effects if x.identity == winner.items[0].identity)
        if doubtful_size(balance, settled, placed) is None:
            others = [rival for rival in rivals if rival is not winner]
            others = _with_better(others, _in_place(balance, settled, placed, alone, dispersion))
            tied = _tied(balance, winner.fit, winner.items[0], winner.gain, others)
            return settled, Contest(placed.identity, kind_of(placed), alone, winner.gain, same, tuple(others), tied)
    tied = _tied(balance, fit, item, gain, rivals)
    return fit, Contest(item.identity, kind_of(item), alone, gain, same, tuple(rivals), tied)


def _tied(
    balance: TorqueBalance, fit: Fit, item: Instance, gain: float, rivals: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """The rivals of an effect of a fit between which and it what else is wrong may decide; gain: the effect's own.

    Those explain nearly as much, and in some piece of the data more than noise allows; or they are waves of its order, and
    explain more beside it than it has ahead of them. Were the effect true and all else right, that would be chance. Over a short
    travel gravity is a slope over the position, and so is a spring, and where more than noise is left, what else is wrong bends
    the one or the other: one that explains nearly as much is as good. What is wrong is no more than all that is left: no rival
    that would leave twice as much is tied.
    """
    used = np.unique(balance.samples.pieces[balance.samples.rows])
    # Were the fit true, a rival whose torque differs by d standard deviations of the noise would lose d^2 + 2 d e in a piece,
    # with e normal; it gains x with a probability of at most that of e < -sqrt(x). Bonferroni's correction is for all pieces.
    by_noise = float(stats.norm.isf(1.0 / (ODDS * len(used)))) ** 2 * fit.squares.dispersion
    own = squares_as_fitted(balance, fit).white
    alike = [rival for rival in rivals if rival.score > 0.0 and _of_one_order(balance, fit, item, rival.items[0])]
    projected = ProjectedResidual(balance, fit) if alike else None

    def gains_somewhere(rival: Candidate) -> bool:
        return bool(np.max((own - squares_as_fitted(balance, rival.fit).white)[used]) > by_noise)

    def gains_beside(rival: Candidate) -> bool:
        term = rival.items[0].term
        start = wave_start(projected, term, item.order, alternatives=1.0) if projected is not None else None
        beside = start.gain / fit.squares.dispersion if start is not None else 0.0
        return beside > max(threshold(balance, [term], rival.start.count), gain - rival.gain)

    bent = item.term.slow_over_position and misfit(balance, balance.residual(fit.axis, fit.noise)) >= NO_NOISE**2
    sloping = bent or _is_slope(balance, fit, item)
    near = [rival for rival in _near(rivals, gain) if gain - rival.gain < balance.samples.effective_count]
    as_good = [rival for rival in near if gains_somewhere(rival) or (sloping and _is_slow(rival))]
    return (*as_good, *(rival for rival in alike if gains_beside(rival)))


def _near(rivals: Sequence[Candidate], gain: float) -> list[Candidate]:
    """The rivals that explain nearly as much as an effect with this gain."""
    return [rival for rival in rivals if rival.gain > NEARLY * gain]


def _is_slow(rival: Candidate) -> bool:
    """Whether a rival is a torque of the position that varies slowly over it, as gravity and springs are."""
    return rival.items[0].term.slow_over_position


def _of_one_order(balance: TorqueBalance, fit: Fit, item: Instance, other: Instance) -> bool:
    """Whether two effects of different kinds are waves over the position of one order."""
    waves = item.term is not other.term and item.term.periodic == "position" == other.term.periodic
    return waves and in_step(balance, fit.axis, item, other)


def _acting_like(balance: TorqueBalance, alone: Fit, item: Instance, known: Sequence[Start]) -> list[Start]:
    """Starts of effects not yet known that act as an effect does; a general effect hides its special cases.

    They act through its recorded signal, or are slopes over the position as it is, or friction over the position where the axis
    moves one way only. What is late, swings or follows the load looks like collisions: torque is missed after each reversal.
    """
    sloping = _is_slope(balance, alone, item)
    one_way = item.term.slow_over_position and Need.BOTH_DIRECTIONS in lacking(balance.data, alone.axis)
    if not (item.signal or sloping or one_way or item.term.collides):
        return []

    def alike(term: Term, signal: str | None) -> bool:
        friction = term.place is Place.SCALE and term.coordinate == "position"
        if item.term.collides:
            return term.filters or (term.resonates and not term.collides) or follows_load(term)
        return (signal == item.signal) if item.signal else (sloping and term.slow_over_position) or (one_way and friction)

    projected = ProjectedResidual(balance, alone)
    others = [pair for pair in eligible(alone.axis, balance) if pair[0] is not item.term and alike(*pair)]
    found = [start for term, signal in others for start in starts(projected, term, signal)[:1]]
    kinds = {start.kinds for start in known}
    return [start for start in found if start.kinds not in kinds]


def _is_slope(balance: TorqueBalance, fit: Fit, item: Instance) -> bool:
    """Whether an effect is a torque of the position, of which the travel is too short to show more than a slope."""
    return item.term.slow_over_position and Need.TRAVEL in lacking(balance.data, fit.axis)


def _in_place(
    balance: TorqueBalance, fit: Fit, item: Instance, alone: Fit, dispersion: float
) -> list[Candidate]:
    """Effects that act as one does, each fitted in its place from the fit's own numbers. alone: the fit without it.

    They are waves over the position with its order, or the whole number next to it if they need one: in steady motion one way a
    torque, a friction and a gain of the drive with the same wave do nearly the same. Or they are slow torques over the position
    like it. Without the effect the friction law may go astray to stand in for it, and few steps do not lead it back.
    """
    others, result = ProjectedResidual(balance, taken_out(balance, fit, item)), []
    for term, signal in eligible(others.axis, balance):
        start = _start_in_place(others, item, term, signal)
        if start is None:
            continue
        axis = others.axis.with_effect(start.instance)
        free = [number for number in balance.free(axis) if not number.is_order_of(start.instance)]
        trial = fit_untimed(balance, axis, alone.noise, IN_PLACE_ITERATIONS, free=free)
        (placed,) = (x for x in trial.axis.effects if x.identity == start.instance.identity)
        why_not = doubtful_size(balance, trial, placed) if term.periodic else doubt(balance, trial, placed, others.axis)
        if why_not is None:
            gain = squares_gained(balance, alone, trial, [placed]) / dispersion
            limit = threshold(balance, [term], start.count)
            result.append(Candidate(gain, limit, trial, replace(start, columns=np.empty((0, 0)))))
    return result


def _with_better(rivals: Sequence[Candidate], placed: Sequence[Candidate]) -> list[Candidate]:
    """Rivals and those fitted in place, best first; of slow torques over the position each kind once, as it does better."""
    found = list(rivals)
    for one in placed:
        known = None if one.items[0].term.periodic else next((x for x in found if x.kinds == one.kinds), None)
        if known is None:
            found.append(one)
        elif one.gain > known.gain:
            found[found.index(known)] = one
    return sorted(found, key=lambda rival: -rival.score)


def _start_in_place(others: ProjectedResidual, item: Instance, term: Term, signal: str | None) -> Start | None:
    """The start of an effect of a kind that acts as another one does, which was taken out; None of other kinds."""
    if term is item.term:
        return None
    if item.term.periodic == "position" == term.periodic:
        whole = term.whole and others.axis.kind == "rotary"
        return wave_start(others, term, max(round(item.order), 1) if whole else item.order, alternatives=1.0)
    slow = item.term.slow_over_position and term.slow_over_position
    return next(iter(starts(others, term, signal)), None) if slow else None
