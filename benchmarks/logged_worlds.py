"""Stand-ins for logs of real machines that were diagnosed wrongly: axes with LuGre friction, recorded as drives record them.

The axes and their electronics are those of `scale_worlds`, written anew beside the product. Kinds of logs:

- `held`: at 250 Hz, each value held from its stamp to the next;
- `late`: at 250 to 500 Hz, a column that is 4 ms late beside the position, give or take a millisecond of jitter.
- `coarse`: an encoder whose steps show, a night of ordinary tracking among them;
- `coupled`: the next joint moves, too, and its acceleration takes torque from this one; nothing else is missing.

The air warms by half a degree, which does nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed_score import Expected
from benchmarks.scale_axis import Axis as ScaleAxis
from benchmarks.scale_axis import draw_axis
from benchmarks.scale_drive import clocks, drive, drive_noise, worth_keeping
from benchmarks.scale_physics import NAMES, simulate
from benchmarks.trials import Trial, signals_of
from tcs_friction.config import AxisFile
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

KINDS = ("held", "late", "coarse", "coupled")
MOTIONS = ("multisine", "chirp", "slow_tracking", "steps")
RATES = {"held": (250.0,), "late": (250.0, 500.0)}  # Hz; of other kinds whatever is drawn
LATE, JITTER = 0.004, 0.001  # s
WARMER = 0.5  # degC, from the first sample to the last
COUPLED = 0.3  # of the torque, rms
LINES = (0.1, 2.0)  # Hz, of the next joint's motion
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
        encoder = {"encoder": "coarse"} if kind == "coarse" else {}
        axis = draw_axis(STRATUM | encoder | {"motion": motion, "size": rng.uniform(0.2, 0.9)}, rng)
        if axis.rate in RATES.get(kind, (axis.rate,)):
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
    others: dict[str, np.ndarray] = {}
    if kind == "coupled":
        others["next_velocity"], acceleration = _next_joint(t, rng)
        torque = torque + COUPLED * np.sqrt(np.mean(torque**2)) / np.std(acceleration) * acceleration
    temperature = 20.0 + WARMER * t / t[-1]
    values = {name: axis.believed[name] for name in NAMES[:6]}
    believed = Axis("axis", axis.believed["inertia"], instance(law("lugre"), values))
    recording = Recording(t, position, torque, temperature=temperature, exogenous=others, source=f"{kind} torque")
    return LoggedWorld(recording, AxisFile(believed), -LATE if kind == "late" else 0.0)


def names() -> list[str]:
    """Kinds and motions: a world for each pair."""
    return [f"{kind}-{motion}" for kind in KINDS for motion in MOTIONS]


def world(name: str, seed: int) -> Trial:
    """The world of that name and seed: nothing but the coupling is missing, where there is one."""
    kind, motion = name.split("-")
    drawn = draw(kind, len(MOTIONS) * seed + MOTIONS.index(motion))
    believed = replace(drawn.believed, signals=signals_of(drawn.recording))
    missing = (("cross_axis_coupling",),) if kind == "coupled" else ()
    return Trial(name, drawn.recording, believed, Expected(missing, 0.0), f"an axis, {kind}", {"acts": drawn.acts})


def _next_joint(t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration (n,) of a joint that moves in lines of its own, rad/s and rad/s^2."""
    omega, phase = 2.0 * np.pi * rng.uniform(*LINES, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
    angles = np.outer(t, omega) + phase
    return np.sin(angles).sum(axis=1), (omega * np.cos(angles)).sum(axis=1)
