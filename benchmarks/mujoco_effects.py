"""What the MuJoCo worlds lack, built from parts that the engine has: each function adds parts to a model and says what is right.

Sizes are torques rms over that of the noise, as far as the reference foretells them; the truth file says what was built.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from benchmarks.mujoco_axis import Loop, Model, coloured, input_of
from benchmarks.mujoco_motion import Motion

AIR = 1.2  # kg/m^3
SHARP = 'solreflimit="{0:.6g} {1:.3g}" solimplimit="0.95 0.99 1e-5"'


@dataclass
class Setting:
    """A world while it is drawn; effects change `model`, `exogenous` and `details`."""

    rng: np.random.Generator
    telescope: bool
    inertia: float  # kg m^2, of all that turns
    floor: float  # N m rms
    size: float  # of the effect, times the floor
    motion: Motion
    loop: Loop
    model: Model
    friction: Mapping[str, float]
    exogenous: dict[str, np.ndarray] = field(default_factory=dict)
    details: dict[str, float] = field(default_factory=dict)

    @property
    def torque(self) -> float:
        """Wanted rms, N m."""
        return self.size * self.floor

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        return float(self.rng.choice((-1.0, 1.0)))

    def take(self, part: float) -> None:
        """Inertia that another body brings; the first one has the less."""
        self.model.base -= part
        if self.model.base < 0.3 * self.inertia:
            raise ValueError("parts are heavier than the axis")


@dataclass(frozen=True)
class Truth:
    """What is right to say of an effect: see `Expected`."""

    effects: tuple[tuple[str, ...], ...]
    note: str
    tolerated: frozenset[str] = frozenset()
    outside: bool = False
    partial: bool = False


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


PASSED = 5.0  # waves of cogging in the travel, at least: what comes by less often is no wave that anybody could know


def cogging(s: Setting) -> Truth:
    fewest = math.ceil(PASSED * 2.0 * math.pi / float(np.ptp(s.motion.position)))
    poles = int(s.rng.integers(18, 97)) if s.telescope else int(s.rng.integers(max(8, fewest), 61))
    amplitude, phase = math.sqrt(2.0) * s.torque, s.between(0.0, 6.28)
    s.model.actuators.append(
        '<dcmotor name="cogging" joint="axis" motorconst="1e-9" resistance="1" input="none" '
        f'cogging="{amplitude:.9g} {poles} {phase:.9g}"/>'
    )
    s.details |= {"order": float(poles), "amplitude": amplitude}
    return Truth((("cogging",),), "the motor cogs")


def lag(s: Setting) -> Truth:
    """The current of a motor lags behind its voltage."""
    constant = s.between(0.002, 0.006)
    s.model.drive = (
        '<dcmotor name="drive" joint="axis" motorconst="1" resistance="1" input="ff" '
        f'inductance="0 {constant:.9g}"/>'
    )
    s.details["time_constant"] = constant
    return Truth((("actuator_lag", "transport_delay"),), "the motor's current lags")


def delay(s: Setting) -> Truth:
    samples = int(s.rng.integers(2, 6)) * s.loop.substeps
    step = s.motion.period / s.loop.substeps
    s.model.drive = (
        f'<motor name="drive" joint="axis" nsample="{4 * samples + 2}" delay="{samples * step:.9g}"/>'
    )
    s.details["delay"] = samples * step
    return Truth((("transport_delay", "actuator_lag"),), "the drive acts later than believed")


def mode(s: Setting) -> Truth:
    ratio = s.between(0.15, 0.4)
    frequency, damping = s.between(12.0, 30.0), s.between(0.01, 0.05)
    load, omega = ratio * s.inertia, 2.0 * math.pi * frequency
    reduced = load * (s.inertia - load) / s.inertia
    s.take(load)
    s.model.inside.append(
        _load(load, f'stiffness="{reduced * omega**2:.9g}" damping="{2.0 * damping * omega * reduced:.9g}"')
    )
    s.details |= {"frequency": frequency, "damping": damping, "inertia_ratio": ratio}
    return Truth((("flexible_mode",),), "part of the inertia hangs on a spring")


def backlash(s: Setting) -> Truth:
    """Part of the inertia moves freely between two stops of the joint."""
    ratio = s.between(0.15, 0.4)
    gap = 10.0 ** s.between(-4.3, -3.3) if s.telescope else 10.0 ** s.between(-3.3, -2.3)
    load = ratio * s.inertia
    s.take(load)
    contact = SHARP.format(s.between(0.003, 0.006), s.between(0.3, 0.7))
    s.model.inside.append(_load(load, f'range="{-0.5 * gap:.9g} {0.5 * gap:.9g}" limited="true" {contact}'))
    s.details |= {"gap": gap, "inertia_ratio": ratio}
    return Truth((("backlash",),), "part of the inertia is coupled through a gap")


def _load(inertia: float, joint: str) -> str:
    return (
        f'<body name="load"><joint name="load" type="hinge" axis="0 0 1" {joint}/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{inertia:.9g} {inertia:.9g} {inertia:.9g}"/></body>'
    )


def gravity(s: Setting) -> Truth:
    """A mass off centre, on a hinge that does not stand upright."""
    tilt, phase = s.between(0.3, 0.5 * math.pi), s.between(0.0, 6.28)
    amplitude = s.torque / rms(np.sin(s.motion.position + phase))
    arm = s.between(0.3, 0.8) * (3.0 if s.telescope else 0.3)
    mass = amplitude / (9.81 * math.sin(tilt) * arm)
    s.take(mass * arm**2)
    s.model.option["gravity"] = f"{-9.81 * math.sin(tilt):.9g} 0 {-9.81 * math.cos(tilt):.9g}"
    x, y = arm * math.cos(phase), arm * math.sin(phase)
    s.model.inside.append(
        f'<body><inertial pos="{x:.9g} {y:.9g} 0" mass="{mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    # In the hinge's frame gravity points to -x: the opposing torque is -amplitude sin(q + phase)
    s.details |= {"amplitude": amplitude, "phase": phase + math.pi}
    return Truth((("imbalance",),), "a mass off centre")


def spring(s: Setting) -> Truth:
    """A torsion spring that hardens, at rest where the encoder does not read zero."""
    rest = s.between(-0.6, 0.6) * float(np.abs(s.motion.position).max())
    deflection = s.motion.position - rest
    hard = s.between(0.0, 0.3) / float(np.abs(deflection).max()) ** 2
    linear = s.torque / rms(deflection + hard * deflection**3)
    s.model.hinge |= {"stiffness": f"{linear:.9g} 0 {hard * linear:.9g}", "springref": f"{rest:.9g}"}
    s.details |= {"stiffness": linear, "cubic": hard * linear, "neutral": rest}
    return Truth((("cable_wrap",),), "a hardening spring whose rest is not at zero")


def tendon(s: Setting) -> Truth:
    """A coil spring from a post to an arm on the axis: no polynomial of the angle, nearly the sine that gravity has."""
    arm, post, angle = s.between(0.4, 0.6), s.between(1.0, 1.6), s.between(0.0, 6.28)
    length = s.between(0.0, 0.4) * post
    swing = s.motion.position - angle
    path = np.sqrt(arm**2 + post**2 - 2.0 * arm * post * np.cos(swing))
    stiffness = s.torque / rms((path - length) / path * arm * post * np.sin(swing))
    s.model.world.append(
        f'<site name="post" pos="{post * math.cos(angle):.9g} {post * math.sin(angle):.9g} 0"/>'
    )
    s.model.inside.append(f'<site name="arm" pos="{arm:.9g} 0 0"/>')
    s.model.tendons.append(
        f'<spatial stiffness="{stiffness:.9g}" springlength="{length:.9g}"><site site="post"/><site site="arm"/></spatial>'
    )
    s.details |= {"stiffness": stiffness, "length": length, "arm": arm, "post": post}
    return Truth((("imbalance", "cable_wrap"),), "a coil spring between a post and an arm", partial=True)


def slack_cable(s: Setting) -> Truth:
    """A cable that hangs through in the middle of the travel and pulls at both ends."""
    reach = float(np.abs(s.motion.position).max())
    low, high = -s.between(0.2, 0.5) * reach, s.between(0.2, 0.5) * reach
    pulled = s.motion.position - np.clip(s.motion.position, low, high)
    stiffness = s.torque / rms(pulled)
    s.model.tendons.append(
        f'<fixed stiffness="{stiffness:.9g}" springlength="{low:.9g} {high:.9g}"><joint joint="axis" coef="1"/></fixed>'
    )
    s.details |= {"stiffness": stiffness, "slack_from": low, "slack_to": high}
    return Truth((("cable_wrap",),), "a cable that is slack in the middle of the travel", partial=True)


def cable_friction(s: Setting) -> Truth:
    """A cable that drags along: a spring to a drum that slips (one Jenkins element)."""
    level = 1.1 * s.torque
    width = 10.0 ** s.between(-1.8, -1.1) * (1.0 if s.telescope else 4.0)
    stiffness = level / width
    drum = stiffness / (2.0 * math.pi * 25.0) ** 2
    s.model.world.append(
        f'<body name="drum"><joint name="drum" type="hinge" axis="0 0 1" frictionloss="{level:.9g}" '
        f'solreffriction="4e-4 1" solimpfriction="0.99 0.999 1e-6"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{drum:.9g} {drum:.9g} {drum:.9g}"/></body>'
    )
    s.model.tendons.append(
        f'<fixed stiffness="{stiffness:.9g}" damping="{0.6 * math.sqrt(stiffness * drum):.9g}">'
        '<joint joint="axis" coef="1"/><joint joint="drum" coef="-1"/></fixed>'
    )
    s.model.start["drum"] = float(s.motion.position[0])
    s.details |= {"amplitude": level, "width": width}
    return Truth((("cable_hysteresis",),), "a cable that drags along", partial=True)


def coupling(s: Setting) -> Truth:
    """A balanced wheel on the axis with a servo of its own; its speed is logged as that of the other axis."""
    count, period = len(s.motion.position), s.motion.period
    speed = 0.15 if s.telescope else 2.0
    ask = np.cumsum(_wandering(s.rng, count, period, 0.08 if s.telescope else 0.3) * speed) * period
    acceleration = np.gradient(np.gradient(ask, period), period)
    inertia = min(s.torque / rms(acceleration), 0.4 * s.inertia)
    s.take(inertia)
    s.model.inside.append(
        '<body name="wheel"><joint name="wheel" type="hinge" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{inertia:.9g} {inertia:.9g} {inertia:.9g}"/></body>'
    )
    _servo(s, "wheel", ask, inertia)
    s.details["inertia_of_wheel"] = inertia
    return Truth((("cross_axis_coupling",),), "a driven wheel on the axis")


def elbow(s: Setting) -> Truth:
    """A second joint swings a mass out and in: the inertia follows an angle that nobody logs, only its speed."""
    count, period = len(s.motion.position), s.motion.period
    ask = 0.7 * _wandering(s.rng, count, period, 0.05 if s.telescope else 0.3)
    square = np.cos(ask) ** 2
    momentum = np.gradient((square - square.mean()) * s.motion.velocity, period)
    moment = min(s.torque / rms(momentum), 0.5 * s.inertia)
    arm = 1.0 if s.telescope else 0.3
    mass = moment / arm**2
    s.take(moment * float(square.mean()))
    s.model.inside.append(
        '<body name="elbow"><joint name="elbow" type="hinge" axis="0 1 0"/>'
        f'<inertial pos="{arm:.9g} 0 0" mass="{mass:.9g}" diaginertia="1e-6 1e-6 1e-6"/></body>'
    )
    s.model.start["elbow"] = float(ask[0])
    _servo(s, "elbow", ask, moment)
    s.details["inertia_of_forearm"] = moment
    return Truth((), "an elbow that changes the inertia, its angle not logged", outside=True)


def _servo(s: Setting, joint: str, ask: np.ndarray, inertia: float) -> None:
    stiff = inertia * (2.0 * math.pi * 6.0) ** 2
    s.model.actuators.append(
        f'<position name="{joint}" joint="{joint}" kp="{stiff:.9g}" kv="{1.4 * math.sqrt(stiff * inertia):.9g}"/>'
    )
    asked = ask.tolist()

    def follow(k: int, model: Any, data: Any) -> None:
        data.ctrl[input_of(model, joint)] = asked[k]

    s.model.before.append(follow)
    s.model.speeds["elevation_velocity"] = joint


def _wandering(rng: np.random.Generator, count: int, period: float, corner: float) -> np.ndarray:
    """A smooth random course of unit variance, (count,), that starts at zero; corner in Hz."""
    x = gaussian_filter1d(coloured(rng, count, corner * period), 0.15 / corner / period)
    return np.asarray((x - x[0]) / x.std() * np.clip(np.arange(count) * period, 0.0, 1.0))


EFFECTS: Mapping[str, Callable[[Setting], Truth]] = {
    "cogging": cogging,
    "lag": lag,
    "delay": delay,
    "mode": mode,
    "backlash": backlash,
    "gravity": gravity,
    "spring": spring,
    "tendon": tendon,
    "slack-cable": slack_cable,
    "cable-friction": cable_friction,
    "coupling": coupling,
    "elbow": elbow,
}
