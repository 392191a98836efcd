"""Friction that grows with the load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import INERTIA, PERIOD, SPEED, axis_of

from tcs_friction.conditioning.motion import prepare
from tcs_friction.identify.determined import Verdicts, judge
from tcs_friction.identify.problem import Problem, pose
from tcs_friction.identify.start import believed_start, space_of
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording

BAM = {"coulomb": 80.0, "static": 110.0, "stribeck_velocity": 8e-4, "viscous": 500.0, "exponent": 2.0}
BAM |= {"load": 0.1, "load_stribeck": 0.05}
WRAP = instance(effect("cable_wrap"), {"stiffness": 9000.0})
WEIGHT = instance(effect("imbalance"), {"amplitude": 40.0, "phase": 0.5 * np.pi})


def loaded(load: Instance) -> Axis:
    return replace(axis_of(BAM, "bam"), effects=(load,))


def bam_recording(load: Instance, noise: float = 1.0) -> Recording:
    """A sinusoid, and the logged torque that it takes against that load, on which alone there is noise."""
    t = np.arange(24000) / 500.0
    turn = 2.0 * np.pi / PERIOD
    q, v, a = (
        SPEED / turn * x for x in (-np.cos(turn * t), turn * np.sin(turn * t), turn**2 * np.cos(turn * t))
    )
    opposing = 9000.0 * q if load is WRAP else 40.0 * np.cos(q)
    drop = np.exp(-((v / BAM["stribeck_velocity"]) ** 2))
    dry = BAM["coulomb"] + (BAM["static"] - BAM["coulomb"]) * drop
    share = BAM["load"] + BAM["load_stribeck"] * drop
    torque = np.zeros(len(t))
    for _ in range(40):
        friction = (dry + share * np.abs(torque)) * np.sign(v) + BAM["viscous"] * v
        torque = INERTIA * a + opposing + friction
    random = np.random.default_rng(0)
    q = q + 2e-8 * random.standard_normal(len(t))
    return Recording(t, q, torque + noise * random.standard_normal(len(t)), source="test")


def judged(axis: Axis, data: Recording) -> tuple[Problem, Verdicts]:
    problem = pose(axis, prepare([data]))
    space = space_of(problem, True, True, False)
    start = believed_start(problem)
    return problem, judge(problem, start, space, axis.friction.values, "squares", True, {})


def test_noise_of_the_logged_torque_is_not_taken_for_friction() -> None:
    problem, verdicts = judged(loaded(WRAP), bam_recording(WRAP))
    found = dict(zip(problem.names, verdicts.refined.unknowns, strict=True))
    assert set(verdicts.reasons) <= {problem.inertia_index}  # it hardly accelerates
    for name in ("coulomb", "static", "stribeck_velocity"):
        assert found[name] == pytest.approx(BAM[name], rel=0.03)
    assert found["load"] == pytest.approx(BAM["load"], abs=0.025)


def test_a_constant_load_does_not_tell_its_share() -> None:
    problem, verdicts = judged(loaded(WEIGHT), bam_recording(WEIGHT, noise=10.0))
    assert problem.names.index("load") in verdicts.reasons
    assert verdicts.refined.unknowns[0] == pytest.approx(BAM["coulomb"], rel=0.01)


def test_derivatives_with_a_load_are_those_of_the_torque() -> None:
    problem = pose(loaded(WRAP), prepare([bam_recording(WRAP)]))
    start = believed_start(problem)
    slopes = problem.linearised(start)[1]
    for k in (0, 3, 5, problem.inertia_index, problem.offset_index):
        step = np.zeros(len(start))
        step[k] = max(1e-3 * start[k], 1e-3)
        change = (problem.torque(start + step) - problem.torque(start - step)) / (2.0 * step[k])
        counted = problem.weights > 0.0
        assert np.allclose(slopes[counted, k], change[counted], atol=1e-3 * np.abs(slopes[:, k]).max())
