"""The torque balance of an axis over a data set: residual and its derivatives, as pure functions of axis and noise model.

In: a data set, an axis, a noise model. Out: the residual r(t) (n,), N m, on the samples that are compared,

    r = u_rotor - J a - F - x

(u_rotor: torque that the drive makes of the logged one, F: friction, x: other opposing torques),

its derivatives by free numbers, and its whitened sum of squares. Nothing here is changed by a call: results that were computed
before are kept in a cache of `TorqueTerms` and are the same if they are computed again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.filters import through
from tcs_friction.diagnose.fit.noise import NoiseModel, Squares, compared_samples
from tcs_friction.diagnose.fit.parameters import Form, FreeNumber, Part, bound_reached, free_parameters, moved
from tcs_friction.diagnose.fit.repeatable import RepeatablePart
from tcs_friction.diagnose.fit.second_body import motion_gain, resonant_bodies
from tcs_friction.diagnose.fit.torque import TorqueTerms
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.numerics.runs import runs
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Role

ALIGNMENT_STEP = 1e-3  # of the time between samples, for derivatives
WHITENING_SECONDS = 0.5  # half length of the whitening filter at most: its resolution in frequency is 1 Hz
BLOCKS_PER_FILTER = 20.0  # median length of a train block over the filter's half length: a tenth of the rows is lost
SHORTEST_FILTER = 4  # samples on either side


class TorqueBalance:
    """Torque balances over one data set.

    inertia_known: it is not fitted. reach: s by which the torque may act sooner or later than the log has it; None: as far as
    stamps may be meant.
    """

    def __init__(self, data: DataSet, inertia_known: bool = False, reach: tuple[float, float] | None = None) -> None:
        self.data = data
        self.reach = (-data.leeway, data.leeway) if reach is None else reach
        self.inertia_known = inertia_known
        self.samples = compared_samples(data, _filter_half_length(data))
        self.train, self.held_out, self.untouched = self.samples.train, self.samples.held_out, self.samples.untouched
        self.torque_size = rms(data.joined("torque")[self.train])
        self.terms = TorqueTerms(data)
        self.repeatable = RepeatablePart(data, self.train)

    def free(self, axis: Axis) -> list[FreeNumber]:
        """The free numbers of a joint fit, the alignment of torque and position in the log among them where nobody states it.

        An axis with an effect that is a pure delay has its alignment in that.
        """
        free = [number for number in free_parameters(axis) if not (self.inertia_known and number.part is Part.INERTIA)]
        if self.reach == (0.0, 0.0) or any(item.term.alignment for item in axis.effects):
            return free
        step = ALIGNMENT_STEP * self.data.dt
        return [*free, FreeNumber(Part.ALIGNMENT, "lateness", Form.PLAIN, step, bounds=self.reach)]

    def residual(self, axis: Axis, noise: NoiseModel, keep: bool = True) -> np.ndarray:
        """Torque residual (n,), N m; where bodies swing, with the noise of the motion as small as if they did not.

        At an antiresonance a body takes any torque and hardly moves: what a noisy motion requires there is mostly noise. The
        residual is divided by the factor by which its noise is amplified (total least squares with the motion's share in the
        noise). Without such bodies it is the `torque_residual`. `keep`: in the cache, for an axis near it.
        """
        residual = self.torque_residual(axis, keep)
        if not resonant_bodies(axis):
            return residual
        return self.through(residual, lambda frequency: 1.0 / noise_amplification(axis, noise, frequency))

    def torque_residual(self, axis: Axis, keep: bool = True) -> np.ndarray:
        """Torque at the rotor less what the motion requires (n,), N m, scaled as if the drive passed all of the logged torque on.

        A drive that swallows the torque would need no friction and leave no residual: the torque is no measure of itself.
        """
        rotor, size = self.terms.rotor(axis, keep)
        return np.asarray(self.scale(size) * (rotor - self.terms.required(axis, keep)))

    def scale(self, size: float) -> float:
        """Scale of a residual whose torque at the rotor has the rms `size`, N m."""
        return max(self.torque_size / size, 1.0) if size > 0.0 else 1.0

    def through(self, x: np.ndarray, response: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """A series (n,) through a linear filter, stretch by stretch; `response` (m,) at frequencies (m,), Hz, may be complex."""
        return np.concatenate([through(x[s], self.data.dt, response) for s in self.samples.stretches])

    def time_derivative(self, x: np.ndarray) -> np.ndarray:
        """Time derivative (n,) of a series, stretch by stretch."""
        return np.concatenate([np.gradient(x[s], self.data.dt) for s in self.samples.stretches])

    def derivatives(
        self,
        axis: Axis,
        free: Sequence[FreeNumber],
        noise: NoiseModel,
        residual: np.ndarray,
        through: Callable[[np.ndarray], np.ndarray] = lambda column: column,
    ) -> np.ndarray:
        """Derivatives (n, k) of the residual by the free numbers, each column passed `through` a function.

        Forward differences; backward at an upper bound.
        """

        def differentiate(k: int) -> np.ndarray:
            step = -free[k].step if bound_reached(axis, free, k) == 1 else free[k].step
            return through((self.residual(moved(axis, free, k, step), noise) - residual) / step)

        columns = side_by_side(differentiate, range(len(free)))
        return np.stack(columns, axis=1) if columns else np.empty((len(through(residual)), 0))

    def jacobian(
        self,
        axis: Axis,
        free: Sequence[FreeNumber],
        noise: NoiseModel,
        residual: np.ndarray,
        drive_only: bool = False,
    ) -> np.ndarray:
        """Derivatives (m, k) of the whitened residual by the free numbers."""
        return self.derivatives(axis, free, noise, residual, lambda column: noise.whiten(column, drive_only))

    def squares(self, axis: Axis, noise: NoiseModel) -> Squares:
        """Whitened sum of squares of an axis' residual on the rows, corrected for what noise in the motion takes away."""
        white = noise.whiten(self.residual(axis, noise))
        return Squares(float(white @ white) + noise.bias.squares(axis), noise)

    def quantisation_torque(self, axis: Axis) -> float:
        """N m rms that the steps of a coarse encoder feign through the inertia, if their error is evenly spread."""
        frequency = np.linspace(0.0, self.data.cutoff, 257)
        density = self.data.period * self.data.position_step**2 / 6.0  # one-sided, of a uniform error
        power = density * (axis.inertia * (2.0 * math.pi * frequency) ** 2) ** 2
        return math.sqrt(float(np.trapezoid(power, frequency)))


