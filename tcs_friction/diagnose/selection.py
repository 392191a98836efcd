"""Chooses the effects: forward, backward and swap steps over joint fits, with error control over everything that was looked at.

A step is judged by the drop of the whitened train squares after a joint refit of all free numbers, less what chance would
give: chi-squared with as many numbers, Bonferroni's correction for the alternatives that were searched through and for the
length of the vocabulary. Effects made from logged torque, acceleration or a memory of them feed on the residual's own noise
and on what sampling leaves behind; they have to explain a share of the noise power as well.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy import ndimage, stats

from tcs_friction.diagnose.background import Background, survey
from tcs_friction.diagnose.balance import Balance, Fit, Free, at_bound, rms
from tcs_friction.diagnose.hypotheses import (
    Start,
    all_starts,
    climbed,
    dispersion,
    follows_load,
    gain_by_motion,
    name_of,
    starts,
    together,
)
from tcs_friction.diagnose.side_by_side import side_by_side
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Place, Role, Term

ODDS = 100.0  # to one, by which an effect must beat a rival
SAME = 2.0 * math.log(ODDS)  # gain, in units of the misfit, that this takes
ALIKE = 0.02  # of a gain: what noise in motion and torque does to it through the feedback, whatever its statistics say
FALSE_ALARM = 0.01  # chance that any of the vocabulary is named where nothing is missing
MATERIAL = 0.006  # of the noise power, for effects that feed on noise
BEYOND = 1.5e-3  # of the noise power beyond chance, that collisions must explain and no blurred signal does
LARGEST = 1.2  # of the logged torque's rms: a larger effect cancels against another one and is no physics
IMPERFECT, IMPERFECT_AT_MOST = 3e-4, 0.02  # of the power that others explain, of the noise power: what their errors may leave
SLOW_PERIODS = 4.0  # of the cutoff, averaged over to see the slow part
TRIED = 5  # candidates a round that are fitted jointly
STEPS, WINNING = 3, 0.5  # of a joint fit half way; of the best gain there, or of the fitted one where confirmed, to count
BEHIND = 0.1  # of the best start's gain, from which a start is fitted jointly, too
RIVALS = 6  # that compete for a chosen effect's place
MOST = 6  # effects
REACH = 3.0  # times the proposed values, within which an effect can be told from others
ASTRAY = 2.0  # factor from a believed number of the law, from which its fit may be another basin
WORSE = 1.01  # by which the plain residual may grow on pieces that a candidate was not fitted to
AROUND = 3.0  # widths about its centre, where a local effect that was passed once must account for all
ONCE = 0.1  # of a candidate's gain, or what chance gives, must come from other pieces than the best
PRIOR = 1.0  # log units by which a base parameter may wander from the believed one if the data do not say
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Candidate:
    """An effect, or two, after a joint fit: the drop of squares in units of the noise, what chance takes, the fit."""

    name: str
    gain: float
    threshold: float
    fit: Fit
    start: Start

    @property
    def items(self) -> tuple[Instance, ...]:
        """The effects, the fit's last ones."""
        return self.fit.axis.effects[-len(self.start.instances) :]

    @property
    def score(self) -> float:
        """Gain beyond chance; positive: worth adding."""
        return self.gain - self.threshold


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


def prior(free: list[Free] | tuple[Free, ...]) -> np.ndarray:
    """Standard deviations that keep undetermined base parameters near where they were; effects are free."""
    return np.array([PRIOR if f.owner < 0 else (3.0 if f.kind == "log" else np.inf) for f in free])


def settle(balance: Balance, axis: Axis, rounds: int = 3) -> Fit:
    """Joint fit of everything the axis has, noise and weights estimated along the way."""
    balance.estimate_noise(balance.residual(axis), axis)
    fit = None
    for i in range(rounds):
        free = balance.free(axis)
        fit = balance.fit(axis, free, prior(free), iterations=20 if i == 0 else 8)
        axis = fit.axis
        balance.weigh(axis)
    assert fit is not None
    return _judged(balance, fit)


def _judged(balance: Balance, fit: Fit) -> Fit:
    """The fit with its squares under the present weights."""
    return replace(fit, squares=balance.squares(fit.axis))


