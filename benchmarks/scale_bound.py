"""How well a recording of `scale_worlds` can tell its parameters at best: the Cramer-Rao bound.

A Kalman filter of position, velocity, bristle and drive noise, linearised along the true motion, splits the readings into
innovations of known variance; the derivatives of the innovations after the parameters give the Fisher information (Schweppe,
Uncertain Dynamic Systems, 1973, chapter 14). Torque noise that moves the axis is noise there, and the axis answering it is no
information beyond what the readings show of it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.scale_motion import smooth
from benchmarks.scale_physics import NAMES, Array, next_step, step
from benchmarks.scale_worlds import ScaleWorld

BOUNDED = (*NAMES, "acts")
_TOLERANCE = 1e-6  # of a step
_AROUND = 5.0  # log periods over which the torque's walk is as strong
_STEP = 1e-6  # of a parameter, for its derivative: half of the digits that a step has


def bound(world: ScaleWorld) -> dict[str, float]:
    """Least standard deviations of unbiased estimates.

    All parameters and the timing (`acts`) are unknown together; levels and spectra of the noises are known, and the encoder's
    step counts as noise of a twelfth of its square. Torque between logged values (`point`, `stale`, lost samples) counts as
    interpolated linearly, and what that misses as noise (`known_torque`).

    It is lower than what can be reached where an axis stands under load: noise then turns the speed's sign all the time, the
    bristles creep with its magnitude, and no filter knows the sign that the true motion has. A coarse encoder at rest repeats one
    error, which is no noise.

    Parameters
    ----------
    world : ScaleWorld
        Its truth and what happened behind the log are read.

    Returns
    -------
    dict
        One entry for each of `BOUNDED`, in its unit; very large or inf where the motion does not tell it.
    """
    found, _ = look(world)
    size = np.sqrt(np.diag(found))
    told = np.flatnonzero(size > 0.0)
    values, vectors = np.linalg.eigh(found[np.ix_(told, told)] / np.outer(size[told], size[told]))
    values = np.maximum(values, 1e-15)  # what double precision cannot tell from nothing
    least = np.full(len(BOUNDED), np.inf)
    least[told] = np.sqrt((vectors**2 / values).sum(axis=1)) / size[told]
    return dict(zip(BOUNDED, least.tolist(), strict=True))


def look(world: ScaleWorld, readings: Array | None = None) -> tuple[Array, Array]:
    """The Fisher information at the truth of `world`, and the score of readings there.

    Parameters
    ----------
    world : ScaleWorld
        Without `readings` the filter goes along its true motion, its true noise acting.
    readings : ndarray, shape (n,), optional
        Of the encoder. The filter then knows nothing else: it is linearised along its own estimate.

    Returns
    -------
    information : ndarray, shape (9, 9)
        In the order of `BOUNDED`.
    score : ndarray, shape (9,)
        Derivative of the logarithm of the likelihood of the readings; nothing without them.
    """
    behind = world.simulated
    known, unknown = known_torque(world)
    p = np.array([world.truth[name] for name in NAMES])
    reading = behind.encoder_noise**2 + behind.encoder_step**2 / 12.0
    return _filter(
        behind.ticks,
        behind.torque if readings is None else known,
        behind.noise if readings is None else np.zeros_like(behind.noise),
        np.diff(known, prepend=0.0),
        unknown,
        np.array([behind.noise_level, behind.noise_rate]),
        world.t,
        behind.states,
        np.zeros(0) if readings is None else readings,
        p,
        _STEP * np.where(p == 0.0, 1.0, np.abs(p)),
        behind.scales,
        reading,
    )


def known_torque(world: ScaleWorld) -> tuple[Array, Array]:
    """Torque at each tick as the log tells it, and what it leaves open.

    Between two logged ticks the torque is taken as a walk with independent steps, whose best estimate is the straight line. What
    is missed is then a Brownian bridge: of `k` ticks that are left to the next logged one, a step keeps (k - 1) / k of it and
    adds that share of the walk's variance. This is as large as what was missed around there says.

    Returns
    -------
    known : ndarray, shape (k,)
    open : ndarray, shape (2, k)
        Of what is missed at each tick, the share that remains of the last tick's, and the variance that is added.
    """
    behind = world.simulated
    at = np.flatnonzero(behind.logged)
    tick = np.arange(behind.torque.size)
    known = np.interp(tick, at, behind.torque[at])
    after = np.minimum(np.searchsorted(at, tick), at.size - 1)
    left = np.maximum(at[after] - tick, 0)
    gone = np.maximum(tick - at[np.maximum(after - 1, 0)], 1)
    share = left / np.maximum(left + 1, 1)
    unlogged = (~behind.logged).astype(float)
    walk = unlogged * (behind.torque - known) ** 2 * (left + gone) / np.maximum(left * gone, 1)
    width = _AROUND * world.log_period
    times = behind.ticks[:-1]
    level = smooth(walk, times, width) / np.maximum(smooth(unlogged, times, width), 1e-9)
    return known, np.stack(
        [share * unlogged, np.where(left > 0, share, 1.0) * unlogged * np.maximum(level, 0.0)]
    )


@njit(cache=True)
def _derivatives(
    v: float, z: float, torque: float, p: Array, sizes: Array, scales: Array, h: float, k: Array, out: Array
) -> None:
    """Derivatives of one step's distance, velocity and bristle: `out`, shape (3, 11), after v, z, torque and the 8 parameters."""
    x_0, v_0, z_0, _, _, _ = step(v, z, torque, p, h, k)
    for i in range(10):
        dv, dz, du = 0.0, 0.0, 0.0
        if i == 0:
            size = dv = _STEP * scales[1]
        elif i == 1:
            size = dz = _STEP * scales[0]
        elif i == 2:
            size = du = _STEP * p[0]
        else:
            size = sizes[i - 3]
            p[i - 3] += size
        x_1, v_1, z_1, _, _, _ = step(v + dv, z + dz, torque + du, p, h, k)
        if i > 2:
            p[i - 3] -= size
        out[0, i] = (x_1 - x_0) / size
        out[1, i] = (v_1 - v_0) / size
        out[2, i] = (z_1 - z_0) / size
    out[:, 10] = -out[:, 2]  # the offset is a torque the other way


