"""An axis on MuJoCo: what stands around its hinge as a model of the engine, and the closed loop that moves it.

The equations of motion, the friction, the springs, gaps, fluids and motors are the engine's. Here are only the controller, the
encoder, and noise. The package is in the optional set `bench`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.mujoco_motion import Motion
from tcs_friction.errors import InputError
from tcs_friction.recording.recording import Recording

NOISE_CORNER = 10.0  # Hz, of the torque that nobody logs
SPEED_CORNER = 100.0  # Hz, of the measured speed's filter
UNSTABLE = 30.0  # times the friction, a torque that no stable loop asks for

Before = Callable[[int, Any, Any], None]
"""Called before each sample with its number, the engine's model and data: sets what the surroundings do."""


@dataclass
class Model:
    """A model of the engine that grows while a world is drawn. `base`: inertia of the hinge's own body, kg m^2."""

    base: float
    hinge: dict[str, str] = field(default_factory=lambda: {"axis": "0 0 1"})
    option: dict[str, str] = field(default_factory=dict)
    inside: list[str] = field(default_factory=list)  # bodies and geoms that turn with the hinge
    world: list[str] = field(default_factory=list)
    tendons: list[str] = field(default_factory=list)
    equalities: list[str] = field(default_factory=list)
    actuators: list[str] = field(default_factory=list)
    drive: str = '<motor name="drive" joint="axis"/>'
    command: float = 1.0  # of the drive's input for each N m
    start: dict[str, float] = field(default_factory=dict)  # joint -> position, where it is not zero
    before: list[Before] = field(default_factory=list)
    speeds: dict[str, str] = field(default_factory=dict)  # recorded signal -> joint whose speed it is

    def xml(self, step: float) -> str:
        """The model in the engine's own format, MJCF, to be integrated with steps of `step` seconds."""
        option = _words({"timestep": f"{step:.9g}", "gravity": "0 0 0", "integrator": "RK4", **self.option})
        return f"""<mujoco>
<compiler angle="radian" autolimits="true"/>
<option {option}/>
<worldbody>
{_lines(self.world)}
<body name="body"><joint name="axis" type="hinge" {_words(self.hinge)}/>
<inertial pos="0 0 0" mass="{self.base:.9g}" diaginertia="{self.base:.9g} {self.base:.9g} {self.base:.9g}"/>
{_lines(self.inside)}
</body></worldbody>
<tendon>{_lines(self.tendons)}</tendon>
<equality>{_lines(self.equalities)}</equality>
<actuator>{self.drive}
{_lines(self.actuators)}</actuator>
</mujoco>"""


@dataclass(frozen=True)
class Loop:
    """Cascaded controller, encoder and noise of one class of axis."""

    substeps: int  # of the engine in a period
    speed_gain: float  # N m s/rad
    position_gain: float  # 1/s
    integral: float  # 1/s
    resolution: float  # rad
    encoder_noise: float  # rad rms
    torque_noise: float  # N m rms
    highest: float  # N m, beyond which the loop is unstable


class Unstable(Exception):  # noqa: N818 an outcome, caught where a world is drawn
    """The loop asked for a torque that no stable one asks for."""


def engine() -> Any:
    """The package; InputError says how to get it."""
    try:
        import mujoco
    except ImportError:
        raise InputError("mujoco", "is not installed", "./tcs bench concealed, which installs it") from None
    return mujoco


def run(
    model: Model,
    motion: Motion,
    loop: Loop,
    rng: np.random.Generator,
    away: float = 0.0,
    exogenous: Mapping[str, np.ndarray] | None = None,
    temperature: np.ndarray | None = None,
    refine: int = 1,
) -> Recording:
    """The closed loop over the whole motion, from rest `away` (rad) from its start.

    The torque logged at a sample acts until the next one. `refine` divides the engine's step. Raises Unstable.
    """
    mujoco = engine()
    count, period = len(motion.position), motion.period
    substeps = loop.substeps * refine
    compiled = mujoco.MjModel.from_xml_string(model.xml(period / substeps))
    data = mujoco.MjData(compiled)
    places = {name: compiled.joint(name).qposadr[0] for name in ("axis", *model.start)}
    rates = {name: compiled.joint(joint).dofadr[0] for name, joint in model.speeds.items()}
    drive, axis, dof = input_of(compiled, "drive"), places["axis"], compiled.joint("axis").dofadr[0]
    for name, value in {"axis": float(motion.position[0]) + away, **model.start}.items():
        data.qpos[places[name]] = value
    noise = (loop.torque_noise * coloured(rng, count, NOISE_CORNER * period)).tolist()
    seen = (loop.encoder_noise * rng.standard_normal(count)).tolist()
    wanted = zip(motion.position.tolist(), motion.velocity.tolist(), strict=True)
    out, others = np.empty((count, 3)), np.empty((count, len(rates)))
    gain = 1.0 - math.exp(-2.0 * math.pi * SPEED_CORNER * period)
    last, speed, integral = None, 0.0, 0.0
    for k, (target, rate) in enumerate(wanted):
        measured = loop.resolution * math.floor((float(data.qpos[axis]) + seen[k]) / loop.resolution + 0.5)
        speed += 0.0 if last is None else gain * ((measured - last) / period - speed)
        last = measured
        error = rate + loop.position_gain * (target - measured) - speed
        integral += loop.integral * error * period
        torque = loop.speed_gain * (error + integral)
        out[k] = measured, speed, torque
        others[k] = [data.qvel[place] for place in rates.values()]
        for act in model.before:
            act(k, compiled, data)
        data.ctrl[drive] = torque * model.command
        data.qfrc_applied[dof] = noise[k]
        mujoco.mj_step(compiled, data, substeps)
        if not abs(torque) < loop.highest:
            raise Unstable
    recorded = {name: others[:, i] for i, name in enumerate(rates)} | dict(exogenous or {})
    return Recording(
        motion.t,
        out[:, 0],
        out[:, 2],
        velocity=out[:, 1],
        temperature=temperature,
        exogenous=recorded,
        source="world",
    )


def input_of(model: Any, actuator: str) -> int:
    """Where in the engine's inputs that of an actuator is; passive ones have none."""
    return int(model.actuator_ctrladr[model.actuator(actuator).id])


def coloured(rng: np.random.Generator, count: int, corner: float) -> np.ndarray:
    """First-order noise of unit variance, (count,); corner in cycles a sample."""
    decay = math.exp(-2.0 * math.pi * corner)
    white = rng.standard_normal(count) * math.sqrt(1.0 - decay * decay)
    white[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -decay], white))


def _words(attributes: Mapping[str, str]) -> str:
    return " ".join(f'{name}="{value}"' for name, value in attributes.items())


def _lines(parts: list[str]) -> str:
    return "\n".join(parts)
