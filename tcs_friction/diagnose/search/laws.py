"""The friction law as a question of its own: does another law explain the recording better than the one that is believed?

In: a fit. Out: a `LawCandidate`, the same axis with another friction law, fitted jointly with all else, and what its gain is
worth. A law starts from the fit's own values where the two have parameters of one name, and from its own `scan` for the rest.
Each start is judged by the residual that it leaves with everything projected out that retuning explains; the best ones of every
law are fitted jointly.

What the believed law lacks are the features (`Feature`) of the better law that it does not have. Each has an effect in the
vocabulary that completes a law by it, and is named only if no law without that feature does as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit, fit_jointly, settle
from tcs_friction.diagnose.fit.noise_estimate import misfit
from tcs_friction.diagnose.fit.parameters import Part
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.cross_validation import PLAIN_GROWTH, squares_as_fitted
from tcs_friction.diagnose.search.harmonics import added_effects
from tcs_friction.diagnose.search.hypotheses import eligible, redundant, starts
from tcs_friction.diagnose.search.plausibility import within_search
from tcs_friction.diagnose.search.projection import ProjectedResidual, survey
from tcs_friction.diagnose.search.significance import DISTINGUISHABLE, IMPERFECT_AT_MOST, chance, threshold
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.friction.lugre import NARROWEST
from tcs_friction.physics.registry import effects, laws
from tcs_friction.physics.terms import Feature, Instance, Parameter, Role, Survey, Term, instance

STARTS, GOING_ON = 2, 1  # of each law that are fitted jointly: at first, and to the end
EXTENDED_STARTS, EXTENDED_GOING_ON = 6, 3  # of a law that extends another: its cost has many minima
FIRST_STEPS, MORE_STEPS = 4, 12  # of joint fits: of every start, then of those that go on
SAME_SHAPE = 1.5  # factor between parameters of two starts, below which both would end in the same minimum
FAR_WORSE = 2.0  # times the squares of the best law after the first steps: further steps win no tenth of that
CONTRADICTED = 1.5  # times the residual in motion that a fit to motion alone leaves, where the law's memory is wrong at rest
LONGEST_BRISTLE = 0.1  # of the travel: what bends over more of it is a spring or gravity
STEADY = (Feature.DRY, Feature.VISCOUS)  # friction in steady sliding, which a fit with any law has told
LEAST_VISCOUS = 1e-3  # of the dry friction at the fastest speed: where a law's linear part starts at least


@dataclass(frozen=True, eq=False)
class LawCandidate:
    """An axis with another friction law after a joint fit.

    gain: drop of squares in units of the noise. threshold: gain that chance would give. plausible: whether the recording can show
    what the law adds, and that is like friction.
    """

    fit: Fit
    gain: float
    threshold: float
    plausible: bool

    @property
    def law(self) -> Term:
        """The friction law."""
        return self.fit.axis.friction.term

    @property
    def score(self) -> float:
        """Gain beyond chance; positive: worth taking."""
        return self.gain - self.threshold


@dataclass(frozen=True, eq=False)
class Lack:
    """What a believed law lacks of a better one: the effect that completes it, as the better law has it.

    without: the fit with the best law that lacks it, too. gain: drop of squares by it, in units of the noise.
    """

    effect: Instance
    without: Fit
    gain: float


def unloaded_laws() -> list[Term]:
    """The laws of which the load is no part: what grows with the load is an effect of its own."""
    return [term for term in laws().values() if "torque" not in term.reads]


def other_laws(axis: Axis, excluded: frozenset[str] = frozenset()) -> list[Term]:
    """The laws that can take the place of an axis' own: they have all of its features.

    A Stribeck drop may be missing, unless the law is the own one without it: where friction is high at reversals, a drop may
    stand in for bristles, or for a bristle of two elements.

    excluded: ids of effects that the data cannot carry; a law that differs by what such an effect stands for is none, also where
    it only has another form of that.
    """
    own = axis.friction.term
    known, hidden = {p.name for p in own.parameters}, {f for name in excluded for f in effects()[name].features}

    def can_take_its_place(term: Term) -> bool:
        without_drop = term.features | {Feature.STRIBECK} >= own.features and {p.name for p in term.parameters} - known
        return term is not own and (term.features >= own.features or bool(without_drop))

    better = filter(can_take_its_place, unloaded_laws())
    return [term for term in better if not any(p.feature in hidden for p in term.parameters if p.name not in known)]


def law_candidates(
    balance: TorqueBalance, fit: Fit, terms: Sequence[Term], believed: Axis, beside_own: bool = False
) -> list[LawCandidate]:
    """Each of these laws in the place of a fit's own, fitted jointly, best first; without those that are far worse.

    They start from the fit's own values and from the believed ones: while a law lacked something, its numbers, the width of its
    bristles among them, may have gone astray to stand in for that. beside_own: whether the fit's own law counts among those that
    others may be far worse than.
    """
    projected = ProjectedResidual(balance, fit)
    sources = [fit.axis, replace(fit.axis, friction=believed.friction)]
    views = [survey(balance, source) for source in sources]
    begun = list[Axis]()
    for term in terms:
        axes = [axis for source, view in zip(sources, views, strict=True) for axis in starting_axes(source, term, view)]
        axes = [_without_parts_of_the_law(axis, believed) for axis in axes]
        begun += _best_starts(projected, term, axes)
    first = side_by_side(lambda axis: fit_jointly(balance, axis, fit.noise, FIRST_STEPS), begun)
    least = min((one.squares.value for one in [*first, *[fit] * beside_own]), default=0.0)
    close = [one for one in _best_of_each_law(first) if one.squares.value <= FAR_WORSE * least]
    more = side_by_side(lambda one: fit_jointly(balance, one.axis, one.noise, MORE_STEPS), close)
    finished = {one.axis.friction.term.id: one for one in sorted(more, key=lambda one: -one.squares.value)}
    alternatives = float(max(len(begun), 1))
    judged = side_by_side(
        partial(_judged, balance, fit, views, projected.dispersion, alternatives), list(finished.values())
    )
    return sorted(judged, key=lambda candidate: -candidate.score)


def extension_promises(balance: TorqueBalance, fit: Fit, term: Term, tried: Sequence[LawCandidate]) -> bool:
    """Whether a law that extends another one may gain more than chance: to first order, beside the fit with that other law.

    fit: the base of the gain. tried: candidates of other laws. True where the other law is neither the fit's nor among these.
    """
    plain = next((x for x in (fit, *(one.fit for one in tried)) if x.axis.friction.term.id == term.extends), None)
    if plain is None:
        return True
    values = plain.axis.friction.values
    further = {p.name: p.default for p in term.parameters if p.name not in values and p.default is not None}
    axis = replace(plain.axis, friction=instance(term, {**values, **further}))
    free = [number for number in balance.free(axis) if number.part is Part.FRICTION and number.name in further]
    projected = ProjectedResidual(balance, plain)
    columns = projected.project(balance.jacobian(axis, free, plain.noise, projected.residual))
    promised = projected.gain(columns)[0] + float(fit.squares - plain.squares)
    return promised > chance(len(further)) * projected.dispersion


def contradicted_at_rest(moving: TorqueBalance, fit: Fit, moving_fit: Fit) -> bool:
    """Whether what a law with memory says of the axis at rest keeps it from explaining its motion.

    moving: balance in which nothing is compared where friction without memory is unknown. fit: to all data. moving_fit: to those
    of `moving`.
    """
    left = [moving.residual(x.axis, moving_fit.noise)[moving.train] for x in (fit, moving_fit)]
    return rms(left[0]) > CONTRADICTED * rms(left[1])


def law_without_memory(balance: TorqueBalance, retuned: Fit, believed: Axis) -> Fit | None:
    """The fit with a law without memory, None where the memory of the fit's own law earns its place in motion.

    Bristles too narrow to be seen in the recording earn nothing: what they gain is how steps of time meet a reversal.
    balance: of a data set in which nothing is compared where such friction is unknown.
    """
    terms = [term for term in unloaded_laws() if term.without_memory]
    fits = [candidate.fit for candidate in law_candidates(balance, retuned, terms, believed)]
    best = min(fits, key=lambda fit: fit.squares - retuned.squares)
    earned = (best.squares - retuned.squares) / retuned.squares.dispersion
    by_steps = IMPERFECT_AT_MOST * balance.samples.effective_count
    needed = threshold(balance, [retuned.axis.friction.term], 1) if shows_bristles(balance, retuned.axis) else by_steps
    return None if earned > needed else best


def shows_bristles(balance: TorqueBalance, axis: Axis) -> bool:
    """Whether the bristles of an axis are wide enough to be seen in the recording."""
    return axis.bristle >= NARROWEST * balance.data.position_noise


def simplest_law(balance: TorqueBalance, candidates: Sequence[LawCandidate]) -> LawCandidate | None:
    """The best law; of those that the data cannot tell from it the one with the fewest free numbers.

    None where none is better.
    """
    better = [candidate for candidate in candidates if candidate.score > 0.0]
    if not better:
        return None
    best = max(better, key=lambda candidate: candidate.score)
    same = DISTINGUISHABLE * misfit(balance, balance.residual(best.fit.axis, best.fit.noise))
    close = [candidate for candidate in better if candidate.score > best.score - same]
    return min(close, key=lambda candidate: (len(candidate.fit.free), -candidate.score))


def starting_axes(axis: Axis, term: Term, view: Survey) -> list[Axis]:
    """The axis with another law, at every distinct start; none where the law does not say where to start.

    What the two laws call alike keeps its value, and so do dry and viscous friction.
    """
    found: dict[tuple[float, ...], Axis] = {}
    for scanned in term.scan(view):
        values = {p.name: _starting_value(p, term, axis.friction, scanned, view) for p in term.parameters}
        given = {name: value for name, value in values.items() if value is not None}
        if len(given) == len(values):
            found.setdefault(tuple(given.values()), replace(axis, friction=instance(term, given)))
    return list(found.values())


def _without_parts_of_the_law(axis: Axis, believed: Axis) -> Axis:
    """The axis without effects beyond the believed ones that complete a law by what its own law has."""
    parts = [item for item in added_effects(axis, believed) if redundant(item.term, axis.without_effect(item))]
    return reduce(Axis.without_effect, parts, axis)


def _starting_value(
    parameter: Parameter, term: Term, law: Instance, scanned: Mapping[str, float], view: Survey
) -> float | None:
    """Where a parameter of another law, `term`, starts; None where nothing says.

    The curve of a law that extends another starts anew: where the other one's form is wrong its values lead astray.
    """
    anew = bool(term.extends) and parameter.feature is Feature.STRIBECK
    known = 0.0 if anew else law.values.get(parameter.name, 0.0)
    if parameter.feature is Feature.VISCOUS:
        return max(_alike(law, Feature.VISCOUS), LEAST_VISCOUS * view.level / max(view.fast, 1e-300))
    if known > 0.0 or (parameter.name in law.values and parameter.role is Role.FIXED):
        return known
    if parameter.feature is Feature.DRY:
        return _alike(law, Feature.DRY)
    return scanned.get(parameter.name, parameter.default)


def _alike(law: Instance, feature: Feature) -> float:
    """The first value of a law with this feature, 0 without one."""
    return next((law.values[p.name] for p in law.term.parameters if p.feature is feature), 0.0)


def _best_of_each_law(fits: Sequence[Fit]) -> list[Fit]:
    """The fits that go on after the first steps."""
    by_law: dict[str, list[Fit]] = {}
    for fit in sorted(fits, key=lambda fit: fit.squares.value):
        by_law.setdefault(fit.axis.friction.term.id, []).append(fit)
    count = {name: EXTENDED_GOING_ON if laws()[name].extends else GOING_ON for name in by_law}
    return [fit for name, some in by_law.items() for fit in some[: count[name]]]


def _best_starts(projected: ProjectedResidual, term: Term, axes: Sequence[Axis]) -> list[Axis]:
    """The axes with this law that leave least of the residual once everything is projected out that retuning explains.

    Their shapes differ: a fit from nearly the same place would end in the same minimum.
    """
    squares = side_by_side(projected.left, axes)
    best: list[Axis] = []
    for k in np.argsort(squares):
        if not any(_alike_in_shape(axes[k].friction, other.friction) for other in best):
            best.append(axes[k])
    return best[: EXTENDED_STARTS if term.extends else STARTS]


def _shape(term: Term) -> list[str]:
    """The free parameters of a law but dry and viscous friction."""
    return [p.name for p in term.parameters if p.role is not Role.FIXED and p.feature not in STEADY]


def _alike_in_shape(one: Instance, other: Instance) -> bool:
    """Whether no parameter of the shape of two instances of a law differs by a factor."""
    pairs = [(one.values[name], other.values[name]) for name in _shape(one.term)]
    return all(max(a, b) < SAME_SHAPE * min(a, b) or a == b for a, b in pairs)


def _judged(
    balance: TorqueBalance, base: Fit, views: Sequence[Survey], dispersion: float, alternatives: float, fit: Fit
) -> LawCandidate:
    """What a fit with another law is worth beside the base, confirmed in more than one piece of the data.

    A law whose new parts the recording cannot show, or that are like no friction, is worth nothing. views: of the axes that laws
    start from, whose bristles say how far those of others may bend.
    """
    extra = max(len(fit.free) - len(base.free), 1)
    before, after = squares_as_fitted(balance, base), squares_as_fitted(balance, fit)
    gains = (before.white - after.white) / dispersion
    gain = float(base.squares - fit.squares) / dispersion
    needed = threshold(balance, [fit.axis.friction.term], extra, alternatives)
    grown = after.plain.sum() > PLAIN_GROWTH * before.plain.sum()
    plausible = not all(_implausible(base.axis.friction, fit.axis.friction, view) for view in views)
    if (
        grown
        or not plausible
        or float(gains.sum() - gains.max()) < chance(extra, alternatives)
    ):
        gain = min(gain, 0.0)
    return LawCandidate(fit, gain, needed, plausible)


def _implausible(own: Instance, law: Instance, view: Survey) -> bool:
    """Whether the recording cannot show what another law has that an axis' own lacks, or that is like no friction."""
    view = replace(view, level=law.values[law.term.level.name])
    if law.term.bristle(law.values) > LONGEST_BRISTLE * view.span:
        return True
    new = [p.name for p in law.term.parameters if not own.values.get(p.name, 0.0) > 0.0]
    if not within_search(law, view, new):
        return True
    parts = [completing(effect, law) for effect in missing_features(law.term, own.term)]
    return any(part.term.implausible(part.values, view) for part in parts if _does_something(part))


