"""More of what the MuJoCo worlds lack: air, loads, machines on the axis, stops, and a motor that gets hot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.mujoco_axis import coloured, input_of
from benchmarks.mujoco_effects import AIR, Setting, Truth, rms

SOFT = 0.01  # share of all other accelerations that a contact takes over; with little of it a contact is a spring and a damper
COPPER = 0.0039  # 1/K, by which the resistance of a winding grows


def drag(s: Setting) -> Truth:
    v = s.motion.velocity
    coefficient = s.torque / rms(v * v)
    s.model.hinge["damping"] = f"0 {coefficient:.9g} 0"
    s.details["coefficient"] = coefficient
    return Truth((("quadratic_drag",),), "drag that grows with the square of the speed")


def bias(s: Setting) -> Truth:
    """A spring of constant force."""
    torque = s.sign() * s.torque
    s.model.actuators.append(
        f'<general name="bias" joint="axis" gaintype="fixed" gainprm="0" biastype="affine" biasprm="{-torque:.9g} 0 0"/>'
    )
    s.details["bias"] = torque
    return Truth((("torque_bias",),), "a spring of constant force")


def load_step(s: Setting) -> Truth:
    """A weight is hung on, or taken off, amid the recording."""
    torque, at = s.sign() * 1.5 * s.torque, int(len(s.motion.position) * s.between(0.3, 0.7))
    s.model.actuators.append('<motor name="weight" joint="axis"/>')

    def hang(k: int, model: Any, data: Any) -> None:
        data.ctrl[input_of(model, "weight")] = -torque if k >= at else 0.0

    s.model.before.append(hang)
    s.details |= {"step": torque, "time": at * s.motion.period}
    return Truth((("load_step",),), "a load that appears")


def wind(s: Setting) -> Truth:
    """A panel in the wind. It turns its face away while the axis turns, and the axis' own motion is wind, too."""
    area = _panel(s)
    s.details["area"] = area
    turned = float(np.abs(s.motion.position).max())
    outside = 1.0 - math.cos(turned) > 0.3  # the face is so far away that wind squared alone says little
    tolerated = frozenset({"wind_torque"}) if outside else frozenset()
    note = f"wind on a panel that turns by {turned:.2g} rad"
    return Truth(() if outside else (("wind_torque",),), note, tolerated, outside, partial=True)


def _panel(s: Setting) -> float:
    """Adds the panel and the wind; returns its area (m^2)."""
    count, period = len(s.motion.position), s.motion.period
    speed = s.between(5.0, 6.5) + 2.4 * coloured(s.rng, count, period / (2.0 * math.pi * 6.0))
    arm = 1.5
    facing = np.cos(s.motion.position)
    area = s.torque / (0.5 * AIR * arm * rms((facing * speed) ** 2))
    half, mass = 0.5 * math.sqrt(area), 20.0 * area
    s.take(mass * (arm**2 + area / 12.0))
    s.model.option["density"] = f"{AIR}"
    s.model.inside.append(
        f'<body pos="{arm} 0 0"><geom type="box" size="{half:.9g} 0.005 {half:.9g}" mass="{mass:.9g}" '
        'contype="0" conaffinity="0"/></body>'
    )
    blowing = speed.tolist()

    def blow(k: int, model: Any, _data: Any) -> None:
        model.opt.wind[1] = blowing[k]

    s.model.before.append(blow)
    s.exogenous["wind_speed"] = speed
    return area


def yoke(s: Setting) -> Truth:
    """A scotch yoke: a slider that a crank on the axis moves along a line, so that the inertia goes with cos 2q."""
    q, v = s.motion.position, s.motion.velocity
    angle = s.between(0.0, math.pi)
    momentum = np.gradient(np.cos(2.0 * (q + angle)) * v, s.motion.period)
    half = min(s.torque / rms(momentum), 0.25 * s.inertia)  # kg m^2, of the inertia's wave
    arm = 1.0 if s.telescope else 0.2
    mass = 2.0 * half / arm**2
    s.take(half)
    x, y = arm * math.cos(angle), arm * math.sin(angle)
    s.model.world.append(
        f'<body name="slider" pos="{x:.9g} {y:.9g} 0"><joint name="slider" type="slide" axis="1 0 0"/>'
        f'<inertial pos="0 0 0" mass="{mass:.9g}" diaginertia="1 1 1"/>'
        '<body name="block"><joint name="block" type="slide" axis="0 1 0"/>'
        f'<inertial pos="0 0 0" mass="{1e-4 * mass:.9g}" diaginertia="1 1 1"/></body></body>'
    )
    s.model.equalities.append(
        f'<connect body1="body" body2="block" anchor="{x:.9g} {y:.9g} 0" solref="4e-4 1" solimp="0.999 0.9999 1e-6"/>'
    )
    start = float(q[0]) + angle
    s.model.start |= {"slider": arm * math.cos(start) - x, "block": arm * math.sin(start) - y}
    s.details |= {"amplitude": half / s.inertia, "phase": 2.0 * angle + math.pi}
    return Truth((("position_dependent_inertia",),), "a slider that a crank on the axis moves along a line")


