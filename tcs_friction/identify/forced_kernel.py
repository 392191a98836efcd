"""Compiled loop of a Kalman filter about an inertia under torques that are known: how well each next position is predicted.

State: position x, velocity v, and the acceleration by disturbances, first-order noise w and slow drift d, as in
`prediction_kernel`. Friction is an input here, computed beforehand along the measured motion and linear in the velocity about it;
so the filter is linear, and one kernel serves every law.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit, prange

from tcs_friction.identify.prediction_kernel import SLOW

STEEPEST = 0.5  # 1/steps: friction that slows the axis faster is not resolved


@njit(cache=True, error_model="numpy", parallel=True, nogil=True)
def predict(
    position: Any,
    bounds: Any,
    steps: Any,
    pushes: Any,
    moves: Any,
    rough: Any,
    row: Any,
    friction: Any,
    law: Any,
    velocity: Any,
    slope: Any,
    candidates: Any,
    errors: Any,
    variances: Any,
) -> None:
    """One-step errors of prediction and their variances for each candidate.

    position (n,) rad, bounds (s + 1,) of the stretches, steps (n,) s from each sample to the next, pushes (l, n) mean torque N m
    over each, by several timings, moves (l, n) the constant torque that moves as far, rough (n,) N m by which
    the torque changes about there, row (m,) which of them a candidate has,
    friction (l, n) N m at each sample for several laws, law (m,) which of them a candidate has, velocity (n,) rad/s that the
    friction was computed with, slope (n,) N m s/rad of friction by velocity, candidates (m, 7): inertia, offset N m, rate 1/s
    and size (rad/s^2 rms) of the disturbance, encoder noise rad rms, size of the drift (rad/s^2 rms), share of the
    changes that the log misses.
    Out (m, n): errors in rad, variances in rad^2.
    """
    for m in prange(len(candidates)):
        inertia, offset, rate, size, encoder, drift, missed = candidates[m]
        noise, wander = encoder * encoder, drift * drift
        pull, driven, moved = friction[law[m]], pushes[row[m]], moves[row[m]]
        keep, stay, last_dt = 1.0, 1.0, 0.0
        for part in range(len(bounds) - 1):
            first, last = bounds[part], bounds[part + 1]
            dt = steps[first]
            x, v, w, d = position[first], (position[first + 1] - position[first]) / dt, 0.0, 0.0
            xx, xv, xw, xd, vw, vd, wd = noise, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            vv, ww, dd = 2.0 * noise / (dt * dt) + v * v, size * size, wander
            for i in range(first, last):
                variance, error = xx + noise, position[i] - x
                errors[m, i], variances[m, i] = error, variance
                gx, gv, gw, gd = xx / variance, xv / variance, xw / variance, xd / variance
                x, v, w, d = x + gx * error, v + gv * error, w + gw * error, d + gd * error
                vv, vw, vd = vv - gv * xv, vw - gv * xw, vd - gv * xd
                ww, wd, dd = ww - gw * xw, wd - gw * xd, dd - gd * xd
                xx, xv, xw, xd = xx - gx * xx, xv - gx * xv, xw - gx * xw, xd - gx * xd

                dt, after = steps[i], min(i + 1, last - 1)
                if dt != last_dt:
                    keep, stay, last_dt = math.exp(-rate * dt), math.exp(-SLOW * dt), dt
                power = size * size * (1.0 - keep * keep)
                middle, half = 0.5 * (1.0 + keep), 0.5 * dt * dt
                push = (driven[i] - offset - 0.5 * (pull[i] + pull[after])) / inertia
                lift = half * (moved[i] - driven[i]) / inertia
                drag = min(max(0.5 * (slope[i] + slope[after]) / inertia, -STEEPEST / dt), STEEPEST / dt)
                push += drag * 0.5 * (velocity[i] + velocity[after]) + d
                a = push - drag * v + w
                a = push - drag * (v + 0.5 * dt * a) + middle * w
                x, v, w, d = x + dt * v + half * a + lift, v + dt * a, keep * w, stay * d

                along = 1.0 - 0.5 * dt * drag
                x1, v1, v2, v3 = dt * along, 1.0 - dt * drag * along, dt * along * middle, dt * along
                tv = xv + x1 * vv + half * (vw + vd)
                tw, td = xw + x1 * vw + half * (ww + wd), xd + x1 * vd + half * (wd + dd)
                uv, uw, ud = (
                    v1 * vv + v2 * vw + v3 * vd,
                    v1 * vw + v2 * ww + v3 * wd,
                    v1 * vd + v2 * wd + v3 * dd,
                )
                unknown = (missed * rough[i] / inertia) ** 2
                xx += x1 * xv + half * (xw + xd) + x1 * tv + half * (tw + td) + half * half * unknown
                xv = v1 * tv + v2 * tw + v3 * td + half * v3 * unknown
                vv = v1 * uv + v2 * uw + v3 * ud + power * dt * dt / 3.0 + v3 * v3 * unknown
                xw, xd, vw, vd = keep * tw, stay * td, keep * uw + 0.5 * power * dt, stay * ud
                ww, wd = keep * keep * ww + power, keep * stay * wd
                dd = stay * stay * dd + wander * (1.0 - stay * stay)
