"""Stepwise selection: forward by the best confirmed candidate, backward by what no longer earns its place.

In: the retuned fit. Out: a `Selection`: the chosen fit and the candidates of every round. Other friction laws compete with the
effects before any is added, until no law is better, and again where an effect completes the law or none is left to be added:
what a wrong law leaves behind looks like effects. The noise model is estimated anew with each fit that is kept; inside a round
all fits share one, so that their squares can be compared.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose import rules
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import (
    Fit,
    fit_jointly,
    fit_without,
    from_believed_law,
    settle,
    taken_out,
)
from tcs_friction.diagnose.fit.noise import NoiseModel
from tcs_friction.diagnose.fit.noise_estimate import misfit
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.candidates import (
    SPECTRUM_NEIGHBOURS,
    Candidate,
    fitted_candidates,
    gains_of_load,
)
from tcs_friction.diagnose.search.cross_validation import with_best_confirmed
from tcs_friction.diagnose.search.harmonics import added_effects, with_harmonics_joined, with_offsets_joined
from tcs_friction.diagnose.search.hypotheses import all_starts, pairs_of_starts, refined, starts
from tcs_friction.diagnose.search.laws import (
    LawCandidate,
    extension_promises,
    law_candidates,
    other_laws,
    simplest_law,
)
from tcs_friction.diagnose.search.plausibility import doubt
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.significance import (
    DISTINGUISHABLE,
    FALSE_ALARM,
    FEEDBACK_SHARE,
    NOISE_SHARE,
    chance,
    imperfection,
    threshold,
)
from tcs_friction.diagnose.search.start import Kind, Start, follows_load, judged_linear, kind_of
from tcs_friction.diagnose.search.waves import told_from_torque
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Term

TRIED = 5  # candidates in a round that are fitted jointly
CLOSE_BEHIND = 0.1  # of the best start's promise, from which a start is fitted jointly, too
HALF_PROMISED = 0.5  # of the threshold that a start must promise: a joint fit may bring it twice as far
MOST_EFFECTS = 6
MOST_LAWS = 3  # one after the other
PLACING_ITERATIONS = 12  # of a fit from an effect's new place
Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Selection:
    """What a search chose.

    retuned: fit of what the model has alone. base: the same with the friction law that serves best. chosen: with the effects
    chosen. rounds: candidates of each round, best first.
    """

    retuned: Fit
    base: Fit
    chosen: Fit
    rounds: tuple[tuple[Candidate, ...], ...] = ()

    @property
    def found(self) -> tuple[Instance, ...]:
        """The effects that were added."""
        return added_effects(self.chosen.axis, self.retuned.axis)


def select_effects(
    balance: TorqueBalance,
    retuned: Fit,
    base: Fit,
    believed: Axis,
    excluded: frozenset[str],
    enough: Callable[[Fit, Fit], bool],
    progress: Progress,
) -> Selection:
    """Add effects to the base, and change its friction law, while that earns its place.

    retuned: fit of what the model has alone. base: the same, or with another friction law. believed: the axis as its file gives
    it. excluded: ids of effects that the data cannot carry. enough: asked from the second effect on with the base and the fit,
    whether to go on makes no sense. progress: may raise to cancel.
    """
    fit, rounds = base, list[tuple[Candidate, ...]]()
    alternatives: dict[Kind, float] = {}
    law_is_open, met, refused = True, {_kinds(fit.axis)}, set[frozenset[tuple[Kind, float]]]()
    searched = lru_cache(maxsize=1)(partial(one_round, balance))  # after a refusal the fit is the same
    for number in range(MOST_EFFECTS + MOST_LAWS):
        progress(min(0.2 + 0.1 * number, 0.7), f"round {number + 1}: {len(fit.axis.effects)} effects")
        candidates = searched(fit, excluded | _confused_with_collisions(fit))
        candidates = [c for c in candidates if _kinds(c.fit.axis) not in refused]
        best = _worth_adding(balance, base, fit, candidates)
        if law_is_open or best is None or any(item.term.features for item in best.items):
            law = _better_law(balance, base, fit, believed, excluded, best)
            law_is_open = law is not None and number < MOST_LAWS
            if law is not None and _comes_first(balance, fit, law, best):
                base = settle(balance, _without_added(law.fit.axis, retuned.axis), law.fit.noise, rounds=2)
                fit = pruned(balance, settle(balance, law.fit.axis, law.fit.noise, rounds=2), base, alternatives)
                continue
        rounds.append(tuple(candidates))
        if best is None or len(added_effects(fit.axis, retuned.axis)) >= MOST_EFFECTS:
            break
        before = fit
        best, fit = _best_of_two_close(balance, believed, best, candidates)
        fit = _placed_again(balance, fit, added_effects(fit.axis, retuned.axis))
        fit = with_harmonics_joined(balance, fit, retuned.axis)
        fit = with_offsets_joined(balance, fit, retuned.axis, excluded)
        alternatives |= dict.fromkeys(best.kinds, best.start.alternatives)
        kept = pruned(balance, fit, base, alternatives)
        if _only_lost(before.axis, kept.axis) or _among(added_effects(fit.axis, kept.axis), best.items):
            refused.add(_kinds(best.fit.axis))
            fit = kept if _led_back(balance, before, kept) else before
            continue
        fit = kept
        if len(added_effects(fit.axis, retuned.axis)) > 1 and enough(base, fit):
            break
        if _kinds(fit.axis) in met:  # what was pruned again would come back in every further round
            refused.add(_kinds(best.fit.axis))
        met.add(_kinds(fit.axis))
    return Selection(retuned, base, fit, tuple(rounds))


def _kinds(axis: Axis) -> frozenset[tuple[Kind, float]]:
    """The friction law and the kinds of effects of an axis, waves with their orders to a hundredth."""
    items = [axis.friction, *axis.effects]
    return frozenset((kind_of(item), round(item.order, 2) if item.term.periodic else 0.0) for item in items)


def _only_lost(before: Axis, after: Axis) -> bool:
    """Whether an axis has fewer effects than before and no new one: what was added was dropped, and took others with it."""
    return Counter(map(kind_of, after.effects)) < Counter(map(kind_of, before.effects))


def _among(dropped: Sequence[Instance], added: Sequence[Instance]) -> bool:
    """Whether one of the effects that were just added was dropped at once: of two, the other is better found alone."""
    return not {item.identity for item in dropped}.isdisjoint(item.identity for item in added)


def _led_back(balance: TorqueBalance, before: Fit, after: Fit) -> bool:
    """Whether a fit has the effects of another one and does better: what was added and dropped led their numbers there."""
    same = _kinds(after.axis) == _kinds(before.axis)
    return same and balance.squares(before.axis, after.noise) - after.squares > 0.0


def _worth_adding(balance: TorqueBalance, base: Fit, fit: Fit, candidates: Sequence[Candidate]) -> Candidate | None:
    """The best candidate, None where it gains no more than chance or the errors of other effects give."""
    best = candidates[0] if candidates else None
    if best is None or best.score <= 0.0 or best.gain < imperfection(base, fit, balance):
        return None
    return best


def _best_of_two_close(
    balance: TorqueBalance, believed: Axis, best: Candidate, candidates: Sequence[Candidate]
) -> tuple[Candidate, Fit]:
    """The best candidate and its fit with its own noise, or the next that gains nearly as much and is as simple, if better.

    Of a pair one effect that gains nearly as much alone is taken: what the other one is shows better when the first is known.
    What is missing counts as noise until it is found: of a delay and a lag that the noise of a round does not tell apart one may
    leave twice as much as the other. The next one is better if that is so with the noise of either.
    """

    def settled(one: Candidate) -> Fit:
        return settle(balance, from_believed_law(balance, one.fit, believed), one.fit.noise, rounds=2)

    least = (1.0 - FEEDBACK_SHARE) * best.gain
    close = [one for one in candidates if one.score > 0.0 and one.gain > least and one.kinds != best.kinds]
    alone = next((one for one in close if set(one.kinds) < set(best.kinds)), None)
    if alone is not None:
        return alone, settled(alone)
    fit, other = settled(best), next((one for one in close if one.threshold <= best.threshold), None)
    if other is None:
        return best, fit
    instead = settled(other)

    def gains(noise: NoiseModel) -> bool:
        return balance.squares(fit.axis, noise) - balance.squares(instead.axis, noise) > 0.0

    return (other, instead) if gains(fit.noise) and gains(instead.noise) else (best, fit)


def _better_law(
    balance: TorqueBalance, base: Fit, fit: Fit, believed: Axis, excluded: frozenset[str], effect: Candidate | None
) -> LawCandidate | None:
    """The best candidate with another friction law, None where none gains.

    Where the residual is as small as its noise no law is looked for, and no gain counts that the errors of the fit's effects may
    give. One that extends another law is looked for where it promises to gain, and neither the effect nor any other law leaves as
    little as the noise.
    """

    def left(one: Fit) -> float:
        return misfit(balance, balance.residual(one.axis, fit.noise))

    def with_laws(terms: list[Term]) -> list[LawCandidate]:
        return law_candidates(balance, fit, terms, believed, beside_own=True)

    found = left(fit)
    if found < 1.0 + NOISE_SHARE:
        return None
    terms = other_laws(fit.axis, excluded)
    tried = with_laws([term for term in terms if not term.extends])
    others = [candidate.fit for candidate in tried] + ([effect.fit] if effect is not None else [])
    if min(map(left, others), default=found) >= 1.0 + NOISE_SHARE:
        tried += with_laws([x for x in terms if x.extends and extension_promises(balance, fit, x, tried)])
    best = simplest_law(balance, tried)
    return None if best is None or best.gain < imperfection(base, fit, balance) else best


def _comes_first(balance: TorqueBalance, fit: Fit, law: LawCandidate, effect: Candidate | None) -> bool:
    """Whether a better law takes its place before the best effect does: where it does as well.

    If the data cannot tell the two apart, the law comes first unless the effect has fewer numbers and is no part of a law.
    """
    if effect is None:
        return True
    simpler = len(effect.fit.free) < len(law.fit.free) and not any(item.term.features for item in effect.items)
    found = misfit(balance, balance.residual(fit.axis, fit.noise))
    return law.score - effect.score >= (DISTINGUISHABLE * found if simpler else -DISTINGUISHABLE * found)


def _without_added(axis: Axis, base: Axis) -> Axis:
    """The axis without the effects that another one does not have."""
    for item in added_effects(axis, base):
        axis = axis.without_effect(item)
    return axis


def one_round(balance: TorqueBalance, fit: Fit, excluded: frozenset[str] = frozenset()) -> list[Candidate]:
    """All effects on top of a fit, and the best pair of them; the promising ones fitted jointly, best first."""
    projected = ProjectedResidual(balance, fit)
    dispersion = projected.dispersion

    def beyond_chance(start: Start, share: float = 1.0) -> float:
        terms = [item.term for item in start.instances]
        return start.promise / dispersion - share * threshold(balance, terms, start.count, start.alternatives)

    found = [start for start in all_starts(projected, excluded) if told_from_torque(projected, start)]
    by_kind: dict[tuple[Kind, ...], list[Start]] = {}
    for start in found:
        if beyond_chance(start, HALF_PROMISED) >= 0.0:
            by_kind.setdefault(start.kinds, []).append(start)
    several = [some[:2] if some[0].instance.term.discontinuous else some[:1] for some in by_kind.values()]
    promising = close_behind(list(itertools.chain.from_iterable(several)))[:TRIED]
    single = max(map(beyond_chance, found), default=0.0)
    both = max(pairs_of_starts(projected, found), key=beyond_chance, default=None)
    if both is not None and beyond_chance(both) > max(single, 0.0):
        promising.append(both)
    promising = side_by_side(partial(refined, projected), promising)
    candidates = fitted_candidates(balance, fit, promising, dispersion)
    return with_best_confirmed(balance, fit, candidates, dispersion)


def close_behind(found: Sequence[Start]) -> list[Start]:
    """The two best starts, and those that a joint fit may still bring before them."""
    ranked = sorted(found, key=lambda start: -start.promise)
    return ranked[:2] + [start for start in ranked[2:] if start.promise > CLOSE_BEHIND * ranked[0].promise]


def _confused_with_collisions(fit: Fit) -> frozenset[str]:
    """Linear filters, while there are collisions: what these leave untimed looks like modes and delays."""
    if not any(item.term.collides for item in fit.axis.effects):
        return frozenset()
    return frozenset(name for name, term in effects().items() if term.transfer is not None)


def _placed_again(balance: TorqueBalance, fit: Fit, items: Sequence[Instance]) -> Fit:
    """The fit with those of these effects where a search now puts each whose torque jumps with its shape, or that is a slow wave.

    What was missing when they were found may have led them astray, and no joint fit, which follows derivatives, leads them back.
    """
    for old in items:
        item = next((x for x in fit.axis.effects if x.identity == old.identity), None)
        if item is not None and (item.term.discontinuous or (item.term.periodic == "position" and not item.term.whole)):
            fit = _placed_elsewhere(balance, fit, item) or fit
    return fit


def _placed_elsewhere(balance: TorqueBalance, fit: Fit, item: Instance) -> Fit | None:
    """The fit with one effect found once more, on top of all others or beside them as they are, if it does better there."""
    base = fit_without(balance, fit, item)
    projected = ProjectedResidual(balance, base)
    found = starts(projected, item.term, item.signal)
    start = refined(projected, found[0]) if found else None
    if start is None or start.gain <= base.squares - fit.squares:
        base = taken_out(balance, fit, item)
        start = _refined_in_place(ProjectedResidual(balance, base), item) if item.term.discontinuous else None
    if start is None:
        return None
    placed = base.axis.with_effect(item.replace(**start.instance.values))
    trial = fit_jointly(balance, placed, fit.noise, PLACING_ITERATIONS)
    better = fit.squares - trial.squares > 0.0
    return settle(balance, trial.axis, trial.noise, rounds=1) if better else None


def _refined_in_place(projected: ProjectedResidual, item: Instance) -> Start | None:
    """A better start for an effect that was taken out, found from the shape that it had; None where there is none."""
    here = judged_linear(projected, item.term, item.shape, item.signal, 1.0)
    better = refined(projected, here) if here is not None else None
    return None if better is here else better


def pruned(
    balance: TorqueBalance, fit: Fit, retuned: Fit, alternatives: Mapping[Kind, float] | None = None
) -> Fit:
    """Drop effects beyond those of the retuned fit that no longer earn their place, or that cannot be beside the others.

    Of those that cannot be beside each other the one that does least goes first.

    `alternatives`: for each kind of effect, among how many it was found. A lone effect has just earned its place, if it is still
    what it says; what others leave behind has not.
    """
    alternatives = alternatives or {}
    items = added_effects(fit.axis, retuned.axis)
    if len(items) == 1 and doubt(balance, fit, items[0], fit.axis) is None:
        return fit
    while items := added_effects(fit.axis, retuned.axis):
        fewer = side_by_side(partial(fit_without, balance, fit), items)
        margins = []
        for item, alone in zip(items, fewer, strict=True):
            limit = threshold(balance, [item.term], fit.numbers_of(item), alternatives.get(kind_of(item), 1.0))
            loss = (alone.squares - fit.squares) / fit.squares.dispersion
            margin = loss - max(limit, imperfection(retuned, alone, balance))
            if follows_load(item.term):  # noise of the logged torque is no loss, and the noise estimate has followed it
                margin = min(margin, gains_of_load(balance, fit, item)[0] / fit.squares.dispersion - limit)
            margins.append((doubt(balance, fit, item, fit.axis) is None, margin))
        worst = min(range(len(items)), key=lambda k: margins[k])
        if margins[worst] > (True, 0.0):
            break
        fit = settle(balance, fewer[worst].axis, fit.noise, rounds=1)
    return fit


def beyond_remaining_spectrum(balance: TorqueBalance, fit: Fit, retuned: Fit) -> Fit:
    """The fit without effects that a torque of unknown cause, as large as what is left near each frequency, explains by chance.

    The noise is estimated from what does not repeat; here the residual as it is counts as noise, its lines by the neighbourhood
    that they stand in. It may be far from Gaussian: odds are squared.
    """
    while items := added_effects(fit.axis, retuned.axis):
        noise = fit.noise
        left = noise.spectrum(balance.residual(fit.axis, noise))
        power, squared = (ndimage.uniform_filter1d(x, SPECTRUM_NEIGHBOURS, mode="nearest") for x in (left, left**2))
        local = 0.5 * squared / np.maximum(power, 1e-300)  # power-weighted mean; of chi-squared of two it is twice the mean
        times = np.maximum(local / noise.samples.white_level, 1.0)
        fewer = side_by_side(partial(fit_without, balance, fit), items)
        margins = []
        for item, alone in zip(items, fewer, strict=True):
            gain = float(np.sum((noise.spectrum(balance.residual(alone.axis, noise)) - left) / times))
            margins.append(gain - chance(fit.numbers_of(item), 1.0 / FALSE_ALARM))
        if min(margins) > 0.0:
            break
        rules.SPECTRUM.decides()
        fit = settle(balance, fewer[int(np.argmin(margins))].axis, noise, rounds=1)
    return fit
