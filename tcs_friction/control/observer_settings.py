"""The one configuration of a friction observer, whichever its design: the same settings, the same interface."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tcs_friction.control.config_field import choice, setting, validate
from tcs_friction.control.dob import dob_delay, dob_design
from tcs_friction.control.kalman import kalman_delay, kalman_design
from tcs_friction.control.observer import Design, NominalPlant

DOB, KALMAN = "dob", "kalman"


@dataclass(frozen=True)
class ObserverSettings:
    """Nominal plant, filter, known delays, and what calibration against a dynamometer has found of the torque."""

    plant: NominalPlant = field(default_factory=NominalPlant)
    bandwidth: float = setting(10.0, "Hz", 0.01, 1000.0, "cut-off frequency of the estimate")
    estimator: str = choice(
        DOB, (DOB, KALMAN), "disturbance observer with Q filter, or Luenberger with Kalman gain"
    )
    actuation_delay: float = setting(
        0.0, "s", 0.0, 0.1, "known delay between the logged torque and its action"
    )
    velocity_delay: float = setting(0.0, "s", 0.0, 0.1, "known delay of the measured speed (its filter)")
    torque_scale: float = setting(1.0, "1", 0.01, 100.0, "torque that acts over torque that is logged")
    torque_offset: float = setting(0.0, "N m", -1e9, 1e9, "torque that acts while the logged one is 0")

    def validate(self, where: str = "observer") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)

    @property
    def filter_delay(self) -> float:
        """Delay of the estimate at low frequency (s): that of its filter and that of the measured speed."""
        own = dob_delay(self.bandwidth) if self.estimator == DOB else kalman_delay(self.plant, self.bandwidth)
        return own + self.velocity_delay

    @property
    def estimate_filter(self) -> tuple[float, float]:
        """By how much the estimate is later than the measured speed (s), and the bandwidth (Hz) of Q, which has its own lag.

        What an identification has to know; the Kalman observer's filter counts as a delay.
        """
        if self.estimator == DOB:
            return 0.0, self.bandwidth
        return kalman_delay(self.plant, self.bandwidth), 0.0

    def design(self, dt: float) -> Design:
        """The observer's matrices for a tick of `dt` seconds."""
        make = dob_design if self.estimator == DOB else kalman_design
        # the torque waits for the late speed, so that both speak of the same moment
        made = make(self.plant, self.bandwidth, self.actuation_delay + self.velocity_delay, dt)
        return replace(made, torque_scale=self.torque_scale, torque_offset=self.torque_offset)
