"""The concealed worlds: reproducible, of the asked size, and, seen through the product's own physics, what they claim to be."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.concealed_baselines import baselines, residual_of
from benchmarks.concealed_effects import EFFECTS, EXCLUSIVE, OUTSIDE, compatible
from benchmarks.concealed_oracle import detection_limit, whitened
from benchmarks.concealed_physics import PERIOD, Encoder, simulate
from benchmarks.worlds import World, draw_axis, draw_effects, draw_environment, draw_world, write_world
from tcs_friction.config import load_axis
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.bags import read_recordings

STRETCH = 0.2  # 80 s


def world_with(*names: str, size: float = 5.0, seed: int = 0, stretch: float = STRETCH) -> World:
    return draw_world(np.random.default_rng(seed), names, size, stretch)


def true_axis(world: World, *names: str) -> Axis:
    """The product's axis with the world's true parameters and these effects."""
    believed = world.believed.axis
    term = law("lugre") if believed.friction.term.id == "lugre" else believed.friction.term
    declared = {p.name for p in term.parameters}
    friction = instance(term, {n: v for n, v in world.truth.friction.items() if n in declared})
    axis = replace(believed, inertia=world.truth.inertia, friction=friction)
    for name in names:
        values = dict(world.truth.parameters[name])
        if name == "stribeck":
            values["drop"] = world.truth.friction["static"] - world.truth.friction["coulomb"]
        axis = axis.with_effect(instance(effect(name), values))
    return axis


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_every_effect_of_the_vocabulary_can_be_concealed() -> None:
    assert set(EFFECTS) - set(OUTSIDE) == set(effects()) - {"learned_map"}


def test_same_seed_same_world() -> None:
    one, two = (draw_world(np.random.default_rng(5), 2, 3.0, STRETCH) for _ in range(2))
    assert one.truth == two.truth
    assert np.array_equal(one.recording.position, two.recording.position)
    assert one.believed.axis == two.believed.axis
    assert world_with(seed=6).truth.inertia != one.truth.inertia


# Those left out have limits of their own (a lag of at least 0.2 ms, say) and come as near as these let them.
SIZED = sorted(set(EFFECTS) - {"presliding", "flexible_mode", "actuator_lag"})


@pytest.mark.parametrize(
    ("name", "size"), [*((name, 4.0) for name in SIZED), ("cogging", 0.05), ("imbalance", 0.3)]
)
def test_effects_have_the_size_asked_for(name: str, size: float) -> None:
    truth = world_with(name, size=size, stretch=0.06).truth
    assert truth.effect_torque_rms == pytest.approx(size * truth.noise_floor, rel=0.15)
    assert truth.torque_rms[name] == pytest.approx(size * truth.noise_floor, rel=1e-6)


def test_nothing_concealed_is_nothing() -> None:
    world = world_with()
    assert world.truth.effects == ()
    assert world.truth.effect_torque_rms < 1e-9
    assert residual_without_effects() < 1.7 * world.truth.noise_floor


@cache
def residual_without_effects() -> float:
    """Of the same axis and motion as all worlds with this seed: noise and what smoothing does, N m rms."""
    world = world_with()
    return rms(residual_of(true_axis(world), world.recording))


ADDITIVE = (
    "actuator_lag",
    "cable_hysteresis",
    "cable_wrap",
    "coulomb_asymmetry",
    "encoder_periodic_error",
    "imbalance",
    "load_dependent_friction",
    "load_step",
    "local_friction_bump",
    "periodic_vibration",
    "position_dependent_friction",
    "position_dependent_inertia",
    "quadratic_drag",
    "stribeck",
    "torque_bias",
    "torque_ripple",
    "transport_delay",
    "viscous_asymmetry",
    "warmup_drift",
)


@pytest.mark.parametrize("name", ADDITIVE)
def test_product_physics_explains_the_independent_world(name: str) -> None:
    """Two writings of the same effect, other integrator, other step: with the true values only noise is left."""
    world = world_with(name)
    assert rms(residual_of(true_axis(world), world.recording)) > 2.0 * residual_without_effects()
    assert rms(residual_of(true_axis(world, name), world.recording)) < 1.2 * residual_without_effects()


def test_flexible_mode_of_the_product_is_that_of_the_world() -> None:
    world = world_with("flexible_mode", size=9.0)
    left = rms(residual_of(true_axis(world, "flexible_mode"), world.recording))
    lacking = rms(residual_of(true_axis(world), world.recording))
    assert lacking > 1.6 * residual_without_effects()
    assert left < 1.3 * residual_without_effects()


def test_coarser_steps_give_the_same_world() -> None:
    """The worlds are converged: half the step changes nothing that an encoder sees."""
    rng = np.random.default_rng(1)
    environment, physics = (
        draw_environment(rng, STRETCH),
        draw_axis(rng)._replace(cogging=2.0, cogging_order=40.0),
    )
    coarse = simulate(physics, environment, Encoder(), 20)
    fine = simulate(physics, environment, Encoder(), 40)
    assert np.abs(coarse[:, 0] - fine[:, 0]).max() < 1e-7


def test_no_pair_is_drawn_that_acts_as_one() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        drawn = draw_effects(rng, 3)
        assert len(set(drawn)) == 3
        assert compatible(drawn)
    assert not compatible(tuple(EXCLUSIVE[0]))


def test_bag_holds_what_was_recorded_and_the_truth_lies_elsewhere(tmp_path: Path) -> None:
    world = world_with("cogging")
    write_world(world, tmp_path / "open", tmp_path / "sealed")
    file = load_axis(tmp_path / "open" / "axis.yaml")
    assert file.signals is not None
    (read,) = read_recordings([tmp_path / "open" / "recording"], file.signals)
    assert np.array_equal(read.position, world.recording.position)
    assert np.array_equal(read.torque, world.recording.torque)
    assert set(read.exogenous) == {"elevation_velocity", "wind_speed"}
    assert json.loads((tmp_path / "sealed" / "truth.json").read_text())["effects"] == ["cogging"]
    for path in (tmp_path / "open").rglob("*"):
        assert path.is_dir() or b"cogging" not in path.read_bytes()


def test_oracles_filter_makes_its_noise_white() -> None:
    """Torque noise and encoder noise as the worlds have them, through the filter: variance one in its band."""
    world = world_with(stretch=0.4)
    from scipy.ndimage import gaussian_filter1d

    rng = np.random.default_rng(0)
    environment = draw_environment(rng, 0.4)
    position = (
        environment.encoder_noise
        + rng.uniform(-0.5, 0.5, len(environment.encoder_noise)) * Encoder().resolution
    )
    acceleration = np.gradient(np.gradient(position, PERIOD), PERIOD)
    noise = gaussian_filter1d(
        world.truth.noise_floor * environment.torque_noise - world.truth.inertia * acceleration,
        0.004 / PERIOD,
    )
    power = np.abs(np.fft.rfft(whitened(noise, world))) ** 2 / len(noise)
    frequency = np.fft.rfftfreq(len(noise), PERIOD)
    for low, high in ((0.5, 5.0), (5.0, 20.0), (20.0, 40.0)):
        assert power[(frequency > low) & (frequency < high)].mean() == pytest.approx(1.0, abs=0.15)


def test_oracles_limit_does_not_depend_on_the_size_shown() -> None:
    small, large = (world_with("cogging", size=size) for size in (1.0, 6.0))
    limits = [detection_limit(world, true_axis(world)) for world in (small, large)]
    assert limits[0] == pytest.approx(limits[1], rel=0.1)
    assert limits[0] < 0.2 * small.truth.noise_floor


def test_baselines_see_a_plain_effect() -> None:
    world = world_with("wind_torque", stretch=0.3)
    for named in baselines(world.recording, world.believed, world.truth.noise_floor).values():
        assert "wind_torque" in named
