"""Whether `./tcs compensate` predicts what compensation then gains: axes identified, predicted, and measured.

Each axis is drawn at random and recorded under its controller, with noise of drive and encoder. From that recording it is
identified, from beliefs that are wrong; with what was identified, its covariance and its noise, the gain of compensation is
predicted on another motion. Then the true axis makes that motion, without compensation and with the one identified, with noise of
its own: a run is predicted if its gain (rms with compensation over rms without) lies in the 90 % interval.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import periodogram

from benchmarks.accuracy import believed, draw, run_axis
from tcs_friction.commands.parser import positive
from tcs_friction.config import default_control
from tcs_friction.control.loop import Cancellation, LoopConfig, simulate_loop
from tcs_friction.control.model_compensator import CancellationConfig, effect_names
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.reference import Legs, Reference, Sinusoid
from tcs_friction.control.worth import LAW, LEAST_DRAWS, Stage, Task, worth
from tcs_friction.identify.identification import identified_axis, identify
from tcs_friction.identify.result import Identification
from tcs_friction.physics.axis import Axis, Drive
from tcs_friction.recording.recording import Recording
from tcs_friction.report.identification_files import IDENTIFICATION
from tcs_friction.report.identification_spread import spread_by

BAR = 0.9
SETTLE = 2.0  # s
SECONDS = (24.0, 72.0)  # of a recording: from one period of its motion to three
BAND = 0.5  # of the highest frequency in the residual, up to which its spectrum is that of the drive's noise
LOWEST = 0.2  # Hz, from where on friction leaves nothing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--axes", type=positive, default=20, help="axes drawn at random (default 20, about 15 minutes)")
    parser.add_argument("--runs", type=positive, default=3, help="of each axis that are measured (default 3)")
    parser.add_argument("--draws", type=positive, default=LEAST_DRAWS, help="of a prediction (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="that the axes are drawn with (default 0)")
    parser.add_argument("--show", action="store_true", help="a line for each axis")


@dataclass(frozen=True)
class Outcome:
    """Of one axis: the predicted stage, and the gains measured, true and by the encoder, (r, 2)."""

    stage: Stage
    measured: np.ndarray

    @property
    def line(self) -> str:
        """For a reader."""
        assert self.stage.gain_between is not None
        low, high = self.stage.gain_between
        runs = " ".join(f"{gain:.4f}" for gain in self.measured[:, 0])
        return f"predicted {self.stage.gain:.4f} ({low:.4f} to {high:.4f}), measured {runs}"


def drive_noise(found: Identification) -> tuple[Drive, float]:
    """A drive's noise by what an identification leaves of the torque, and its standard error, N m.

    A first-order spectrum is fitted to the periodogram of the low frequencies, which a position's noise and the low pass leave
    alone. Its ordinates are independent and exponential about the spectrum (Whittle 1953), so that a fit of two numbers to n of
    them misses the power by a share of (2 / n)^0.5 over the band.
    """
    t, residual = found.fit.t, found.fit.residual
    frequency, density = periodogram(residual, 1.0 / float(np.median(np.diff(t))))
    low = (frequency > LOWEST) & (frequency < BAND * frequency[-1])
    frequency, density = frequency[low], density[low]

    def level(bandwidth: float) -> float:
        return float(np.mean(density * (1.0 + (frequency / bandwidth) ** 2)))

    def badness(logarithm: float) -> float:
        bandwidth = math.exp(logarithm)
        return float(np.sum(np.log(level(bandwidth) / (1.0 + (frequency / bandwidth) ** 2))))

    best = minimize_scalar(badness, bounds=(math.log(1.0), math.log(100.0)), method="bounded")
    bandwidth = math.exp(float(best.x))
    noise = math.sqrt(level(bandwidth) * 0.5 * math.pi * bandwidth)
    return Drive(noise=noise, noise_bandwidth=bandwidth), 0.5 * noise * math.sqrt(2.0 / len(frequency))


def motion(random: np.random.Generator) -> Reference:
    """Legs or a sinusoid of up to 0.1 deg/s."""
    speed = math.radians(random.uniform(0.02, 0.1))
    if random.random() < 0.5:
        return Reference(Legs(speed=speed, leg=random.uniform(3.0, 8.0), acceleration=random.uniform(2e-3, 8e-3), duration=40.0))
    period = random.uniform(8.0, 30.0)
    return Reference(Sinusoid(amplitude=speed * period / (2.0 * math.pi), period=period, duration=40.0))


def outcome(random: np.random.Generator, runs: int, draws: int) -> Outcome:
    """One axis: identified, predicted, measured."""
    true = draw(random)
    true = replace(true, drive=replace(true.drive, noise_bandwidth=random.uniform(5.0, 20.0)))
    run = run_axis(true, int(random.integers(2**31)), random.uniform(*SECONDS))
    guess = believed(true, random)
    found = identify([Recording(run.t, run.position, run.torque, source="simulated")], guess)
    model = identified_axis(guess, found)
    content = found.to_mapping()
    noise = model.drive
    if not noise.noise > 0.0:  # an identification that does not tell it
        noise, std = drive_noise(found)
        content["drive"] = {"noise": {"value": noise.noise, "std": std, "unit": "N m", "determined": True}}
    model = replace(model, sensors=true.sensors, drive=replace(noise, limit=true.drive.limit))
    controller, reference = default_control(true).controller, motion(random)
    task = Task(reference, controller, LoopConfig(), ObserverSettings(), seed=int(random.integers(2**31)), settle=SETTLE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / IDENTIFICATION
        path.write_text(json.dumps(content))
        spread, _ = spread_by(path, model)
    stage = worth(model, task, spread=spread, draws=draws).stage(LAW)
    seeds = random.integers(2**31, size=runs).tolist()
    return Outcome(stage, np.array([_gain(true, model, task, seed) for seed in seeds]))


def _gain(true: Axis, model: Axis, task: Task, seed: int) -> np.ndarray:
    """Rms with the law of a model compensated over that without, of the true error and of the encoder's, (2,)."""
    sizes = []
    for compensation in ("none", "model"):
        loop = replace(task.loop, compensation=compensation)
        cancelling = Cancellation(model, CancellationConfig(left_out=tuple(effect_names(model))))
        run = simulate_loop(true, task.reference, task.controller, loop, seed=seed, cancellation=cancelling)
        counted = run.t >= task.settle
        errors = (run.reference - run.true_position, run.error)
        sizes.append([float(np.sqrt(np.mean(error[counted] ** 2))) for error in errors])
    return np.array(sizes[1]) / np.array(sizes[0])


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: share of the runs whose gain lies in the predicted interval, and measured over predicted gain."""
    outcomes = []
    for number in range(arguments.axes):
        outcomes.append(outcome(np.random.default_rng([arguments.seed, number]), arguments.runs, arguments.draws))
        if arguments.show:
            print(outcomes[-1].line, flush=True)
    gain = float(np.median([one.measured[:, 0].mean() for one in outcomes]))
    rows: list[dict[str, Any]] = [{"name": "rms compensated over not, median of the axes", "value": gain, "unit": ""}]
    return [*rows, *_rows(outcomes, "true error", 0), *_rows(outcomes, "error by the encoder", 1)]


def _rows(outcomes: Sequence[Outcome], words: str, column: int) -> list[dict[str, Any]]:
    inside, ratios, widths = [], [], []
    for one in outcomes:
        stage = one.stage
        interval, middle = (stage.gain_between, stage.gain) if column == 0 else (stage.measured_gain_between, stage.measured_gain)
        assert interval is not None
        gains = one.measured[:, column]
        inside += [interval[0] <= gain <= interval[1] for gain in gains]
        ratios += (gains / middle).tolist()
        widths.append(interval[1] / interval[0])
    share = float(np.mean(inside))
    rows = [{"name": f"runs in the 90 % interval, {words}", "value": share, "unit": "", "beside": BAR, "ratio": share / BAR}]
    for name, value in (
        ("measured gain over predicted, median", np.median(ratios)),
        ("measured gain over predicted, 5 %", np.percentile(ratios, 5.0)),
        ("measured gain over predicted, 95 %", np.percentile(ratios, 95.0)),
        ("upper over lower end of the interval, median", np.median(widths)),
    ):
        rows.append({"name": f"{name}, {words}", "value": float(value), "unit": "", "beside": 1.0})
    return rows