def fan(s: Setting) -> Truth:
    """A fan out of balance turns on the axis; nobody logs it."""
    frequency = s.between(2.0, 9.0)
    omega = 2.0 * math.pi * frequency
    arm = 1.5 if s.telescope else 0.3
    moment = math.sqrt(2.0) * s.torque / (arm * omega**2)  # kg m, of the fan's mass off its own axis
    off = 0.05
    mass = moment / off
    s.take(mass * arm**2)
    s.model.inside.append(
        f'<body name="fan" pos="{arm} 0 0"><joint name="fan" type="hinge" axis="0 0 1" armature="{100.0 * mass * off**2:.9g}"/>'
        f'<inertial pos="{off} 0 0" mass="{mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    s.model.actuators.append(f'<velocity name="fan" joint="fan" kv="{3000.0 * mass * off**2:.9g}"/>')

    def turn(_k: int, model: Any, data: Any) -> None:
        data.ctrl[input_of(model, "fan")] = omega

    s.model.before.append(turn)
    s.details |= {"frequency": frequency, "amplitude": math.sqrt(2.0) * s.torque}
    return Truth((("periodic_vibration",),), "a fan out of balance")


def stop(s: Setting) -> Truth:
    """A finger on the axis runs into a rubber stop at one end of the travel: a contact of the engine's."""
    high, low = float(s.motion.position.max()), float(s.motion.position.min())
    # Further in, the finger would come out of the block's sides
    depth = min(s.between(0.1, 0.25) * (high - low), 0.35)  # rad
    arm, radius, half, angle = 1.0, 0.02, 0.45, high - depth
    pressed = np.maximum(s.motion.position - angle, 0.0)
    stiffness = s.torque / rms(pressed)  # N m/rad
    x, y = arm * math.cos(angle), arm * math.sin(angle)
    # A block whose face looks against the finger's motion where they meet
    nx, ny = math.sin(angle), -math.cos(angle)
    px, py = x - (radius + half) * nx, y - (radius + half) * ny
    # The engine takes the mean over three directions for the mobility of the finger, which can move in one
    stiff = f"{-stiffness / s.inertia / 3.0:.9g} {-0.1 * stiffness / s.inertia / 3.0:.9g}"
    solver = f'condim="1" solref="{stiff}" solimp="{SOFT} {SOFT} 1e-3"'
    s.model.world.append(
        f'<geom name="rubber" type="box" size="{half} {half} {half}" pos="{px:.9g} {py:.9g} 0" '
        f'zaxis="{nx:.9g} {ny:.9g} 0" {solver}/>'
    )
    mass = 1e-4 * s.inertia
    s.take(mass * arm**2)
    s.model.inside.append(
        f'<body pos="{arm} 0 0"><geom name="finger" type="sphere" size="{radius}" mass="{mass:.9g}" {solver}/></body>'
    )
    s.details |= {"from": angle, "stiffness": stiffness}
    return Truth((), "a rubber stop at one end of the travel", outside=True)


def heat(s: Setting) -> Truth:
    """A motor on a voltage whose winding gets hot: the torque that is logged is the voltage times what was once true.

    Where friction is most of the torque, a drive that gets weaker is friction that grows.
    """
    constant = 10.0 if s.telescope else 1.0
    level = s.friction["coulomb"] + s.friction["viscous"] * rms(s.motion.velocity)
    power = (level / constant) ** 2
    rise = 2.0 * s.torque / level / COPPER  # K, when it stays warm
    time = s.between(0.15, 0.35) * len(s.motion.position) * s.motion.period
    resistance = rise / power
    s.model.drive = (
        f'<dcmotor name="drive" joint="axis" motorconst="{constant}" resistance="1" input="voltage" '
        f'thermal="{resistance:.9g} {time / resistance:.9g} 0 {COPPER} 20 20"/>'
    )
    s.model.command = 1.0 / constant
    s.details |= {"rise": rise, "time_constant": time, "back_emf_viscous": constant**2}
    tolerated = frozenset({"warmup_drift", "temperature_dependent_friction"})
    return Truth((), "a motor on a voltage that gets hot and weak", tolerated, outside=True)


SURROUNDINGS: Mapping[str, Callable[[Setting], Truth]] = {
    "drag": drag,
    "bias": bias,
    "load-step": load_step,
    "wind": wind,
    "yoke": yoke,
    "fan": fan,
    "stop": stop,
    "heat": heat,
}
