"""Friction compensation driven by the reference: LuGre, and the Stribeck curve alone for comparison.

The reference speed is used because it is clean where it matters, at the reversal. A torque commanded now
acts after the actuation delay and is held for one tick, so friction is predicted for the middle of that
time:

    v(t + lead) = v_ref + a_ref lead,      lead = actuation delay + half a tick.

Each direction of motion has its own parameters. The bristle is one and the same; where the direction changes it keeps its torque,
so that another stiffness there makes no step. What is commanded may be a `share` of it, and less while the axis is meant to rest
(`rested`): too much compensation makes an axis unstable, and what is left of a bristle's torque at rest makes a controller hunt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tcs_friction.control.config_field import setting, validate
from tcs_friction.physics.friction.lugre import friction, stribeck_level
from tcs_friction.physics.terms import DRY_SCALE, EXOGENOUS, TRAVEL, VELOCITY, VISCOUS_SCALE

Array = NDArray[np.float64]

# parameter slots: six of the positive direction (_STIFFNESS of each), six of the negative, then
_STIFFNESS = 3
_NEGATIVE, _LEAD, _DT, _SHARE, _REST_SPEED, _REST_TORQUE = 6, 12, 13, 14, 15, 16
# state slots; the motion vector that the friction kernel reads follows
DEFLECTION, _SPEED, _PRIMED, _STATE_HEADER = 0, 1, 2, 3
STATES = _STATE_HEADER + EXOGENOUS

_SIGNATURE = "f8(f8[::1], f8[::1], f8, f8)"


def share_setting() -> float:
    """The setting `share` of a compensator."""
    return setting(1.0, "", 0.0, 1.0, "part of the compensation that is commanded; below 1 the axis keeps some friction")


def rest_speed_setting() -> float:
    """The setting `rest_speed` of a compensator."""
    return setting(0.0, "rad/s", 0.0, 1e6, "reference speed below which the friction compensated falls to rest_torque at rest")


def rest_torque_setting() -> float:
    """The setting `rest_torque` of a compensator."""
    return setting(0.0, "N m", 0.0, 1e12, "most friction torque compensated at rest, where there is a rest_speed")


@njit("f8(f8, f8, f8, f8)", cache=True, inline="always")
def rested(torque: float, velocity: float, rest_speed: float, rest_torque: float) -> float:
    """Friction torque (N m) in the rest band: bounded to `rest_torque` at rest, whole from `rest_speed` on, a line between."""
    if abs(velocity) >= rest_speed:
        return torque
    moving = abs(velocity) / rest_speed
    return moving * torque + (1.0 - moving) * min(max(torque, -rest_torque), rest_torque)


@dataclass(frozen=True)
class LugreParameters:
    """LuGre friction of one direction, in the order of the friction law's kernel."""

    coulomb: float = setting(78.1, "N m", 1e-12, 1e9, "friction torque of steady sliding")
    static: float = setting(117.2, "N m", 1e-12, 1e9, "largest friction torque before sliding")
    stribeck_velocity: float = setting(
        6.1e-4, "rad/s", 1e-12, 1e6, "speed over which static falls to coulomb"
    )
    stiffness: float = setting(2.96e5, "N m/rad", 1e-9, 1e15, "bristle stiffness, sigma0")
    damping: float = setting(3.4e4, "N m s/rad", 0.0, 1e15, "bristle damping, sigma1")
    viscous: float = setting(572.0, "N m s/rad", 0.0, 1e12, "viscous coefficient, sigma2")

    def conflict(self) -> list[str]:
        """Values that do not go together: the Stribeck curve falls from static to coulomb."""
        if self.static < self.coulomb:
            return [f"static is {self.static:g}, expected coulomb ({self.coulomb:g} N m) or more"]
        return []

    def validate(self, where: str = "lugre") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)

    def packed(self) -> tuple[float, ...]:
        """The values in the kernel's order."""
        return (
            self.coulomb,
            self.static,
            self.stribeck_velocity,
            self.stiffness,
            self.damping,
            self.viscous,
        )


@dataclass(frozen=True)
class CompensatorConfig:
    """Both directions' friction and the known delay of the actuation."""

    positive: LugreParameters = field(default_factory=LugreParameters)
    negative: LugreParameters = field(default_factory=LugreParameters)
    actuation_delay: float = setting(
        0.0, "s", 0.0, 0.1, "known delay between the commanded torque and its action"
    )
    share: float = share_setting()
    rest_speed: float = rest_speed_setting()
    rest_torque: float = rest_torque_setting()

    def validate(self, where: str = "compensator") -> None:
        """Raises InputError naming every value that is out of its range or not a number."""
        validate(self, where)


def compensator_parameters(config: CompensatorConfig, dt: float) -> Array:
    """The kernels' parameter array for a tick of `dt` seconds."""
    lead = config.actuation_delay + 0.5 * dt
    chosen = config.share, config.rest_speed, config.rest_torque
    return np.array([*config.positive.packed(), *config.negative.packed(), lead, dt, *chosen])


