"""The least-squares problem: what is compared with what, filtered alike, at the rate that still carries information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from tcs_friction.conditioning.hold import LoggedTorque
from tcs_friction.conditioning.motion import (
    SAMPLES_PER_CYCLE,
    Motion,
    at_rest,
    coarse,
    resmoothed,
    sections,
    unsure_start,
    windows,
)
from tcs_friction.identify import kernels
from tcs_friction.identify.fine import Fine, fine_samples
from tcs_friction.identify.models import (
    AnyModel,
    LoadedModel,
    Model,
    background,
    model_for,
    reads_load,
)
from tcs_friction.identify.refine import Refined
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Place

MOST_INITIAL_STATES = 16
SERIES_POINTS = 20000  # friction series are thinned to about this many points
MOST_SAMPLES, WINDOW = 400_000, 20_000  # samples that are predicted, and windows of a recording that has more
LITTLE = 1e-4  # of the torque, or of a number's unit: a small step from zero
JITTER = 1e-3  # of the velocity's resolution, for slopes of friction: a memory must keep up with what it does to the level
SHARPER = 3.0  # times the low pass' bandwidth, for friction that predictions are made with
LEAST_SLIDING = 0.2  # of a recording, where a law without memory is to be judged by sliding alone


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
    passed, lead = None, 0
    if motion.bandwidth > 0.0:
        passed = sections(motion.bandwidth, motion.rate)
    if motion.filtered > 0.0:
        passed = butter(3, motion.filtered, fs=motion.rate, output="sos")
        lead = round(motion.rate / (np.pi * motion.filtered))
    half = 0 if stride == 1 or motion.bandwidth == 0.0 else 3 * stride
    x = np.arange(-half, half + 1) / stride
    taps = np.sinc(0.8 * x) * (0.5 + 0.5 * np.cos(np.pi * x / 3.0) if half else 1.0)
    centres = [np.arange(part.start + half, part.stop - half - lead, stride) for part in motion.stretches]
    chosen = np.concatenate(centres).astype(np.int64)
    return Thinning(chosen, taps / taps.sum(), stride, passed, motion.bandwidth > 0.0, lead, motion.bounds)


@dataclass(frozen=True, eq=False)
class Problem:
    """Torque measured against torque modelled.

    The vector of unknowns holds the law's parameters, then inertia, offset, lateness of the torque and the initial bristle torque
    of each stretch. Lateness is how much later (s) the torque acts than `rotor` has it. `rotor` (n,) is the torque to explain;
    `weights` (m,) say which compared samples count. whole: the motion of which `motion` has every so many samples.
    """

    axis: Axis
    motion: Motion
    model: Model
    rotor: np.ndarray
    thin: Thinning
    target: np.ndarray
    weights: np.ndarray
    acceleration: np.ndarray  # (m,)
    explained: np.ndarray  # (m,) bool: the law's torque there does not depend on what nobody saw
    told: np.ndarray  # (m,) bool: and it is more than a bound
    rise: np.ndarray  # (m,) N m/s, by which the torque to explain changes with time
    whole: Motion  # of which `motion` are every so many samples
    fine: Fine | None = None  # where predictions can be made: a recording

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
    def lateness_index(self) -> int:
        return self.law_size + 2

    @property
    def states_index(self) -> int:
        """Of the first initial bristle torque."""
        return self.law_size + 3

    @property
    def names(self) -> list[str]:
        """Of the unknowns."""
        states = [f"initial bristle torque {k}" for k in range(len(self.motion.bounds) - 1)]
        return [*(p.name for p in self.axis.friction.term.parameters), "inertia", "offset", "lateness", *states]

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

    def unexplained(self, refined: Refined) -> np.ndarray:
        """(m,) residual of a fit; of a law that only bounds the torque at rest, there what exceeds the bound."""
        silent = self.explained & ~self.told
        if not silent.any() or not isinstance(self.model, AnyModel):
            return refined.residual
        friction = (self.target - self.beside(refined.unknowns))[silent]
        level = self.model.level(refined.unknowns[: self.law_size])[self.thin.centres][silent]
        residual = refined.residual.copy()
        residual[silent] = friction - np.clip(friction, -level, level)
        return residual

    def masked(self, mask: np.ndarray) -> Problem:
        """The same problem in which only some of the samples count."""
        return replace(self, weights=self.weights * mask)

    def torque(self, unknowns: np.ndarray) -> np.ndarray:
        """(m,) modelled torque."""
        k = self.law_size
        law = self.model.torque(unknowns[:k], unknowns[k + 3 :], self._rest(unknowns))
        friction = self.thin.modelled(law[:, None])[:, 0]
        return np.asarray(friction + self.beside(unknowns))

    def beside(self, unknowns: np.ndarray) -> np.ndarray:
        """(m,) torque beside friction; one that acts later leaves more to explain where the torque rises."""
        inertia, offset, lateness = unknowns[self.law_size : self.law_size + 3]
        return np.asarray(inertia * self.acceleration + offset + lateness * self.rise)

    def _rest(self, unknowns: np.ndarray) -> np.ndarray:
        """(n,) torque that inertia and offset require."""
        return np.asarray(
            unknowns[self.inertia_index] * self.motion.acceleration + unknowns[self.offset_index]
        )

    def evaluated(self, unknowns: np.ndarray) -> np.ndarray:
        """The same, by the name that a fit knows."""
        return self.torque(unknowns)

    def linearised(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torque (m,) and its derivatives by every unknown (m, p)."""
        k = self.law_size
        law, slopes, first = self.model.derivatives(unknowns[:k], unknowns[k + 3 :], self._rest(unknowns))
        stretches = self.motion.stretches
        states = np.zeros((len(law), len(stretches)))
        if first is not None and len(stretches) <= MOST_INITIAL_STATES:
            for s, part in enumerate(stretches):
                states[part, s] = first[part]
        columns = self.thin.modelled(np.column_stack([law, slopes, states]))
        torque = columns[:, 0] + self.beside(unknowns)
        rest = np.column_stack([self.acceleration, np.ones(len(torque))])
        if isinstance(self.model, LoadedModel):
            growth = self.model.growth(unknowns[:k])
            rest += self.thin.modelled(np.column_stack([growth * self.motion.acceleration, growth]))
        return torque, np.hstack([columns[:, 1 : 1 + k], rest, self.rise[:, None], columns[:, 1 + k :]])


