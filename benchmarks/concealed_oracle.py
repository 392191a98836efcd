"""The best that anyone could do: a matched filter that knows an effect's exact shape and only asks whether it is there.

It knows the noise as well (torque noise and what the encoder adds through the second derivative). The model's own parameters
it does not know: what retuning them explains is taken out of the shape first, as no method could tell it from the effect.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import norm

from benchmarks.concealed_baselines import torque_residual, variants
from benchmarks.concealed_physics import PERIOD, Encoder
from benchmarks.worlds import SMOOTHING, World
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Column

FALSE_ALARMS = 0.02
HIGHEST = 60.0  # Hz, above which nothing is left of any shape


def detection_limit(world: World, axis: Axis) -> float:
    """Torque rms (N m) at which the world's only effect would be seen in half of all recordings.

    `axis` has the true parameters of the believed law: around it the shape is freed from what retuning explains.
    """
    shape = whitened(world.effect_torque, world)
    now = torque_residual(axis, world.recording)
    base = np.stack(
        [whitened(torque_residual(other, world.recording) - now, world) for other in variants(axis)], axis=1
    )
    base /= np.maximum(np.linalg.norm(base, axis=0), 1e-300)
    own = shape - base @ np.linalg.lstsq(base, shape, rcond=1e-10)[0]
    distance = float(np.linalg.norm(own))  # in standard deviations of the filter's output
    return world.truth.effect_torque_rms * float(norm.isf(FALSE_ALARMS)) / distance


def whitened(x: Column, world: World) -> Column:
    """A torque (n,) through the filter that makes the world's noise white with variance one."""
    frequency = np.fft.rfftfreq(len(x), PERIOD)
    corner = 10.0
    torque = world.truth.noise_floor**2 * 2.0 / (math.pi * corner) / (1.0 + (frequency / corner) ** 2)
    step = math.radians(0.01 / 3600.0) ** 2 + Encoder().resolution ** 2 / 12.0
    encoder = (world.truth.inertia * (2.0 * math.pi * frequency) ** 2) ** 2 * step * 2.0 * PERIOD
    smoothing = np.exp(-((2.0 * math.pi * frequency * SMOOTHING) ** 2))
    density = (torque + encoder) * smoothing
    gain = np.where(frequency <= HIGHEST, np.sqrt(2.0 * PERIOD / density), 0.0)
    return np.asarray(np.fft.irfft(np.fft.rfft(x) * gain, len(x)))