@njit(_SIGNATURE, cache=True)
def lugre_step(state: Array, parameters: Array, v_ref: float, a_ref: float) -> float:
    """One tick: the torque to add to the command. `state` is updated in place."""
    velocity = v_ref + a_ref * parameters[_LEAD]
    if state[_PRIMED] == 0.0:
        state[_PRIMED] = 1.0
        state[_SPEED] = velocity
    motion = state[_STATE_HEADER:]
    motion[VELOCITY] = velocity
    motion[DRY_SCALE] = motion[VISCOUS_SCALE] = 1.0
    motion[TRAVEL] = 0.5 * (state[_SPEED] + velocity) * parameters[_DT]
    if velocity < 0.0 <= state[_SPEED]:
        state[DEFLECTION] *= parameters[_STIFFNESS] / parameters[_NEGATIVE + _STIFFNESS]
    elif state[_SPEED] < 0.0 <= velocity:
        state[DEFLECTION] *= parameters[_NEGATIVE + _STIFFNESS] / parameters[_STIFFNESS]
    state[_SPEED] = velocity
    bristle = state[DEFLECTION:_SPEED]
    if velocity < 0.0:
        torque = friction(motion, parameters[_NEGATIVE:_LEAD], bristle, parameters[_DT])
    else:
        torque = friction(motion, parameters[:_NEGATIVE], bristle, parameters[_DT])
    return float(parameters[_SHARE] * rested(torque, velocity, parameters[_REST_SPEED], parameters[_REST_TORQUE]))


@njit(_SIGNATURE, cache=True)
def stribeck_step(  # the memory is there for the common signature
    state: Array,  # noqa: ARG001
    parameters: Array,
    v_ref: float,
    a_ref: float,
) -> float:
    """One tick of the memoryless feed-forward: the Stribeck curve at the reference speed, 0 at rest."""
    velocity = v_ref + a_ref * parameters[_LEAD]
    if velocity == 0.0:
        return 0.0
    at = _NEGATIVE if velocity < 0.0 else 0
    level = stribeck_level(velocity, parameters[at], parameters[at + 1], parameters[at + 2])
    torque = math.copysign(level, velocity) + parameters[at + 5] * velocity
    return float(parameters[_SHARE] * rested(torque, velocity, parameters[_REST_SPEED], parameters[_REST_TORQUE]))


class Compensator(Protocol):
    """A feed-forward of friction, one `step` a tick."""

    def step(self, v_ref: float, a_ref: float) -> float:
        """The torque to add to the command (N m), from this tick's reference speed and acceleration."""

    def reset(self) -> None:
        """Forget the past."""


class _KernelCompensator:
    def __init__(self, config: CompensatorConfig, dt: float) -> None:
        self._state = np.zeros(STATES)
        self.dt = dt
        self.configure(config)

    def configure(self, config: CompensatorConfig, dt: float | None = None) -> None:
        """Use other parameters, at once; a bad one raises InputError and changes nothing. dt: s, as before by default."""
        config.validate()
        self.config, self.dt = config, dt or self.dt
        self.parameters = compensator_parameters(config, self.dt)

    def reset(self) -> None:
        """Forget the bristle's deflection."""
        self._state[:] = 0.0


class LugreCompensator(_KernelCompensator):
    """The LuGre model run on the reference motion."""

    def continued(self, config: CompensatorConfig, dt: float) -> LugreCompensator:
        """The same with other parameters, which goes on from the state of this one.

        The bristle keeps its deflection as a share of that of steady sliding, and with it the share of the dry friction.
        """
        other = LugreCompensator(config, dt)
        other._state[:] = self._state
        other._state[DEFLECTION] *= other._steady_deflection / self._steady_deflection
        return other

    @property
    def _steady_deflection(self) -> float:
        """Of steady sliding at the speed of the last tick, rad."""
        speed = float(self._state[_SPEED])
        way = self.config.negative if speed < 0.0 else self.config.positive
        return float(stribeck_level(speed, way.coulomb, way.static, way.stribeck_velocity)) / way.stiffness

    def step(self, v_ref: float, a_ref: float) -> float:
        """The torque to add to the command (N m), from this tick's reference speed and acceleration."""
        torque: float = lugre_step(self._state, self.parameters, v_ref, a_ref)
        return torque

    @property
    def deflection(self) -> float:
        """The modelled bristle deflection (rad)."""
        return float(self._state[DEFLECTION])


class StribeckFeedforward(_KernelCompensator):
    """Static friction feed-forward, without the bristle."""

    def step(self, v_ref: float, a_ref: float) -> float:
        """The torque to add to the command (N m), from this tick's reference speed and acceleration."""
        torque: float = stribeck_step(self._state, self.parameters, v_ref, a_ref)
        return torque
