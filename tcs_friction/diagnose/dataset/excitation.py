"""What a data set can carry: what it cannot show is said before anything is named."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.diagnose.dataset.coordinates import unit_of
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Instance, Need

FEWEST_MOVING = 20  # samples that move
SCARCE = 0.01  # share of the moving time in a direction that counts as none
ONE_SPEED = 1.5  # fastest over slowest speed
SHORT = 20.0  # s
FEW_REVERSALS = 4
ONE_SINUSOID = 0.98  # correlation of acceleration with position, reversed
AVERAGED, OF_A_PERIOD = 1.0, 40.0  # s, and parts of a period at most, over which both are averaged for it
TENTH = 0.1  # of a turn of travel
BUILT_UP = 3.0  # bristle deflections, after which 95 % of the friction is built up in the new direction
SEEN = 6.0  # standard deviations of the position's noise, that a motion one way must cover to be one
STRAIGHT = 0.01  # rms of inertial torque over that of the torque
FASTER = 2.0  # times the fastest speed seen: the most that a next motion is asked for, so that a named model has to hold there


@dataclass(frozen=True)
class Limit:
    """One thing that the data cannot show, in words, and what effects may need that it lacks."""

    line: str
    lacking: frozenset[Need] = frozenset()


def limits(data: DataSet, axis: Axis) -> tuple[str, ...]:
    """What the data cannot carry, one line each; empty if it can carry a whole diagnosis."""
    return tuple(limit.line for limit in _found(data, axis))


def lacking(data: DataSet, axis: Axis) -> frozenset[Need]:
    """What effects may need and this data does not have."""
    return frozenset[Need]().union(*(limit.lacking for limit in _found(data, axis)))


def barred(lacks: frozenset[Need]) -> frozenset[str]:
    """Effects that no diagnosis of data that lacks this should name."""
    return frozenset(name for name, term in effects().items() if term.needs & lacks)


def passed_once(data: DataSet, found: Sequence[Instance]) -> tuple[str, ...]:
    """One line for each found effect in a single place that the axis passed only once, held-out data included."""
    lines = []
    for item in found:
        place = item.term.local
        if place is not None:
            centre, width = item.values[place.centre], item.values[place.width]
            near = [np.abs(s.position - centre) < width for s in data.stretches]
            if sum(map(passes, near)) == 1:
                name = item.term.words
                lines.append(f"whether the {name} belongs to its place or to the moment at which the axis passed it, once")
    return tuple(lines)


def passes(inside: np.ndarray) -> int:
    """How often a series (n,) of answers whether the axis is somewhere turns to yes."""
    return int(np.count_nonzero(np.diff(inside, prepend=False) & inside))


def turns(data: DataSet, bristle: float) -> tuple[tuple[float, float], ...]:
    """When the axis turns back, s: from its last motion one way until friction is built up the other way.

    bristle: travel (rad) in which friction builds up. Motion one way that does not cover it does not count.
    """
    return tuple(turn for s in data.stretches for turn in _turns_of(data, s, bristle))


def _turns_of(data: DataSet, s: Stretch, bristle: float) -> list[tuple[float, float]]:
    moving = np.flatnonzero(np.abs(s.velocity) > data.speed_threshold)
    ways = np.sign(s.velocity[moving])
    least = max(BUILT_UP * bristle, SEEN * data.position_noise)
    legs: list[np.ndarray] = []
    for leg in np.split(moving, np.flatnonzero(np.diff(ways)) + 1):
        if len(leg) == 0 or abs(s.position[leg[-1]] - s.position[leg[0]]) < least:
            continue
        if legs and s.velocity[legs[-1][0]] * s.velocity[leg[0]] > 0.0:
            legs[-1] = np.concatenate([legs[-1], leg])
        else:
            legs.append(leg)
    found = []
    for one, other in itertools.pairwise(legs):
        built = np.abs(s.position[other] - s.position[other[0]]) >= BUILT_UP * bristle
        found.append((float(s.t[one[-1]]), float(s.t[other[int(np.argmax(built))]])))
    return found


def period(data: DataSet, axis: Axis) -> float:
    """Time (s) in which the motion usually comes back to where it was: it turns back twice, or goes round once; inf if never.

    A stretch that turns back once does not say how soon it will again: not before its end.
    """
    between: list[float] = []
    for s in data.stretches:
        times = [0.5 * (begin + end) for begin, end in _turns_of(data, s, axis.bristle)]
        if len(times) == 1:
            times = [float(s.t[0]), *times, float(s.t[-1])]
        between += np.diff(times).tolist()
    if between:
        return 2.0 * float(np.median(between))
    around = sum(float(np.ptp(s.position)) for s in data.stretches) / (2.0 * math.pi) if axis.kind == "rotary" else 0.0
    return sum(float(np.ptp(s.t)) for s in data.stretches) / around if around >= 1.0 else math.inf


def _found(data: DataSet, axis: Axis) -> list[Limit]:
    moving = _moving(data)
    if len(moving) < FEWEST_MOVING:
        return [
            Limit(
                "the axis hardly moves: nothing but torques at rest can be judged",
                frozenset({Need.MOTION, Need.REVERSALS, Need.SPEEDS, Need.ACCELERATION}),
            )
        ]
    return [
        *_direction(data, moving),
        *_speed(moving, axis),
        *_acceleration(data, axis),
        *_swing(data, axis),
        *_extent(data, axis),
    ]


def _moving(data: DataSet) -> np.ndarray:
    """Velocities that stand out of their noise."""
    velocity = data.joined("velocity")
    return np.asarray(velocity[data.moving()])


def _direction(data: DataSet, moving: np.ndarray) -> list[Limit]:
    share = float(np.mean(moving > 0.0))
    if min(share, 1.0 - share) < SCARCE:
        way = "positive" if share > 0.5 else "negative"
        return [
            Limit(
                f"never reverses (moves in the {way} direction only): dry friction cannot be told from a constant torque, "
                "nor its change over the position from a torque's, and direction, pre-sliding and backlash cannot be judged",
                frozenset({Need.BOTH_DIRECTIONS, Need.REVERSALS}),
            )
        ]
    reversals = count_reversals(data)
    if reversals < FEW_REVERSALS:
        word = "once" if reversals == 1 else f"{reversals} times"
        return [
            Limit(
                f"reverses only {word}: what happens at reversals can hardly be judged",
                frozenset({Need.REVERSALS}),
            )
        ]
    return []


def count_reversals(data: DataSet) -> int:
    """Changes of direction between samples that move, summed over the stretches."""
    total = 0
    for s in data.stretches:
        signs = np.sign(s.velocity[np.abs(s.velocity) > data.speed_threshold])
        total += int(np.count_nonzero(np.diff(signs)))
    return total


def _speed(moving: np.ndarray, axis: Axis) -> list[Limit]:
    slow, fast = np.percentile(np.abs(moving), [10, 98])
    if fast > ONE_SPEED * slow:
        return []
    unit = unit_of("velocity", axis)
    return [
        Limit(
            f"moves at one speed only ({fast:.3g} {unit}): viscous cannot be told from dry friction, and how friction depends on "
            "speed cannot be judged",
            frozenset({Need.SPEEDS}),
        )
    ]


def _acceleration(data: DataSet, axis: Axis) -> list[Limit]:
    acceleration, torque = data.joined("acceleration"), data.joined("torque")[~data.untouched]
    noise = data.velocity_noise * 2.0 * math.pi * data.cutoff * math.sqrt(0.6)
    inertial = axis.inertia * float(np.sqrt(np.mean(acceleration**2)))
    size = float(np.sqrt(np.mean(torque**2)))
    if inertial > STRAIGHT * size and inertial > 2.0 * axis.inertia * noise:
        return []
    return [
        Limit(
            "hardly accelerates: the inertia is not determined, and resonances, delays and lags cannot be judged",
            frozenset({Need.ACCELERATION}),
        )
    ]


def _swing(data: DataSet, axis: Axis) -> list[Limit]:
    """Slow means are compared: noise moves the axis, too, and faster than the reference."""
    window = max(1, round(min(AVERAGED, period(data, axis) / OF_A_PERIOD) / data.dt))
    ends = list(itertools.pairwise(data.ends))
    position, acceleration = (
        np.concatenate([ndimage.uniform_filter1d(data.joined(name)[a:b], window) for a, b in ends])
        for name in ("position", "acceleration")
    )
    if -float(np.corrcoef(position, acceleration)[0, 1]) < ONE_SINUSOID:
        return []
    return [
        Limit(
            "swings like one sinusoid, whose acceleration follows its position: springs and gravity cannot be told from inertia",
            frozenset({Need.FREE_ACCELERATION, Need.MEASURED_INERTIA}),
        )
    ]


def _extent(data: DataSet, axis: Axis) -> list[Limit]:
    result = []
    duration = sum(float(s.t[-1] - s.t[0]) for s in data.stretches)
    if duration < SHORT:
        result.append(Limit(f"lasts only {duration:.3g} s: slow changes cannot be judged", frozenset({Need.DURATION})))
    turn = 2.0 * math.pi
    travel = float(np.ptp(data.joined("position")))
    if axis.kind == "rotary" and travel < 0.5 * turn:
        result.append(
            Limit(
                f"covers {travel / turn:.2g} of a turn: what repeats once or twice a turn cannot be told from a slope over "
                "the position",
                frozenset({Need.TRAVEL} if travel < TENTH * turn else ()),
            )
        )
    return result
