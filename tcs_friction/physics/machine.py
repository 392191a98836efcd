"""The compiled axis: terms packed into arrays, the integration step and the evaluation of a recording.

Both loops call the same kernels. Integration is a leapfrog: positions and velocities at step ends, kernels called once a step at
the middle, where the velocity is extrapolated with the acceleration before; second order for smooth torques, and the
bristles' own step is exact in the travel between two middles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from tcs_friction.physics.axis import Axis
from tcs_friction.physics.calling import addresses, call_kernel
from tcs_friction.physics.terms import (
    ACCELERATION,
    ARREST,
    CYCLE,
    DRY,
    DRY_SCALE,
    EXTRA_LEVEL,
    INERTIA,
    LEVEL,
    MOBILISED,
    POSITION,
    TEMPERATURE,
    TIME,
    TORQUE,
    TRAVEL,
    VELOCITY,
    VISCOUS,
    VISCOUS_SCALE,
    Instance,
    Place,
    rate_at,
    set_surroundings,
    signal_slot,
)

# Slots of Machine.body
(
    TRUE_POSITION,
    TRUE_VELOCITY,
    TRUE_ACCELERATION,
    OTHERS,
    CLOCK,
    NOISE,
    MEASURED,
    MEASURED_VELOCITY,
    FRICTION,
    LAST_MIDDLE,
) = range(10)
# Slots of Machine.constants
(
    MASS,
    PHASE_PER_UNIT,
    TORQUE_LIMIT,
    NOISE_GAIN,
    NOISE_DECAY,
    RESOLUTION,
    ENCODER_NOISE,
    VELOCITY_DECAY,
    STEP,
    SUBSTEPS,
    LEVEL_PLACE,  # of the law's level among all parameters; -1 without a law
) = range(11)


PLACES = tuple(Place)


class Machine(NamedTuple):
    """An axis as the compiled loops want it. Arrays are live: `states`, `body` and `motion` change as it runs."""

    kernels: np.ndarray  # (k,) addresses of the kernels in the order they act
    ends: np.ndarray  # (6,) where each place's kernels end in that list
    parameters: np.ndarray  # all kernels' parameters
    parameter_ends: np.ndarray  # (k + 1,)
    states: np.ndarray  # all kernels' states
    state_ends: np.ndarray  # (k + 1,)
    motion: np.ndarray  # (EXOGENOUS + PER_SIGNAL signals,)
    body: np.ndarray  # (10,)
    constants: np.ndarray  # (11,)


def build(
    axis: Axis,
    dt: float,
    substeps: int = 1,
    signals: tuple[str, ...] = (),
    position: float = 0.0,
    terms: Sequence[Instance] | None = None,
) -> Machine:
    """Pack an axis for instants `dt` (s) apart, of which `substeps` make a control period.

    It starts at rest at `position` (rad), which the encoder has seen already. `terms` are only some of the axis' own, in their
    order, for `evaluate`.
    """
    terms = axis.terms if terms is None else terms
    kernels = addresses([item.term.kernel for item in terms])
    places = [item.term.place for item in terms]
    packed = [item.packed(signals) for item in terms]
    sizes = [item.term.state_size(item.values, dt) for item in terms]
    period = dt * substeps
    decay = math.exp(-2.0 * math.pi * axis.drive.noise_bandwidth * period)
    bandwidth = axis.sensors.velocity_bandwidth
    constants = np.array(
        [
            axis.inertia,
            axis.cycle,
            axis.drive.limit,
            axis.drive.noise * math.sqrt(1.0 - decay * decay),
            decay,
            axis.sensors.resolution,
            axis.sensors.noise,
            math.exp(-2.0 * math.pi * bandwidth * period) if bandwidth > 0.0 else 0.0,
            dt,
            float(substeps),
            float(_level_place(terms, packed)),
        ]
    )
    motion = np.zeros(signal_slot(len(signals)))
    motion[POSITION], motion[CYCLE], motion[INERTIA], motion[TEMPERATURE] = (
        position,
        axis.cycle,
        axis.inertia,
        20.0,
    )
    body = np.zeros(10)
    body[TRUE_POSITION] = body[MEASURED] = body[LAST_MIDDLE] = position
    for item, values, size in zip(terms, packed, sizes, strict=True):
        if item.term.place is Place.SENSOR:
            body[MEASURED] += item.term.kernel(motion, values, np.zeros(size), dt)
    return Machine(
        kernels,
        np.array([*accumulate(places.count(place) for place in PLACES)], np.int64),
        np.concatenate([*packed, np.zeros(0)]),
        np.array([0, *accumulate(len(p) for p in packed)], np.int64),
        np.zeros(sum(sizes)),
        np.array([0, *accumulate(sizes)], np.int64),
        motion,
        body,
        constants,
    )


def _level_place(terms: Sequence[Instance], packed: Sequence[np.ndarray]) -> int:
    """Where the law's level is among all the packed parameters, -1 without a law."""
    before = 0
    for item, values in zip(terms, packed, strict=True):
        if item.term.place is Place.LAW:
            return before + item.term.parameters.index(item.term.level)
        before += len(values)
    return -1


