"""Joint fits of everything that an axis has.

In: an axis and a noise model. Out: a `Fit`: the axis with the free numbers that minimise

    w'w + bias(axis) + sum_k ((x_k - x_k,start) / prior_k)^2        w: whitened residual on the train rows

by Levenberg-Marquardt, with the noise model that this is true under. `settle` alternates fits with estimates of the noise.

The controller answers the encoder's noise with torque: a fit to all frequencies would put the torque where it cancels that
noise. What times the torque (alignment, delay, lag) is therefore fitted first, with the base, to the share of the noise that
is not the encoder's, and held while all the rest is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance, jumps, times_torque
from tcs_friction.diagnose.fit.noise import NoiseModel, Squares
from tcs_friction.diagnose.fit.noise_estimate import estimated, with_bias, with_spectrum
from tcs_friction.diagnose.fit.parameters import (
    Form,
    FreeNumber,
    Part,
    bound_reached,
    read_numbers,
    with_numbers,
)
from tcs_friction.numerics.least_squares import Schedule, minimise
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance

BASE_PRIOR = 1.0  # log units by which a number of the base may leave where it was if the data do not say
SHAPE_PRIOR = 3.0  # the same for a positive number of an effect: a factor of twenty
OTHER_BASIN = 2.0  # factor from a believed number of the law, from which its fit may be in another minimum
FIRST_ITERATIONS, LATER_ITERATIONS = 20, 8  # of the first fit of `settle` and of those after a new noise estimate
WITHOUT_ITERATIONS, WITHOUT_TOLERANCE = 5, 0.5  # of a fit without one effect, which starts near its optimum
SHARED = 0.9  # correlation of two effects' numbers, from which they share a torque
LARGEST_LOG_CHANGE = 0.7  # in one step of a fit: a positive number changes at most by a factor of two
FORETOLD = 0.1  # of a step's gain, by which it may miss what the derivatives foretold for them to serve again
SCHEDULE = Schedule(start=1e-4, ease=5.0, tighten=8.0, least=1e-9, attempts=6, floor=1e-12)  # fits start near their optimum


@dataclass(frozen=True, eq=False)
class Fit:
    """A joint fit: the axis, its free numbers (k,) with their covariance (k, k) under the noise model, its squares.

    outcome: how the search ended.
    """

    axis: Axis
    free: tuple[FreeNumber, ...]
    covariance: np.ndarray
    squares: Squares
    outcome: Outcome

    @property
    def noise(self) -> NoiseModel:
        """The noise model of the fit."""
        return self.squares.noise

    def numbers_of(self, item: Instance) -> int:
        """How many free numbers one of its effects has."""
        return sum(number.effect == item.identity for number in self.free)


def prior(free: Sequence[FreeNumber]) -> np.ndarray:
    """Standard deviations (k,) that keep numbers near where they were which the data do not determine; amplitudes have none."""

    def deviation(number: FreeNumber) -> float:
        if number.part is not Part.EFFECT:
            return BASE_PRIOR
        return SHAPE_PRIOR if number.form is Form.LOGARITHM else float("inf")

    return np.array([deviation(number) for number in free])


def settle(balance: TorqueBalance, axis: Axis, noise: NoiseModel, rounds: int = 3) -> Fit:
    """Joint fit of everything the axis has, in turn with estimates of the noise; `noise` is the model so far."""
    noise = with_bias(balance, axis, with_spectrum(balance, noise, balance.residual(axis, noise), axis.inertia))
    iterations = FIRST_ITERATIONS
    for _ in range(rounds):
        fit = fit_untimed(balance, fit_timing(balance, axis, noise, iterations), noise, iterations)
        axis, noise = fit.axis, estimated(balance, fit.axis, noise)
        iterations = LATER_ITERATIONS
    return under(balance, fit, noise)


def fit_timing(
    balance: TorqueBalance, axis: Axis, noise: NoiseModel, iterations: int, tolerance: float = 1.0
) -> Axis:
    """The axis after a fit of all that times the torque, and of its base, where the noise is not the encoder's."""
    free = balance.free(axis)
    some = [
        number
        for number, timing in zip(free, times_torque(axis, free), strict=True)
        if timing or number.part is not Part.EFFECT
    ]
    return least_squares(balance, axis, some, noise, prior(some), iterations, tolerance, drive_only=True).axis


