"""Frequency response of a plant from torque to speed, with coherence, uncertainty and fitted models (paper Fig. 9, eq. 10).

In a closed loop the torque answers the very disturbances that the speed shows, and the ratio of their spectra is biased. The
reference does not, so it serves as instrument: G = S(reference, speed) / S(reference, torque).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import csd

from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Recording

SEGMENTS = 8  # at least so many averages
PERIODS = 4  # of the lowest frequency in a stretch
LEAST_COHERENCE = 0.5  # of a frequency that a model is fitted to, at least
RANGE = 1e6  # by which a parameter may differ from its first guess
CHANCE = 0.01  # probability that pure noise reaches the coherence asked for, at any frequency
SETTLE = 2.0  # s at the start of a recording


@dataclass(frozen=True, eq=False)
class Excited:
    """A stretch of evenly sampled torque, speed, and an instrument (None: the torque itself); each (n,), `rate` in Hz."""

    rate: float
    torque: np.ndarray
    velocity: np.ndarray
    instrument: np.ndarray | None = None
    source: str = "recording"


@dataclass(frozen=True, eq=False)
class Response:
    """frequency Hz, response (complex, speed per torque), coherence (0 to 1), std: relative, of the gain; each (k,).

    coherence: the lesser of speed's and torque's with the instrument. least: what it takes to be no chance.
    """

    frequency: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    std: np.ndarray
    least: float = LEAST_COHERENCE

    @property
    def sure(self) -> Response:
        """Those frequencies at which speed and excitation belong together."""
        keep = self.coherence >= self.least
        return replace(
            self,
            frequency=self.frequency[keep],
            response=self.response[keep],
            coherence=self.coherence[keep],
            std=self.std[keep],
        )

    def to_mapping(self) -> dict[str, list[float]]:
        """For `response.json`."""
        return {
            "frequency": self.frequency.tolist(),
            "gain": np.abs(self.response).tolist(),
            "phase": np.angle(self.response).tolist(),
            "coherence": self.coherence.tolist(),
            "relative_std": self.std.tolist(),
        }


@dataclass(frozen=True, eq=False)
class PlantModel:
    """parameters by name with standard deviations, misfit: rms of the model's error relative to the measured response."""

    form: str
    parameters: dict[str, float]
    std: dict[str, float]
    misfit: float

    def at(self, frequency: np.ndarray) -> np.ndarray:
        """(k,) the modelled response at frequencies in Hz."""
        return FORMS[self.form](2j * np.pi * frequency, *self.parameters.values())

    def to_mapping(self) -> dict[str, Any]:
        """For `response.json`."""
        values = {name: {"value": value, "std": self.std[name]} for name, value in self.parameters.items()}
        return {"parameters": values, "misfit": self.misfit}


def stretches(recording: Recording) -> list[Excited]:
    """The stretches of a recording that a response can come from; speed by central differences of position.

    The response is later corrected for what that does (`of_recordings`).
    """
    found = []
    for part in recording.segments:
        t = recording.t[part]
        t0, period = t[0] + SETTLE, float(np.median(np.diff(t)))
        if t[-1] - t0 < 2.0 * SETTLE:
            continue
        grid = t0 + period * np.arange(int((t[-1] - t0) / period + 1e-6) + 1)
        torque, position = (
            np.interp(grid, t, values[part]) for values in (recording.torque, recording.position)
        )
        instrument = None
        if recording.reference is not None:
            instrument = np.gradient(np.interp(grid, t, recording.reference[part]), period)[1:-1]
        velocity = (position[2:] - position[:-2]) / (2.0 * period)
        found.append(Excited(1.0 / period, torque[1:-1], velocity, instrument, recording.source))
    if not found:
        raise InputError(recording.source, "every stretch is too short", f"{3.0 * SETTLE:g} s without a gap")
    return found


def of_recordings(
    recordings: Sequence[Recording], lowest: float, highest: float, actuation_delay: float = 0.0
) -> Response:
    """The response in recordings of one axis, of what is known corrected.

    Known are the delay (s) between logged torque and its action, the torque's being held through the period that ends with
    its stamp, and the central difference that the speed is.
    """
    parts = [part for recording in recordings for part in stretches(recording)]
    raw = frequency_response(parts, lowest, highest)
    period = 1.0 / parts[0].rate
    held = np.sinc(raw.frequency * period) * np.exp(
        2j * np.pi * raw.frequency * (0.5 * period - actuation_delay)
    )
    known = np.sinc(2.0 * raw.frequency * period) * held
    return replace(raw, response=raw.response / known)


