"""Units that the columns of a table may be in, by what they measure, and their conversion to SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording.recording import Column

KELVIN = 273.15
"""Zero of the Celsius scale, K."""

Conversion = tuple[float, float]
"""Factor and offset: value in SI units = factor * value + offset."""


def _scaled(**factors: float) -> dict[str, Conversion]:
    return {unit.replace("_per_", "/"): (factor, 0.0) for unit, factor in factors.items()}


SECONDS = _scaled(s=1.0, ms=1e-3, us=1e-6, ns=1e-9, min=60.0)
RADIANS = _scaled(
    rad=1.0, mrad=1e-3, urad=1e-6, deg=np.pi / 180, arcmin=np.pi / 10800, arcsec=np.pi / 648000, rev=2 * np.pi
)
RADIANS_PER_SECOND = _scaled(
    rad_per_s=1.0, mrad_per_s=1e-3, deg_per_s=np.pi / 180, arcsec_per_s=np.pi / 648000, rev_per_s=2 * np.pi,
    rpm=np.pi / 30, rev_per_min=np.pi / 30,
)  # fmt: skip
DRIVE = _scaled(A=1.0, mA=1e-3, V=1.0, mV=1e-3)
"""Of a drive whose torque is known up to a constant: current, voltage. Everything that has torque in it is then in such units."""
NEWTON_METRES = _scaled(Nm=1.0, mNm=1e-3, kNm=1e3) | DRIVE
METRES = _scaled(m=1.0, mm=1e-3, um=1e-6)
METRES_PER_SECOND = _scaled(m_per_s=1.0, mm_per_s=1e-3, um_per_s=1e-6)
NEWTONS = _scaled(N=1.0, mN=1e-3, kN=1e3) | DRIVE
CELSIUS = {"degC": (1.0, 0.0), "C": (1.0, 0.0), "K": (1.0, -KELVIN), "degF": (5 / 9, -160 / 9)}

ANY_KIND = {"time": SECONDS, "temperature": CELSIUS}
KINDS: dict[str, dict[str, dict[str, Conversion]]] = {
    "rotary": {
        "position": RADIANS, "velocity": RADIANS_PER_SECOND, "torque": NEWTON_METRES, "reference": RADIANS, **ANY_KIND,
    },
    "linear": {
        "position": METRES, "velocity": METRES_PER_SECOND, "torque": NEWTONS, "reference": METRES, **ANY_KIND,
    },
}  # fmt: skip
"""Units of each signal by the kind of axis."""

WITHOUT = ("", "1", "-")
"""What stands for no unit."""


@dataclass(frozen=True)
class Named:
    """A signal's column and the unit in its name, for conversion and for messages."""

    signal: str
    column: str
    unit: str


def spelled(unit: str) -> str:
    """A unit without what people put between its letters: `N·m`, `N m` and `N*m` are `Nm`, `µm` is `um`, `°C` is `degC`."""
    for found, plain in ((" ", ""), ("*", ""), ("·", ""), ("⋅", ""), ("°", "deg"), ("µ", "u"), ("μ", "u")):
        unit = unit.replace(found, plain)
    return unit


def is_unit(word: str) -> bool:
    """Whether a word is a unit of any signal."""
    return any(_known(word, units) for signals in KINDS.values() for units in signals.values())


def conversions(columns: Sequence[Named], where: str, kind: str | None) -> dict[str, Conversion]:
    """How to convert each signal. kind: of the axis, None if nobody has said; then the units must agree on one.

    Raises InputError for a unit that does not measure what its column should hold.
    """
    with_unit = [item for item in columns if item.unit not in WITHOUT]
    kinds = [kind] if kind is not None else list(KINDS)
    told: Named | None = None
    for item in with_unit:
        fitting = [name for name in kinds if _known(item.unit, KINDS[name][item.signal])]
        if not fitting:
            raise _misfit(item, told, where, kinds)
        if len(fitting) < len(kinds):
            kinds, told = fitting, item
    units = KINDS[kinds[0]]
    found = {item.signal: units[item.signal][str(_known(item.unit, units[item.signal]))] for item in with_unit}
    return {item.signal: found.get(item.signal, (1.0, 0.0)) for item in columns}


def kind_of(columns: Sequence[Named]) -> str | None:
    """The kind of axis that the units of some signals belong to, None where they fit both."""
    told = [one for one in columns if one.unit not in WITHOUT]
    fitting = [kind for kind, known in KINDS.items() if all(_known(one.unit, known[one.signal]) for one in told)]
    return fitting[0] if len(fitting) == 1 else None


def converted(values: Column, conversion: Conversion) -> Column:
    """Values in SI units."""
    factor, offset = conversion
    return values if conversion == (1.0, 0.0) else values * factor + offset


def _known(unit: str, units: Mapping[str, Conversion]) -> str | None:
    """The unit meant, in whatever case it is written, except that a capital M never stands for milli."""
    if unit in units:
        return unit
    folded = {name.casefold(): name for name in units}
    meant = unit.casefold()
    if unit.startswith("M") and meant[1:] in folded:
        return None
    return folded.get(meant)


def _misfit(item: Named, told: Named | None, where: str, kinds: Sequence[str]) -> InputError:
    expected = nearest(item.unit, [unit for kind in kinds for unit in KINDS[kind][item.signal]])
    because = f" (a {kinds[0]} axis, as {told.column!r} says)" if told is not None else ""
    return InputError(where, f"column {item.column!r} holds the {item.signal} in {item.unit!r}", expected + because)