@njit(cache=True, error_model="numpy", inline="always")
def call_term(m: Machine, k: int, dt: float) -> float:
    """One kernel on its own slice of parameters and states."""
    parameters = m.parameters[m.parameter_ends[k] : m.parameter_ends[k + 1]]
    state = m.states[m.state_ends[k] : m.state_ends[k + 1]]
    return float(call_kernel(m.kernels[k], m.motion, parameters, state, dt))


@njit(cache=True, error_model="numpy", inline="always")
def torques(m: Machine, dt: float) -> tuple[float, float]:
    """Friction and other opposing torque at the instant in `m.motion`, N m."""
    friction, opposing = 0.0, 0.0
    m.motion[EXTRA_LEVEL], m.motion[DRY_SCALE], m.motion[VISCOUS_SCALE] = 0.0, 1.0, 1.0
    for k in range(m.ends[0], m.ends[2]):
        friction += call_term(m, k, dt)
    for k in range(m.ends[2], m.ends[4]):
        opposing += call_term(m, k, dt)
    return friction, opposing


@njit(cache=True, error_model="numpy", inline="always")
def rotor_torque(m: Machine, torque: float, dt: float) -> float:
    """What the drive's terms make of a torque (N m) at the instant in `m.motion`, where it is left as TORQUE."""
    m.motion[TORQUE] = torque
    for k in range(m.ends[0]):
        m.motion[TORQUE] = call_term(m, k, dt)
    return float(m.motion[TORQUE])


@njit(cache=True, error_model="numpy", inline="always")
def advance(m: Machine, torque: float) -> None:
    """One integration step under a commanded torque (N m)."""
    motion, body, dt = m.motion, m.body, m.constants[STEP]
    position, velocity = body[TRUE_POSITION], body[TRUE_VELOCITY]
    middle = velocity + 0.5 * dt * body[TRUE_ACCELERATION]
    if middle * velocity < 0.0:
        middle = 0.0
    motion[TIME] = body[CLOCK] + 0.5 * dt
    motion[POSITION] = position + 0.5 * dt * velocity
    motion[VELOCITY] = middle
    motion[TRAVEL] = motion[POSITION] - body[LAST_MIDDLE]
    body[LAST_MIDDLE] = motion[POSITION]
    motion[INERTIA] = m.constants[MASS]
    rotor_torque(m, torque, dt)
    motion[ARREST] = m.constants[MASS] * velocity / dt + motion[TORQUE] - body[OTHERS]
    friction, opposing = torques(m, dt)
    acceleration = (motion[TORQUE] - friction - opposing) / motion[INERTIA]
    body[OTHERS] = opposing
    body[FRICTION] = friction
    body[TRUE_ACCELERATION] = acceleration
    body[TRUE_VELOCITY] = velocity + dt * acceleration
    body[TRUE_POSITION] = position + dt * velocity + 0.5 * dt * dt * acceleration
    body[CLOCK] += dt


@njit(cache=True, error_model="numpy", inline="always")
def drive(m: Machine, command: float, torque_normal: float) -> float:
    """Begin a control period: returns the torque that the drive is told to apply, N m; body[NOISE] is what comes on top."""
    body, constants = m.body, m.constants
    limit = constants[TORQUE_LIMIT]
    body[NOISE] = constants[NOISE_DECAY] * body[NOISE] + constants[NOISE_GAIN] * torque_normal
    return float(min(max(command, -limit), limit))