def feeds_on_noise(term: Term) -> bool:
    """Whether noise of the residual is in what an effect is made from: logged torque, acceleration, or a memory of motion."""
    torque = "torque" in term.reads and not term.periodic
    memory = term.states != 0 and not term.signals
    return torque or memory or term.place is Place.BODY


def rings(term: Term) -> bool:
    """Whether an effect is a body that swings or collides: what it explains is fast, as the noise is."""
    return term.place is Place.BODY and term.states != 0


def _mimicked(fit: Fit) -> frozenset[str]:
    """Linear filters, while a jagged effect is there: the collisions that it leaves untimed look like swings and delays.

    What is larger than the jagged effect came before it.
    """
    if not any(item.term.jagged for item in fit.axis.effects):
        return frozenset()
    return frozenset(name for name, term in effects().items() if term.transfer is not None)


def chance(count: int, looks: float) -> float:
    """Gain (chi-squared) that `count` free numbers reach by chance, the best of `looks` alternatives of every effect."""
    return float(stats.chi2.isf(FALSE_ALARM / (looks * len(effects())), max(count, 1)))


def threshold(balance: Balance, terms: Sequence[Term], count: int, looks: float) -> float:
    """Gain that chance may give, and noise to effects that feed on it."""
    material = MATERIAL * balance.effective_count if any(map(feeds_on_noise, terms)) else 0.0
    return chance(count, looks) + material + (len(terms) - 1) * chance(1, 1.0)


def slow_part(balance: Balance, white: np.ndarray) -> np.ndarray:
    """Running mean of whitened rows over SLOW_PERIODS of the cutoff."""
    window = max(2, round(SLOW_PERIODS / (balance.data.cutoff * balance.data.dt)))
    return np.asarray(ndimage.uniform_filter1d(white, window))


def blurs(balance: Balance, axis: Axis) -> np.ndarray:
    """What slow sampling, interpolation and smoothing do to signals: orthonormal whitened rows (rows, 4).

    Friction's first and second derivative by time, the second ones of acceleration and torque. A gap is more than a filter.
    """
    friction = balance.parts.friction(axis)
    columns = [balance.slope(friction), balance.slope(balance.slope(friction))]
    for x in (balance.parts.acceleration(axis), balance.parts.rotor(axis)[0]):
        columns.append(balance.slope(balance.slope(x)))
    white = balance.whiten(np.stack(columns, axis=1))
    return np.asarray(np.linalg.qr(white / np.maximum(np.linalg.norm(white, axis=0), 1e-300))[0])


def refine(balance: Balance, axis: Axis, starts: Sequence[Start], base: Fit, spread: float) -> list[Candidate]:
    """The candidates after joint fits from their starts; half way, only those that may still win go on."""
    fits = side_by_side(partial(_joined, balance, axis), starts)
    needed = base.squares - WINNING * (base.squares - min((fit.squares for fit in fits), default=0.0))

    def finished(fit: Fit) -> Fit:
        return fit if fit.converged or fit.squares > needed else _stepped(balance, fit.axis)

    fits = side_by_side(finished, fits)
    return side_by_side(lambda pair: _candidate(balance, axis, *pair, base, spread), zip(starts, fits, strict=True))


def _joined(balance: Balance, axis: Axis, start: Start) -> Fit:
    """The first steps of the joint fit of an axis with what a start adds."""
    for item in start.instances:
        axis = _widened(balance, axis, item)
    return _stepped(balance, axis)


def _stepped(balance: Balance, axis: Axis) -> Fit:
    free = balance.free(axis)
    return balance.fit(axis, free, prior(free), iterations=STEPS, tolerance=0.5)


