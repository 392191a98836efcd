"""The formulas of the references, compiled: parameters and time to position, speed and acceleration."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Sample = tuple[float, float, float]

EARTH_RADIUS = 6.371e6
"""Mean radius, m (IUGG)."""
EARTH_GRAVITY = 3.986004418e14
"""Gravitational parameter, m^3/s^2 (WGS 84)."""
SIDEREAL_RATE = 7.292115e-5
"""The Earth's rate of rotation, rad/s (WGS 84)."""

_SAMPLE = "UniTuple(f8, 3)(f8[::1], f8)"


@njit(_SAMPLE, cache=True)
def _hold(parameters: Array, t: float) -> Sample:  # noqa: ARG001 one signature for all kinds
    return parameters[0], 0.0, 0.0


@njit(_SAMPLE, cache=True)
def _constant_speed(parameters: Array, t: float) -> Sample:
    velocity, start = parameters[0], parameters[1]
    return start + velocity * t, velocity, 0.0


@njit(_SAMPLE, cache=True)
def _sinusoid(parameters: Array, t: float) -> Sample:
    amplitude, rate, phase, center = parameters[0], parameters[1], parameters[2], parameters[3]
    swing = amplitude * math.sin(rate * t + phase)
    return center + swing, amplitude * rate * math.cos(rate * t + phase), -rate * rate * swing


@njit(_SAMPLE, cache=True)
def _multisine(parameters: Array, t: float) -> Sample:
    amplitude, lowest, step, count, center = (
        parameters[0],
        parameters[1],
        parameters[2],
        int(parameters[3]),
        parameters[4],
    )
    position, velocity, acceleration = center + parameters[5] * t, parameters[5], 0.0
    for k in range(count):
        rate = lowest + k * step
        angle = rate * t - math.pi * k * (k + 1) / count  # Schroeder 1970
        position += amplitude / rate * math.sin(angle)
        velocity += amplitude * math.cos(angle)
        acceleration -= amplitude * rate * math.sin(angle)
    return position, velocity, acceleration


@njit(_SAMPLE, cache=True)
def _swept_sine(parameters: Array, t: float) -> Sample:
    amplitude, lowest, growth, sweep, center = (
        parameters[0],
        parameters[1],
        parameters[2],
        parameters[3],
        parameters[4],
    )
    swept = min(t, sweep)
    rate = lowest * math.exp(growth * swept)
    bend, jerk = (growth * rate, growth * growth * rate) if t < sweep else (0.0, 0.0)
    stretch = (
        math.expm1(growth * swept) / growth if growth * swept != 0.0 else swept
    )  # s, that the angle has run at `lowest`
    angle = lowest * stretch + rate * (t - swept)
    # position = center - amplitude/rate cos(angle); its derivatives with the slowly changing rate's own
    radius = amplitude / rate
    slope = -radius * bend / rate
    curve = -slope * bend / rate - radius * (jerk / rate - bend * bend / (rate * rate))
    position = center + parameters[5] * t - radius * math.cos(angle)
    velocity = parameters[5] - slope * math.cos(angle) + radius * rate * math.sin(angle)
    acceleration = -curve * math.cos(angle) + 2.0 * slope * rate * math.sin(angle)
    acceleration += radius * (bend * math.sin(angle) + rate * rate * math.cos(angle))
    return position, velocity, acceleration


@njit(_SAMPLE, cache=True)
def _steps(parameters: Array, t: float) -> Sample:
    start, height, dwell, count = parameters[0], parameters[1], parameters[2], int(parameters[3])
    phase = math.floor(t / dwell) % (2 * count)
    level = phase if phase <= count else 2 * count - phase
    return start + height * level, 0.0, 0.0


@njit(_SAMPLE, cache=True)
def _turn(parameters: Array, t: float) -> Sample:
    """A reversal from -speed to +speed around t = 0: offset from its middle, speed, acceleration."""
    turn, peak = parameters[2], parameters[3]
    rate = 2.0 * math.pi / turn
    velocity = 0.5 * peak * (t + math.sin(rate * t) / rate)
    position = 0.5 * peak * (0.5 * t * t + (1.0 - math.cos(rate * t)) / (rate * rate))
    return position, velocity, 0.5 * peak * (1.0 + math.cos(rate * t))


@njit(_SAMPLE, cache=True)
def _legs(parameters: Array, t: float) -> Sample:
    speed, leg, turn, start = parameters[0], parameters[1], parameters[2], parameters[4]
    half = leg + turn
    count = math.floor(t / half + 0.5)
    since = t - count * half  # from the middle of the nearest reversal
    way = 1.0 if int(count) % 2 == 0 else -1.0  # even reversals turn to positive speed
    inner = min(max(since, -0.5 * turn), 0.5 * turn)
    position, velocity, acceleration = _turn(parameters, inner)
    edge = abs(since) - 0.5 * turn
    if edge > 0.0:
        position += speed * edge
        velocity, acceleration = math.copysign(speed, since), 0.0
    top = 2.0 * _turn(parameters, 0.5 * turn)[0] + speed * leg  # between the two places of reversal
    base = start if way > 0.0 else start + top
    return base + way * position, way * velocity, way * acceleration


@njit("UniTuple(f8, 3)(f8, f8, f8, f8, f8, f8)", cache=True)
def _bearing(x: float, y: float, vx: float, vy: float, ax: float, ay: float) -> Sample:
    """Angle atan2(x, y) with its first and second derivative."""
    square = x * x + y * y
    cross = vx * y - x * vy
    rate = cross / square
    change = ((ax * y - x * ay) - 2.0 * rate * (x * vx + y * vy)) / square
    return math.atan2(x, y), rate, change


