"""Data sets with a given motion, coloured torque noise and a concealed torque: fast, without a simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import signal

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, least_squares, settle, under
from tcs_friction.diagnose.fit.noise import NoiseModel, white_noise
from tcs_friction.diagnose.fit.noise_estimate import with_spectrum
from tcs_friction.diagnose.fit.parameters import free_parameters
from tcs_friction.diagnose.search.stepwise import Selection, select_effects
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance

DT = 0.01  # s
NOISE = 0.3  # N m rms


class Motion(NamedTuple):
    """Time, position and velocity, (n,) each."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray


Torque = Callable[[Motion], np.ndarray]  # opposing, N m, (n,)


def axis() -> Axis:
    friction = instance(law("coulomb_viscous"), {"coulomb": 60.0, "viscous": 500.0})
    return Axis("azimuth", 900.0, friction)


def coloured(rng: np.random.Generator, count: int) -> np.ndarray:
    """Torque noise (count,) of a first-order corner at 10 Hz, NOISE rms."""
    decay = np.exp(-2.0 * np.pi * 10.0 * DT)
    white = rng.standard_normal(count)
    return NOISE * signal.lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], white)


def conditioned(
    rng: np.random.Generator,
    torque: Torque | None = None,
    seconds: float = 300.0,
    speed: float | None = None,
) -> DataSet:
    """An axis that sweeps at several speeds, with noise and a concealed opposing torque; every fourth block held out.

    speed: rad/s, at which it goes to and fro instead, for 5 s each way, every third time at a fiftieth of it.
    """
    t = np.arange(0.0, seconds, DT)
    velocity = 0.15 * np.sin(2 * np.pi * t / 83.0) + 0.06 * np.sin(2 * np.pi * t / 19.0) + 1e-9
    if speed is not None:
        speeds = np.where(t // 10.0 % 3.0 == 2.0, 0.02 * speed, speed)
        velocity = speeds * np.clip(10.0 * signal.sawtooth(2.0 * np.pi * t / 10.0, 0.5), -1.0, 1.0)
    position = np.cumsum(velocity) * DT
    acceleration = np.gradient(velocity, DT)
    model = axis()
    required = model.inertia * acceleration + 60.0 * np.sign(velocity) + 500.0 * velocity
    hidden = np.zeros(len(t)) if torque is None else torque(Motion(t, position, velocity))
    block = np.arange(len(t)) * 16 // len(t)
    held_out = block % 4 == 2
    wind = 2.0 * signal.lfilter([np.sqrt(1.0 - 0.99**2)], [1.0, -0.99], rng.standard_normal(len(t)))
    stretch = Stretch(
        t=t,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        torque=required + hidden + coloured(rng, len(t)),
        signals=np.stack([15.0 + 5.0 * (1.0 - np.exp(-t / 100.0)), wind]),
        resting=np.zeros(len(t), bool),
        train=~held_out & (t > 0.5),  # it starts at rest
        held_out=held_out,
        untouched=np.zeros(len(t), bool),
        piece=block,
    )
    return DataSet(
        stretches=(stretch,),
        period=DT,
        dt=DT,
        stride=1,
        cutoff=0.45 / DT,
        velocity_noise=1e-6,
        position_noise=1e-8,
        position_step=0.0,
        names=("wind_speed",),
        temperature=True,
        notes=(),
    )


def settled(data: DataSet) -> tuple[TorqueBalance, Fit]:
    """The balance, and the believed axis refitted with the noise spectrum that it leaves."""
    balance = TorqueBalance(data)
    noise = white_noise(balance.samples)
    noise = with_spectrum(balance, noise, balance.residual(axis(), noise))
    free = free_parameters(axis())
    fit = least_squares(balance, axis(), free, noise, np.full(len(free), np.inf))
    return balance, under(balance, fit, with_spectrum(balance, noise, balance.residual(fit.axis, noise)))


def unfitted(balance: TorqueBalance, model: Axis, noise: NoiseModel, variance: float = 1.0) -> Fit:
    """An axis as it is, as if it had been fitted, with this variance of every number."""
    free = tuple(balance.free(model))
    return Fit(model, free, variance * np.eye(len(free)), balance.squares(model, noise), Outcome.CONVERGED)


def selected(balance: TorqueBalance, excluded: frozenset[str] = frozenset()) -> Selection:
    """The effects that the search adds to the believed axis, some excluded."""
    retuned = settle(balance, axis(), white_noise(balance.samples))
    return select_effects(balance, retuned, retuned, axis(), excluded, enough=lambda *_: False, progress=lambda *_: None)
