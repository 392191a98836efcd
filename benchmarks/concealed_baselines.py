"""What one would do without a diagnosis: regress the residual of the believed simulation on a library of functions.

Two baselines on the same recordings: sparse regression as SINDy does it (sequentially thresholded least squares, Brunton et
al. 2016; pysindy's, or the same written out where there is no network) with the model's own parameters in the library, and
forward stepwise regression on what retuning the model leaves, without retuning again. Both start from the retuned model and
know the shapes of the vocabulary, on grids where a shape has parameters; the first is told the noise floor.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tcs_friction.config import AxisFile
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Column, Recording

SMOOTHING = 0.004  # s, of position and torque; more would bend what friction does at reversals
THINNING = 0.01  # s, of everything after that
THIN = 10  # samples for one, after smoothing
DIRECTION = 1e-4  # rad/s over which the sign of the velocity turns over
LARGEST_SET = 8


@dataclass(frozen=True)
class Library:
    """Candidate functions: `columns` (n, m) of unit rms, the effect each belongs to and its group (fitted together)."""

    columns: Column
    effects: tuple[str, ...]
    groups: tuple[int, ...]


@dataclass(frozen=True)
class Motion:
    """A smoothed, thinned recording, each (n,)."""

    t: Column
    q: Column
    v: Column
    a: Column
    u: Column
    dt: float


class _Collector:
    """Gathers columns group by group."""

    def __init__(self) -> None:
        self.columns: list[Column] = []
        self.effects: list[str] = []
        self.groups: list[int] = []

    def add(self, effect: str, *columns: Column) -> None:
        group = self.groups[-1] + 1 if self.groups else 0
        for column in columns:
            size = math.sqrt(float(np.mean(column**2)))
            if size > 0.0:
                self.columns.append(column / size)
                self.effects.append(effect)
                self.groups.append(group)

    def library(self) -> Library:
        return Library(np.stack(self.columns, axis=1), tuple(self.effects), tuple(self.groups))


def conditioned(recording: Recording) -> Motion:
    """Position, velocity, acceleration and torque, all through the same filters."""
    dt, q, v, a, u = _smoothed(recording)
    part = slice(THIN * 5, -THIN * 5, THIN)
    q, v, a, u = (_thinned(x, dt) for x in (q, v, a, u))
    return Motion(recording.t[part], q, v, a, u, THIN * dt)


def _smoothed(recording: Recording) -> tuple[float, Column, Column, Column, Column]:
    dt = float(np.median(np.diff(recording.t)))
    q = gaussian_filter1d(recording.position, SMOOTHING / dt)
    v = np.gradient(q, dt)
    return dt, q, v, np.gradient(v, dt), gaussian_filter1d(recording.torque, SMOOTHING / dt)


def _thinned(x: Column, dt: float) -> Column:
    return np.asarray(gaussian_filter1d(x, THINNING / dt)[THIN * 5 : -THIN * 5 : THIN])


def residual_of(axis: Axis, recording: Recording) -> Column:
    """Torque that the axis cannot account for, smoothed and thinned like `conditioned`, (n,) N m."""
    return _thinned(torque_residual(axis, recording), float(np.median(np.diff(recording.t))))


def torque_residual(axis: Axis, recording: Recording) -> Column:
    """The same at the recording's own rate, smoothed by SMOOTHING only."""
    dt, q, v, a, u = _smoothed(recording)
    out = np.empty((len(q), 8))
    signals = np.full((1, len(q)), 20.0)
    built = machine.build(axis, dt, position=float(q[0]))
    machine.evaluate(built, recording.t, q, v, a, u, signals, 2e-5, out)
    return np.asarray(out[:, machine.ROTOR] - out[:, machine.REQUIRED])


def base_columns(axis: Axis, recording: Recording) -> Column:
    """How the residual moves with one per cent more of each of the axis' own parameters, (n, k)."""
    now = residual_of(axis, recording)
    return np.stack([residual_of(other, recording) - now for other in variants(axis)], axis=1)


def variants(axis: Axis) -> list[Axis]:
    """The axis with one per cent more of each of its own parameters in turn."""
    return [_changed(axis, name, 1.01) for name in _numbers(axis)]


