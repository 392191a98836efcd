"""An axis of some size as an engineer would build it, and the sensor and drive that go with it, for `scale_worlds`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.scale_physics import NAMES, Array

# Inertia, top speed and time to reach it: a small motor, a gimbal, a robot joint, a radar antenna, a large telescope.
_ROTARY = np.array([[-5.0, -2.0, 0.0, 3.0, 6.0], [150.0, 20.0, 3.0, 0.5, 0.04], [0.04, 0.1, 0.25, 0.6, 2.0]])
# Mass in the same way: a small stage, a gantry axis, a ball screw's table, the column of a large machine.
_LINEAR = np.array([[-0.3, 1.0, 2.0, 3.3], [0.4, 0.6, 0.5, 0.3], [0.03, 0.08, 0.15, 0.4]])
_RATES = (5000.0, 2000.0, 1000.0, 500.0, 250.0, 200.0, 100.0, 50.0)
_RAMPS = 250.0  # ramps to top speed in a recording: at least ten cycles of the slowest kind of motion
_FASTEST_BRISTLE = 6.0  # rad a sample: a faster bristle passes unseen between two samples


@dataclass(frozen=True)
class Axis:
    """An axis and its electronics.

    Attributes
    ----------
    parameters : ndarray, shape (8,)
        In the order of `NAMES`.
    believed : dict
        What a data sheet says.
    rate : float
        Of the log [Hz]; `samples` are taken.
    top_speed, ramp : float
        Usual largest speed [rad/s or m/s], and the time in which it is reached [s].
    presliding : float
        Deflection at which the bristles slip [rad or m].
    bristle_rate : float
        Natural frequency of the axis on its bristles [rad/s].
    encoder_noise, encoder_step : float
        Standard deviation before rounding, and the step that is rounded to.
    noise_level : float
        Standard deviation of the drive's torque noise [N m or N].
    """

    parameters: Array
    believed: dict[str, float]
    rate: float
    samples: int
    top_speed: float
    ramp: float
    presliding: float
    bristle_rate: float
    encoder_noise: float
    encoder_step: float
    noise_level: float

    @property
    def scales(self) -> Array:
        """Scales of position and velocity for the integrator."""
        return np.array([self.presliding, self.parameters[2]])

    @property
    def coast(self) -> float:
        """Time in which the axis comes to rest by itself from its top speed [s]."""
        p = self.parameters
        return float(p[6] / p[5] * np.log1p(p[5] * self.top_speed / p[0]))

    def velocity_bandwidth(self, control_rate: float) -> float:
        """Crossover of the velocity loop [rad/s].

        A thirtieth of the control rate leaves phase for the hold and the filter. A step of the encoder may change the torque by
        no more than a fifth of the friction; through a filter at five times the crossover w it changes by 5 J w^2 times the step.
        """
        visible = self.encoder_step + 2.0 * self.encoder_noise
        quiet = np.sqrt(0.04 * self.parameters[0] / (self.parameters[6] * visible))
        return float(min(2.0 * np.pi * control_rate / 30.0, quiet))


def draw_axis(stratum: dict[str, Any], rng: np.random.Generator) -> Axis:
    """An axis of the stratum's `kind`, `size` (0 smallest, 1 largest), `encoder` and `offset`, for its `motion`."""
    size = float(stratum["size"])
    if stratum["kind"] == "rotary":
        table, mass, step = _ROTARY, -5.0 + 11.0 * size, 7.0 * size
    else:
        table, mass, step = _LINEAR, np.log10(0.5) + np.log10(4000.0) * size, 0.5 + 4.5 * size
    rate = _RATES[int(np.clip(round(step + rng.uniform(-1.3, 1.3)), 0, len(_RATES) - 1))]
    speed = 10.0 ** (np.interp(mass, table[0], np.log10(table[1])) + rng.uniform(-0.3, 0.3))
    ramp = 10.0 ** (np.interp(mass, table[0], np.log10(table[2])) + rng.uniform(-0.2, 0.2))
    samples = 10.0 ** rng.uniform(3.74, 4.6) if rng.uniform() < 0.92 else rng.uniform(4e4, 6e4)
    samples = round(float(np.clip(_RAMPS * ramp * rate, samples, 4e4 if samples < 4e4 else 6e4)))
    ramp = float(np.clip(ramp, 22.0 / rate, samples / _RAMPS / rate))
    inertia = 10.0**mass
    # Without a controller a weak drive only sticks.
    weakest = 2.0 if stratum["motion"].startswith("open_") else 0.25
    coulomb = inertia * speed / ramp / 10.0 ** rng.uniform(np.log10(weakest), 1.0)
    presliding = speed * ramp * 10.0 ** rng.uniform(-4.8, -2.5)
    presliding = max(presliding, coulomb / inertia / (_FASTEST_BRISTLE * rate) ** 2)
    stiffness = coulomb / presliding
    bristle_rate = np.sqrt(stiffness / inertia)
    parameters = np.array(
        [
            coulomb,
            coulomb * rng.uniform(1.15, 1.7),
            max(speed / 10.0 ** rng.uniform(np.log10(8.0), np.log10(40.0)), presliding * bristle_rate),
            stiffness,
            2.0 * 10.0 ** rng.uniform(np.log10(0.2), 0.0) * np.sqrt(stiffness * inertia),
            coulomb / speed * 10.0 ** rng.uniform(np.log10(0.05), 0.0),
            inertia,
            coulomb * rng.uniform(0.01, 0.1) * rng.choice([-1.0, 1.0]) if stratum["offset"] else 0.0,
        ]
    )
    noise, step = _encoder(stratum["encoder"], presliding, rng)
    level = coulomb * 10.0 ** rng.uniform(np.log10(0.002), np.log10(0.02))
    return Axis(
        parameters,
        _believed(parameters, rng),
        rate,
        samples,
        float(speed),
        ramp,
        float(presliding),
        float(bristle_rate),
        noise,
        step,
        float(level),
    )


def _believed(parameters: Array, rng: np.random.Generator) -> dict[str, float]:
    off = dict(
        zip(NAMES[:-1], (parameters[:-1] * rng.uniform(0.8, 1.2, len(NAMES) - 1)).tolist(), strict=True)
    )
    return off | {"static": max(off["static"], off["coulomb"])}


def _encoder(grade: str, presliding: float, rng: np.random.Generator) -> tuple[float, float]:
    """Noise before rounding, and the step that is rounded to."""
    if grade == "fine":
        noise = presliding * 10.0 ** rng.uniform(-3.3, -2.3)
        return float(noise), float(noise * rng.choice([0.0, 1.0, 2.0]))
    fewest, most, share = {
        "medium": (40.0, 200.0, 0.5),
        "coarse": (8.0, 30.0, 0.3),
        "one_step": (0.8, 1.5, 0.0),
    }[grade]
    step = presliding / 10.0 ** rng.uniform(np.log10(fewest), np.log10(most))
    return float(step * rng.uniform(0.0, share)), float(step)
