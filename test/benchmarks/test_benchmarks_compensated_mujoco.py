"""The benchmark of compensation on MuJoCo: with the effect and without it, and what counts as named right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.compensated_mujoco import KNOWN, EngineBench, EngineWorld, _text, named_right
from benchmarks.compensated_tracking import Choice
from benchmarks.mujoco_effects import Truth
from benchmarks.mujoco_worlds import PARTS, believe, draw
from tcs_friction.config import AxisFile, load_axis, shipped
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

pytest.importorskip("mujoco", reason="of the optional set mujoco")


def made(name: str, size: float) -> EngineWorld:
    """A world whose recording is not run."""
    plain, s = (draw(np.random.default_rng(3), True, False, False) for _ in range(2))
    s.size = size
    truth = PARTS[name](s)
    telescope = load_axis(shipped("azimuth_1p2m.yaml")).axis
    true = replace(telescope, inertia=s.inertia, friction=instance(law("lugre"), s.friction), effects=())
    at_rest = Recording(np.arange(3.0), np.zeros(3), np.zeros(3))
    return EngineWorld(
        name, at_rest, at_rest, AxisFile(believe(s.rng, s, "lugre", None)), truth, true, _text(s.model), _text(plain.model)
    )


@pytest.mark.parametrize("name", KNOWN)
def test_every_effect_is_in_one_model_and_not_in_the_other(name: str, tmp_path: Path) -> None:
    world = made(name, 6.0)
    assert set().union(*world.truth.effects) <= set(effects())
    positions = []
    for text in (world.plain, world.model):
        (tmp_path / "model.xml").write_text(text)
        simulator = MujocoSimulator(world.friction, tmp_path / "model.xml", "axis", 1e-3, position=3.0)
        assert simulator.inertia == pytest.approx(world.friction.inertia, rel=0.02 if name != "mode" else 0.5)
        for k in range(400):
            simulator.step(600.0 if k < 300 else -300.0)
        positions.append(simulator.position)
    assert abs(positions[1] - positions[0]) > 1e-7


def test_cancelling_what_the_engine_s_motor_cogs_brings_tracking_to_the_ideal(tmp_path: Path) -> None:
    world = made("cogging", 40.0)
    bench = EngineBench(replace(world, believed=AxisFile(world.friction)), tmp_path)
    slow = {"kind": "sinusoid", "amplitude": 0.05, "period": 10.0, "duration": 5.0}
    bench.references = [reference_from_mapping(slow, "test")]
    amplitude, order, phase = (float(word) for word in world.model.split('cogging="')[1].split('"')[0].split())
    # The engine's torque drives with the sine, the product's opposes with the cosine
    values = {"order": order, "amplitude": amplitude, "phase": phase + 0.5 * np.pi}
    model = world.friction.with_effect(instance(effect("cogging"), values))
    ideal = bench.tracking(Choice(world.friction, ()), world.friction).rms
    assert bench.tracking(Choice(world.friction, ())).rms > 1.05 * ideal
    assert bench.tracking(Choice(model, ("cogging",))).rms == pytest.approx(ideal, rel=0.01)


def test_named_right_is_the_effect_alone_and_one_that_there_is_a_word_for() -> None:
    gravity = Truth((("imbalance", "cable_wrap"),), "")
    assert named_right(["cable_wrap"], gravity)
    assert not named_right([], gravity)
    assert not named_right(["cogging"], gravity)
    assert not named_right(["imbalance", "cogging"], gravity)
    assert not named_right(["imbalance"], replace(gravity, partial=True))
