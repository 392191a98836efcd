"""Friction laws against slow references and the physics they have to obey."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics_cases import COULOMB, DAHL, LAWS, LUGRE, STRIBECK
from scipy.integrate import solve_ivp

from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.friction import lugre
from tcs_friction.physics.registry import effect
from tcs_friction.physics.simulate import simulate_open_loop
from tcs_friction.physics.terms import Instance, instance

LUGRE_VALUES = st.fixed_dictionaries(
    {
        "coulomb": st.floats(1.0, 500.0),
        "drop": st.floats(0.0, 2.0),
        "stribeck_velocity": st.floats(1e-5, 0.1),
        "stiffness": st.floats(1e2, 1e8),
        "damping": st.floats(0.0, 1e5),
        "viscous": st.floats(0.0, 2e3),
    }
)


def lugre_of(values: Mapping[str, float]) -> Instance:
    """A LuGre instance from a coulomb torque and a relative drop."""
    rest = {name: value for name, value in values.items() if name != "drop"}
    return instance(lugre.TERM, {**rest, "static": values["coulomb"] * (1.0 + values["drop"])})


def friction_of(law: Instance, velocity: np.ndarray, dt: float) -> np.ndarray:
    """Friction torque (n,) along a velocity, by walking through a motion as a recording is walked through."""
    t = dt * np.arange(len(velocity))
    position = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt)])
    out = np.empty((len(t), 8))
    zero = np.zeros(len(t))
    built = machine.build(Axis("test", 1.0, law), dt)
    machine.evaluate(built, t, position, velocity, zero, zero, np.full((1, len(t)), 20.0), 1e-6, out)
    friction: np.ndarray = out[:, machine.DRY_PART] + out[:, machine.VISCOUS_PART]
    return friction


def stribeck_curve(values: Mapping[str, float], v: float) -> float:
    drop = values["static"] - values["coulomb"]
    level = values["coulomb"] + drop * float(np.exp(-((v / values["stribeck_velocity"]) ** 2)))
    return float(np.sign(v)) * level + values["viscous"] * v


@pytest.mark.parametrize("amplitude", [3e-4, 5e-3, 0.1])
def test_lugre_follows_a_stiff_solver(amplitude: float) -> None:
    """Independent reference: the printed equations in scipy's implicit Radau solver."""
    p = LUGRE.values

    def level(v: float) -> float:
        ratio = v / p["stribeck_velocity"]
        return float(p["coulomb"] + (p["static"] - p["coulomb"]) * np.exp(-ratio * ratio))

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        v = amplitude * np.sin(3.0 * t)
        return v - p["stiffness"] * abs(v) / level(v) * z

    t = np.arange(0.0, 4.0, 1e-4)
    solved = solve_ivp(
        rate, (0.0, 4.0), [0.0], method="Radau", t_eval=t, rtol=1e-8, atol=1e-13, max_step=0.01
    )
    z, v = solved.y[0], amplitude * np.sin(3.0 * t)
    expected = [
        p["stiffness"] * z[i] + p["damping"] * rate(t[i], z[i]) + p["viscous"] * v[i] for i in range(len(t))
    ]
    assert np.abs(friction_of(LUGRE, v, 1e-4) - expected).max() < 0.1


