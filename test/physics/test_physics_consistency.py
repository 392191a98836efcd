"""Simulation and evaluation agree: what drives a simulated motion is what that motion requires."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics_cases import COULOMB, LAWS, LUGRE, VALUES, axis_with, residual, rms, run
from scipy.ndimage import uniform_filter1d

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance

# What acts at single instants is compared by its impulse, smoothed over so many samples
SMOOTHED = {"backlash": 200, "load_step": 5, "presliding": 5}
# The time of an impact is known to a step, and the flight after it makes the error grow until the next contact
SHARE = {"backlash": 0.25}


def test_every_effect_is_tried_here() -> None:
    assert set(VALUES) == set(effects())


@pytest.mark.parametrize("name", sorted(VALUES))
def test_required_torque_of_a_simulated_motion_is_the_applied_one(name: str) -> None:
    axis = axis_with(name)
    without = axis_with(friction=axis.friction)
    measured = run(axis)
    width = SMOOTHED.get(name, 1)
    full = rms(uniform_filter1d(residual(axis, measured), width))
    lacking = rms(uniform_filter1d(residual(without, measured), width))
    assert lacking > 0.3
    assert full < SHARE.get(name, 0.02) * lacking


@pytest.mark.parametrize("law", LAWS, ids=lambda item: str(item.term.id))
def test_every_law_agrees_while_the_axis_slides(law: Instance) -> None:
    measured = run(Axis("test", 1000.0, law))
    sliding = np.abs(np.gradient(measured.position, 2e-4))[50:-50] > 2e-3
    difference = residual(Axis("test", 1000.0, law), measured)[sliding]
    assert sliding.mean() > 0.5
    assert rms(difference) < 0.05


@settings(max_examples=12, deadline=None)
@given(st.sets(st.sampled_from(sorted(set(VALUES) - {"backlash", "stribeck", "presliding"})), max_size=8))
def test_any_subset_of_effects_agrees(names: set[str]) -> None:
    if {"flexible_mode", "position_dependent_inertia"} <= names:
        names.discard("position_dependent_inertia")
    axis = axis_with(*sorted(names), friction=LUGRE)
    assert rms(residual(axis, run(axis, duration=1.5))) < 0.7


def test_an_arrested_axis_stays_where_it_is() -> None:
    """Torque below the static law's level does not move it, and no drift adds up."""
    from tcs_friction.physics.simulate import simulate_open_loop

    torque = 70.0 * np.sin(2.0 * np.pi * np.arange(4000) * 1e-3)
    result = simulate_open_loop(Axis("test", 1000.0, COULOMB), torque, 1e-3)
    assert np.abs(result.position).max() < 1e-9
    assert np.abs(result.friction - torque).max() < 0.5
