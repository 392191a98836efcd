"""What repeats with the motion: a regression of a residual on smooth functions of place, speed, direction and time.

A residual that holds missing physics is no noise. Whatever follows place, speed, direction, acceleration, slow time or a recorded
signal is taken out before the noise is judged; these few dozen functions leave real noise as it is.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from tcs_friction.diagnose.basis import Hats, dense
from tcs_friction.diagnose.condition import Conditioned

SAMPLES_PER_FUNCTION = 60.0  # effective ones, for each node over the position
NODES = (4, 24)  # over the position, fewest and most
STILL = 3.0  # times the velocity noise, that a direction needs


class Reproducible:
    """Projection of series (n,) over the compared samples onto what the train data's motion can repeat."""

    def __init__(self, data: Conditioned) -> None:
        train = data.joined("train")
        columns = _columns(data, train)
        size = np.sqrt(np.mean(columns[train] ** 2, axis=0))
        columns /= np.where(size > 0.0, size, 1.0)
        inner = columns[train].astype(np.float64)
        gram = inner.T @ inner
        self.train = train
        self.columns = columns
        self.inverse = linalg.pinvh(gram, rtol=1e-7)

    def remove(self, x: np.ndarray) -> np.ndarray:
        """The series without its reproducible part, fitted on train data."""
        amounts = self.inverse @ (self.columns[self.train].T @ x[self.train])
        return np.asarray(x - self.columns @ amounts)


def _columns(data: Conditioned, train: np.ndarray) -> np.ndarray:
    """(n, k) in single precision."""
    q, v, a, t = (data.joined(name) for name in ("position", "velocity", "acceleration", "t"))
    effective = float(train.sum()) * min(1.0, 2.0 * data.cutoff * data.dt)
    places = int(min(max(effective / SAMPLES_PER_FUNCTION / 4.0, NODES[0]), NODES[1]))
    direction = np.tanh(v / max(STILL * data.velocity_noise, 1e-300))
    slow = float(np.percentile(np.abs(v), 10)) + STILL * data.velocity_noise
    compressed = np.arcsinh(v / slow)
    parts = [np.stack([v, v * np.abs(v), a, direction * np.abs(a)], axis=1)]
    over_place = _hats("position", q, places)
    parts += [over_place, over_place * direction[:, None]]
    parts += [_hats("velocity", compressed, max(5, places // 2)), _hats("time", t, max(2, places // 2))]
    signals = data.joined("signals")
    for x in signals if data.temperature else signals[1:]:
        spread = float(np.std(x))
        if spread > 0.0:
            z = (x - float(np.mean(x))) / spread
            parts.append(np.stack([z, z * np.abs(z), z * direction, z * v], axis=1))
    return np.concatenate(parts, axis=1, dtype=np.float32)


def _hats(name: str, x: np.ndarray, count: int) -> np.ndarray:
    lower, upper = float(x.min()), float(x.max())
    if not upper - lower > 1e-12 * max(abs(lower), abs(upper), math.ulp(1.0)):
        return np.empty((len(x), 0))
    return dense(Hats(name, lower, upper, count), x)
