"""Friction against speed as every report shows it: measured points beside models, and what a model leaves of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tcs_friction.numerics.by_speed import TorqueBySpeed
from tcs_friction.report.figures import MEASURED, MUTED, Picture
from tcs_friction.report.plot import Array, Curve, Panel, Plot, Rule, Scale, Spacing
from tcs_friction.report.plot_picture import drawn_plot

DEGREE = np.pi / 180.0  # rad
ROOM = 1.25  # times the largest mean friction, up to which the picture reaches


@dataclass(frozen=True)
class Shown:
    """How a model is shown: by which name and in which colour."""

    name: str
    color: str


def speed_scale(found: TorqueBySpeed, rotary: bool) -> tuple[Scale, float]:
    """The scale of speed, deg/s or m/s, and how many of its units the unit of the recording is."""
    unit = 1.0 / DEGREE if rotary else 1.0
    scale = Scale(
        "speed",
        "deg/s" if rotary else "m/s",
        Spacing.ASINH,
        linear=10.0 ** round(math.log10(found.width * unit)),
        also=("rad/s", DEGREE) if rotary else None,
    )
    return scale, unit


def draw_friction_by_speed(
    found: TorqueBySpeed, shown: Mapping[str, Shown], best: str, torque_unit: str, rotary: bool, name: str = "friction_speed"
) -> Picture:
    """Friction over speed above, what the model `best` leaves of it below. shown: models by their name in `found`, in order."""
    scale, unit = speed_scale(found, rotary)
    above = [Curve("samples", MUTED, found.cloud[0] * unit, found.cloud[1], points=True, size=1.2)]
    for key, model in shown.items():
        if key in found.models:
            above += _model(found, key, model, unit)
    above += _measured(found, found.measured, found.scatter, unit, MEASURED)
    left = found.residual(best)
    below = _band(found, best, shown[best], unit) + _measured(found, left, 2.0 * found.error, unit, MEASURED)
    reach = ROOM * float(np.abs(found.measured).max())
    reach_below = 1.3 * float(np.quantile(np.abs(left) + 2.0 * found.error, 0.98)) or 1.0
    panels = (
        (Panel(scale, Scale("friction", torque_unit, limits=(-reach, reach)), tuple(above), rules=(_zero(),)),),
        (
            Panel(
                scale,
                Scale(f"less {shown[best].name}", torque_unit, limits=(-reach_below, reach_below)),
                tuple(below),
                rules=(_zero(),),
            ),
        ),
    )
    return drawn_plot(Plot(name, _caption(shown, best), panels, heights=(3.4, 1.5), linked=True))


def _caption(shown: Mapping[str, Shown], best: str) -> str:
    return (
        "Friction against speed: torque less inertia and all other known effects. Points: mean in a bin of speed, bars: scatter "
        "of the samples (grey). Near zero speed the scale is even, further out it goes by decades. After a reversal friction has "
        "to build up: an axis that speeds up is drawn apart from one that slows down. "
        f"Below: what {shown[best].name} leaves, with bars and band of two standard deviations."
    )


def _zero() -> Rule:
    return Rule(0.0, MUTED, dashed=False)


def _ways(found: TorqueBySpeed) -> list[tuple[np.ndarray, str, bool]]:
    """Bins (k,) of each way, how it is called, and whether |v| grows."""
    return [(~found.speeding_up, "slowing down", False), (found.speeding_up, "speeding up", True)]


def _model(found: TorqueBySpeed, key: str, model: Shown, unit: float) -> list[Curve]:
    torque, std = found.models[key].torque, found.models[key].std
    curves = []
    for bins, way, grows in _ways(found):
        zero = int(np.searchsorted(found.speed[bins], 0.0))  # a gap: friction does not go through zero in a straight line
        speed, here = np.insert(found.speed[bins] * unit, zero, 0.0), np.insert(torque[bins], zero, np.nan)
        reach = None if std is None else 2.0 * np.insert(std[bins], zero, np.nan)
        low, high = (None, None) if reach is None else (here - reach, here + reach)
        curves.append(Curve(f"{model.name}, {way}", model.color, speed, here, dashed=grows, low=low, high=high))
    return curves


def _band(found: TorqueBySpeed, key: str, model: Shown, unit: float) -> list[Curve]:
    """Zero, with the band of the model's own uncertainty."""
    std = found.models[key].std
    if std is None:
        return []
    order = np.argsort(found.speed)
    x, zero, width = found.speed[order] * unit, np.zeros(len(order)), 2.0 * std[order]
    return [Curve("", model.color, x, zero, size=0.8, low=-width, high=width)]


def _measured(found: TorqueBySpeed, torque: Array, reach: Array, unit: float, color: str) -> list[Curve]:
    return [
        Curve(
            f"measured, {way}",
            color,
            found.speed[bins] * unit,
            torque[bins],
            points=True,
            size=4.0,
            hollow=grows,
            low=torque[bins] - reach[bins],
            high=torque[bins] + reach[bins],
        )
        for bins, way, grows in _ways(found)
    ]
