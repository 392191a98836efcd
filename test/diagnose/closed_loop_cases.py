"""The 1.2 m telescope in its controller, with torque noise that nobody logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tcs_friction.config import AxisFile, load_axis
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Multisine, Reference
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording


def telescope_file() -> AxisFile:
    return load_axis(Path(__file__).parents[2] / "config" / "azimuth_1p2m.yaml")


def telescope(drive_noise: float, speed: float, start: float = 3.0, seed: int = 41) -> tuple[Recording, Axis]:
    """200 s without effects, from `start` (s) on, and the axis; noise in N m rms up to 60 Hz, speed (rad/s) of eight sines."""
    file = telescope_file()
    control = file.control
    assert control is not None
    drive = replace(file.axis.drive, noise=drive_noise, noise_bandwidth=60.0)
    plant = replace(file.axis, effects=(), drive=drive)
    sines = Multisine(speed, lowest_frequency=0.003, frequency_step=0.007, components=8, duration=200.0)
    run = simulate_loop(plant, Reference(sines), control.controller, control.loop, control.observer, control.compensator, seed)
    kept = run.t > start
    return Recording(run.t[kept], run.position[kept], run.torque[kept], source="simulated"), plant
