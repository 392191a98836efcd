"""Recordings to a data set: one even time base, motion and torque through one zero-phase filter, some data held out.

In: recordings. Out: a `DataSet`. The steps, each in a module of its own:

1. what cannot carry a torque balance is refused (`checks`);
2. stretches without a gap are put onto even time steps, where they are not already; of a position that is renewed every few
   samples only the new ones count;
3. the position's spectrum says up to which frequency torques can be compared (`bands`);
4. position, velocity and acceleration come from the same low-passed position, and all other signals pass the same filter
   (`filters`); the torque passes it as what its hold makes of the logged values (`hold`), at the time when they act (`timing`);
5. edges and pauses of the log are left out, and some data are held out (`hold_out`);
6. where the axis rests (`rest`), nothing is compared for a friction law without memory: at rest it only bounds the torque.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tcs_friction.conditioning import hold_out
from tcs_friction.conditioning.bands import Bands, bands, usual_spacing, visible_step
from tcs_friction.conditioning.checks import check
from tcs_friction.conditioning.data_set import MOVING, DataSet, Stretch
from tcs_friction.conditioning.filters import low_pass
from tcs_friction.conditioning.hold import Between, fresh, logged, stale_stride
from tcs_friction.conditioning.rest import unknown_friction
from tcs_friction.conditioning.sampling import jitter, resampled
from tcs_friction.conditioning.timing import LogTiming, log_timing
from tcs_friction.errors import InputError
from tcs_friction.recording.columns import counted
from tcs_friction.recording.mending import mendings
from tcs_friction.recording.recording import Recording

SHORTEST = 2.0  # s; two periods of the lowest cutoff
FEWEST_SAMPLES = 200  # samples; five overlapping segments of the shortest kind for the noise's spectrum
EVEN = 1e-3  # relative jitter of the steps: at a fifth of the sampling rate, the highest cutoff, a phase of 0.001 rad
FEWEST_FITTED = 20  # compared samples, five for each number of a plain balance
EDGE_PERIODS = 4.0  # of the cutoff, left out at both ends: the low pass settles to 1e-5 in so many
EDGE_SECONDS = 0.1  # at least: a torque that acts later than it is logged acts by then
PAUSE = 3.0  # usual times between samples: no line through what came before and after tells how the axis moved meanwhile
NO_TEMPERATURE = 20.0  # degC, where none was recorded

Segment = tuple[int, slice]  # number of the recording, samples of it
Series = tuple[np.ndarray, np.ndarray]  # t (n,), s; position, reference or NaN, torque, temperature, signals (4 + s, n)


def prepare(
    recordings: Sequence[Recording],
    held_out: bool = True,
    memory: float = 0.0,
    at_rest: bool = True,
    timings: Sequence[LogTiming] | None = None,
    untouched: bool = False,
) -> DataSet:
    """Put recordings onto a common filtered time base and, if `held_out`, keep some data from being fitted.

    What was before a stretch is unknown: it is not compared until it has moved over `memory` (rad). at_rest: whether friction is
    known while the axis rests. timings: of each recording's torque; None: as the recordings have it. untouched: whether a block
    is kept from being looked at as well.

    Raises InputError when the data cannot carry a torque balance: too short, no motion, no torque.
    """
    check(recordings)
    segments, notes = _long_enough(recordings)
    kept = [_fresh_positions(recordings[k], s) for k, s in segments]
    times = [recordings[k].t[chosen] for (k, _), chosen in zip(segments, kept, strict=True)]
    period = float(np.median([np.median(np.diff(t)) for t in times]))
    series = [_even(recordings[k], chosen, period) for (k, _), chosen in zip(segments, kept, strict=True)]
    spacing = usual_spacing(times)
    band = bands([values[0] for _, values in series], period, spacing)
    timings = [log_timing(r) for r in recordings] if timings is None else timings
    parts = [_filtered(one, recordings[k], s, timings[k], period, band) for one, (k, s) in zip(series, segments, strict=True)]
    dt = band.step * band.stride * period
    pauses = _pauses(times, spacing, _edge(band))
    if not at_rest:
        noise = math.sqrt(2.0 * period * band.motion) * band.position_noise
        for part in parts:
            part["resting"] = unknown_friction(
                part["position"], part["velocity"], band.step * period, band.cutoff, noise, MOVING * band.velocity_noise
            )
    kinds = 0 if not held_out else 2 if untouched else 1
    stretches = _divided(parts, [k for k, _ in segments], band, dt, kinds, memory, pauses)
    _check_fitted(stretches, recordings[0].source, band.cutoff)
    renewals = [2.0 * timing.leeway for timing in timings]
    step = visible_step([r.position for r in recordings], band.position_noise)
    return DataSet(
        stretches=stretches,
        period=period,
        dt=dt,
        stride=band.stride,
        cutoff=band.cutoff,
        velocity_noise=band.velocity_noise,
        position_noise=band.position_noise,
        position_step=step,
        names=tuple(recordings[0].exogenous),
        temperature=all(r.temperature is not None for r in recordings),
        notes=(*mendings(recordings), *notes, *_notes(band, period, max(period, *renewals), step, sum(map(len, pauses)))),
        timings=tuple(timings),
    )


def _long_enough(recordings: Sequence[Recording]) -> tuple[list[Segment], list[str]]:
    """The segments that are worth filtering, and a line about those that are not."""
    everything = [(k, s) for k, r in enumerate(recordings) for s in r.segments]
    seconds = [float(recordings[k].t[s.stop - 1] - recordings[k].t[s.start]) for k, s in everything]
    found = [
        (k, s)
        for (k, s), lasts in zip(everything, seconds, strict=True)
        if s.stop - s.start >= FEWEST_SAMPLES and lasts >= SHORTEST
    ]
    if not found:
        raise InputError(
            recordings[0].source,
            f"the longest stretch without a gap has {max(seconds):.3g} s",
            f"at least {SHORTEST:g} s and {FEWEST_SAMPLES} samples",
        )
    left_out = len(everything) - len(found)
    line = f"{left_out} of {len(everything)} stretches between gaps are too short and left out"
    return found, [line] if left_out else []


def _fresh_positions(r: Recording, s: slice) -> NDArray[np.intp]:
    """Samples of a segment whose position is new, where it is renewed every few samples: a held one is no new measurement.

    Too few would be left of a short one: it stays as it is.
    """
    every = np.arange(s.start, s.stop)
    few = (s.stop - s.start) < FEWEST_SAMPLES * stale_stride(r.t[s], r.position[s])
    return every if few else every[fresh(r.t[s], r.position[s])]


def _even(r: Recording, kept: NDArray[np.intp], period: float) -> Series:
    """Samples of one segment at even steps; what is even already stays as it is."""
    temperature = np.full(len(r), NO_TEMPERATURE) if r.temperature is None else r.temperature
    reference = np.full(len(r), np.nan) if r.reference is None else r.reference
    t, values = r.t[kept], np.array([r.position, reference, r.torque, temperature, *r.exogenous.values()])[:, kept]
    return (t, values) if np.max(jitter(t, 1.0 / period)) < EVEN else resampled(t, values, 1.0 / period)


def _filtered(
    series: Series, recording: Recording, segment: slice, timing: LogTiming, period: float, band: Bands
) -> dict[str, np.ndarray]:
    """Motion, torque and signals of one stretch at the samples that are evaluated.

    A held torque is what its hold makes of it, a momentary one passes the filter as the position does.
    """
    t, (position, reference, torque, *signals) = series
    q, v, a = low_pass(position, period, band.motion, 2)
    if timing.between is Between.HELD:
        u = logged(*recording.logged(segment)).low_passed(t, period, band.motion, timing.acts)
    else:
        u = low_pass(torque, period, band.motion)[0]
    others = [low_pass(x, period, band.motion)[0] for x in signals]
    columns = {"t": t, "position": q, "velocity": v, "acceleration": a, "torque": u}
    if np.isfinite(reference).all():
        columns["reference"] = np.array(low_pass(reference, period, band.motion, 2))
    kept = {name: values[..., :: band.step] for name, values in columns.items()}
    kept["signals"] = np.ascontiguousarray(np.array(others)[:, :: band.step])
    return kept | {"resting": np.zeros(len(kept["t"]), bool)}


def _edge(band: Bands) -> float:
    """s, left out beside what is not known."""
    return max(EDGE_PERIODS / band.cutoff, EDGE_SECONDS)


def _pauses(times: Sequence[np.ndarray], spacing: float, edge: float) -> list[np.ndarray]:
    """Beginnings and ends (p, 2), s, of what the pauses of each stretch, sampled at `times`, leave unknown, edges included.

    What was buffered meanwhile often comes at once, with the stamps of its arrival. None where that would be too much of the
    data: pauses are usual then, and what is compared lies at frequencies that a line through the samples leaves alone.
    """
    found = []
    for t in times:
        begins = np.flatnonzero(np.diff(t) > PAUSE * spacing)
        found.append(np.stack([t[begins] - edge, t[begins + 1] + edge], axis=1))
    lost = sum(float(np.sum(np.diff(pauses, axis=1))) for pauses in found)
    few = lost < hold_out.MOST_UNKNOWN * sum(float(t[-1] - t[0]) for t in times)
    return found if few else [np.zeros((0, 2)) for _ in found]


def _within(t: np.ndarray, spans: np.ndarray) -> np.ndarray:
    """(n,) Which of the rising times t (n,) lie within one of the spans (p, 2)."""
    inside = np.zeros(len(t), bool)
    firsts, ends = np.searchsorted(t, spans[:, 0]), np.searchsorted(t, spans[:, 1], side="right")
    for first, end in zip(firsts, ends, strict=True):
        inside[first:end] = True
    return inside


def _divided(
    parts: Sequence[dict[str, np.ndarray]],
    sources: Sequence[int],
    band: Bands,
    dt: float,
    kinds: int,
    memory: float,
    pauses: Sequence[np.ndarray],
) -> tuple[Stretch, ...]:
    """Stretches with their train, held-out and untouched samples.

    sources: which recording each is from. dt: s between compared samples. kinds: how many of the last two there are. pauses:
    spans (p, 2) of each, s, that are left out.
    """
    positions = [part["position"][:: band.stride] for part in parts]
    edge = math.ceil(_edge(band) / dt)
    numbers = hold_out.blocks([len(position) for position in positions], edge)
    nothing = [np.zeros(len(block), bool) for block in numbers]
    masks = hold_out.held_out(sources, numbers) if kinds > 0 else nothing
    others = hold_out.untouched(sources, numbers) if kinds > 1 else nothing
    unknown = hold_out.unknown(positions, memory)
    stretches = []
    for part, mask, other, block, first, paused in zip(parts, masks, others, numbers, unknown, pauses, strict=True):
        known = ~part["resting"][:: band.stride] & ~_within(part["t"][:: band.stride], paused)
        train, held, apart = (some & known for some in hold_out.divided(mask, other, edge, first))
        stretches.append(Stretch(**part, train=train, held_out=held, untouched=apart, piece=block))
    return tuple(stretches)


def _check_fitted(stretches: Sequence[Stretch], source: str, cutoff: float) -> None:
    """Raise InputError where too few samples are left to be fitted."""
    fitted = sum(int(np.count_nonzero(s.train)) for s in stretches)
    if fitted >= FEWEST_FITTED:
        return
    resting = float(np.mean(np.concatenate([s.resting for s in stretches])))
    found, expected = f"the position shows motion up to {cutoff:.3g} Hz only", "a longer recording or faster changes of the speed"
    if resting > 0.0:
        found += f", the axis rests or reverses for {resting:.0%} of the time, where a friction law without memory says nothing"
        expected = "longer motions in one direction, or a friction law with memory such as lugre"
    raise InputError(
        source, f"{found}, and {fitted} samples are left to be fitted", f"{expected}, {FEWEST_FITTED} samples"
    )


def _notes(band: Bands, period: float, renewal: float, step: float, pauses: int) -> list[str]:
    """What a reader of the report should know of the data set."""
    evaluated = band.step * period
    lines = [
        f"torques compared up to {band.cutoff:.3g} Hz (position noise {band.position_noise:.2g} rms), evaluated at "
        f"{1 / evaluated:.4g} Hz, compared at {1 / (band.stride * evaluated):.4g} Hz",
        f"modes, contacts and lags above {0.5 / renewal:.4g} Hz are not named: samples are new {1 / renewal:.4g} times a second",
    ]
    if step > 0.0:
        lines.append(f"the encoder's steps of {step:.3g} show: waves within half a step are not named")
    if pauses:
        longer = f"{counted(pauses, 'pause')} of the log, longer than {PAUSE:g} usual times between samples"
        lines.append(f"nothing is compared around {longer}")
    return lines
