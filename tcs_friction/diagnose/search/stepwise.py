"""Chooses the effects: forward, backward and swap steps over joint fits, with error control over all that was looked at."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.balance import Balance, Fit
from tcs_friction.diagnose.fit.joint_fit import joined, judged, recovered, settle, without
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.candidates import (
    FALSE_ALARM,
    NEIGHBOURS,
    SAME,
    WINNING,
    Candidate,
    chance,
    gained,
    implausible,
    impossible,
    refine,
    threshold,
)
from tcs_friction.diagnose.search.cross_validation import confirmed
from tcs_friction.diagnose.search.hypotheses import (
    Start,
    all_starts,
    climbed,
    dispersion,
    eligible,
    name_of,
    starts,
    together,
)
from tcs_friction.diagnose.search.matched_filter import APART, angle
from tcs_friction.diagnose.search.projection import Background
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance

ALIKE = 0.02  # of a gain: what noise in motion and torque does to it through the feedback, whatever its statistics say
IMPERFECT, IMPERFECT_AT_MOST = 1e-3, 0.02  # of the power that others explain, of the noise power: what their errors may leave
TRIED = 5  # candidates a round that are fitted jointly
BEHIND = 0.1  # of the best start's gain, from which a start is fitted jointly, too
RIVALS = 6  # that compete for a chosen effect's place
MINOR = 0.3  # of a wave's amplitude, below which one at a multiple of its order is no wave of its own
MOST = 6  # effects
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Rivals:
    """One chosen effect against the rest of the vocabulary in its place: the fit without it, and all candidates, best first."""

    without: Fit
    same: float  # gain below which candidates cannot be told apart
    gain: float  # of the chosen effect, in units of the noise
    candidates: list[Candidate]


@dataclass
class Selection:
    """The chosen axis, rounds of candidates (each best first), and the fit of the base model alone."""

    retuned: Fit
    chosen: Fit
    rounds: list[list[Candidate]] = field(default_factory=list)
    rivals: list[Rivals] = field(default_factory=list)


def _mimicked(fit: Fit) -> frozenset[str]:
    """Linear filters, while there are collisions: what these leave untimed looks like swings and delays.

    What is larger than they are came before them.
    """
    if not any(item.term.collides for item in fit.axis.effects):
        return frozenset()
    return frozenset(name for name, term in effects().items() if term.transfer is not None)


def one_round(balance: Balance, fit: Fit, barred: frozenset[str] = frozenset()) -> list[Candidate]:
    """All effects on top of a fit, and the best pair of them; the promising ones fitted jointly, best first."""
    background = Background(balance, fit.axis, fit.free)
    spread = dispersion(background)
    base = judged(balance, fit)

    def promise(start: Start, share: float) -> float:
        limit = threshold(balance, [item.term for item in start.instances], start.count, start.looks)
        return start.gain / spread / start.excess - share * limit

    found = all_starts(background, barred)
    best: dict[str, list[Start]] = {}
    for start in found:
        if promise(start, 0.5) >= 0.0:
            best.setdefault(start.name, []).append(start)
    several = [some[:2] if some[0].instance.term.jagged else some[:1] for some in best.values()]
    promising = close_behind(list(itertools.chain.from_iterable(several)))[:TRIED]
    single = max((promise(start, 1.0) for start in found), default=0.0)
    both = max(together(background, found), key=lambda pair: promise(pair, 1.0), default=None)
    if both is not None and promise(both, 1.0) > max(single, 0.0):
        promising.append(both)

    promising = side_by_side(partial(climbed, background), promising)
    return confirmed(balance, base, refine(balance, fit.axis, promising, base, spread), spread)


def close_behind(found: Sequence[Start]) -> list[Start]:
    """The two best starts, and those that a joint fit may still bring before them."""
    ranked = sorted(found, key=lambda start: -start.gain / start.excess)
    return ranked[:2] + [s for s in ranked[2:] if s.gain / s.excess > BEHIND * ranked[0].gain / ranked[0].excess]


def select(
    balance: Balance,
    axis: Axis,
    progress: Progress | None = None,
    barred: frozenset[str] = frozenset(),
    hopeless: Callable[[Selection], bool] | None = None,
) -> Selection:
    """Forward selection with backward checks; noise and weights are estimated anew after each step.

    `barred` effects are never tried: the data cannot carry them. `progress` may raise to cancel. `hopeless` is asked
    from the second effect on whether to go on makes no sense.
    """
    believed = len(axis.effects)
    retuned = settle(balance, axis)
    selection = Selection(retuned, retuned)
    fit = retuned
    looks: dict[str, float] = {}
    for round_number in range(MOST):
        if progress is not None:
            progress(
                0.2 + 0.1 * round_number, f"round {round_number + 1}: {len(fit.axis.effects)} effects"
            )
        candidates = one_round(balance, fit, barred | _mimicked(fit))
        selection.rounds.append(candidates)
        if not candidates or candidates[0].score <= 0.0 or candidates[0].gain < imperfection(balance, retuned, fit):
            break
        fit = settle(balance, recovered(balance, candidates[0].fit, axis), rounds=2)
        earlier = len(fit.axis.effects) - (len(candidates[0].items) == 1)
        fit = as_harmonics(balance, searched_anew(balance, fit, range(believed, earlier)), believed)
        looks |= {name_of(item): candidates[0].start.looks for item in candidates[0].items}
        selection.chosen = fit = prune(balance, fit, retuned, looks)
        if hopeless is not None and len(fit.axis.effects) > believed + 1 and hopeless(selection):
            break
    return selection


def searched_anew(balance: Balance, fit: Fit, indices: range) -> Fit:
    """The fit with jagged ones of these effects where a search now puts each.

    What was missing then may have led it astray, and no derivative leads it back.
    """
    index = indices.start
    for _ in indices:
        jagged = fit.axis.effects[index].term.jagged
        better = _placed_anew(balance, fit, index) if jagged else None
        if better is None:
            index += 1
        else:
            fit = better  # the effect is its last one now
    return fit


def as_harmonics(balance: Balance, fit: Fit, believed: int) -> Fit:
    """The fit in which a small wave at a multiple of another one's order is its harmonic, and none is there twice.

    Where they can be told apart, only if that explains as much.
    """
    for one, other in itertools.permutations(fit.axis.effects[believed:], 2):
        if one.term is not other.term or one.term.periodic != "position":
            continue
        ratio = other.values["order"] / one.values["order"]
        name = f"_{round(ratio)}"
        apart = abs(ratio - round(ratio)) * one.values["order"] * float(np.ptp(angle(balance, fit.axis, one.term)))
        if apart > 2.0 * math.pi or f"amplitude{name}" not in one.values:
            continue
        waves = [p.name for p in one.term.parameters if p.name.startswith("amplitude") and other.values[p.name] != 0.0]
        minor = waves == ["amplitude"] and other.values["amplitude"] < MINOR * one.values["amplitude"]
        twice = one.values[f"amplitude{name}"] != 0.0
        if twice:
            rest, numbers = fit.axis, {f"amplitude{name}": 0.0, f"phase{name}": 0.0}
        elif minor:
            rest = fit.axis.without_effect(other)
            numbers = {f"{own}{name}": other.values[own] for own in ("amplitude", "phase")}
        else:
            continue
        items = tuple(item.replace(**numbers) if item is one else item for item in rest.effects)
        trial = settle(balance, replace(rest, effects=items), rounds=1)
        one_wave = twice and apart < 2.0 * math.pi * APART
        if one_wave or trial.squares < balance.squares(fit.axis) + SAME * balance.misfit(trial.axis):
            return as_harmonics(balance, trial, believed)
        balance.weigh(fit.axis)
    return fit


def _placed_anew(balance: Balance, fit: Fit, index: int) -> Fit | None:
    """The fit with one effect found once more on top of all others, if it does better there."""
    item = fit.axis.effects[index]
    alone = judged(balance, without(balance, fit, index))
    background = Background(balance, alone.axis, alone.free)
    found = starts(background, item.term, item.signal)
    squares = balance.squares(fit.axis)
    start = climbed(background, found[0]) if found else None
    if start is None or start.gain <= alone.squares - squares:
        return None
    anew = alone.axis.with_effect(start.instance)
    trial = joined(balance, anew, iterations=12)
    return settle(balance, trial.axis, rounds=1) if trial.squares < squares else None


def contend(balance: Balance, selection: Selection, believed: int, progress: Progress | None) -> None:
    """Let what was promising compete for the place of every chosen effect; keeps the rivals."""
    fit = selection.chosen
    for index in range(believed, len(fit.axis.effects)):
        if progress is not None:
            progress(0.8, f"rivals of {fit.axis.effects[index].term.id}")
        fit, rivals = contest(balance, fit, index, challengers(selection, fit, index))
        selection.rivals.append(rivals)
    selection.chosen = fit


def challengers(selection: Selection, fit: Fit, index: int) -> list[Start]:
    """Where rivals of an effect may start: candidates of the round that brought it, then of others, each effect once."""
    name = name_of(fit.axis.effects[index])
    present = {name_of(item) for item in fit.axis.effects}
    rounds = sorted(selection.rounds, key=lambda candidates: all(name not in c.name.split("+") for c in candidates))
    best: dict[str, Start] = {}
    for candidate in itertools.chain.from_iterable(rounds):
        single = len(candidate.items) == 1
        if single and (candidate.name not in present or (candidate.items[0].term.periodic and candidate.name != name)):
            best.setdefault(candidate.name, replace(candidate.start, instances=candidate.items))
    return list(best.values())[:RIVALS]


def contest(
    balance: Balance, fit: Fit, index: int, rivals: Sequence[Start]
) -> tuple[Fit, Rivals]:
    """Let rivals compete for one effect's place; swap where one does better, or as well through the same signal with less."""
    alone = judged(balance, without(balance, fit, index))
    spread = max(1.0, fit.squares / balance.effective_count)
    item = fit.axis.effects[index]
    gain = gained(balance, alone, judged(balance, fit), [item]) / spread
    rivals = [*rivals, *_through_the_same(balance, alone, item, {rival.name for rival in rivals})]
    refined = refine(balance, alone.axis, close_behind(rivals), alone, spread)
    fitted = {id(candidate.fit): candidate.gain for candidate in refined}
    candidates = [  # the effect in place had its own confirmation: gains are compared as fitted
        replace(c, gain=fitted[id(c.fit)]) if c.gain > WINNING * fitted[id(c.fit)] else c
        for c in confirmed(balance, alone, refined, spread)
    ]
    candidates.sort(key=lambda candidate: -candidate.score)
    count = sum(f.owner == index for f in fit.free)
    tie = max(SAME * balance.misfit(fit.axis), IMPERFECT * gain)
    same = max(tie, ALIKE * gain)
    better = [c for c in candidates[:1] if c.score > gain - threshold(balance, [item.term], count, 1.0) + same]
    better += [c for c in candidates if c.items[0].signal and c.start.count < count and c.gain > gain - tie]
    if better:
        best = better[0]
        order = [*range(index), len(best.fit.axis.effects) - 1, *range(index, len(best.fit.axis.effects) - 1)]
        swapped = replace(best.fit.axis, effects=tuple(best.fit.axis.effects[i] for i in order))
        settled = settle(balance, swapped, rounds=1)
        if not impossible(balance, settled, index):
            return settled, Rivals(alone, same, best.gain, [c for c in candidates if c is not best])
        balance.weigh(fit.axis)
    return fit, Rivals(alone, same, gain, candidates)


