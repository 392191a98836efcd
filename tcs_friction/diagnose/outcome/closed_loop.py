"""The proof under control: axis models that follow the recorded reference under the axis file's own controller.

A free run diverges where an axis is unstable by itself, and says little of how well an axis follows. Where the recording has the
reference and the axis file says how the axis is controlled, the loop is simulated, without noise, and its position compared with
the recorded one. Whether the recording was made under that controller shows in the tracking error: a loop that predicts little
of it proves nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.config import AxisFile, Control
from tcs_friction.control.loop import Cancellation, LoopRun, simulate_loop, ticks
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.diagnose.fit.balance import rms
from tcs_friction.diagnose.outcome.free_run import Kept, kept_windows
from tcs_friction.errors import TcsError
from tcs_friction.physics.axis import Axis

SETTLE = 1.0  # s at the start of a stretch: the simulated axis starts at rest
PREDICTED = 0.5  # of the recorded tracking error, rms, that the best model may miss where the controller is the file's


class _Recorded:
    """The recorded reference of a stretch, from time 0 on."""

    def __init__(self, s: Stretch) -> None:
        assert s.reference is not None
        self._t = s.t - s.t[0]
        self._position = CubicHermiteSpline(self._t, s.reference[0], s.reference[1])
        self._derivatives = s.reference[1:]

    @property
    def duration(self) -> float:
        return float(self._t[-1])

    def over(self, times: ArrayLike) -> np.ndarray:
        """Shape (n, 3): position, speed, acceleration at times (n,), s."""
        t = np.asarray(times, dtype=np.float64)
        return np.column_stack([self._position(t), *(np.interp(t, self._t, values) for values in self._derivatives)])


class ClosedLoop:
    """The loop of an axis file on the references of a data set. horizon: length of a window, s. kept: the data with windows."""

    def __init__(self, data: DataSet, control: Control, believed: Axis, horizon: float, kept: Kept = "held_out") -> None:
        self._data, self._control, self._believed = data, control, believed
        step = data.dt / data.stride
        self._length = round(horizon / step)
        starts = kept_windows(data, self._length, kept) if self._length else []
        settled = [begins[begins * step >= SETTLE] for begins in starts]
        self._windows = [
            (s, begins) for s, begins in zip(data.stretches, settled, strict=False) if s.reference is not None and len(begins)
        ]

    def errors(self, axis: Axis) -> np.ndarray:
        """Rms (rad) of the position error of an axis within each window (w,).

        An axis that is unstable under this controller misses by the whole travel.
        """
        travel = float(np.ptp(self._data.joined("position")))
        found = []
        for s, begins in self._windows:
            try:
                run = _followed(s, self._data.names, self._control, self._believed, axis)
            except TcsError:
                found.append(np.full(len(begins), travel))
                continue
            away = np.interp(s.t - s.t[0], run.t, run.position) - s.position
            found.append(np.minimum(self._within(away, begins), travel))
        return np.concatenate([np.zeros(0), *found])

    def predicts(self, errors: np.ndarray) -> bool:
        """Whether an axis with these errors (w,) predicts most of the tracking error, as under the recording's controller."""
        found = [self._within(s.reference[0] - s.position, begins) for s, begins in self._windows if s.reference is not None]
        tracking = np.concatenate([np.zeros(0), *found])
        return bool(len(tracking) and rms(errors) < PREDICTED * rms(tracking))

    def _within(self, away: np.ndarray, begins: np.ndarray) -> np.ndarray:
        return np.array([rms(away[k : k + self._length]) for k in begins])


def closed_loop(data: DataSet, file: AxisFile, horizon: float, kept: Kept = "held_out") -> ClosedLoop | None:
    """The loop, where the axis file says how the axis is controlled; `horizon` in s."""
    return None if file.control is None else ClosedLoop(data, file.control, file.axis, horizon, kept)


def _followed(s: Stretch, names: tuple[str, ...], control: Control, believed: Axis, axis: Axis) -> LoopRun:
    """The loop on the reference of a stretch, in its temperature and with its signals."""
    reference = _Recorded(s)
    quiet = replace(axis, sensors=replace(axis.sensors, noise=0.0), drive=replace(axis.drive, noise=0.0), lateness=0.0)
    at = ticks(reference, control.loop) + s.t[0]
    signals = {name: np.interp(at, s.t, values) for name, values in zip(names, s.signals[1:], strict=True)}
    return simulate_loop(
        quiet,
        reference,
        control.controller,
        control.loop,
        control.observer,
        control.compensator,
        temperature=np.interp(at, s.t, s.signals[0]),
        exogenous={name: signals[name] for name in dict.fromkeys([*signals_of(axis), *signals_of(believed)])},
        cancellation=Cancellation(believed),
    )
