"""The part of a residual that repeats with the motion.

In: a residual (n,), N m. Out: the same without what smooth functions of place, speed, direction, acceleration, slow time and
recorded signals explain, by ordinary least squares on the train data. A residual that holds missing physics is no noise; what
repeats is taken out before the noise is estimated. These few dozen functions leave real noise as it is.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg, sparse

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose.dataset.basis import hats

SAMPLES_PER_NODE = 60.0  # effective ones, for each node over the position: the fit takes less than 2 % of the noise
FEWEST_NODES, MOST_NODES = 4, 24  # over the position


class RepeatablePart:
    """Projection of series (n,) over the compared samples onto what the train data's motion can repeat."""

    def __init__(self, data: DataSet, train: np.ndarray) -> None:
        self.train = train
        self.columns = _columns(data, train)
        size = np.sqrt(np.asarray(self.columns.multiply(self.columns).mean(axis=0))).ravel()
        self.columns = self.columns @ sparse.diags_array(1.0 / np.where(size > 0.0, size, 1.0))
        self.inverse = linalg.pinvh((self.columns.T @ self.columns).toarray(), rtol=1e-7)

    def remove(self, x: np.ndarray) -> np.ndarray:
        """The series (n,) without its repeatable part in the train data; elsewhere as it is."""
        seen, left = x[self.train], x.copy()
        left[self.train] = seen - self.columns @ (self.inverse @ (self.columns.T @ seen))
        return left


def _columns(data: DataSet, train: np.ndarray) -> sparse.csr_array:
    """(train samples, k)."""
    q, v, a, t = (data.joined(name)[train] for name in ("position", "velocity", "acceleration", "t"))
    effective = len(q) * min(1.0, 2.0 * data.cutoff * data.dt)
    places = int(min(max(effective / SAMPLES_PER_NODE / 4.0, FEWEST_NODES), MOST_NODES))
    direction = np.tanh(v / max(data.speed_threshold, 1e-300))
    slow = float(np.percentile(np.abs(v), 10)) + data.speed_threshold
    compressed = np.arcsinh(v / slow)
    smooth = [v, v * np.abs(v), a, direction * np.abs(a)]
    signals = data.joined("signals")[:, train]
    for x in signals if data.temperature else signals[1:]:
        spread = float(np.std(x))
        if spread > 0.0:
            z = (x - float(np.mean(x))) / spread
            smooth += [z, z * np.abs(z), z * direction, z * v]
    over_place = hats(q, places)
    parts = [over_place, sparse.diags_array(direction) @ over_place]
    parts += [hats(compressed, max(5, places // 2)), hats(t, max(2, places // 2))]
    return sparse.csr_array(sparse.hstack([sparse.csr_array(np.stack(smooth, axis=1)), *parts]))
