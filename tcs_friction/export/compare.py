"""Measured beside simulated: a simulation's recording, a MuJoCo model or an FMU that is driven as the real axis was.

In an identified model's usual terms: fit per cent (NRMSE, 100 (1 - |y - y_simulated| / |y - mean y|)) of each signal, what the
residual follows, and whether it is white (autocorrelation) and has nothing of the torque left (cross-correlation).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.recording.recording import Recording

LAGS = 40  # of the correlations, in steps of half a cycle of the cutoff, between which the filter leaves nothing independent
CHANCE = 2.576  # standard deviations: one lag in a hundred of a white residual is beyond
PARTS = 8  # of each coordinate, over which the residual is told
ROUGHLY = 1e-6  # of a second: steps of an FMU against those of the recording


@dataclass(frozen=True)
class Compared:
    """One signal, measured and simulated, over all stretches.

    way: how the simulation was driven. fit: per cent. rms: of the residual. over: by coordinate, the residual's mean in PARTS
    parts of its range, and the ends of that range. white, driven: share of lags at which its autocorrelation and its correlation
    with the torque are beyond the bounds of chance, 0.01 for a residual that is white.
    """

    way: str
    signal: str
    unit: str
    fit: float
    rms: float
    over: dict[str, tuple[float, float, list[float]]]
    white: float
    driven: float

    def to_mapping(self) -> dict[str, Any]:
        """For JSON."""
        over = {name: {"from": low, "to": high, "mean": means} for name, (low, high, means) in self.over.items()}
        return {"way": self.way, "signal": self.signal, "unit": self.unit, "fit": self.fit, "rms": self.rms, "over": over,
                "autocorrelation_beyond": self.white, "cross_correlation_beyond": self.driven}  # fmt: skip


Pair = tuple[Stretch, np.ndarray, np.ndarray, np.ndarray]
"""A stretch, which of its samples, and there the measured and the simulated signal."""


def compared(data: DataSet, way: str, signal: str, unit: str, pairs: Sequence[Pair]) -> Compared:
    """A signal's comparison over stretches."""
    measured, simulated = (np.concatenate([pair[k] for pair in pairs]) for k in (2, 3))
    residual, spread = measured - simulated, float(np.linalg.norm(measured - measured.mean()))
    fit = 100.0 * (1.0 - float(np.linalg.norm(residual)) / spread) if spread > 0.0 else math.nan
    coordinates = {"time": "t", "position": "position", "velocity": "velocity"}
    over = {
        name: _over(np.concatenate([getattr(stretch, field)[rows] for stretch, rows, _, _ in pairs]), residual)
        for name, field in coordinates.items()
    }
    stride = max(round(0.5 / (data.cutoff * _step(data))), 1)
    correlations = (
        [_beyond(m - s, m - s, stride) for _, _, m, s in pairs],
        [_beyond(m - s, stretch.torque[rows], stride) for stretch, rows, m, s in pairs],
    )
    white, driven = (float(np.mean(values)) for values in correlations)
    return Compared(way, signal, unit, fit, float(np.sqrt(np.mean(residual**2))), over, white, driven)


def _step(data: DataSet) -> float:
    """Of the samples of a stretch, s."""
    return data.dt / data.stride


def _over(coordinate: np.ndarray, residual: np.ndarray) -> tuple[float, float, list[float]]:
    low, high = float(coordinate.min()), float(coordinate.max())
    place = np.clip(((coordinate - low) / max(high - low, 1e-300) * PARTS).astype(int), 0, PARTS - 1)
    count = np.bincount(place, minlength=PARTS)
    sums = np.bincount(place, residual, minlength=PARTS)
    return low, high, [float(s / n) if n else 0.0 for s, n in zip(sums, count, strict=True)]


def _beyond(x: np.ndarray, y: np.ndarray, stride: int) -> float:
    """The share of lags, 0 apart, at which two series are correlated by more than chance explains."""
    x, y = x[::stride] - x.mean(), y[::stride] - y.mean()
    count = min(LAGS, len(x) - 2)
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    if count < 1 or size == 0.0:
        return 0.0
    found = [float(x[lag:] @ y[: len(y) - lag]) / size for lag in range(1, count + 1)]
    return float(np.mean(np.abs(found) > CHANCE / math.sqrt(len(x))))


def against_recording(real: Sequence[Recording], simulated: Sequence[Recording], axis: Axis) -> list[Compared]:
    """A simulation's recordings beside the real ones, from the start of each."""
    if len(real) != len(simulated):
        raise InputError("--with", f"{len(simulated)} recordings of a simulation", f"{len(real)}, one for each real one")
    units = {"position": axis.unit("rad"), "velocity": axis.unit("rad/s"), "torque": axis.unit("N m")}
    found: dict[str, list[Pair]] = {name: [] for name in units}
    data = [prepare([one], held_out=False) for one in real]
    for one, other in zip(data, simulated, strict=True):
        parts = prepare([other], held_out=False).stretches
        for stretch in one.stretches:
            for name in units:
                found[name].append(_beside(stretch, stretch.t, name, parts, other.source))
    return [compared(data[0], "as recorded", name, unit, found[name]) for name, unit in units.items()]


def _beside(stretch: Stretch, t: np.ndarray, signal: str, parts: Sequence[Stretch], source: str) -> Pair:
    """A signal of a stretch at times `t` of a simulation, and the simulation's in `parts`, both filtered in the same way."""
    values = np.full(len(t), np.nan)
    for part in parts:
        inside = (t >= part.t[0]) & (t <= part.t[-1])
        values[inside] = np.interp(t[inside], part.t, getattr(part, signal))
    rows = np.flatnonzero(np.isfinite(values))
    if len(rows) < 2:
        raise InputError(source, "no time in common with the real recording", "a simulation of the same run")
    return stretch, rows, getattr(stretch, signal)[rows], values[rows]


