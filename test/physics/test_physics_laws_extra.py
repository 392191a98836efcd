"""The laws named as alternatives: each against what its own paper says it does."""

from __future__ import annotations

import numpy as np
import pytest
from physics_cases import COULOMB
from scipy.interpolate import CubicHermiteSpline

from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law, laws
from tcs_friction.physics.terms import Instance, instance

BLIMAN = instance(
    law("bliman_sorine"),
    {"coulomb": 78.0, "transient": 40.0, "presliding_distance": 2e-4, "ratio": 0.3, "viscous": 500.0},
)
RESET = instance(
    law("reset_integrator"),
    {"coulomb": 78.0, "static": 110.0, "stiffness": 3e5, "damping": 2e4, "viscous": 500.0},
)
MAXWELL = instance(
    law("maxwell_slip"),
    {
        "coulomb": 78.0,
        "static": 110.0,
        "stribeck_velocity": 6e-4,
        "stiffness": 3e5,
        "viscous": 500.0,
        "elements": 10.0,
    },
)
BAM = instance(
    law("bam"),
    {
        "coulomb": 78.0,
        "static": 110.0,
        "stribeck_velocity": 6e-4,
        "viscous": 500.0,
        "load": 0.1,
        "load_stribeck": 0.05,
    },
)
FREE = instance(
    law("free_curve"),
    {
        "coulomb": 78.0,
        "static": 110.0,
        "stribeck_velocity": 2e-4,
        "shape_1": 1.2,
        "shape_2": 0.7,
        "shape_3": 1.1,
        "stiffness": 3e5,
        "damping": 100.0,
        "viscous": 500.0,
    },
)
EXTRA = (BLIMAN, RESET, MAXWELL, BAM, FREE)


def walked(chosen: Instance, position: np.ndarray, dt: float, torque: float = 0.0) -> np.ndarray:
    """Friction torque (n,) along positions (n,)."""
    velocity = np.gradient(position, dt)
    out = np.empty((len(position), 8))
    zero = np.zeros(len(position))
    built = machine.build(Axis("test", 1.0, chosen), dt)
    temperature = np.full((1, len(position)), 20.0)
    t = dt * np.arange(len(position))
    machine.evaluate(built, t, position, velocity, zero, torque + zero, temperature, 1e-7, out)
    friction: np.ndarray = out[:, machine.DRY_PART] + out[:, machine.VISCOUS_PART]
    return friction


def test_all_laws_of_the_contract_are_there() -> None:
    named = {
        "coulomb_viscous",
        "stribeck_static",
        "dahl_viscous",
        "lugre",
        "reset_integrator",
        "bliman_sorine",
        "maxwell_slip",
        "bam",
        "free_curve",
    }
    assert named <= set(laws())


@pytest.mark.parametrize("chosen", EXTRA, ids=lambda item: item.term.id)
@pytest.mark.parametrize("speed", [2e-3, 1e-2])
def test_fast_sliding_is_coulomb_and_viscous(chosen: Instance, speed: float) -> None:
    position = speed * 1e-3 * np.arange(3000)
    torque = walked(chosen, position, 1e-3)
    drop = 32.0 * np.exp(-((speed / 6e-4) ** 2)) if chosen in (MAXWELL, BAM) else 0.0
    assert torque[-1] == pytest.approx(78.0 + 500.0 * speed + drop, rel=1e-6)


@pytest.mark.parametrize("chosen", EXTRA, ids=lambda item: item.term.id)
def test_friction_is_odd(chosen: Instance) -> None:
    position = 1e-3 * np.sin(2.0 * np.pi * 0.5 * 1e-3 * np.arange(4000))
    assert walked(chosen, position, 1e-3) == pytest.approx(-walked(chosen, -position, 1e-3), abs=1e-9)


@pytest.mark.parametrize("chosen", EXTRA, ids=lambda item: item.term.id)
@pytest.mark.parametrize("amplitude", [1e-5, 2e-4, 5e-3])
def test_a_closed_loop_dissipates(chosen: Instance, amplitude: float) -> None:
    position = amplitude * np.sin(2.0 * np.pi * 0.25 * 1e-3 * np.arange(12001))
    torque = walked(chosen, position, 1e-3)
    last = slice(8000, 12001)
    work = np.sum(0.5 * (torque[last][1:] + torque[last][:-1]) * np.diff(position[last]))
    assert work > 0.0


def test_bliman_sorine_depends_on_the_path_alone() -> None:
    """Same path at ten times the speed: same dry friction; it overshoots after a reversal, then settles."""
    shape = np.concatenate([np.linspace(0.0, 3e-3, 3000), np.linspace(3e-3, 0.0, 3000)[1:]])
    still = BLIMAN.replace(viscous=0.0)
    slow, fast = walked(still, shape, 1e-2), walked(still, shape, 1e-3)
    assert slow == pytest.approx(fast, abs=1e-9)
    after = -slow[3000:]
    assert after.max() > 1.05 * 78.0
    assert after[-1] == pytest.approx(78.0, rel=1e-3)


def test_reset_integrator_breaks_at_its_static_torque() -> None:
    still = RESET.replace(damping=0.0, viscous=0.0)
    torque = walked(still, 1e-6 * np.arange(1000), 1.0)
    limit = 78.0 / 3e5
    assert torque.max() == pytest.approx(110.0, rel=0.01)
    assert torque[100] == pytest.approx(110.0 / 78.0 * 3e5 * 1e-4, rel=1e-6)  # while the bond holds
    assert torque[int(limit / 1e-6) + 2] == pytest.approx(78.0)


