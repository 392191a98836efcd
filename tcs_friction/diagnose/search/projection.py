"""What a hypothesis is judged against: a residual from which everything that retuning explains is projected out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tcs_friction.diagnose.fit.balance import Balance
from tcs_friction.diagnose.fit.parameters import Free, at_bound, pairs
from tcs_friction.diagnose.fit.second_body import motion_gain
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Role, Survey, Term, instance


class Background:
    """The residual of an axis with everything that its own parameters can explain projected out.

    Attributes: axis, free numbers, residual (n,), its whitened and projected part (rows,), orthonormal base (rows, k).
    """

    def __init__(self, balance: Balance, axis: Axis, free: Sequence[Free]) -> None:
        self.balance = balance
        self.axis = axis
        self.free = list(free)
        self.residual = balance.residual(axis)
        base = balance.jacobian(axis, self.free, self.residual)
        kept = (
            np.linalg.norm(base, axis=0) * [not at_bound(axis, self.free, k) for k in range(len(self.free))]
            > 0.0
        )
        base = base[:, kept] / np.linalg.norm(base[:, kept], axis=0)
        left, singular, _ = np.linalg.svd(base, full_matrices=False)
        self.base = np.ascontiguousarray(left[:, singular > 1e-9 * singular[0]]) if base.size else base
        self.white = self.project(balance.whiten(self.residual))
        self.squares = float(self.white @ self.white)

    def project(self, x: np.ndarray) -> np.ndarray:
        """x (rows,) or (rows, k) without what the base parameters explain."""
        return np.asarray(x - self.base @ (self.base.T @ x))

    def column(self, item: Instance) -> np.ndarray:
        """Change of the residual (n,) when the effect is added as it is."""
        return np.asarray(self.balance.residual(self.axis.with_effect(item), remember=False) - self.residual)

    def swung(self, item: Instance) -> np.ndarray:
        """`column` of a body from its transfer function: it changes the torque that the motion requires, and how much of its
        noise comes through. Right but for the ends of the stretches."""
        balance, swung = self.balance, self.axis.with_effect(item)
        size = balance.scale(balance.parts.rotor(self.axis)[1])
        inertial = size * self.axis.inertia * balance.parts.acceleration(self.axis)
        added = balance.through(inertial, lambda f: motion_gain(swung, f) - motion_gain(self.axis, f))
        left = balance.torque_residual(self.axis) - added
        return balance.through(left, lambda f: 1.0 / balance.noise_gain(swung, f)) - self.residual

    def column_by_motion(self, item: Instance) -> np.ndarray:
        """`column` of friction that follows the load, the load taken from the motion."""
        parts = self.balance.parts
        loads = parts.loads_by_motion(self.axis)
        plain, loaded = (parts.friction_under(x, loads) for x in (self.axis, self.axis.with_effect(item)))
        return plain - loaded

    def columns(self, items: Sequence[Instance]) -> np.ndarray:
        """Those of several effects (rows, k), whitened and projected."""
        return self.project(np.stack([self.balance.whiten(self.column(item)) for item in items], axis=1))

    def gain(self, columns: np.ndarray) -> tuple[float, np.ndarray]:
        """Drop of squares for projected whitened columns (rows, k), and the amplitudes (k,) that give it."""
        gram = columns.T @ columns
        amplitudes = np.linalg.lstsq(gram, -(columns.T @ self.white), rcond=1e-12)[0]
        return float(-(columns.T @ self.white) @ amplitudes), amplitudes


def survey(balance: Balance, axis: Axis) -> Survey:
    """What the recordings can show."""
    data = balance.data
    position, speed = data.joined("position"), np.abs(data.joined("velocity"))
    moving = speed[speed > 3.0 * data.velocity_noise]
    moving = moving if len(moving) > 20 else speed
    begin = min(float(s.t[0]) for s in data.stretches)
    end = max(float(s.t[-1]) for s in data.stretches)
    return Survey(
        travel=(float(position.min()), float(position.max())),
        slow=float(np.percentile(moving, 5)),
        fast=float(np.percentile(moving, 99)),
        start=begin,
        duration=end - begin,
        cutoff=data.cutoff,
        resolution=data.position_noise,
        inertia=axis.inertia,
        level=axis.friction.values["coulomb"],
        bristle=axis.bristle,
    )


def probe(term: Term, values: Mapping[str, float], signal_name: str | None, size: float) -> list[Instance]:
    """One instance per linear number of the effect, each with only that number at `size`."""
    result = []
    linear = [(p, phase) for p, phase in pairs(term.parameters) if p.role is Role.LINEAR]
    for p, phase in linear:
        off = {q.name: 0.0 for q, _ in linear}
        for angle in (0.0, 0.5 * math.pi) if phase else (0.0,):
            chosen = {**off, **values, p.name: size * unit_size(p.unit)}
            result.append(instance(term, chosen | ({phase.name: angle} if phase else {}), signal=signal_name))
    return result


def unit_size(unit: str) -> float:
    """A small amplitude for effects that are only nearly linear in it."""
    return {"": 0.01, "1/degC": 0.001, "rad": 1e-7}.get(unit, 1.0)
