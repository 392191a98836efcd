"""How well an effect is established: by its agreement between independent pieces of the data, and by what it leaves.

In: the fits with and without an effect. Out: its `Agreement`.

Significance against white noise grows without limit with the length of a recording, whatever small thing the rest of the model
misses. Two questions do not:

1. Does the effect come back with the same size? Each piece p of the data has its own least-squares multiple a_p of the torque
   that was fitted to the train data, 1 where it agrees, and the variance v_p of that by the noise. The pieces differ by more than
   noise where the model is wrong otherwise: the mean is that of a random-effects meta-analysis,

       a = sum(a_p / (v_p + tau^2)) / sum(1 / (v_p + tau^2))        over the held-out pieces

   with the variance tau^2 between all pieces by DerSimonian and Laird (1986) and the standard error by Hartung and Knapp (2001).
   The multiples of fitted pieces average 1 by the normal equations whatever was fitted: they tell the scatter and not the mean.
   a over its standard error is Student's t with one degree of freedom less than there are pieces with a say in the scatter,

       n = sum(w_p)^2 / sum(w_p^2),        w_p = 1 / (v_p + tau^2)        (Kish 1965)

   so that pieces in which the effect hardly acts are no replications.
   An effect that changes the inertia has the acceleration's noise in its torque, and so has the residual: there the multiple is
   that of the part of its torque that is driven (an instrumental variable).
2. How much of what was not explained before does it explain? An effect that is smaller than what is left may be a part of that.
   The power that it explains over the power beyond noise that is left stands for the odds that it is none, in the data held
   out or in all of them, wherever it explains less: a quiet span that was held out proves little. Names for what
   another engine had made in another way explained 79 to 91 % of it, true ones 93 % and more
   (`./tcs bench concealed --worlds mujoco`).

Both together are the probability that a name is right, were there no others that these data cannot tell from it. How often
names are right that are given with a probability is measured by `./tcs bench concealed`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise_estimate import NO_NOISE, driven_part, noise_floor
from tcs_friction.diagnose.search.matched_filter import wave_angle
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place

FLOOR_ERROR = 0.05  # of its power, to which a noise floor is known: a median over some 24 blocks and 32 neighbouring frequencies
PLACES = 24  # of equal length in the travel or the time, or of equal count of velocities, over which a mean depends on that
OF_THE_VELOCITY = ("velocity", "direction")  # coordinates that the velocity alone gives
NEXT_ORDERS = 8  # on either side: one period more in the recording is the next one
AROUND_AN_ORDER = 0.125  # of what is left: it would have to be in a few lines for more of it to be around one order
BY_CHANCE = 1.645  # standard deviations, that noise exceeds once in twenty
LEAST_LEFT = 2e-3  # of the noise power, that nobody would see: what one name out of all needs in 15 000 independent samples


@dataclass(frozen=True)
class Agreement:
    """What independent pieces of the data say of an effect.

    multiple, deviation: of the fitted torque in pieces that were not fitted, mean and its standard error. pieces: in how many it
    acts, so that their scatter is known. gone, left: torque that it takes away, and what is left beyond noise and could be the
    same, N m rms, of held-out data or of all, where it explains less.
    """

    multiple: float
    deviation: float
    pieces: float
    gone: float
    left: float

    @property
    def explained(self) -> float:
        """Share of the power that was not explained without the effect."""
        return self.gone**2 / max(self.gone**2 + self.left**2, 1e-300)

    @property
    def comes_back(self) -> float:
        """Probability that independent pieces have it, too."""
        if self.pieces <= 1.0:
            return 0.0
        t = self.multiple / max(self.deviation, 1e-300)
        return 1.0 - 2.0 * float(stats.t.sf(max(t, 0.0), self.pieces - 1))

    @property
    def probability(self) -> float:
        """That the effect is there, by agreement and by what it leaves."""
        return self.explained * self.comes_back


def agreement_on(balance: TorqueBalance, fit: Fit, without: Fit, item: Instance) -> Agreement:
    """What the pieces say of an effect of a fit; `without`: the fit without it, all else refitted.

    A wave can be a part of no more than what is left around its order, a torque or friction of the position of no more than
    depends on that, a constant torque of no more than its changes over the travel or the time. What collisions leave is theirs,
    since none comes at its exact time, and what depends on the velocity can be a part of no more than that, unless more than
    noise is left: wrong models leave what looks like collisions, and wrong friction laws what depends on the way from a reversal.
    """
    noise = fit.noise
    before, after = (balance.residual(x.axis, noise) for x in (without, fit))
    judging = judged(balance, fit.axis)
    usable = balance.train | judging

    def white(residual: np.ndarray) -> np.ndarray:
        whitened = noise.whitening.apply(residual, balance.samples) * np.sqrt(noise.local_weight)
        return np.where(usable, whitened, 0.0)

    change, base = white(before - after), white(before)
    known = white(driven_part(noise, before - after)) if item.term.inertia_over is not None else change
    mean, deviation, acting = random_effects(*multiples(balance.samples.pieces, judging, change, known, base))
    floor = noise_floor(balance, after)
    share = _share_that_it_could_be(balance, fit.axis, item, after, floor)
    of_torque = [_explained(balance, before, after, where, share, floor) for where in (judging, usable)]
    return min((Agreement(mean, deviation, acting, *one) for one in of_torque), key=lambda one: one.explained)


def multiples(
    pieces: np.ndarray, held_out: np.ndarray, change: np.ndarray, known: np.ndarray, base: np.ndarray
) -> tuple[np.ndarray, np.ndarray, NDArray[np.bool_]]:
    """Multiples of an effect in the pieces that have it (p,), their variances by white noise, and which pieces were held out.

    Of samples (n,): number of the piece, whether it was held out, whitened residual without the effect, the change that it makes
    of it and the part of that which is known apart from the residual's noise; zero where nothing is compared. Where the band ends
    below half the rate, whitened noise still has a power of one at all frequencies that a change has.
    """
    count = int(pieces.max()) + 1
    parts = pieces + count * held_out
    size, power, together = (np.bincount(parts, known * x, 2 * count) for x in (change, known, base))
    seen = size > 0.0
    return together[seen] / size[seen], power[seen] / size[seen] ** 2, np.flatnonzero(seen) >= count


def _share_that_it_could_be(
    balance: TorqueBalance, axis: Axis, item: Instance, left: np.ndarray, floor: float
) -> float:
    """Share of what is left, from a residual (n,) with a noise floor (N m), that an effect of this axis could be a part of."""
    usable = balance.train | balance.held_out
    more_than_noise = max(rms(left[balance.train]), rms(left[balance.held_out])) >= NO_NOISE * floor
    if item.term.collides:
        return 1.0 if more_than_noise else 0.0
    left = left[usable]
    if item.term.periodic:
        angle = wave_angle(balance, axis, item.term)[usable]
        return min(_power_around(angle, item.order, left) / float(left @ left), AROUND_AN_ORDER)
    position, velocity, t = (balance.data.joined(name)[usable] for name in ("position", "velocity", "t"))
    if item.term.coordinate == "position" and not item.term.states:
        friction = item.term.place is Place.SCALE
        return _power_over(position, left * np.sign(velocity) if friction else left) / float(left @ left)
    if item.term.coordinate in OF_THE_VELOCITY and not (item.term.states or more_than_noise):
        return _power_over(stats.rankdata(velocity), left) / float(left @ left)
    if item.term.offset and len(item.term.parameters) == 1:
        return max(_power_over(position, left), _power_over(t, left)) / float(left @ left)
    return 1.0


def _power_around(angle: np.ndarray, order: float, left: np.ndarray) -> float:
    """Sum of squares of a series (n,) in waves over an angle (n,) of an order and of those next to it."""
    once = 2.0 * math.pi / max(float(np.ptp(angle)), 1e-300)
    orders = order + once * np.arange(-NEXT_ORDERS, NEXT_ORDERS + 1)
    phases = np.outer(angle, orders[orders > 0.0])
    columns = np.concatenate([np.cos(phases), np.sin(phases)], axis=1)
    return float(left @ columns @ np.linalg.lstsq(columns.T @ columns, columns.T @ left, rcond=1e-9)[0])


def _power_over(coordinate: np.ndarray, left: np.ndarray) -> float:
    """Sum of squares of a series (n,) in its means over equal parts of a coordinate (n,)."""
    part = (coordinate - coordinate.min()) / max(float(np.ptp(coordinate)), 1e-300)
    place = np.minimum(part * PLACES, PLACES - 1).astype(int)
    return float(np.sum(np.bincount(place, left) ** 2 / np.maximum(np.bincount(place), 1)))


def judged(balance: TorqueBalance, axis: Axis) -> np.ndarray:
    """Samples (n,) on which an axis is judged: those held out but `untimed` ones, all of them where no others are left.

    Train data where none are held out.
    """
    held = balance.held_out & _timed(balance, axis)
    return next((mask for mask in (held, balance.held_out) if mask.any()), balance.train)


def stated(balance: TorqueBalance, axis: Axis) -> np.ndarray:
    """Samples (n,) that say what an axis is worth: untouched ones but `untimed` ones; none of a short recording."""
    return np.asarray(balance.untouched & _timed(balance, axis))


def _timed(balance: TorqueBalance, axis: Axis) -> np.ndarray:
    """Samples (n,) at which every event in time of an axis has begun or not, as far as what was fitted says it."""
    t = balance.data.joined("t")
    timed = np.ones(len(t), bool)
    for _, begin, end in untimed(balance, axis):
        timed &= (t <= begin) | (t >= end)
    return timed


def untimed(balance: TorqueBalance, axis: Axis) -> list[tuple[Instance, float, float]]:
    """Events in time of an axis that begin where data are not fitted, and between which two fitted samples (s) that is.

    Nothing that was fitted says when such an event begins.
    """
    t, blur = balance.data.joined("t"), 1.0 / balance.data.cutoff
    fitted, held = t[balance.samples.rows], t[balance.held_out | balance.untouched]
    found = []
    for item in axis.effects:
        if item.term.event and item.extent is not None:
            begin = float(fitted[fitted < item.extent[0] - blur].max(initial=t.min()))
            end = float(fitted[fitted > item.extent[0] + blur].min(initial=t.max()))
            if np.any((held > begin) & (held < end)):
                found.append((item, begin, end))
    return found


def random_effects(
    values: np.ndarray, variances: np.ndarray, counted: NDArray[np.bool_] | None = None
) -> tuple[float, float, float]:
    """Mean of the counted of values (p,) that scatter by more than their variances (p,), its standard error, and of how many.

    counted (p,): which have a say in the mean; None: all. All have one in the scatter, as far as they are known (Kish 1965).
    DerSimonian and Laird (1986), Hartung and Knapp (2001); the standard error is never below that of the noise alone.
    """
    counted = np.ones(len(values), bool) if counted is None else counted
    if len(values) < 2 or not counted.any():
        return (float(np.mean(values)) if len(values) else 0.0), math.inf, float(len(values))
    weights = 1.0 / variances
    fixed = float(weights @ values / weights.sum())
    excess = float(weights @ (values - fixed) ** 2) - (len(values) - 1)
    scale = float(weights.sum() - (weights @ weights) / weights.sum())
    between = max(excess / scale, 0.0) if scale > 0.0 else 0.0
    weights = 1.0 / (variances + between)
    common = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - common) ** 2) / (len(values) - 1)
    say = weights[counted]
    known = float(weights.sum() ** 2 / (weights @ weights))
    return float(say @ values[counted] / say.sum()), math.sqrt(max(scatter, 1.0) / float(say.sum())), known


def _explained(
    balance: TorqueBalance, before: np.ndarray, after: np.ndarray, where: np.ndarray, share: float, floor: float
) -> tuple[float, float]:
    """Torque that is gone and that is left beyond noise, N m rms, from residuals (n,) at some samples, `where` (n,).

    What noise alone has in so few samples by chance is not left. share: of what is left, that the effect could be a part of.
    floor: of the noise in what is left, N m rms.
    """
    gone = max(rms(before[where]) ** 2 - rms(after[where]) ** 2, 0.0)
    independent = np.count_nonzero(where) * min(1.0, 2.0 * balance.data.cutoff * balance.data.dt)
    by_chance = BY_CHANCE * math.sqrt(2.0 / independent)  # a chi-squared over its mean
    left = max(share * (rms(after[where]) ** 2 - (1.0 + FLOOR_ERROR + by_chance) * floor**2), LEAST_LEFT * floor**2)
    return math.sqrt(gone), math.sqrt(left)
