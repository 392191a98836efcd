"""Joint fits: the true axis leaves whitened noise, and its numbers are the true ones."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.machine import build, tick
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording


def axis() -> Axis:
    values = {"coulomb": 2.0, "stiffness": 800.0, "viscous": 1.5}
    return Axis("turntable", 1.2, instance(law("dahl_viscous"), values))


def recording(real: Axis, seconds: float = 60.0, seed: int = 1) -> Recording:
    """A proportional-integral velocity loop with torque and encoder noise follows legs at three speeds and sinusoids."""
    period, noise = 2e-3, np.random.default_rng(seed)
    machine = build(real, period / 20, 20)
    t = period * np.arange(int(seconds / period))
    speed = 0.8 * np.sin(2 * np.pi * t / 12.0) + 0.3 * np.sin(2 * np.pi * 0.9 * t)
    position, torque = np.empty(len(t)), np.empty(len(t))
    integral, command, drift = 0.0, 0.0, 0.0
    for k, wanted in enumerate(speed):
        position[k] = machine.body[0] + 2e-6 * noise.standard_normal()
        error = wanted - machine.body[1]
        integral += period * error
        command = 20.0 * error + 60.0 * integral
        torque[k] = command
        drift = 0.9 * drift + 0.05 * noise.standard_normal()
        tick(machine, command + drift, 0.0, 0.0)
    return Recording(t, position, torque)


def test_the_true_axis_leaves_whitened_noise() -> None:
    balance = TorqueBalance(prepare([recording(axis())]))
    fit = settle(balance, axis(), white_noise(balance.samples))
    assert fit.squares.value / balance.samples.effective_count == pytest.approx(1.0, abs=0.25)
    assert fit.axis.inertia == pytest.approx(1.2, rel=0.05)
    assert fit.axis.friction.values["coulomb"] == pytest.approx(2.0, rel=0.03)  # the feedback takes 2 % of it