@njit(cache=True, error_model="numpy", inline="always")
def measure(m: Machine, encoder_normal: float) -> None:
    """End a control period: what the encoder says of the true position."""
    body, constants = m.body, m.constants
    m.motion[POSITION] = body[TRUE_POSITION]
    position = body[TRUE_POSITION] + constants[ENCODER_NOISE] * encoder_normal
    for k in range(m.ends[4], m.ends[5]):
        position += call_term(m, k, constants[STEP])
    if constants[RESOLUTION] > 0.0:
        position = constants[RESOLUTION] * math.floor(position / constants[RESOLUTION] + 0.5)
    raw = (position - body[MEASURED]) / (constants[STEP] * constants[SUBSTEPS])
    decay = constants[VELOCITY_DECAY]
    body[MEASURED_VELOCITY] = decay * body[MEASURED_VELOCITY] + (1.0 - decay) * raw
    body[MEASURED] = position


@njit(cache=True, error_model="numpy")
def tick(m: Machine, command: float, torque_normal: float, encoder_normal: float) -> float:
    """One control period: hold the command over the substeps, then measure.

    Returns the torque that the drive was told to apply, N m.
    """
    applied = drive(m, command, torque_normal)
    for _ in range(int(m.constants[SUBSTEPS])):
        advance(m, applied + m.body[NOISE])
    measure(m, encoder_normal)
    return applied


@njit(cache=True, error_model="numpy")
def begin_period(m: Machine, command: float, torque_normal: float, out: Any) -> float:
    """`tick` where the motion is integrated elsewhere, first half: `out` (substeps,) gets the torque at the rotor in each, N m.

    Returns the torque that the drive was told to apply, N m.
    """
    applied = drive(m, command, torque_normal)
    for i in range(len(out)):
        out[i] = rotor_torque(m, applied + m.body[NOISE], m.constants[STEP])
    return applied


@njit(cache=True, error_model="numpy")
def end_period(m: Machine, position: float, velocity: float, opposing: float, encoder_normal: float) -> None:
    """Second half: the true position (rad), velocity (rad/s) and opposing torque (N m) that the period has ended with."""
    body = m.body
    body[TRUE_POSITION], body[TRUE_VELOCITY], body[OTHERS] = position, velocity, opposing
    body[CLOCK] += m.constants[STEP] * m.constants[SUBSTEPS]
    measure(m, encoder_normal)


@njit(cache=True, error_model="numpy")
def run(m: Machine, torque: Any, out: Any) -> None:
    """Open loop: `torque` (n,) a control period each; `out` (n, 4): true position, velocity, friction, other opposing torque."""
    for i in range(len(torque)):
        for _ in range(int(m.constants[SUBSTEPS])):
            advance(m, torque[i])
        out[i, 0] = m.body[TRUE_POSITION]
        out[i, 1] = m.body[TRUE_VELOCITY]
        out[i, 2] = m.body[FRICTION]
        out[i, 3] = m.body[OTHERS]


# Columns of what `evaluate` writes
REQUIRED, ROTOR, DRY_PART, VISCOUS_PART, AVAILABLE, SHARE, OPPOSED, MOVED = range(8)


@njit(cache=True, error_model="numpy", inline="always")
def sensor_error(m: Machine, k: int, q: float, dt: float) -> tuple[float, float, float]:
    """A sensor term's error at a position, its slope and its curvature over the position."""
    motion = m.motion
    step = 1e-6 * 2.0 * math.pi / m.constants[PHASE_PER_UNIT]
    motion[POSITION] = q - step
    before = call_term(m, k, dt)
    motion[POSITION] = q + step
    after = call_term(m, k, dt)
    motion[POSITION] = q
    here = call_term(m, k, dt)
    return here, (after - before) / (2.0 * step), (after - 2.0 * here + before) / (step * step)