def noise_amplification(axis: Axis, noise: NoiseModel, frequency: np.ndarray) -> np.ndarray:
    """Factor by which bodies that swing on an axis amplify the residual's noise, at frequencies (k,), Hz."""
    amplified = np.abs(motion_gain(axis, frequency)) ** 2
    return np.sqrt(1.0 + noise.encoder_share_at(frequency) * (amplified - 1.0))


def times_torque(axis: Axis, free: Sequence[FreeNumber]) -> np.ndarray:
    """Which free numbers (k,) say how much later the torque acts: alignment of the log, filters of the drive."""

    def times(number: FreeNumber) -> bool:
        item = number.item(axis)
        return number.part is Part.ALIGNMENT or (item is not None and item.term.filters)

    return np.array([times(number) for number in free], bool)


def jumps(axis: Axis, number: FreeNumber) -> bool:
    """Whether its effect's torque jumps with a number: derivatives by it say nothing."""
    item = number.item(axis)
    return item is not None and item.term.discontinuous and item.term.parameter(number.name).role is Role.SHAPE


def rms(x: np.ndarray) -> float:
    """Root of the mean square; of nothing 0."""
    return math.sqrt(float(np.mean(x**2))) if len(x) else 0.0


def _filter_half_length(data: DataSet) -> int:
    """Samples on either side of the whitening filter: up to WHITENING_SECONDS, short against the train blocks."""
    lengths = np.diff(runs(data.train), axis=1)
    block = float(np.median(lengths)) if len(lengths) else 0.0
    return max(SHORTEST_FILTER, int(min(WHITENING_SECONDS / data.dt, block / BLOCKS_PER_FILTER)))
