"""The residual of an axis with everything that retuning explains projected out: what a hypothesis is judged against.

In: a fit. Out: the whitened residual w and columns of hypotheses, both projected onto the complement of the fit's own
derivatives J,

    w_p = w - Q Q'w,    Q: orthonormal basis of J

so that a least-squares gain on projected columns is that of a joint fit, to first order (Frisch-Waugh-Lovell theorem).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from tcs_friction.diagnose.dataset.excitation import period, turns
from tcs_friction.diagnose.fit.balance import TorqueBalance, noise_amplification
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.parameters import amplitudes, bound_reached, small_amplitude
from tcs_friction.diagnose.fit.second_body import motion_gain
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Role, Survey, Term, instance

INDEPENDENT = 1e-9  # of the largest singular value: directions below it are rounding errors
FEWEST_MOVING = 20  # samples from which their percentiles describe the speeds
SLOW_PERCENTILE, FAST_PERCENTILE = 5, 99  # of the speeds


class ProjectedResidual:
    """The residual of a fit with everything that its own numbers can explain projected out.

    Attributes: residual (n,), N m; white (m,): its whitened and projected rows; basis (m, k), orthonormal; squares: of `white`.
    """

    def __init__(self, balance: TorqueBalance, fit: Fit) -> None:
        self.balance, self.axis, self.noise = balance, fit.axis, fit.noise
        self.residual = balance.residual(self.axis, self.noise)
        jacobian = balance.jacobian(self.axis, fit.free, self.noise, self.residual)
        movable = [not bound_reached(self.axis, fit.free, k) for k in range(len(fit.free))]
        norms = np.linalg.norm(jacobian, axis=0) * movable
        jacobian = jacobian[:, norms > 0.0] / norms[norms > 0.0]
        self.basis = jacobian
        if jacobian.size:
            left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
            self.basis = np.ascontiguousarray(left[:, singular > INDEPENDENT * singular[0]])
        self.white = self.project(self.noise.whiten(self.residual))
        self.squares = float(self.white @ self.white)

    @property
    def dispersion(self) -> float:
        """Whitened squares per independent sample, at least one: how much larger than its estimate the noise is."""
        return max(1.0, self.squares / self.balance.samples.effective_count)

    def project(self, x: np.ndarray) -> np.ndarray:
        """x (m,) or (m, k) without what the fit's own numbers explain."""
        return np.asarray(x - self.basis @ (self.basis.T @ x))

    def left(self, axis: Axis) -> float:
        """Squares of the residual that another axis leaves, with the same projected out."""
        white = self.project(self.noise.whiten(self.balance.residual(axis, self.noise, keep=False)))
        return float(white @ white)

    def change(self, item: Instance) -> np.ndarray:
        """Change of the residual (n,) when the effect is added as it is."""
        changed = self.balance.residual(self.axis.with_effect(item), self.noise, keep=False)
        return np.asarray(changed - self.residual)

    def change_by_body(self, item: Instance) -> np.ndarray:
        """`change` by a body that resonates, from its transfer function: right but for the ends of the stretches.

        It changes the torque that the motion requires, and how much of the residual's noise comes through.
        """
        balance, swung = self.balance, self.axis.with_effect(item)
        size = balance.scale(balance.terms.rotor(self.axis)[1])
        inertial = size * self.axis.inertia * balance.terms.acceleration(self.axis)
        added = balance.through(inertial, lambda f: motion_gain(swung, f) - motion_gain(self.axis, f))
        left = balance.torque_residual(self.axis) - added
        return balance.through(left, lambda f: 1.0 / noise_amplification(swung, self.noise, f)) - self.residual

    def change_by_load_from_motion(self, item: Instance) -> np.ndarray:
        """`change` by friction that follows the load, the load taken from the motion instead of the logged torque."""
        terms = self.balance.terms
        loads = terms.loads_from_motion(self.axis)
        plain, loaded = (terms.friction_under(x, loads) for x in (self.axis, self.axis.with_effect(item)))
        return plain - loaded

    def columns(self, items: Sequence[Instance]) -> np.ndarray:
        """Whitened and projected changes of several effects (m, k)."""
        return self.project(np.stack([self.noise.whiten(self.change(item)) for item in items], axis=1))

    def gain(self, columns: np.ndarray) -> tuple[float, np.ndarray]:
        """Drop of squares for projected whitened columns (m, k), and the amplitudes (k,) that give it."""
        scores = columns.T @ self.white
        sizes = np.linalg.lstsq(columns.T @ columns, -scores, rcond=1e-12)[0]
        return float(-scores @ sizes), sizes


def survey(balance: TorqueBalance, axis: Axis) -> Survey:
    """What the recordings can show of an axis."""
    data = balance.data
    position, speed = data.joined("position"), np.abs(data.joined("velocity"))
    moving = speed[data.moving()]
    moving = moving if len(moving) > FEWEST_MOVING else speed
    begin = min(float(s.t[0]) for s in data.stretches)
    end = max(float(s.t[-1]) for s in data.stretches)
    return Survey(
        travel=(float(position.min()), float(position.max())),
        slow=float(np.percentile(moving, SLOW_PERCENTILE)),
        fast=float(np.percentile(moving, FAST_PERCENTILE)),
        start=begin,
        duration=end - begin,
        cutoff=data.cutoff,
        resolution=data.position_noise,
        inertia=axis.inertia,
        level=axis.friction.values[axis.friction.term.level.name],
        bristle=axis.bristle,
        cycle=axis.cycle,
        turns=partial(turns, data),
        period=period(data, axis),
        acceleration=float(np.sqrt(np.mean(balance.terms.acceleration(axis)[balance.train] ** 2))),
    )


def probes(term: Term, shape: Mapping[str, float], signal_name: str | None) -> list[Instance]:
    """One instance for each linear number of an effect, with only that number at a small amplitude; `shape`: other values."""
    result = []
    linear = [(p, phase) for p, phase in amplitudes(term.parameters) if p.role is Role.LINEAR]
    for parameter, phase in linear:
        values = {other.name: 0.0 for other, _ in linear} | dict(shape)
        values[parameter.name] = small_amplitude(parameter.unit)
        for angle in (0.0, 0.5 * math.pi) if phase else (0.0,):
            turned = {phase.name: angle} if phase else {}
            result.append(instance(term, values | turned, signal=signal_name))
    return result
