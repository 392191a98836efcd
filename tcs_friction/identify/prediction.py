"""How well the next position is predicted, as a least-squares problem.

Least squares of torque against a measured motion is biased where the motion itself is noisy: encoder noise makes the
acceleration too large, and disturbance torque that the controller answers is correlated with the motion it causes. The errors of
one-step predictions have neither fault (Ljung, System Identification, 2nd ed., sections 7.3 and 13.4), and they are white, so
that their scatter says how well the parameters are known. Timing of the torque and spectrum of the disturbance are fitted too.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from tcs_friction.identify import forced_kernel
from tcs_friction.identify import prediction_kernel as kernel
from tcs_friction.identify.models import LuGreModel, Model
from tcs_friction.identify.refine import Space
from tcs_friction.numerics.runs import runs

LEAST_RUN = 100  # samples that follow each other, to predict one from those before
TUNING_SAMPLES = 40_000  # of the disturbance's spectrum before the fit
TUNING_ROUNDS = 16
TUNING_SHIFT = 4e-3  # s
NUISANCES = (
    4  # unknowns beyond law, inertia and offset: delay, rate and size of the disturbance, size of the drift
)
REST = NUISANCES + 2
STIFFEST = 0.5  # rad per sample: bristles that swing faster are not resolved
JUMP = 0.05  # of its range: friction that changes by more within a sample is not resolved
AROUND = LEAST_RUN // 2  # samples on either side that are left out, too
LARGEST, SMALLEST = 1e60, 1e-60
LONGEST_DELAY = 0.05  # s


@dataclass(frozen=True, eq=False)
class Fine:
    """What predictions are made from, at every sample: position rad and torque N m (n,), bounds (s + 1,), step s.

    The torque is the one at the rotor less believed effects, without the believed delay (s); density: rad^2/Hz of the
    encoder's noise. `model` walks through a motion that has these samples at `places` (n,) with `velocity` rad/s (n,),
    `shaken` through the same with the velocity moved by `jitter` rad/s (n,), to and fro so that the way stays the same.
    least: (k,) steps of the law's parameters that move the friction a little where these are zero.
    """

    position: np.ndarray
    torque: np.ndarray
    bounds: np.ndarray
    dt: float
    density: float
    delay: float
    model: Model
    shaken: Model
    places: np.ndarray
    velocity: np.ndarray
    jitter: np.ndarray
    least: np.ndarray

    def only(self, mask: np.ndarray) -> Fine | None:
        """The same with those samples (n,) alone of which enough follow each other; None of none."""
        found = [
            np.arange(a + first, b + first)
            for first, last in itertools.pairwise(self.bounds)
            for a, b in runs(mask[first:last])
            if b - a >= LEAST_RUN
        ]
        if not found:
            return None
        index = np.concatenate(found)
        columns = {
            name: getattr(self, name)[index]
            for name in ("position", "torque", "places", "velocity", "jitter")
        }
        return replace(self, **columns, bounds=np.cumsum([0, *(len(part) for part in found)]))


class Predictor(ABC):
    """Errors of prediction over their standard deviations as a least-squares problem."""

    STEP = 1e-3  # relative, of differences that stand for derivatives

    def __init__(self, fine: Fine, space: Space) -> None:
        self.fine, self._space = fine, space
        start = fine.position[fine.bounds[:-1]]
        lengths = np.diff(fine.bounds)
        self._position = fine.position - np.repeat(start, lengths)
        self._impulse = np.cumsum(fine.torque) * fine.dt
        self._torque = np.ascontiguousarray(fine.torque)
        least = 1e-9 * float(np.ptp(fine.position))
        self.encoder = max(float(np.sqrt(0.5 * fine.density / fine.dt)), least)
        self._size = float(np.std(fine.torque))
        self._deviation = np.ones(len(fine.position))
        self.target, self.weights = np.zeros(len(fine.position)), np.ones(len(fine.position))
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None
        self.evaluations = 0

    @abstractmethod
    def _filter(self, laws: np.ndarray, rest: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        """Fill errors and variances (2, m, n) for laws (m, k) and the rest (m, 7): inertia, offset, delay, rate and size of the
        disturbance, encoder noise, size of the drift."""

    @abstractmethod
    def resolved(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) Where the recording's steps are short against what the axis does; unknowns (k + 2,): law, inertia, offset."""

    def predicted(
        self, unknowns: np.ndarray, encoder: np.ndarray | float, samples: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Errors and variances (m, n) of candidates (m, k + 6) with encoder noise (m,) rad rms; `samples`: of the first alone."""
        rest, drift = unknowns[:, -REST:-1], unknowns[:, -1]
        rest = np.column_stack([rest, np.broadcast_to(encoder, len(unknowns)), drift])
        bounds = self.fine.bounds
        if samples is not None and samples < bounds[-1]:
            bounds = np.array([*bounds[bounds < samples - 2], samples])
        self.evaluations += len(unknowns)
        out = np.empty((2, len(unknowns), int(bounds[-1])))
        self._filter(unknowns[:, :-REST], rest, bounds, out)
        errors, variances = _bounded(out)
        return errors, np.maximum(variances, SMALLEST)

    def weigh(self, unknowns: np.ndarray) -> None:
        """Take the errors' standard deviations from these unknowns."""
        self._deviation = np.sqrt(self.predicted(unknowns[None], self.encoder)[1][0])
        self._last = None

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) errors over their standard deviations, with the sign of a model's output: what should come near `target`."""
        return self.linearised(unknowns)[0]

    def linearised(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same, and its derivatives (n, k + 6) by central differences, where unknowns are free."""
        if self._last is not None and (self._last[0] == unknowns).all():
            return self._last[1]
        moved = np.flatnonzero(self._space.free)
        step = np.diag(self._steps(unknowns))[moved]
        high, low = (
            np.clip(unknowns + side * step, self._space.lower, self._space.upper) for side in (1.0, -1.0)
        )
        errors = self.predicted(np.vstack([unknowns, high, low]), self.encoder)[0]
        apart = (high - low)[np.arange(len(moved)), moved][:, None]
        slopes = np.zeros((len(errors[0]), len(unknowns)))
        slopes[:, moved] = (
            (errors[1 + len(moved) :] - errors[1 : 1 + len(moved)]) / (apart * self._deviation)
        ).T
        self._last = unknowns.copy(), (-errors[0] / self._deviation, slopes)
        return self._last[1]

    def _steps(self, unknowns: np.ndarray) -> np.ndarray:
        step = self.STEP * np.abs(unknowns)
        linear = ~self._space.logarithmic[:-REST]
        step[:-REST][linear] = np.maximum(step[:-REST], self.fine.least)[linear]
        step[1 - REST] = 1e-4 * self._size
        step[-NUISANCES] = 0.02 * self.fine.dt
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


class LuGrePredictor(Predictor):
    """An axis with LuGre friction, whose bristle is predicted with its motion."""

    def __init__(self, fine: Fine, model: LuGreModel, space: Space) -> None:
        super().__init__(fine, space)
        self._model = model

    def _filter(self, laws: np.ndarray, rest: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        candidates = np.column_stack([np.array([self._model.as_lugre(values) for values in laws]), rest])
        kernel.predict(self._position, self._torque, self._impulse, bounds, self.fine.dt, candidates, *out)

    def resolved(self, unknowns: np.ndarray) -> np.ndarray:
        """Everywhere if steps are short against the bristles' own swing and decay, else nowhere."""
        values, inertia = self._model.as_lugre(unknowns[:-2]), unknowns[-2]
        swing, decay = np.sqrt(values[3] / inertia), (values[4] + values[5]) / inertia
        return np.full(len(self.target), max(swing, decay) * self.fine.dt < STIFFEST)


class ForcedPredictor(Predictor):
    """An axis with any law: its friction is computed along the measured motion and drives the axis like any known torque."""

    STEP = 1e-5  # kinks of a law move by more than their standard errors in longer ones

    def __init__(self, fine: Fine, space: Space) -> None:
        super().__init__(fine, space)
        self._rows: dict[bytes, np.ndarray] = {}
        self.slope = np.zeros(len(fine.position))

    def _filter(self, laws: np.ndarray, rest: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        different, law = np.unique(laws, axis=0, return_inverse=True)
        known, self._rows = self._rows, {}
        for values in different:
            key = values.tobytes()
            self._rows[key] = known[key] if key in known else self._friction(self.fine.model, values)
        forced_kernel.predict(
            self._position, self._torque, self._impulse, np.array(list(self._rows.values())), law,
            self.fine.velocity, self.slope, bounds, self.fine.dt, np.ascontiguousarray(rest), *out,
        )  # fmt: skip

    def weigh(self, unknowns: np.ndarray) -> None:
        """Take the slopes of the friction from these unknowns, too."""
        values = unknowns[:-REST]
        moved = self._friction(self.fine.shaken, values) - self._friction(self.fine.model, values)
        self.slope = moved / self.fine.jitter
        super().weigh(unknowns)

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """Without derivatives, each of which is a walk through the whole motion."""
        if self._last is not None and (self._last[0] == unknowns).all():
            return self._last[1][0]
        return np.asarray(-self.predicted(unknowns[None], self.encoder)[0][0] / self._deviation)

    def resolved(self, unknowns: np.ndarray) -> np.ndarray:
        """Away from where friction jumps from sample to sample: what it does there depends on motion between them."""
        friction = self._friction(self.fine.model, unknowns[:-2])
        steps = np.abs(np.diff(friction, prepend=friction[0]))
        steps[self.fine.bounds[1:-1]] = 0.0
        return ~ndimage.binary_dilation(steps > JUMP * np.ptp(friction), iterations=AROUND)

    def _friction(self, model: Model, values: np.ndarray) -> np.ndarray:
        return model.torque(values, np.zeros(0))[self.fine.places]
