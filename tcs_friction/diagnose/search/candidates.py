"""Candidates: effects after a joint fit with all else that the axis has, and what their gain is worth.

In: the fit of an axis and starts of effects. Out: candidates, each with its joint fit, its gain and the gain that chance
would give. Noise of the encoder is in the residual through the acceleration and in the torque through the controller. Effects
made from logged torque, acceleration or a memory of them gain by that noise; what they gain has to show where it is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import ndimage

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, fit_jointly, taken_out
from tcs_friction.diagnose.fit.second_body import motion_gain
from tcs_friction.diagnose.fit.torque import SLOW_PERIODS
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.diagnose.search.plausibility import Doubt, doubt
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.significance import chance, feeds_on_noise, threshold
from tcs_friction.diagnose.search.start import Kind, Start, follows_load, gain_by_load_from_motion, kind_of
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place, Term

FIRST_STEPS, FIRST_TOLERANCE = 3, 0.5  # of a joint fit, after which candidates that cannot win are given up
STILL_WINNING = 0.5  # of the best gain after the first steps, that a candidate needs to be fitted further
BLURRED_SHARE = 1.5e-3  # of the noise power beyond chance, that collisions must explain and no blurred signal does
FEW_AMPLIFIED = 2.0  # times the noise power: amplification of a mode below which its torque must explain what it gains
MOSTLY_ENCODER = 0.5  # of the noise power
DRIVEN = 100.0  # times the noise power, from which a torque is driven by the reference and not by noise
ANSWERED = 4.0  # times the noise power, that a well damped loop makes of noise at most: a sensitivity of two
SPECTRUM_NEIGHBOURS = 129  # frequencies, over which the power near one of them is averaged: it scatters by a tenth


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect, or two, after a joint fit.

    gain: drop of squares in units of the noise. threshold: gain that chance and noise would give. items: its effects in the fit.
    doubt: why one of its effects cannot be what it says; its gain counts as none then, and `doubted` is what it was.
    """

    gain: float
    threshold: float
    fit: Fit
    start: Start
    doubt: Doubt | None = None
    doubted: float = 0.0

    @property
    def items(self) -> tuple[Instance, ...]:
        """The effects as fitted."""
        own = {item.identity for item in self.start.instances}
        return tuple(item for item in self.fit.axis.effects if item.identity in own)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of its effects."""
        return tuple(map(kind_of, self.items))

    @property
    def score(self) -> float:
        """Gain beyond chance; positive: worth adding."""
        return self.gain - self.threshold


def is_fast_body(term: Term) -> bool:
    """Whether an effect is a body that resonates or collides: what it explains is fast, as the noise is."""
    return term.place is Place.BODY and term.states != 0


def fitted_candidates(
    balance: TorqueBalance, base: Fit, starts: Sequence[Start], dispersion: float
) -> list[Candidate]:
    """The candidates after joint fits from their starts; only those that may still win after the first steps go on."""
    fits = side_by_side(partial(_first_steps, balance, base), starts)
    best = max((base.squares - fit.squares for fit in fits), default=0.0)

    def finished(fit: Fit) -> Fit:
        hopeless = base.squares - fit.squares < STILL_WINNING * best
        if fit.outcome is not Outcome.BUDGET_SPENT or hopeless:
            return fit
        return fit_jointly(balance, fit.axis, base.noise, FIRST_STEPS, FIRST_TOLERANCE)

    fits = side_by_side(finished, fits)
    pairs = list(zip(starts, fits, strict=True))
    return side_by_side(lambda pair: _candidate(balance, base, *pair, dispersion), pairs)


def _first_steps(balance: TorqueBalance, base: Fit, start: Start) -> Fit:
    """The first steps of the joint fit of an axis with what a start adds."""
    axis = base.axis
    for item in start.instances:
        axis = _with_effect(axis, item)
    return fit_jointly(balance, axis, base.noise, FIRST_STEPS, FIRST_TOLERANCE)


def _with_effect(axis: Axis, item: Instance) -> Axis:
    """The axis with one more effect; a filter of the torque starts from the log's alignment, a delay takes over the rest."""
    if not item.term.filters:
        return axis.with_effect(item)
    aligned = replace(axis, lateness=0.0)
    if item.term.alignment:
        late = item.values[item.term.alignment] + axis.lateness
        item = item.replace(**{item.term.alignment: max(late, 0.0)})
    return aligned.with_effect(item)


