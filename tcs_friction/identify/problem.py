"""The least-squares problem: what is compared with what, filtered alike, at the rate that still carries information."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from tcs_friction.identify import kernels
from tcs_friction.identify.models import AnyModel, LuGreModel, Model, background, model_for
from tcs_friction.identify.motion import SAMPLES_PER_CYCLE, Motion, coarse, low_pass, unsure_start
from tcs_friction.identify.prediction import Fine
from tcs_friction.physics.axis import Axis

MOST_INITIAL_STATES = 16
SERIES_POINTS = 20000  # friction series are thinned to about this many points


@dataclass(frozen=True, eq=False)
class Thinning:
    """Which samples are compared, after which symmetric filter. centres (m,) sample indices; taps (2 h + 1,)."""

    centres: np.ndarray
    taps: np.ndarray
    stride: int
    sections: np.ndarray | None = None  # second-order sections of the low pass, or of the observer's filter
    zero_phase: bool = False
    lead: int = 0  # samples by which the filter's lag has been taken out of the data
    bounds: np.ndarray | None = None

    def modelled(self, columns: np.ndarray) -> np.ndarray:
        """The same of modelled friction (n, k), which first passes the filters that the measured torque has passed."""
        if self.sections is None or self.bounds is None:
            return self.apply(columns)
        passed = np.empty_like(columns)
        for start, stop in zip(self.bounds[:-1], self.bounds[1:], strict=True):
            part = columns[start:stop]
            if self.zero_phase:
                padding = min(len(part) - 1, round(2.0 * SAMPLES_PER_CYCLE))
                passed[start:stop] = sosfiltfilt(self.sections, part, axis=0, padlen=padding)
                continue
            rest = sosfilt_zi(self.sections)[:, :, None] * part[0]
            filtered = sosfilt(
                self.sections, np.vstack([part, np.repeat(part[-1:], self.lead, axis=0)]), axis=0, zi=rest
            )[0]
            passed[start:stop] = filtered[self.lead :]
        return self.apply(passed)

    def apply(self, columns: np.ndarray) -> np.ndarray:
        """(n, k) -> (m, k)."""
        if len(self.taps) == 1:
            return columns[self.centres]
        out = np.empty((len(self.centres), columns.shape[1]))
        kernels.decimate(np.ascontiguousarray(columns), self.centres, self.taps, out)
        return out


def thinning(motion: Motion) -> Thinning:
    """Twice the bandwidth is enough for a smoothed recording; a friction series is only thinned when it is very long."""
    if motion.bandwidth > 0.0:
        stride = max(1, int(motion.rate / (2.0 * motion.bandwidth)))
    else:
        stride = max(1, len(motion) // SERIES_POINTS)
    sections, lead = None, 0
    if motion.bandwidth > 0.0:
        sections = low_pass(motion.bandwidth, motion.rate)
    if motion.filtered > 0.0:
        sections = butter(3, motion.filtered, fs=motion.rate, output="sos")
        lead = round(motion.rate / (np.pi * motion.filtered))
    half = 0 if stride == 1 or motion.bandwidth == 0.0 else 3 * stride
    x = np.arange(-half, half + 1) / stride
    taps = np.sinc(0.8 * x) * (0.5 + 0.5 * np.cos(np.pi * x / 3.0) if half else 1.0)
    centres = [np.arange(part.start + half, part.stop - half - lead, stride) for part in motion.stretches]
    chosen = np.concatenate(centres).astype(np.int64)
    return Thinning(chosen, taps / taps.sum(), stride, sections, motion.bandwidth > 0.0, lead, motion.bounds)


@dataclass(frozen=True, eq=False)
class Problem:
    """Torque measured against torque modelled.

    The vector of unknowns holds the law's parameters, then inertia, offset and the initial bristle torque of each
    stretch. `rotor` (n,) is the torque to explain; `weights` (m,) say which compared samples count.
    """

    axis: Axis
    motion: Motion
    model: Model
    rotor: np.ndarray
    thin: Thinning
    target: np.ndarray
    weights: np.ndarray
    acceleration: np.ndarray  # (m,)
    fine: Fine | None = None  # where predictions can be made: a recording and a law with bristles

    @property
    def law_size(self) -> int:
        return len(self.axis.friction.term.parameters)

    @property
    def inertia_index(self) -> int:
        return self.law_size

    @property
    def offset_index(self) -> int:
        return self.law_size + 1

    @property
    def names(self) -> list[str]:
        """Of the unknowns."""
        states = [f"initial bristle torque {k}" for k in range(len(self.motion.bounds) - 1)]
        return [*(p.name for p in self.axis.friction.term.parameters), "inertia", "offset", *states]

    @property
    def tolerance(self) -> float:
        """Relative gain of cost below which a fit ends; derivatives by differences cannot tell less."""
        return 1e-6 if isinstance(self.model, AnyModel) else 1e-10

    @property
    def times(self) -> np.ndarray:
        return self.motion.t[self.thin.centres]

    @property
    def velocity(self) -> np.ndarray:
        """(m,) rad/s at the compared samples."""
        return self.motion.velocity[self.thin.centres]

    def masked(self, mask: np.ndarray) -> Problem:
        """The same problem in which only some of the samples count."""
        return replace(self, weights=self.weights * mask)

    def torque(self, unknowns: np.ndarray) -> np.ndarray:
        """(m,) modelled torque."""
        k = self.law_size
        friction = self.thin.modelled(self.model.torque(unknowns[:k], unknowns[k + 2 :])[:, None])[:, 0]
        return np.asarray(friction + unknowns[k] * self.acceleration + unknowns[k + 1])

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """The same, by the name that a fit knows."""
        return self.torque(unknowns)

    def linearised(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torque (m,) and its derivatives by every unknown (m, p)."""
        k = self.law_size
        law, slopes, first = self.model.derivatives(unknowns[:k], unknowns[k + 2 :])
        stretches = self.motion.stretches
        states = np.zeros((len(law), len(stretches)))
        if first is not None and len(stretches) <= MOST_INITIAL_STATES:
            for s, part in enumerate(stretches):
                states[part, s] = first[part]
        columns = self.thin.modelled(np.column_stack([law, slopes, states]))
        torque = columns[:, 0] + unknowns[k] * self.acceleration + unknowns[k + 1]
        rest = np.column_stack([self.acceleration, np.ones(len(torque))])
        return torque, np.hstack([columns[:, 1 : 1 + k], rest, columns[:, 1 + k :]])


