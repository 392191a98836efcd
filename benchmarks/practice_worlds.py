"""The concealed recordings that came with the project, each with what is right to say of it.

A recording is a folder with axis.yaml, a bag named recording, and truth.json. They lie in practice/ of the folder that
TCS_FRICTION_DATA names, or of ../shared. Some truths are sentences only, so what is right is written down here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from benchmarks.concealed_score import Expected
from benchmarks.hardware import data_folder
from benchmarks.trials import Trial
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.yaml_files import load_yaml

MISSING: Mapping[str, tuple[str, ...]] = {
    "cable_and_asymmetry": ("cable_wrap", "coulomb_asymmetry"),
    "cogging": ("cogging",),
    "flexible_mode": ("flexible_mode",),
    "law": ("stribeck",),
    "match": (),
    "mujoco_coulomb": (),
    "mujoco_coupling": ("cross_axis_coupling",),
    "mujoco_spring": ("cable_wrap",),
    "outside": (),
    "presliding": ("presliding",),
    "unknown": (),
}
"""The effects that each belief lacks."""
OUTSIDE = ("outside", "unknown")  # of these, something is missing that no effect describes


def names() -> list[str]:
    """The recordings by name."""
    return list(MISSING)


def folder_of(name: str) -> Path:
    """Where the recording of that name is. InputError where it is missing."""
    folder = data_folder().parent / "practice" / name
    if not (folder / "axis.yaml").is_file():
        raise InputError(str(folder), "no recording", "axis.yaml, recording and truth.json (TCS_FRICTION_DATA names the folder)")
    return folder


def world(name: str, seed: int = 0) -> Trial:  # noqa: ARG001 they are recorded, not drawn
    """The recording of that name. InputError where it is missing or cannot be read."""
    folder = folder_of(name)
    file = load_axis(folder / "axis.yaml")
    truth = load_yaml(folder / "truth.json", "the truth of a practice recording")  # JSON is YAML
    noise = truth.get("torque_noise", 0.0)
    if not isinstance(noise, float):
        raise InputError(f"{folder / 'truth.json'}: torque_noise", repr(noise), "a number, N m rms")
    (recording,) = read_recordings([folder / "recording"], file.mapped(folder / "axis.yaml"))
    right = Expected(
        tuple((effect,) for effect in MISSING[name]),
        noise_floor=noise,
        tolerated=frozenset({"presliding"} if name == "law" else ()),  # damping of the bristles is missing, too
        outside=name in OUTSIDE,
    )
    return Trial(name, recording, file, right, truth.get("note", f"{', '.join(MISSING[name]) or 'nothing'} is missing"))