def _candidate(
    balance: TorqueBalance, base: Fit, start: Start, fit: Fit, dispersion: float
) -> Candidate:
    """What a fit from a start is worth beside the base."""
    candidate = Candidate(0.0, 0.0, fit, replace(start, columns=np.empty((0, 0))))
    items = candidate.items
    terms = [item.term for item in items]
    limit = threshold(balance, terms, start.count, start.alternatives)
    gained = (base.squares - fit.squares) / dispersion
    doubts = (doubt(balance, fit, item, base.axis, decides=gained > limit) for item in items)
    why_not = next(filter(None, doubts), None)
    if why_not is not None:
        return replace(candidate, threshold=limit, doubt=why_not, doubted=gained)
    loads = {item.identity: gains_of_load(balance, fit, item) for item in items if follows_load(item.term)}
    from_noise = sum(by_noise for _, by_noise in loads.values())
    gain = (squares_gained(balance, base, fit, items) - from_noise) / dispersion / start.noise_excess
    if any(map(feeds_on_noise, terms)):
        shown = _gains_apart_from_noise(balance, items, start, fit, base, loads)
        gain = min([gain, *(some / dispersion for some, needed in shown if some / dispersion < needed)])
    return replace(candidate, gain=gain, threshold=limit)


def squares_gained(balance: TorqueBalance, base: Fit, fit: Fit, items: Sequence[Instance]) -> float:
    """Drop of the whitened squares from a fit to one with these effects, where what they do can be told from noise.

    The controller answers the encoder's noise, so where most noise is the encoder's, a filter of the torque seems to explain it.
    """
    if not any(item.term.filters for item in items):
        return base.squares - fit.squares
    noise = base.noise
    before, after = (noise.spectrum(balance.residual(x.axis, noise)) for x in (base, fit))
    shows = noise.encoder_share_at(noise.samples.frequencies) < MOSTLY_ENCODER
    return float(np.sum((before - after)[shows]))


def gains_of_load(balance: TorqueBalance, fit: Fit, item: Instance) -> tuple[float, float]:
    """Squares that friction following the load gains with the load taken from the motion, and what it gains beside them.

    That is noise of the logged torque, of which it takes a share away.
    """
    others = ProjectedResidual(balance, taken_out(balance, fit, item))
    white = fit.noise.whiten(balance.residual(fit.axis, fit.noise))
    by_motion = gain_by_load_from_motion(others, item)
    return by_motion, max(others.squares - float(white @ white) - by_motion, 0.0)


def _gains_apart_from_noise(
    balance: TorqueBalance,
    items: Sequence[Instance],
    start: Start,
    fit: Fit,
    base: Fit,
    loads: Mapping[int, tuple[float, float]],
) -> Iterator[tuple[float, float]]:
    """Squares that effects which feed on noise gain where that noise is not, and how many units of it they need there.

    What they gain must show in the slow part of the residual; of collisions, beyond what blurred signals explain; of a mode,
    in the torque too; of friction that follows the load, with the load taken from the motion; of that and of filters of the
    drive, where the torque is driven. loads: by identity, what `gains_of_load` says of those that follow the load.
    """
    needed = chance(start.count, start.alternatives)
    terms = [item.term for item in items]
    before, after = (base.noise.whiten(balance.residual(x.axis, base.noise)) for x in (base, fit))
    if any(feeds_on_noise(term) and not is_fast_body(term) for term in terms):
        slow = [_slow_part(balance, white) for white in (before, after)]
        yield float(slow[0] @ slow[0] - slow[1] @ slow[1]), needed
    if any(term.collides for term in terms):
        yield _gain_beyond_blur(balance, base, before, after), needed + BLURRED_SHARE * balance.samples.effective_count
    if any(term.resonates for term in terms):
        yield _gain_of_torque(balance, base, fit), needed
    for item in items:
        if item.identity in loads:
            yield loads[item.identity][0], threshold(balance, [item.term], 1)
        if item.identity in loads or item.term.filters:
            yield _gain_where_driven(balance, base, fit, item), needed


