"""The test stand: one simulated axis with its controller, on which all experiments of the paper are made."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tcs_friction.config import AxisFile, Control, default_control
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.physics.axis import Axis
from tcs_friction.report.figures import Array, Picture
from tcs_friction.report.html import Html
from tcs_friction.report.runs import DEGREE

TOP_SPEED = 0.1 * DEGREE
"""rad/s, the paper's working speed."""


@dataclass(frozen=True)
class Chapter:
    """A part of the report with its pictures, and the comparisons that belong into the summary."""

    html: Html
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class Stand:
    """An axis file's axis and controller, the tracking run of Table 3, and the seed of all noise."""

    file: AxisFile
    tracking: Reference
    seed: int = 0

    @property
    def axis(self) -> Axis:
        return self.file.axis

    @property
    def control(self) -> Control:
        return self.file.control or default_control(self.file.axis)

    @property
    def settle(self) -> float:
        """s at the start of runs that do not count."""
        return 5.0

    def run(
        self,
        reference: Reference,
        compensation: str = "none",
        feed_back: bool = False,
        compensator: CompensatorConfig | None = None,
        axis: Axis | None = None,
    ) -> LoopRun:
        """The closed loop over a reference; `compensator` defaults to the axis file's."""
        control = self.control
        loop = replace(control.loop, compensation=compensation, feed_back=feed_back)
        observer, parameters = control.observer, compensator or control.compensator
        return simulate_loop(
            axis or self.axis, reference, control.controller, loop, observer, parameters, self.seed
        )

    def sinusoid(self, speed: float, period: float, periods: float) -> Reference:
        """A sinusoid from rest with the given top speed, rad/s."""
        return Reference(Sinusoid(speed * period / (2.0 * np.pi), period, duration=periods * period))


@dataclass(frozen=True)
class Observed:
    """Friction as the observer gives it with its filter's delay taken out, and the plant's own; each (n,)."""

    t: Array
    velocity: Array  # of the reference, rad/s
    friction: Array  # N m
    truth: Array  # N m, all that opposes the motion

    @classmethod
    def of(cls, run: LoopRun, delay: float) -> Observed:
        """From an offline run; `delay` of the observer, s."""
        ticks = round(delay / float(run.t[1] - run.t[0]))
        stop = len(run.t) - ticks
        truth = (run.friction + run.opposing)[:stop]
        return cls(run.t[:stop], run.reference_velocity[:stop], run.friction_estimate[ticks:], truth)

    def relative_error(self, keep: NDArray[np.bool_] | None = None) -> float:
        """RMS of the estimate's error over RMS of the truth."""
        chosen = np.full(len(self.t), True) if keep is None else keep
        error = (self.friction - self.truth)[chosen]
        return float(np.sqrt(np.mean(error**2) / np.mean(self.truth[chosen] ** 2)))
