"""What a fit looks at: motion and torque on regular time steps, from recordings or from friction estimates.

Velocity and acceleration come from the position by a zero-phase low pass and central differences; torque passes the same low
pass. The pass band ends where the position's own noise begins, so that the acceleration does not drown in it.

A diagnosis smooths in the frequency domain, with the same attenuation (conditioning.filters). An identification needs a
filter that runs from sample to sample: its search passes the torque of every candidate through the same sections as the measured
one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import butter, welch

from tcs_friction.conditioning.filters import low_pass
from tcs_friction.conditioning.hold import Between, LoggedTorque, logged
from tcs_friction.conditioning.sampling import even, resampled
from tcs_friction.conditioning.white_noise import derivative_noise
from tcs_friction.errors import InputError
from tcs_friction.numerics.integral import travelled
from tcs_friction.recording.recording import Recording

HIGHEST_SHARE = 0.1  # of the sample rate, at most, for the pass band
LARGEST_SHARE = 0.4  # the same, for one that somebody asks for
LEAST_SAMPLES = 32  # of a segment that is worth filtering
SAMPLES_PER_CYCLE = (
    32.0  # of the bandwidth: as many as a bristle's step needs between which velocity runs linearly
)
UNSURE = 0.02  # of the range of positions: travel after a start within which a bristle may remember what nobody saw
SPIKE_WINDOW = 9  # samples
SPIKE = 8.0  # robust standard deviations
FILTER_ORDER = 4
EDGE = 1.5  # cycles of the low pass' bandwidth over which it mixes what is apart


@dataclass(frozen=True, eq=False)
class FrictionSeries:
    """Friction estimates against time, as a disturbance observer gives them. Each array (n,).

    t in s, strictly increasing; velocity in rad/s; friction in N m, positive against positive motion. `delay` is by how much the
    friction lags behind the velocity, s; it is taken out. `bandwidth` is that of the observer's filter Q, Hz, a third-order
    Butterworth low pass (control.dob): the modelled friction is passed through it too, its lag need not be counted in `delay`.
    """

    t: np.ndarray
    velocity: np.ndarray
    friction: np.ndarray
    delay: float = 0.0
    bandwidth: float = 0.0
    source: str = "friction estimate"

    def __post_init__(self) -> None:
        for name in ("t", "velocity", "friction"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or len(values) != len(self.t):
                raise InputError(self.source, f"{name} has shape {values.shape}", f"({len(self.t)},) like t")
            if not np.isfinite(values).all():
                raise InputError(
                    self.source,
                    f"{name}[{int(np.argmin(np.isfinite(values)))}] is not finite",
                    "finite samples",
                )
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if len(self.t) < LEAST_SAMPLES:
            raise InputError(self.source, f"{len(self.t)} samples", f"at least {LEAST_SAMPLES}")
        if not (np.diff(self.t) > 0.0).all():
            raise InputError(
                self.source,
                f"t must strictly increase; t[{int(np.argmin(np.diff(self.t) > 0.0)) + 1}] does not",
            )
        if not 0.0 <= self.delay < self.t[-1] - self.t[0]:
            raise InputError(self.source, f"delay is {self.delay!r}", "from 0 to the series' duration, s")
        if not 0.0 <= self.bandwidth < 0.5 / float(np.median(np.diff(self.t))):
            raise InputError(
                self.source,
                f"bandwidth is {self.bandwidth!r}",
                "from 0 (no filter) to half the sample rate, Hz",
            )

    @property
    def lag(self) -> float:
        """s by which the friction lags behind the velocity at low frequency, the filter's lag included."""
        return self.delay + (1.0 / (np.pi * self.bandwidth) if self.bandwidth > 0.0 else 0.0)


Data = Recording | FrictionSeries


@dataclass(frozen=True)
class Timing:
    """When a logged torque begins to act, s after its stamp, and what it does between (see `conditioning.hold`)."""

    acts: float
    between: Between = Between.HELD


@dataclass(frozen=True, eq=False)
class Grid:
    """One stretch: columns on even steps (t, position, temperature if recorded, exogenous signals), and as it was recorded.

    source: which recording it is from. t (m,) s and position (m,) rad as recorded; logged: the torque.
    """

    source: int
    columns: Mapping[str, np.ndarray]
    t: np.ndarray
    position: np.ndarray
    logged: LoggedTorque

    def window(self, first: int, last: int) -> Grid:
        """The even samples from `first` up to `last`, and what was recorded in their time; the torque is that of all."""
        columns = {name: values[first:last] for name, values in self.columns.items()}
        inside = slice(*np.searchsorted(self.t, [columns["t"][0] - 1e-9, columns["t"][-1] + 1e-9]).tolist())
        return replace(self, columns=columns, t=self.t[inside], position=self.position[inside])