def _does_something(part: Instance) -> bool:
    """Whether an effect that completes a law has a torque: of a law with static below Coulomb friction no drop is lacking."""
    sizes = [part.values[p.name] for p in part.term.parameters if p.role is Role.LINEAR]
    return any(sizes) or not sizes


def lacks(balance: TorqueBalance, fit: Fit, believed: Axis) -> tuple[Fit, tuple[Lack, ...]]:
    """What a believed law lacks of the law of a fit, and the fit; with a simpler law, and an effect, where these do as well.

    What another law that is no simpler does without has no gain of its own: these data cannot tell the two.
    """
    better, found = fit.axis.friction.term, list[Lack]()

    def loss(without: Fit) -> float:
        return float(without.squares - fit.squares) / fit.squares.dispersion

    for effect, features in missing_features(better, believed.friction.term).items():
        others = [law for law in unloaded_laws() if not law.features & features]
        candidates = law_candidates(balance, fit, others, believed)
        fits = [one.fit for one in sorted(candidates, key=lambda one: (not one.plausible, loss(one.fit)))]
        fewer = [one for one in fits if one.axis.friction.term.features < better.features]
        beside = (more for one in fewer for more in _with_effects_alike(balance, one, effect))
        for simpler in itertools.chain(fewer, beside):
            needed = threshold(balance, [better], max(len(fit.free) - len(simpler.free), 1))
            if loss(simpler) < needed:
                return lacks(balance, settle(balance, simpler.axis, simpler.noise, rounds=1), believed)
        part = completing(effect, fit.axis.friction)
        if _does_something(part):
            found.append(Lack(part, fits[0], loss(fits[0])))
    return fit, tuple(found)


def _with_effects_alike(balance: TorqueBalance, fit: Fit, effect: Term) -> list[Fit]:
    """A fit with one more effect without memory over the coordinate of another: with drag, say, instead of a Stribeck drop."""
    projected = ProjectedResidual(balance, fit)
    alike = [term for term, _ in eligible(fit.axis, balance) if term.coordinate == effect.coordinate]
    begun = [start for term in alike if not (term.features or term.states) for start in starts(projected, term, None)[:1]]
    return [fit_jointly(balance, fit.axis.with_effect(one.instance), fit.noise, MORE_STEPS) for one in begun]


def missing_features(better: Term, believed: Term) -> dict[Term, frozenset[Feature]]:
    """The effects that complete a believed law by what a better one has, and the features that each of them stands for."""
    missing = better.features - believed.features
    shared = {term: term.features & missing for term in effects().values()}
    return {term: features for term, features in shared.items() if features}


def completing(term: Term, law: Instance) -> Instance:
    """The effect that has of a law what it completes; what the law does not say is as small as it can be."""
    known = dict(term.of_law(law.values_of_law))
    rest = {p.name: max(p.lower, 0.0) for p in term.parameters if p.default is None and p.name not in known}
    return instance(term, known | rest)