def pose(axis: Axis, motion: Motion) -> Problem:
    """The problem of an axis (its law and effects believed) and a motion."""
    known = background(axis, motion)
    rotor = known.rotor - known.opposing
    model = model_for(axis, motion)
    fine = _fine(axis, motion, known.opposing) if isinstance(model, LuGreModel) else None
    if motion.bandwidth > 0.0:
        index, motion = coarse(motion, max(1, int(motion.rate / (SAMPLES_PER_CYCLE * motion.bandwidth))))
        rotor = rotor[index]
        model = model_for(axis, motion)
    thin = thinning(motion)
    weights = np.ones(len(thin.centres))
    if isinstance(model, AnyModel):
        weights[unsure_start(motion)[thin.centres]] = 0.0
    target, acceleration = thin.apply(np.column_stack([rotor, motion.acceleration])).T
    return Problem(axis, motion, model, rotor, thin, target.copy(), weights, acceleration.copy(), fine)


def _fine(axis: Axis, motion: Motion, opposing: np.ndarray) -> Fine | None:
    """Position and torque at the rotor as logged, the torque without believed effects and without the believed delay."""
    if motion.raw is None:
        return None
    position, torque = motion.raw
    prompt = background(replace(axis, actuation_delay=0.0), replace(motion, torque=torque)).rotor
    return Fine(
        position, prompt - opposing, motion.bounds, 1.0 / motion.rate, motion.density, axis.actuation_delay
    )
