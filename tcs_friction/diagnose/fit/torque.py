"""The torque of each group of terms over a data set, computed once and kept.

In: a data set and axes. Out: the torque at the rotor and the torque that the measured motion requires there, N m,

    required = J a + friction + other opposing torques + what bodies add

A search evaluates thousands of axes that differ in one number. Only what that number reaches is computed again: the drive's
terms, the friction law with all that acts through it, each effect that stands alone, the bodies, the sensors.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from threading import Lock

import numpy as np
from scipy import ndimage

from tcs_friction.conditioning.data_set import DataSet, Stretch
from tcs_friction.conditioning.filters import through
from tcs_friction.physics import machine
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Place

CACHE_SIZE = 400e6  # bytes of results at most, so that an hour at 1 kHz needs less than 2 GB in all
SLOW_PERIODS = 4.0  # of the cutoff that a running mean spans to leave its slow part: it passes a tenth of the band


class ResultCache:
    """The most recent results, up to so many bytes; for several threads."""

    def __init__(self, size: float = CACHE_SIZE) -> None:
        self.size = size
        self.held = 0
        self.results: OrderedDict[Hashable, tuple[np.ndarray, ...]] = OrderedDict()
        self.lock = Lock()

    def get(
        self, key: Hashable, make: Callable[[], tuple[np.ndarray, ...]], keep: bool = True
    ) -> tuple[np.ndarray, ...]:
        """The result under this key, computed if it is not there; `keep`: put it there."""
        with self.lock:
            if key in self.results:
                self.results.move_to_end(key)
                return self.results[key]
        result = make()
        if not keep:
            return result
        with self.lock:
            if key not in self.results:
                self.results[key] = result
                self.held += sum(x.nbytes for x in result)
            while self.held > self.size and len(self.results) > 1:
                _, old = self.results.popitem(last=False)
                self.held -= sum(x.nbytes for x in old)
        return result


class TorqueTerms:
    """Torques over the compared samples (n,) of conditioned recordings, stretches one after the other."""

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self.train = data.train
        self.resolution = data.speed_resolution
        self.cache = ResultCache()
        self.rests = bool(data.resting.any())

    def rotor(self, axis: Axis, keep: bool = True) -> tuple[np.ndarray, float]:
        """Torque (n,) that the drive gives at the rotor, and its rms over the train data, N m."""
        rotor, size = self._drive(axis, keep)[:2]
        return rotor, float(size[0])

    def required(self, axis: Axis, keep: bool = True) -> np.ndarray:
        """Torque that the measured motion requires at the rotor, N m."""
        total = axis.inertia * self._motion(axis, keep)[0] + self.friction(axis, keep)
        for group in _standing_alone(axis):
            total += self._alone(axis, group, keep)
        return np.asarray(total)

    def holding(self, axis: Axis) -> list[np.ndarray]:
        """Torque (n,), N m, of the drive that neither the inertia nor another term takes up, at all samples of each stretch.

        Where the axis rests, friction without memory is this torque, up to its level.
        """
        others = [self._everywhere(axis, group, True) for group in _standing_alone(axis)]
        inertial = [axis.inertia * motion[2] for motion in self._motion(axis, True)[1:]]
        return [torque - sum(parts) for torque, *parts in zip(self._drive(axis, True)[2:], inertial, *others, strict=True)]

    def friction(self, axis: Axis, keep: bool = True) -> np.ndarray:
        """Friction (n,), N m, and what acts through it."""
        group = _friction(axis)
        loaded = any("torque" in item.term.reads for item in group)

        def compute() -> tuple[np.ndarray, ...]:
            torques = self._drive(axis, keep)[2:] if loaded else [s.torque for s in self.data.stretches]
            holding = self.holding(axis) if self.rests else None
            return (self._narrowed_demands(axis, group, self._motion(axis, keep)[1:], torques, holding),)

        key = (
            "friction",
            _key(group),
            _key(_at(axis, Place.SENSOR)),
            _key(_at(axis, Place.DRIVE)) if loaded or self.rests else None,
            (axis.inertia, _key(axis.effects)) if self.rests else None,
        )
        return self.cache.get(key, compute, keep)[0]

    def loads_from_motion(self, axis: Axis) -> list[np.ndarray]:
        """Torque that the motion requires at the rotor, N m, averaged over SLOW_PERIODS, at all samples of each stretch.

        The logged torque's own noise is in every residual, and the encoder's, which the average leaves out, is in both.
        """
        terms = [item for item in axis.terms if item.term.place not in (Place.DRIVE, Place.SENSOR)]
        stretches = zip(self.data.stretches, self._motion(axis, True)[1:], strict=True)
        window = max(2, round(SLOW_PERIODS / (self.data.cutoff * self.step)))
        return [
            ndimage.uniform_filter1d(self._evaluate(axis, terms, s, motion, s.torque) + axis.inertia * motion[2], window)
            for s, motion in stretches
        ]

    def friction_under(self, axis: Axis, loads: Sequence[np.ndarray]) -> np.ndarray:
        """Friction at the compared samples under these torques at the rotor instead of the logged ones."""
        return self._narrowed_demands(axis, _friction(axis), self._motion(axis, True)[1:], loads)

    def _drive(self, axis: Axis, keep: bool) -> tuple[np.ndarray, ...]:
        """Torque at the rotor where it is compared, its rms over the train data, then at all samples of each stretch."""
        drive, stretches = _at(axis, Place.DRIVE), self.data.stretches

        def compute() -> tuple[np.ndarray, ...]:
            every = [s.torque for s in stretches]
            for item in drive:
                if item.term.filters:  # by its response: steps would bend it
                    response = partial(_response, item)
                    every = [x + through(x - x[0], self.step, response) for x in every]
                else:
                    every = self._driven(axis, item, every, keep)
            rotor = np.concatenate([self.data.narrowed(x) for x in every])
            return rotor, np.sqrt(np.mean(rotor[self.train] ** 2, keepdims=True)), *every

        moving = not all(item.term.filters for item in drive)
        return self.cache.get(
            ("drive", _key(drive), _key(_at(axis, Place.SENSOR)) if moving else None), compute, keep
        )

    def _driven(
        self, axis: Axis, item: Instance, torques: Sequence[np.ndarray], keep: bool
    ) -> list[np.ndarray]:
        """Torques of all stretches after a term of the drive that follows the motion."""
        driven = []
        stretches = zip(self.data.stretches, self._motion(axis, keep)[1:], torques, strict=True)
        for s, motion, logged in stretches:
            torque = np.empty(len(logged))
            machine.evaluate_drive(self._built(axis, [item], motion), s.t, motion, logged, s.signals, torque)
            driven.append(torque)
        return driven

    def acceleration(self, axis: Axis) -> np.ndarray:
        """True acceleration (n,), rad/s^2, narrowed as torques are."""
        return self._motion(axis, True)[0]

    def _motion(self, axis: Axis, keep: bool) -> tuple[np.ndarray, ...]:
        """True acceleration at the compared samples, then position, velocity and acceleration (3, n) of each stretch."""
        sensors = _at(axis, Place.SENSOR)

        def compute() -> tuple[np.ndarray, ...]:
            stretches = []
            for s in self.data.stretches:
                true = np.stack([s.position, s.velocity, s.acceleration])
                if sensors:
                    measured, true = true, np.empty_like(true)
                    built = machine.build(axis, self.step, signals=self.data.names, terms=sensors)
                    machine.true_motion(built, self.step, measured, true)
                stretches.append(true)
            return np.concatenate([self.data.narrowed(x[2]) for x in stretches]), *stretches

        return self.cache.get(("motion", _key(sensors)), compute, keep)

    def _alone(self, axis: Axis, group: Sequence[Instance], keep: bool) -> np.ndarray:
        """What a group of terms that stand alone adds to the required torque at the compared samples."""

        def compute() -> tuple[np.ndarray, ...]:
            every = self._everywhere(axis, group, keep and self.rests)
            return (np.concatenate([self.data.narrowed(x) for x in every]),)

        return self.cache.get(("alone", *_key_alone(axis, group)), compute, keep)[0]

    def _everywhere(self, axis: Axis, group: Sequence[Instance], keep: bool) -> tuple[np.ndarray, ...]:
        """The same at all samples of each stretch."""

        def compute() -> tuple[np.ndarray, ...]:
            stretches = zip(self.data.stretches, self._motion(axis, keep)[1:], strict=True)
            return tuple(self._evaluate(axis, group, s, motion, s.torque) for s, motion in stretches)

        return self.cache.get(("everywhere", *_key_alone(axis, group)), compute, keep)

    @property
    def step(self) -> float:
        """Seconds between the samples that are evaluated."""
        return self.data.dt / self.data.stride

    def _narrowed_demands(
        self,
        axis: Axis,
        terms: Sequence[Instance],
        motions: Sequence[np.ndarray],
        torques: Sequence[np.ndarray],
        holding: Sequence[np.ndarray] | None = None,
    ) -> np.ndarray:
        """What some terms demand at the compared samples of all stretches, under these torques at the rotor."""
        stretches = zip(self.data.stretches, motions, torques, holding or torques, strict=True)
        return np.concatenate(
            [
                self.data.narrowed(self._evaluate(axis, terms, s, motion, torque, holds))
                for s, motion, torque, holds in stretches
            ]
        )

    def _evaluate(
        self,
        axis: Axis,
        terms: Sequence[Instance],
        s: Stretch,
        motion: np.ndarray,
        torque: np.ndarray,
        holding: np.ndarray | None = None,
    ) -> np.ndarray:
        """`machine.evaluate_demand` of some terms over every sample of a stretch."""
        built, out = self._built(axis, terms, motion), np.empty(len(s.t))
        holds = torque if holding is None else holding
        signals = s.signals if any(item.signals or item.thermal for item in terms) else s.signals[:0]
        machine.evaluate_demand(built, s.t, motion, torque, signals, self.resolution, s.resting, holds, out)
        return out

    def _built(self, axis: Axis, terms: Sequence[Instance], motion: np.ndarray) -> machine.Machine:
        """Some terms, ready to walk through a stretch's motion (3, n)."""
        start = float(motion[0, 0])
        return machine.build(axis, self.step, signals=self.data.names, position=start, terms=terms)


