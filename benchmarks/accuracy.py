"""Identified parameters beside the truth and the Cramer-Rao bound, on simulated axes drawn at random.

Each axis follows a sinusoid through zero speed for two minutes under its controller, with encoder noise, encoder steps and torque
noise as on a 1.2 m telescope. Somebody believes values up to 20 % off. The bound is that of the data: exact derivatives along the
true motion and the true spectra of both noises; unknown are law, inertia, offset, timing of the torque and the initial bristle.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from tcs_friction.config import default_control
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.identify.identification import identify
from tcs_friction.identify.kernels import sensitivities
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.identify.uncertainty import cramer_rao
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

NAMES = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous", "inertia")
SECONDS, PERIOD, TOP_SPEED = 120.0, 24.0, math.radians(0.1)
ENCODER = Sensors(resolution=2.4240684e-8, noise=4.8481368e-8, velocity_bandwidth=100.0)  # 0.005" and 0.01"
BELIEF = 0.2  # largest relative error of believed friction
BOUND_RATE, BOUND_BAND, BOUND_LAGS = 100.0, 40.0, 150  # Hz: above it, encoder noise hides all torque
NORMAL_95, NORMAL_MEDIAN = 1.96, 0.6745


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--axes", type=int, default=20, help="axes drawn at random")
    parser.add_argument("--recordings", type=int, default=3, help="of each axis, with noise of its own")


def draw(random: np.random.Generator) -> Axis:
    """An azimuth axis of a 1.2 m telescope, more or less."""
    coulomb, inertia = random.uniform(60.0, 105.0), random.uniform(800.0, 1300.0)
    stiffness = random.uniform(2.2e5, 4.2e5)
    values = {
        "coulomb": coulomb,
        "static": coulomb * random.uniform(1.22, 1.58),
        "stribeck_velocity": random.uniform(4.8e-4, 8.5e-4),
        "stiffness": stiffness,
        "damping": random.uniform(0.4, 0.9) * 2.0 * math.sqrt(stiffness * inertia),
        "viscous": random.uniform(350.0, 650.0),
    }
    drive = Drive(limit=1000.0, noise=random.uniform(0.2, 0.33), noise_bandwidth=10.0)
    return Axis("azimuth", inertia, instance(law("lugre"), values), sensors=ENCODER, drive=drive)


def run_axis(axis: Axis, seed: int, seconds: float = SECONDS) -> LoopRun:
    """The axis under its controller, to and fro."""
    sinusoid = Sinusoid(amplitude=TOP_SPEED * PERIOD / (2.0 * math.pi), period=PERIOD, duration=seconds)
    return simulate_loop(axis, Reference(sinusoid), default_control(axis).controller, seed=seed)


def believed(axis: Axis, random: np.random.Generator) -> Axis:
    """The same law with wrong values, and no knowledge of noise."""
    values = {
        name: value * (1.0 + BELIEF * random.uniform(-1, 1)) for name, value in axis.friction.values.items()
    }
    values["static"] = max(values["static"], values["coulomb"])
    inertia = axis.inertia * (1.0 + 0.5 * BELIEF * random.uniform(-1, 1))
    return Axis("azimuth", inertia, instance(law("lugre"), values))


def found_by(axis: Axis, run: LoopRun, random: np.random.Generator) -> Identification:
    """What the default method makes of position and torque alone."""
    return identify([Recording(run.t, run.position, run.torque, source="simulated")], believed(axis, random))


def bound(axis: Axis, run: LoopRun) -> dict[str, float]:
    """Least standard deviations by name."""
    dt, count = float(run.t[1] - run.t[0]), len(run.t)
    position = np.array(run.true_position)
    velocity = np.gradient(position, dt)
    values = np.array([axis.friction.values[name] for name in NAMES[:6]])
    out = np.empty((count, 8))
    sensitivities(
        velocity, np.diff(position, prepend=position[0]), np.array([0, count]), values, np.zeros(1), out
    )
    timing = np.gradient(np.array(run.torque), dt)
    columns = [*out[:, 1:7].T, np.gradient(velocity, dt), np.ones(count), timing, out[:, 7]]
    smooth = sosfiltfilt(butter(8, BOUND_BAND, fs=1.0 / dt, output="sos"), np.column_stack(columns), axis=0)
    kept = smooth[round(0.2 / dt) :: round(1.0 / (dt * BOUND_RATE))]
    deviation = np.sqrt(np.diag(cramer_rao(kept, _autocovariance(axis, dt))))
    return dict(zip(NAMES, deviation.tolist(), strict=False))


def _autocovariance(axis: Axis, dt: float) -> np.ndarray:
    """(BOUND_LAGS,) of torque noise and of the torque that encoder noise pretends, sampled at BOUND_RATE, (N m)^2."""
    frequency = np.linspace(0.0, 0.5 * BOUND_RATE, 4001)
    omega = 2.0 * math.pi * frequency
    decay = math.exp(-2.0 * math.pi * axis.drive.noise_bandwidth * dt)
    torque = (
        2.0
        * dt
        * axis.drive.noise**2
        * (1.0 - decay**2)
        / np.abs(1.0 - decay * np.exp(-1j * omega * dt)) ** 2
    )
    encoder = 2.0 * dt * (axis.sensors.noise**2 + axis.sensors.resolution**2 / 12.0)
    density = torque + encoder * (axis.inertia * omega**2) ** 2
    lags = np.arange(BOUND_LAGS) / BOUND_RATE
    return np.array([np.trapezoid(density * np.cos(omega * lag), frequency) for lag in lags])


def trials(axes: int, recordings: int, seconds: float = SECONDS) -> tuple[dict[str, np.ndarray], float]:
    """Name -> (k, 4): error, standard deviation, bound, truth of what was determined; and seconds per identification."""
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in NAMES}
    spent = 0.0
    for number in range(axes):
        random = np.random.default_rng([7, number])
        axis = draw(random)
        for _ in range(recordings):
            run = run_axis(axis, int(random.integers(2**31)), seconds)
            limits = bound(axis, run)
            began = time.perf_counter()
            found = found_by(axis, run, random)
            spent += time.perf_counter() - began
            for name in NAMES:
                estimate, true = _estimate(found, name), _true(axis, name)
                if estimate.determined:
                    rows[name].append((estimate.value - true, estimate.std, limits[name], true))
    return {name: np.array(values).reshape(-1, 4) for name, values in rows.items()}, spent / (
        axes * recordings
    )


def _estimate(found: Identification, name: str) -> Estimate:
    return found.inertia if name == "inertia" else found.parameters[name]


def _true(axis: Axis, name: str) -> float:
    return axis.inertia if name == "inertia" else axis.friction.values[name]


def coverage(rows: np.ndarray) -> float:
    """Share of 95 % intervals that hold the truth."""
    return float(np.mean(np.abs(rows[:, 0]) < NORMAL_95 * rows[:, 1]))


def over_bound(rows: np.ndarray) -> float:
    """Median error over that of a Gaussian whose standard deviation is the bound."""
    return float(np.median(np.abs(rows[:, 0] / rows[:, 2])) / NORMAL_MEDIAN)


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    found, seconds = trials(arguments.axes, arguments.recordings)
    every = np.vstack(list(found.values()))
    results = [
        _row("95 % intervals that hold the truth", 100.0 * coverage(every), "%", 95.0),
        _row("median error over that of the bound", over_bound(every), "1", 1.0),
        _row("parameters determined", len(every), "1", len(NAMES) * arguments.axes * arguments.recordings),
        _row("time per identification", seconds, "s", None),
    ]
    for name, rows in found.items():
        relative = 100.0 * np.abs(rows[:, 0] / rows[:, 3])
        results += [
            _row(f"{name}: 95 % intervals that hold the truth", 100.0 * coverage(rows), "%", 95.0),
            _row(f"{name}: median error over that of the bound", over_bound(rows), "1", 1.0),
            _row(
                f"{name}: rms error over the bound",
                float(np.sqrt(np.mean((rows[:, 0] / rows[:, 2]) ** 2))),
                "1",
                1.0,
            ),
            _row(f"{name}: median error", float(np.median(relative)), "%", None),
            _row(f"{name}: largest error", float(relative.max()), "%", None),
        ]
    return results


def _row(name: str, value: float, unit: str, beside: float | None) -> dict[str, Any]:
    ratio = value / beside if beside else None
    return {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": ratio}
