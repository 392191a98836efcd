"""What inertia and friction law were believed to be, are retuned, and are beside what was found."""

from __future__ import annotations

import math

from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.parameters import Form, Part
from tcs_friction.diagnose.outcome.result import Told
from tcs_friction.physics.axis import Axis

INERTIA = "inertia"


def parameter_table(believed: Axis, retuned: Fit, improved: Fit) -> tuple[Told, ...]:
    """One line for each parameter that one of the three has."""
    axes = {"believed": _values(believed), "retuned": _values(retuned.axis), "improved": _values(improved.axis)}
    declared = (*believed.friction.term.parameters, *improved.axis.friction.term.parameters)
    units = {p.name: p.unit_for(believed.kind, believed.torque_unit) for p in declared} | {INERTIA: believed.unit("kg m^2")}
    names = dict.fromkeys(name for values in axes.values() for name in values)
    fits = [(retuned, axes["retuned"]), (improved, axes["improved"])]
    return tuple(
        Told(name, units[name], axes["believed"].get(name), *(_told(fit, values, name) for fit, values in fits)) for name in names
    )


def _values(axis: Axis) -> dict[str, float]:
    return {INERTIA: axis.inertia, **axis.friction.values}


def _told(fit: Fit, values: dict[str, float], name: str) -> tuple[float, float | None] | None:
    """A value with its standard deviation, to first order; without one where it was not fitted."""
    if name not in values:
        return None
    for k, number in enumerate(fit.free):
        if number.name == name and number.part in (Part.INERTIA, Part.FRICTION):
            scale = abs(values[name]) if number.form is Form.LOGARITHM else 1.0
            return values[name], scale * math.sqrt(max(float(fit.covariance[k, k]), 0.0) * fit.squares.dispersion)
    return values[name], None
