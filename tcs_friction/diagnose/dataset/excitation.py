"""What a data set can carry: units that cannot be right are refused, and what it cannot show is said before anything is named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.diagnose.dataset.preprocessing import Conditioned
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance

MOVING = 3.0  # times the velocity noise
FEWEST = 20  # samples that move
SCARCE = 0.01  # share of the moving time in a direction that counts as none
ONE_SPEED = 1.5  # fastest over slowest speed
SHORT = 20.0  # s
FEW_REVERSALS = 4
ONE_SINUSOID = 0.98  # correlation of acceleration with position, reversed
STRAIGHT = 0.01  # rms of inertial torque over that of the torque
BLOCKS, QUARTERS = 32, 4  # of the data, interleaved

REVERSING = frozenset(
    {"coulomb_asymmetry", "viscous_asymmetry", "presliding", "cable_hysteresis", "backlash"}
)
SPEEDS = frozenset({"stribeck", "quadratic_drag", "viscous_asymmetry"})
ACCELERATING = frozenset(
    {"flexible_mode", "position_dependent_inertia", "actuator_lag", "transport_delay", "backlash"}
)
ELASTIC = frozenset({"cable_wrap", "imbalance", "position_dependent_inertia"})
SLOW = frozenset({"warmup_drift", "temperature_dependent_friction"})
WIRING = {57.29578: "degrees", 1.0 / 57.29578: "rad where the axis file has degrees"}
LINEAR_WIRING = {1e3: "mm", 1e-3: "m where the axis file has mm"}


@dataclass(frozen=True)
class Limit:
    """One thing that the data cannot show, in words, and the effects that it cannot be asked about."""

    line: str
    effects: frozenset[str] = frozenset()


def limits(data: Conditioned, axis: Axis) -> tuple[str, ...]:
    """What the data cannot carry, one line each; empty if it can carry a whole diagnosis."""
    return tuple(limit.line for limit in _found(data, axis))


def barred(data: Conditioned, axis: Axis) -> frozenset[str]:
    """Effects that no diagnosis of this data should name."""
    return frozenset().union(*(limit.effects for limit in _found(data, axis)))


def passed_once(data: Conditioned, effects: Sequence[Instance]) -> tuple[str, ...]:
    """One line for each found effect in a single place that the axis passed only once, held-out data included."""
    lines = []
    for item in effects:
        if item.term.local:
            near = [np.abs(s.position - item.values["centre"]) < item.values["width"] for s in data.stretches]
            if sum(map(passes, near)) == 1:
                name = item.term.id.replace("_", " ")
                lines.append(f"whether the {name} belongs to its place or to the moment at which the axis passed it, once")
    return tuple(lines)


def passes(inside: np.ndarray) -> int:
    """How often a series (n,) of answers whether the axis is somewhere turns to yes."""
    return int(np.count_nonzero(np.diff(inside, prepend=False) & inside))


def check_units(data: Conditioned, axis: Axis) -> None:
    """Refuse data without motion, a torque of the wrong sign and a position in another unit than the axis file's, in one line.

    Raises InputError. Judged by a plain balance of torque with acceleration, direction and speed, and only where every quarter
    of the data (interleaved blocks) that can tell agrees. A wrong guess of the inertia or an effort in ampere is no reason.
    """
    if len(_moving(data)) < FEWEST:
        raise InputError("signal position", "nothing but noise in it", "a recording in which the axis moves")
    count = len(data.joined("torque"))
    block = np.arange(count) * BLOCKS // count
    parts = [plain_balance(data, block % QUARTERS == k) for k in range(QUARTERS)]
    whole = plain_balance(data, block >= 0)
    sums = [part for part in (whole, *parts) if part is not None]
    if whole is None or len(sums) < 3:
        return
    inertia, level = whole
    if not all(0.5 < part[0] / inertia < 2.0 and 0.5 < part[1] / level < 2.0 for part in sums):
        return
    if inertia < 0.0 and level < 0.0:
        raise InputError(
            "signal torque", "it opposes every motion that it should drive", "the other sign (scale: -1.0)"
        )
    known = axis.friction.values.get("coulomb", 0.0)
    if inertia <= 0.0 or level <= 0.0 or not 0.4 < level / max(known, 1e-300) < 2.5:
        return
    ratio = axis.inertia / inertia  # how much larger the position is than it should be
    unit, wiring = ("rad", WIRING) if axis.kind == "rotary" else ("m", LINEAR_WIRING)
    for factor, name in wiring.items():
        if 0.5 < ratio / factor < 2.0:
            raise InputError(
                "signal position",
                f"it moves about {ratio:.2g} times as far as torque, friction and inertia allow ({name}?)",
                f"{unit}, or a scale in the signals block",
            )


def plain_balance(data: Conditioned, rows: np.ndarray) -> tuple[float, float] | None:
    """Inertia and dry friction by least squares; None where the motion does not determine both."""
    v, a, u = (data.joined(name)[rows] for name in ("velocity", "acceleration", "torque"))
    direction = np.tanh(v / max(MOVING * data.velocity_noise, 1e-300))
    columns = np.stack([a, direction, v, np.ones_like(v)], axis=1)
    norms = np.linalg.norm(columns, axis=0)
    if not (norms > 0.0).all():
        return None
    left, singular, right = np.linalg.svd(columns / norms, full_matrices=False)
    if singular[-1] < 0.02 * singular[0]:
        return None
    numbers = right.T @ ((left.T @ u) / singular)
    if (numbers[:2] ** 2 < 1e-3 * float(u @ u)).any():
        return None
    return float(numbers[0] / norms[0]), float(numbers[1] / norms[1])


def _found(data: Conditioned, axis: Axis) -> list[Limit]:
    moving = _moving(data)
    if len(moving) < FEWEST:
        return [
            Limit(
                "the axis hardly moves: nothing but torques at rest can be judged",
                SPEEDS | REVERSING | ACCELERATING,
            )
        ]
    return [
        *_direction(data, moving),
        *_speed(moving, axis),
        *_acceleration(data, axis),
        *_swing(data),
        *_extent(data, axis),
    ]


def _moving(data: Conditioned) -> np.ndarray:
    """Velocities that stand out of their noise."""
    velocity = data.joined("velocity")
    return np.asarray(velocity[np.abs(velocity) > MOVING * data.velocity_noise])


def _direction(data: Conditioned, moving: np.ndarray) -> list[Limit]:
    share = float(np.mean(moving > 0.0))
    if min(share, 1.0 - share) < SCARCE:
        way = "positive" if share > 0.5 else "negative"
        return [
            Limit(
                f"never reverses (moves in the {way} direction only): dry friction cannot be told from a constant torque, and "
                "direction, pre-sliding and backlash cannot be judged",
                REVERSING | {"torque_bias"},
            )
        ]
    reversals = count_reversals(data)
    if reversals < FEW_REVERSALS:
        word = "once" if reversals == 1 else f"{reversals} times"
        return [
            Limit(
                f"reverses only {word}: what happens at reversals can hardly be judged",
                frozenset({"presliding", "cable_hysteresis", "backlash"}),
            )
        ]
    return []


def count_reversals(data: Conditioned) -> int:
    """Changes of direction between samples that move, summed over the stretches."""
    total = 0
    for s in data.stretches:
        signs = np.sign(s.velocity[np.abs(s.velocity) > MOVING * data.velocity_noise])
        total += int(np.count_nonzero(np.diff(signs)))
    return total


def _speed(moving: np.ndarray, axis: Axis) -> list[Limit]:
    slow, fast = np.percentile(np.abs(moving), [10, 98])
    if fast > ONE_SPEED * slow:
        return []
    unit = unit_of("velocity", axis.kind)
    return [
        Limit(
            f"moves at one speed only ({fast:.3g} {unit}): viscous cannot be told from dry friction, and how friction depends on "
            "speed cannot be judged",
            SPEEDS,
        )
    ]


def _acceleration(data: Conditioned, axis: Axis) -> list[Limit]:
    acceleration, torque = data.joined("acceleration"), data.joined("torque")
    noise = data.velocity_noise * 2.0 * math.pi * data.cutoff * math.sqrt(0.6)
    inertial = axis.inertia * float(np.sqrt(np.mean(acceleration**2)))
    size = float(np.sqrt(np.mean(torque**2)))
    if inertial > STRAIGHT * size and inertial > 2.0 * axis.inertia * noise:
        return []
    return [
        Limit(
            "hardly accelerates: the inertia is not determined, and resonances, delays and lags cannot be judged",
            ACCELERATING,
        )
    ]


def _swing(data: Conditioned) -> list[Limit]:
    position, acceleration = data.joined("position"), data.joined("acceleration")
    if -float(np.corrcoef(position, acceleration)[0, 1]) < ONE_SINUSOID:
        return []
    return [
        Limit(
            "swings like one sinusoid, whose acceleration follows its position: springs and gravity cannot be told from inertia",
            ELASTIC,
        )
    ]


def _extent(data: Conditioned, axis: Axis) -> list[Limit]:
    result = []
    duration = sum(float(s.t[-1] - s.t[0]) for s in data.stretches)
    if duration < SHORT:
        result.append(Limit(f"lasts only {duration:.3g} s: slow changes cannot be judged", SLOW))
    turn = 2.0 * math.pi
    travel = float(np.ptp(data.joined("position")))
    if axis.kind == "rotary" and travel < 0.5 * turn:
        result.append(
            Limit(
                f"covers {travel / turn:.2g} of a turn: what repeats once or twice a turn cannot be told from a slope over "
                "the position",
                frozenset({"position_dependent_inertia"} if travel < 0.1 * turn else ()),
            )
        )
    return result