@dataclass(frozen=True, eq=False)
class Motion:
    """Regularly sampled motion and torque of one or several stretches, one after the other.

    t, position, velocity, acceleration, torque: (n,). bounds: (s + 1,) where each stretch starts, and n.
    temperature (n,) and exogenous name -> (n,) as recorded. rate: samples/s. bandwidth: Hz, of the low pass (0: none).
    velocity_noise: rad/s, standard deviation of the velocity's error. measured: torque is friction itself (no inertia in it).
    """

    t: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    bounds: np.ndarray
    rate: float
    bandwidth: float
    velocity_noise: float
    measured: bool
    temperature: np.ndarray | None = None
    exogenous: Mapping[str, np.ndarray] = field(default_factory=dict)
    sources: tuple[int, ...] = ()  # which recording each stretch is from
    notes: tuple[str, ...] = ()
    filtered: float = 0.0  # Hz, of the observer's filter that the torque has passed, its lag at low frequency taken out; 0: none
    density: float = 0.0  # rad^2/Hz, one-sided, of the position's noise
    grids: tuple[Grid, ...] = ()  # what the stretches were made of; none where that is not known
    timing: Timing = Timing(0.0)  # with which the torque was taken from the log

    def __len__(self) -> int:
        return len(self.t)

    @property
    def travel(self) -> np.ndarray:
        """(n,) rad moved since the sample before, zero where a stretch starts."""
        moved = np.zeros(len(self))
        moved[1:] = 0.5 * (self.velocity[1:] + self.velocity[:-1]) * np.diff(self.t)
        moved[self.bounds[:-1]] = 0.0
        return moved

    @property
    def stretches(self) -> list[slice]:
        """The stretches without a gap."""
        return [slice(int(a), int(b)) for a, b in zip(self.bounds[:-1], self.bounds[1:], strict=True)]

    @property
    def resolution(self) -> float:
        """rad/s below which the direction of motion is not known."""
        return max(3.0 * self.velocity_noise, 1e-4 * float(np.abs(self.velocity).max(initial=0.0)), 1e-12)

    @property
    def reverses(self) -> bool:
        """Whether the axis moves both ways."""
        return bool((self.velocity > self.resolution).any() and (self.velocity < -self.resolution).any())


def prepare(
    data: Sequence[Data], bandwidth: float | None = None, despike: bool = False, timing: Timing | None = None
) -> Motion:
    """Smooth the recordings, or take the friction series as they are, into one Motion.

    Parameters
    ----------
    data: recordings or friction series, not mixed.
    bandwidth: of the low pass, Hz; chosen from the position's noise when None.
    despike: replace single wild torque samples of recordings before the low pass spreads them.
    timing: of the logged torque; None: its values act at their stamps, in the middle of the period that they are held.

    Raises InputError when there is nothing long enough to filter.
    """
    if not data:
        raise InputError("identification", "no recordings", "at least one")
    series = [item for item in data if isinstance(item, FrictionSeries)]
    recordings = [item for item in data if isinstance(item, Recording)]
    if series and recordings:
        raise InputError("identification", "recordings and friction series together", "one kind of data")
    return _from_series(series) if series else _from_recordings(recordings, bandwidth, despike, timing)


def _from_series(series: Sequence[FrictionSeries]) -> Motion:
    parts = []
    for item in series:
        friction = np.interp(item.t + item.lag, item.t, item.friction)
        kept = item.t <= item.t[-1] - item.lag
        t, velocity = item.t[kept], item.velocity[kept]
        position = travelled(t, velocity)
        parts.append((t, position, velocity, np.zeros(len(t)), friction[kept]))
    t, position, velocity, acceleration, friction = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    bounds = np.concatenate([[0], np.cumsum([len(part[0]) for part in parts])]).astype(np.int64)
    rate = 1.0 / float(np.median(np.concatenate([np.diff(part[0]) for part in parts])))
    noise = float(np.median([_roughness(part[2]) for part in parts]))
    if len({item.bandwidth for item in series}) > 1:
        found, expected = (
            f"filter bandwidth {series[-1].bandwidth:g} Hz",
            f"{series[0].bandwidth:g} Hz as before",
        )
        raise InputError(series[-1].source, found, expected)
    return Motion(
        t, position, velocity, acceleration, friction, bounds, rate, 0.0, noise, True,
        sources=tuple(range(len(parts))), filtered=series[0].bandwidth,
    )  # fmt: skip


def _roughness(values: np.ndarray) -> float:
    """Standard deviation of white noise on a smooth signal, from third differences (robust)."""
    differences = np.diff(values, 3)
    return float(np.median(np.abs(differences)) / 0.6745 / np.sqrt(20.0)) if len(differences) else 0.0