def _at(axis: Axis, place: Place) -> list[Instance]:
    return [item for item in axis.terms if item.term.place is place]


def _response(item: Instance, frequency: np.ndarray) -> np.ndarray:
    """What a linear filter adds to a torque, at frequencies (m,), Hz."""
    assert item.term.transfer is not None
    return item.term.transfer(item.values, 2j * np.pi * frequency)


def _friction(axis: Axis) -> list[Instance]:
    """The law with all that acts through it or reads what it wrote."""
    reading = [item for item in _at(axis, Place.OPPOSING) if not _stands_alone(item)]
    return [*_at(axis, Place.SCALE), *_at(axis, Place.LAW), *reading]


def _standing_alone(axis: Axis) -> list[list[Instance]]:
    """Groups of terms whose torque is the same whatever else the axis has: each effect, and all bodies."""
    bodies = _at(axis, Place.BODY)
    return [*([item] for item in _at(axis, Place.OPPOSING) if _stands_alone(item)), *([bodies] if bodies else [])]


def _stands_alone(item: Instance) -> bool:
    """Whether the term's torque is the same whatever else the axis has."""
    return not item.term.reads or (item.table is not None and "torque" not in item.table.coordinates)


def _key(items: Sequence[Instance]) -> Hashable:
    """Equal for terms that act alike."""
    return tuple(
        (item.term.id, tuple(item.values.values()), item.signal, item.table and item.table.key)
        for item in items
    )


def _key_alone(axis: Axis, group: Sequence[Instance]) -> tuple[Hashable, ...]:
    """Equal for axes on which a group of terms that stand alone gives the same torque."""
    inertia = axis.inertia if group[0].term.place is Place.BODY else None
    return _key(group), _key(_at(axis, Place.SENSOR)), inertia
