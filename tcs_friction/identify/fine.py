"""What predictions are made from: position as recorded, at its own instants, and torque as logged, with its own stamps."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.conditioning.hold import Between, LoggedTorque
from tcs_friction.conditioning.motion import Motion
from tcs_friction.conditioning.sampling import even
from tcs_friction.identify.models import Model
from tcs_friction.numerics.runs import runs

LEAST_RUN = 100  # samples that follow each other, to predict one from those before


@dataclass(frozen=True, eq=False)
class Samples:
    """Recorded samples of several runs, one after the other.

    t (n,) s, position (n,) rad, bounds (s + 1,), source (s,): stretch of the motion that each run is from. before (n,) and
    share (n,): between which samples of the motion each lies, share 0 at `before` and 1 at the next. steps (n,): s to the next
    sample, 0 at the end of a run.
    """

    t: np.ndarray
    position: np.ndarray
    bounds: np.ndarray
    source: tuple[int, ...]
    before: np.ndarray
    share: np.ndarray
    steps: np.ndarray

    def __len__(self) -> int:
        return len(self.t)

    def at(self, values: np.ndarray) -> np.ndarray:
        """Values (k,) of the motion's samples at these (n,)."""
        here = values[self.before]
        if not self.share.any():
            return np.asarray(here)
        return np.asarray(here + self.share * (values[np.minimum(self.before + 1, len(values) - 1)] - here))

    def only(self, mask: np.ndarray) -> Samples | None:
        """Those samples (n,) alone of which LEAST_RUN follow each other; None of none."""
        found = [
            (np.arange(a + first, b + first), source)
            for (first, last), source in zip(itertools.pairwise(self.bounds), self.source, strict=True)
            for a, b in runs(mask[first:last])
            if b - a >= LEAST_RUN
        ]
        if not found:
            return None
        index = np.concatenate([part for part, _ in found])
        bounds = np.cumsum([0, *(len(part) for part, _ in found)])
        steps = self.steps[index]
        steps[bounds[1:] - 1] = 0.0
        columns = {name: getattr(self, name)[index] for name in ("t", "position", "before", "share")}
        return Samples(**columns, bounds=bounds, source=tuple(source for _, source in found), steps=steps)


def fine_samples(motion: Motion) -> Samples:
    """The recorded samples within a motion's stretches."""
    t, position, before, share, steps = [], [], [], [], []
    dt = 1.0 / motion.rate
    for grid, part in zip(motion.grids, motion.stretches, strict=True):
        times = motion.t[part]
        a, b = np.searchsorted(grid.t, [times[0] - 1e-9, times[-1] + 1e-9]).tolist()
        at = np.clip((grid.t[a:b] - times[0]) * motion.rate, 0.0, len(times) - 1.0)
        apart, regular = np.diff(grid.t[a:b]), b - a == len(times) and even(grid.t[a:b], motion.rate)
        whole = np.arange(b - a) if regular else np.minimum(at.astype(np.int64), len(times) - 2)
        t.append(grid.t[a:b])
        position.append(grid.position[a:b])
        before.append(part.start + whole)
        share.append(np.zeros(b - a) if regular else at - whole)
        steps.append(np.append(np.full(b - a - 1, dt) if regular else apart, 0.0))
    return Samples(
        np.concatenate(t), np.concatenate(position), np.cumsum([0, *map(len, t)]), tuple(range(len(t))),
        np.concatenate(before), np.concatenate(share), np.concatenate(steps),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Fine:
    """What predictions are made from.

    logs: torque of each stretch, with what is believed of the drive but its delay; between, acts (s): its timing to start with;
    delay: s, believed, on top. period: usual step, s. density: rad^2/Hz of the encoder's noise. opposing (k,): N m of believed
    effects at the samples of the motion. `model` walks through that motion with `velocity` rad/s (k,), `shaken` through the same
    with the velocity moved by `jitter` rad/s (k,), to and fro so that the way stays the same. least: (p,) steps of the law's
    parameters that move the friction a little where these are zero. size: N m, of the torque.
    """

    samples: Samples
    logs: tuple[LoggedTorque, ...]
    period: float
    between: Between
    density: float
    acts: float
    delay: float
    opposing: np.ndarray
    model: Model
    shaken: Model
    velocity: np.ndarray
    jitter: np.ndarray
    least: np.ndarray
    size: float

    def only(self, mask: np.ndarray) -> Fine | None:
        """The same with those samples (n,) alone of which enough follow each other; None of none."""
        samples = self.samples.only(mask)
        return None if samples is None else replace(self, samples=samples)

    def drawn(self, between: Between) -> Fine:
        """The same with another idea of what the torque does between logged values."""
        return replace(self, between=between, logs=tuple(log.drawn(between) for log in self.logs))

    def walked(self, substeps: int) -> Walked:
        """The walk that divides each usual period into so many equal steps; 0: one step from sample to sample, however far."""
        samples = self.samples
        counts = np.rint(substeps * samples.steps / self.period).astype(np.int64)
        counts = np.where(samples.steps > 0.0, np.maximum(counts, 1), 0)
        firsts = np.concatenate([[0], np.cumsum(counts)])
        number = np.arange(firsts[-1]) - np.repeat(firsts[:-1], counts)
        parts = np.maximum(counts, 1)
        begins = np.repeat(samples.t, counts) + number * np.repeat(np.diff(samples.t, append=samples.t[-1]) / parts, counts)
        return Walked(firsts, np.repeat(samples.steps / parts, counts), begins)

    def pushed(self, walk: Walked, lateness: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean torque (q,) N m over each step of a walk and the constant one (q,) that moves as far.

        lateness: s by which the torque acts later than `acts` + `delay` say.
        """
        samples, begins = self.samples, walk.begins
        means, moving = np.empty(len(begins)), np.empty(len(begins))
        late, opposing = self.acts + self.delay + lateness, samples.at(self.opposing)
        for (first, last), source in zip(itertools.pairwise(samples.bounds), samples.source, strict=True):
            part = slice(walk.firsts[first], walk.firsts[last])
            edges = np.append(begins[part], samples.t[last - 1])
            means[part], moving[part] = self.logs[source].pushes(edges, late)
            if opposing.any():
                known = np.interp(edges, samples.t[first:last], opposing[first:last])
                known = 0.5 * (known[1:] + known[:-1])
                means[part] -= known
                moving[part] -= known
        return means, moving

    def rough(self, walk: Walked) -> np.ndarray:
        """(q,) N m by which the log changes about each step of a walk; steps of one sample share its square."""
        rough = np.empty(len(walk.begins))
        for (first, last), source in zip(itertools.pairwise(self.samples.bounds), self.samples.source, strict=True):
            part, log = slice(walk.firsts[first], walk.firsts[last]), self.logs[source]
            rough[part] = np.interp(walk.begins[part] - self.acts - self.delay, log.t, log.roughness)
        parts = np.diff(walk.firsts)
        return np.asarray(rough * np.sqrt(np.repeat(parts, parts)))


@dataclass(frozen=True, eq=False)
class Walked:
    """Steps between samples: from sample i on those from firsts[i] up to firsts[i + 1] (n + 1,); steps (q,) s, begins (q,) s."""

    firsts: np.ndarray
    steps: np.ndarray
    begins: np.ndarray

    @property
    def counted(self) -> np.ndarray:
        """(n,) Which samples a step follows."""
        return np.asarray(np.diff(self.firsts) > 0)
