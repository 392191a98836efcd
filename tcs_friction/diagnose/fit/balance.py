"""The torque balance of an axis over conditioned recordings: residual, whitening, and joint least squares.

residual = torque at the rotor - torque that the measured motion requires. Its noise is coloured (the encoder's noise enters
through the second derivative, torque noise through the drive), so every comparison is made after a whitening filter
estimated from the residual itself: then squares add up to a likelihood and gains compare with chi-squared.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage, signal

from tcs_friction.diagnose.dataset.preprocessing import Conditioned, through
from tcs_friction.diagnose.fit.errors_in_variables import Attenuation, attenuation
from tcs_friction.diagnose.fit.parameters import (
    INERTIA,
    Free,
    at_bound,
    free_parameters,
    get,
    limited,
    moved,
    put,
)
from tcs_friction.diagnose.fit.repeatable import Reproducible
from tcs_friction.diagnose.fit.second_body import motion_gain, swinging
from tcs_friction.diagnose.fit.torque import Parts
from tcs_friction.diagnose.parallel import side_by_side
from tcs_friction.physics.axis import Axis

EARLY, LATE = 0.5, 0.25  # periods of the recording, by which a torque may act earlier or later than stated
UNSTATED = 0.5  # by which it may act later where nothing is stated
LOUDEST = 4.0  # noise power, relative to the usual, that is allowed for
LOCAL_SECONDS = 1.0  # over which the noise level may change
FORETOLD = 0.1  # of a step's gain, by which it may miss what the derivatives foretold
MOST_OF_MOTION = 0.9  # of the noise power: the drive always adds a little
WHITENING_SECONDS = 0.5  # half length of the whitening filter at most


@dataclass(frozen=True)
class Fit:
    """A joint fit: the axis, its free numbers with covariance (whitened), the whitened sum of squares on train data."""

    axis: Axis
    free: tuple[Free, ...]
    covariance: np.ndarray
    squares: float
    converged: bool


class Balance:
    """Torque balances over one set of conditioned recordings.

    `weights` is the whitening filter (2 half + 1,), scaled so that whitened noise has variance one; `calm` the same where each
    frequency counts by the share of its noise that is not the encoder's.
    """

    def __init__(self, data: Conditioned, believed_delay: float = 0.0) -> None:
        self.data = data
        self.believed_delay = believed_delay
        self.weights = np.array([1.0])
        self.calm = np.array([1.0])
        self.responses: dict[tuple[int, bool], np.ndarray] = {}
        self.motion_share = np.zeros(2)  # of the noise power, by the encoder through the inertia, at even steps of frequency
        self.attenuation = Attenuation()
        self.sizes = [len(s.train) for s in data.stretches]
        self.ends = np.cumsum([0, *self.sizes])
        self.train = data.joined("train")
        self.held_out = data.joined("held_out")
        self.pieces = data.joined("piece")
        self.local_weight = np.ones(
            len(self.train)
        )  # 1/variance of the whitened noise relative to the record's
        self.torque_size = rms(data.joined("torque")[self.train])
        self.parts = Parts(data)
        self.reproducible = Reproducible(data)
        self._refresh_rows()

    def free(self, axis: Axis) -> list[Free]:
        """The free numbers of a joint fit, the alignment of torque and position in the log among them.

        An axis with a transport delay has its alignment in that.
        """
        free = free_parameters(axis, 1.0)
        if any(item.term.id == "transport_delay" for item in axis.effects):
            return free
        believed = self.believed_delay
        bounds = (max(believed - EARLY * self.data.period, 0.0), believed + self.leeway)
        return [*free, Free(-3, "actuation_delay", "plain", 1e-3 * self.data.dt, bounds=bounds)]

    @property
    def leeway(self) -> float:
        """s by which a torque may act later than the log has it, which is no physics: half its period, less if a delay is stated.

        It is held for a period, so half of it acts earlier whatever is stated.
        """
        return (LATE if self.believed_delay > 0.0 else UNSTATED) * self.data.period

    def residual(self, axis: Axis, remember: bool = True) -> np.ndarray:
        """Torque residual (n,), N m, where bodies that swing amplify noise of the motion as small as if they did not.

        At an antiresonance a body takes any torque and hardly moves: what a noisy motion requires there is mostly noise.
        Total least squares with the motion's share in the noise. Without such bodies it is the `torque_residual`.
        """
        residual = self.torque_residual(axis, remember)
        if not swinging(axis):
            return residual
        return self.through(residual, lambda frequency: 1.0 / self.noise_gain(axis, frequency))

    def through(self, x: np.ndarray, response: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """A series (n,) through a linear filter, stretch by stretch; `response` (m,) at frequencies (m,), Hz, may be complex."""
        return np.concatenate([through(x[a:b], self.data.dt, response) for a, b in itertools.pairwise(self.ends)])

    def noise_gain(self, axis: Axis, frequency: np.ndarray) -> np.ndarray:
        """Factor by which bodies that swing on an axis amplify the residual's noise, at frequencies (n,), Hz."""
        amplified = np.abs(motion_gain(axis, frequency)) ** 2
        return np.sqrt(1.0 + self.noise_share(frequency) * (amplified - 1.0))

    def noise_share(self, frequency: np.ndarray) -> np.ndarray:
        """Share of the encoder, through the inertia, in the residual's noise power at frequencies (n,), Hz."""
        even = np.linspace(0.0, 0.5 / self.data.dt, len(self.motion_share))
        return np.interp(frequency, even, self.motion_share)

    def torque_residual(self, axis: Axis, remember: bool = True) -> np.ndarray:
        """Torque at the rotor less what the motion requires (n,), N m, as if the drive passed all of the logged torque on.

        A drive that swallows the torque would need no friction and leave no residual: the torque is no measure of itself.
        `remember`: an axis near it will be asked for again.
        """
        rotor, size = self.parts.rotor(axis, remember)
        return np.asarray(self.scale(size) * (rotor - self.parts.required(axis, remember)))

    def scale(self, size: float) -> float:
        """Of a residual whose torque at the rotor has this rms, N m."""
        return max(self.torque_size / size, 1.0) if size > 0.0 else 1.0

    def slope(self, x: np.ndarray) -> np.ndarray:
        """Time derivative (n,) of a series, stretch by stretch."""
        return np.concatenate([np.gradient(x[a:b], self.data.dt) for a, b in itertools.pairwise(self.ends)])

    def whiten(self, x: np.ndarray, calm: bool = False) -> np.ndarray:
        """Whitened series of (n,) or (n, k) on the train rows only."""
        local = np.sqrt(self.local_weight[self.rows])
        return self._whiten_all(x, calm)[self.rows] * (local if x.ndim == 1 else local[:, None])

    def squares(self, axis: Axis) -> float:
        """Whitened sum of squares of an axis under the present weights, and what of it noise feigns to be less."""
        white = self.whiten(self.residual(axis))
        return float(white @ white) + self.attenuation.feigned(axis)

    def spectrum(self, residual: np.ndarray) -> np.ndarray:
        """Whitened squares of a residual (n,) on the train rows, at each of the `frequencies`."""
        power = np.abs(np.fft.rfft(self._filled(self.whiten(residual)))) ** 2 / len(self.train)
        power[1 : (len(self.train) + 1) // 2] *= 2.0
        return np.asarray(power)

    def _filled(self, white: np.ndarray) -> np.ndarray:
        """Whitened rows among zeros (n,)."""
        full = np.zeros(len(self.train))
        full[self.rows] = white
        return full

    @property
    def frequencies(self) -> np.ndarray:
        """Even steps up to half the rate, Hz."""
        return np.fft.rfftfreq(len(self.train), self.data.dt)

    @property
    def white_level(self) -> float:
        """What noise as it is estimated has in a `spectrum` at each frequency."""
        return 2.0 * len(self.rows) / len(self.train)

    def unwhiten(self, white: np.ndarray) -> np.ndarray:
        """The adjoint of `whiten`: (n,) series whose scalar product with any x is that of `white` with whitened x."""
        full = self._filled(white * np.sqrt(self.local_weight[self.rows]))
        return self._whiten_all(full)  # the filter is symmetric

    def whitening_gain(self, frequency: np.ndarray) -> np.ndarray:
        """Squared gain of the whitening filter at frequencies (Hz) of any shape; beyond the last frequency that of it."""
        count = 8 * len(self.weights)
        response = np.abs(np.fft.rfft(self.weights, count)) ** 2
        return np.interp(frequency, np.fft.rfftfreq(count, self.data.dt), response)

    @property
    def effective_count(self) -> float:
        """Independent samples in the whitened train rows: their band ends at the cutoff."""
        return len(self.rows) * min(1.0, 2.0 * self.data.cutoff * self.data.dt)

    def weigh(self, axis: Axis) -> None:
        """Take the noise, where it is louder than usual, and what it feigns, from an axis' residual."""
        residual = self.residual(axis)
        self.estimate_noise(residual, axis.inertia)
        self.estimate_local_noise(residual)
        self.estimate_attenuation(axis, residual)

    def estimate_attenuation(self, axis: Axis, residual: np.ndarray) -> None:
        """What of the residual's noise is in the acceleration, too."""
        white = [self.whiten(residual), -self.jacobian(axis, [INERTIA], residual)[:, 0]]
        frequency, spectra = self._blocks([self._filled(x) for x in white])
        inside = frequency < self.data.cutoff
        noise, motion = (x[:, inside] for x in spectra)
        driven, count = float(white[1] @ white[1]), len(self.rows) / len(frequency)
        frequency = frequency[inside]
        self.attenuation = attenuation(axis, driven, frequency, noise, motion, count, self.noise_share(frequency))

    def estimate_local_noise(self, residual: np.ndarray) -> None:
        """Weigh down the seconds in which the whitened residual is larger than usual.

        A recording is quieter at rest than in a fast manoeuvre. What is louder than LOUDEST is no noise but missing physics.
        """
        self.local_weight = np.ones(len(self.train))
        white = self._whiten_all(residual)
        window = max(8, int(LOCAL_SECONDS / self.data.dt))
        parts = [
            ndimage.uniform_filter1d(white[a:b] ** 2, min(window, b - a), mode="nearest")
            for a, b in zip(self.ends[:-1], self.ends[1:], strict=True)
        ]
        power = np.concatenate(parts)
        usual = float(np.median(power[self.rows]))
        spread = 1.0 + 3.0 * math.sqrt(2.0 / max(window * 2.0 * self.data.cutoff * self.data.dt, 1.0))
        self.local_weight = 1.0 / np.clip(power / (usual * spread), 1.0, LOUDEST)

    def _whiten_all(self, x: np.ndarray, calm: bool = False) -> np.ndarray:
        if len(self.weights) == 1:
            return x * self.weights[0]
        parts = []
        for a, b in zip(self.ends[:-1], self.ends[1:], strict=True):
            size = fft.next_fast_len(int(b - a) + len(self.weights) // 2, real=True)
            response = self._response(size, calm)
            spectrum = fft.rfft(x[a:b], size, axis=0)
            spectrum *= response if x.ndim == 1 else response[:, None]
            parts.append(fft.irfft(spectrum, size, axis=0, overwrite_x=True)[: b - a])
        return np.concatenate(parts)

    def _response(self, size: int, calm: bool) -> np.ndarray:
        """The whitening filter's real response at the frequencies of a transform of `size`."""
        if (size, calm) not in self.responses:
            weights = self.calm if calm else self.weights
            half = len(weights) // 2
            turned = np.zeros(size)
            turned[: half + 1], turned[size - half :] = weights[half:], weights[:half]
            self.responses[size, calm] = fft.rfft(turned).real
        return self.responses[size, calm]

    def _refresh_rows(self) -> None:
        """Rows whose whole whitening filter lies in train data."""
        order = len(self.weights) - 1
        inside = [
            ndimage.minimum_filter1d(self.train[a:b].astype(np.uint8), order + 1, mode="constant").astype(
                bool
            )
            for a, b in zip(self.ends[:-1], self.ends[1:], strict=True)
        ]
        self.rows = np.nonzero(np.concatenate(inside))[0]

    def estimate_noise(self, residual: np.ndarray, inertia: float = 0.0) -> None:
        """Set the whitening filter, and with the axis' inertia the share of the motion's noise, from the residual's train part.

        The spectrum is a median over blocks of time and over neighbouring frequencies, so that neither bursts nor lines (which
        may be the physics that is looked for) count as noise. The filter is its inverse square root, zero-phase.
        """
        frequency, power = self.noise_spectrum(residual)
        if inertia > 0.0:
            encoder = 2.0 * self.data.period * self.data.position_noise**2  # rad^2/Hz
            share = (inertia * (2.0 * math.pi * frequency) ** 2) ** 2 * encoder / power
            self.motion_share = np.minimum(share, MOST_OF_MOTION)
        inside = frequency <= self.data.cutoff
        power = np.where(inside, power, power[inside].max())  # what the filter took away is no lack of noise
        half = self._half_length()
        count = 2 * max(2 * half, len(frequency))
        even = np.linspace(0.0, frequency[-1], count // 2 + 1)
        response = np.sqrt(2.0 * self.data.dt / np.interp(even, frequency, power))
        window = signal.get_window("hann", 2 * half + 3, fftbins=False)[1:-1]
        self.weights, self.calm = (
            window * np.roll(np.fft.irfft(x, count), half)[: 2 * half + 1]
            for x in (response, response * (1.0 - self.noise_share(even)))
        )
        self.responses = {}
        self._refresh_rows()

    def _half_length(self) -> int:
        """Of the whitening filter: up to WHITENING_SECONDS, short against the train blocks."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], self.train.astype(np.int8), [0]])))
        block = float(np.median(edges[1::2] - edges[::2]))
        return max(4, int(min(WHITENING_SECONDS / self.data.dt, block / 20.0)))

    def noise_spectrum(self, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (Hz) and robust power density of what a residual has beside its reproducible part, train data, N m^2/Hz."""
        residual = self.reproducible.remove(residual)
        frequency, (blocks,) = self._blocks([residual])
        if not len(blocks):
            even = np.linspace(0.0, 0.5 / self.data.dt, 17)
            return even, np.full(17, 2.0 * self.data.dt * np.var(residual[self.train]))
        middle = 2.0 * self.data.dt * np.median(np.abs(blocks) ** 2, axis=0) / math.log(2.0)
        middle[0] = middle[1]
        middle = ndimage.median_filter(middle, max(3, (len(frequency) - 1) // 32 * 2 + 1), mode="reflect")
        return frequency, np.maximum(middle, 1e-12 * middle.max())

    def _blocks(self, series: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
        """Frequencies (m,), Hz, and spectra (blocks, m) of windowed train data of series (n,); of white noise its deviation."""
        length = 1 << max(5, min(10, int(math.log2(max(len(self.rows) / 24.0, 32)))))
        window = signal.get_window("hann", length)
        window /= math.sqrt(np.sum(window**2))
        begins = [
            begin
            for a, b in itertools.pairwise(self.ends)
            for begin in range(a, b - length + 1, length // 2)
            if self.train[begin : begin + length].all()
        ]
        spectra = []
        for x in series:
            pieces = np.stack([x[begin : begin + length] for begin in begins]) if begins else np.empty((0, length))
            spectra.append(fft.rfft(window * (pieces - pieces.mean(axis=1, keepdims=True)), axis=1))
        return np.fft.rfftfreq(length, self.data.dt), spectra

    def noise_floor(self, axis: Axis) -> float:
        """N m rms of the robust spectrum of an axis' residual."""
        frequency, power = self.noise_spectrum(self.residual(axis))
        return math.sqrt(float(np.trapezoid(power, frequency)))

    def step_torque(self, axis: Axis) -> float:
        """N m rms that the steps of a coarse encoder pretend through the inertia, if their error is evenly spread."""
        frequency = np.linspace(0.0, self.data.cutoff, 257)
        density = self.data.period * self.data.position_step**2 / 6.0
        power = density * (axis.inertia * (2.0 * math.pi * frequency) ** 2) ** 2
        return math.sqrt(float(np.trapezoid(power, frequency)))

    def misfit(self, axis: Axis) -> float:
        """Power of the residual over that of its noise, at least one: how far the best model is from all that could be known."""
        residual = self.residual(axis)
        return max(1.0, float(np.mean(residual[self.train] ** 2)) / max(self.noise_floor(axis) ** 2, 1e-300))

    def columns(self, axis: Axis, free: Sequence[Free], residual: np.ndarray) -> np.ndarray:
        """Derivative of the residual (n, k) by the free numbers, by forward differences; at an upper bound backwards."""
        return self._differentiated(axis, free, residual, lambda column: column)

    def jacobian(
        self, axis: Axis, free: Sequence[Free], residual: np.ndarray, calm: bool = False
    ) -> np.ndarray:
        """Derivative of the whitened residual (rows, k)."""
        return self._differentiated(axis, free, residual, lambda column: self.whiten(column, calm))

    def _differentiated(
        self, axis: Axis, free: Sequence[Free], residual: np.ndarray, passed: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        def differentiate(k: int) -> np.ndarray:
            step = -free[k].scale if at_bound(axis, free, k) == 1 else free[k].scale
            return passed((self.residual(moved(axis, free, k, step)) - residual) / step)

        columns = side_by_side(differentiate, range(len(free)))
        return np.stack(columns, axis=1) if columns else np.empty((len(passed(residual)), 0))

    def fit(
        self,
        axis: Axis,
        free: Sequence[Free],
        prior: np.ndarray | None = None,
        iterations: int = 12,
        tolerance: float = 1.0,
        still: np.ndarray | None = None,
        calm: bool = False,
    ) -> Fit:
        """Levenberg-Marquardt on whitened train residuals.

        `still` (k,) marks numbers that stay as they are. `calm`: as whitened for what noise of the encoder would lead astray.

        `prior` (k,) is the standard deviation that keeps a number that the data do not determine near its start (inf: none).
        Stops when a step gains less than `tolerance` (units of chi-squared, of the noise that the fit itself shows). Derivatives
        that foretold a step's gain serve for the next one, too.
        """
        start = get(axis, free)
        strength = np.zeros(len(free)) if prior is None else 1.0 / np.asarray(prior) ** 2
        held = np.zeros(len(free), bool) if still is None else still
        residual = self.residual(axis)
        white = self.whiten(residual, calm)
        biased = Attenuation() if calm else self.attenuation
        cost = float(white @ white) + biased.feigned(axis)
        damping, converged, numbers = 1e-4, False, start.copy()
        normal, foretold = np.diag(strength), False
        columns = np.empty((0, len(free)))
        for _ in range(iterations):
            if not foretold:
                columns = self.jacobian(axis, free, residual, calm)
                normal = columns.T @ columns + np.diag(strength)
            gradient = columns.T @ white + 0.5 * biased.slope(axis, free) + strength * (numbers - start)
            before, foretold = cost, False
            outward = np.array([at_bound(axis, free, k) * gradient[k] < 0.0 for k in range(len(free))], bool)
            moving = ~(outward | held)
            for _ in range(6):
                diagonal = np.maximum(np.diag(normal), 1e-12 * max(float(np.max(np.diag(normal))), 1e-300))
                damped = (normal + damping * np.diag(diagonal))[np.ix_(moving, moving)]
                step = np.zeros(len(free))
                step[moving] = -np.linalg.lstsq(damped, gradient[moving], rcond=None)[0]
                step = limited(step, free)
                trial = put(axis, free, numbers + step)
                trial_residual = self.residual(trial)
                trial_white = self.whiten(trial_residual, calm)
                moved = get(trial, free)
                trial_cost = float(trial_white @ trial_white + strength @ (moved - start) ** 2)
                trial_cost += biased.feigned(trial)
                if np.isfinite(trial_cost) and trial_cost < cost:
                    expected = -float(step @ (2.0 * gradient + normal @ step))
                    foretold = abs(cost - trial_cost - expected) < FORETOLD * expected
                    axis, numbers, residual, white, cost = (
                        trial,
                        moved,
                        trial_residual,
                        trial_white,
                        trial_cost,
                    )
                    damping = max(damping * 0.2, 1e-9)
                    break
                damping *= 8.0
            if before - cost < tolerance * max(1.0, cost / self.effective_count):
                converged = True
                break
        covariance = np.linalg.pinv(normal, hermitian=True)
        squares = float(white @ white) + biased.feigned(axis)
        return Fit(axis, tuple(free), covariance, squares, converged)


def timing(axis: Axis, free: Sequence[Free]) -> np.ndarray:
    """Which free numbers (k,) say how much later the torque acts: alignment of the log, filters of the drive."""
    return np.array([f.owner == -3 or (f.owner >= 0 and axis.effects[f.owner].term.filters) for f in free], bool)


def rms(x: np.ndarray) -> float:
    """Root of the mean square; of nothing 0."""
    return math.sqrt(float(np.mean(x**2))) if len(x) else 0.0
