"""Conditions recordings for torque balances: one uniform time base, motion and torque through one zero-phase filter.

Position, velocity and acceleration come from the same low-passed position (differentiated in the frequency domain, so
without differentiation noise of their own), and torque and all other signals pass the same filter. Torques are compared up to
where the position's spectrum sinks into its own noise floor: beyond it an acceleration is noise. Friction is no linear function
of the motion, so motion is kept in a wider band and the torques that it demands are narrowed afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft, ndimage, signal

from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Recording

SHORTEST = 2.0  # s; a shorter stretch is left out
FEWEST = 200  # samples
EDGE_PERIODS = 4.0  # of the cutoff, left out at both ends of a stretch
EDGE_SECONDS = 0.1
SAMPLES_PER_PERIOD = 3.0  # compared, of the cutoff; torques are narrowed to 1.4 times the cutoff
STEPS_PER_PERIOD = 6.0  # at which motion is evaluated: bristles need finer steps than the comparison
FILTER_ORDER = 8
WIDE = 2.0  # band of the motion over that of the comparison
WIDEST = 0.4  # of the sampling rate
TAPS = 2.0  # periods of the cutoff on each side, of the filter that narrows torques
RINGING = 2.0  # s of zeros after a series, in which a filter may ring out
CLEAR = 5.0  # power over that of the position's noise that counts as a signal
HIGHEST = 0.2  # of the sampling rate, cutoff
SPACING = 0.95  # quantile of the time between samples, within which a line through them must do
SAME_POSITION = 1e-12  # of the travel: positions that differ by less are the same
UNEVEN, MOST_WHOLE = 0.01, 0.99  # by which a multiple of a step may miss, share of differences that must be multiples
BLURRED = 0.5  # of a step, noise that leaves less than a hundredth of its waves
HELD_OUT = 0.25  # share of the data
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
MOST_UNKNOWN = 0.1  # of a stretch, that may be left out because friction remembers what was before
BLOCKS = 16  # at most, that a lone recording is cut into to hold some out
BLOCK_EDGES = 5.0  # a block is at least so many times as long as the edge that is lost between two


@dataclass(frozen=True, eq=False)
class Stretch:
    """A gap-free, uniformly sampled, filtered piece of a recording; all arrays (n,), signals (1 + s, n).

    The masks mark the samples that are compared, every `stride`-th.
    """

    t: np.ndarray  # s, of the recording
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    signals: np.ndarray  # temperature, then exogenous
    train: np.ndarray  # bool: may be fitted
    held_out: np.ndarray  # bool: never seen before the proof
    piece: np.ndarray  # int: block of the data, as long as a held-out one


@dataclass(frozen=True, eq=False)
class Conditioned:
    """Recordings ready for torque balances.

    cutoff: up to which torques are compared, Hz; the motion's band is WIDE times as wide. period: of the recording, s.
    dt: s between samples that are compared, every `stride`-th that is evaluated.
    velocity_noise: rad/s rms left in the velocity.
    position_noise: rad rms before filtering. position_step: of the encoder, rad, where no noise blurs it, else 0.
    names: of the exogenous signals. notes: what was found and done, one line each.
    """

    stretches: tuple[Stretch, ...]
    period: float
    dt: float
    stride: int
    cutoff: float
    velocity_noise: float
    position_noise: float
    position_step: float
    names: tuple[str, ...]
    temperature: bool
    notes: tuple[str, ...]

    def joined(self, name: str) -> np.ndarray:
        """One quantity over all stretches at the samples that are compared."""
        step = 1 if name in ("train", "held_out", "piece") else self.stride
        return np.concatenate([getattr(s, name)[..., ::step] for s in self.stretches], axis=-1)

    def narrowed(self, x: np.ndarray) -> np.ndarray:
        """A torque (n,) of one stretch at the samples that are evaluated, low-passed at the cutoff where it is compared."""
        taps = len(self._narrowing) // 2
        filtered = signal.upfirdn(self._narrowing, x, down=self.stride, mode="edge")
        first = taps // self.stride
        return np.ascontiguousarray(filtered[first : first - (-len(x) // self.stride)])

    @cached_property
    def _narrowing(self) -> np.ndarray:
        """Low pass of torques at the evaluated samples: a whole number of compared samples on each side."""
        taps = self.stride * math.ceil(TAPS / (self.cutoff * self.dt))
        edge = min(2.0 * self.cutoff * self.dt / self.stride, 0.99)
        return np.asarray(signal.firwin(2 * taps + 1, edge, window="hann"))


def low_pass(x: np.ndarray, dt: float, cutoff: float, derivatives: int = 0) -> list[np.ndarray]:
    """Zero-phase low-pass of x (n,) and its time derivatives, by FFT with odd extension at the ends.

    Magnitude 1/(1 + (f/cutoff)^FILTER_ORDER), Butterworth's, applied forwards and backwards.
    """
    n = len(x)
    pad = min(n - 1, math.ceil(10.0 / cutoff / dt))
    extended = np.concatenate([2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]])
    trend = np.linspace(extended[0], extended[-1], len(extended))
    slope = (extended[-1] - extended[0]) / ((len(extended) - 1) * dt)
    size = fft.next_fast_len(len(extended), real=True)
    frequency = fft.rfftfreq(size, dt)
    spectrum = fft.rfft(extended - trend, size) / (1.0 + (frequency / cutoff) ** FILTER_ORDER)
    omega = 2j * np.pi * frequency
    inside = slice(pad, pad + n)
    results = [fft.irfft(spectrum * omega**k, size)[inside] for k in range(derivatives + 1)]
    results[0] = results[0] + trend[inside]
    if derivatives:
        results[1] = results[1] + slope
    return results


def through(x: np.ndarray, dt: float, response: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """A series (n,) through a linear filter; `response` (m,), complex, at frequencies (m,), Hz. Before and after it are zeros."""
    size = fft.next_fast_len(len(x) + math.ceil(RINGING / dt), real=True)
    spectrum = fft.rfft(x, size) * response(fft.rfftfreq(size, dt))
    return np.asarray(fft.irfft(spectrum, size, overwrite_x=True)[: len(x)])


def position_spectrum(position: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies (Hz), power density of the position and the level of its white noise floor, both in rad^2/Hz."""
    frequency, power = signal.welch(
        np.diff(position, 2), 1.0 / dt, nperseg=min(2048, max(64, len(position) // 4))
    )
    power = power[1:] / (2.0 * np.sin(np.pi * frequency[1:] * dt)) ** 4
    return frequency[1:], power, float(np.median(power[int(0.7 * len(power)) :]))


def choose_cutoff(position: np.ndarray, dt: float) -> tuple[float, float]:
    """Cutoff (Hz), 1.4 times where the position sinks into its noise (the filter halves there), and that noise (rad rms)."""
    frequency, power, floor = position_spectrum(position, dt)
    above = ndimage.median_filter(power, 9) > CLEAR * floor
    share = np.cumsum(above) / np.arange(1, len(above) + 1)
    clear = np.nonzero(above & (share > 0.8))[0]
    cutoff = 1.4 * frequency[clear[-1]] if len(clear) else frequency[0]
    lowest = max(4.0 * frequency[0], 1.0)
    return float(np.clip(cutoff, lowest, HIGHEST / dt)), math.sqrt(floor * 0.5 / dt)


def step_of(position: np.ndarray) -> float:
    """The step (rad) of which differences of positions (n,) are multiples, as a coarse encoder's are; 0 if there is none."""
    values = np.unique(position)
    steps = np.diff(values)
    steps = steps[steps > SAME_POSITION * (values[-1] - values[0])]
    multiples = steps / steps.min()
    whole = np.abs(multiples - np.round(multiples)) < UNEVEN
    return float(steps.min()) if np.mean(whole) > MOST_WHOLE else 0.0


def condition(recordings: Sequence[Recording], held_out: bool = True, memory: float = 0.0) -> Conditioned:
    """Put recordings onto a common filtered time base and cut off the held-out data.

    With several recordings whole ones are held out, otherwise blocks of the one there is. What was before a stretch is unknown:
    it is not compared until it has moved over `memory` (rad), where it does so within MOST_UNKNOWN of its length.

    Raises InputError when the data cannot carry a torque balance: too short, no motion, no torque.
    """
    notes: list[str] = []
    pieces = [(r, s) for r in recordings for s in r.segments]
    check(recordings)
    periods = [float(np.median(np.diff(r.t[s]))) for r, s in pieces if s.stop - s.start >= FEWEST]
    long = [
        (r, s) for r, s in pieces if s.stop - s.start >= FEWEST and r.t[s.stop - 1] - r.t[s.start] >= SHORTEST
    ]
    if not long:
        longest = max(float(r.t[s.stop - 1] - r.t[s.start]) for r, s in pieces)
        raise InputError(
            recordings[0].source,
            f"the longest stretch without a gap has {longest:.3g} s",
            f"at least {SHORTEST:g} s and {FEWEST} samples",
        )
    if len(long) < len(pieces):
        notes.append(
            f"{len(pieces) - len(long)} of {len(pieces)} stretches between gaps are too short and left out"
        )
    dt = float(np.median(periods))
    uniform = [_uniform(r, s, dt) for r, s in long]
    chosen = [choose_cutoff(position, dt) for _, position, _, _ in uniform]
    spacing = max(float(np.quantile(np.diff(r.t[s]), SPACING)) for r, s in long)
    cutoff = min(float(np.median([c for c, _ in chosen])), HIGHEST / (dt * max(round(spacing / dt), 1)))
    noise = float(np.median([n for _, n in chosen]))
    step = max(1, int(1.0 / (STEPS_PER_PERIOD * cutoff * dt)))
    stride = max(1, int(1.0 / (SAMPLES_PER_PERIOD * cutoff * dt * step)))
    notes.append(
        f"torques compared up to {cutoff:.3g} Hz (position noise {noise:.2g} rms), evaluated at "
        f"{1 / (step * dt):.4g} Hz, compared at {1 / (step * stride * dt):.4g} Hz"
    )
    wide = min(WIDE * cutoff, WIDEST / dt)
    velocity_noise = noise * 2.0 * math.pi * wide * math.sqrt(2.0 * dt * wide / 3.0)
    names = tuple(recordings[0].exogenous)
    parts = [_filtered(piece, dt, wide, step) for piece in uniform]
    sizes = [-(-len(part["t"]) // stride) for part in parts]
    edge = math.ceil(max(EDGE_PERIODS / cutoff, EDGE_SECONDS) / (step * stride * dt))
    blocks = _blocks(sizes, edge)
    masks = (
        _hold_out([r for r, _ in long], blocks, len(recordings))
        if held_out
        else [np.zeros(n, bool) for n in sizes]
    )
    stretches = []
    for part, mask, block in zip(parts, masks, blocks, strict=True):
        usable = np.zeros(len(mask), bool)
        usable[max(edge, _unknown(part["position"][::stride], memory)) : -edge] = True
        gap = ndimage.binary_dilation(mask, iterations=edge) if mask.any() else mask
        stretches.append(Stretch(**part, train=usable & ~gap, held_out=usable & mask, piece=block))
    temperature = all(r.temperature is not None for r in recordings)
    step_size = max(step_of(r.position) for r in recordings)
    step_size = step_size if noise < BLURRED * step_size else 0.0
    if step_size > 0.0:
        notes.append(f"the encoder's steps of {step_size:.3g} show: waves within half a step are not named")
    return Conditioned(
        tuple(stretches),
        dt,
        step * stride * dt,
        stride,
        cutoff,
        velocity_noise,
        noise,
        step_size,
        names,
        temperature,
        tuple(notes),
    )


def _unknown(position: np.ndarray, memory: float) -> int:
    """Samples of a stretch until its positions (n,) have spread over `memory`, 0 if that takes too many of them."""
    spread = np.maximum.accumulate(position) - np.minimum.accumulate(position)
    count = int(np.searchsorted(spread, memory))
    return count if count < MOST_UNKNOWN * len(position) else 0


def check(recordings: Sequence[Recording]) -> None:
    """Refuse what cannot carry a torque balance, in one line."""
    for r in recordings:
        if np.ptp(r.position) == 0.0:
            raise InputError(r.source, "the position never changes", "a recording in which the axis moves")
        if np.ptp(r.torque) == 0.0:
            raise InputError(
                r.source, f"the torque is constant ({r.torque[0]:g})", "the torque applied to the axis"
            )
        distinct = len(np.unique(r.position))
        if distinct < 20:
            raise InputError(
                r.source, f"the position takes only {distinct} values", "motion over many encoder steps"
            )
        if tuple(r.exogenous) != tuple(recordings[0].exogenous):
            raise InputError(
                r.source,
                "other exogenous signals than the first recording",
                ", ".join(recordings[0].exogenous),
            )
        if r.velocity is not None:
            _check_velocity(r)


def _check_velocity(r: Recording) -> None:
    """The recorded velocity must be the derivative of the position: otherwise one of them has another unit."""
    assert r.velocity is not None
    moved, integrated = [], []
    for s in r.segments:
        t, q, v = r.t[s], r.position[s], r.velocity[s]
        if len(t) < 10:
            continue
        sums = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        moved.append(q - np.mean(q))
        integrated.append(sums - np.mean(sums))
    if not moved:
        return
    x, y = np.concatenate(integrated), np.concatenate(moved)
    if x @ x == 0.0 or (x @ y) ** 2 < 0.5 * (x @ x) * (y @ y):
        return  # no clear relation either way; the velocity is not used further
    slope = float(x @ y / (x @ x))
    if not 0.5 < slope < 2.0:
        hint = (
            " (degrees in one of them?)"
            if min(abs(slope * 57.29578 - 1), abs(slope / 57.29578 - 1)) < 0.3
            else ""
        )
        raise InputError(
            r.source,
            f"position changes {slope:.3g} times as fast as the velocity says{hint}",
            "both in the same unit",
        )


def _uniform(r: Recording, s: slice, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t, position, torque and other signals at a uniform dt; recordings that are uniform already stay as they are."""
    t = r.t[s]
    others = [r.temperature if r.temperature is not None else np.full(len(r), 20.0), *r.exogenous.values()]
    if np.max(np.abs(np.diff(t) - dt)) < 1e-3 * dt:
        return t, r.position[s], r.torque[s], np.array([x[s] for x in others])
    grid = np.arange(t[0], t[-1], dt)
    return (
        grid,
        *(np.interp(grid, t, x[s]) for x in (r.position, r.torque)),
        np.array([np.interp(grid, t, x[s]) for x in others]),
    )  # type: ignore[return-value]


def _filtered(
    piece: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    dt: float,
    cutoff: float,
    step: int,
) -> dict[str, np.ndarray]:
    t, position, torque, others = piece
    q, v, a = low_pass(position, dt, cutoff, 2)
    (u,) = low_pass(torque, dt, cutoff)
    signals = np.array([low_pass(x, dt, cutoff)[0] for x in others])
    keep = slice(0, len(t), step)
    return {
        "t": t[keep],
        "position": q[keep],
        "velocity": v[keep],
        "acceleration": a[keep],
        "torque": u[keep],
        "signals": np.ascontiguousarray(signals[:, keep]),
    }


def _blocks(sizes: list[int], edge: int) -> list[np.ndarray]:
    """Number of the block (n,) of every sample of each stretch; blocks go on through stretches."""
    total = sum(sizes)
    blocks = min(max(int(total / (BLOCK_EDGES * edge)), round(1.0 / HELD_OUT)), BLOCKS)
    return np.split(np.arange(total) * blocks // total, np.cumsum(sizes)[:-1])


def _hold_out(recordings: Sequence[Recording], blocks: list[np.ndarray], count: int) -> list[np.ndarray]:
    """Masks of held-out samples: the last whole recordings of several, blocks of a lone one at irregular distances.

    Regular ones would always hold the same part of a motion that repeats; multiples of the golden ratio never fall into step.
    """
    if count > 1:
        sources = [id(r) for r in recordings]
        order = list(dict.fromkeys(sources))
        held = set(order[-max(1, round(HELD_OUT * len(order))) :])
        return [np.full(len(b), source in held) for b, source in zip(blocks, sources, strict=True)]
    return [(block * GOLDEN + 0.5) % 1.0 < HELD_OUT for block in blocks]
