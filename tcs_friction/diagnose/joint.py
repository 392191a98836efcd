"""Joint fits of everything that an axis has, noise and weights estimated along the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcs_friction.diagnose.balance import Balance, Fit, Free
from tcs_friction.physics.axis import Axis

ASTRAY = 2.0  # factor from a believed number of the law, from which its fit may be another basin
PRIOR = 1.0  # log units by which a base parameter may wander from the believed one if the data do not say


def prior(free: list[Free] | tuple[Free, ...]) -> np.ndarray:
    """Standard deviations that keep undetermined base parameters near where they were; effects are free."""
    return np.array([PRIOR if f.owner < 0 else (3.0 if f.kind == "log" else np.inf) for f in free])


def settle(balance: Balance, axis: Axis, rounds: int = 3) -> Fit:
    """Joint fit of everything the axis has, noise and weights estimated along the way."""
    balance.estimate_noise(balance.residual(axis), axis.inertia)
    fit = None
    for i in range(rounds):
        free = balance.free(axis)
        fit = balance.fit(axis, free, prior(free), iterations=20 if i == 0 else 8)
        axis = fit.axis
        balance.weigh(axis)
    assert fit is not None
    return judged(balance, fit)


def judged(balance: Balance, fit: Fit) -> Fit:
    """The fit with its squares under the present weights."""
    return replace(fit, squares=balance.squares(fit.axis))


def without(balance: Balance, fit: Fit, index: int) -> Fit:
    """The joint fit without one effect."""
    fewer = fit.axis.without_effect(fit.axis.effects[index])
    free = balance.free(fewer)
    return balance.fit(fewer, free, prior(free), iterations=5, tolerance=0.5)


def recovered(balance: Balance, fit: Fit, believed: Axis) -> Axis:
    """The fit's axis, or one fitted from the believed law where that does better.

    Without the effect the law's own numbers may have gone far astray to stand in for it, and find no way back.
    """
    start = replace(fit.axis, friction=believed.friction, inertia=believed.inertia)
    ratios = [fit.axis.friction.values[name] / max(v, 1e-300) for name, v in believed.friction.values.items()]
    if all(1.0 / ASTRAY < ratio < ASTRAY or ratio == 0.0 for ratio in ratios):
        return fit.axis
    free = balance.free(start)
    again = balance.fit(start, free, prior(free), iterations=20)
    return again.axis if again.squares < balance.squares(fit.axis) else fit.axis
