"""The offline axis at 10 kHz beside scipy's solve_ivp at the same accuracy, and beside real time.

Both move the same LuGre axis by the torque of a 1 kHz controller, noise included, held between ticks. The truth is
solve_ivp with a tolerance far below both. scipy gets every advantage: a compiled right-hand side, the fastest of
its methods here, restarted at every tick or not, and the loosest tolerance whose position error is no larger than
ours. A row of its own shows a smooth torque, where an adaptive step can be long. Where MuJoCo is installed, a tick of the shipped
mount on it stands beside one of the own simulator, each asked for by itself as a node does.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.friction.lugre import stribeck_level
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance

Array = NDArray[np.float64]

STEP = 1e-4  # s
TICK = 1e-3  # s
SUBSTEPS = 10
INERTIA = 1000.0  # kg m^2
LUGRE = {
    "coulomb": 78.1,
    "static": 117.2,
    "stribeck_velocity": 6.1e-4,
    "stiffness": 2.96e5,
    "damping": 3.4e4,
    "viscous": 572.0,
}
FIVE = (
    ("cogging", {"order": 72.0, "amplitude": 0.5, "phase": 0.3}),
    ("coulomb_asymmetry", {"asymmetry": 0.01}),
    ("viscous_asymmetry", {"asymmetry": 20.0}),
    ("imbalance", {"amplitude": 2.0, "phase": 0.1}),
    ("periodic_vibration", {"amplitude": 0.3, "frequency": 13.0, "phase": 0.0}),
)
METHODS = ("LSODA", "DOP853", "RK45")
TOLERANCES = 10.0 ** -np.arange(2.0, 11.0, 1.0)
SCALE = np.array([1e-3, 1e-3, 1e-4])  # rad, rad/s, rad: the sizes of the three states here


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--seconds", type=float, default=5.0, help="simulated time for the comparison")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: seconds beside scipy's, position error, and speed over real time with no effects and with five."""
    axis = Axis("azimuth", INERTIA, instance(law("lugre"), LUGRE))
    effects = tuple(instance(effect(name), values) for name, values in FIVE)
    crowded = Axis("azimuth", INERTIA, axis.friction, effects)
    span, ticks = arguments.seconds, round(arguments.seconds / TICK)
    held = smooth_torque(TICK * np.arange(ticks)) + _noise(ticks)
    middles = STEP * (np.arange(ticks * SUBSTEPS) + 0.5)
    with np.errstate(all="ignore"):  # scipy at a tolerance that is too loose for it
        rows = _compare(f"{span:g} s, torque of a controller", axis, held, TICK)
        rows += _compare(f"{span:g} s, smooth torque", axis, smooth_torque(middles), STEP)
    for name, kind, bar in (("LuGre alone", axis, 1000.0), ("LuGre and five effects", crowded, 300.0)):
        times = span / _fastest(lambda kind=kind: _simulate(kind, held, TICK))  # type: ignore[misc]
        rows.append({"name": f"times real time, {name} (beside: the bar)", "value": times, "unit": "1",
                     "beside": bar, "ratio": times / bar})  # fmt: skip
    return rows + _engine()


def _engine() -> list[dict[str, Any]]:
    """A tick of the shipped mount on MuJoCo beside one of the own simulator; nothing where it is not installed."""
    file = load_axis(shipped("mount_azimuth.yaml"))
    try:
        mount = MujocoSimulator(file.axis, shipped("mount_two_axis.xml"), file.axis.name, TICK)
    except InputError:
        return []
    torque = smooth_torque(TICK * np.arange(1000.0)).tolist()
    ours, engines = (
        1e3 * _fastest(lambda s=s: [s.step(one) for one in torque], 5)  # type: ignore[misc]
        for s in (Simulator(file.axis, TICK), mount)
    )
    name = "a tick of the shipped mount on MuJoCo, beside the own simulator"
    return [{"name": name, "value": engines, "unit": "us", "beside": ours, "ratio": engines / ours}]