def _candidate(balance: Balance, axis: Axis, start: Start, fit: Fit, base: Fit, spread: float) -> Candidate:
    """What a fit from a start is worth beside the base.

    Noise of the encoder is in the residual through the acceleration and in the torque through the controller, so effects that
    feed on noise gain by it at high frequency. What they gain must show in the slow part as well; of collisions, beyond what
    blurred signals explain; of friction that follows the load, with the load taken from the motion.
    """
    terms = [item.term for item in start.instances]
    limit = threshold(balance, terms, start.count, start.looks)
    gain = (base.squares - fit.squares) / spread / start.excess
    if any(_implausible(balance, axis, fit, len(axis.effects) + k) for k in range(len(terms))):
        gain = 0.0
    both = [balance.whiten(balance.residual(x.axis)) for x in (base, fit)]
    if any(feeds_on_noise(term) and not rings(term) for term in terms):
        before, after = (slow_part(balance, white) for white in both)
        slow = float(before @ before - after @ after) / spread
        if slow < chance(start.count, start.looks):
            gain = min(gain, slow)
    if any(term.jagged for term in terms):
        blurred = blurs(balance, base.axis)
        before, after = (white - blurred @ (blurred.T @ white) for white in both)
        change = before - after  # its best multiple counts: the fit could not know the blurs
        beyond = max(float(change @ before), 0.0) ** 2 / max(float(change @ change), 1e-300) / spread
        if beyond < chance(start.count, start.looks) + BEYOND * balance.effective_count:
            gain = min(gain, beyond)
    for item in fit.axis.effects[len(axis.effects) :]:
        if follows_load(item.term):
            others = replace(fit.axis, effects=tuple(x for x in fit.axis.effects if x is not item))
            by_motion = gain_by_motion(Background(balance, others, balance.free(others)), item) / spread
            if by_motion < threshold(balance, [item.term], 1, 1.0):
                gain = min(gain, by_motion)
    return Candidate(start.name, gain, limit, fit, replace(start, columns=np.empty((0, 0))))


def _widened(balance: Balance, axis: Axis, item: Instance) -> Axis:
    """The axis with one more effect; a delay takes the alignment of the log over."""
    if item.term.id != "transport_delay":
        return axis.with_effect(item)
    late = item.values["delay"] + axis.actuation_delay - balance.believed_delay
    aligned = replace(axis, actuation_delay=balance.believed_delay)
    return aligned.with_effect(item.replace(delay=max(late, 0.0)))


def _implausible(balance: Balance, axis: Axis, fit: Fit, index: int) -> bool:
    """Whether a fitted effect cannot be, or ended where it proposes nothing for such a recording."""
    return _impossible(balance, fit, index) or _out_of_reach(balance, axis, fit.axis.effects[index])


def _impossible(balance: Balance, fit: Fit, index: int) -> bool:
    """Whether an effect is larger than any torque, or its own declaration warns of its values."""
    item = fit.axis.effects[index]
    kept = tuple(other for other in fit.axis.effects if other is not item)
    own = balance.residual(replace(fit.axis, effects=kept)) - balance.residual(fit.axis)
    return bool(item.term.warn(item.values)) or rms(own[balance.train]) > LARGEST * balance.torque_size


@dataclass(frozen=True)
class LeftOut:
    """Squares of a fit on pieces (p,) of the train data that it is not fitted to: whitened, and of the plain residual."""

    white: np.ndarray
    plain: np.ndarray


def _out_of_reach(balance: Balance, axis: Axis, item: Instance) -> bool:
    """Whether a fit ended at a declared bound, or far from all values that the effect proposes for such a recording."""
    for parameter in item.term.parameters:
        value = item.values[parameter.name]
        if parameter.role in (Role.FIXED, Role.PHASE) or value == parameter.default or value == 0.0:
            continue
        near = 1e-3 * abs(value)
        if abs(value - parameter.lower) < near or abs(value - parameter.upper) < near:
            return True
    scans = item.term.scan(survey(balance, axis))
    for name in scans[0] if len(scans) else ():
        values = {scan[name] for scan in scans}
        given = item.values[name] != item.term.parameter(name).default
        if given and len(values) > 2 and not min(values) / REACH < item.values[name] < REACH * max(values):
            return True
    return False