def fit_untimed(
    balance: TorqueBalance,
    axis: Axis,
    noise: NoiseModel,
    iterations: int,
    tolerance: float = 1.0,
    free: Sequence[FreeNumber] | None = None,
) -> Fit:
    """Joint fit of everything, or of some free numbers, but what times the torque, and what it jumps with."""
    free = balance.free(axis) if free is None else free
    held = times_torque(axis, free) | np.array([jumps(axis, number) for number in free], bool)
    return least_squares(balance, axis, free, noise, prior(free), iterations, tolerance, held)


def fit_jointly(
    balance: TorqueBalance, axis: Axis, noise: NoiseModel, iterations: int, tolerance: float = 1.0
) -> Fit:
    """Joint fit under a given noise model; an axis with a filter of the torque is timed first."""
    if any(item.term.filters for item in axis.effects):
        axis = fit_timing(balance, axis, noise, iterations, tolerance)
    return fit_untimed(balance, axis, noise, iterations, tolerance)


def under(balance: TorqueBalance, fit: Fit, noise: NoiseModel) -> Fit:
    """The same axis with its squares under another noise model."""
    return replace(fit, squares=balance.squares(fit.axis, noise))


def fit_without(balance: TorqueBalance, fit: Fit, item: Instance) -> Fit:
    """The joint fit without one effect; where that timed the torque, the alignment does what it can.

    Effects that shared its torque take that over first: all numbers at once, far from the optimum, would lead the law astray.
    """
    fewer = fit.axis.without_effect(item)
    if _shares_torque(fit, item):
        others = [number for number in balance.free(fewer) if number.part is Part.EFFECT]
        fewer = least_squares(balance, fewer, others, fit.noise, prior(others), WITHOUT_ITERATIONS, WITHOUT_TOLERANCE).axis
    if item.term.filters:
        fewer = fit_timing(balance, fewer, fit.noise, WITHOUT_ITERATIONS, WITHOUT_TOLERANCE)
    return fit_jointly(balance, fewer, fit.noise, WITHOUT_ITERATIONS, WITHOUT_TOLERANCE)


def taken_out(balance: TorqueBalance, fit: Fit, item: Instance) -> Fit:
    """The fit's axis without one effect, all else as it is."""
    axis = fit.axis.without_effect(item)
    return replace(fit, axis=axis, free=tuple(balance.free(axis)))


def _shares_torque(fit: Fit, item: Instance) -> bool:
    """Whether an effect's numbers go with those of another effect, so that the data hardly tell whose torque it is."""
    own = np.array([number.effect == item.identity for number in fit.free])
    others = np.array([number.part is Part.EFFECT for number in fit.free]) & ~own
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    correlation = np.abs(fit.covariance / np.outer(deviations, deviations))[np.ix_(own, others)]
    return bool(np.any(correlation > SHARED))


def from_believed_law(balance: TorqueBalance, fit: Fit, believed: Axis) -> Axis:
    """The fit's axis, or one fitted from the believed law where that does better.

    While an effect was missing the law's own numbers may have gone far astray to stand in for it, and find no way back.
    """
    if fit.axis.friction.term is not believed.friction.term:
        return fit.axis
    ratios = [fit.axis.friction.values[name] / max(v, 1e-300) for name, v in believed.friction.values.items()]
    if all(1.0 / OTHER_BASIN < ratio < OTHER_BASIN or ratio == 0.0 for ratio in ratios):
        return fit.axis
    start = replace(fit.axis, friction=believed.friction, inertia=believed.inertia)
    again = fit_jointly(balance, start, fit.noise, FIRST_ITERATIONS)
    return again.axis if balance.squares(fit.axis, fit.noise) - again.squares > 0.0 else fit.axis


