"""The torque balance in parts: what each group of terms contributes over conditioned recordings, remembered.

A search evaluates thousands of axes that differ in one number. Only what that number reaches is walked through again: the drive's
terms, the friction law with all that acts through it, each effect that stands alone, the bodies, the sensors.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from threading import Lock

import numpy as np

from tcs_friction.diagnose.condition import Conditioned, Stretch
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place

REMEMBERED = 400e6  # bytes of results at most


class Memory:
    """The most recent results, up to so many bytes; for several threads."""

    def __init__(self, size: float = REMEMBERED) -> None:
        self.size = size
        self.held = 0
        self.results: OrderedDict[Hashable, tuple[np.ndarray, ...]] = OrderedDict()
        self.lock = Lock()

    def get(self, key: Hashable, make: Callable[[], tuple[np.ndarray, ...]]) -> tuple[np.ndarray, ...]:
        """The result under this key, made if it is not remembered."""
        with self.lock:
            if key in self.results:
                self.results.move_to_end(key)
                return self.results[key]
        result = make()
        with self.lock:
            if key not in self.results:
                self.results[key] = result
                self.held += sum(x.nbytes for x in result)
            while self.held > self.size and len(self.results) > 1:
                _, old = self.results.popitem(last=False)
                self.held -= sum(x.nbytes for x in old)
        return result


class Parts:
    """Torques over the compared samples (n,) of conditioned recordings, stretches one after the other."""

    def __init__(self, data: Conditioned) -> None:
        self.data = data
        self.resolution = max(2.0 * data.velocity_noise, 1e-12)
        self.memory = Memory()

    def rotor(self, axis: Axis) -> np.ndarray:
        """Torque that the drive gives at the rotor, N m."""
        return self._drive(axis)[0]

    def required(self, axis: Axis) -> np.ndarray:
        """Torque that the measured motion requires at the rotor, N m."""
        opposing = _at(axis, Place.OPPOSING)
        alone = [[item] for item in opposing if _alone(item)]
        friction = [
            *_at(axis, Place.SCALE),
            *_at(axis, Place.LAW),
            *(item for item in opposing if not _alone(item)),
        ]
        bodies = _at(axis, Place.BODY)
        total = axis.inertia * self._motion(axis)[0]
        for group in (friction, *alone, *([bodies] if bodies else [])):
            total += self._demand(axis, group)
        return np.asarray(total)

    def _drive(self, axis: Axis) -> tuple[np.ndarray, ...]:
        """Torque at the rotor where it is compared, then at all samples of each stretch."""
        drive, stretches = _at(axis, Place.DRIVE), self.data.stretches

        def walk() -> tuple[np.ndarray, ...]:
            every = [s.torque for s in stretches]
            if drive:
                motions = self._motion(axis)[1:]
                walked = [
                    self._walk(axis, drive, s, m, s.torque) for s, m in zip(stretches, motions, strict=True)
                ]
                every = [out[:, machine.ROTOR].copy() for out in walked]
            return np.concatenate([self.data.narrowed(x) for x in every]), *every

        return self.memory.get(("drive", _key(drive), _key(_at(axis, Place.SENSOR))), walk)

    def _motion(self, axis: Axis) -> tuple[np.ndarray, ...]:
        """True acceleration at the compared samples, then position, velocity and acceleration (3, n) of each stretch."""
        sensors = _at(axis, Place.SENSOR)

        def walk() -> tuple[np.ndarray, ...]:
            stretches = []
            for s in self.data.stretches:
                true = np.stack([s.position, s.velocity, s.acceleration])
                if sensors:
                    measured, true = true, np.empty_like(true)
                    built = machine.build(axis, self.step, signals=self.data.names, terms=sensors)
                    machine.true_motion(built, self.step, measured, true)
                stretches.append(true)
            return np.concatenate([self.data.narrowed(x[2]) for x in stretches]), *stretches

        return self.memory.get(("motion", _key(sensors)), walk)

    def _demand(self, axis: Axis, group: Sequence[Instance]) -> np.ndarray:
        """What a group of terms adds to the required torque at the compared samples."""
        loaded = any("torque" in item.term.reads for item in group)
        bodily = group[0].term.place is Place.BODY

        def walk() -> tuple[np.ndarray, ...]:
            stretches, motions = self.data.stretches, self._motion(axis)[1:]
            torques = self._drive(axis)[1:] if loaded else [s.torque for s in stretches]
            parts = []
            for s, motion, torque in zip(stretches, motions, torques, strict=True):
                required = self._walk(axis, group, s, motion, torque)[:, machine.REQUIRED]
                parts.append(self.data.narrowed(required - axis.inertia * motion[2]))
            return (np.concatenate(parts),)

        key = (
            _key(group),
            _key(_at(axis, Place.SENSOR)),
            _key(_at(axis, Place.DRIVE)) if loaded else None,
            axis.inertia if bodily else None,
        )
        return self.memory.get(key, walk)[0]

    @property
    def step(self) -> float:
        """Seconds between the samples that are evaluated."""
        return self.data.dt / self.data.stride

    def _walk(
        self,
        axis: Axis,
        terms: Sequence[Instance],
        s: Stretch,
        motion: np.ndarray,
        torque: np.ndarray,
    ) -> np.ndarray:
        """`machine.evaluate` of some terms (n, 8) over every sample of a stretch."""
        position, velocity, acceleration = motion
        built = machine.build(
            axis, self.step, signals=self.data.names, position=float(position[0]), terms=terms
        )
        out = np.empty((len(position), 8))
        machine.evaluate(
            built, s.t, position, velocity, acceleration, torque, s.signals, self.resolution, out
        )
        return out


def _at(axis: Axis, place: Place) -> list[Instance]:
    return [item for item in axis.terms if item.term.place is place]


def _alone(item: Instance) -> bool:
    """Whether the term's torque is the same whatever else the axis has."""
    return not item.term.reads or (item.table is not None and "torque" not in item.table.coordinates)


def _key(items: Sequence[Instance]) -> Hashable:
    """Equal for terms that act alike."""
    return tuple(
        (item.term.id, tuple(item.values.values()), item.signal, item.table and item.table.key)
        for item in items
    )