@njit(cache=True)
def _propagate(P: Array, S: Array, D: Array, T: Array) -> None:
    """Covariance (5, 5) and sensitivities (5, 9) of position, velocity, bristle, drive noise and unknown torque over one step."""
    for i in range(3):
        direct = 1.0 if i == 0 else 0.0
        for j in range(5):
            T[i, j] = direct * P[0, j] + D[i, 0] * P[1, j] + D[i, 1] * P[2, j] + D[i, 2] * (P[3, j] + P[4, j])
        for j in range(9):
            T[i, 5 + j] = (
                direct * S[0, j] + D[i, 0] * S[1, j] + D[i, 1] * S[2, j] + D[i, 2] * (S[3, j] + S[4, j])
            )
            if j < 8:
                T[i, 5 + j] += D[i, 3 + j]
    for i in range(3):
        for j in range(3, 5):
            P[i, j] = T[i, j]
            P[j, i] = T[i, j]
        for j in range(9):
            S[i, j] = T[i, 5 + j]
    for i in range(3):
        for j in range(i, 3):
            direct = T[i, 0] if j == 0 else 0.0
            P[i, j] = direct + T[i, 1] * D[j, 0] + T[i, 2] * D[j, 1] + (T[i, 3] + T[i, 4]) * D[j, 2]
            P[j, i] = P[i, j]


