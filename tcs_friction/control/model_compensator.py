"""Feed-forward of all that an axis file knows: each term's torque along the reference, by the kernel that simulates it.

The terms are evaluated along the reference motion where it will be when the command acts, in the middle of its tick:

    q = q_ref + v_ref lead + a_ref lead^2 / 2,   v = v_ref + a_ref lead,   lead = known delays + half a tick
    wanted  = J a_ref + friction + opposing torques        what the rotor has to give
    command = inverse of the drive's terms of `wanted`
    compensation = command - J a_ref                       since the controller adds the inertia's part itself

Each effect has a share from 0 to 1, which follows its switch over a stated time, so that torque never appears in a step, and
a limit. Friction of the law itself always has share 1. Sensor terms are left to `position_correction`. Of the sum a share is
commanded, which follows its setting as the effects' do; friction has a rest band (`compensator.rested`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.control.compensator import rest_speed_setting, rest_torque_setting, rested, share_setting
from tcs_friction.control.config_field import setting, texts, validate
from tcs_friction.errors import InputError, nearest
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.machine import MASS, Machine, arrest_per_speed, build, call_term
from tcs_friction.physics.terms import (
    ACCELERATION,
    ARREST,
    DRY_SCALE,
    EXTRA_LEVEL,
    INERTIA,
    LEVEL,
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
)

Array = NDArray[np.float64]

LONGEST_LEAD = 0.1  # s, for which a reference is foretold from its acceleration
AT_REST = 1e-9  # rad/s, reference speed below which a law without bristles is not sliding
ROOM = 20.0  # degC, where nobody measures the temperature
LOOKS = 20_000  # places of a turn that are looked at for the largest torque
SLOW = 1e-3  # rad/s

# constants
_DT, _LEAD, _RISE, _LIMIT, _ARREST, _SHARE, _REST_SPEED, _REST_TORQUE = range(8)
# memory
_PRIMED, _SPEED, _WANTED, _SHARED = range(4)


@dataclass(frozen=True)
class SwitchConfig:
    """Which effects of a model are cancelled."""

    left_out: tuple[str, ...] = texts("effects of the model that are not cancelled, by name")
    entry_time: float = setting(0.5, "s", 0.0, 60.0, "an effect, another model or another limit comes and goes over this time")


@dataclass(frozen=True)
class CancellationConfig(SwitchConfig):
    """Which effects of a model are cancelled, and how much torque that may take."""

    total_limit: float = setting(1e12, "N m", 0.0, 1e12, "largest torque of the whole compensation")
    effect_limit: float = setting(1e12, "N m", 0.0, 1e12, "largest torque of each effect in it")
    effect_limits: tuple[str, ...] = texts("largest torque (N m) of single effects, NAME=LIMIT, instead of effect_limit")
    share: float = share_setting()
    rest_speed: float = rest_speed_setting()
    rest_torque: float = rest_torque_setting()

    def validate(self, where: str = "cancellation") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)
        self.limits()

    def limits(self) -> dict[str, float]:
        """The limits of single effects by name, N m. Raises InputError for one that is none."""
        found = {}
        for entry in self.effect_limits:
            name, _, text = entry.partition("=")
            try:
                limit = float(text)
            except ValueError:
                limit = math.nan
            if not (name and limit >= 0.0):
                raise InputError("effect_limits", repr(entry), "NAME=LIMIT with a limit of 0 N m or more")
            found[name] = limit
        return found


class Plan(NamedTuple):
    """What the kernel needs beside the machine. Arrays are live: shares, parts and memory change as it runs."""

    shares: Array  # (k + d,) of the machine's k terms, then of the d delays
    wanted: Array  # (k + d,) where the shares go
    limits: Array  # (k + d,) of the parts, N m; not used of delays
    parts: Array  # (k + d,) torque of each term in the last compensation, N m; 0 of delays
    delays: Array  # (d,) s
    constants: Array
    memory: Array


@njit(cache=True, error_model="numpy", inline="always")
def _bounded(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@njit(cache=True, error_model="numpy", inline="always")
def follow(shares: Array, wanted: Array, rise: float, at_once: bool) -> None:
    """One tick of shares (k,) on their way to what is wanted (k,), by at most `rise`."""
    for k in range(len(shares)):
        missing = wanted[k] - shares[k]
        shares[k] += missing if at_once else _bounded(missing, rise)


def rise_per_tick(dt: float, entry_time: float) -> float:
    """By how much a share may change in a tick of `dt` seconds."""
    return dt / entry_time if entry_time > 0.0 else 1.0


@njit(cache=True, error_model="numpy")
def compensate(m: Machine, plan: Plan, t: float, q_ref: float, v_ref: float, a_ref: float, surroundings: Any) -> float:
    """One tick: the torque to add to the command, N m. `surroundings`: temperature, then each signal and its rate."""
    shares, parts, constants, memory, motion = plan.shares, plan.parts, plan.constants, plan.memory, m.motion
    dt, first = constants[_DT], memory[_PRIMED] == 0.0
    follow(shares, plan.wanted, constants[_RISE], first)
    follow(memory[_SHARED:], constants[_SHARE : _SHARE + 1], constants[_RISE], first)
    lead = constants[_LEAD]
    for d in range(len(plan.delays)):
        lead += shares[len(m.kernels) + d] * plan.delays[d]
    velocity = v_ref + lead * a_ref
    motion[TIME] = t + lead
    motion[POSITION] = q_ref + lead * (v_ref + 0.5 * lead * a_ref)
    motion[TRAVEL] = 0.5 * ((velocity if first else memory[_SPEED]) + velocity) * dt
    motion[VELOCITY], motion[ACCELERATION] = velocity, a_ref
    motion[TEMPERATURE:] = surroundings
    motion[INERTIA] = m.constants[MASS]
    motion[ARREST] = constants[_ARREST] * velocity
    motion[TORQUE] = m.constants[MASS] * a_ref if first else memory[_WANTED]  # load-dependent friction: of the tick before
    memory[_PRIMED], memory[_SPEED] = 1.0, velocity
    added = rested(_friction(m, plan, dt), velocity, constants[_REST_SPEED], constants[_REST_TORQUE])
    for k in range(m.ends[2], m.ends[4]):
        before = motion[INERTIA]
        torque = call_term(m, k, dt)
        parts[k] = _bounded(shares[k] * (torque + (motion[INERTIA] - before) * a_ref), plan.limits[k])
        added += parts[k]
    rigid = m.constants[MASS] * a_ref
    memory[_WANTED] = rigid + added
    motion[TORQUE] = rigid + added
    for k in range(m.ends[0] - 1, -1, -1):  # the last term of the drive is the first to be undone
        wanted = motion[TORQUE]
        parts[k] = _bounded(shares[k] * (call_term(m, k, dt) - wanted), plan.limits[k])
        motion[TORQUE] = wanted + parts[k]
    return float(_bounded(memory[_SHARED] * (motion[TORQUE] - rigid), constants[_LIMIT]))


@njit(cache=True, error_model="numpy", inline="always")
def _friction(m: Machine, plan: Plan, dt: float) -> float:
    """Friction of the law as the SCALE terms leave it; the part of such a term is estimated from the tick before."""
    motion, shares, parts = m.motion, plan.shares, plan.parts
    motion[EXTRA_LEVEL], motion[DRY_SCALE], motion[VISCOUS_SCALE] = 0.0, 1.0, 1.0
    way = math.copysign(1.0, motion[VELOCITY])
    for k in range(m.ends[0], m.ends[1]):
        extra, dry, viscous = motion[EXTRA_LEVEL], motion[DRY_SCALE], motion[VISCOUS_SCALE]
        call_term(m, k, dt)
        more = (motion[EXTRA_LEVEL] - extra, motion[DRY_SCALE] - dry, motion[VISCOUS_SCALE] - viscous)
        torque = abs(more[0] + more[1] * motion[LEVEL] + more[2] * abs(motion[VISCOUS]))
        share = shares[k] if shares[k] * torque <= plan.limits[k] else plan.limits[k] / torque
        motion[EXTRA_LEVEL] = extra + share * more[0]
        motion[DRY_SCALE] = dry + share * more[1]
        motion[VISCOUS_SCALE] = viscous + share * more[2]
        parts[k] = way * share * torque
    friction = 0.0
    for k in range(m.ends[1], m.ends[2]):
        parts[k] = call_term(m, k, dt)
        friction += parts[k]
    return friction


def effect_names(axis: Axis) -> dict[str, Instance]:
    """The effects of an axis by name: `cogging`, and `cogging_2` for the second of its kind."""
    named: dict[str, Instance] = {}
    for item in axis.effects:
        count = 1 + sum(other.term is item.term for other in named.values())
        named[item.term.id if count == 1 else f"{item.term.id}_{count}"] = item
    return named


def obstacles(axis: Axis) -> dict[str, str]:
    """Effects of an axis that no feed-forward can cancel, by name, and why."""
    return {name: item.obstacle for name, item in effect_names(axis).items() if item.obstacle}


class ModelCompensator:
    """The feed-forward of an axis model, one `step` a tick of `dt` seconds.

    signals: names of the live signals, in the order of the surroundings that `step` is given.

    Raises InputError for a bad configuration, an unknown effect that is left out, a signal that is not there, and a model that
    looks further ahead than a reference can be foretold.
    """

    def __init__(
        self, model: Axis, dt: float, config: CancellationConfig | None = None, signals: Sequence[str] = ()
    ) -> None:
        self.model, self.dt, self.signals = model, dt, tuple(signals)
        self._around = np.zeros(1 + 2 * len(signals))
        hindered = obstacles(model)
        self.effects = {
            name: item
            for name, item in effect_names(model).items()
            if name not in hindered and item.term.place is not Place.SENSOR
        }
        """What is cancelled, by name."""
        chosen = [item for item in model.terms if item is model.friction or self._cancels(item)]
        self._terms = [item for item in chosen if not item.term.alignment]
        self.delays = [item for item in chosen if item.term.alignment]
        self.acting = [
            replace(item, term=replace(item.term, kernel=item.term.inverse)) if item.term.inverse is not None else item
            for item in self._terms
        ]
        self.machine = build(model, dt, signals=tuple(signals), terms=self.acting)
        self._at_rest = self.machine.motion.copy()
        self._missing: frozenset[str] = frozenset()
        lead = model.actuation_delay + 0.5 * dt
        delays = np.array([item.values[item.term.alignment] for item in self.delays])
        ahead = lead + float(delays.sum())
        if ahead > LONGEST_LEAD:
            expected = f"at most {1e3 * LONGEST_LEAD:g} ms, for which a reference is foretold"
            raise InputError(f"model {model.name}", f"it has to act {1e3 * ahead:.3g} ms ahead", expected)
        count = len(self._terms) + len(self.delays)
        constants = np.zeros(8)
        constants[[_DT, _LEAD, _ARREST]] = dt, lead, arrest_per_speed(self.machine, AT_REST)
        shares, wanted, limits, parts = np.zeros((4, count))
        self.plan = Plan(shares, wanted, limits, parts, delays, constants, np.zeros(4))
        self.configure(config or CancellationConfig())
        self.reset()

    def _cancels(self, item: Instance) -> bool:
        return any(item is other for other in self.effects.values())

    def configure(self, config: CancellationConfig) -> None:
        """Other switches and limits from the next tick on; a bad one raises InputError and changes nothing."""
        config.validate()
        check_names(self.model, config.left_out)
        limits = config.limits()
        check_names(self.model, limits, "effect_limits")
        self.config = config
        self.plan.constants[_RISE] = rise_per_tick(self.dt, config.entry_time)
        self.plan.constants[_LIMIT] = config.total_limit
        self.plan.constants[_SHARE:] = config.share, config.rest_speed, config.rest_torque
        own = {item.identity: limits.get(name, config.effect_limit) for name, item in self.effects.items()}
        self.plan.limits[:] = [own.get(item.identity, math.inf) for item in self._all]
        self._switch()

    def continued(self, config: CancellationConfig) -> ModelCompensator:
        """The same feed-forward with another configuration, which goes on from the state of this one."""
        other = ModelCompensator(self.model, self.dt, config, self.signals)
        for own, its in (
            (self.machine.states, other.machine.states),
            (self.machine.motion, other.machine.motion),
            (self.plan.shares, other.plan.shares),
            (self.plan.memory, other.plan.memory),
            (self.plan.parts, other.plan.parts),
        ):
            its[:] = own
        other.without(self._missing)
        return other

    def without(self, missing: Collection[str]) -> None:
        """Effects, by name, whose temperature or signal is not to be had at present: they leave as those left out do."""
        if frozenset(missing) != self._missing:
            self._missing = frozenset(missing)
            self._switch()

    def _switch(self) -> None:
        off = [self.effects.get(name) for name in (*self.config.left_out, *self._missing)]
        self.plan.wanted[:] = [0.0 if any(item is other for other in off) else 1.0 for item in self._all]

    @property
    def _all(self) -> list[Instance]:
        return [*self._terms, *self.delays]

    @property
    def needs(self) -> Mapping[str, tuple[str, ...]]:
        """What has to be measured while the axis runs, by effect: "temperature" and names of signals."""
        asked = {name: (*(("temperature",) if item.thermal else ()), *item.signals) for name, item in self.effects.items()}
        return {name: what for name, what in asked.items() if what}

    @property
    def parts(self) -> Mapping[str, float]:
        """Torque (N m) of each effect in the last compensation; that of a friction scale as of the tick before."""
        return {name: self._part(item) for name, item in self.effects.items() if not item.term.alignment}

    def _part(self, item: Instance) -> float:
        return float(next(self.plan.parts[k] for k, other in enumerate(self._terms) if other is item))

    def reset(self) -> None:
        """Forget the past: bristles at rest, every effect at the share that it is wanted with."""
        self.machine.states[:] = 0.0
        self.machine.motion[:] = self._at_rest  # what terms have written for each other
        self.plan.memory[:] = 0.0
        self.plan.parts[:] = 0.0

    def step(
        self, t: float, q_ref: float, v_ref: float, a_ref: float, temperature: float = ROOM, signals: Sequence[float] = ()
    ) -> float:
        """The torque to add to the command (N m), for this tick's time (s), reference and temperature (degC).

        signals: each signal's value and its rate per second; 0 if none are given.
        """
        self._around[0] = temperature
        if signals:
            self._around[1:] = signals
        torque: float = compensate(self.machine, self.plan, t, q_ref, v_ref, a_ref, self._around)
        return torque

    def largest(self) -> float:
        """Largest torque (N m) that it commands in slow, steady motion to and fro over a turn."""
        way = np.linspace(-math.pi, math.pi, LOOKS)
        position = np.concatenate([way, way[::-1]])
        speed = SLOW * np.sign(np.gradient(position))
        motion = np.column_stack([position, speed, np.zeros(2 * LOOKS)])
        self._around[0], self._around[1:] = ROOM, 0.0
        around = np.tile(self._around, (2 * LOOKS, 1))
        return float(np.max(np.abs(self.over(np.zeros(2 * LOOKS), motion, around))))

    def over(self, t: Array, motion: Array, surroundings: Array) -> Array:
        """The compensation (n,) from rest along a whole reference: times (n,), position, speed and acceleration (n, 3)."""
        self.reset()
        result: Array = _along(self.machine, self.plan, t, motion, surroundings)
        self.reset()
        return result


@njit(cache=True, error_model="numpy")
def _along(m: Machine, plan: Plan, t: Array, motion: Array, surroundings: Array) -> Array:
    result = np.empty(len(t))
    for k in range(len(t)):
        result[k] = compensate(m, plan, t[k], motion[k, 0], motion[k, 1], motion[k, 2], surroundings[k])
    return result


def signals_of(axis: Axis) -> tuple[str, ...]:
    """Names of the recorded signals that the effects and maps of an axis act through, each once."""
    return tuple(dict.fromkeys(name for item in axis.effects for name in item.signals))


def check_names(model: Axis, given: Collection[str], where: str = "left_out") -> None:
    """Raises InputError when one of these effects is none of a model."""
    names = effect_names(model)
    for name in given:
        if name not in names:
            raise InputError(where, f"model {model.name} has no effect {name!r}", nearest(name, list(names)))


def check_model(model: Axis, axis: Axis) -> None:
    """Raises InputError when a model belongs to another kind of axis or to another joint than `axis`."""
    if model.kind != axis.kind:
        raise InputError(f"model {model.name}", f"of a {model.kind} axis", f"one of the {axis.kind} axis {axis.name}")
    if model.name != axis.name:
        raise InputError(f"model {model.name}", "of another joint", f"one of joint {axis.name}")


def check_drive(compensation: Array, motion: Array, model: Axis, limit: float) -> None:
    """Raises InputError when a reference with this compensation (n,) takes more torque than the drive has (`limit`, N m).

    motion: position, speed and acceleration of the reference, (n, 3).
    """
    check_torque(float(np.max(np.abs(compensation + model.inertia * motion[:, 2]), initial=0.0)), model, limit)


def check_torque(largest: float, model: Axis, limit: float) -> None:
    """Raises InputError when cancelling what a model has takes more torque (N m) than the drive has."""
    if largest > limit:
        found = f"cancelling what it has takes {largest:.4g} N m"
        raise InputError(f"model {model.name}", found, f"at most the drive's {limit:g} N m")