@pytest.mark.parametrize("law", [LUGRE, STRIBECK], ids=["lugre", "stribeck_static"])
@pytest.mark.parametrize("speed", [-0.1, -6e-4, 1e-4, 6e-4, 2e-3, 0.05])
def test_steady_state_is_the_stribeck_curve(law: Instance, speed: float) -> None:
    steady = friction_of(law, np.full(20000, speed), 1e-2)[-1]
    assert steady == pytest.approx(stribeck_curve(law.values, speed), rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(LUGRE_VALUES, st.floats(1e-5, 1.0))
def test_steady_state_for_any_values(values: dict[str, float], speed: float) -> None:
    law = lugre_of(values)
    far = 40.0 * law.values["static"] / law.values["stiffness"]  # many bristle widths of travel
    steady = friction_of(law, np.full(400, speed), far / speed / 400)[-1]
    assert steady == pytest.approx(stribeck_curve(law.values, speed), rel=1e-6)


@settings(max_examples=60, deadline=None)
@given(LUGRE_VALUES, st.floats(1e-6, 1.0), st.integers(0, 2**32 - 1))
def test_bristle_is_stable_at_any_stiffness_and_step(values: dict[str, float], dt: float, seed: int) -> None:
    """|stiffness z| never exceeds the static level, however coarse the step."""
    law = lugre_of({**values, "damping": 0.0, "viscous": 0.0})
    velocity = np.random.default_rng(seed).normal(0.0, 0.3, 200)
    torque = friction_of(law, velocity, dt)
    assert np.isfinite(torque).all()
    assert np.abs(torque).max() <= law.values["static"] * (1.0 + 1e-12)


@pytest.mark.parametrize("law", LAWS, ids=lambda item: str(item.term.id))
def test_friction_is_odd(law: Instance) -> None:
    velocity = np.random.default_rng(1).normal(0.0, 0.01, 500)
    assert np.array_equal(friction_of(law, velocity, 1e-3), -friction_of(law, -velocity, 1e-3))


@pytest.mark.parametrize("law", [COULOMB, STRIBECK], ids=["coulomb_viscous", "stribeck_static"])
def test_static_laws_always_dissipate(law: Instance) -> None:
    velocity = np.random.default_rng(2).normal(0.0, 0.01, 2000)
    assert (friction_of(law, velocity, 1e-3) * velocity >= 0.0).all()


@settings(max_examples=40, deadline=None)
@given(LUGRE_VALUES, st.integers(0, 2**32 - 1))
def test_energy_is_never_created_where_the_passivity_condition_holds(
    values: dict[str, float], seed: int
) -> None:
    """Work put in from rest is never negative: what the bristle gives back it was given before."""
    passive = {**values, "viscous": values["viscous"] + 1.001 * values["damping"] * values["drop"]}
    law = lugre_of(passive)
    assert not [line for line in law.term.warn(law.values) if "passive" in line]
    width = law.values["coulomb"] / law.values["stiffness"]
    rng = np.random.default_rng(seed)
    dt = 1e-3
    slow = np.cumsum(rng.normal(0.0, 1.0, 200))
    velocity = np.repeat(slow / np.abs(slow).max(), 50) * 10 ** rng.uniform(-1.0, 1.5) * width / (50 * dt)
    friction = friction_of(law, velocity, dt)
    power = (
        friction * velocity
    )  # the bristle's travel to instant i is the mean of two velocities: use the same
    work = np.cumsum(np.concatenate([[0.0], 0.5 * (power[1:] + power[:-1]) * dt]))
    assert work.min() >= -0.02 * np.abs(power).max() * dt - 1e-3 * work.max()


def test_a_broken_passivity_condition_is_named_and_does_create_energy() -> None:
    """With much damping, little viscous friction and a steep drop, a small oscillation about a speed feeds on the law."""
    law = LUGRE.replace(damping=3e5, viscous=0.0, static=300.0)
    warnings = law.term.warn(law.values)
    assert any("not passive" in line and "viscous" in line for line in warnings)
    assert (
        LUGRE.replace(static=70.0).term.warn(LUGRE.replace(static=70.0).values)[0].startswith("static (70)")
    )
    assert Axis("a", 1.0, law).warnings() == [f"axis a: {line}" for line in warnings]


def test_dahl_is_lugre_without_drop_and_damping() -> None:
    v = DAHL.values
    same = instance(
        lugre.TERM,
        {
            "coulomb": v["coulomb"],
            "static": v["coulomb"],
            "stribeck_velocity": 1.0,
            "stiffness": v["stiffness"],
            "damping": 0.0,
            "viscous": v["viscous"],
        },
    )
    velocity = np.random.default_rng(3).normal(0.0, 0.01, 1000)
    assert friction_of(DAHL, velocity, 1e-3) == pytest.approx(friction_of(same, velocity, 1e-3), abs=1e-9)


def test_exponent_shapes_the_stribeck_curve() -> None:
    steady = friction_of(STRIBECK.replace(exponent=1.0, viscous=0.0), np.full(10, 6e-4), 1e-3)[-1]
    assert steady == pytest.approx(78.0 + 32.0 * np.exp(-1.0))


def test_simulated_axis_follows_a_stiff_solver() -> None:
    """The whole closed equation of motion, LuGre axis from rest through reversals."""
    p = LUGRE.values

    def rates(t: float, y: np.ndarray) -> list[float]:
        _, v, z = y
        ratio = v / p["stribeck_velocity"]
        level = p["coulomb"] + (p["static"] - p["coulomb"]) * np.exp(-ratio * ratio)
        dz = v - p["stiffness"] * abs(v) / level * z
        friction = p["stiffness"] * z + p["damping"] * dz + p["viscous"] * v
        return [v, (150.0 * np.sin(4.0 * t) - friction) / 1000.0, dz]

    solved = solve_ivp(
        rates, (0.0, 3.0), [0.0, 0.0, 0.0], method="Radau", rtol=1e-8, atol=1e-12, max_step=0.01
    )
    steps = 60000
    t = (np.arange(steps) + 0.5) * 3.0 / steps
    result = simulate_open_loop(Axis("test", 1000.0, LUGRE), 150.0 * np.sin(4.0 * t), 3.0 / steps)
    assert result.position[-1] == pytest.approx(solved.y[0, -1], rel=1e-4)
    assert result.velocity[-1] == pytest.approx(solved.y[1, -1], abs=1e-5)


@pytest.mark.parametrize("dt", [1e-4, 2e-3])
def test_damping_feels_a_level_that_changes_even_at_coarse_steps(dt: float) -> None:
    """A bump passed at speed: the bristle follows its level at a rate that sigma1 turns into some N m."""
    speed, p = 0.165, LUGRE.values
    bump = instance(effect("local_friction_bump"), {"amplitude": 0.3, "centre": 0.1, "width": 0.05})

    def level(q: float) -> float:
        return float(p["coulomb"] * (1.0 + 0.3 * np.exp(-(((q - 0.1) / 0.05) ** 2))))

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        return speed - p["stiffness"] * speed / level(speed * t) * z

    t = np.arange(0.0, 1.2, dt)
    solved = solve_ivp(
        rate, (0.0, 1.2), [0.0], method="Radau", t_eval=t, rtol=1e-10, atol=1e-15, max_step=1e-3
    )
    slip = np.array([float(rate(t[i], solved.y[:, i])[0]) for i in range(len(t))])
    out, zero = np.empty((len(t), 8)), np.zeros(len(t))
    built = machine.build(Axis("test", 1.0, LUGRE, (bump,)), dt)
    velocity = np.full(len(t), speed)
    machine.evaluate(built, t, speed * t, velocity, zero, zero, np.full((1, len(t)), 20.0), 1e-6, out)
    expected = p["stiffness"] * solved.y[0] + p["damping"] * slip
    far = t > 0.05
    assert np.abs(p["damping"] * slip[far]).max() > 2.0
    assert np.abs(out[:, machine.DRY_PART] - expected)[far].max() < 0.05