def _numbers(axis: Axis) -> list[str]:
    return [
        "inertia",
        *(name for name, value in axis.friction.values.items() if name != "exponent" and value > 0.0),
    ]


def _changed(axis: Axis, name: str, factor: float) -> Axis:
    if name == "inertia":
        return replace(axis, inertia=factor * axis.inertia)
    return axis.with_friction({name: factor * axis.friction.values[name]})


def retuned(axis: Axis, recording: Recording) -> Axis:
    """The believed axis with its own parameters fitted, by three Gauss-Newton steps."""
    for _ in range(3):
        columns = base_columns(axis, recording)
        step = np.linalg.lstsq(columns, -residual_of(axis, recording), rcond=1e-8)[0]
        for name, share in zip(_numbers(axis), np.clip(0.01 * step, -0.2, 0.2), strict=True):
            axis = _changed(axis, name, 1.0 + float(share))
    return axis


def library_for(recording: Recording, m: Motion) -> Library:
    """The vocabulary's functions of this recording."""
    found = _Collector()
    s, one = np.tanh(m.v / DIRECTION), np.ones_like(m.t)
    found.add("torque_bias", one)
    found.add("viscous_asymmetry", np.abs(m.v))
    found.add("coulomb_asymmetry", np.abs(s))
    found.add("quadratic_drag", m.v * np.abs(m.v))
    found.add("imbalance", np.cos(m.q), np.sin(m.q))
    found.add("cable_wrap", m.q, m.q**3)
    found.add("load_dependent_friction", np.abs(m.u) * s)
    found.add("position_dependent_inertia", m.a * np.cos(2.0 * m.q), m.a * np.sin(2.0 * m.q))
    rate = np.gradient(m.u, m.dt)
    found.add("transport_delay", rate)
    found.add("actuator_lag", np.gradient(rate, m.dt))
    found.add("flexible_mode", np.gradient(np.gradient(m.a, m.dt), m.dt))
    found.add("backlash", np.sign(m.a))
    found.add("presliding", _lagged(m, 3e-4))
    for speed in np.geomspace(2e-4, 5e-3, 5):
        found.add("stribeck", s * np.exp(-((m.v / speed) ** 2)))
    for width in np.geomspace(0.01, 0.1, 4):
        found.add("cable_hysteresis", _lagged(m, float(width)))
    _add_periodic(found, m, s)
    _add_recorded(found, recording, m, s)
    _add_placed(found, m, s)
    return found.library()


def _lagged(m: Motion, width: float) -> Column:
    """Direction of motion that turns over within a travel, (n,)."""
    state, out = 0.0, np.empty_like(m.q)
    travel = np.diff(m.q, prepend=m.q[0])
    for i, step in enumerate(travel):
        state = np.sign(step) + (state - np.sign(step)) * math.exp(-abs(step) / width)
        out[i] = state
    return out


def _add_periodic(found: _Collector, m: Motion, s: Column) -> None:
    for order in range(1, 97):
        cosine, sine = np.cos(order * m.q), np.sin(order * m.q)
        if order <= 3:
            found.add("position_dependent_friction", s * cosine, s * sine)
        if order >= 8:
            found.add("cogging", cosine, sine)
        if 8 <= order <= 48:
            bend = order * order * m.v * m.v
            found.add("encoder_periodic_error", bend * cosine, bend * sine)
        if 12 <= order <= 60:
            found.add("torque_ripple", m.u * cosine, m.u * sine)


def _add_recorded(found: _Collector, recording: Recording, m: Motion, s: Column) -> None:
    if recording.temperature is not None:
        warm = np.interp(m.t, recording.t, recording.temperature) - 20.0
        found.add("temperature_dependent_friction", warm * s, warm * m.v)
    for name, values in recording.exogenous.items():
        signal = np.interp(m.t, recording.t, values)
        found.add("exogenous", signal)
        if "wind" in name:
            found.add("wind_torque", signal * np.abs(signal))
        else:
            found.add("cross_axis_coupling", np.gradient(signal, m.dt))