def least_squares(
    balance: TorqueBalance,
    axis: Axis,
    free: Sequence[FreeNumber],
    noise: NoiseModel,
    prior: np.ndarray,
    iterations: int = 12,
    tolerance: float = 1.0,
    held: np.ndarray | None = None,
    drive_only: bool = False,
) -> Fit:
    """Levenberg-Marquardt on the whitened train residual.

    prior (k,): standard deviation that keeps a number near its start (inf: none). held (k,): numbers that stay as they are.
    drive_only: as whitened for the share of the noise that is not the encoder's. The fit stops when a step gains less than
    `tolerance`, in units of chi-squared of the noise that the fit itself shows.
    """
    objective = _WhitenedResidual(balance, axis, free, noise, prior, held, drive_only)
    longest = [LARGEST_LOG_CHANGE if number.form is Form.LOGARITHM else np.inf for number in free]
    minimum = minimise(
        objective,
        axis,
        iterations=iterations,
        absolute=tolerance,
        relative=tolerance / noise.samples.effective_count,
        longest=np.array(longest),
        reuse=FORETOLD,
        schedule=SCHEDULE,
    )
    covariance = np.linalg.pinv(0.5 * minimum.normal, hermitian=True)
    return Fit(minimum.point, tuple(free), covariance, objective.squares(minimum.point), minimum.outcome)


class _WhitenedResidual:
    """The cost of a joint fit over axes: whitened squares, bias and prior (`numerics.least_squares.Objective`)."""

    def __init__(
        self,
        balance: TorqueBalance,
        start: Axis,
        free: Sequence[FreeNumber],
        noise: NoiseModel,
        prior: np.ndarray,
        held: np.ndarray | None,
        drive_only: bool,
    ) -> None:
        self.balance, self.free, self.noise, self.drive_only = balance, free, noise, drive_only
        self.bias = noise.drive_bias if drive_only else noise.bias
        self.start = read_numbers(start, free)
        self.strength = 1.0 / np.asarray(prior) ** 2
        self.held = np.zeros(len(free), bool) if held is None else held
        self.columns = np.empty((0, len(free)))
        self.last: tuple[Axis, np.ndarray, np.ndarray] | None = None

    def _residuals(self, axis: Axis) -> tuple[np.ndarray, np.ndarray]:
        """Residual (n,) of an axis and its whitened rows (m,); those of the last axis are kept."""
        if self.last is None or self.last[0] is not axis:
            residual = self.balance.residual(axis, self.noise)
            self.last = axis, residual, self.noise.whiten(residual, self.drive_only)
        return self.last[1], self.last[2]

    def squares(self, axis: Axis) -> Squares:
        """Whitened squares without the prior."""
        white = self._residuals(axis)[1]
        return Squares(float(white @ white) + self.bias.squares(axis), self.noise)

    def cost(self, point: Axis) -> float:
        """Squares and prior."""
        away = read_numbers(point, self.free) - self.start
        return self.squares(point).value + float(self.strength @ away**2)

    def quadratic(self, point: Axis, renew: bool) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, its gradient (k,) and twice the normal matrix (k, k)."""
        residual, white = self._residuals(point)
        if renew:
            self.columns = self.balance.jacobian(point, self.free, self.noise, residual, self.drive_only)
        away = read_numbers(point, self.free) - self.start
        gradient = self.columns.T @ white + 0.5 * self.bias.gradient(point, self.free) + self.strength * away
        normal = self.columns.T @ self.columns + np.diag(self.strength)
        return self.cost(point), 2.0 * gradient, 2.0 * normal

    def moved(self, point: Axis, step: np.ndarray) -> Axis:
        """The axis after a step (k,), within the declared bounds."""
        return with_numbers(point, self.free, read_numbers(point, self.free) + step)

    def blocked(self, point: Axis, gradient: np.ndarray) -> np.ndarray:
        """(k,) Which numbers stay: held ones, and those at a bound that going downhill would leave."""
        reached = [not held and bound_reached(point, self.free, k) for k, held in enumerate(self.held)]
        return np.asarray(self.held | (np.array(reached, int) * gradient < 0.0))
