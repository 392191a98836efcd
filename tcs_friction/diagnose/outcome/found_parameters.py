"""The numbers of a found effect with their standard deviations, to first order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.parameters import Form, amplitudes, moved
from tcs_friction.diagnose.search.laws import Lack
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Parameter, Role


def parameters_of_law(fit: Fit, lack: Lack) -> dict[str, dict[str, Any]]:
    """What a law says of an effect that completes it, with standard deviations to first order."""
    term = lack.effect.term
    covariance = fit.covariance * fit.squares.dispersion

    def stated(axis: Axis) -> dict[str, float]:
        return dict(term.of_law(axis.friction.values_of_law))

    here = stated(fit.axis)
    slopes = {
        name: np.array(
            [
                (stated(moved(fit.axis, fit.free, k, n.step))[name] - value) / n.step
                for k, n in enumerate(fit.free)
            ]
        )
        for name, value in here.items()
    }
    variances = {name: float(slope @ covariance @ slope) for name, slope in slopes.items()}
    return {
        name: {
            "value": value,
            "std": math.sqrt(variances[name]),
            "unit": term.parameter(name).unit_for(fit.axis.kind, fit.axis.torque_unit),
        }
        for name, value in here.items()
        if variances[name] > 0.0  # otherwise nothing that was fitted has a say in it
    }


def parameters_of(balance: TorqueBalance, fit: Fit, item: Instance) -> dict[str, dict[str, Any]]:
    """Value, standard deviation and unit of every parameter that was free."""
    numbers = {(n.name, n.form): k for k, n in enumerate(fit.free) if n.effect == item.identity}
    covariance = fit.covariance * fit.squares.dispersion
    result: dict[str, dict[str, Any]] = {}
    for parameter, phase in amplitudes(item.term.parameters):
        if parameter.role is Role.FIXED or item.values[parameter.name] == parameter.default:
            continue
        for each, deviation in _deviations(parameter, phase, item, numbers, covariance):
            unit = each.unit_for(fit.axis.kind, fit.axis.torque_unit)
            if item.term.discontinuous and item.term.coordinate == "time" and each.role is Role.SHAPE:
                deviation = max(deviation, _moment_within(balance, item.values[each.name]))
            if each.name == item.term.alignment:  # the log may have the torque at either end of its leeway
                deviation = math.hypot(deviation, balance.data.leeway / math.sqrt(3.0))
            result[each.name] = {"value": item.values[each.name], "std": deviation, "unit": unit}
    return result


def _moment_within(balance: TorqueBalance, moment: float) -> float:
    """Standard deviation (s) of a moment between two fitted samples, at one of which it is, or in what the low pass blurs."""
    t = balance.data.joined("t")[balance.samples.rows]
    after = int(np.clip(np.searchsorted(t, moment), 1, len(t) - 1))
    gap = max(float(t[after] - t[after - 1]), 1.0 / balance.data.cutoff)
    return gap / math.sqrt(3.0)


def _deviations(
    parameter: Parameter,
    phase: Parameter | None,
    item: Instance,
    numbers: Mapping[tuple[str, Form], int],
    covariance: np.ndarray,
) -> list[tuple[Parameter, float]]:
    """Standard deviation of a parameter and of its phase, of those that were free; linear about the optimum."""
    value = item.values[parameter.name]
    if phase is None:
        for form, scale in ((Form.LOGARITHM, abs(value)), (Form.PLAIN, 1.0)):
            if (parameter.name, form) in numbers:
                k = numbers[parameter.name, form]
                return [(parameter, scale * math.sqrt(covariance[k][k]))]
        return []
    if (parameter.name, Form.COSINE) not in numbers:
        return []
    both = [numbers[parameter.name, form] for form in (Form.COSINE, Form.SINE)]
    block, angle = covariance[np.ix_(both, both)], item.values[phase.name]
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-math.sin(angle), math.cos(angle)]) / max(value, 1e-300)
    return [
        (each, math.sqrt(max(float(direction @ block @ direction), 0.0)))
        for each, direction in ((parameter, along), (phase, across))
    ]
