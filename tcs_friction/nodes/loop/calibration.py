"""What the observer's node keeps of a run with a dynamometer on the axis, until it is asked to calibrate. No ROS here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import JobError, TcsError
from tcs_friction.identify.dob_acceptance import accepted
from tcs_friction.identify.dob_calibration import Calibration, Comparison, calibrate
from tcs_friction.nodes.core.series import Series

LARGEST_GAP = 10.0
"""Periods between two states that are bridged. Over more the observer would be told of a motion that nobody has seen."""
SHORTEST = 3.0
"""s between two pauses that are worth comparing: the observer settles for one of them."""
RATE_TOLERANCE = 0.05
"""Share by which the states' usual distance may differ from the observer's period: it takes one for the other at every tick."""


class CalibrationMemory:
    """Torque and speed at every tick and the dynamometer's readings, from its first reading on; the newest `seconds`."""

    def __init__(self) -> None:
        self._states = Series(2)
        self._readings = Series(1)

    def configure(self, period: float, seconds: float) -> None:
        """How much is kept."""
        self._period = period
        self._states.limit = self._readings.limit = max(2, round(seconds / period))

    def state(self, stamp: int, torque: float, speed: float) -> None:
        """Torque held until the stamp (ns), speed measured then."""
        if len(self._readings):
            if self._states.stamps and stamp < self._states.stamps[-1]:
                self._readings.clear()  # the clock went back: another run
            self._states.append(stamp, torque, speed)

    @property
    def last_reading(self) -> int:
        """Stamp (ns) of the last reading, -1 before the first."""
        return self._readings.stamps[-1] if len(self._readings) else -1

    def reading(self, stamp: int, torque: float) -> None:
        """What the dynamometer shows."""
        self._readings.append(stamp, torque)

    def comparisons(self) -> list[Comparison]:
        """What was heard, between its pauses. Copied, so that callbacks may go on to append while it is worked on.

        Raises JobError when there is nothing to calibrate with.
        """
        if not len(self._readings):
            raise JobError("calibration", "no reading of a dynamometer heard", "node dynamometer to run")
        t, torque, speed = self._states.arrays()
        known, readings = self._readings.arrays()
        keep = (t >= known[0]) & (t <= known[-1])
        if np.count_nonzero(keep) < 2:
            raise JobError("calibration", "no joint state heard beside the dynamometer", "stamps of the same clock")
        t, torque, speed = t[keep], torque[keep], speed[keep]
        usual = float(np.median(np.diff(t)))
        if abs(usual / self._period - 1.0) > RATE_TOLERANCE:
            raise JobError("calibration", f"joint_states came every {usual:.4g} s", f"the observer's period, {self._period:g} s")
        pauses = np.flatnonzero(np.diff(t) > LARGEST_GAP * self._period) + 1
        found = []
        for part in np.split(np.arange(len(t)), pauses):
            if t[part[-1]] - t[part[0]] < SHORTEST:
                continue
            grid = np.arange(t[part[0]], t[part[-1]], self._period)
            columns = (torque[part], speed[part])
            own = [np.interp(grid, t[part], column) for column in columns]
            found.append(Comparison(grid, own[0], own[1], np.interp(grid, known, readings), "calibration"))
        if not found:
            raise JobError("calibration", f"{len(t)} joint states, none of them", f"{SHORTEST:g} s of them without a pause")
        return found


def calibrated(comparisons: Sequence[Comparison], observer: ObserverSettings) -> Calibration:
    """The observer calibrated. Raises JobError when the data does not do, or when what comes of it is no calibration."""
    try:
        return accepted(calibrate(comparisons, observer))
    except TcsError as error:
        raise JobError(error.where, f"{error.found}; nothing was changed", error.expected) from None
