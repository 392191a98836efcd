"""The last end of a fit: parameters with which the next position is predicted best.

Least squares of torque against a measured motion is biased where the motion itself is noisy: encoder noise makes the
acceleration too large, and disturbance torque that the controller answers is correlated with the motion it causes. The errors of
one-step predictions have neither fault (Ljung, System Identification, 2nd ed., sections 7.3 and 13.4), and they are white, so
that their scatter says how well the parameters are known. Timing of the torque and spectrum of the disturbance are fitted too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.identify import prediction_kernel as kernel
from tcs_friction.identify.models import LuGreModel
from tcs_friction.identify.refine import Refined, Space, refine

MOST_SAMPLES, WINDOW = 400_000, 20_000  # samples that are predicted, and windows of a recording that has more
LEAST_WINDOW = 100  # samples
TUNING_SAMPLES = 40_000  # of the disturbance's spectrum before the fit
TUNING_ROUNDS = 16
TUNING_SHIFT = 4e-3  # s
ROUNDS = 3  # of fits, each with the weights that follow from the one before
NUISANCES = (
    4  # unknowns beyond law, inertia and offset: delay, rate and size of the disturbance, size of the drift
)
REST = NUISANCES + 2
LEAST_GAIN = 0.1  # of the cost, whose unit is about half a sample: a step that gains less ends a round
SETTLED = 0.1  # standard deviations: a round that moves nothing farther is the last
STIFFEST = 0.5  # rad per sample: bristles that swing faster are not resolved
SOUND = (0.5, 2.0)  # rms of errors of prediction over what the filter expects
WHITE = 3.5  # standard deviations of the correlation of neighbouring errors, if there is none
LARGEST, SMALLEST = 1e60, 1e-60
LONGEST_DELAY = 0.05  # s
START_RATE = 30.0  # 1/s, of the disturbance
DRIFT = 0.1  # times the disturbance's size, to start with


@dataclass(frozen=True, eq=False)
class Fine:
    """What predictions are made from, at every sample: position rad and torque N m (n,), bounds (s + 1,), step s.

    The torque is the one at the rotor less believed effects, without the believed delay (s); density: rad^2/Hz of the
    encoder's noise.
    """

    position: np.ndarray
    torque: np.ndarray
    bounds: np.ndarray
    dt: float
    density: float
    delay: float

    def windows(self, samples: int, length: int) -> Fine:
        """The same, or, where there are more samples, windows of that length spread over it, about so many samples."""
        count = len(self.position)
        if count <= samples:
            return self
        wanted = max(1, samples // length)
        places = [
            np.arange(a, min(a + length, stop))
            for start, stop in zip(self.bounds[:-1], self.bounds[1:], strict=True)
            for a in range(int(start), int(stop), max(length, round(count / wanted)))
        ]
        kept = [place for place in places if len(place) >= LEAST_WINDOW]
        index = np.concatenate(kept)
        bounds = np.cumsum([0, *(len(place) for place in kept)])
        return replace(self, position=self.position[index], torque=self.torque[index], bounds=bounds)


@dataclass(frozen=True, eq=False)
class Sharpened:
    """A fit of predictions.

    unknowns (k + 6,): law, inertia, offset, delay s, rate 1/s and size of the disturbance, size of the drift, both rad/s^2 rms.
    fit: of the errors of prediction.
    """

    unknowns: np.ndarray
    space: Space
    fit: Refined
    evaluations: int
    aim: Predictor

    @property
    def delay(self) -> float:
        """s by which the torque acts after its stamp."""
        return float(self.unknowns[-NUISANCES])

    @property
    def sound(self) -> bool:
        """Whether the errors of prediction are as large as the filter expects, and white: else it lacks something."""
        errors = self.fit.residual
        power = float(np.mean(errors**2))
        if not SOUND[0] ** 2 < power < SOUND[1] ** 2:
            return False
        return bool(abs(float(np.mean(errors[1:] * errors[:-1]))) < WHITE * power / np.sqrt(len(errors)))


class Predictor:
    """Errors of prediction over their standard deviations as a least-squares problem."""

    def __init__(self, fine: Fine, model: LuGreModel, logarithmic: np.ndarray, speed: float) -> None:
        self._fine, self._model, self._logarithmic = fine, model, logarithmic
        start = fine.position[fine.bounds[:-1]]
        lengths = np.diff(fine.bounds)
        self._position = fine.position - np.repeat(start, lengths)
        self._impulse = np.cumsum(fine.torque) * fine.dt
        self._torque = np.ascontiguousarray(fine.torque)
        least = 1e-9 * float(np.ptp(fine.position))
        self.encoder = max(float(np.sqrt(0.5 * fine.density / fine.dt)), least)
        self._scale = float(np.std(fine.torque)), max(speed, 1e-300)
        self._deviation = np.ones(len(fine.position))
        self.target, self.weights = np.zeros(len(fine.position)), np.ones(len(fine.position))
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None
        self.evaluations = 0

    def predicted(
        self, unknowns: np.ndarray, encoder: np.ndarray | float, samples: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Errors and variances (m, n) of candidates (m, k + 6) with encoder noise (m,) rad rms; `samples`: of the first alone."""
        laws = np.array([self._model.as_lugre(values) for values in unknowns[:, :-REST]])
        rest, drift = unknowns[:, -REST:-1], unknowns[:, -1]
        candidates = np.column_stack([laws, rest, np.broadcast_to(encoder, len(unknowns)), drift])
        bounds = self._fine.bounds
        if samples is not None and samples < bounds[-1]:
            bounds = np.array([*bounds[bounds < samples - 2], samples])
        self.evaluations += len(unknowns)
        errors = np.empty((len(unknowns), int(bounds[-1])))
        variances = np.empty_like(errors)
        kernel.predict(
            self._position, self._torque, self._impulse, bounds, self._fine.dt, candidates, errors, variances
        )
        return _bounded(errors), np.maximum(_bounded(variances), SMALLEST)

    def weigh(self, unknowns: np.ndarray) -> None:
        """Take the errors' standard deviations from these unknowns."""
        self._deviation = np.sqrt(self.predicted(unknowns[None], self.encoder)[1][0])
        self._last = None

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) errors over their standard deviations, with the sign of a model's output: what should come near `target`."""
        return self.linearised(unknowns)[0]

    def linearised(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same, and its derivatives (n, k + 6) by central differences: all candidates cost little more than one."""
        if self._last is not None and (self._last[0] == unknowns).all():
            return self._last[1]
        step = self._steps(unknowns)
        high, low = unknowns + np.diag(step), unknowns - np.diag(step)
        late = len(unknowns) - NUISANCES
        low[late, late] = max(low[late, late], 0.0)
        count = len(unknowns)
        errors = self.predicted(np.vstack([unknowns, high, low]), self.encoder)[0]
        apart = (np.diag(high) - np.diag(low))[:, None]
        slopes = (errors[1 + count :] - errors[1 : 1 + count]) / (apart * self._deviation)
        self._last = unknowns.copy(), (-errors[0] / self._deviation, slopes.T)
        return self._last[1]

    def _steps(self, unknowns: np.ndarray) -> np.ndarray:
        torque, speed = self._scale
        step = 1e-3 * np.abs(unknowns)
        linear = ~self._logarithmic[:-REST]
        step[:-REST][linear] = np.maximum(step[:-REST][linear], 1e-4 * torque / speed)
        step[1 - REST] = 1e-4 * torque
        step[-NUISANCES] = 0.02 * self._fine.dt
        return step

    def tune(self, unknowns: np.ndarray) -> np.ndarray:
        """Encoder noise, rate and size of the disturbance, and size of the drift, stepping by factors, and the delay, by
        maximum likelihood. The delay's has several maxima: a fit finds only the nearest."""
        point, factor, shift, best = np.array([*unknowns, self.encoder]), 4.0, TUNING_SHIFT, np.inf
        for _ in range(TUNING_ROUNDS):
            trials = np.tile(point, (11, 1))
            for k in range(8):
                trials[1 + k, -1 - k // 2] *= factor if k % 2 else 1.0 / factor
            trials[9:, -5] = np.clip(point[-5] + np.array([shift, -shift]), 0.0, LONGEST_DELAY)
            errors, variances = self.predicted(trials[:, :-1], trials[:, -1], TUNING_SAMPLES)
            costs = 0.5 * np.sum(errors**2 / variances + np.log(variances), axis=1)
            least = int(np.nanargmin(costs)) if np.isfinite(costs).any() else 0
            if least == 0 or not costs[least] < best:
                factor, shift = np.sqrt(factor), 0.5 * shift
            point, best = trials[least], costs[least]
        self.encoder = float(point[-1])
        return point[:-1]


def _bounded(values: np.ndarray) -> np.ndarray:
    """The same array with what an unstable candidate made of it large but finite."""
    np.clip(values, -LARGEST, LARGEST, out=values)
    values[np.isnan(values)] = LARGEST
    return values


def resolvable(fine: Fine, model: LuGreModel, law: np.ndarray, inertia: float) -> bool:
    """Whether steps of the recording are short against the bristles' own swing and decay."""
    values = model.as_lugre(law)
    swing, decay = np.sqrt(values[3] / inertia), (values[4] + values[5]) / inertia
    return bool(max(swing, decay) * fine.dt < STIFFEST)


def sharpen(
    fine: Fine, model: LuGreModel, unknowns: np.ndarray, space: Space, residual: float, speed: float, loss: str,
    cancel: Callable[[], bool],
) -> Sharpened:  # fmt: skip
    """Fit predictions, starting from a fit of torques.

    unknowns, space: law, inertia and offset (k + 2,); residual: rms of the fit before, N m; speed: the highest, rad/s.
    """
    fine = fine.windows(MOST_SAMPLES, WINDOW)
    wider = _widened(space)
    predictor = Predictor(fine, model, wider.logarithmic, speed)
    size = max(residual, 1e-9 * float(np.std(fine.torque))) / unknowns[-2]
    start = predictor.tune(np.array([*unknowns, fine.delay, START_RATE, size, DRIFT * size]))
    for _ in range(ROUNDS):
        predictor.weigh(start)
        fit = refine(
            predictor.linearised, predictor.evaluated, predictor.target, predictor.weights, start, wider, loss,
            iterations=15, tolerance=LEAST_GAIN / len(predictor.target), cancel=cancel,
        )  # fmt: skip
        power = np.sum(fit.weights[:, None] * fit.jacobian[:, wider.free] ** 2, axis=0)
        moved = float(np.max(np.abs(fit.unknowns - start)[wider.free] * np.sqrt(power)))
        start = fit.unknowns
        if moved < SETTLED or cancel():
            break
    return Sharpened(start, wider, fit, predictor.evaluations, predictor)


def _widened(space: Space) -> Space:
    """With delay, rate and size of the disturbance, and size of the drift."""
    return Space(
        np.concatenate([space.lower, [0.0, START_RATE / 30.0, 1e-300, 1e-300]]),
        np.concatenate([space.upper, [LONGEST_DELAY, 1e5, np.inf, np.inf]]),
        np.concatenate([space.logarithmic, [False, True, True, True]]),
        np.concatenate([space.free, [True, True, True, True]]),
    )
