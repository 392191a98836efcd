"""Compiled loop of a Kalman filter about an axis with LuGre friction: how well each next position is predicted.

State: position x, velocity v, bristle deflection z and the acceleration by disturbances, which is first-order noise w and a
slow drift d; without the drift, whatever a law lacks at low frequency would spoil the spectrum of w. A step is that of the
midpoint rule under the torque held over it, exact in z for the middle velocity, so that no bristle is too stiff for fast
motion, extrapolated from the step's two halves; covariances follow the linearised step (extended Kalman filter, Jazwinski
1970). Each stretch starts with velocity, bristle and disturbance unknown. Candidates go side by side in lanes, as in `kernels`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from tcs_friction.identify.kernels import FAST, falling_exponential, mean_decay

LANES = 16
SLOW = 0.3  # 1/s, of the drift
SIZE = 14  # of a candidate: LuGre's six, and eight that `predict` lists
ROWS = 20  # of the state and its covariance


@njit(inline="always")
def bristle_rate(v: Any, z: Any, coulomb: Any, drop: Any, bell: Any, stiffness: Any) -> Any:
    """dz/dt of eq. 2, its derivative by v, and the rate (1/s) at which z is forgotten; bell is -1 / stribeck_velocity^2."""
    fallen = drop * falling_exponential(v * v * bell)
    pull = stiffness / (coulomb + fallen)
    slope = 2.0 * fallen * v * bell * pull / stiffness
    by_velocity = 1.0 - pull * z * (math.copysign(1.0, v) - abs(v) * slope)
    return v - pull * abs(v) * z, by_velocity, pull * abs(v)


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True, nogil=True)
def predict(
    position: Any,
    bounds: Any,
    firsts: Any,
    steps: Any,
    pushes: Any,
    moves: Any,
    rough: Any,
    row: Any,
    candidates: Any,
    errors: Any,
    variances: Any,
) -> None:
    """One-step errors of prediction and their variances for each candidate.

    position (n,) rad, bounds (s + 1,) of the stretches, steps (q,) s that are walked, from sample i on those from firsts[i] up to
    firsts[i + 1] (n + 1,), pushes (l, q) mean torque N m over each, by several timings, moves (l, q) the constant torque that
    moves as far, rough (q,) N m by which the torque changes about there, row (m,) which timing a candidate has, candidates
    (m, SIZE): LuGre's six as in `physics.friction.lugre`, inertia, offset N m, rate 1/s and size (rad/s^2 rms) of the
    disturbance, encoder noise rad rms, size of the drift (rad/s^2 rms), share of the changes that the log misses, how unsure a
    bristle is at first (1; 0: it is relaxed).
    Out (m, n): errors in rad, variances in rad^2.
    """
    L = LANES
    count = candidates.shape[0]
    for block in prange((count + L - 1) // L):
        c, s = np.empty((SIZE + 4, L)), np.zeros((ROWS, L))
        push, lift, ends, unknown = np.zeros(L), np.zeros(L), np.zeros((3, L)), np.zeros(L)
        for j in range(L):
            p = candidates[min(block * L + j, count - 1)]
            for k in range(SIZE):
                c[k, j] = p[k]
            c[1, j], c[2, j], c[6, j] = p[1] - p[0], -1.0 / (p[2] * p[2]), 1.0 / p[6]
            c[9, j], c[10, j], c[11, j], c[12, j] = p[9] * p[9], p[10] * p[10], p[11] * p[11], p[12] * p[12]
            c[13, j] = p[13] * (p[1] / p[3]) ** 2
        used = min(L, count - block * L)
        last_dt = 0.0
        for part in range(len(bounds) - 1):
            first, last = bounds[part], bounds[part + 1]
            apart = 0.0
            for k in range(firsts[first], firsts[first + 1]):
                apart += steps[k]
            for j in range(L):
                for k in range(ROWS):
                    s[k, j] = 0.0
                v, noise = (position[first + 1] - position[first]) / apart, c[10, j]
                s[0, j], s[1, j], s[4, j] = position[first], v, noise
                s[8, j], s[11, j], s[13, j] = 2.0 * noise / (apart * apart) + v * v, c[13, j], c[9, j]
                s[19, j] = c[11, j]
            for i in range(first, last):
                for j in range(used):
                    errors[block * L + j, i] = position[i] - s[0, j]
                    variances[block * L + j, i] = s[4, j] + c[10, j]
                _update(s, c, position[i])
                for k in range(firsts[i], firsts[i + 1]):
                    dt = steps[k]
                    if dt != last_dt:
                        for j in range(L):
                            c[14, j], c[16, j] = math.exp(-c[8, j] * dt), math.exp(-SLOW * dt)
                            c[15, j] = c[9, j] * (1.0 - c[14, j] * c[14, j])
                            c[17, j] = math.exp(-0.5 * c[8, j] * dt)
                        last_dt = dt
                    for j in range(L):
                        r = row[min(block * L + j, count - 1)]
                        push[j] = pushes[r, k] - c[7, j]
                        lift[j] = moves[r, k] - pushes[r, k]
                        unknown[j] = c[12, j] * (rough[k] * c[6, j]) ** 2
                    _halves(s, c, push, dt, ends)
                    _advance(s, c, push, lift, unknown, ends, dt)


@njit(inline="always")
def _update(s: Any, c: Any, measured: float) -> None:
    """Take a measured position (rad) into states and covariances of all lanes."""
    for j in range(LANES):
        xx, xv, xz, xw = s[4, j], s[5, j], s[6, j], s[7, j]
        part = 1.0 / (xx + c[10, j])
        error = measured - s[0, j]
        gx, gv, gz, gw = xx * part, xv * part, xz * part, xw * part
        s[0, j] += gx * error
        s[1, j] += gv * error
        s[2, j] += gz * error
        s[3, j] += gw * error
        s[4, j], s[5, j], s[6, j], s[7, j] = xx - gx * xx, xv - gx * xv, xz - gx * xz, xw - gx * xw
        s[8, j] -= gv * xv
        s[9, j] -= gv * xz
        s[10, j] -= gv * xw
        s[11, j] -= gz * xz
        s[12, j] -= gz * xw
        s[13, j] -= gw * xw
        xd = s[15, j]
        gd = xd * part
        s[14, j] += gd * error
        s[16, j] -= gv * xd
        s[17, j] -= gz * xd
        s[18, j] -= gw * xd
        s[19, j] -= gd * xd
        s[15, j] = xd - gd * xx


@njit(inline="always")
def _midpoint(x: Any, v: Any, z: Any, push: Any, dt: float, c: Any, j: Any) -> Any:
    """Position, velocity and deflection after one step under the torque `push`, disturbances included."""
    coulomb, drop, bell, stiffness, damping, viscous, lightness = (
        c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[5, j], c[6, j])  # fmt: skip
    flow, _, forget = bristle_rate(v, z, coulomb, drop, bell, stiffness)
    share = mean_decay(forget * dt, falling_exponential(-forget * dt))
    vm = v + 0.5 * dt * lightness * (push - stiffness * z - share * damping * flow - viscous * v)
    flow, _, forget = bristle_rate(vm, z, coulomb, drop, bell, stiffness)
    flow *= mean_decay(forget * dt, falling_exponential(-forget * dt))
    a = lightness * (push - stiffness * (z + 0.5 * dt * flow) - damping * flow - viscous * vm)
    return x + dt * v + 0.5 * dt * dt * a, v + dt * a, z + dt * flow


@njit(inline="always")
def _halves(s: Any, c: Any, push: Any, dt: float, ends: Any) -> None:
    """Position, velocity and deflection (3, lanes) after a step in two halves under the mean torque."""
    for j in range(LANES):
        w, d, keep = s[3, j], s[14, j], c[17, j]
        first = push[j] + ((0.5 + 0.5 * keep) * w + d) / c[6, j]
        x, v, z = _midpoint(s[0, j], s[1, j], s[2, j], first, 0.5 * dt, c, j)
        second = push[j] + ((0.5 + 0.5 * keep) * keep * w + d) / c[6, j]
        ends[0, j], ends[1, j], ends[2, j] = _midpoint(x, v, z, second, 0.5 * dt, c, j)


@njit(inline="always")
def _extrapolated(whole: Any, halves: Any) -> Any:
    """Where infinitely many parts of a step would end, whose error goes with its third power (Richardson 1911)."""
    return whole + (halves - whole) / 0.75


@njit(inline="always")
def _advance(s: Any, c: Any, push: Any, lift: Any, unknown: Any, ends: Any, dt: float) -> None:
    """One step of all lanes under the torque `push` (N m), which moves as `push + lift` does: x' = T x, P' = T P T^T + Q.

    unknown: variance of an acceleration that lasts for this step alone, (rad/s^2)^2. ends: what `_halves` found.
    Rows: x v z w, xx xv xz xw vv vz vw zz zw ww, d, xd vd zd wd dd.
    """
    half = 0.5 * dt * dt
    for j in range(LANES):
        coulomb, drop, bell, stiffness, damping, viscous, lightness = (
            c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[5, j], c[6, j])  # fmt: skip
        keep, power = c[14, j], c[15, j]
        middle = 0.5 * (1.0 + keep)
        v, z, w, d, stay = s[1, j], s[2, j], s[3, j], s[14, j], c[16, j]
        flow, _, forget = bristle_rate(v, z, coulomb, drop, bell, stiffness)
        share = mean_decay(forget * dt, falling_exponential(-forget * dt))
        a = (push[j] - stiffness * z - share * damping * flow - viscous * v) * lightness + w + d
        vm = v + 0.5 * dt * a
        flow, by_velocity, forget = bristle_rate(vm, z, coulomb, drop, bell, stiffness)
        share = mean_decay(forget * dt, falling_exponential(-forget * dt))
        moved, zv, z2 = share * dt * flow, share * dt * by_velocity, 1.0 - share * dt * forget
        zm, flow = z + 0.5 * moved, share * flow
        a = (push[j] - stiffness * zm - damping * flow - viscous * vm) * lightness + middle * w + d
        beyond = half * lift[j] * lightness  # the way that the torque moves beyond its mean, which bends and damps, too
        s[0, j] = _extrapolated(s[0, j] + dt * v + half * a, ends[0, j]) + beyond
        s[1, j] = _extrapolated(v + dt * a, ends[1, j]) - (viscous + damping * zv / dt) * lightness * beyond
        s[2, j] = _extrapolated(z + moved, ends[2, j]) + zv / dt * beyond
        s[3, j] = w * keep
        s[14, j] = d * stay

        av = -(viscous + (damping / dt + 0.5 * stiffness) * zv) * lightness
        az = -(0.5 * stiffness * (1.0 + z2) - damping * share * forget) * lightness
        along = 1.0 + 0.5 * dt * av
        x1, x2, x3 = dt * along, half * az, half
        v1, v2, v3, v4 = 1.0 + dt * av * along, dt * az * along, dt * along * middle, dt * along
        z1, z2, z3 = zv * along, z2 + 0.5 * dt * zv * az, 0.5 * dt * zv
        xx, xv, xz, xw, vv = s[4, j], s[5, j], s[6, j], s[7, j], s[8, j]
        vz, vw, zz, zw, ww = s[9, j], s[10, j], s[11, j], s[12, j], s[13, j]
        xd, vd, zd, wd, dd = s[15, j], s[16, j], s[17, j], s[18, j], s[19, j]
        tv = xv + x1 * vv + x2 * vz + x3 * (vw + vd)
        tz = xz + x1 * vz + x2 * zz + x3 * (zw + zd)
        tw = xw + x1 * vw + x2 * zw + x3 * (ww + wd)
        td = xd + x1 * vd + x2 * zd + x3 * (wd + dd)
        uv = v1 * vv + v2 * vz + v3 * vw + v4 * vd
        uz = v1 * vz + v2 * zz + v3 * zw + v4 * zd
        uw = v1 * vw + v2 * zw + v3 * ww + v4 * wd
        ud = v1 * vd + v2 * zd + v3 * wd + v4 * dd
        sv, sz = z1 * vv + z2 * vz + z3 * (vw + vd), z1 * vz + z2 * zz + z3 * (zw + zd)
        sw, sd = z1 * vw + z2 * zw + z3 * (ww + wd), z1 * vd + z2 * zd + z3 * (wd + dd)
        e = unknown[j]
        s[4, j] = xx + x1 * xv + x2 * xz + x3 * (xw + xd) + x1 * tv + x2 * tz + x3 * (tw + td) + x3 * x3 * e
        s[5, j] = v1 * tv + v2 * tz + v3 * tw + v4 * td + x3 * v4 * e
        s[6, j] = z1 * tv + z2 * tz + z3 * (tw + td) + x3 * z3 * e
        s[7, j], s[10, j], s[12, j] = keep * tw, keep * uw + 0.5 * power * dt, keep * sw
        s[8, j] = v1 * uv + v2 * uz + v3 * uw + v4 * ud + power * dt * dt / 3.0 + v4 * v4 * e
        s[9, j] = z1 * uv + z2 * uz + z3 * (uw + ud) + v4 * z3 * e
        s[11, j] = z1 * sv + z2 * sz + z3 * (sw + sd) + z3 * z3 * e
        s[13, j] = keep * keep * ww + power
        s[15, j], s[16, j], s[17, j] = stay * td, stay * ud, stay * sd
        s[18, j] = keep * stay * wd
        s[19, j] = stay * stay * dd + c[11, j] * (1.0 - stay * stay)
