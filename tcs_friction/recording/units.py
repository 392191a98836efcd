"""Units that the columns of a table may be in, by what they measure, and their conversion to SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcs_friction.errors import InputError, nearest

KELVIN = 273.15
"""Zero of the Celsius scale, K."""

Conversion = tuple[float, float]
"""Factor and offset: value in SI units = factor * value + offset."""


def _scaled(**factors: float) -> dict[str, Conversion]:
    return {unit.replace("_per_", "/"): (factor, 0.0) for unit, factor in factors.items()}


SECONDS = _scaled(s=1.0, ms=1e-3, us=1e-6, ns=1e-9, min=60.0, h=3600.0, d=86400.0)
RADIANS = _scaled(
    rad=1.0, mrad=1e-3, urad=1e-6, deg=np.pi / 180, mdeg=np.pi / 180e3, arcmin=np.pi / 10800, arcsec=np.pi / 648000,
    mas=np.pi / 648e6, gon=np.pi / 200, rev=2 * np.pi,
)  # fmt: skip
RADIANS_PER_SECOND = _scaled(
    rad_per_s=1.0, mrad_per_s=1e-3, deg_per_s=np.pi / 180, mdeg_per_s=np.pi / 180e3, arcmin_per_s=np.pi / 10800,
    arcsec_per_s=np.pi / 648000, rev_per_s=2 * np.pi, rpm=np.pi / 30, rev_per_min=np.pi / 30, deg_per_min=np.pi / 10800,
)  # fmt: skip
PER_RATED = {"%": 0.01, "permille": 0.001}
"""Of the torque that a drive is rated for: what CiA 402 drives record."""

DRIVE = _scaled(A=1.0, mA=1e-3, V=1.0, mV=1e-3) | {unit: (100.0 * share, 0.0) for unit, share in PER_RATED.items()}
"""Of a drive whose torque is known up to a constant: current, voltage, per cent. All that has torque in it is in such units."""
NEWTON_METRES = _scaled(Nm=1.0, mNm=1e-3, kNm=1e3, uNm=1e-6, Ncm=1e-2, lbfft=1.3558179483314004, lbfin=0.1129848290276167) | DRIVE
METRES = _scaled(m=1.0, cm=1e-2, mm=1e-3, um=1e-6)
METRES_PER_SECOND = _scaled(m_per_s=1.0, cm_per_s=1e-2, mm_per_s=1e-3, um_per_s=1e-6, mm_per_min=1e-3 / 60, m_per_min=1 / 60)
NEWTONS = _scaled(N=1.0, mN=1e-3, kN=1e3, lbf=4.4482216152605) | DRIVE
CELSIUS = {"degC": (1.0, 0.0), "C": (1.0, 0.0), "K": (1.0, -KELVIN), "degF": (5 / 9, -160 / 9)}

WORDS = {
    "s": ("sec", "secs", "second", "seconds"), "ms": ("msec", "msecs", "millis", "millisecond", "milliseconds"),
    "us": ("usec", "usecs", "micros", "microsecond", "microseconds"), "ns": ("nsec", "nanos", "nanosecond", "nanoseconds"),
    "min": ("minutes",), "d": ("day", "days"), "rad": ("radian", "radians"), "deg": ("degree", "degrees"),
    "rev": ("turn", "turns", "revolutions"),
    "rpm": ("1/min", "min^-1", "min-1", "U/min", "rev/min"), "deg/s": ("dps",), "m": ("meter", "meters", "metre", "metres"),
    "A": ("amp", "amps", "ampere", "amperes", "Arms"), "V": ("volt", "volts"), "%": ("percent", "pct", "per cent"),
    "permille": ("‰",), "Nm": ("N-m", "N.m"), "degC": ("celsius", "deg_C"),
}  # fmt: skip
"""Other words for units."""

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


ALL: dict[str, Conversion] = {name: how for kind in KINDS.values() for units in kind.values() for name, how in units.items()}
"""Every unit; none means two things."""

_SAME = {word.casefold(): unit for unit, words in WORDS.items() for word in words}


def spelled(unit: str) -> str:
    """A unit without what people put between its letters: `N·m`, `N m` and `N*m` are `Nm`, `µm` is `um`, `°C` is `degC`."""
    unit = unit.strip()
    if unit.casefold() in _SAME:
        return _SAME[unit.casefold()]
    for found, plain in ((" ", ""), ("*", ""), ("·", ""), ("⋅", ""), ("°", "deg"), ("µ", "u"), ("μ", "u")):
        unit = unit.replace(found, plain)
    unit = re.sub(r"(?<=[a-z])s\^?-1$", "/s", re.sub(r"/(sec|second)$", "/s", unit))
    return _SAME.get(unit.casefold(), unit)


def is_unit(word: str, signal: str = "") -> bool:
    """Whether a word is a unit of a signal, "" for any. One letter counts only as it is written: `A`, not `a`."""
    found = [units for signals in KINDS.values() for name, units in signals.items() if not signal or name == signal]
    return any(word in units if len(word) == 1 else _known(word, units) for units in found)


def units_of(signal: str) -> tuple[str, ...]:
    """The units that a signal may have on an axis of any kind; none for a signal that is not the axis' own."""
    return tuple(dict.fromkeys(unit for signals in KINDS.values() for unit in signals.get(signal, ())))


def conversion_of(unit: str, rated: float = 0.0) -> Conversion:
    """To SI units; of a torque in per cent by `rated` (N m), to per cent where that is 0. `unit`: one of `ALL`, or "" for SI."""
    if unit in PER_RATED and rated:
        return PER_RATED[unit] * rated, 0.0
    return ALL[unit] if unit else (1.0, 0.0)


def torque_base(unit: str, rated: float = 0.0) -> str:
    """A, V or % for a torque that is known up to a constant, "" for one in N m or N."""
    if unit in PER_RATED:
        return "" if rated else "%"
    return unit.removeprefix("m") if unit in DRIVE else ""


def settled(columns: Sequence[Named], where: str, kind: str | None) -> dict[str, str]:
    """The unit of each signal as `ALL` has it, "" where none is said. kind: of the axis, None where the units must agree on one.

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
    found = {item.signal: str(_known(item.unit, units[item.signal])) for item in with_unit}
    return {item.signal: found.get(item.signal, "") for item in columns}


def kind_of(columns: Sequence[Named]) -> str | None:
    """The kind of axis that the units of some signals belong to, None where they fit both."""
    told = [one for one in columns if one.unit not in WITHOUT]
    fitting = [kind for kind, known in KINDS.items() if all(_known(one.unit, known[one.signal]) for one in told)]
    return fitting[0] if len(fitting) == 1 else None


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
