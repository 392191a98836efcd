"""Axes of every size with LuGre friction, recorded as people record: `python -m benchmarks.scale_worlds --seed 1 --count 40`.

A world is arrays: what a log of the axis holds, and the truth behind it. Worlds are drawn in blocks of `BLOCK`: inside a block
size, motion, logging, clock, stamps and encoder are stratified, independently of one another.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.scale_axis import draw_axis
from benchmarks.scale_drive import clocks, drive, drive_noise, log_torque, worth_keeping
from benchmarks.scale_physics import NAMES, Array, Control, simulate

BLOCK = 40
_STRATA: dict[str, list[Any]] = {
    "kind": ["rotary"] * 27 + ["linear"] * 13,
    "motion": ["chirp"] * 5
    + ["open_chirp"] * 3
    + ["multisine"] * 4
    + ["open_multisine"] * 3
    + ["one_way"]
    + ["steps"] * 6
    + ["slow_tracking"] * 5
    + ["never_fast"]
    + ["pick_and_place"] * 6
    + ["free_decay"] * 6,
    "logging": ["held_from_stamp", "held_up_to_stamp", "point", "stale"] * 10,
    "clock": [False, True] * 20,
    "stamps": ["regular"] * 26 + ["jittered"] * 9 + ["missing"] * 4 + ["jittered, missing"],
    "encoder": ["fine"] * 16 + ["medium"] * 11 + ["coarse"] * 9 + ["one_step"] * 4,
    "noise": ["coloured"] * 26 + ["white"] * 14,
    "offset": [True] * 16 + [False] * 24,
}


@dataclass(frozen=True)
class Simulated:
    """What happened behind a log; `scale_bound` reads it.

    Attributes
    ----------
    ticks : ndarray, shape (k + 1,)
        Control ticks and the end [s].
    control : Control
        The controller and its reference.
    torque : ndarray, shape (k,)
        Torque that the drive was asked for and held over each tick [N m or N].
    logged : ndarray of bool, shape (k,)
        The ticks whose torque is in the log.
    noise : ndarray, shape (k, split)
        Torque noise that acted, held over equal parts of a tick.
    noise_level : float
        Its standard deviation.
    noise_rate : float
        Its corner [rad/s]; 0: white, a new value each tick.
    reading_noise : ndarray, shape (k,)
        Noise of the encoder as the controller read it, before rounding.
    encoder_noise, encoder_step : float
        Its standard deviation, and the step that is rounded to [rad or m].
    states : ndarray, shape (n, 3)
        True position, velocity and bristle at the stamps of the positions.
    scales : ndarray, shape (2,)
        Scales of position and velocity for the integrator.
    """

    ticks: Array
    control: Control
    torque: Array
    logged: np.ndarray[Any, np.dtype[np.bool_]]
    noise: Array
    noise_level: float
    noise_rate: float
    reading_noise: Array
    encoder_noise: float
    encoder_step: float
    states: Array
    scales: Array


@dataclass(frozen=True)
class ScaleWorld:
    """One recorded axis.

    Attributes
    ----------
    name, kind : str
        Seed and number; 'rotary' (rad, N m, kg m^2) or 'linear' (m, N, kg).
    t, position : ndarray, shape (n,)
        Stamps [s] and readings of the encoder.
    torque_t, torque : ndarray, shape (m,)
        Stamps and logged torque; `torque_t` is `t` where they share stamps.
    truth, believed : dict
        The parameters of `scale_physics.NAMES`; what a data sheet says, each off by up to 20 %, and no offset.
    acts : float
        Time after its stamp at which a logged value begins to act [s]: 0 for `held_from_stamp` and `stale` (for its fresh
        values), minus the log period for `held_up_to_stamp`, minus half of a control tick for `point` (the log looks in the
        middle of a tick, so the points themselves are the applied torque without delay), each less the clock's offset.
    log_period : float
        Nominal period of the log [s].
    drawn : dict
        What was drawn, for reports.
    simulated : Simulated
        What happened behind the log.
    """

    name: str
    kind: str
    t: Array
    position: Array
    torque_t: Array
    torque: Array
    truth: dict[str, float]
    believed: dict[str, float]
    acts: float
    log_period: float
    drawn: dict[str, str | float]
    simulated: Simulated


def draw(seed: int, number: int) -> ScaleWorld:
    """World `number` of `seed`; the same for the same arguments."""
    stratum = plan(seed, number)
    for attempt in range(100):
        world = _attempt(seed, number, stratum, np.random.default_rng([seed, number, attempt, 1]))
        if world is not None:
            return world
    raise RuntimeError(f"seed {seed}, world {number}: no sensible motion in 100 attempts")


def plan(seed: int, number: int) -> dict[str, Any]:
    """What the plan of the block has for this world, and in `size` where it is between the smallest and the largest axis."""
    block, place = divmod(number, BLOCK)
    rng = np.random.default_rng([seed, block, 0])
    chosen = {name: [values[i] for i in rng.permutation(BLOCK)] for name, values in _STRATA.items()}
    alike = [i for i in range(BLOCK) if chosen["kind"][i] == chosen["kind"][place]]
    order = rng.permutation(BLOCK)
    rank = sorted(alike, key=lambda i: int(order[i])).index(place)
    size = (rank + float(np.random.default_rng([seed, number, 2]).uniform())) / len(alike)
    stratum = {name: values[place] for name, values in chosen.items()} | {"size": size}
    if stratum["kind"] == "linear" and stratum["motion"] == "one_way":
        stratum["motion"] = "multisine"  # it would leave the machine
    return stratum


def _attempt(seed: int, number: int, stratum: dict[str, Any], rng: np.random.Generator) -> ScaleWorld | None:
    """A world, or None where its motion is none that a person would keep."""
    axis = draw_axis(stratum, rng)
    logging, stamps = stratum["logging"], stratum["stamps"]
    per_sample = int(rng.choice([4, 5, 8, 10])) if logging == "point" else 1
    ticks, t = clocks(axis, logging, per_sample, "jittered" in stamps, rng)
    noise, noise_rate = drive_noise(ticks, axis.noise_level, stratum["noise"], rng)
    control = drive(stratum["motion"], ticks, axis, rng)
    reading_noise = axis.encoder_noise * rng.standard_normal(ticks.size - 1)
    torque, states = simulate(
        ticks, noise, t, axis.parameters, axis.scales, control, reading_noise, axis.encoder_step
    )
    if not worth_keeping(stratum, axis, states, torque):
        return None
    own = axis.encoder_noise * rng.standard_normal(t.size) if logging == "point" else reading_noise
    position = states[:, 0] + own
    if axis.encoder_step > 0.0:
        position = np.round(position / axis.encoder_step) * axis.encoder_step
    every = int(rng.integers(2, 6)) if logging == "stale" else 1
    clock = float(rng.uniform(-0.02, 0.02)) if stratum["clock"] else 0.0
    lost = float(rng.uniform(0.01, 0.03)) if "missing" in stamps else 0.0
    kept = rng.uniform(size=t.size) >= lost
    kept_torque = rng.uniform(size=t.size) >= lost if stratum["clock"] else kept
    value, tick = log_torque(logging, torque, t.size, per_sample, every)
    logged = np.zeros(torque.size, dtype=bool)
    logged[tick[kept_torque & (tick >= 0)]] = True
    period = 1.0 / axis.rate
    begins = {"held_up_to_stamp": -period, "point": -0.5 * period / per_sample}.get(logging, 0.0)
    truth = dict(zip(NAMES, axis.parameters.tolist(), strict=True))
    drawn = stratum | {
        "rate": axis.rate,
        "samples": int(kept.sum()),
        "top_speed": axis.top_speed,
        "ramp": axis.ramp,
        "presliding": axis.presliding,
        "bristle_frequency": axis.bristle_rate / (2.0 * np.pi),
        "noise_level": axis.noise_level,
        "noise_corner": noise_rate / (2.0 * np.pi),
        "encoder_noise": axis.encoder_noise,
        "encoder_step": axis.encoder_step,
        "ticks_per_sample": per_sample,
        "fresh_every": every,
        "clock_offset": clock,
        "lost": lost,
    }
    return ScaleWorld(
        f"scale-{seed}-{number:03d}",
        stratum["kind"],
        t[kept],
        position[kept],
        t[kept_torque] + clock,
        value[kept_torque],
        truth,
        axis.believed,
        begins - clock,
        period,
        drawn,
        Simulated(
            ticks,
            control,
            torque,
            logged,
            noise,
            axis.noise_level,
            noise_rate,
            reading_noise,
            axis.encoder_noise,
            axis.encoder_step,
            states[kept],
            axis.scales,
        ),
    )


def table(seed: int, count: int, first: int = 0) -> None:
    """Print the worlds with their bounds in per cent of the true values, the offset's of the Coulomb friction."""
    from benchmarks.scale_bound import bound

    heads = ("Fc", "Fs", "vs", "s0", "s1", "s2", "J", "offset")
    print(f"{'name':13s} {'J or m':>8s} {'rate':>4s} {'n':>5s} {'motion':14s} {'logging':17s}", end="")
    print(
        f"{'encoder':9s}{'stamps':9s}{'fb/rate':>7s}{'aJ/Fc':>6s} ",
        *(f"{h:>6s}" for h in heads),
        "time/us  s",
    )
    below: list[bool] = []
    for number in range(first, first + count):
        begin = time.perf_counter()
        world = draw(seed, number)
        drawn = time.perf_counter() - begin
        least, truth, d = bound(world), world.truth, world.drawn
        scale = [truth[name] for name in NAMES[:-1]] + [truth["coulomb"]]
        share = [100.0 * least[name] / s for name, s in zip(NAMES, scale, strict=True)]
        below += [value < 5.0 for value in share]
        ratio = truth["inertia"] * float(d["top_speed"]) / float(d["ramp"]) / truth["coulomb"]
        print(
            f"{world.name:13s} {truth['inertia']:8.2g}{'*' if world.kind == 'linear' else ' '}{d['rate']:4.0f} {world.t.size:5d} "
            f"{d['motion']:14s} {d['logging']!s:16s}{'+' if d['clock'] else ' '}{d['encoder']:9s}{d['stamps']:9.9s}"
            f"{float(d['bristle_frequency']) * world.log_period:7.3f}{ratio:6.2f} ",
            *(f"{min(value, 9999.0):6.2f}" for value in share),
            f"{1e6 * least['acts']:7.1f} {drawn:.1f}+{time.perf_counter() - begin - drawn:.1f}",
            flush=True,
        )
    print(f"{100.0 * np.mean(below):.0f} % of the bounds are below 5 %")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=BLOCK)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    table(asked.seed, asked.count, asked.first)