def _through_the_same(balance: Balance, alone: Fit, item: Instance, known: set[str]) -> list[Start]:
    """Starts of effects not yet known that act through an effect's recorded signal: a general one hides its special cases."""
    if item.signal is None:
        return []
    background = Background(balance, alone.axis, alone.free)
    others = [term for term, signal in eligible(alone.axis, balance) if signal == item.signal and term is not item.term]
    found = [start for term in others for start in starts(background, term, item.signal)[:1]]
    return [start for start in found if start.name not in known]


def imperfection(balance: Balance, retuned: Fit, fit: Fit) -> float:
    """Gain that effects may leave to others because they are not known exactly: a share of theirs, at most of the noise power."""
    squares = balance.squares(fit.axis)
    spread = max(1.0, squares / balance.effective_count)
    explained = (balance.squares(retuned.axis) - squares) / spread
    return min(IMPERFECT * explained, IMPERFECT_AT_MOST * balance.effective_count)


def prune(balance: Balance, fit: Fit, retuned: Fit, looks: Mapping[str, float] | None = None) -> Fit:
    """Drop effects beyond those of the retuned fit that no longer earn their place, or that cannot be beside the others.

    `looks`: by an effect's name, among how many alternatives it was found.
    """
    looks = looks or {}
    believed = len(retuned.axis.effects)
    fewest = believed + 1  # a lone effect has just earned its place; what others leave behind has not
    while len(fit.axis.effects) > fewest:
        fewest = believed
        spread = max(1.0, fit.squares / balance.effective_count)
        fewer = side_by_side(partial(without, balance, fit), range(believed, len(fit.axis.effects)))
        losses = []
        for index, alone in enumerate(fewer, believed):
            count, item = sum(f.owner == index for f in fit.free), fit.axis.effects[index]
            limit = threshold(balance, [item.term], count, looks.get(name_of(item), 1.0))
            loss = (alone.squares - fit.squares) / spread - max(limit, imperfection(balance, retuned, alone))
            losses.append(-math.inf if implausible(balance, fit.axis, fit, index) else loss)
        if min(losses) > 0.0:
            break
        fit = settle(balance, fewer[int(np.argmin(losses))].axis, rounds=1)
    return fit