@pytest.mark.parametrize("begin", [0.0, 1e-3, 2e-3, 3e-3])
def test_the_moments_at_which_a_bond_holds_again_and_lets_go_are_known_within_a_step(begin: float) -> None:
    """The impulse of friction over one reversal: moments known to a step would miss half of a step times the jumps of 32 N m."""
    steps = 4e-3, 1e-5

    def impulse(step: float) -> float:
        t = np.arange(begin, 0.7, step)
        friction = walked(RESET, 1e-3 * np.sin(2.0 * np.pi * (t - 0.1)), step)
        inside = friction[(t > begin + 0.2 - 1e-9) & (t < begin + 0.6 + 1e-9)]
        return step * float(np.sum(inside) - 0.5 * (inside[0] + inside[-1]))

    coarse, fine = map(impulse, steps)
    assert coarse == pytest.approx(fine, abs=0.05 * 32.0 * steps[0])


def test_maxwell_slip_starts_with_its_stiffness_and_remembers_the_outer_loop() -> None:
    """An inner loop closes on itself: Masing's rules, which a single bristle does not obey."""
    plain = MAXWELL.replace(static=78.0, viscous=0.0)
    assert walked(plain, 1e-7 * np.arange(20), 1.0)[-1] == pytest.approx(3e5 * 19e-7, rel=1e-6)
    legs = [(0.0, 4e-4), (4e-4, 1e-4), (1e-4, 3e-4), (3e-4, 1e-4)]
    position = np.concatenate([np.linspace(a, b, 500)[:-1] for a, b in legs] + [[1e-4]])
    torque = walked(plain, position, 1.0)
    assert torque[-1] == pytest.approx(torque[499 + 499], abs=0.02 * 78.0)
    lugre = instance(law("dahl_viscous"), {"coulomb": 78.0, "stiffness": 3e5, "viscous": 0.0})
    bristle = walked(lugre, position, 1.0)
    assert abs(bristle[-1] - bristle[499 + 499]) > abs(torque[-1] - torque[499 + 499])


def test_maxwell_slip_keeps_torque_and_share_of_each_element() -> None:
    assert MAXWELL.term.state_size(MAXWELL.values, 1e-3) == 2 * 10 + 1


def slid(chosen: Instance, speed: float) -> float:
    """Friction torque, N m, where the axis has slid long at a speed (rad/s)."""
    return float(walked(chosen, 1e-5 * np.arange(3000), 1e-5 / speed)[-1])


def test_a_free_curve_is_lugres_curve_times_its_shapes() -> None:
    still = FREE.replace(viscous=0.0)
    knots = 2e-4 * 3.0 ** np.arange(-2.0, 3.0)

    def lugre(speed: np.ndarray) -> np.ndarray:
        return 78.0 + 32.0 * np.exp(-((speed / 2e-4) ** 2))

    shapes = np.array([1.0, 1.2, 0.7, 1.1, 1.0])
    assert [slid(still, v) for v in knots] == pytest.approx(lugre(knots) * shapes, rel=1e-6)
    between = np.geomspace(knots[0], knots[-1], 13)
    slopes = np.array([0.0, *(0.5 * (np.log(shapes[2:]) - np.log(shapes[:-2]))), 0.0])
    spline = CubicHermiteSpline(np.log(knots) / np.log(3.0), np.log(shapes), slopes)
    expected = lugre(between) * np.exp(spline(np.log(between) / np.log(3.0)))
    assert [slid(still, v) for v in between] == pytest.approx(expected, rel=1e-6)
    outside = np.array([0.01 * knots[0], 100.0 * knots[-1]])
    assert [slid(still, v) for v in outside] == pytest.approx(lugre(outside))


def test_a_free_curve_whose_shapes_are_one_is_lugres() -> None:
    values = {"coulomb": 78.0, "static": 110.0, "stribeck_velocity": 2e-4, "stiffness": 3e5, "damping": 1e4, "viscous": 500.0}
    position = 1e-3 * np.sin(2.0 * np.pi * 0.5 * 1e-3 * np.arange(4000))
    plain, lugre = (walked(instance(law(name), values), position, 1e-3) for name in ("free_curve", "lugre"))
    assert plain == pytest.approx(lugre, abs=1e-9)


def test_a_law_of_two_elements_says_how_stiff_its_bristles_are() -> None:
    """Its friction rises from rest by the slope of the faster element less that of the slower one."""
    rise = walked(BLIMAN.replace(viscous=0.0), 1e-9 * np.arange(2), 1e-3)[-1] / 1e-9
    completed = effect("presliding").of_law(BLIMAN.values_of_law)
    assert completed["stiffness"] == pytest.approx(rise, rel=1e-3)


def test_bam_grows_with_the_load() -> None:
    position = 1e-2 * 1e-3 * np.arange(100)
    light, heavy = walked(BAM, position, 1e-3), walked(BAM, position, 1e-3, torque=-50.0)
    assert heavy[-1] - light[-1] == pytest.approx(5.0)
    slow = 1e-6 * 1e-3 * np.arange(100)
    stuck = walked(BAM, slow, 1e-3, torque=50.0)[-1] - walked(BAM, slow, 1e-3)[-1]
    assert stuck == pytest.approx(5.0 + 2.5, rel=1e-3)


def test_without_load_and_drop_bam_is_coulomb() -> None:
    plain = instance(
        law("bam"), {"coulomb": 78.0, "static": 78.0, "stribeck_velocity": 1e-3, "viscous": 500.0}
    )
    position = 1e-3 * np.sin(0.01 * np.arange(2000))
    assert walked(plain, position, 1e-3) == pytest.approx(walked(COULOMB, position, 1e-3), abs=1e-9)