@njit("UniTuple(f8, 3)(f8, f8, f8, f8, f8, f8, f8, f8, f8)", cache=True)
def _elevation(
    x: float, y: float, z: float, vx: float, vy: float, vz: float, ax: float, ay: float, az: float
) -> Sample:
    """Elevation atan2(z, hypot(x, y)) with its first and second derivative."""
    ground = math.sqrt(x * x + y * y)
    slope = (x * vx + y * vy) / ground
    curve = (vx * vx + vy * vy + x * ax + y * ay - slope * slope) / ground
    result: Sample = _bearing(z, ground, vz, slope, az, curve)
    return result


@njit(_SAMPLE, cache=True)
def _satellite_pass(parameters: Array, t: float) -> Sample:
    """Station at EARTH_RADIUS on the z axis; the track runs along x and passes z at the angle `central`."""
    radius, rate, central = parameters[1], parameters[2], parameters[3]
    angle = rate * (t - parameters[4])
    s, c = radius * math.sin(angle), radius * math.cos(angle)
    side, up = math.sin(central), math.cos(central)
    x, vx, ax = s, rate * c, -rate * rate * s
    y, vy, ay = side * c, -side * rate * s, -side * rate * rate * c
    z, vz, az = up * c - EARTH_RADIUS, -up * rate * s, -up * rate * rate * c
    if parameters[0] == 0.0:
        bearing, velocity, acceleration = _bearing(x, y, vx, vy, ax, ay)
        return parameters[5] + bearing, velocity, acceleration
    result: Sample = _elevation(x, y, z, vx, vy, vz, ax, ay, az)
    return result


@njit(_SAMPLE, cache=True)
def _sidereal_track(parameters: Array, t: float) -> Sample:
    """Meeus, Astronomical Algorithms, ch. 13, as a vector (east, north, up)."""
    hour = parameters[1] + SIDEREAL_RATE * t
    declination, latitude = parameters[2], parameters[3]
    w = SIDEREAL_RATE
    ring, pole = math.cos(declination), math.sin(declination)
    s, c = ring * math.sin(hour), ring * math.cos(hour)
    across, along = math.cos(latitude), math.sin(latitude)
    east, north, up = -s, pole * across - along * c, pole * along + across * c
    v_east, v_north, v_up = -w * c, along * w * s, -across * w * s
    a_east, a_north, a_up = w * w * s, along * w * w * c, -across * w * w * c
    if parameters[0] != 0.0:
        result: Sample = _elevation(east, north, up, v_east, v_north, v_up, a_east, a_north, a_up)
        return result
    # The jump of atan2 is laid where the star passes its lower culmination, and undone there.
    days = math.floor((hour + math.pi) / (2.0 * math.pi))
    if declination < latitude:  # culminates south of the zenith
        bearing, velocity, acceleration = _bearing(-east, -north, -v_east, -v_north, -a_east, -a_north)
        turns = days if latitude >= 0.0 else 0.0
        return math.pi + bearing + 2.0 * math.pi * turns, velocity, acceleration
    bearing, velocity, acceleration = _bearing(east, north, v_east, v_north, a_east, a_north)
    turns = 0.0 if latitude >= 0.0 else -days
    return bearing + 2.0 * math.pi * turns, velocity, acceleration


@njit("UniTuple(f8, 3)(i8, f8[::1], f8)", cache=True)
def sample(code: int, parameters: Array, t: float) -> Sample:
    """Position, speed, acceleration at time t (s) of the reference with this code, in the order of KINDS."""
    result: Sample
    if code == 0:
        result = _hold(parameters, t)
    elif code == 1:
        result = _constant_speed(parameters, t)
    elif code == 2:
        result = _sinusoid(parameters, t)
    elif code == 3:
        result = _multisine(parameters, t)
    elif code == 4:
        result = _swept_sine(parameters, t)
    elif code == 5:
        result = _steps(parameters, t)
    elif code == 6:
        result = _legs(parameters, t)
    elif code == 7:
        result = _satellite_pass(parameters, t)
    else:
        result = _sidereal_track(parameters, t)
    return result


@njit("UniTuple(f8, 3)(i8, f8[::1], f8[:, ::1], f8)", cache=True)
def shaped(code: int, parameters: Array, impulses: Array, t: float) -> Sample:
    """`sample`, shaped by impulses (n, 2) of weight and delay (s); before time 0 a shaped reference rests where it begins."""
    if impulses.shape[0] == 0:
        plain: Sample = sample(code, parameters, t)
        return plain
    position = velocity = acceleration = 0.0
    begin = sample(code, parameters, 0.0)[0]
    for i in range(impulses.shape[0]):
        weight, since = impulses[i, 0], t - impulses[i, 1]
        if since < 0.0:
            position += weight * begin
        else:
            at = sample(code, parameters, since)
            position += weight * at[0]
            velocity += weight * at[1]
            acceleration += weight * at[2]
    return position, velocity, acceleration


@njit("f8[:, ::1](i8, f8[::1], f8[:, ::1], f8[::1])", cache=True)
def shaped_all(code: int, parameters: Array, impulses: Array, times: Array) -> Array:
    """Shape (n, 3): `shaped` at each time."""
    samples = np.empty((times.size, 3))
    for i in range(times.size):
        samples[i] = shaped(code, parameters, impulses, times[i])
    return samples