def against_model(real: Sequence[Recording], file: AxisFile, model: Path, joint: str, horizon: float) -> list[Compared]:
    """A MuJoCo model by the recorded torque, begun anew every `horizon` (s), and along the recorded motion."""
    from tcs_friction.diagnose.from_model import recorded_along

    data, joint = prepare(real, held_out=False), joint or file.axis.name
    plain = replace(file.axis, effects=(), drive=Drive(), sensors=Sensors())
    simulator = MujocoSimulator(plain, model, joint, _step(data))
    moved = [pair for stretch in data.stretches for pair in _free(simulator, stretch, horizon, _step(data))]
    unit, way = file.axis.unit, f"by the recorded torque, {horizon:g} s each"
    found = [compared(data, way, name, unit(one), [(stretch, rows, *pair[k]) for stretch, rows, pair in moved])
             for k, (name, one) in enumerate((("position", "rad"), ("velocity", "rad/s")))]  # fmt: skip
    along = recorded_along(model, joint, file.with_axis(plain), real)
    pairs = [
        _beside(stretch, stretch.t - stretch.t[0], "torque", prepare([own], held_out=False).stretches, own.source)
        for stretch, own in zip(data.stretches, along, strict=True)
    ]
    return [*found, compared(data, "along the recorded motion", "torque", unit("N m"), pairs)]


Moved = tuple[Stretch, np.ndarray, tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]]


def _free(simulator: MujocoSimulator, stretch: Stretch, horizon: float, period: float) -> Iterator[Moved]:
    """Windows of a stretch, in each of which the simulator goes on by the torque alone; positions from the window's first one.

    For half a window before it is led along the measured motion: where its bristles then are follows from that.
    """
    size = min(max(round(horizon / period), 2), len(stretch.t))
    lead = min(size // 2, len(stretch.t) - size)
    for start in range(lead, len(stretch.t) - size + 1, size):
        rows = np.arange(start, start + size)
        first = float(stretch.position[start])
        simulator.begin(float(stretch.position[start - lead]), float(stretch.velocity[start - lead]))
        for before in range(start - lead, start):
            simulator.hold(float(stretch.position[before]), float(stretch.velocity[before]))
            simulator.step(float(stretch.torque[before]))
        simulator.hold(first, float(stretch.velocity[start]))
        position, velocity = np.empty(size), np.empty(size)
        for k, row in enumerate(rows.tolist()):
            position[k], velocity[k] = simulator.place
            simulator.step(float(stretch.torque[row]))
        yield stretch, rows, ((stretch.position[rows] - first, position - first), (stretch.velocity[rows], velocity))


def against_fmu(real: Sequence[Recording], file: AxisFile, fmu: Path) -> list[Compared]:
    """An FMU that has a torque and gives a motion, from the recording's start; or one that has a motion and gives friction."""
    package = _fmpy()
    try:
        description = package.read_model_description(str(fmu))
    except Exception as error:
        raise InputError(str(fmu), f"not read as an FMU ({error})", "an FMU for co-simulation") from None
    causality = {one.name: one.causality for one in description.modelVariables}
    data, unit = prepare(real, held_out=False), file.axis.unit
    if causality.get("torque") == "input" and causality.get("position") == "output":
        runs = [_run(package, fmu, s, ("torque",), ("position", "velocity"), _step(data)) for s in data.stretches]
        way = "by the recorded torque, from the start"
        return [
            compared(data, way, name, unit(one), [(s, np.arange(len(s.t)), getattr(s, name), run[:, k])
                                                  for s, run in zip(data.stretches, runs, strict=True)])
            for k, (name, one) in enumerate((("position", "rad"), ("velocity", "rad/s")))
        ]  # fmt: skip
    if causality.get("friction") == "output" and causality.get("position") == "input":
        inputs = ("position", "velocity", "acceleration", "torque")
        runs = [_run(package, fmu, s, inputs, ("friction",), _step(data))[:, 0] for s in data.stretches]
        pairs = [(s, np.arange(len(s.t)), s.torque, file.axis.inertia * s.acceleration + run)
                 for s, run in zip(data.stretches, runs, strict=True)]  # fmt: skip
        return [compared(data, "along the recorded motion", "torque", unit("N m"), pairs)]
    raise InputError(
        str(fmu), "its variables are no axis", "input torque and outputs position, velocity; or a motion and output friction"
    )


def _fmpy() -> Any:
    try:
        import fmpy
    except ImportError:
        raise InputError("FMPy", "the package is not installed", "pip install fmpy") from None
    return fmpy


def _run(
    package: Any, fmu: Path, stretch: Stretch, inputs: tuple[str, ...], outputs: tuple[str, ...], period: float
) -> np.ndarray:
    """Outputs (n, k) of an FMU at the end of each step, its inputs held over the step."""
    t = stretch.t - stretch.t[0]
    columns = np.zeros(len(t), dtype=[("time", float), *((name, float) for name in inputs)])
    columns["time"] = t
    for name in inputs:
        columns[name] = getattr(stretch, name)
    found = package.simulate_fmu(
        str(fmu), start_values={"start_position": float(stretch.position[0])} if "position" in outputs else {}, input=columns,
        output=list(outputs), step_size=period, output_interval=period, stop_time=float(t[-1] + 0.5 * ROUGHLY),
    )  # fmt: skip
    return np.column_stack([np.interp(t, found["time"], found[name]) for name in outputs])