def left_out(balance: Balance, fit: Fit, count: int = 1) -> LeftOut:
    """The numbers of the last `count` effects without one piece at a time, linear about the optimum.

    A piece is as long as a held-out one. All other numbers follow the effects as they do over the whole data: what one piece
    alone says about a bristle is not asked.
    The shape of a jagged effect stays as it is: derivatives by it say nothing.
    """
    own = np.array([f.owner >= len(fit.axis.effects) - count for f in fit.free])
    still = [mine and _jagged(fit.axis, f) for mine, f in zip(own, fit.free, strict=True)]
    residual = balance.residual(fit.axis)
    plain = balance.columns(fit.axis, fit.free, residual)
    size = np.linalg.norm(plain, axis=0) * [
        at_bound(fit.axis, fit.free, k) == 0 and not still[k] for k in range(len(fit.free))
    ]
    plain, own = plain[:, size > 0.0] / size[size > 0.0], own[size > 0.0]
    columns, white = balance.whiten(plain), balance.whiten(residual)
    follow = np.linalg.lstsq(columns[:, ~own], columns[:, own], rcond=1e-9)[0]
    plain, columns = plain[:, own] - plain[:, ~own] @ follow, columns[:, own] - columns[:, ~own] @ follow
    normal, scores = columns.T @ columns, columns.T @ white
    piece = balance.pieces
    squares = LeftOut(np.zeros(piece.max() + 1), np.zeros(piece.max() + 1))
    for number in range(len(squares.white)):
        left, every = piece[balance.rows] == number, (piece == number) & balance.train
        some = columns[left]
        others = normal - some.T @ some
        step = -np.linalg.lstsq(others, scores - some.T @ white[left], rcond=1e-10)[0]
        squares.white[number] = np.sum((white[left] + some @ step) ** 2)
        squares.plain[number] = np.sum((residual[every] + plain[every] @ step) ** 2)
    return squares


def _jagged(axis: Axis, number: Free) -> bool:
    """Whether its effect's torque jumps with a number."""
    item = axis.effects[number.owner]
    return item.term.jagged and item.term.parameter(number.name).role is Role.SHAPE


def as_fitted(balance: Balance, fit: Fit) -> LeftOut:
    """Squares of a fit on every piece as it is."""
    residual = balance.residual(fit.axis)
    count = int(balance.pieces.max()) + 1
    white = np.bincount(balance.pieces[balance.rows], balance.whiten(residual) ** 2, count)
    plain = np.bincount(balance.pieces[balance.train], residual[balance.train] ** 2, count)
    return LeftOut(white, plain)


def confirmed(balance: Balance, fit: Fit, candidates: list[Candidate], spread: float) -> list[Candidate]:
    """Candidates, best first, the best of them confirmed: what it gains, it gains on pieces that it was not fitted to.

    There the plain residual must not grow, and what depends on the place not gain in a single piece: it comes back to its place.
    What is in one place only, and was passed once, must account for all that was there instead.
    A jagged effect's best and worst piece do not count: one collision lost throws a whole piece out of step.
    """
    before: LeftOut | None = None
    if not candidates:
        return []
    waiting: list[Candidate] = list(candidates)
    done: list[Candidate] = []
    while True:
        best = simplest(balance, [*waiting, *done])
        if best.score <= 0.0 or any(best is candidate for candidate in done):
            break
        before = as_fitted(balance, fit) if before is None else before
        lone = len(best.items) == 1 and _passed_once(balance, best.items[0])
        after = as_fitted(balance, best.fit) if lone else left_out(balance, best.fit, len(best.items))
        gains = (before.white - after.white) / spread
        gain = float(gains.sum())
        placed = any(item.term.coordinate == "position" for item in best.items)
        enough = min(ONCE * gain, chance(best.start.count, best.start.looks))
        if lone:
            gain = best.gain if _accounts(balance, fit, best) else 0.0
        elif placed and gain - float(gains.max()) < enough:
            gain = 0.0
        kept = np.argsort(gains)
        if any(item.term.jagged for item in best.items):
            kept = kept[1:-1]
            gain = float(gains[kept].sum())
        if after.plain[kept].sum() > WORSE * before.plain[kept].sum():
            gain = 0.0
        waiting.remove(best)
        done.append(replace(best, gain=min(best.gain, gain + best.threshold if gain > 0.0 else gain)))
    rest = sorted((c for c in (*waiting, *done) if c is not best), key=lambda candidate: -candidate.score)
    return [best, *rest]


