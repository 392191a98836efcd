"""Second bodies against independent references: two equations of motion in scipy's solver."""

from __future__ import annotations

import numpy as np
import pytest
from physics_cases import INERTIA, plain, torque_at
from scipy.integrate import solve_ivp

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import simulate_open_loop
from tcs_friction.physics.terms import Instance, instance

SMOOTH = instance(
    law("coulomb_viscous"), {"coulomb": 1e-9, "viscous": 500.0}
)  # so that only the bodies matter


def simulated(item: Instance, duration: float, steps: int) -> tuple[float, float]:
    dt = duration / steps
    torque = torque_at((np.arange(steps) + 0.5) * dt)
    result = simulate_open_loop(Axis("test", INERTIA, SMOOTH, (item,)), torque, dt, substeps=1)
    return float(result.position[-1]), float(result.velocity[-1])


def reference(
    duration: float, ratio: float, frequency: float, damping: float, gap: float = 0.0
) -> tuple[float, float]:
    """Position and velocity of the shaft; `frequency` with the shaft held."""
    omega = 2.0 * np.pi * frequency
    carried = ratio * INERTIA

    def rates(t: float, y: np.ndarray) -> list[float]:
        _, v, deflection, w = y
        beyond = deflection - np.clip(deflection, -gap / 2.0, gap / 2.0)
        touching = gap == 0.0 or beyond != 0.0
        spring = carried * (omega**2 * beyond + 2.0 * damping * omega * (w - v)) if touching else 0.0
        drive = float(torque_at(np.array(t)))
        return [v, (drive - 500.0 * v + spring) / (INERTIA - carried), w - v, -spring / carried]

    solved = solve_ivp(rates, (0.0, duration), np.zeros(4), rtol=1e-9, atol=1e-13, max_step=5e-4)
    return float(solved.y[0, -1]), float(solved.y[1, -1])


@pytest.mark.parametrize(
    ("frequency", "damping", "ratio"), [(20.0, 0.03, 0.3), (5.0, 0.0, 0.6), (60.0, 0.2, 0.05)]
)
def test_flexible_mode_is_two_bodies_on_a_spring(frequency: float, damping: float, ratio: float) -> None:
    item = instance(
        effect("flexible_mode"), {"frequency": frequency, "damping": damping, "inertia_ratio": ratio}
    )
    position, velocity = simulated(item, 2.0, 40000)
    expected = reference(2.0, ratio, frequency * np.sqrt(1.0 - ratio), damping)
    assert position == pytest.approx(expected[0], abs=2e-6)
    assert velocity == pytest.approx(expected[1], abs=2e-5)


def test_backlash_is_two_bodies_with_a_gap() -> None:
    position, velocity = simulated(plain("backlash"), 1.0, 40000)
    expected = reference(1.0, 0.3, 50.0, 0.1, gap=2e-4)
    assert position == pytest.approx(expected[0], abs=5e-6)
    assert velocity == pytest.approx(expected[1], abs=5e-4)


def test_a_gap_that_is_never_crossed_leaves_the_second_body_behind() -> None:
    item = instance(effect("backlash"), {"gap": 10.0, "inertia_ratio": 0.4})
    torque = np.full(100, 60.0)
    free = instance(law("coulomb_viscous"), {"coulomb": 1e-9, "viscous": 0.0})
    light = simulate_open_loop(Axis("test", INERTIA, free, (item,)), torque, 1e-3)
    assert light.velocity[-1] == pytest.approx(60.0 * 0.1 / (0.6 * INERTIA), rel=1e-3)


def test_momentum_is_conserved_through_the_spring() -> None:
    """Without drive and friction nothing the bodies do to each other moves their common centre."""
    free = instance(law("coulomb_viscous"), {"coulomb": 1e-9, "viscous": 0.0})
    item = instance(effect("flexible_mode"), {"frequency": 10.0, "damping": 0.05, "inertia_ratio": 0.5})
    push = np.zeros(20000)
    push[:200] = 100.0
    result = simulate_open_loop(Axis("test", INERTIA, free, (item,)), push, 1e-4, substeps=1)
    assert result.velocity[-1] == pytest.approx(100.0 * 0.02 / INERTIA, rel=5e-3)