def frequency_response(parts: Sequence[Excited], lowest: float, highest: float) -> Response:
    """Welch's estimate from evenly sampled stretches, between two frequencies (Hz).

    Raises InputError when they are too short to average `SEGMENTS` times `PERIODS` periods of the lowest frequency, or when the
    highest lies beyond half the sample rate.
    """
    rate = parts[0].rate
    if not 0.0 < lowest < highest < 0.5 * rate:
        found = f"frequencies from {lowest:g} to {highest:g} Hz"
        raise InputError(
            "plant response", found, f"rising ones below half the sample rate, {0.5 * rate:g} Hz"
        )
    length = int(PERIODS * rate / lowest)
    counts = [max(0, 2 * len(part.torque) // length - 1) for part in parts]
    if sum(counts) < SEGMENTS:
        needed = f"at least {(SEGMENTS + 1) * length / 2 / rate:.3g} s for {lowest:g} Hz"
        seconds = sum(len(part.torque) for part in parts) / rate
        raise InputError("plant response", f"{seconds:.3g} s of recording", needed)
    chosen = [(part, count) for part, count in zip(parts, counts, strict=True) if count]
    frequency, spectra = _spectra(chosen, length, rate)
    keep = (frequency >= lowest) & (frequency <= highest)
    uu, vv, rr, uv, ru, rv = (values[keep] for values in spectra)
    response = rv / ru
    # what of the speed the response does not explain, seen through the instrument (Soderstrom and Stoica 1983)
    error = vv.real + np.abs(response) ** 2 * uu.real - 2.0 * (np.conj(response) * uv).real
    variance = np.maximum(error, 0.0) * rr.real / np.abs(ru) ** 2 / sum(counts)
    likeness = np.minimum(np.abs(rv) ** 2 / vv.real, np.abs(ru) ** 2 / uu.real) / rr.real
    std = np.sqrt(0.5 * variance) / np.abs(response)
    chance = 1.0 - (CHANCE / len(likeness)) ** (1.0 / (sum(counts) - 1))
    least = max(LEAST_COHERENCE, chance)
    return Response(frequency[keep], response, np.minimum(likeness, 1.0), std, least)


def _spectra(
    chosen: Sequence[tuple[Excited, int]], length: int, rate: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies and averaged spectra: torque, speed, instrument, torque-speed, instrument-torque, instrument-speed."""
    sums: list[np.ndarray] = []
    weight = 1.0 / sum(count for _, count in chosen)
    for part, count in chosen:
        r = part.torque if part.instrument is None else part.instrument
        u, v = part.torque, part.velocity
        pairs = ((u, u), (v, v), (r, r), (u, v), (r, u), (r, v))
        frequency, _ = csd(u, u, rate, nperseg=length)
        spectra = [weight * count * csd(a, b, rate, nperseg=length)[1] for a, b in pairs]
        sums = [total + one for total, one in zip(sums, spectra, strict=True)] if sums else spectra
    return frequency, sums


def second_order(
    s: np.ndarray, second: float, first: float, constant: float, delay: float = 0.0
) -> np.ndarray:
    """Eq. 10: speed per torque of 1 / (second s^2 + first s + constant), `delay` seconds late."""
    return np.asarray(np.exp(-s * delay) / (second * s**2 + first * s + constant))


def two_inertias(
    s: np.ndarray,
    inertia: float,
    viscous: float,
    inertia_ratio: float,
    frequency: float,
    damping: float,
    delay: float = 0.0,
) -> np.ndarray:
    """Near-side speed per torque of two inertias coupled by a spring, parameters as of the effect `flexible_mode`.

    `inertia` of both (kg m^2), `inertia_ratio` the far share of it, `frequency` (Hz) and `damping` (1) of the resonance;
    `viscous` friction (N m s/rad) on the near side.
    """
    lower = np.sqrt(1.0 - inertia_ratio)
    corner, ratio = 2.0 * np.pi * frequency * lower, damping * lower
    coupled = (2.0 * ratio * corner * s + corner**2) / (s**2 + 2.0 * ratio * corner * s + corner**2)
    near, far = inertia * (1.0 - inertia_ratio) * s, inertia * inertia_ratio * s * coupled
    return np.asarray(np.exp(-s * delay) / (near + far + viscous))


SECOND_ORDER, TWO_INERTIAS = "second_order", "two_inertias"
FORMS: dict[str, Callable[..., np.ndarray]] = {SECOND_ORDER: second_order, TWO_INERTIAS: two_inertias}


def fit_second_order(measured: Response) -> PlantModel:
    """Fit eq. 10's form."""
    measured = _enough(measured, 4)
    gain, corner = float(np.abs(measured.response[0])), 2.0 * np.pi * float(np.median(measured.frequency))
    start = {"second": 1.0 / (gain * corner**2), "first": 1.0 / (gain * corner), "constant": 1.0 / gain}
    return _fit(measured, SECOND_ORDER, [start])


def fit_two_inertias(measured: Response) -> PlantModel:
    """Fit two inertias with a spring between them; the search starts from several frequencies."""
    measured = _enough(measured, 6)
    s = 2.0 * np.pi * float(measured.frequency[0])
    inertia = float(1.0 / np.abs(measured.response[0] * s))
    places = np.geomspace(measured.frequency[0], measured.frequency[-1], 12)[2:]
    common = {"inertia": inertia, "viscous": 0.1 * inertia * s, "inertia_ratio": 0.3}
    starts = [{**common, "frequency": float(place), "damping": 0.03} for place in places]
    return _fit(measured, TWO_INERTIAS, starts)


def _enough(measured: Response, parameters: int) -> Response:
    sure = measured.sure
    if len(sure.frequency) <= parameters:
        found = f"coherence above {measured.least:.2g} at {len(sure.frequency)} of {len(measured.frequency)} frequencies"
        raise InputError("plant response", found, f"at more than {parameters}: more excitation or less noise")
    return sure


def _fit(measured: Response, form: str, starts: Sequence[dict[str, float]]) -> PlantModel:
    """Least squares of the logarithm of the response, each frequency by its own uncertainty.

    Parameters but the delay stay positive; one that the response does not show is given as 0. The delay (ms in the search)
    is that left beside the known one.
    """
    names = tuple(starts[0])
    s = 2.0j * np.pi * measured.frequency
    weight = 1.0 / np.maximum(measured.std, 1e-3)

    def values(unknowns: np.ndarray) -> np.ndarray:
        return np.append(np.exp(unknowns[:-1]), 1e-3 * unknowns[-1])

    def errors(unknowns: np.ndarray) -> np.ndarray:
        ratio = np.log(FORMS[form](s, *values(unknowns)) / measured.response)
        return np.concatenate([weight * ratio.real, weight * ratio.imag])

    guess = np.log(list(starts[0].values()))
    shares = np.array([name in ("inertia_ratio", "damping") for name in names])
    upper = np.append(np.where(shares, -1e-6, guess + np.log(RANGE)), 1e3)
    lower = np.append(guess - np.log(RANGE), -1e3)
    begins = [np.append(np.log(list(start.values())), 0.0) for start in starts]
    fits = [
        least_squares(errors, np.clip(begin, lower + 0.1, upper - 0.1), bounds=(lower, upper))
        for begin in begins
    ]
    best = min(fits, key=lambda fit: fit.cost)
    found = values(best.x)
    felt = np.linalg.norm(
        best.jac[:, :-1], axis=0
    )  # standard deviations that a factor e of a parameter makes
    found[:-1][felt < 1.0] = 0.0
    scatter = 2.0 * best.cost / max(len(best.fun) - len(found), 1)
    spread = np.sqrt(scatter * np.abs(np.diag(np.linalg.pinv(best.jac.T @ best.jac))))
    deviation = np.append(found[:-1], 1e-3) * spread
    misfit = float(np.sqrt(np.mean(np.abs(FORMS[form](s, *found) / measured.response - 1.0) ** 2)))
    every = (*names, "delay")
    return PlantModel(
        form,
        dict(zip(every, found.tolist(), strict=True)),
        dict(zip(every, deviation.tolist(), strict=True)),
        misfit,
    )