def _near(balance: Balance, item: Instance, widths: float) -> np.ndarray:
    """Rows in which the axis is so near to a local effect's place."""
    far = np.abs(balance.data.joined("position")[balance.rows] - item.values["centre"])
    return np.asarray(far < widths * item.values["width"])


def _passed_once(balance: Balance, item: Instance) -> bool:
    """Whether an effect is local and its place was passed once, or in one piece only: nothing is left to confirm it by."""
    if not item.term.local:
        return False
    near = _near(balance, item, 1.0)
    passes = np.count_nonzero(np.diff(near, prepend=False) & near)
    return bool(passes < 2 or len(np.unique(balance.pieces[balance.rows][near])) < 2)


def _accounts(balance: Balance, base: Fit, candidate: Candidate) -> bool:
    """Whether a local effect takes away nearly all that the base left around its place."""
    near = _near(balance, candidate.items[0], AROUND)
    before, after = (balance.whiten(balance.residual(fit.axis))[near] for fit in (base, candidate.fit))
    return bool(after @ after < ONCE * (before @ before))


def simplest(balance: Balance, candidates: list[Candidate]) -> Candidate:
    """The best candidate; of those that the data cannot tell from it, the one with the fewest declared parameters."""
    best = max(candidates, key=lambda candidate: candidate.score)
    if best.score <= 0.0:
        return best
    same = SAME * balance.misfit(best.fit.axis)
    close = [c for c in candidates if c.score > max(best.score - same, 0.0)]
    return min(close, key=lambda c: (sum(len(item.term.parameters) for item in c.items), -c.score))


def one_round(balance: Balance, fit: Fit, barred: frozenset[str] = frozenset()) -> list[Candidate]:
    """All effects on top of a fit, and the best pair of them; the promising ones fitted jointly, best first."""
    background = Background(balance, fit.axis, fit.free)
    spread = dispersion(background)
    base = _judged(balance, fit)

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


def without(balance: Balance, fit: Fit, index: int) -> Fit:
    """The joint fit without one effect."""
    axis = fit.axis
    kept = tuple(item for i, item in enumerate(axis.effects) if i != index)
    fewer = replace(axis, effects=kept)
    free = balance.free(fewer)
    return balance.fit(fewer, free, prior(free), iterations=5, tolerance=0.5)


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
        fit = searched_anew(balance, fit, range(believed, earlier))
        selection.chosen = fit = prune(balance, fit, retuned)
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


def _placed_anew(balance: Balance, fit: Fit, index: int) -> Fit | None:
    """The fit with one effect found once more on top of all others, if it does better there."""
    item = fit.axis.effects[index]
    alone = _judged(balance, without(balance, fit, index))
    background = Background(balance, alone.axis, alone.free)
    found = starts(background, item.term, item.signal)
    squares = balance.squares(fit.axis)
    start = climbed(background, found[0]) if found else None
    if start is None or start.gain <= alone.squares - squares:
        return None
    anew = alone.axis.with_effect(start.instance)
    free = balance.free(anew)
    trial = balance.fit(anew, free, prior(free))
    return settle(balance, trial.axis, rounds=1) if trial.squares < squares else None


