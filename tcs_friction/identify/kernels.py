"""Compiled loops of LuGre identification over motion (n,) and populations (m, ...).

The bristle is stepped as in `physics.friction.lugre` (bristle_step, stribeck_level), in the torque Z = sigma0 z.
Candidates go side by side in lanes that the processor computes together, and the exponential is a polynomial for the
same reason: many times the speed of one candidate at a time. Tests hold both forms against each other.

Common arguments: `velocity` (rad/s), `travel` (rad since the sample before), `carry` (1 within a stretch, 0 where one
starts), `target` (N m), `weight` (1: counts in the cost, 0: does not), each (n,).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

LANES = 16
FAST = {"contract", "nnan", "ninf", "nsz", "arcp"}
COLUMNS = 5  # of the linear part: slide, bristle rate, velocity, acceleration, one
OBSERVER = 13  # numbers that describe a filter of fourth order or less
ROWS = 16  # of the state of LANES candidates: parameters, bristle, sum, level before, friction, filter
GRAM = COLUMNS * (COLUMNS + 1) // 2 + COLUMNS  # its upper triangle and right-hand side


@njit(inline="always")
def falling_exponential(x: Any) -> Any:
    """exp(x) for x <= 0, to 1e-13; below -44 the value there. Tenth-order Taylor of exp(x/64), squared six times."""
    y = max(x, -44.0) * 0.015625
    p = 1.0 + y * (1.0 + y * (1.0 / 2.0 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0 + y * (
        1.0 / 720.0 + y * (1.0 / 5040.0 + y * (1.0 / 40320.0 + y * (1.0 / 362880.0 + y / 3628800.0)))))))))  # fmt: skip
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p * p


@njit(inline="always")
def mean_decay(widths: Any, decay: Any) -> Any:
    """(1 - exp(-w)) / w, the mean of the decay over a step w long, also where w is next to nothing."""
    small = 1.0 - widths * (0.5 - widths * (1.0 / 6.0 - widths / 24.0))
    return small if widths < 1e-3 else (1.0 - decay) / max(widths, 1e-3)


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True)
def squared_errors(
    velocity: Any,
    travel: Any,
    carry: Any,
    acceleration: Any,
    target: Any,
    weight: Any,
    observer: Any,
    population: Any,
    out: Any,
) -> None:
    """Sum of squared errors (eq. 5, twice) of each candidate, `out` (m,).

    `observer` (OBSERVER,): the filter that the friction in `target` has passed, as coefficients b0 to b4, a1 to a4 and its
    states on a constant one; (0,) if it has passed none. `population` (m, 8): LuGre's parameters as in
    `physics.friction.lugre`, then inertia and offset.
    """
    L = LANES
    count, passed = population.shape[0], len(observer) > 0
    for block in prange((count + L - 1) // L):
        w = _lanes(population, block)
        for i in range(len(velocity)):
            _friction(w, velocity[i], travel[i], carry[i])
            if passed:
                _observe(w, observer, carry[i])
            _compare(w, acceleration[i], target[i], weight[i])
        for j in range(min(L, count - block * L)):
            out[block * L + j] = w[9 * L + j]


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True)
def smoothed_errors(
    velocity: Any,
    travel: Any,
    carry: Any,
    acceleration: Any,
    target: Any,
    weight: Any,
    low_pass: Any,
    population: Any,
    out: Any,
) -> None:
    """The same where `target` has passed a filter (OBSERVER,) forwards and backwards: so does the friction."""
    L = LANES
    count, last = population.shape[0], len(velocity) - 1
    for block in prange((count + L - 1) // L):
        w = _lanes(population, block)
        torque = np.empty((last + 1, L))
        for i in range(last + 1):
            _friction(w, velocity[i], travel[i], carry[i])
            _observe(w, low_pass, carry[i])
            for j in range(L):
                torque[i, j] = w[11 * L + j]
        for i in range(last, -1, -1):
            for j in range(L):
                w[11 * L + j] = torque[i, j]
            _observe(w, low_pass, carry[i + 1] if i < last else 0.0)
            _compare(w, acceleration[i], target[i], weight[i])
        for j in range(min(L, count - block * L)):
            out[block * L + j] = w[9 * L + j]


@njit(inline="always")
def _lanes(population: Any, block: int) -> Any:
    """(ROWS * LANES,): coulomb, static - coulomb, -1/stribeck_velocity^2, stiffness ... offset; Z, sum, level before,
    friction and filter states are zero."""
    L = LANES
    w = np.zeros(ROWS * L)
    for j in range(L):
        p = population[min(block * L + j, len(population) - 1)]
        w[j], w[L + j], w[2 * L + j] = p[0], p[1] - p[0], -1.0 / (p[2] * p[2])
        for k in range(3, 8):
            w[k * L + j] = p[k]
    return w


@njit(inline="always")
def _friction(w: Any, v: float, travel: float, kept: float) -> None:
    """One step of the bristles (row 8) and the friction (row 11)."""
    L = LANES
    speed, square, moved, direction = abs(v), v * v, abs(travel), math.copysign(1.0, travel)
    for j in range(L):
        level = w[j] + w[L + j] * falling_exponential(square * w[2 * L + j])
        before = level + kept * (w[10 * L + j] - level)
        w[10 * L + j] = level
        widths = w[3 * L + j] * moved * 2.0 / (before + level)
        decay = falling_exponential(-widths)
        mean = mean_decay(widths, decay)
        slide = direction * (before * (mean - decay) + level * (1.0 - mean))
        bristle = kept * w[8 * L + j] * decay + slide
        w[8 * L + j] = bristle
        w[11 * L + j] = bristle + w[4 * L + j] * (v - speed / level * bristle) + w[5 * L + j] * v


@njit(inline="always")
def _compare(w: Any, a: float, aim: float, share: float) -> None:
    """Adds the squared error of friction (row 11), inertia and offset to the sum (row 9)."""
    L = LANES
    for j in range(L):
        error = w[11 * L + j] + w[6 * L + j] * a + w[7 * L + j] - aim
        w[9 * L + j] += share * error * error


@njit(inline="always")
def _observe(w: Any, filtered: Any, kept: float) -> None:
    """Pass the friction in row 11 through the filter (direct form II transposed), whose states are in rows 12 to 15."""
    L, fresh = LANES, 1.0 - kept
    for j in range(L):
        x = w[11 * L + j]
        state = w[12 * L + j], w[13 * L + j], w[14 * L + j], w[15 * L + j]
        first, second = kept * state[0] + fresh * filtered[9] * x, kept * state[1] + fresh * filtered[10] * x
        third, fourth = kept * state[2] + fresh * filtered[11] * x, kept * state[3] + fresh * filtered[12] * x
        y = filtered[0] * x + first
        w[12 * L + j] = filtered[1] * x - filtered[5] * y + second
        w[13 * L + j] = filtered[2] * x - filtered[6] * y + third
        w[14 * L + j] = filtered[3] * x - filtered[7] * y + fourth
        w[15 * L + j] = filtered[4] * x - filtered[8] * y
        w[11 * L + j] = y


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True)
def normal_equations(
    velocity: Any, travel: Any, carry: Any, acceleration: Any, target: Any, weight: Any, shapes: Any, out: Any
) -> None:
    """The linear part of LuGre for each shape: sums from which the best linear coefficients follow (variable projection).

    `shapes` (m, 3): presliding distance coulomb/stiffness (rad), static/coulomb, Stribeck velocity (rad/s). With these
    fixed the torque is linear in coulomb, damping, viscous, inertia and offset. `out` (m, GRAM): upper triangle of the weighted
    Gram matrix row by row, then the products with the target.
    """
    L = LANES
    count = shapes.shape[0]
    for block in prange((count + L - 1) // L):
        w = np.zeros(5 * L)  # stiffness/coulomb, static/coulomb - 1, -1/stribeck_velocity^2, y, level before
        sums = np.zeros(GRAM * L)
        for j in range(L):
            p = shapes[min(block * L + j, count - 1)]
            w[j], w[L + j], w[2 * L + j] = 1.0 / p[0], p[1] - 1.0, -1.0 / (p[2] * p[2])
        for i in range(len(velocity)):
            v, speed, square = velocity[i], abs(velocity[i]), velocity[i] * velocity[i]
            moved, direction = abs(travel[i]), math.copysign(1.0, travel[i])
            kept, a, aim, share = carry[i], acceleration[i], target[i], weight[i]
            for j in range(L):
                level = 1.0 + w[L + j] * falling_exponential(square * w[2 * L + j])
                before = level + kept * (w[4 * L + j] - level)
                w[4 * L + j] = level
                widths = w[j] * moved * 2.0 / (before + level)
                decay = falling_exponential(-widths)
                mean = mean_decay(widths, decay)
                y = kept * w[3 * L + j] * decay + direction * (before * (mean - decay) + level * (1.0 - mean))
                w[3 * L + j] = y
                rate = v - speed / level * y
                sy, sr = share * y, share * rate
                sums[j] += sy * y
                sums[L + j] += sy * rate
                sums[2 * L + j] += sy * v
                sums[3 * L + j] += sy * a
                sums[4 * L + j] += sy
                sums[5 * L + j] += sr * rate
                sums[6 * L + j] += sr * v
                sums[7 * L + j] += sr * a
                sums[8 * L + j] += sr
                sums[15 * L + j] += sy * aim
                sums[16 * L + j] += sr * aim
            fixed = (square, v * a, v, a * a, a, 1.0)
            for k in range(6):
                sums[(9 + k) * L] += share * fixed[k]
            sums[17 * L] += share * v * aim
            sums[18 * L] += share * a * aim
            sums[19 * L] += share * aim
        for j in range(min(L, count - block * L)):
            for k in range(GRAM):
                common = 9 <= k <= 14 or k >= 17
                out[block * L + j, k] = sums[k * L] if common else sums[k * L + j]


@njit(cache=True, error_model="numpy")
def sensitivities(velocity: Any, travel: Any, bounds: Any, parameters: Any, initial: Any, out: Any) -> None:
    """LuGre torque and its exact derivatives, integrated beside the bristle.

    `bounds` (s + 1,): the stretches; `initial` (s,): bristle torque Z at their starts, N m. `out` (n, 8): torque;
    derivatives by coulomb, static, stribeck_velocity, stiffness, damping, viscous; derivative by the stretch's initial Z.
    """
    coulomb, static, stribeck, stiffness, damping, viscous = parameters
    for s in range(len(bounds) - 1):
        z, z_c, z_s, z_w, z_k, z_0 = initial[s], 0.0, 0.0, 0.0, 0.0, 1.0
        before, bell_before, slope_before = 0.0, 0.0, 0.0
        for i in range(bounds[s], bounds[s + 1]):
            v, speed = velocity[i], abs(velocity[i])
            ratio = v / stribeck
            bell = math.exp(-ratio * ratio)
            g = coulomb + (static - coulomb) * bell
            g_c, g_s, g_w = 1.0 - bell, bell, (static - coulomb) * bell * 2.0 * ratio * ratio / stribeck
            if i == bounds[s]:
                before, bell_before, slope_before = g, bell, g_w
            if travel[i] != 0.0:
                sign, both = math.copysign(1.0, travel[i]), before + g
                widths = stiffness * abs(travel[i]) * 2.0 / both
                e = math.exp(-widths)
                mean = mean_decay(widths, e)
                bend = -0.5 + widths / 3.0 - widths * widths / 8.0  # derivative of mean by widths
                if widths > 1e-3:
                    bend = (e - mean) / widths
                by_widths = -z * e + sign * (before * (bend + e) - g * bend)
                first, second, stretch = sign * (mean - e), sign * (1.0 - mean), -by_widths * widths / both
                z_c = (
                    z_c * e + first * (1.0 - bell_before) + second * g_c + stretch * (1.0 - bell_before + g_c)
                )
                z_s = z_s * e + first * bell_before + second * g_s + stretch * (bell_before + g_s)
                z_w = z_w * e + first * slope_before + second * g_w + stretch * (slope_before + g_w)
                z_k = z_k * e + by_widths * widths / stiffness
                z_0 = z_0 * e
                z = z * e + first * before + second * g
            before, bell_before, slope_before = g, bell, g_w
            through = 1.0 - damping * speed / g
            direct = damping * speed * z / (g * g)
            out[i, 0] = z + damping * (v - speed * z / g) + viscous * v
            out[i, 1] = through * z_c + direct * g_c
            out[i, 2] = through * z_s + direct * g_s
            out[i, 3] = through * z_w + direct * g_w
            out[i, 4] = through * z_k
            out[i, 5] = v - speed * z / g
            out[i, 6] = v
            out[i, 7] = through * z_0


@njit(cache=True, error_model="numpy")
def decimate(columns: Any, centres: Any, taps: Any, out: Any) -> None:
    """Symmetric filter `taps` (2h + 1,) of `columns` (n, k) at samples `centres` (m,), h from any edge; `out` (m, k)."""
    half = len(taps) // 2
    for i in range(len(centres)):
        for k in range(columns.shape[1]):
            out[i, k] = 0.0
        for j in range(len(taps)):
            row = centres[i] - half + j
            for k in range(columns.shape[1]):
                out[i, k] += taps[j] * columns[row, k]