@njit(cache=True)
def _read(
    mean: Array, P: Array, S: Array, reading: float, surprise: float, found: Array, score: Array
) -> None:
    """What one reading tells: `mean`, P and S are corrected; information and score are added up."""
    variance = P[0, 0] + reading
    gain = P[0].copy() / variance
    first = S[0].copy()
    for i in range(9):
        score[i] += first[i] * surprise / variance
        for j in range(9):
            found[i, j] += first[i] * first[j] / variance
    for i in range(5):
        mean[i] += gain[i] * surprise
        for j in range(9):
            S[i, j] -= gain[i] * first[j]
        for j in range(5):
            P[i, j] -= gain[i] * gain[j] * variance


@njit(cache=True)
def _fade(mean: Array, P: Array, S: Array, i: int, keep: float, added: float) -> None:
    """Noise `i` goes on: a part `keep` of it remains, and variance is added."""
    mean[i] *= keep
    S[i] *= keep
    P[i, :] *= keep
    P[:, i] *= keep
    P[i, i] += added


@njit(cache=True)
def _cross(
    mean: Array,
    h_next: float,
    duration: float,
    torque: float,
    p: Array,
    sizes: Array,
    scales: Array,
    P: Array,
    S: Array,
    k: Array,
    D: Array,
    T: Array,
) -> float:
    """`scale_physics.advance` with the covariance and the sensitivities; returns the length of the next step."""
    left = duration
    while left > 1e-12 * duration:
        h = min(h_next, left)
        dx, v, z, e_x, e_v, e_z = step(mean[1], mean[2], torque, p, h, k)
        good, following = next_step(h, (e_x, e_v, e_z), abs(v), scales, _TOLERANCE)
        if good:
            _derivatives(mean[1], mean[2], torque, p, sizes, scales, h, k, D)
            _propagate(P, S, D, T)
            mean[0] += dx
            mean[1] = v
            mean[2] = z
            left -= h
        if not good or h == h_next or following < h:
            h_next = following
    return h_next


@njit(cache=True)
def _filter(
    ticks: Array,
    torque: Array,
    noise: Array,
    jumps: Array,
    unknown: Array,
    drive: Array,
    times: Array,
    states: Array,
    readings: Array,
    p: Array,
    sizes: Array,
    scales: Array,
    reading: float,
) -> tuple[Array, Array]:
    count, split = noise.shape
    found, score, mean = np.zeros((9, 9)), np.zeros(9), np.zeros(5)
    k, D, T, S = np.empty((3, 6)), np.zeros((3, 11)), np.zeros((3, 14)), np.zeros((5, 9))
    variance = drive[0] ** 2
    # At rest, the position known as well as one reading tells it; the bristles may be pulled a little.
    P = np.diag(np.array([reading, (0.01 * scales[1]) ** 2, (0.1 * scales[0]) ** 2, variance, 0.0]))
    h = ticks[1] - ticks[0]
    taken = 0
    for j in range(count):
        _fade(mean, P, S, 4, unknown[0, j], unknown[1, j])
        S[1, 8] -= jumps[j] / p[6]  # torque that begins later by dt has not changed the speed by jump dt / J
        length = ticks[j + 1] - ticks[j]
        keep = math.exp(-drive[1] * length / split) if drive[1] > 0.0 else 0.0
        for i in range(split):
            _fade(mean, P, S, 3, keep, (1.0 - keep**2) * variance)
            now = ticks[j] + length * i / split
            end = ticks[j] + length * (i + 1) / split
            while taken < times.size and times[taken] < end - 1e-9 * length:
                if times[taken] > now:
                    total = torque[j] + noise[j, i] + mean[3] + mean[4]
                    h = _cross(mean, h, times[taken] - now, total, p, sizes, scales, P, S, k, D, T)
                    now = times[taken]
                surprise = 0.0
                if readings.size > 0:
                    surprise = readings[taken] - mean[0]
                else:  # a replayed motion would leave the true one where friction falls with speed: errors grow there
                    mean[:3] = states[taken]
                _read(mean, P, S, reading, surprise, found, score)
                taken += 1
            total = torque[j] + noise[j, i] + mean[3] + mean[4]
            h = _cross(mean, h, end - now, total, p, sizes, scales, P, S, k, D, T)
    return found, score
