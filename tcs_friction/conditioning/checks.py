"""What a diagnosis refuses, in one line each: recordings that cannot carry a torque balance, and signals in wrong units.

In: recordings as they were read, or the data set and the axis. Out: nothing, or an InputError that names recording or signal.

Units are judged by a plain balance of the torque u with acceleration a, direction and speed v,

    u = inertia a + level tanh(v/threshold) + viscous v + offset,

by least squares. A wrong guess of the inertia or an effort in ampere is no reason to refuse. A sign that is wrong in both is one,
and an inertia that is off by the ratio of two units while the level of dry friction is right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.errors import InputError
from tcs_friction.numerics.integral import travelled
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import opposing_torque

FEWEST_POSITIONS = 20  # different ones; the encoder of an axis that only chatters shows two or three
FEWEST_SAMPLES = 10  # of a segment, from which a drift between position and velocity is told
RELATED = 0.5  # squared correlation of position and integrated velocity; below it their ratio means nothing
SAME_UNIT = 2.0  # factor by which position and velocity may disagree: no two units lie so near
DEGREES = math.degrees(1.0)
NEAR_DEGREES = 0.3  # relative, within which a ratio looks like degrees per radian
FEWEST_MOVING = 20  # compared samples, five for each number of the plain balance
BLOCKS, QUARTERS = 32, 4  # of the data, interleaved: every quarter has something of the beginning and of the end
FEWEST_ANSWERS = 3  # of the whole and its quarters, that must determine the balance
ALIKE = 2.0  # factor within which quarters agree with the whole, and a ratio with that of two units
LEVEL_KNOWN = 2.5  # factor within which a level of dry friction is the believed one: torque and its unit are right
DETERMINED = 0.02  # smallest singular value over the largest, of columns of length one: below it they are nearly dependent
MATERIAL = 1e-3  # of the torque's power, that a number must explain
LEAST_LEVEL = 1e-300  # so that nothing is divided by zero
ANGLES = {DEGREES: "degrees", 1.0 / DEGREES: "rad where the axis file has degrees"}
LENGTHS = {1e3: "mm", 1e-3: "m where the axis file has mm"}


def check_changes(recordings: Sequence[Recording]) -> None:
    """Refuse a position or a torque that is always the same, in one line."""
    for r in recordings:
        check_position(r)
        check_torque(r)


def check_position(recording: Recording) -> None:
    """Refuse a position that is always the same, in one line: of an axis at rest, or one that is not read."""
    check_read(recording)
    if np.ptp(recording.position) == 0.0:
        raise InputError(recording.source, "the position never changes", "a recording in which the axis moves")


def check_read(recording: Recording) -> None:
    """Refuse a position that is always the same beside a velocity that is not, in one line."""
    if np.ptp(recording.position) == 0.0 and recording.velocity is not None and np.ptp(recording.velocity) > 0.0:
        found = "the position never changes, and the velocity does"
        raise InputError(recording.source, found, "the position of the axis: is its sensor read?")


def check_torque(recording: Recording) -> None:
    """Refuse a torque that is always the same, in one line."""
    if np.ptp(recording.torque) == 0.0:
        found = f"the torque is constant ({recording.torque[0]:g})"
        raise InputError(recording.source, found, "the torque applied to the axis")


def check(recordings: Sequence[Recording]) -> None:
    """Refuse what cannot carry a torque balance, in one line."""
    check_changes(recordings)
    for r in recordings:
        distinct = len(np.unique(r.position))
        if distinct < FEWEST_POSITIONS:
            found = f"the position takes only {distinct} values"
            raise InputError(r.source, found, "motion over many encoder steps")
        if tuple(r.exogenous) != tuple(recordings[0].exogenous):
            found = "other exogenous signals than the first recording"
            raise InputError(r.source, found, ", ".join(recordings[0].exogenous))
        if r.velocity is not None:
            _check_velocity(r, r.velocity)


def _check_velocity(r: Recording, velocity: np.ndarray) -> None:
    """The recorded velocity must be the derivative of the position: otherwise one of them has another unit."""
    moved, integrated = [], []
    for s in r.segments:
        t, q, v = r.t[s], r.position[s], velocity[s]
        if len(t) < FEWEST_SAMPLES:
            continue
        sums = travelled(t, v)
        moved.append(q - np.mean(q))
        integrated.append(sums - np.mean(sums))
    if not moved:
        return
    x, y = np.concatenate(integrated), np.concatenate(moved)
    if x @ x == 0.0 or (x @ y) ** 2 < RELATED * (x @ x) * (y @ y):
        return  # no clear relation either way; the velocity is not used further
    slope = float(x @ y / (x @ x))
    if not 1.0 / SAME_UNIT < slope < SAME_UNIT:
        degrees = min(abs(slope * DEGREES - 1.0), abs(slope / DEGREES - 1.0)) < NEAR_DEGREES
        hint = " (degrees in one of them?)" if degrees else ""
        found = f"position changes {slope:.3g} times as fast as the velocity says{hint}"
        raise InputError(r.source, found, "both in the same unit")


def check_units(data: DataSet, axis: Axis) -> None:
    """Refuse data without motion, a torque of the wrong sign and a position in another unit than the axis file's, in one line.

    Raises InputError.
    """
    if np.count_nonzero(data.moving()) < FEWEST_MOVING:
        raise InputError("signal position", "nothing but noise in it", "a recording in which the axis moves")
    balance = _agreed_balance(data)
    if balance is None:
        return
    inertia, level = balance
    if inertia < 0.0 and level < 0.0:
        raise opposing_torque()
    known = 1.0 / LEVEL_KNOWN < level / max(axis.dry_level, LEAST_LEVEL) < LEVEL_KNOWN
    if inertia <= 0.0 or level <= 0.0 or not known:
        return
    ratio = axis.inertia / inertia  # how much larger the position is than it should be
    unit, others = ("rad", ANGLES) if axis.kind == "rotary" else ("m", LENGTHS)
    for factor, name in others.items():
        if _alike(ratio, factor):
            found = f"it moves about {ratio:.2g} times as far as torque, friction and inertia allow ({name}?)"
            raise InputError("signal position", found, f"{unit}, or a scale in the signals block")


def _agreed_balance(data: DataSet) -> tuple[float, float] | None:
    """The plain balance of all data, if the quarters that can tell agree with it."""
    block = np.arange(data.ends[-1]) * BLOCKS // data.ends[-1]
    whole = plain_balance(data, block >= 0)
    parts = [plain_balance(data, block % QUARTERS == k) for k in range(QUARTERS)]
    told = [part for part in (whole, *parts) if part is not None]
    if whole is None or len(told) < FEWEST_ANSWERS:
        return None
    agreed = all(_alike(x, y) for part in told for x, y in zip(part, whole, strict=True))
    return whole if agreed else None


def _alike(x: float, y: float) -> bool:
    return 1.0 / ALIKE < x / y < ALIKE


def plain_balance(data: DataSet, rows: np.ndarray) -> tuple[float, float] | None:
    """Inertia and dry friction by least squares on compared samples (n,); None where the motion does not determine both.

    Nor does it where the viscous torque is negative and larger than the dry one: such friction would drive the axis.
    """
    v, a, u = (data.joined(name)[rows] for name in ("velocity", "acceleration", "torque"))
    direction = np.tanh(v / max(data.speed_threshold, LEAST_LEVEL))
    columns = np.stack([a, direction, v, np.ones_like(v)], axis=1)
    norms = np.linalg.norm(columns, axis=0)
    if not (norms > 0.0).all():
        return None
    left, singular, right = np.linalg.svd(columns / norms, full_matrices=False)
    if singular[-1] < DETERMINED * singular[0]:
        return None
    numbers = right.T @ ((left.T @ u) / singular)
    if (numbers[:2] ** 2 < MATERIAL * float(u @ u)).any() or numbers[2] < -abs(numbers[1]):
        return None
    return float(numbers[0] / norms[0]), float(numbers[1] / norms[1])
