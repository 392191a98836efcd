"""The unit in which tracking errors are told: one for a report, in which they are easy numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from tcs_friction.control.tracking import ARCSEC

LEAST, MOST = 1.0, 1000.0
"""Between which numbers are easily read and compared."""


class Unit(NamedTuple):
    """How many rad (m) a unit is, and its name."""

    size: float
    name: str


UNITS = {
    "rotary": (
        Unit(ARCSEC, "arcsec"),
        Unit(1e-3 * ARCSEC, "mas"),
        Unit(1e-6, "urad"),
        Unit(1e-3, "mrad"),
        Unit(math.radians(1.0), "deg"),
    ),
    "linear": (Unit(1e-6, "um"), Unit(1e-9, "nm"), Unit(1e-3, "mm"), Unit(1.0, "m")),
}
"""Of each kind of axis; the first that serves is taken."""


def unit_for(kind: str, errors: Iterable[float]) -> Unit:
    """The unit in which errors (rad, m) of an axis of this kind lie between 1 and 1000, as far as one unit can.

    >>> unit_for("rotary", [1.4e-5, 5e-6]).name, unit_for("rotary", [1.4e-5, 3.9e-7]).name, unit_for("linear", [2e-8]).name
    ('arcsec', 'mas', 'nm')
    """
    sizes = [abs(error) for error in errors if error != 0.0 and math.isfinite(error)]
    return min(UNITS[kind], key=lambda unit: _decades_beyond(sizes, unit.size))


def _decades_beyond(sizes: list[float], unit: float) -> int:
    """By how many decades, begun ones counted, the least and the greatest of some sizes are beyond the limits together."""
    if not sizes:
        return 0
    below = math.log10(LEAST * unit / min(sizes))
    above = math.log10(max(sizes) / (MOST * unit))
    return sum(math.ceil(one) for one in (below, above) if one > 0.0)


def between(low: float, high: float) -> str:
    """An interval, to the second digit of its width or the third of its upper end.

    >>> between(0.0712, 0.1089), between(94.12, 94.43), between(1250.0, 4312.0), between(5.0, 5.0)
    ('0.071 to 0.109', '94.1 to 94.4', '1250 to 4312', '5.00 to 5.00')
    """
    width = max(high - low, 0.1 * abs(high)) or 1.0
    places = max(1 - math.floor(math.log10(width)), 0)
    return f"{low:.{places}f} to {high:.{places}f}"


def plain(value: float, digits: int = 3) -> str:
    """A number of so many digits, without a power of ten.

    >>> plain(2912.4), plain(0.083412, 2), plain(24.0)
    ('2910', '0.083', '24.0')
    """
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="k").rstrip(".")
