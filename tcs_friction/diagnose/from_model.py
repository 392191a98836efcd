"""A MuJoCo model against recordings of the real axis: the model is moved as the axis was, and that is recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from tcs_friction.conditioning.data_set import Stretch
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile, default_control
from tcs_friction.control.loop import LoopConfig, simulate_loop
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.recording.recording import Recording

SUFFIXES = (".xml", ".mjcf", ".urdf")
"""Of files that are models of MuJoCo; any other simulation is a bag."""
SHORTEST_START = 1.0  # s in which the model comes to the speed that the axis has when a recording begins


def is_model(path: Path) -> bool:
    """Whether a simulation is a model and not a bag of one."""
    return path.suffix.lower() in SUFFIXES


def recorded_along(model: Path, joint: str, file: AxisFile, real: Sequence[Recording]) -> list[Recording]:
    """What a joint of a model does when a controller moves it as recordings of the real axis went, a recording for each stretch.

    joint: "" for the one that has the axis' name. The axis file says what drive and encoder are like and how often they are
    read; the controller is a cautious one for the model's own inertia. Raises InputError for a model that cannot be the axis and
    for recordings that cannot be diagnosed either, JobError where the model becomes unstable.
    """
    axis = replace(file.axis, effects=(), drive=replace(file.axis.drive, limit=math.inf))
    joint = joint or axis.name
    inertia = MujocoSimulator(axis, model, joint).inertia
    if not inertia > 0.0:
        raise InputError(str(model), f"nothing moves with joint {joint}", "a model with inertia")
    config = LoopConfig(period=file.control.loop.period if file.control else LoopConfig().period)
    controller = default_control(replace(axis, inertia=inertia)).controller

    def plant(of: Axis, period: float, seed: int, position: float) -> MujocoSimulator:
        return MujocoSimulator(of, model, joint, period, seed, position)

    recordings = []
    for number, stretch in enumerate(prepare(real, held_out=False).stretches):
        way = Way(stretch)
        run = simulate_loop(axis, way, controller, config, seed=number, plant=plant)
        k = int(np.searchsorted(run.t, way.start))
        t, source = run.t[k:] - way.start, str(model)
        recordings.append(Recording(t, run.position[k:], run.torque[k:], run.velocity[k:], source=source))
    return recordings


class Way:
    """A recorded stretch as a reference (`control.reference.Reference`), which from rest comes to the stretch's first speed.

    start: s that this takes, at no more than the acceleration that the stretch has itself.
    """

    def __init__(self, stretch: Stretch) -> None:
        self._begin, end = float(stretch.t[0]), float(stretch.t[-1])
        self._path = CubicHermiteSpline(stretch.t, stretch.position, stretch.velocity)
        self._acceleration = stretch.t, stretch.acceleration
        self._position, self._speed = float(stretch.position[0]), float(stretch.velocity[0])
        hardest = float(np.abs(stretch.acceleration).max())
        self.start = max(SHORTEST_START, abs(self._speed) / hardest if hardest > 0.0 else 0.0)
        self.duration = self.start + end - self._begin

    def over(self, times: ArrayLike) -> NDArray[np.float64]:
        """Shape (n, 3): position (rad), speed (rad/s) and acceleration (rad/s^2) at each of n times (s)."""
        t = np.asarray(times, dtype=np.float64) - self.start
        along = np.maximum(t, 0.0) + self._begin
        path = [self._path(along), self._path(along, 1), np.interp(along, *self._acceleration)]
        left = self._speed / self.start  # rad/s^2, constant while the speed grows from nothing
        before = [self._position + t * (self._speed + 0.5 * left * t), self._speed + left * t, np.full_like(t, left)]
        return np.ascontiguousarray(np.where(t < 0.0, before, path).T)