def _add_placed(found: _Collector, m: Motion, s: Column) -> None:
    """What sits at a time, a place or a frequency."""
    duration = float(m.t[-1] - m.t[0])
    for share in (0.1, 0.2, 0.4):
        cold = np.exp(-(m.t - m.t[0]) / (share * duration))
        found.add("warmup_drift", cold * s, cold * m.v)
    for time in np.linspace(m.t[0], m.t[-1], 32)[1:-1]:
        found.add("load_step", (m.t >= time).astype(np.float64))
    for centre in np.linspace(m.q.min(), m.q.max(), 26)[1:-1]:
        for width in (0.07, 0.2):
            found.add("local_friction_bump", s * np.exp(-(((m.q - centre) / width) ** 2)))
    for frequency in np.arange(0.5, 10.0, 0.25):
        angle = 2.0 * math.pi * frequency * m.t
        found.add("periodic_vibration", np.cos(angle), np.sin(angle))


def sparse_regression(library: Library, base: Column, residual: Column, floor: float) -> tuple[str, ...]:
    """Effects whose functions survive SINDy's thresholding; the threshold is half the noise floor in torque rms."""
    columns = np.concatenate([base, library.columns], axis=1)
    coefficients = thresholded(columns, residual, 0.5 * floor)[base.shape[1] :]
    return tuple(sorted({library.effects[i] for i in np.flatnonzero(coefficients)}))


def thresholded(columns: Column, target: Column, threshold: float) -> Column:
    """Sequentially thresholded least squares: coefficients (m,)."""
    try:
        from pysindy.optimizers import STLSQ
    except ImportError:
        return _thresholded(columns, target, threshold)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing is left is an answer
        fit = STLSQ(threshold=threshold, alpha=1e-6 * len(target), max_iter=20).fit(columns, target[:, None])
    return np.asarray(fit.coef_[0])


def _thresholded(columns: Column, target: Column, threshold: float) -> Column:
    gram, moment = columns.T @ columns, columns.T @ target
    active = np.arange(columns.shape[1])
    coefficients = np.zeros(columns.shape[1])
    for _ in range(20):
        ridge = 1e-6 * len(target) * np.eye(len(active))
        values = np.linalg.solve(gram[np.ix_(active, active)] + ridge, moment[active])
        keep = np.abs(values) >= threshold
        coefficients[:] = 0.0
        coefficients[active] = np.where(keep, values, 0.0)
        if keep.all() or not keep.any():
            break
        active = active[keep]
    return coefficients


def stepwise_regression(library: Library, residual: Column) -> tuple[str, ...]:
    """Effects that forward steps by BIC take up from the residual of a model that stays as it is."""
    left = residual
    count = len(left)
    groups = np.array(library.groups)
    members = [np.flatnonzero(groups == g) for g in range(groups.max() + 1)]
    inverses = [np.linalg.pinv(library.columns[:, i].T @ library.columns[:, i]) for i in members]
    chosen: list[str] = []
    for _ in range(LARGEST_SET):
        moment = library.columns.T @ left
        gains = np.array(
            [moment[i] @ inverse @ moment[i] for i, inverse in zip(members, inverses, strict=True)]
        )
        best = int(np.argmax(gains))
        squares = float(left @ left)
        after = max(squares - gains[best], 1e-12 * squares)
        if count * math.log(squares / after) < (len(members[best]) + 1) * math.log(count):
            break
        index = members[best]
        left = left - library.columns[:, index] @ (inverses[best] @ moment[index])
        chosen.append(library.effects[index[0]])
    return tuple(sorted(set(chosen)))


def baselines(recording: Recording, file: AxisFile, floor: float) -> dict[str, tuple[str, ...]]:
    """Effects that each baseline names. `floor`: noise floor, N m, which a person would set the threshold by."""
    motion = conditioned(recording)
    axis = retuned(file.axis, recording)
    residual = residual_of(axis, recording)
    base = base_columns(axis, recording)
    base = base / np.maximum(np.sqrt(np.mean(base**2, axis=0)), 1e-12)
    library = library_for(recording, motion)
    return {
        "sparse regression": sparse_regression(library, base, residual, floor),
        "stepwise regression": stepwise_regression(library, residual),
    }
