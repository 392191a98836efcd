"""The last end of a fit, started from a fit of torques: law, inertia and offset with which predictions are best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tcs_friction.identify.models import LuGreModel
from tcs_friction.identify.prediction import NUISANCES, Fine, ForcedPredictor, LuGrePredictor, Predictor
from tcs_friction.identify.refine import Refined, Space, refine

MOSTLY = 0.5  # of the samples, at least, must be resolved
ROUNDS = 3  # of fits, each with the weights that follow from the one before
LEAST_GAIN = 0.1  # of the cost, whose unit is about half a sample: a step that gains less ends a round
SETTLED = 0.1  # standard deviations: a round that moves nothing farther is the last
SOUND = (0.5, 2.0)  # rms of errors of prediction over what the filter expects
WHITE = 3.5  # standard deviations of the correlation of neighbouring errors, if there is none
LONGEST_DELAY = 0.05  # s
START_RATE = 30.0  # 1/s, of the disturbance
DRIFT = 0.1  # times the disturbance's size, to start with


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


def sharpen(
    fine: Fine, unknowns: np.ndarray, space: Space, residual: float, loss: str,
    cancel: Callable[[], bool],
) -> Sharpened | None:  # fmt: skip
    """Fit predictions, starting from a fit of torques; None where the recording is too coarse for them.

    The law is held at first: a wrong timing would drive it off, into other minima where it has kinks.

    unknowns, space: law, inertia and offset (k + 2,); residual: rms of the fit before, N m.
    """
    wider = widened(space)
    predictor = _predictor(fine, wider)
    resolved = predictor.resolved(unknowns)
    if not resolved.all():
        clear = fine.only(resolved)
        if clear is None or len(clear.position) < MOSTLY * len(fine.position):
            return None
        fine, predictor = clear, _predictor(clear, wider)
    size = max(residual, 1e-9 * float(np.std(fine.torque))) / unknowns[-2]
    start = predictor.tune(np.array([*unknowns, fine.delay, START_RATE, size, DRIFT * size]))
    law = np.arange(len(start)) < len(unknowns) - 2
    for spaces in (*[wider.holding(law)] * 2, *[wider] * ROUNDS):
        predictor.weigh(start)
        fit = refine(
            predictor.linearised, predictor.evaluated, predictor.target, predictor.weights, start, spaces, loss,
            iterations=15, tolerance=LEAST_GAIN / len(predictor.target), cancel=cancel,
        )  # fmt: skip
        power = np.sum(fit.weights[:, None] * fit.jacobian[:, spaces.free] ** 2, axis=0)
        moved = float(np.max(np.abs(fit.unknowns - start)[spaces.free] * np.sqrt(power)))
        start = fit.unknowns
        if (moved < SETTLED and spaces is wider) or cancel():
            break
    return Sharpened(start, wider, fit, predictor.evaluations, predictor)


def _predictor(fine: Fine, space: Space) -> Predictor:
    if isinstance(fine.model, LuGreModel):
        return LuGrePredictor(fine, fine.model, space)
    return ForcedPredictor(fine, space)


def widened(space: Space) -> Space:
    """With delay, rate and size of the disturbance, and size of the drift."""
    return Space(
        np.concatenate([space.lower, [0.0, START_RATE / 30.0, 1e-300, 1e-300]]),
        np.concatenate([space.upper, [LONGEST_DELAY, 1e5, np.inf, np.inf]]),
        np.concatenate([space.logarithmic, [False, True, True, True]]),
        np.concatenate([space.free, [True, True, True, True]]),
    )
