"""The last end of a fit, started from a fit of torques: law, inertia and offset with which predictions are best."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from tcs_friction.conditioning.hold import Between
from tcs_friction.identify.determined import LARGEST_RELATIVE
from tcs_friction.identify.fine import Fine
from tcs_friction.identify.models import LuGreModel
from tcs_friction.identify.prediction import (
    DRIFT,
    INERTIA,
    LATENESS,
    MISSED,
    NUISANCES,
    RATE,
    SIZE,
    ForcedPredictor,
    LuGrePredictor,
    Predictor,
)
from tcs_friction.identify.refine import Refined, Space, refine
from tcs_friction.identify.result import Noise
from tcs_friction.identify.uncertainty import curvature_inverse

MOSTLY = 0.5  # of the samples, at least, must be resolved
ROUNDS = 6  # of fits at most, each with the weights of the one before: 3 and 4 were needed in worlds 3 and 0 of `scale_worlds`
COARSE = 0.5  # rad that bristles swing in a step, until a fit is near its end: that errs by 0.4 % of their stiffness
LEAST_SEEN = 0.01  # of a curvature: with less, a standard error that is ten times as large says that nothing is known
LEAST_GAIN = 0.1  # of the cost, whose unit is about half a sample: a step that gains less ends a round
SETTLED = 0.1  # standard deviations: a round that moves nothing farther is the last
LEVEL = (0.95, 1.05)  # rms of errors over what the filter expects: within 5 % of an interval, noises are not scaled again
SOUND = (0.5, 2.0)  # rms of errors of prediction over what the filter expects
WHITE = 3.5  # standard deviations of the correlation of neighbouring errors, if there is none
START_RATE = 30.0  # 1/s, of the disturbance
DRIFTING, SHOWN = 0.1, 0.3  # times the disturbance's size, share of the torque's changes, to start with


@dataclass(frozen=True, eq=False)
class Sharpened:
    """A fit of predictions.

    unknowns (k + 7,): law, inertia, offset, lateness s, and the nuisances of `prediction`.
    fit: of the errors of prediction. hopeless: it contradicted the torques on its way, and went no further.
    """

    unknowns: np.ndarray
    space: Space
    fit: Refined
    evaluations: int
    aim: Predictor
    hopeless: bool = False

    @cached_property
    def scores(self) -> np.ndarray:
        """(n,) of each sample, minus the logarithm of its likelihood; NaN of those left out."""
        return self.aim.scores(self.unknowns)

    @cached_property
    def seen(self) -> float:
        """Share of the squares' curvature by the lateness, as derivatives have it, that the squares themselves have.

        It is half a unit of cost at one standard error by derivatives, beside what it is there.
        """
        index, late = np.flatnonzero(self.space.free), len(self.unknowns) + LATENESS
        if late not in index:
            return 1.0
        inverse = curvature_inverse(self.fit.jacobian[:, index], self.fit.weights)
        way, at = np.zeros(len(self.unknowns)), int(np.searchsorted(index, late))
        way[index] = inverse[:, at] / math.sqrt(inverse[at, at])
        ends = [np.clip(self.unknowns + side * way, self.space.lower, self.space.upper) for side in (1.0, -1.0)]
        costs = [0.5 * float(self.fit.weights @ (self.aim.target - self.aim.evaluated(end)) ** 2) for end in ends]
        return float(np.clip(sum(costs) - 2.0 * self.fit.cost, LEAST_SEEN, 1.0))

    def likelier_than(self, other: Sharpened) -> bool:
        """Whether it went as far and predicts at least as well; of the same samples, or on average of different ones."""
        if self.hopeless != other.hopeless:
            return other.hopeless
        if len(self.scores) == len(other.scores):
            return likelier(self.scores, other.scores)
        return bool(np.nanmean(self.scores) <= np.nanmean(other.scores))

    @property
    def noise(self) -> Noise:
        """Of drive and encoder: the disturbance and its drift as torques, and what blurs each position."""
        inertia, rate, size, drift = (float(self.unknowns[k]) for k in (INERTIA, RATE, SIZE, DRIFT))
        return Noise(inertia * math.hypot(size, drift), rate / (2.0 * math.pi), self.aim.encoder)

    def disturbance(self, bandwidth: float) -> float:
        """N m rms up to a frequency, Hz, of what these predictions need beside the logged torque."""
        inertia, rate, size, drift = (float(self.unknowns[k]) for k in (INERTIA, RATE, SIZE, DRIFT))
        below = 2.0 / math.pi * math.atan(2.0 * math.pi * bandwidth / rate)  # of first-order noise
        return inertia * math.hypot(size * math.sqrt(below), drift)

    def tells(self, k: int) -> bool:
        """Whether a positive unknown is known to better than half of itself, and no bound stops it."""
        index, value = np.flatnonzero(self.space.free), float(self.unknowns[k])
        inverse = curvature_inverse(self.fit.jacobian[:, index], self.fit.weights)
        std = math.sqrt(max(float(np.diag(inverse)[np.searchsorted(index, k)]), 0.0))
        inside = self.space.lower[k] * 1.001 < value < self.space.upper[k] / 1.001
        return bool(std < LARGEST_RELATIVE * abs(value) and inside)

    def covariance_as_seen(self, covariance: np.ndarray) -> np.ndarray:
        """A covariance (q, q) by derivatives with the lateness as unsure as the squares say, and what goes with it.

        Noise of a torque's log makes its derivative by the lateness large, but tells no time: the squares hardly change with it.
        """
        k = len(self.unknowns) + LATENESS
        if not covariance[k, k] > 0.0:
            return covariance
        return covariance + (1.0 / self.seen - 1.0) * np.outer(covariance[k], covariance[k]) / covariance[k, k]

    @property
    def sound(self) -> bool:
        """Whether the errors of prediction are as large as the filter expects, and white: else it lacks something."""
        errors = self.fit.residual[self.fit.weights > 0.0]
        power = float(np.mean(errors**2))
        if not SOUND[0] ** 2 < power < SOUND[1] ** 2:
            return False
        return bool(abs(float(np.mean(errors[1:] * errors[:-1]))) < WHITE * power / np.sqrt(len(errors)))


class Torques(Protocol):
    """The fit of torques that predictions start from and must not contradict; left: what it leaves, N m rms."""

    @property
    def left(self) -> float: ...

    def ruled_out(self, sharp: Sharpened) -> bool:
        """Whether predictions in time, with the law of the torques, leave more of the torque."""

    def hopeless(self, sharp: Sharpened) -> bool:
        """Whether predictions that are under way leave more of the torque: the law is another."""


def sharpen(
    fine: Fine, unknowns: np.ndarray, space: Space, torques: Torques, loss: str, cancel: Callable[[], bool]
) -> Sharpened | None:  # fmt: skip
    """Fit predictions, starting from a fit of torques; None where the recording is too coarse for them.

    The law is that of the torques at first: a wrong timing would drive it off, into other minima where it has kinks. Predictions
    that the torques rule out on their way go no further.

    unknowns, space: law, inertia, offset and lateness (k + 3,).
    """
    predictor = _predictor(fine, widened(space, fine), unknowns, COARSE)
    resolved = predictor.resolved(unknowns)
    if not resolved.all():
        clear = fine.only(resolved)
        if clear is None or len(clear.samples) < MOSTLY * len(fine.samples):
            return None
        fine, predictor = clear, _predictor(clear, predictor.space, unknowns, COARSE)
    size = max(torques.left, 1e-9 * fine.size) / unknowns[-3]
    first = np.array([*unknowns, START_RATE, size, DRIFTING * size, SHOWN if predictor.space.free[MISSED] else 0.0])
    begun = _begun(predictor, first, loss, torques, cancel)
    if space.free[-1] and not all(log.even for log in fine.logs):
        other = _predictor(fine.drawn(Between.HELD_UP_TO), predictor.space, unknowns, COARSE)
        up_to = _begun(other, first, loss, torques, cancel)
        begun, up_to = (replace(one, unknowns=one.aim.tune(one.unknowns, near=True)) for one in (begun, up_to))
        begun = begun if begun.likelier_than(up_to) else up_to
    found = _fitted(begun, loss, torques, cancel)
    if not space.free[-1]:
        return found
    sound = found.sound and not found.hopeless
    line, start = fine.drawn(Between.LINE), (found.unknowns if sound else first).copy()
    start[MISSED] = SHOWN
    other = _predictor(line, widened(space, line), start[:-NUISANCES], COARSE)
    if sound and likelier(found.scores, other.scores(other.tune(start, near=True))):
        return found
    momentary = _fitted(_begun(other, start, loss, torques, cancel), loss, torques, cancel)
    return found if found.likelier_than(momentary) else momentary


def _begun(
    predictor: Predictor, first: np.ndarray, loss: str, torques: Torques, cancel: Callable[[], bool]
) -> Sharpened:
    """Predictions in time, with the law of the torques, from `first` (k + 7,)."""
    start, space = predictor.tune(first), predictor.space
    in_time = space.holding(np.arange(len(start)) < len(start) + INERTIA)
    for _ in range(2):
        fit = _refined(predictor, start, in_time, loss, cancel)
        start = fit.unknowns
        found = Sharpened(start, space, fit, predictor.evaluations, predictor)
        if torques.ruled_out(found):
            return replace(found, hopeless=True)
    return found


def _fitted(found: Sharpened, loss: str, torques: Torques, cancel: Callable[[], bool]) -> Sharpened:
    """The fit of predictions in all that is free, from predictions in time."""
    if found.hopeless:
        return found
    predictor, start, space, evaluations, level = found.aim, found.unknowns, found.space, 0, 1.0
    exact = predictor
    for number in range(ROUNDS):
        if number == 1:  # noise is tuned beside a law that is nearly right
            start = predictor.tune(start, near=True)
        elif number:
            start = predictor.scaled(start, level)
        if exact is not predictor:
            exact.encoder, evaluations, predictor = predictor.encoder, evaluations + predictor.evaluations, exact
        fit = _refined(predictor, start, space, loss, cancel)
        moved, start = _moved(fit, start, space), fit.unknowns
        found = Sharpened(start, space, fit, evaluations + predictor.evaluations, predictor)
        if torques.hopeless(found):
            return replace(found, hopeless=True)
        exact, level = predictor.finer(start), math.sqrt(float(np.mean(fit.residual[fit.weights > 0.0] ** 2)))
        if cancel() or (moved < SETTLED and number and exact is predictor and LEVEL[0] < level < LEVEL[1]):
            break
    return found


def _refined(predictor: Predictor, start: np.ndarray, space: Space, loss: str, cancel: Callable[[], bool]) -> Refined:
    """A fit with the weights that the filter expects at its start."""
    predictor.weigh(start)
    return refine(
        predictor.linearised, predictor.evaluated, predictor.target, predictor.weights, start, space, loss,
        iterations=15, tolerance=LEAST_GAIN / len(predictor.target), cancel=cancel,
    )  # fmt: skip


def _moved(fit: Refined, start: np.ndarray, space: Space) -> float:
    """How many standard deviations a fit lies from its start, at most of any unknown."""
    index = np.flatnonzero(space.free)
    stds = np.sqrt(np.maximum(np.diag(curvature_inverse(fit.jacobian[:, index], fit.weights)), 0.0))
    moves = np.abs(fit.unknowns - start)[index]
    return float(np.max(np.divide(moves, stds, out=np.where(moves > 0.0, np.inf, 0.0), where=stds > 0.0)))


def likelier(scores: np.ndarray, others: np.ndarray) -> bool:
    """Whether predictions with these scores (n,) are at least as likely as others, by the samples that both count."""
    return bool(np.nansum(scores - others) <= 0.0)


def _predictor(fine: Fine, space: Space, unknowns: np.ndarray, finest: float) -> Predictor:
    if isinstance(fine.model, LuGreModel):
        return LuGrePredictor(fine, fine.model, space, unknowns, finest)
    return ForcedPredictor(fine, space)


def widened(space: Space, fine: Fine) -> Space:
    """With the nuisances of `prediction`: a held torque acts as it was logged, if all of it was; momentary values miss much."""
    misses = fine.between is Between.LINE or any(log.lost is not None for log in fine.logs)
    return Space(
        np.concatenate([space.lower, [START_RATE / 30.0, 1e-30, 1e-30, 1e-3]]),
        np.concatenate([space.upper, [1e5, np.inf, np.inf, 1e3]]),
        np.concatenate([space.logarithmic, [True, True, True, True]]),
        np.concatenate([space.free, [True, True, True, misses]]),
    )
