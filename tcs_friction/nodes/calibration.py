"""What the observer's node keeps of a run with a dynamometer on the axis, until it is asked to calibrate. No ROS here."""

from __future__ import annotations

import numpy as np

from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.errors import JobError
from tcs_friction.identify.dob_calibration import Calibration, Comparison, calibrate
from tcs_friction.nodes.series import Series


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

    def reading(self, stamp: int, torque: float) -> None:
        """What the dynamometer shows."""
        self._readings.append(stamp, torque)

    def calibrate(self, observer: ObserverSettings) -> Calibration:
        """Raises JobError when there is nothing to calibrate with, InputError when that does not do."""
        if not len(self._readings):
            raise JobError("calibration", "no reading of a dynamometer heard", "node dynamometer to run")
        t, torque, speed = self._states.arrays()
        known, readings = self._readings.arrays()
        keep = (t >= known[0]) & (t <= known[-1])
        if np.count_nonzero(keep) < 2:
            raise JobError("calibration", "no joint state heard beside the dynamometer", "stamps of the same clock")
        t = t[keep]
        grid = t[0] + self._period * np.arange(round((t[-1] - t[0]) / self._period) + 1)
        columns = (np.interp(grid, t, torque[keep]), np.interp(grid, t, speed[keep]), np.interp(grid, known, readings))
        return calibrate([Comparison(grid, *columns, "calibration")], observer)
