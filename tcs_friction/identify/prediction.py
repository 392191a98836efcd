"""How well the next position is predicted, as a least-squares problem.

Least squares of torque against a measured motion is biased where the motion itself is noisy: encoder noise makes the
acceleration too large, and disturbance torque that the controller answers is correlated with the motion it causes. The errors of
one-step predictions have neither fault (Ljung, System Identification, 2nd ed., sections 7.3 and 13.4), and they are white, so
that their scatter says how well the parameters are known. Timing of the torque and spectrum of the disturbance are fitted too.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod

import numpy as np
from scipy import ndimage

from tcs_friction.identify import forced_kernel
from tcs_friction.identify import prediction_kernel as kernel
from tcs_friction.identify.fine import LEAST_RUN, Fine
from tcs_friction.identify.models import LuGreModel, Model
from tcs_friction.identify.refine import Space

TUNING_SAMPLES = 20_000  # of the disturbance's spectrum before the fit
TUNING_ROUNDS = 16
TUNING_SHIFT = 2.0  # periods: between the two ends of one lies what is not known of a log
INERTIA, OFFSET, LATENESS = -7, -6, -5  # of the unknowns, after those of the law: kg m^2, N m, s
RATE, SIZE, DRIFT = -4, -3, -2  # 1/s and rad/s^2 of the disturbance, rad/s^2 of its slow drift
MISSED = -1  # share of the torque's changes that acts besides, because the log does not show it
NUISANCES, REST = -RATE, -INERTIA  # how many stand at the end
FORGOTTEN = 0.1  # standard deviations of a prediction, by which it may depend on what was before the recording
FINEST = 0.1  # rad that bristles swing in a step: that misses 3e-5 of their stiffness at 0.7 of critical damping, 6e-7 at none
MOST_SUBSTEPS, STIFFEST = 32, 0.5  # of a period; rad per step: bristles that swing faster are not resolved
JUMP = 0.05  # of its range: friction that changes by more within a sample is not resolved
AROUND = LEAST_RUN // 2  # samples on either side that are left out, too
LARGEST, SMALLEST = 1e60, 1e-60


class Predictor(ABC):
    """Errors of prediction over their standard deviations as a least-squares problem."""

    STEP = 1e-3  # relative, of differences that stand for derivatives

    def __init__(self, fine: Fine, space: Space, substeps: int) -> None:
        self.fine, self.space = fine, space
        samples = fine.samples
        start = samples.position[samples.bounds[:-1]]
        self._position = samples.position - np.repeat(start, np.diff(samples.bounds))
        self._walk = fine.walked(substeps)
        self._rough = fine.rough(self._walk)
        self._pushed: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        least = 1e-9 * float(np.ptp(samples.position))
        self.encoder = max(float(np.sqrt(0.5 * fine.density / fine.period)), least)
        self._deviation = np.ones(len(samples))
        self.target, self.weights = np.zeros(len(samples)), np.ones(len(samples))
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None
        self.evaluations = 0

    def _pushes(self, lateness: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pushes and moves (l, q) of the different latenesses among (m,), s, and which of them each has (m,)."""
        different, row = np.unique(lateness, return_inverse=True)
        known, self._pushed = self._pushed, {}
        for value in different.tolist():
            self._pushed[value] = known[value] if value in known else self.fine.pushed(self._walk, value)
        pushes, moves = (np.array(rows) for rows in zip(*self._pushed.values(), strict=True))
        return pushes, moves, row

    @abstractmethod
    def _filter(self, unknowns: np.ndarray, encoder: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        """Fill errors and variances (2, m, n) for candidates (m, k + 7) with encoder noise (m,) rad rms."""

    @abstractmethod
    def resolved(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) Where the recording's steps are short against what the axis does; unknowns (k + 2,): law, inertia, offset."""

    @property
    def swing(self) -> float:
        """rad/s, of the fastest swing or decay that the friction has of its own; 0: none is predicted."""
        return 0.0

    def finer(self, unknowns: np.ndarray) -> Predictor:  # noqa: ARG002
        """The same with steps as fine as these unknowns (k + 7,) ask for; itself if they are."""
        return self

    def predicted(
        self, unknowns: np.ndarray, encoder: np.ndarray | float, samples: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Errors and variances (m, n) of candidates (m, k + 7) with encoder noise (m,) rad rms; `samples`: of the first alone."""
        bounds = self.fine.samples.bounds
        if samples is not None and samples < bounds[-1]:
            bounds = np.array([*bounds[bounds < samples - 2], samples])
        self.evaluations += len(unknowns)
        out = np.empty((2, len(unknowns), int(bounds[-1])))
        self._filter(unknowns, np.broadcast_to(encoder, len(unknowns)), bounds, out)
        errors, variances = _bounded(out)
        return errors, np.maximum(variances, SMALLEST)

    def weigh(self, unknowns: np.ndarray) -> None:
        """Take the errors' standard deviations from these unknowns."""
        self._believe(self.predicted(unknowns[None], self.encoder)[1][0])

    def _believe(self, variances: np.ndarray) -> None:
        """Take the errors' standard deviations from these variances (n,)."""
        self._deviation = np.sqrt(variances)
        self._last = None

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) errors over their standard deviations, with the sign of a model's output: what should come near `target`."""
        return self.linearised(unknowns)[0]

    def linearised(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same, and its derivatives (n, k + 7) by differences, where unknowns are free.

        Differences to one side: a candidate costs as much as the fit's own point, and a relative step of STEP bends nothing.
        """
        if self._last is not None and (self._last[0] == unknowns).all():
            return self._last[1]
        moved = np.flatnonzero(self.space.free)
        step = self._steps(unknowns)[moved]
        step = np.where(unknowns[moved] + step > self.space.upper[moved], -step, step)
        candidates = np.tile(unknowns, (1 + len(moved), 1))
        candidates[1 + np.arange(len(moved)), moved] += step
        errors = self.predicted(candidates, self.encoder)[0]
        slopes = np.zeros((len(errors[0]), len(unknowns)))
        slopes[:, moved] = ((errors[1:] - errors[0]) / (step[:, None] * self._deviation)).T
        self._last = unknowns.copy(), (-errors[0] / self._deviation, -slopes)
        return self._last[1]

    def _steps(self, unknowns: np.ndarray) -> np.ndarray:
        step = self.STEP * np.abs(unknowns)
        linear = ~self.space.logarithmic[:-REST]
        step[:-REST][linear] = np.maximum(step[:-REST], self.fine.least)[linear]
        step[OFFSET] = 1e-4 * self.fine.size
        step[LATENESS] = 0.02 * self.fine.period
        return step

    def likelihood(self, unknowns: np.ndarray, encoder: np.ndarray, samples: int | None = None) -> np.ndarray:
        """(m,) minus its logarithm, of candidates (m, k + 7) with encoder noise (m,)."""
        scores = _scores(*self.predicted(unknowns, encoder, samples))
        return np.asarray(scores @ self.weights[: scores.shape[1]])

    def scores(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) minus the logarithm of each sample's likelihood; NaN of samples that are left out."""
        (scores,) = _scores(*self.predicted(unknowns[None], self.encoder))
        return np.where(self.weights > 0.0, scores, np.nan)

    def scaled(self, unknowns: np.ndarray, factor: float) -> np.ndarray:
        """Unknowns (k + 7,) with all noises so many times as large: the likeliest ones where errors are that much larger."""
        self.encoder *= factor
        scaled = unknowns.copy()
        scaled[[SIZE, DRIFT, MISSED]] *= factor
        return scaled

    def tune(self, unknowns: np.ndarray, near: bool = False) -> np.ndarray:
        """Encoder noise and nuisances, stepping by factors, and the lateness, by maximum likelihood. The lateness' has several
        maxima: a fit finds only the nearest. `near`: all have been tuned before."""
        point, best = np.array([*unknowns, self.encoder]), np.inf
        factor, shift = (1.5, 0.1 * self.fine.period) if near else (4.0, TUNING_SHIFT * self.fine.period)
        self.weigh(unknowns)
        factors = [-1, *(k - 1 for k in (RATE, SIZE, DRIFT, MISSED) if self.space.free[k])]
        late, moves = LATENESS - 1, bool(self.space.free[LATENESS])
        earliest, latest = self.space.lower[LATENESS], self.space.upper[LATENESS]
        for _ in range(TUNING_ROUNDS):
            trials = [point]
            for k in factors:
                trials += [_moved(point, k, point[k] * factor), _moved(point, k, point[k] / factor)]
            if moves:
                trials += [_moved(point, late, np.clip(point[late] + way, earliest, latest)) for way in (shift, -shift)]
            costs = self.likelihood(np.array(trials)[:, :-1], np.array(trials)[:, -1], TUNING_SAMPLES)
            least = int(np.nanargmin(costs)) if np.isfinite(costs).any() else 0
            if least == 0 or not costs[least] < best:
                factor, shift = np.sqrt(factor), 0.5 * shift
            point, best = trials[least], costs[least]
        self.encoder = float(point[-1])
        return point[:-1]


def _moved(point: np.ndarray, k: int, value: float) -> np.ndarray:
    moved = point.copy()
    moved[k] = value
    return moved


def _rest(unknowns: np.ndarray, encoder: np.ndarray) -> np.ndarray:
    """(m, 7) of candidates what a filter reads after the law: inertia, offset, rate, size, encoder noise, drift, missed."""
    return np.column_stack([unknowns[:, [INERTIA, OFFSET, RATE, SIZE]], encoder, unknowns[:, [DRIFT, MISSED]]])


def _scores(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(m, n) minus the logarithms of likelihoods of normal errors, but for a constant."""
    return np.asarray(0.5 * (errors**2 / variances + np.log(variances)))


def _bounded(values: np.ndarray) -> np.ndarray:
    """The same array with what an unstable candidate made of it large but finite."""
    np.clip(values, -LARGEST, LARGEST, out=values)
    values[np.isnan(values)] = LARGEST
    return values


def _steps_for(turn: float, finest: float) -> int:
    """Into how many steps a period is divided in which bristles swing by `turn` rad."""
    return int(np.clip(np.ceil(turn / finest), 1, MOST_SUBSTEPS))


class LuGrePredictor(Predictor):
    """An axis with LuGre friction, whose bristle is predicted with its motion."""

    def __init__(self, fine: Fine, model: LuGreModel, space: Space, unknowns: np.ndarray, finest: float = FINEST) -> None:
        self._model, self._unsure = model, np.ones(1)
        self._turn = self._fastest(unknowns) * fine.period
        self._substeps = _steps_for(self._turn, finest)
        super().__init__(fine, space, self._substeps)

    @property
    def swing(self) -> float:
        return self._turn / self.fine.period

    def finer(self, unknowns: np.ndarray) -> Predictor:
        needed = _steps_for(self._fastest(unknowns[: -NUISANCES]) * self.fine.period, FINEST)
        if needed <= self._substeps:
            return self
        return LuGrePredictor(self.fine, self._model, self.space, unknowns[: -NUISANCES])

    def _fastest(self, unknowns: np.ndarray) -> float:
        """rad/s, of the bristles' own swing or decay; unknowns (k + 3,): law, inertia, offset, lateness."""
        values, inertia = self._model.as_lugre(unknowns[:-3]), unknowns[-3]
        return float(max(np.sqrt(values[3] / inertia), (values[4] + values[5]) / inertia))

    def _filter(self, unknowns: np.ndarray, encoder: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        laws = np.array([self._model.as_lugre(values) for values in unknowns[:, :-REST]])
        candidates = np.column_stack([laws, _rest(unknowns, encoder), np.broadcast_to(self._unsure, len(laws))])
        pushes, moves, row = self._pushes(unknowns[:, LATENESS])
        kernel.predict(
            self._position, bounds, self._walk.firsts, self._walk.steps, pushes, moves, self._rough, row, candidates, *out
        )

    def weigh(self, unknowns: np.ndarray) -> None:
        """Leave out, too, what depends on how a bristle was bent before the recording: a filter of that would not be linear."""
        self._unsure = np.array([1.0, 0.0])
        (errors, relaxed), variances = self.predicted(np.tile(unknowns, (2, 1)), self.encoder)
        self._unsure = np.ones(1)
        self._believe(variances[0])
        bounds, part = self.fine.samples.bounds, np.zeros(len(self.target), dtype=bool)
        apart = np.abs(errors - relaxed) > FORGOTTEN * self._deviation
        for first, last in itertools.pairwise(bounds):
            late = np.flatnonzero(apart[first : first + (last - first) // 5])
            part[first : first + (late[-1] + 1 if len(late) else 0)] = True
        self.weights = np.where(part, 0.0, 1.0)

    def resolved(self, unknowns: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Everywhere if steps are short against the bristles' own swing and decay, else nowhere."""
        return np.full(len(self.target), self._turn < STIFFEST * MOST_SUBSTEPS)


class ForcedPredictor(Predictor):
    """An axis with any law: its friction is computed along the measured motion and drives the axis like any known torque."""

    STEP = 1e-5  # kinks of a law move by more than their standard errors in longer ones

    def __init__(self, fine: Fine, space: Space) -> None:
        super().__init__(fine, space, substeps=0)
        self._rows: dict[bytes, np.ndarray] = {}
        self.slope = np.zeros(len(fine.samples))
        self._velocity, self._jitter = fine.samples.at(fine.velocity), fine.jitter

    def _filter(self, unknowns: np.ndarray, encoder: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
        different, law = np.unique(unknowns[:, :-REST], axis=0, return_inverse=True)
        known, self._rows = self._rows, {}
        for values in different:
            key = values.tobytes()
            self._rows[key] = known[key] if key in known else self._friction(self.fine.model, values)
        pushes, moves, row = self._pushes(unknowns[:, LATENESS])
        forced_kernel.predict(
            self._position, bounds, self.fine.samples.steps, self._at_samples(pushes), self._at_samples(moves),
            self._at_samples(self._rough[None])[0], row, np.array(list(self._rows.values())),
            law.ravel(), self._velocity, self.slope, _rest(unknowns, encoder), *out,
        )  # fmt: skip

    def _at_samples(self, rows: np.ndarray) -> np.ndarray:
        """Rows (l, q) of the walk's steps as rows (l, n) over the step from each sample on; at the end of a run there is none."""
        wide = np.zeros((len(rows), len(self.target)))
        wide[:, self._walk.counted] = rows
        return wide

    def weigh(self, unknowns: np.ndarray) -> None:
        """Take the slopes of the friction from these unknowns, too."""
        values = unknowns[:-REST]
        moved = self.fine.shaken.torque(values, np.zeros(0)) - self.fine.model.torque(values, np.zeros(0))
        self.slope = self.fine.samples.at(moved / self._jitter)
        super().weigh(unknowns)

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """Without derivatives, each of which is a walk through the whole motion."""
        if self._last is not None and (self._last[0] == unknowns).all():
            return self._last[1][0]
        return np.asarray(-self.predicted(unknowns[None], self.encoder)[0][0] / self._deviation)

    def resolved(self, unknowns: np.ndarray) -> np.ndarray:
        """Away from where friction jumps from sample to sample: what it does there depends on motion between them."""
        friction = self._friction(self.fine.model, unknowns[:-3])
        steps = np.abs(np.diff(friction, prepend=friction[0]))
        steps[self.fine.samples.bounds[1:-1]] = 0.0
        return ~ndimage.binary_dilation(steps > JUMP * np.ptp(friction), iterations=AROUND)

    def _friction(self, model: Model, values: np.ndarray) -> np.ndarray:
        return self.fine.samples.at(model.torque(values, np.zeros(0)))