def pose(axis: Axis, motion: Motion, predicted: bool = True) -> Problem:
    """The problem of an axis (its law and effects believed) and a motion; `predicted`: with what predictions are made from."""
    known = background(axis, motion)
    rotor = known.rotor - known.opposing
    rise = np.concatenate([np.gradient(known.rotor[part], 1.0 / motion.rate) for part in motion.stretches])
    fine = _fine(axis, motion) if predicted else None
    whole = motion
    if motion.bandwidth > 0.0:
        index, motion = coarse(motion, max(1, int(motion.rate / (SAMPLES_PER_CYCLE * motion.bandwidth))))
        rotor, rise = rotor[index], rise[index]
    model = model_for(axis, motion)
    thin = thinning(motion)
    explained, told = _known(axis, model, motion)
    target, acceleration, rising = thin.apply(np.column_stack([rotor, motion.acceleration, rise])).T.copy()
    return Problem(
        axis, motion, model, rotor, thin, target, told[thin.centres].astype(np.float64), acceleration,
        explained[thin.centres], told[thin.centres], rising, whole, fine,
    )  # fmt: skip


def _known(axis: Axis, model: Model, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """(n,) Whether the law's torque follows from the motion, and whether that tells its parameters.

    A law without memory is silent about the torque at rest, unless hardly anything else has been recorded.
    """
    explained = ~unsure_start(motion) if isinstance(model, AnyModel) else np.ones(len(motion), dtype=bool)
    if not axis.friction.term.without_memory:
        return explained, explained
    told = explained & ~at_rest(motion)
    return explained, told if told.mean() > LEAST_SLIDING else explained


def _fine(axis: Axis, motion: Motion) -> Fine | None:
    """Position as recorded and torque as logged; what is believed of the drive has acted on it, but for its delay."""
    if not motion.grids or any(item.term.place is Place.SENSOR for item in axis.effects):
        return None
    motion = resmoothed(windows(motion, MOST_SAMPLES, WINDOW), SHARPER * motion.bandwidth)
    samples = fine_samples(motion)
    opposing = background(axis, motion).opposing
    if any(item.term.place is Place.DRIVE for item in axis.effects):
        logged = np.concatenate(
            [grid.logged.values_at(motion.t[part]) for grid, part in zip(motion.grids, motion.stretches, strict=True)]
        )
        rotor = background(replace(axis, actuation_delay=0.0), replace(motion, torque=logged)).rotor
        logs = tuple(LoggedTorque(motion.t[part], rotor[part], 1.0 / motion.rate) for part in motion.stretches)
    else:
        logs = tuple(grid.logged for grid in motion.grids)
    if reads_load(axis):
        # A prediction from the torque as it is, which pushes and loads at once, shares no noise with its error.
        motion = replace(motion, torque=_mean_torque(logs, motion))
    made = AnyModel if reads_load(axis) else model_for
    model = made(axis, motion)
    jitter = JITTER * motion.resolution * np.where(np.arange(len(motion)) % 2, -1.0, 1.0)
    shaken = made(axis, replace(motion, velocity=motion.velocity + jitter))
    viscosity = float(np.std(motion.torque)) / float(np.abs(motion.velocity).max())
    least = [LITTLE * (viscosity if p.unit == "N m s/rad" else 1.0) for p in axis.friction.term.parameters]
    fine = Fine(
        samples, logs, 1.0 / motion.rate, motion.timing.between, motion.density, motion.timing.acts,
        axis.actuation_delay, opposing, model, shaken, motion.velocity, jitter, np.array(least),
        float(np.std(motion.torque)),
    )  # fmt: skip
    return fine.only(fine.samples.at(_known(axis, model, motion)[1].astype(np.float64)) == 1.0)


def _mean_torque(logs: Sequence[LoggedTorque], motion: Motion) -> np.ndarray:
    """(n,) torque over the period around each sample."""
    half, timing = 0.5 / motion.rate, motion.timing
    return np.concatenate(
        [
            (log.integrals(motion.t[part] + half, timing.acts)[0] - log.integrals(motion.t[part] - half, timing.acts)[0])
            * motion.rate
            for log, part in zip(logs, motion.stretches, strict=True)
        ]
    )


def settled(problem: Problem, unknowns: np.ndarray) -> Problem:
    """The same without the samples whose friction, by these unknowns (p,), depends on what was before the recording."""
    model, fine, values = problem.model, problem.fine, unknowns[: problem.law_size]
    if not isinstance(model, AnyModel) or problem.axis.friction.term.without_memory:
        return problem
    sure = ~model.unsure(values)[problem.thin.centres]
    if fine is not None and isinstance(fine.model, AnyModel):
        fine = fine.only(fine.samples.at(fine.model.unsure(values).astype(np.float64)) == 0.0)
    told, explained = problem.told & sure, problem.explained & sure
    return replace(problem, weights=problem.weights * sure, explained=explained, told=told, fine=fine)
