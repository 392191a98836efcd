"""The identification problem of the paper's section 5.3, for the benchmarks: friction about two crossings of zero speed."""

from __future__ import annotations

import numpy as np

from benchmarks import accuracy
from tcs_friction.conditioning.motion import FrictionSeries, prepare
from tcs_friction.identify.cost import LuGreCost
from tcs_friction.identify.problem import Problem, pose
from tcs_friction.identify.start import believed_start
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.report.paper.identification import paper_box

POINTS = 4600  # each way, as in the paper
PERIOD = 24.0  # s, of the sinusoid whose top speed is 0.1 deg/s
TOP_SPEED = np.deg2rad(0.1)
NOISE = 0.5  # N m rms
TRUE = {
    "coulomb": 78.1,
    "static": 117.2,
    "stribeck_velocity": 6.1e-4,
    "stiffness": 2.96e5,
    "damping": 3.4e4,
    "viscous": 572.0,
}


def axis() -> Axis:
    """The paper's azimuth axis."""
    return Axis("azimuth", 1000.0, instance(law("lugre"), TRUE))


def drawn(number: int) -> Axis:
    """Number 0: the paper's axis; others are drawn at random within the paper's search box."""
    box, random = paper_box(), np.random.default_rng([11, number])
    while number:
        values = accuracy.draw(random).friction.values
        vector = np.array([values[name] for name in box.names])
        if ((box.lower < vector) & (vector < box.upper)).all():
            return Axis("azimuth", 1000.0, instance(law("lugre"), values))
    return axis()


def series(seed: int = 0, points: int = POINTS, of: Axis | None = None) -> list[FrictionSeries]:
    """Friction (of the paper's axis) against time about a crossing upwards and one downwards, with white noise, at 1 kHz."""
    random = np.random.default_rng(seed)
    t = 1e-3 * np.arange(points)
    found = []
    for sign in (1.0, -1.0):
        velocity = sign * TOP_SPEED * np.sin(2.0 * np.pi * (t - t[-1] / 2.0) / PERIOD)
        found.append(
            FrictionSeries(
                t, velocity, friction(t, velocity, of or axis()) + NOISE * random.standard_normal(points)
            )
        )
    return found


def friction(t: np.ndarray, velocity: np.ndarray, of: Axis) -> np.ndarray:
    """(n,) N m along a motion that comes from sliding."""
    before = t - t[-1] - 1e-3
    longer, motion = np.concatenate([before, t]), np.concatenate([np.full(len(t), velocity[0]), velocity])
    position = np.concatenate([[0.0], np.cumsum(0.5 * (motion[1:] + motion[:-1]) * 1e-3)])
    out, zero = np.empty((len(longer), 8)), np.zeros(len(longer))
    built = machine.build(of, 1e-3)
    machine.evaluate(built, longer, position, motion, zero, zero, np.full((1, len(longer)), 20.0), 1e-9, out)
    result: np.ndarray = out[len(t) :, machine.DRY_PART] + out[len(t) :, machine.VISCOUS_PART]
    return result


def problem(seed: int = 0, points: int = POINTS, of: Axis | None = None) -> Problem:
    """The least-squares problem of these points."""
    return pose(of or axis(), prepare(series(seed, points, of)))


def lugre_cost(posed: Problem) -> LuGreCost:
    """The paper's cost of six parameters over all points, in the box that the data suggest."""
    return LuGreCost(posed, False, False, believed_start(posed), points=len(posed.motion))