def _compare(name: str, axis: Axis, torque: Array, period: float) -> list[dict[str, Any]]:
    """Ours and scipy's fastest way that is as accurate."""
    ends: Array = np.asarray(TICK * np.arange(1, round(len(torque) * period / TICK) + 1), dtype=np.float64)
    held = torque if period == TICK else np.zeros(0)
    truth = _scipy(held, "DOP853", 1e-11, ends, restart=len(held) > 0)
    every = round(TICK / period)
    error = _rms(_simulate(axis, torque, period)[every - 1 :: every, 0] - truth)
    seconds = _fastest(lambda: _simulate(axis, torque, period))
    how, other = _as_good(held, error, truth, ends)
    return [
        {"name": f"{name}; beside solve_ivp, {how}", "value": seconds, "unit": "s", "beside": other,
         "ratio": other / seconds},
        {"name": f"{name}: rms position error", "value": error, "unit": "rad"},
    ]  # fmt: skip


def smooth_torque(t: Array) -> Array:
    """A torque (N m) that breaks away, reverses and creeps; (n,) for instants t (n,)."""
    values: Array = 110.0 * np.sin(2.0 * np.pi * 0.2 * t) + 40.0 * np.sin(2.0 * np.pi * 0.53 * t)
    return values


def _noise(count: int) -> Array:
    """White torque noise of 1 N m rms, as the noise of an encoder makes it."""
    return np.random.default_rng(0).standard_normal(count)


@njit(cache=True)
def slope(t: float, state: Any, held: Any) -> Any:
    """Right-hand side for scipy; state: position (rad), velocity (rad/s), bristle deflection (rad).

    `held` (ticks,): torque (N m) held over each tick; empty for the smooth torque.
    """
    if len(held) == 0:
        torque = 110.0 * math.sin(2.0 * math.pi * 0.2 * t) + 40.0 * math.sin(2.0 * math.pi * 0.53 * t)
    else:
        torque = held[min(int(t / 1e-3), len(held) - 1)]
    velocity, deflection = state[1], state[2]
    level = stribeck_level(velocity, 78.1, 117.2, 6.1e-4)
    rate = velocity - 2.96e5 * abs(velocity) / level * deflection
    friction = 2.96e5 * deflection + 3.4e4 * rate + 572.0 * velocity
    return np.array([velocity, (torque - friction) / 1000.0, rate])


def _simulate(axis: Axis, torque: Array, period: float) -> Array:
    substeps = round(period / STEP)
    out = np.empty((len(torque), 4))
    compiled.run(compiled.build(axis, STEP, substeps), torque, out)
    return out


def _scipy(held: Array, method: str, tolerance: float, ends: Array, restart: bool) -> Array:
    """Positions (rad) at the ends of the ticks; `restart`: solve each tick by itself."""
    accuracy = {"rtol": tolerance, "atol": tolerance * SCALE}
    if not restart:
        span = (0.0, float(ends[-1]))
        longest = TICK if len(held) else np.inf
        found = solve_ivp(slope, span, np.zeros(3), method, ends, args=(held,), max_step=longest, **accuracy)
        whole: Array = found.y[0]
        return whole
    state, positions = np.zeros(3), np.empty(len(ends))
    for k in range(len(ends)):
        torque = held[k : k + 1]
        state = solve_ivp(slope, (0.0, TICK), state, method, args=(torque,), **accuracy).y[:, -1]
        positions[k] = state[0]
    return positions


def _as_good(held: Array, error: float, truth: Array, ends: Array) -> tuple[str, float]:
    """scipy's fastest way to come as near to the truth as `error`: which, and its time (s)."""
    found = []
    for restart in (False, True) if len(held) else (False,):
        for method in METHODS:
            for tolerance in TOLERANCES:
                begin = time.perf_counter()
                positions = _scipy(held, method, float(tolerance), ends, restart)
                seconds = time.perf_counter() - begin
                if len(positions) == len(truth) and _rms(positions - truth) <= error:
                    how = f"{method} rtol {tolerance:.0e}{', each tick' if restart else ''}"
                    found.append((seconds, how, method, float(tolerance), restart))
                    break
    seconds, how, method, tolerance, restart = min(found)
    return how, min(seconds, _fastest(lambda: _scipy(held, method, tolerance, ends, restart), 2))


def _fastest(job: Callable[[], object], times: int = 40) -> float:
    job()  # compiled and warm
    best = math.inf
    for _ in range(times):
        begin = time.perf_counter()
        job()
        best = min(best, time.perf_counter() - begin)
    return best


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