def _from_recordings(
    recordings: Sequence[Recording], bandwidth: float | None, despike: bool, timing: Timing | None
) -> Motion:
    steps = np.concatenate([np.diff(item.t[part]) for item in recordings for part in item.segments])
    rate = 1.0 / float(np.median(steps))
    grids = [_grid(k, item, part, rate) for k, item in enumerate(recordings) for part in item.segments]
    grids = [grid for grid in grids if len(grid.columns["t"]) >= LEAST_SAMPLES]
    if not grids:
        raise InputError(
            recordings[0].source, "every stretch is too short", f"{LEAST_SAMPLES} samples without a gap"
        )
    notes = []
    if despike:
        cleaned = [without_spikes(grid.logged.values) for grid in grids]
        grids = [
            replace(grid, logged=replace(grid.logged, values=values))
            for grid, (values, _) in zip(grids, cleaned, strict=True)
        ]
        notes.append(
            f"torque: {sum(count for _, count in cleaned)} wild samples replaced by their neighbours' median"
        )
    density = float(np.median([noise_density(grid.columns["position"], rate) for grid in grids]))
    chosen = bandwidth or min(useful_bandwidth(grid.columns["position"], rate, density) for grid in grids)
    chosen = min(chosen, LARGEST_SHARE * rate)
    notes.append(f"velocity and acceleration: from position, zero-phase low pass at {chosen:.4g} Hz")
    timing = timing or Timing(-0.5 * grids[0].logged.period)
    return _smoothed(grids, rate, chosen, density, tuple(notes), timing)


def _smoothed(
    grids: Sequence[Grid], rate: float, bandwidth: float, density: float, notes: tuple[str, ...], timing: Timing
) -> Motion:
    """The motion behind a low pass at that bandwidth (Hz)."""
    parts = [smooth(grid, rate, bandwidth, timing) for grid in grids]
    joined = {name: np.concatenate([columns[name] for columns in parts]) for name in parts[0]}
    bounds = np.concatenate([[0], np.cumsum([len(columns["t"]) for columns in parts])]).astype(np.int64)
    noise = derivative_noise(density, bandwidth, 1)
    known = ("t", "position", "velocity", "acceleration", "torque", "temperature")
    exogenous = {name: values for name, values in joined.items() if name not in known}
    return Motion(
        joined["t"], joined["position"], joined["velocity"], joined["acceleration"], joined["torque"],
        bounds, rate, bandwidth, noise, False, joined.get("temperature"), MappingProxyType(exogenous),
        tuple(grid.source for grid in grids), notes, density=density, grids=tuple(grids), timing=timing,
    )  # fmt: skip


def resmoothed(motion: Motion, bandwidth: float) -> Motion:
    """The same recordings behind another low pass, Hz, at most what their rate allows. Its grids must be known."""
    band = min(bandwidth, LARGEST_SHARE * motion.rate)
    return _smoothed(motion.grids, motion.rate, band, motion.density, motion.notes, motion.timing)


def timed(motion: Motion, timing: Timing) -> Motion:
    """The same recordings with another timing of the torque. Its grids must be known."""
    return _smoothed(motion.grids, motion.rate, motion.bandwidth, motion.density, motion.notes, timing)


def _grid(source: int, recording: Recording, part: slice, rate: float) -> Grid:
    """One stretch's signals on a regular grid of that rate; interpolated only if its own steps are uneven or others."""
    t, position = recording.t[part], recording.position[part]
    columns = {"position": position}
    if recording.temperature is not None:
        columns["temperature"] = recording.temperature[part]
    columns.update({name: values[part] for name, values in recording.exogenous.items()})
    torque = logged(*recording.logged(part))
    if even(t, rate):
        return Grid(source, {"t": t, **columns}, t, position, torque)
    steps, series = resampled(t, np.array(list(columns.values())), rate)
    smooth_position = CubicSpline(t, position)(steps)
    return Grid(
        source, {"t": steps, **dict(zip(columns, series, strict=True)), "position": smooth_position}, t, position, torque
    )


def noise_density(position: np.ndarray, rate: float) -> float:
    """One-sided density of the position's noise, rad^2/Hz, from the uppermost frequencies, where an axis does not move."""
    frequency, density = _spectrum(position, rate)
    top = frequency > 0.35 * rate
    return (
        float(np.median(density[top]) / 0.7) if top.any() else 0.0
    )  # median of an exponential variate over few averages


