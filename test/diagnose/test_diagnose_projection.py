"""The residual with the fit's own numbers projected out, changes of it by effects, and what a recording can show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from concealed_torque_cases import DT, conditioned, settled
from scipy import ndimage

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import load_axis
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import least_squares, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search.projection import ProjectedResidual, survey
from tcs_friction.diagnose.search.start import gain_by_load_from_motion
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording


def test_a_body_s_column_by_its_transfer_is_that_of_the_kernel() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(2)))
    projected = ProjectedResidual(balance, fit)
    slow = {"frequency": 3.0, "damping": 0.05, "inertia_ratio": 0.3}  # a mode that this slow motion wakes
    item = instance(effect("flexible_mode"), slow)
    changes = (projected.change(item), projected.change_by_body(item))
    exact, quick = (ndimage.uniform_filter1d(x, 20)[2000:-2000] for x in changes)
    assert np.std(quick - exact) < 0.05 * np.std(exact)


def test_noise_of_the_encoder_is_no_load_dependence() -> None:
    """It is in the acceleration, so in a load that is taken from the motion and in the residual."""
    file = load_axis(Path(__file__).parents[2] / "config" / "azimuth_1p2m.yaml")
    assert file.control is not None
    reference = Reference(Sinusoid(amplitude=0.2, period=20.0, duration=60.0))
    run = simulate_loop(file.axis, reference, file.control.controller, seed=1)
    balance = TorqueBalance(prepare([Recording(run.t, run.position, run.torque, source="simulated")]))
    fit = settle(balance, file.axis, white_noise(balance.samples))
    item = instance(effect("load_dependent_friction"), {"coefficient": 0.07})
    assert gain_by_load_from_motion(ProjectedResidual(balance, fit), item) < 30.0


def test_a_search_looks_at_the_survey_of_the_recording() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(0), seconds=60.0))
    view = survey(balance, fit.axis)
    assert view.duration == pytest.approx(60.0 - DT)
    assert view.travel[0] < view.travel[1]
    assert view.slow < view.fast


def test_a_gain_is_that_of_a_joint_fit() -> None:
    """What the believed numbers follow is projected out, so a linear effect's gain is that of fitting all together."""
    balance, fit = settled(conditioned(np.random.default_rng(3), lambda m: np.full(len(m.t), 0.4), seconds=60.0))
    projected = ProjectedResidual(balance, fit)
    bias = instance(effect("torque_bias"), {"bias": 1.0})
    gain, (size,) = projected.gain(projected.columns([bias]))
    model = fit.axis.with_effect(bias.replace(bias=float(size)))
    free = balance.free(model)
    together = least_squares(balance, model, free, fit.noise, np.full(len(free), np.inf), tolerance=1e-6)
    assert size == pytest.approx(0.4, rel=0.2)
    assert gain == pytest.approx(fit.squares - together.squares, rel=0.02)