def _slow_part(balance: TorqueBalance, white: np.ndarray) -> np.ndarray:
    """Running mean of whitened rows over SLOW_PERIODS of the cutoff."""
    window = max(2, round(SLOW_PERIODS / (balance.data.cutoff * balance.data.dt)))
    return np.asarray(ndimage.uniform_filter1d(white, window))


def _gain_beyond_blur(
    balance: TorqueBalance, base: Fit, before: np.ndarray, after: np.ndarray
) -> float:
    """Drop of whitened squares beyond what blurred signals explain; the best multiple of the change counts.

    The fit could not know the blur.
    """
    blurred = blurred_signals(balance, base)
    before, after = (white - blurred @ (blurred.T @ white) for white in (before, after))
    change = before - after
    return max(float(change @ before), 0.0) ** 2 / max(float(change @ change), 1e-300)


def blurred_signals(balance: TorqueBalance, base: Fit) -> np.ndarray:
    """What slow sampling, interpolation and smoothing do to signals: orthonormal whitened rows (m, 4).

    Friction's first and second derivative by time, the second ones of acceleration and torque. A gap is more than a filter.
    """
    axis, slope = base.axis, balance.time_derivative
    friction = balance.terms.friction(axis)
    columns = [slope(friction), slope(slope(friction))]
    columns += [slope(slope(x)) for x in (balance.terms.acceleration(axis), balance.terms.rotor(axis)[0])]
    white = base.noise.whiten(np.stack(columns, axis=1))
    return np.asarray(np.linalg.qr(white / np.maximum(np.linalg.norm(white, axis=0), 1e-300))[0])


def _gain_of_torque(balance: TorqueBalance, base: Fit, fit: Fit) -> float:
    """Drop of the whitened squares of the torque residual where the fit's bodies hardly amplify noise of the motion.

    A logged torque that carries noise of its own is small divided by an antiresonance, whether the axis has one or not.
    """
    noise = base.noise

    def shows(frequency: np.ndarray) -> np.ndarray:
        of_drive = noise.encoder_share_at(frequency) < MOSTLY_ENCODER
        return of_drive & (np.abs(motion_gain(fit.axis, frequency)) ** 2 < FEW_AMPLIFIED)

    before, after = (noise.spectrum(balance.torque_residual(x.axis)) for x in (base, fit))
    biased = noise.bias.squares_of_torque(base.axis) - noise.bias.squares_of_torque(fit.axis)
    gained = float(np.sum((before - after)[shows(noise.samples.frequencies)]))
    return gained + float(np.sum(biased[shows(noise.bias.frequency)]))


def _gain_where_driven(balance: TorqueBalance, base: Fit, fit: Fit, item: Instance) -> float:
    """Drop of the whitened squares where the torque at the rotor is driven and no answer to noise.

    A torque that is not logged moves the axis, and the controller answers it: noise of the residual is in both, with up to
    ANSWERED times its power, and a multiple of them takes that share of it away. That is no gain, nor is a smaller residual
    of an axis that is smaller in all: noise is compared as the acceleration that it makes. Nor is the noise of the logged torque
    that a lag takes away.
    """
    noise = base.noise
    white_level = noise.samples.white_level
    power = ndimage.uniform_filter1d(noise.spectrum(balance.terms.rotor(base.axis)[0]), SPECTRUM_NEIGHBOURS)
    times = power / white_level
    driven = times > DRIVEN
    before, after = (noise.spectrum(balance.torque_residual(x.axis)) for x in (base, fit))
    after = after * (base.axis.inertia / fit.axis.inertia) ** 2
    by_noise = ANSWERED / times
    if item.term.transfer is not None:
        response = 1.0 + item.term.transfer(item.values, 2j * math.pi * noise.samples.frequencies)
        by_noise += np.maximum(1.0 - np.abs(response) ** 2, 0.0)
    return float(np.sum((before - after - white_level * by_noise)[driven]))
