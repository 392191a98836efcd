"""The 1.2 m telescope in its controller, with torque noise that nobody logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tcs_friction.config import AxisFile, load_axis
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Multisine, Reference, ReferenceConfig
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance
from tcs_friction.recording.recording import Recording


def telescope_file() -> AxisFile:
    return load_axis(Path(__file__).parents[2] / "config" / "azimuth_1p2m.yaml")


class BegunAway(Reference):
    """A reference that is `away` (rad) from where the axis begins."""

    def __init__(self, config: ReferenceConfig, away: float) -> None:
        super().__init__(config)
        self.away = away

    def over(self, times: ArrayLike) -> NDArray[np.float64]:
        samples = super().over(times)
        samples[1:, 0] += self.away
        return samples


def telescope(
    drive_noise: float,
    speed: float,
    start: float = 3.0,
    seed: int = 41,
    away: float = 0.0,
    effects: tuple[Instance, ...] = (),
    duration: float = 200.0,
) -> tuple[Recording, Axis]:
    """A recording from `start` (s) on, and the axis; noise in N m rms up to 60 Hz, speed (rad/s) of eight sines.

    away: rad between where the axis begins and where its reference does.
    """
    file = telescope_file()
    control = file.control
    assert control is not None
    drive = replace(file.axis.drive, noise=drive_noise, noise_bandwidth=60.0)
    plant = replace(file.axis, effects=effects, drive=drive)
    sines = Multisine(speed, lowest_frequency=0.003, frequency_step=0.007, components=8, duration=duration)
    configurations = (control.controller, control.loop, control.observer, control.compensator)
    run = simulate_loop(plant, BegunAway(sines, away), *configurations, seed)
    kept = run.t >= start
    return Recording(run.t[kept], run.position[kept], run.torque[kept], source="simulated"), plant
