"""Small fleets for the tests: bags of axes with Coulomb and viscous friction, which are identified in a moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from tcs_friction.config import AxisFile, save_axis
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.write import write_recording

START = 1_772_400_000 * 10**9  # 2026-03-01 21:20 UTC
INERTIA, COULOMB, VISCOUS = 10.0, 5.0, 3.0


def signals(name: str) -> SignalMap:
    topic = f"/{name}/joint_states"
    return SignalMap(
        SignalSource(topic, "position", name), SignalSource(topic, "effort", name), SignalSource(topic, "velocity", name),
        SignalSource(f"/{name}/temperature", "temperature"),
    )  # fmt: skip


def axis_file(name: str) -> AxisFile:
    friction = instance(law("coulomb_viscous"), {"coulomb": COULOMB, "viscous": VISCOUS})
    return AxisFile(Axis(name=name, inertia=INERTIA, friction=friction), signals(name))


def recording(seed: int = 0, seconds: float = 20.0, rate: float = 100.0) -> Recording:
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    speed, w = 0.0, np.zeros(len(t))
    position = np.zeros(len(t))
    for rate_of, size in ((1.1, 0.3), (2.9, 0.2)):
        position += size * np.sin(rate_of * t + seed)
        w += size * rate_of * np.cos(rate_of * t + seed)
        speed = w
    acceleration = np.gradient(w, t)
    torque = INERTIA * acceleration + COULOMB * np.sign(speed) + VISCOUS * w + 0.02 * random.standard_normal(len(t))
    noisy = position + 1e-6 * random.standard_normal(len(t))
    return Recording(t, noisy, torque, velocity=w, temperature=20.0 + 0.01 * t)


def write_axes(folder: Path, names: Sequence[str], **more: object) -> Path:
    for name in names:
        save_axis(folder / f"{name}.yaml", axis_file(name))
    path = folder / "AXES.yaml"
    path.write_text(yaml.safe_dump([{"axis": f"{name}.yaml", **more} for name in names]))
    return path


def write_bag(path: Path, name: str, seed: int = 0, start: int = START, seconds: float = 20.0) -> Path:
    write_recording(path, replace(recording(seed, seconds)), signals(name), start)
    return path