def outstanding(balance: Balance, fit: Fit, believed: int) -> Fit:
    """The fit without effects that a torque of unknown cause, as large as what is left near each frequency, explains by chance.

    The noise is estimated from what does not repeat; here the residual as it is counts as noise, its lines by the neighbourhood
    that they stand in. It may be far from Gaussian: odds are squared.
    """
    while len(fit.axis.effects) > believed:
        left = balance.spectrum(balance.residual(fit.axis))
        power, squared = (ndimage.uniform_filter1d(x, NEIGHBOURS, mode="nearest") for x in (left, left**2))
        local = 0.5 * squared / np.maximum(power, 1e-300)  # power-weighted mean; of chi-squared of two it is twice the mean
        times = np.maximum(local / balance.white_level, 1.0)
        fewer = side_by_side(partial(without, balance, fit), range(believed, len(fit.axis.effects)))
        margins = []
        for index, alone in enumerate(fewer, believed):
            gain = float(np.sum((balance.spectrum(balance.residual(alone.axis)) - left) / times))
            margins.append(gain - chance(sum(f.owner == index for f in fit.free), 1.0 / FALSE_ALARM))
        if min(margins) > 0.0:
            break
        fit = settle(balance, fewer[int(np.argmin(margins))].axis, rounds=1)
    return fit
