"""Frequency response of a plant from torque to speed, with coherence, and models fitted to it (paper Fig. 9, eq. 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import coherence, csd, welch

from tcs_friction.errors import InputError

SEGMENTS = 8  # at least so many averages


@dataclass(frozen=True, eq=False)
class Response:
    """frequency Hz, response (complex, speed per torque), coherence (0 to 1), std: relative, of the gain; each (k,)."""

    frequency: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    std: np.ndarray


@dataclass(frozen=True, eq=False)
class PlantModel:
    """parameters by name with standard deviations, the modelled response at the measured frequencies, relative rms misfit."""

    parameters: dict[str, float]
    std: dict[str, float]
    response: np.ndarray
    misfit: float


def frequency_response(
    t: np.ndarray, torque: np.ndarray, velocity: np.ndarray, lowest: float, highest: float
) -> Response:
    """Welch's H1 estimate from evenly sampled torque and speed (n,), between two frequencies (Hz).

    Raises InputError when the recording is too short to average `SEGMENTS` stretches of four periods of the lowest.
    """
    rate = 1.0 / float(np.median(np.diff(t)))
    length = int(4.0 * rate / lowest)
    if len(t) < (SEGMENTS + 1) * length // 2:
        needed = f"at least {(SEGMENTS + 1) * length / 2 / rate:.3g} s for {lowest:g} Hz"
        raise InputError("plant response", f"{len(t) / rate:.3g} s of recording", needed)
    frequency, cross = csd(torque, velocity, rate, nperseg=length)
    _, power = welch(torque, rate, nperseg=length)
    _, likeness = coherence(torque, velocity, rate, nperseg=length)
    chosen = (frequency >= lowest) & (frequency <= highest)
    likeness = np.clip(likeness[chosen], 1e-6, 1.0 - 1e-12)
    averages = 2.0 * len(t) / length - 1.0
    std = np.sqrt((1.0 - likeness) / (2.0 * averages * likeness))  # Bendat and Piersol, table 9.6
    return Response(frequency[chosen], cross[chosen] / power[chosen], likeness, std)


def second_order(s: np.ndarray, second: float, first: float, constant: float) -> np.ndarray:
    """Eq. 10: speed per torque of 1 / (second s^2 + first s + constant)."""
    return np.asarray(1.0 / (second * s**2 + first * s + constant))


def two_inertias(
    s: np.ndarray, inertia: float, viscous: float, ratio: float, frequency: float, damping: float
) -> np.ndarray:
    """Motor-side speed per torque of two inertias coupled by a spring.

    `inertia` of both (kg m^2), `ratio` the far share of it, `frequency` (Hz) and `damping` (1) of the far one on its spring
    with the near one held.
    """
    corner = 2.0 * np.pi * frequency
    coupled = (2.0 * damping * corner * s + corner**2) / (s**2 + 2.0 * damping * corner * s + corner**2)
    return np.asarray(1.0 / (inertia * (1.0 - ratio) * s + ratio * inertia * s * coupled + viscous))


def fit_second_order(measured: Response) -> PlantModel:
    """Fit eq. 10's form."""
    gain, corner = float(np.abs(measured.response[0])), 2.0 * np.pi * float(np.median(measured.frequency))
    start = np.array([1.0 / (gain * corner**2), 1.0 / (gain * corner), 1.0 / gain])
    return _fit(measured, second_order, ("second", "first", "constant"), [start])


def fit_two_inertias(measured: Response) -> PlantModel:
    """Fit two inertias with a spring between them; the search starts from several frequencies."""
    s = 2.0j * np.pi * measured.frequency[0]
    inertia = float(1.0 / np.abs(measured.response[0] * s))
    places = np.geomspace(measured.frequency[0], measured.frequency[-1], 9)[1:-1]
    starts = [np.array([inertia, 0.1 * inertia * abs(s), 0.3, place, 0.03]) for place in places]
    return _fit(measured, two_inertias, ("inertia", "viscous", "ratio", "frequency", "damping"), starts)


def _fit(
    measured: Response, model: Callable[..., np.ndarray], names: tuple[str, ...], starts: list[np.ndarray]
) -> PlantModel:
    """Least squares of the logarithm of the response, each frequency by its own uncertainty; parameters stay positive."""
    s = 2.0j * np.pi * measured.frequency
    weight = 1.0 / np.maximum(measured.std, 1e-3)

    def errors(logarithms: np.ndarray) -> np.ndarray:
        ratio = np.log(model(s, *np.exp(logarithms)) / measured.response)
        return np.concatenate([weight * ratio.real, weight * ratio.imag])

    upper = np.array([0.0 if name == "ratio" else np.inf for name in names]) - 1e-6
    fits = [
        least_squares(errors, np.minimum(np.log(start), upper - 0.1), bounds=(-np.inf, upper))
        for start in starts
    ]
    best = min(fits, key=lambda fit: fit.cost)
    values = np.exp(best.x)
    scatter = 2.0 * best.cost / max(len(best.fun) - len(values), 1)
    deviation = values * np.sqrt(scatter * np.abs(np.diag(np.linalg.pinv(best.jac.T @ best.jac))))
    modelled = model(s, *values)
    misfit = float(np.sqrt(np.mean(np.abs(modelled / measured.response - 1.0) ** 2)))
    return PlantModel(
        dict(zip(names, values.tolist(), strict=True)),
        dict(zip(names, deviation.tolist(), strict=True)),
        modelled,
        misfit,
    )
