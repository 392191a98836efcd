"""Axes with nothing but LuGre friction whose torque is logged as drives log it: what is diagnosed there is the log, not physics.

    python -m benchmarks.logged_worlds --count 6

The axes and their electronics are those of `scale_worlds`, written anew beside the product. Kinds of logs:

- `held`: at 250 Hz, each value held from its stamp to the next;
- `late`: at 250 to 500 Hz, a column that is 4 ms late beside the position, give or take a millisecond of jitter.

The air warms by half a degree, which does nothing.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.scale_axis import Axis as ScaleAxis
from benchmarks.scale_axis import draw_axis
from benchmarks.scale_drive import clocks, drive, drive_noise, worth_keeping
from benchmarks.scale_physics import NAMES, simulate
from tcs_friction.config import AxisFile
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

KINDS = ("held", "late")
MOTIONS = ("multisine", "chirp", "slow_tracking", "steps")
RATES = {"held": (250.0,), "late": (250.0, 500.0)}
LATE, JITTER = 0.004, 0.001  # s
WARMER = 0.5  # degC, from the first sample to the last
STRATUM = {"kind": "rotary", "encoder": "fine", "offset": False, "noise": "coloured"}


@dataclass(frozen=True)
class LoggedWorld:
    """A recording, what is believed, and when a logged value begins to act after its stamp, s."""

    recording: Recording
    believed: AxisFile
    acts: float


def draw(kind: str, seed: int) -> LoggedWorld:
    """A world of this kind; the same for the same arguments."""
    for attempt in range(1000):
        rng = np.random.default_rng([seed, attempt, KINDS.index(kind)])
        motion = MOTIONS[seed % len(MOTIONS)]
        axis = draw_axis(STRATUM | {"motion": motion, "size": rng.uniform(0.2, 0.9)}, rng)
        if axis.rate in RATES[kind]:
            world = _recorded(kind, motion, axis, rng)
            if world is not None:
                return world
    raise RuntimeError(f"{kind} {seed}: no sensible motion")


def _recorded(kind: str, motion: str, axis: ScaleAxis, rng: np.random.Generator) -> LoggedWorld | None:
    ticks, t = clocks(axis, "held_from_stamp", 1, False, rng)
    noise, _ = drive_noise(ticks, axis.noise_level, "coloured", rng)
    control = drive(motion, ticks, axis, rng)
    reading = axis.encoder_noise * rng.standard_normal(len(t))
    torque, states = simulate(ticks, noise, t, axis.parameters, axis.scales, control, reading, axis.encoder_step)
    if not worth_keeping(STRATUM | {"motion": motion}, axis, states, torque):
        return None
    position = states[:, 0] + reading
    if axis.encoder_step > 0.0:
        position = np.round(position / axis.encoder_step) * axis.encoder_step
    if kind == "late":
        seen = t - LATE - rng.uniform(-JITTER, JITTER, len(t))
        torque = torque[np.maximum(np.searchsorted(t, seen, side="right") - 1, 0)]
    temperature = 20.0 + WARMER * t / t[-1]
    values = {name: axis.believed[name] for name in NAMES[:6]}
    believed = Axis("axis", axis.believed["inertia"], instance(law("lugre"), values))
    recording = Recording(t, position, torque, temperature=temperature, source=f"{kind} torque")
    return LoggedWorld(recording, AxisFile(believed), -LATE if kind == "late" else 0.0)


def main() -> None:
    """Diagnose worlds and print what is named, which is nothing where all is well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=KINDS, nargs="*", default=KINDS)
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    for kind in asked.kind:
        false = 0
        for seed in range(asked.first, asked.first + asked.count):
            world, began = draw(kind, seed), time.process_time()
            found = diagnose([world.recording], world.believed).to_mapping()
            named = [f"{one['effect']} {one['probability']:.2f}" for one in found["effects"]]
            false += bool(named)
            left = found["fit"]["improved"]["held_out"] / found["fit"]["noise_floor"]
            rate = 1.0 / np.median(np.diff(world.recording.t))
            print(
                f"{kind:5} {seed:3} {MOTIONS[seed % len(MOTIONS)]:13} {rate:4.0f} Hz {found['verdict']:15} {left:5.2f} floors "
                f"{time.process_time() - began:6.1f} s  {', '.join(named)}",
                flush=True,
            )
        print(f"{kind}: {false} of {asked.count} with a false name")


if __name__ == "__main__":
    main()