def _spectrum(position: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    length = min(len(position), max(256, int(2.0 * rate)))
    frequency, density = welch(position, rate, window="blackmanharris", nperseg=length, detrend="linear")
    return frequency, density


def useful_bandwidth(position: np.ndarray, rate: float, noise: float) -> float:
    """Frequency (Hz) up to which the position rises above its noise density, within sensible limits."""
    frequency, density = _spectrum(position, rate)
    smoothed = np.convolve(density, np.full(5, 0.2), mode="same")
    below = np.flatnonzero(smoothed < 4.0 * noise)
    highest = HIGHEST_SHARE * rate
    found = frequency[below[0]] if len(below) else highest
    return float(np.clip(found, min(8.0 * rate / len(position), highest), highest))


def sections(bandwidth: float, rate: float) -> np.ndarray:
    """Second-order sections of the same low pass from sample to sample; they are run forwards and backwards."""
    return np.asarray(butter(FILTER_ORDER, bandwidth, fs=rate, output="sos"))


def without_spikes(values: np.ndarray) -> tuple[np.ndarray, int]:
    """Samples far off the median of their neighbours replaced by it (Hampel 1974), and how many there were."""
    middle = median_filter(values, SPIKE_WINDOW, mode="nearest")
    off = np.abs(values - middle)
    limit = SPIKE * max(float(np.median(off)), 1e-3 * float(np.std(values)), 1e-300) / 0.6745
    spikes = off > limit
    return np.where(spikes, middle, values), int(np.count_nonzero(spikes))


def smooth(grid: Grid, rate: float, bandwidth: float, timing: Timing) -> dict[str, np.ndarray]:
    """Zero-phase low pass of every signal, with exact derivatives of the position; filtered ends are left out.

    The torque is what the hold makes of it.
    """
    dt, t = 1.0 / rate, grid.columns["t"]
    edge = min(int(EDGE * rate / bandwidth), len(t) // 4)
    result = {"t": t}
    for name, values in grid.columns.items():
        if name not in ("t", "position"):
            result[name] = values if name == "temperature" else low_pass(values, dt, bandwidth)[0]
    motion = low_pass(grid.columns["position"], dt, bandwidth, 2)
    result |= dict(zip(("position", "velocity", "acceleration"), motion, strict=True))
    result["torque"] = grid.logged.drawn(timing.between).low_passed(t, dt, bandwidth, timing.acts)
    return {name: np.ascontiguousarray(values[edge : len(t) - edge]) for name, values in result.items()}


def coarse(motion: Motion, stride: int) -> tuple[np.ndarray, Motion]:
    """Every stride-th sample of each stretch: their indices, and the motion of them alone."""
    kept = [np.arange(part.start, part.stop, stride) for part in motion.stretches]
    chosen = selected(motion, kept, motion.sources)
    return np.concatenate(kept), replace(chosen, rate=motion.rate / stride, grids=())


def windows(motion: Motion, samples: int, length: int) -> Motion:
    """The same motion or, where it has more samples, windows of that length spread over it, about so many samples."""
    if len(motion) <= samples:
        return motion
    apart = max(length, round(len(motion) / max(1, samples // length)))
    grids = [
        grid.window(first, min(first + length, len(grid.columns["t"])))
        for grid in motion.grids
        for first in range(0, len(grid.columns["t"]), apart)
    ]
    kept = [grid for grid in grids if len(grid.columns["t"]) >= LEAST_SAMPLES]
    return _smoothed(kept, motion.rate, motion.bandwidth, motion.density, motion.notes, motion.timing)


def selected(motion: Motion, kept: Sequence[np.ndarray], sources: tuple[int, ...]) -> Motion:
    """The motion of some samples alone: indices of each of its stretches, and which recording that is from."""
    index = np.concatenate(kept)
    columns = {
        name: getattr(motion, name)[index] for name in ("t", "position", "velocity", "acceleration", "torque")
    }
    return replace(
        motion,
        **columns,
        bounds=np.cumsum([0, *(len(k) for k in kept)], dtype=np.int64),
        temperature=None if motion.temperature is None else motion.temperature[index],
        exogenous={name: values[index] for name, values in motion.exogenous.items()},
        sources=sources,
        grids=(),
    )


def unsure_start(motion: Motion) -> np.ndarray:
    """(n,) True in the beginning of each stretch, where the state of the friction depends on what was before."""
    reached = np.cumsum(np.abs(motion.travel))
    limit = UNSURE * np.ptp(motion.position)
    result = np.zeros(len(motion), dtype=bool)
    for part in motion.stretches:
        first = slice(part.start, part.start + (part.stop - part.start) // 5)
        result[first] = reached[first] - reached[part.start] < limit
    return result


def at_rest(motion: Motion) -> np.ndarray:
    """(n,) True where the direction of motion is not known, or so near that the low pass mixes it with torque at rest."""
    result = np.abs(motion.velocity) < motion.resolution
    band = max(motion.bandwidth, motion.filtered)
    reach = int(EDGE * motion.rate / band) if band > 0.0 else 0
    for part in motion.stretches:
        result[part] = maximum_filter1d(result[part], 2 * reach + 1)
    return result
