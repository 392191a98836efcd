"""The record type: one stretch of motion of one axis, whatever it came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcs_friction.errors import InputError

Column = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals of one axis on one time base, read-only, checked once when made.

    t: (n,) s, strictly increasing, counted from the recording's own zero.
    position (rad or m), torque (N m or N): (n,), finite.
    velocity (rad/s or m/s), temperature (degC), reference (rad or m): (n,) or None when not recorded.
    exogenous: name -> (n,), any other recorded signal, in its own unit.
    segments: stretches without a gap, in order; nothing may be integrated or interpolated across their edges.
        Left empty, the whole recording is one segment.
    source: where it came from, for messages. notes: what was found and handled on reading, one line each.
    start: of t = 0, ns since 1970, 0 where nobody knows it.
    torque_unit: A, V or % where the torque is known up to a constant; everything with torque in it is then in that. "": N m or N.
    torque_log: (2, m) stamps (s, as t) and values of the torque as it was logged, where that has stamps of its own; `torque` is
        then what was last logged at each t. acts: s after its stamp at which a logged torque begins to act; None: not known.

    Raises InputError naming the signal and the sample that breaks a rule.
    """

    t: Column
    position: Column
    torque: Column
    velocity: Column | None = None
    temperature: Column | None = None
    reference: Column | None = None
    exogenous: Mapping[str, Column] = field(default_factory=dict)
    segments: tuple[slice, ...] = ()
    source: str = "recording"
    notes: tuple[str, ...] = ()
    start: int = 0
    torque_unit: str = ""
    torque_log: Column | None = None
    acts: float | None = None

    def __post_init__(self) -> None:
        for name in ("t", "position", "torque", "velocity", "temperature", "reference"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, self._checked(name, values))
        exogenous = {name: self._checked(f"exogenous {name}", values) for name, values in self.exogenous.items()}
        object.__setattr__(self, "exogenous", MappingProxyType(exogenous))
        self._check_time()
        if self.torque_log is not None:
            object.__setattr__(self, "torque_log", self._checked_log(self.torque_log))
        segments = tuple(self.segments) or (slice(0, len(self.t)),)
        object.__setattr__(self, "segments", tuple(self._checked_segments(segments)))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    def logged(self, where: slice) -> tuple[Column, Column]:
        """Stamps (m,), s, and values (m,) of the torque as logged during a slice (step 1), with one value on either side."""
        if self.torque_log is None:
            return self.t[where], self.torque[where]
        first, last = self.t[where][[0, -1]]
        stamps = self.torque_log[0]
        begin = max(int(np.searchsorted(stamps, first, side="right")) - 1, 0)
        end = min(int(np.searchsorted(stamps, last)) + 1, len(stamps))
        return stamps[begin:end], self.torque_log[1][begin:end]

    def turned_over(self) -> Recording:
        """The same with a torque of the other sign."""
        log = None if self.torque_log is None else self.torque_log * np.array([[1.0], [-1.0]])
        return replace(self, torque=-self.torque, torque_log=log)

    def part(self, where: slice) -> Recording:
        """The samples of one slice (step 1) as a recording of its own; times keep their zero."""
        start, stop, _ = where.indices(len(self.t))
        segments = tuple(
            slice(max(s.start, start) - start, min(s.stop, stop) - start)
            for s in self.segments
            if min(s.stop, stop) - max(s.start, start) > 0
        )

        def cut(values: Column | None) -> Column | None:
            return None if values is None else values[start:stop]

        return Recording(
            self.t[start:stop], self.position[start:stop], self.torque[start:stop],
            cut(self.velocity), cut(self.temperature), cut(self.reference),
            {name: values[start:stop] for name, values in self.exogenous.items()},
            segments, self.source, self.notes, self.start, self.torque_unit, self.torque_log, self.acts,
        )  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = (
            self.t, self.position, self.torque, self.velocity, self.temperature, self.reference,
            dict(self.exogenous), self.segments, self.source, self.notes, self.start,
            self.torque_unit, self.torque_log, self.acts,
        )  # fmt: skip
        return (Recording, arguments)

    def _checked(self, name: str, values: Column) -> Column:
        column = np.asarray(values, dtype=np.float64)
        if column.ndim != 1 or len(column) != len(self.t):
            raise InputError(self.source, f"{name} has shape {column.shape}", f"({len(self.t)},) like t")
        finite = np.isfinite(column)
        if not finite.all():
            index = int(np.argmin(finite))
            raise InputError(self.source, f"{name}[{index}] is {column[index]}", "finite samples")
        view = column.view()
        view.flags.writeable = False
        return view

    def _checked_log(self, log: Column) -> Column:
        """Stamps and values of a torque with stamps of its own."""
        values = np.array(log, dtype=np.float64)
        if values.ndim != 2 or len(values) != 2 or values.shape[1] < 2:
            raise InputError(self.source, f"torque_log has shape {values.shape}", "(2, m), m at least 2")
        if not np.isfinite(values).all() or not (np.diff(values[0]) > 0.0).all():
            raise InputError(self.source, "torque_log", "finite values at stamps that strictly increase")
        values.flags.writeable = False
        return values

    def _check_time(self) -> None:
        if len(self.t) < 2:
            raise InputError(self.source, f"{len(self.t)} samples", "at least 2")
        rising = np.diff(self.t) > 0.0
        if not rising.all():
            index = int(np.argmin(rising)) + 1
            raise InputError(self.source, f"t must strictly increase; t[{index}] does not")

    def _checked_segments(self, segments: tuple[slice, ...]) -> list[slice]:
        checked: list[slice] = []
        previous = 0
        for segment in segments:
            start, stop, step = segment.indices(len(self.t))
            if step != 1 or start < previous or stop <= start:
                raise InputError(self.source, f"segment {segment}", "ordered, separate, not empty, step 1")
            checked.append(slice(start, stop))
            previous = stop
        return checked


def same_torque_unit(recordings: Sequence[Recording]) -> str:
    """The unit of the torque in all of them (see Recording.torque_unit). Raises InputError where they differ."""
    first, *others = recordings
    for other in others:
        if other.torque_unit != first.torque_unit:
            found = f"holds the torque in {other.torque_unit or 'N m'}"
            raise InputError(other.source, found, f"{first.torque_unit or 'N m'} as in {first.source}")
    return first.torque_unit
