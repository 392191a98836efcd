"""Compiled loop of a Kalman filter about an axis with LuGre friction: how well each next position is predicted.

State: position x, velocity v, bristle deflection z and the acceleration by disturbances, which is first-order noise w and a slow
drift d; without the drift, whatever a law lacks at low frequency would spoil the spectrum of w. A step is that of the midpoint
rule under the torque held over it, exact in z for the middle velocity, so that no bristle is too stiff for fast motion,
extrapolated from the step's two halves; covariances follow the linearised step (extended Kalman filter, Jazwinski 1970). The
speed |v| that wears the bristle is statistically linearised instead (Gelb, Applied Optimal Estimation, 1974, chapter 6.2): an
axis at rest that noise shakes slips by the mean of |v|, and by chance for as long as its velocity stays like itself. Each stretch
starts with velocity, bristle and disturbance unknown. Candidates go side by side in lanes, as in `kernels`.
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
SQRT_PI, SMALLEST = math.sqrt(math.pi), 1e-200


@njit(inline="always")
def mean_speed(v: Any, scale: Any) -> Any:
    """Mean of |v| and its derivative by the mean v, of a normal velocity; scale is 1 / (standard deviation sqrt(2)).

    Leone, Nelson & Nottingham (1961); the error function to 1.5e-7 (Abramowitz & Stegun 1964, 7.1.26).
    """
    u = abs(v) * scale
    t = 1.0 / (1.0 + 0.3275911 * u)
    fallen = falling_exponential(-u * u)
    sign = 1.0 - fallen * t * (
        0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))  # fmt: skip
    return abs(v) * sign + fallen / (SQRT_PI * scale), math.copysign(sign, v)


@njit(inline="always")
def bristle_rate(v: Any, scale: Any, z: Any, coulomb: Any, drop: Any, bell: Any, stiffness: Any) -> Any:
    """dz/dt of eq. 2, its derivative by v, and the rate (1/s) at which z is forgotten; bell is -1 / stribeck_velocity^2.

    scale: see `mean_speed`. A velocity of which the sign is not sure goes to and fro, and slips although it has no mean.
    """
    speed, sign = mean_speed(v, scale)
    fallen = drop * falling_exponential(v * v * bell)
    pull = stiffness / (coulomb + fallen)
    slope = 2.0 * fallen * v * bell * pull / stiffness
    return v - pull * speed * z, 1.0 - pull * z * (sign - speed * slope), pull * speed


@njit(inline="always")
def forgets_speed(inertia: Any, stiffness: Any, damping: Any, rate: Any) -> Any:
    """1/s, of one over the integral of the squared autocorrelation of the velocity of an axis at rest.

    Noise of first order (1/s) drives the axis on its bristles: rho(s) = s (s + d2) / (s^3 + d2 s^2 + d1 s + d0) with
    d2 = a + r, d1 = b + a r, d0 = b r, a = damping / inertia, b = stiffness / inertia; Newton, Gould & Kaiser 1957, appendix E.
    """
    a, b = damping / inertia, stiffness / inertia
    return 2.0 * a * (b + a * rate + rate * rate) / (b + a * rate + (a + rate) ** 2)


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
        c, s, learnt = np.empty((SIZE + 5, L)), np.zeros((ROWS, L)), np.zeros(L)
        push, lift, ends, unknown = np.zeros(L), np.zeros(L), np.zeros((6, L)), np.zeros(L)
        for j in range(L):
            p = candidates[min(block * L + j, count - 1)]
            for k in range(SIZE):
                c[k, j] = p[k]
            c[18, j] = forgets_speed(p[6], p[3], p[4] + p[5], p[8])
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
                _update(s, c, learnt, position[i])
                period = (firsts[i + 1] - firsts[i]) * steps[min(firsts[i], len(steps) - 1)]
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
                    _advance(s, c, push, lift, unknown, ends, learnt, period, dt)


@njit(inline="always")
def _update(s: Any, c: Any, learnt: Any, measured: float) -> None:
    """Take a measured position (rad) into states and covariances of all lanes.

    learnt: filled with the variance of the velocity before it, over that after it, less one.
    """
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
        learnt[j] = gv * xv / (s[8, j] - gv * xv)
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
def _midpoint(x: Any, v: Any, z: Any, flow: Any, forget: Any, scale: Any, push: Any, dt: float, c: Any, j: Any) -> Any:
    """Position, velocity and deflection after one step under the torque `push`, disturbances included. flow, forget: at first."""
    coulomb, drop, bell, stiffness, damping, viscous, lightness = (
        c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[5, j], c[6, j])  # fmt: skip
    share = mean_decay(forget * dt, falling_exponential(-forget * dt))
    vm = v + 0.5 * dt * lightness * (push - stiffness * z - share * damping * flow - viscous * v)
    flow, _, forget = bristle_rate(vm, scale, z, coulomb, drop, bell, stiffness)
    flow *= mean_decay(forget * dt, falling_exponential(-forget * dt))
    a = lightness * (push - stiffness * (z + 0.5 * dt * flow) - damping * flow - viscous * vm)
    return x + dt * v + 0.5 * dt * dt * a, v + dt * a, z + dt * flow


@njit(inline="always")
def _halves(s: Any, c: Any, push: Any, dt: float, ends: Any) -> None:
    """After a step in two halves under the mean torque: position, velocity and deflection; and of its start what `_advance` asks.

    ends (6, lanes): these three, the bristle's rate, how fast it forgets (1/s), and the scale of `mean_speed`.
    """
    for j in range(LANES):
        coulomb, drop, bell, stiffness = c[0, j], c[1, j], c[2, j], c[3, j]
        w, d, keep, scale = s[3, j], s[14, j], c[17, j], 1.0 / math.sqrt(2.0 * s[8, j] + SMALLEST)
        first = push[j] + ((0.5 + 0.5 * keep) * w + d) / c[6, j]
        flow, _, forget = bristle_rate(s[1, j], scale, s[2, j], coulomb, drop, bell, stiffness)
        ends[3, j], ends[4, j], ends[5, j] = flow, forget, scale
        x, v, z = _midpoint(s[0, j], s[1, j], s[2, j], flow, forget, scale, first, 0.5 * dt, c, j)
        second = push[j] + ((0.5 + 0.5 * keep) * keep * w + d) / c[6, j]
        flow, _, forget = bristle_rate(v, scale, z, coulomb, drop, bell, stiffness)
        ends[0, j], ends[1, j], ends[2, j] = _midpoint(x, v, z, flow, forget, scale, second, 0.5 * dt, c, j)


@njit(inline="always")
def _extrapolated(whole: Any, halves: Any) -> Any:
    """Where infinitely many parts of a step would end, whose error goes with its third power (Richardson 1911)."""
    return whole + (halves - whole) / 0.75


@njit(inline="always")
def _advance(
    s: Any, c: Any, push: Any, lift: Any, unknown: Any, ends: Any, learnt: Any, period: float, dt: float
) -> None:
    """One step of all lanes under the torque `push` (N m), which moves as `push + lift` does: x' = T x, P' = T P T^T + Q.

    unknown: variance of an acceleration that lasts for this step alone, (rad/s^2)^2. ends: what `_halves` found. learnt: of the
    velocity, by the last sample (`_update`), period (s) before the next.
    Rows: x v z w, xx xv xz xw vv vz vw zz zw ww, d, xd vd zd wd dd.
    """
    half = 0.5 * dt * dt
    for j in range(LANES):
        coulomb, drop, bell, stiffness, damping, viscous, lightness = (
            c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[5, j], c[6, j])  # fmt: skip
        keep, power = c[14, j], c[15, j]
        middle = 0.5 * (1.0 + keep)
        v, z, w, d, stay = s[1, j], s[2, j], s[3, j], s[14, j], c[16, j]
        xx, xv, xz, xw, vv = s[4, j], s[5, j], s[6, j], s[7, j], s[8, j]
        flow, forget, scale = ends[3, j], ends[4, j], ends[5, j]
        share = mean_decay(forget * dt, falling_exponential(-forget * dt))
        a = (push[j] - stiffness * z - share * damping * flow - viscous * v) * lightness + w + d
        vm = v + 0.5 * dt * a
        flow, by_velocity, forget = bristle_rate(vm, scale, z, coulomb, drop, bell, stiffness)
        share = mean_decay(forget * dt, falling_exponential(-forget * dt))
        moved, zv, z2 = share * dt * flow, share * dt * by_velocity, 1.0 - share * dt * forget
        speed, sign = mean_speed(vm, scale)
        slip = share * forget * (z + 0.5 * moved) / speed
        unsure = max(vm * vm + vv * (1.0 - sign * sign) - speed * speed, 0.0)  # of |v|, beside what goes with v
        q = 2.0 * dt * slip * slip * unsure / min(c[18, j] + learnt[j] / period, 2.0 / dt)
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
        e, qv = unknown[j], -(0.5 * dt * stiffness + damping) * lightness
        qx = 0.5 * dt * qv
        s[4, j] = xx + x1 * xv + x2 * xz + x3 * (xw + xd) + x1 * tv + x2 * tz + x3 * (tw + td) + x3 * x3 * e + qx * qx * q
        s[5, j] = v1 * tv + v2 * tz + v3 * tw + v4 * td + x3 * v4 * e + qx * qv * q
        s[6, j] = z1 * tv + z2 * tz + z3 * (tw + td) + x3 * z3 * e + qx * q
        s[7, j], s[10, j], s[12, j] = keep * tw, keep * uw + 0.5 * power * dt, keep * sw
        s[8, j] = v1 * uv + v2 * uz + v3 * uw + v4 * ud + power * dt * dt / 3.0 + v4 * v4 * e + qv * qv * q
        s[9, j] = z1 * uv + z2 * uz + z3 * (uw + ud) + v4 * z3 * e + qv * q
        s[11, j] = z1 * sv + z2 * sz + z3 * (sw + sd) + z3 * z3 * e + q
        s[13, j] = keep * keep * ww + power
        s[15, j], s[16, j], s[17, j] = stay * td, stay * ud, stay * sd
        s[18, j] = keep * stay * wd
        s[19, j] = stay * stay * dd + c[11, j] * (1.0 - stay * stay)
