"""One world as the benchmark asks about it, whatever made it: a recording, a belief, and what is right to say."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.concealed_score import Expected
from tcs_friction.config import AxisFile, save_axis, write_whole
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.write import write_recording

JOINT = "/joint_states"


@dataclass(frozen=True)
class Trial:
    """A world to diagnose. `note` says in a sentence what it is; `details` are numbers of the truth, for a reader.

    true: the axis as it is, where the product's own terms can say it.
    """

    name: str
    recording: Recording
    believed: AxisFile
    expected: Expected
    note: str
    details: Mapping[str, Any] = field(default_factory=dict)
    true: Axis | None = None


def rng_of(name: str, seed: int) -> np.random.Generator:
    """The generator of one world: its name and the seed alone decide, so that a world can be made by itself."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def signals_of(recording: Recording) -> SignalMap:
    """Where the signals of a world's recording stand in its bag; speeds of other axes are joints of their own."""
    block: dict[str, Any] = {
        name: {"topic": JOINT, "field": column, "joint": "azimuth"}
        for name, column in (("position", "position"), ("velocity", "velocity"), ("torque", "effort"))
    }
    if recording.temperature is not None:
        block["temperature"] = {"topic": "/temperature", "field": "temperature"}
    others = {
        name: {"topic": JOINT, "field": "velocity", "joint": name.removesuffix("_velocity")}
        if name.endswith("_velocity")
        else {"topic": f"/{name}", "field": "vector.x"}
        for name in recording.exogenous
    }
    return SignalMap.from_mapping(block | ({"exogenous": others} if others else {}), "world")


def save_trial(trial: Trial, folder: Path) -> None:
    """Recording and axis file, as `./tcs diagnose` takes them, and truth.json beside them, into a new folder."""
    signals = trial.believed.signals
    assert signals is not None
    folder.mkdir(parents=True, exist_ok=True)
    write_recording(folder / "recording", trial.recording, signals)
    save_axis(folder / "axis.yaml", trial.believed)
    truth = {"note": trial.note, **trial.expected.to_mapping(), **trial.details}
    write_whole(folder / "truth.json", json.dumps(truth, indent=1) + "\n")