@njit(cache=True, error_model="numpy", inline="always")
def true_instant(m: Machine, q: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration behind measured ones: the sensor terms' errors taken away."""
    error, slope, curve = 0.0, 0.0, 0.0
    for k in range(m.ends[4], m.ends[5]):
        own = sensor_error(m, k, q, dt)
        error += own[0]
        slope += own[1]
        curve += own[2]
    return q - error, v - slope * v, a - slope * a - curve * v * v


@njit(cache=True, error_model="numpy", nogil=True)
def true_motion(m: Machine, dt: float, motion: Any, out: Any) -> None:
    """Measured `motion` (3, n), position, velocity and acceleration, as it is without the sensor terms' errors."""
    for i in range(motion.shape[1]):
        m.motion[TRAVEL] = motion[0, i] - motion[0, i - 1] if i > 0 else 0.0
        out[0, i], out[1, i], out[2, i] = true_instant(m, motion[0, i], motion[1, i], motion[2, i], dt)


@njit(cache=True, error_model="numpy", inline="always")
def measured_instant(
    m: Machine, t: float, dt: float, position: float, velocity: float, acceleration: float, signals: Any, i: int
) -> float:
    """Set `m.motion` to a measured instant, `dt` (s) after the one before; returns the true acceleration."""
    motion = m.motion
    q, v, a = true_instant(m, position, velocity, acceleration, dt)
    motion[TIME] = t
    motion[TRAVEL] = 0.5 * (v + motion[VELOCITY]) * dt
    motion[POSITION] = q
    motion[VELOCITY] = v
    motion[ACCELERATION] = a
    motion[INERTIA] = m.constants[MASS]
    for s in range(signals.shape[0]):
        set_surroundings(motion, s, signals[s, i], rate_at(signals[s], i, dt))
    return float(a)


@njit(cache=True, error_model="numpy", inline="always")
def arrest_per_speed(m: Machine, resolution: float) -> float:
    """How steeply the torque that would arrest the axis grows with its speed, N m s/rad."""
    place = int(m.constants[LEVEL_PLACE])
    return float(m.parameters[place] / resolution) if place >= 0 else 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def evaluate(
    m: Machine,
    t: Any,
    position: Any,
    velocity: Any,
    acceleration: Any,
    torque: Any,
    signals: Any,
    resolution: float,
    out: Any,
) -> None:
    """Walk through a measured motion. Shapes (n,); `signals` (s, n) holds temperature, then the exogenous signals.

    `resolution` is the velocity (rad/s) below which the direction of motion is not known. `out` (n, 8) is in N m
    unless said: torque that the motion requires at the rotor, torque the drive gives there, dry and viscous friction,
    available dry friction, its mobilised share (1), opposing torque of effects, moving inertia (kg m^2).
    """
    motion = m.motion
    slope = arrest_per_speed(m, resolution)
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        a = measured_instant(m, t[i], dt, position[i], velocity[i], acceleration[i], signals, i)
        motion[ARREST] = slope * motion[VELOCITY]
        rotor_torque(m, torque[i], dt)
        friction, opposing = torques(m, dt)
        out[i, REQUIRED] = motion[INERTIA] * a + friction + opposing
        out[i, ROTOR] = motion[TORQUE]
        out[i, DRY_PART] = motion[DRY]
        out[i, VISCOUS_PART] = motion[VISCOUS]
        out[i, AVAILABLE] = motion[LEVEL]
        out[i, SHARE] = motion[MOBILISED]
        out[i, OPPOSED] = opposing
        out[i, MOVED] = motion[INERTIA]


@njit(cache=True, error_model="numpy", nogil=True)
def evaluate_demand(
    m: Machine,
    t: Any,
    motion: Any,
    torque: Any,
    signals: Any,
    resolution: float,
    resting: Any,
    holding: Any,
    out: Any,
) -> None:
    """What the terms add to the torque that a true motion (3, n) requires, `out` (n,), N m; others as for `evaluate`.

    `torque` is that at the rotor. Where the axis is `resting` (n,), the torque that holds it is `holding` (n,), N m.
    """
    at = m.motion
    slope = arrest_per_speed(m, resolution)
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        a = measured_instant(m, t[i], dt, motion[0, i], motion[1, i], motion[2, i], signals, i)
        at[ARREST] = holding[i] if resting[i] else slope * at[VELOCITY]
        at[TORQUE] = torque[i]
        friction, opposing = torques(m, dt)
        out[i] = (at[INERTIA] - m.constants[MASS]) * a + friction + opposing


@njit(cache=True, error_model="numpy", nogil=True)
def evaluate_drive(m: Machine, t: Any, motion: Any, torque: Any, signals: Any, out: Any) -> None:
    """Torque at the rotor (n,), N m, that the drive gives of a logged one; arguments as for `evaluate_demand`."""
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        measured_instant(m, t[i], dt, motion[0, i], motion[1, i], motion[2, i], signals, i)
        out[i] = rotor_torque(m, torque[i], dt)
