"""Identified parameters beside the truth and the Cramer-Rao bound, on simulated axes drawn at random.

Each axis follows a sinusoid through zero speed for two minutes under its controller, with encoder noise, encoder steps and torque
noise as on a 1.2 m telescope. Somebody believes values up to 20 % off. The bound is that of the data: exact derivatives and the
true spectra of both noises; unknown are law, inertia, offset, timing of the torque and the initial bristle. Derivatives are those
along the motion without torque noise. Motion that the noise causes says nothing of the inertia, since the noise is as unknown; a
bound that takes it for known is 1.2 to 1.7 times too low there, and up to 1.08 times for the rest.

Behind the +- stands by how much a number would scatter if the axes were drawn again. `--law` does the same with another friction
law; the bound is then that of its fit, for Gaussian errors with the residual's own correlation. `--axes scales` is another
benchmark, `scale_accuracy.py`.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks import law_axes, scale_accuracy
from benchmarks.law_axes import ENCODER
from tcs_friction.commands.parser import positive
from tcs_friction.config import default_control
from tcs_friction.control.loop import LoopRun, simulate_loop
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.identify.identification import identify
from tcs_friction.identify.kernels import sensitivities
from tcs_friction.identify.result import Estimate, Identification
from tcs_friction.identify.uncertainty import cramer_rao
from tcs_friction.physics.axis import Axis, Drive
from tcs_friction.physics.registry import law, laws
from tcs_friction.physics.terms import Role, instance
from tcs_friction.recording.recording import Recording

NAMES = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous", "inertia")
SECONDS, PERIOD, TOP_SPEED = 120.0, 24.0, math.radians(0.1)
BELIEF = 0.2  # largest relative error of believed friction
BOUND_RATE, BOUND_BAND, BOUND_LAGS = 100.0, 40.0, 150  # Hz: above it, encoder noise hides all torque
NORMAL_95, NORMAL_MEDIAN = 1.96, 0.6745
RESAMPLINGS = 400


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--axes", type=_axes, default=20, metavar="N|scales",
        help="how many of the shipped kind are drawn; scales: of all sizes and rates, by another simulator (scale_worlds.py)",
    )  # fmt: skip
    parser.add_argument("--worlds", type=positive, default=40, help="how many of all scales (default 40)")
    parser.add_argument("--seed", type=int, default=1, help="of the worlds of all scales (default 1)")
    parser.add_argument("--recordings", type=positive, default=3, help="of each axis, with noise of its own")
    parser.add_argument("--law", default="lugre", choices=sorted(laws()), help="friction law (default lugre)")


def _axes(word: str) -> int | None:
    """A number of axes; None for those of all scales."""
    return None if word == "scales" else positive(word)


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


def undisturbed(axis: Axis, seconds: float = SECONDS) -> LoopRun:
    """The same motion without torque noise."""
    return run_axis(replace(axis, drive=replace(axis.drive, noise=0.0)), 0, seconds)


def believed(axis: Axis, random: np.random.Generator) -> Axis:
    """The same law with wrong values, and no knowledge of noise."""
    values = {
        name: value * (1.0 + BELIEF * random.uniform(-1, 1)) for name, value in axis.friction.values.items()
    }
    if "static" in values:
        values["static"] = max(values["static"], values["coulomb"])
    term = axis.friction.term
    fixed = {p.name: axis.friction.values[p.name] for p in term.parameters if p.role is Role.FIXED}
    inertia = axis.inertia * (1.0 + 0.5 * BELIEF * random.uniform(-1, 1))
    return Axis("azimuth", inertia, instance(term, values | fixed), axis.effects)


def found_by(axis: Axis, run: LoopRun, random: np.random.Generator) -> Identification:
    """What the default method makes of position and torque alone."""
    return identify([Recording(run.t, run.position, run.torque, source="simulated")], believed(axis, random))


def bound(axis: Axis, run: LoopRun) -> dict[str, float]:
    """Least standard deviations by name, for the noise of the axis along the motion of an undisturbed run."""
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


def trials(
    axes: int, recordings: int, seconds: float = SECONDS, name: str = "lugre"
) -> tuple[dict[str, np.ndarray], float]:
    """Parameter -> (k, 5): error, standard deviation, bound, truth, number of axis of what was determined; seconds per fit."""
    sought = searched(name)
    rows: dict[str, list[tuple[float, ...]]] = {parameter: [] for parameter in sought}
    spent = 0.0
    for number in range(axes):
        random = np.random.default_rng([7, number])
        axis = draw(random) if name == "lugre" else law_axes.draw(name, random)
        limits = bound(axis, undisturbed(axis, seconds)) if name == "lugre" else {}
        for _ in range(recordings):
            run = run_axis(axis, int(random.integers(2**31)), seconds)
            began = time.perf_counter()
            found = found_by(axis, run, random)
            spent += time.perf_counter() - began
            for parameter in sought:
                estimate, true = _estimate(found, parameter), _true(axis, parameter)
                if estimate.determined:
                    limit = (limits or found.bound).get(parameter, math.nan)
                    rows[parameter].append((estimate.value - true, estimate.std, limit, true, number))
    return {key: np.array(values).reshape(-1, 5) for key, values in rows.items()}, spent / (axes * recordings)


def searched(name: str) -> tuple[str, ...]:
    """What is identified of an axis with that law."""
    return (*(p.name for p in law(name).parameters if p.role is not Role.FIXED), "inertia")


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


def scatter(rows: np.ndarray, statistic: Callable[[np.ndarray], float]) -> float:
    """Standard deviation of a statistic if the axes were drawn again (bootstrap of whole axes: their trials are alike)."""
    random = np.random.default_rng(0)
    groups = [rows[rows[:, 4] == number] for number in np.unique(rows[:, 4])]
    drawn = random.integers(len(groups), size=(RESAMPLINGS, len(groups)))
    return float(np.std([statistic(np.vstack([groups[k] for k in one])) for one in drawn]))


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    if arguments.axes is None:
        return scale_accuracy.run(arguments.seed, arguments.worlds)
    found, seconds = trials(arguments.axes, arguments.recordings, name=arguments.law)
    every = np.vstack(list(found.values()))
    results = [
        *_intervals("", every),
        _row("parameters determined", len(every), "1", len(found) * arguments.axes * arguments.recordings),
        _row("time per identification", seconds, "s", None),
    ]
    for name, rows in found.items():
        if not len(rows):
            continue
        relative = 100.0 * np.abs(rows[:, 0] / rows[:, 3])
        results += [
            *_intervals(f"{name}: ", rows),
            _row(
                f"{name}: rms error over the bound",
                rms_over_bound(rows),
                "1",
                1.0,
                scatter(rows, rms_over_bound),
            ),
            _row(f"{name}: median error", float(np.median(relative)), "%", None),
            _row(f"{name}: largest error", float(relative.max()), "%", None),
        ]
    return results


def rms_over_bound(rows: np.ndarray) -> float:
    """Root mean square of the errors over their bounds."""
    return float(np.sqrt(np.mean((rows[:, 0] / rows[:, 2]) ** 2)))


def _intervals(whose: str, rows: np.ndarray) -> list[dict[str, Any]]:
    """Coverage, whose scatter is at least that of as many trials of exact intervals, and the median error."""
    fewest = math.sqrt(0.95 * 0.05 / len(rows))
    covered = 100.0 * max(scatter(rows, coverage), fewest)
    return [
        _row(f"{whose}95 % intervals that hold the truth", 100.0 * coverage(rows), "%", 95.0, covered),
        _row(
            f"{whose}median error over that of the bound",
            over_bound(rows),
            "1",
            1.0,
            scatter(rows, over_bound),
        ),
    ]


def _row(
    name: str, value: float, unit: str, beside: float | None, error: float | None = None
) -> dict[str, Any]:
    ratio = value / beside if beside else None
    row = {"name": name, "value": value, "unit": unit, "beside": beside, "ratio": ratio}
    return row if error is None else {**row, "error": error}
