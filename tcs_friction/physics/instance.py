"""A term with values: what an axis is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from types import MappingProxyType

import numpy as np

from tcs_friction.errors import InputError, nearest
from tcs_friction.physics.motion import signal_slot
from tcs_friction.physics.parameters import Role
from tcs_friction.physics.table import Table
from tcs_friction.physics.term import Term


@dataclass(frozen=True)
class Instance:
    """A term with values: what an axis is made of. Values are complete and checked; build with `instance`.

    identity: tells it from others of its kind and stays when its values change.
    """

    term: Term
    values: Mapping[str, float]
    signal: str | None = None
    table: Table | None = None
    identity: int = field(default_factory=count().__next__, compare=False)

    @property
    def order(self) -> float:
        """Order (1/turn, 1/m) or frequency (Hz) of a periodic effect."""
        return self.values[self.term.order.name]

    @property
    def frequency(self) -> float | None:
        """Frequency (Hz) at which it shows, if it has one."""
        name = self.term.frequency or (self.term.order.name if self.term.periodic == "time" else "")
        return self.values[name] if name else None

    @property
    def extent(self) -> tuple[float, float | None] | None:
        """From where to where along its coordinate it shows, if not everywhere; None at the end: to the end."""
        if self.term.local is not None:
            centre, width = (self.values[name] for name in (self.term.local.centre, self.term.local.width))
            return centre - width, centre + width
        return self.term.extent(self.values) if self.term.extent is not None else None

    @property
    def values_of_law(self) -> Mapping[str, float]:
        """Of a law: its values, and the stiffness of its bristles where no parameter is that."""
        return self.values if self.term.stiffness is None else {**self.values, "stiffness": self.term.stiffness(self.values)}

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the recorded signals that it acts through."""
        own = () if self.signal is None else (self.signal,)
        return own if self.table is None else (*own, *self.table.signals)

    @property
    def words(self) -> str:
        """What it is, with what tells it from others of its kind: `cogging of order 72`."""
        order = f" of order {self.order:.4g}" if self.term.periodic == "position" else ""
        return f"{self.term.words}{order}{f' from {self.signal}' if self.signal else ''}"

    @property
    def shape(self) -> dict[str, float]:
        """Values of its shape by name, in the order of their declaration: what is neither linear nor fixed."""
        return {p.name: self.values[p.name] for p in self.term.parameters if p.role is Role.SHAPE}

    @property
    def thermal(self) -> bool:
        """Whether it follows the temperature."""
        return self.term.temperature or (self.table is not None and "temperature" in self.table.coordinates)

    @property
    def obstacle(self) -> str:
        """Why no compensator can cancel it, in words; nothing where one can."""
        if self.table is not None and "time" in self.table.coordinates:
            return "its table is one of the recording's time"
        return self.term.obstacle

    def replace(self, **values: float) -> Instance:
        """The same instance with some values changed."""
        changed = instance(self.term, {**self.values, **values}, signal=self.signal, table=self.table)
        return Instance(self.term, changed.values, self.signal, self.table, self.identity)

    def again(self) -> Instance:
        """Another effect with the same values."""
        return Instance(self.term, self.values, self.signal, self.table)

    def packed(self, signals: tuple[str, ...] = ()) -> np.ndarray:
        """Parameters as the kernel reads them: declared values, then signal slots, then the table."""
        packed = [self.values[p.name] for p in self.term.parameters]
        if self.term.signals:
            if self.signal not in signals:
                known = ", ".join(signals) or "none"
                raise InputError(
                    f"effect {self.term.id}", f"no recorded signal named {self.signal!r}", f"one of: {known}"
                )
            packed.append(float(signal_slot(signals.index(self.signal))))
        if self.table is not None:
            packed.extend(self.table.packed(signals))
        return np.array(packed, dtype=np.float64)


def instance(
    term: Term,
    values: Mapping[str, object],
    where: str = "axis",
    signal: str | None = None,
    table: Table | None = None,
) -> Instance:
    """Check values against the term's declaration and fill defaults.

    Raises
    ------
    InputError: a parameter is unknown (names the nearest), missing, not finite or out of bounds.
    """
    where = f"{where} {term.id}" if term.id not in where else where
    names = [p.name for p in term.parameters]
    for name in values:
        if name not in names:
            raise InputError(where, f"unknown parameter {name!r}", nearest(name, names))
    checked = {}
    for parameter in term.parameters:
        value = values.get(parameter.name, parameter.default)
        if value is None:
            raise InputError(where, f"{parameter.name} is missing", f"a number in {parameter.unit or '1'}")
        checked[parameter.name] = parameter.check(value, where)
    if term.signals and signal is None:
        raise InputError(where, "signal is missing", "the name of a recorded exogenous signal")
    if term.tabulated and table is None:
        raise InputError(where, "table is missing", "coordinates, lower, upper and values")
    return Instance(term, MappingProxyType(checked), signal, table)
