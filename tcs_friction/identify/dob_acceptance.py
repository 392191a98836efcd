"""Whether a calibration against a dynamometer is one: the two agree with it, and no worse than without it."""

from __future__ import annotations

import numpy as np

from tcs_friction.control.observer import Array
from tcs_friction.errors import JobError
from tcs_friction.identify.dob_calibration import BLOCK, Calibration

LEAST_ACCURACY = 0.9
"""Of observer against dynamometer, in uniform motion and over everything: the paper reaches 0.97. Below, the two do not measure
the same torque, or the stamps are not the time at which it acted."""
BY_CHANCE = 1.645
"""Standard deviations that a normal number exceeds once in twenty."""


def accepted(found: Calibration) -> Calibration:
    """The calibration itself. Raises JobError when observer and dynamometer still do not agree, or agree less than before."""
    shares = f"{100.0 * found.accuracy_uniform:.2f} % in uniform motion, {100.0 * found.accuracy:.2f} % over everything"
    if not min(found.accuracy_uniform, found.accuracy) >= LEAST_ACCURACY:
        words = f"observer and dynamometer agree to {shares} at best"
        raise JobError("calibration", words, f"at least {100.0 * LEAST_ACCURACY:g} %")
    if _worse(found):
        before = f"{100.0 * found.accuracy_before:.2f} % over everything before"
        raise JobError("calibration", f"observer and dynamometer agree to {shares}, worse than the {before}")
    return found


def _worse(found: Calibration) -> bool:
    """Whether the mean square error has grown by more than its scatter over blocks of time explains."""
    square = (found.after - found.measured) ** 2
    growth = float(np.mean(square) - np.mean((found.before - found.measured) ** 2))
    means = _over_blocks(square, max(1, round(BLOCK / float(np.median(np.diff(found.t))))))
    return growth > BY_CHANCE * float(np.std(means, ddof=1)) / np.sqrt(len(means))


def _over_blocks(values: Array, size: int) -> Array:
    """(n // size,) means of (n,) values over whole blocks of `size`."""
    count = len(values) // size
    return values[: count * size].reshape(count, size).mean(axis=1)
