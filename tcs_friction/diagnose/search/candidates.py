"""Candidates: effects fitted jointly with all else, and what their gain is worth.

A gain is the drop of the whitened train squares after a joint refit of all free numbers, less what chance would give:
chi-squared with as many numbers, Bonferroni's correction for the alternatives that were searched through and for the
length of the vocabulary. Effects made from logged torque, acceleration or a memory of them feed on the residual's own noise
and on what sampling leaves behind: they have to explain a share of the noise power as well, and to show where that noise is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import ndimage, stats

from tcs_friction.diagnose.fit.balance import Balance, Fit, rms
from tcs_friction.diagnose.fit.joint_fit import joined
from tcs_friction.diagnose.fit.second_body import motion_gain
from tcs_friction.diagnose.fit.torque import SLOW_PERIODS
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.hypotheses import (
    Start,
    follows_load,
    gain_by_motion,
)
from tcs_friction.diagnose.search.matched_filter import same_wave
from tcs_friction.diagnose.search.projection import Background, survey
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Place, Role, Term

ODDS = 100.0  # to one, by which an effect must beat a rival
SAME = 2.0 * math.log(ODDS)  # gain, in units of the misfit, that this takes
FALSE_ALARM = 0.01  # chance that any of the vocabulary is named where nothing is missing
MATERIAL = 0.006  # of the noise power, for effects that feed on noise
BEYOND = 1.5e-3  # of the noise power beyond chance, that collisions must explain and no blurred signal does
CALM = 2.0  # times the noise power: amplification below which a mode must improve the torque balance
DRIVEN, ANSWER = 100.0, 4.0  # times the noise power: of what is driven at least, of what answers it at most
LEAST = 0.5  # of what an effect has to gain, that its torque must have: it cannot gain more by itself
NEIGHBOURS = 129  # frequencies, over which the power near one of them is averaged
LARGEST = 1.2  # of the logged torque's rms: a larger effect cancels against another one and is no physics
MOSTLY = 0.5  # of the noise power, from which that is the encoder's
STEPS, WINNING = 3, 0.5  # of a joint fit half way; of the best gain there, or of the fitted one where confirmed, to count
REACH = 3.0  # times the proposed values, within which an effect can be told from others


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


def feeds_on_noise(term: Term) -> bool:
    """Whether noise of the residual is in what an effect is made from: logged torque, acceleration, or a memory of motion."""
    torque = "torque" in term.reads and not term.periodic
    memory = term.states != 0 and not term.signals
    return torque or memory or term.place is Place.BODY


def rings(term: Term) -> bool:
    """Whether an effect is a body that swings or collides: what it explains is fast, as the noise is."""
    return term.place is Place.BODY and term.states != 0


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
        return fit if fit.converged or fit.squares > needed else joined(balance, fit.axis, STEPS, tolerance=0.5)

    fits = side_by_side(finished, fits)
    return side_by_side(lambda pair: _candidate(balance, axis, *pair, base, spread), zip(starts, fits, strict=True))


def _joined(balance: Balance, axis: Axis, start: Start) -> Fit:
    """The first steps of the joint fit of an axis with what a start adds."""
    for item in start.instances:
        axis = _widened(balance, axis, item)
    return joined(balance, axis, STEPS, tolerance=0.5)


def _candidate(balance: Balance, axis: Axis, start: Start, fit: Fit, base: Fit, spread: float) -> Candidate:
    """What a fit from a start is worth beside the base."""
    terms = [item.term for item in start.instances]
    limit = threshold(balance, terms, start.count, start.looks)
    gain = gained(balance, base, fit, start.instances) / spread / start.excess
    if any(implausible(balance, axis, fit, len(axis.effects) + k) for k in range(len(terms))):
        gain = 0.0
    elif any(map(feeds_on_noise, terms)):
        shown = _shown(balance, fit.axis.effects[len(axis.effects) :], start, fit, base)
        gain = min([gain, *(some / spread for some, needed in shown if some / spread < needed)])
    return Candidate(start.name, gain, limit, fit, replace(start, columns=np.empty((0, 0))))


def _shown(
    balance: Balance, items: Sequence[Instance], start: Start, fit: Fit, base: Fit
) -> Iterator[tuple[float, float]]:
    """Squares that effects which feed on noise gain where that noise is not, and how many units of it they need there.

    Noise of the encoder is in the residual through the acceleration and in the torque through the controller, so such effects
    gain by it at high frequency. What they gain must show in the slow part as well; of collisions, beyond what blurred signals
    explain; of a mode, in the torque too; of friction that follows the load, with the load taken from the motion.
    """
    needed = chance(start.count, start.looks)
    terms = [item.term for item in items]
    both = [balance.whiten(balance.residual(x.axis)) for x in (base, fit)]
    if any(feeds_on_noise(term) and not rings(term) for term in terms):
        before, after = (slow_part(balance, white) for white in both)
        yield float(before @ before - after @ after), needed
    if any(term.collides for term in terms):
        blurred = blurs(balance, base.axis)
        before, after = (white - blurred @ (blurred.T @ white) for white in both)
        change = before - after  # its best multiple counts: the fit could not know the blurs
        beyond = max(float(change @ before), 0.0) ** 2 / max(float(change @ change), 1e-300)
        yield beyond, needed + BEYOND * balance.effective_count
    if any(term.swings for term in terms):
        yield _calm_gain(balance, base, fit), needed
    for item in items:
        if follows_load(item.term):
            others = fit.axis.without_effect(item)
            by_motion = gain_by_motion(Background(balance, others, balance.free(others)), item)
            yield by_motion, threshold(balance, [item.term], 1, 1.0)
            yield _driven_gain(balance, base, fit, balance.parts.rotor(base.axis)[0]), needed


def gained(balance: Balance, base: Fit, fit: Fit, items: Sequence[Instance]) -> float:
    """Drop of the whitened squares from a fit to one with these effects, where what they do can be told from noise.

    The controller answers the encoder's noise, so where most noise is the encoder's, a filter of the torque seems to explain it.
    """
    if not any(item.term.filters for item in items):
        return base.squares - fit.squares
    before, after = (balance.spectrum(balance.residual(x.axis)) for x in (base, fit))
    return float(np.sum((before - after)[balance.noise_share(balance.frequencies) < MOSTLY]))


def _calm_gain(balance: Balance, base: Fit, fit: Fit) -> float:
    """Drop of the whitened squares of the torque residual where the fit's bodies hardly amplify noise of the motion.

    A logged torque that carries noise of its own is small divided by an antiresonance, whether the axis has one or not.
    """
    def calm(frequency: np.ndarray) -> np.ndarray:
        few = balance.noise_share(frequency) < MOSTLY
        return few & (np.abs(motion_gain(fit.axis, frequency)) ** 2 < CALM)

    before, after = (balance.spectrum(balance.torque_residual(x.axis)) for x in (base, fit))
    noise = balance.attenuation
    feigned = noise.in_torque(base.axis) - noise.in_torque(fit.axis)
    return float(np.sum((before - after)[calm(balance.frequencies)]) + np.sum(feigned[calm(noise.frequency)]))


def _driven_gain(balance: Balance, base: Fit, fit: Fit, source: np.ndarray) -> float:
    """Drop of the whitened squares where a source (n,), the torque at the rotor, is driven and no answer to noise.

    A torque that is not logged moves the axis, and the controller answers it: noise of the residual is in both, in a loop that
    is damped well with up to ANSWER times its power, and a multiple of them takes that share of it away. That is no gain, nor is
    a smaller residual of an axis that is smaller in all: noise is compared as the acceleration that it makes.
    """
    times = ndimage.uniform_filter1d(balance.spectrum(source), NEIGHBOURS) / balance.white_level
    driven = times > DRIVEN
    before, after = (balance.spectrum(balance.torque_residual(x.axis)) for x in (base, fit))
    after = after * (base.axis.inertia / fit.axis.inertia) ** 2
    return float(np.sum((before - after)[driven]) - ANSWER * balance.white_level * np.sum(1.0 / times[driven]))


def _widened(balance: Balance, axis: Axis, item: Instance) -> Axis:
    """The axis with one more effect; a filter of the torque starts from the believed alignment, a delay takes over the rest."""
    if not item.term.filters:
        return axis.with_effect(item)
    aligned = replace(axis, actuation_delay=balance.believed_delay)
    if item.term.id == "transport_delay":
        late = item.values["delay"] + axis.actuation_delay - balance.believed_delay
        item = item.replace(delay=max(late, 0.0))
    return aligned.with_effect(item)


def implausible(balance: Balance, axis: Axis, fit: Fit, index: int) -> bool:
    """Whether a fitted effect cannot be or be seen, is there twice, or ended where it proposes nothing for such a recording."""
    item = fit.axis.effects[index]
    if item.term.id == "transport_delay" and item.values["delay"] < balance.leeway:
        return True  # alignment
    if any(same_wave(balance, fit.axis, item, other) for other in fit.axis.effects if other is not item):
        return True
    return impossible(balance, fit, index) or _unresolved(balance, fit, index) or _out_of_reach(balance, axis, item)


def impossible(balance: Balance, fit: Fit, index: int) -> bool:
    """Whether an effect is larger than any torque or hardly one, or its own declaration warns of its values."""
    item = fit.axis.effects[index]
    if item.term.warn(item.values):
        return True
    own = _own_torque(balance, fit, index)
    white = balance.whiten(own)
    return float(white @ white) < LEAST * chance(1, 1.0) or rms(own[balance.train]) > LARGEST * balance.torque_size


def _unresolved(balance: Balance, fit: Fit, index: int) -> bool:
    """Whether the steps of a coarse encoder pretend a wave: what it moves the axis by is within half a step.

    At steady speed the error of the steps repeats with time and position, and sampling makes it slow.
    """
    item, step = fit.axis.effects[index], balance.data.position_step
    if not item.term.periodic or step == 0.0:
        return False
    if item.term.place is Place.SENSOR:
        return max(abs(item.values[p.name]) for p in item.term.parameters if p.role is Role.LINEAR) < 0.5 * step
    phase_rate = 2.0 * math.pi
    if item.term.periodic == "position":
        phase_rate = fit.axis.cycle * float(np.median(np.abs(balance.data.joined("velocity")[balance.train])))
    rate = phase_rate * item.values[item.term.parameters[0].name]
    size = math.sqrt(2.0) * rms(_own_torque(balance, fit, index)[balance.train])
    return size < 0.5 * step * fit.axis.inertia * rate**2


def _own_torque(balance: Balance, fit: Fit, index: int) -> np.ndarray:
    """Torque (n,) that a fitted effect adds, N m."""
    fewer = fit.axis.without_effect(fit.axis.effects[index])
    return balance.torque_residual(fewer) - balance.torque_residual(fit.axis)


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
