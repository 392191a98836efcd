"""Joint fits of everything that an axis has, noise and weights estimated along the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcs_friction.diagnose.fit.balance import Balance, Fit, timing
from tcs_friction.diagnose.fit.parameters import Free
from tcs_friction.physics.axis import Axis

ASTRAY = 2.0  # factor from a believed number of the law, from which its fit may be another basin
PRIOR = 1.0  # log units by which a base parameter may wander from the believed one if the data do not say


def prior(free: list[Free] | tuple[Free, ...]) -> np.ndarray:
    """Standard deviations that keep undetermined base parameters near where they were; effects are free."""
    return np.array([PRIOR if f.owner < 0 else (3.0 if f.kind == "log" else np.inf) for f in free])


def settle(balance: Balance, axis: Axis, rounds: int = 3) -> Fit:
    """Joint fit of everything the axis has, timing, noise and weights estimated along the way."""
    balance.estimate_noise(balance.residual(axis), axis.inertia)
    fit = None
    for i in range(rounds):
        iterations = 20 if i == 0 else 8
        fit = untimed(balance, timed(balance, axis, iterations), iterations)
        axis = fit.axis
        balance.weigh(axis)
    assert fit is not None
    return judged(balance, fit)


def timed(balance: Balance, axis: Axis, iterations: int, tolerance: float = 1.0) -> Axis:
    """The axis after a calm fit of all that times the torque, and of its base.

    The controller answers the encoder's noise with torque: a fit to all frequencies puts the torque where it cancels that noise.
    """
    free = balance.free(axis)
    some = [f for f, late in zip(free, timing(axis, free), strict=True) if late or f.owner < 0]
    return balance.fit(axis, some, prior(some), iterations, tolerance, calm=True).axis


def untimed(balance: Balance, axis: Axis, iterations: int, tolerance: float = 1.0) -> Fit:
    """Joint fit, under the present weights, of everything but what times the torque."""
    free = balance.free(axis)
    return balance.fit(axis, free, prior(free), iterations, tolerance, still=timing(axis, free))


def joined(balance: Balance, axis: Axis, iterations: int, tolerance: float = 1.0) -> Fit:
    """Joint fit under the present weights; an axis with a filter of the torque is timed first."""
    if any(item.term.filters for item in axis.effects):
        axis = timed(balance, axis, iterations, tolerance)
    return untimed(balance, axis, iterations, tolerance)


def judged(balance: Balance, fit: Fit) -> Fit:
    """The fit with its squares under the present weights."""
    return replace(fit, squares=balance.squares(fit.axis))


def without(balance: Balance, fit: Fit, index: int, iterations: int = 5, tolerance: float = 0.5) -> Fit:
    """The joint fit without one effect; where that timed the torque, the alignment does what it can."""
    item = fit.axis.effects[index]
    fewer = fit.axis.without_effect(item)
    if item.term.filters:
        fewer = timed(balance, fewer, iterations, tolerance)
    return joined(balance, fewer, iterations, tolerance)


def recovered(balance: Balance, fit: Fit, believed: Axis) -> Axis:
    """The fit's axis, or one fitted from the believed law where that does better.

    Without the effect the law's own numbers may have gone far astray to stand in for it, and find no way back.
    """
    start = replace(fit.axis, friction=believed.friction, inertia=believed.inertia)
    ratios = [fit.axis.friction.values[name] / max(v, 1e-300) for name, v in believed.friction.values.items()]
    if all(1.0 / ASTRAY < ratio < ASTRAY or ratio == 0.0 for ratio in ratios):
        return fit.axis
    again = joined(balance, start, iterations=20)
    return again.axis if again.squares < balance.squares(fit.axis) else fit.axis
