"""Settings of a commissioning."""

from __future__ import annotations

from dataclasses import dataclass

from tcs_friction.control.config_field import setting, switch, text


@dataclass(frozen=True)
class CommissioningConfig:
    """The run that everything is measured on, and how much is tried."""

    reference_file: str = text("azimuth_1p2m_run.yaml", "reference to be tracked better: a path or a name in the config folder")
    measure_file: str = text("azimuth_1p2m_measure.yaml", "reference on which friction is measured")
    diagnose_file: str = text("", "reference to be diagnosed on, as far and fast as the axis may go; none: the runs made so far")
    settle: float = setting(2.0, "s", 0.0, 1e4, "beginning of the run that does not count")
    repetitions: int = setting(1, "", 1, 100, "rounds of identification and compensation when the goal names none")
    diagnoses: int = setting(3, "", 0, 20, "rounds of diagnosis and cancellation; 0: the paper's loop alone")
    trials: int = setting(2, "", 1, 20, "runs by which each way to compensate is judged")
    answer_limit: float = setting(5.0, "s", 0.1, 600.0, "a node that does not answer for so long is missing")
    stall_limit: float = setting(10.0, "s", 0.1, 600.0, "a run that does not advance for so long is given up")
    simulated: bool = switch(True, "the plant is a simulation: start it anew for every run")
    truth: bool = switch(True, "a simulated plant is what the axis file says: compare with it, tell no diagnosis of its effects")

    @property
    def known(self) -> bool:
        """Whether the axis file is the truth about the plant."""
        return self.simulated and self.truth