def recovered(balance: Balance, fit: Fit, believed: Axis) -> Axis:
    """The fit's axis, or one fitted from the believed law where that does better.

    Without the effect the law's own numbers may have gone far astray to stand in for it, and find no way back.
    """
    start = replace(fit.axis, friction=believed.friction, inertia=believed.inertia)
    ratios = [fit.axis.friction.values[name] / max(v, 1e-300) for name, v in believed.friction.values.items()]
    if all(1.0 / ASTRAY < ratio < ASTRAY or ratio == 0.0 for ratio in ratios):
        return fit.axis
    free = balance.free(start)
    again = balance.fit(start, free, prior(free), iterations=20)
    return again.axis if again.squares < balance.squares(fit.axis) else fit.axis


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
    """Let rivals compete for one effect's place; swap where one does better."""
    alone = _judged(balance, without(balance, fit, index))
    spread = max(1.0, fit.squares / balance.effective_count)
    gain = (alone.squares - balance.squares(fit.axis)) / spread
    item = fit.axis.effects[index]
    refined = refine(balance, alone.axis, close_behind(rivals), alone, spread)
    fitted = {id(candidate.fit): candidate.gain for candidate in refined}
    candidates = [  # the effect in place had its own confirmation: gains are compared as fitted
        replace(c, gain=fitted[id(c.fit)]) if c.gain > WINNING * fitted[id(c.fit)] else c
        for c in confirmed(balance, alone, refined, spread)
    ]
    candidates.sort(key=lambda candidate: -candidate.score)
    count = sum(f.owner == index for f in fit.free)
    same = max(SAME * balance.misfit(fit.axis), ALIKE * gain)
    if candidates and candidates[0].score > gain - threshold(balance, [item.term], count, 1.0) + same:
        best = candidates[0]
        order = [*range(index), len(best.fit.axis.effects) - 1, *range(index, len(best.fit.axis.effects) - 1)]
        swapped = replace(best.fit.axis, effects=tuple(best.fit.axis.effects[i] for i in order))
        settled = settle(balance, swapped, rounds=1)
        if not _impossible(balance, settled, index):
            return settled, Rivals(alone, same, best.gain, candidates[1:])
        balance.weigh(fit.axis)
    return fit, Rivals(alone, same, gain, candidates)


def imperfection(balance: Balance, retuned: Fit, fit: Fit) -> float:
    """Gain that effects may leave to others because they are not known exactly: a share of theirs, at most of the noise power."""
    squares = balance.squares(fit.axis)
    spread = max(1.0, squares / balance.effective_count)
    explained = (balance.squares(retuned.axis) - squares) / spread
    return min(IMPERFECT * explained, IMPERFECT_AT_MOST * balance.effective_count)


def prune(balance: Balance, fit: Fit, retuned: Fit) -> Fit:
    """Drop effects beyond those of the retuned fit that no longer earn their place, or that cannot be beside the others."""
    believed = len(retuned.axis.effects)
    fewest = believed + 1  # a lone effect has just earned its place; what others leave behind has not
    while len(fit.axis.effects) > fewest:
        fewest = believed
        spread = max(1.0, fit.squares / balance.effective_count)
        fewer = side_by_side(partial(without, balance, fit), range(believed, len(fit.axis.effects)))
        losses = []
        for index, alone in enumerate(fewer, believed):
            count = sum(f.owner == index for f in fit.free)
            limit = threshold(balance, [fit.axis.effects[index].term], count, 1.0)
            loss = (alone.squares - fit.squares) / spread - max(limit, imperfection(balance, retuned, alone))
            losses.append(-math.inf if _implausible(balance, fit.axis, fit, index) else loss)
        if min(losses) > 0.0:
            break
        fit = settle(balance, fewer[int(np.argmin(losses))].axis, rounds=1)
    return fit


def outstanding(balance: Balance, fit: Fit, believed: int) -> Fit:
    """The fit without effects that a torque of unknown cause, as large and as slow as what is left, explains by chance.

    Whitening is estimated from what does not repeat and does not reach down to slow torques; here the residual as it is counts
    as noise, its density (one-sided, N^2 m^2/Hz) averaged over its own power. It may be far from Gaussian: odds are squared.
    """
    while len(fit.axis.effects) > believed:
        residual = balance.residual(fit.axis)
        power = np.abs(np.fft.rfft(np.where(balance.train, residual, 0.0))[1:]) ** 2
        density = 2.0 * balance.data.dt * float(np.sum(power**2) / np.sum(power)) / balance.train.sum()
        fewer = side_by_side(partial(without, balance, fit), range(believed, len(fit.axis.effects)))
        margins = []
        for index, alone in enumerate(fewer, believed):
            energy = float(np.sum(balance.residual(alone.axis)[balance.train] ** 2 - residual[balance.train] ** 2))
            needed = chance(sum(f.owner == index for f in fit.free), 1.0 / FALSE_ALARM)
            margins.append(energy * balance.data.dt - 0.5 * density * needed)
        if min(margins) > 0.0:
            break
        fit = settle(balance, fewer[int(np.argmin(margins))].axis, rounds=1)
    return fit
