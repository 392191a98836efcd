"""An axis on MuJoCo: a joint of a user's model is the axis, and everything around it is the model's.

The equations of motion, gravity, friction, springs and contacts are the engine's. The drive (limit, noise, actuation delay) and
the encoder are those of the axis file, by the same kernels as in the simulated axis. The package is in the optional set `mujoco`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError, JobError, nearest, one_line
from tcs_friction.physics import machine as compiled
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.simulate import Simulator

HOME = "home"
"""The keyframe of a model in which its other joints begin, and whose controls its other actuators keep."""


def engine() -> Any:
    """The package. Raises InputError that says how to get it."""
    try:
        import mujoco
    except ImportError:
        raise InputError("MuJoCo", "the package is not installed", "./tcs node mujoco_plant, or pip install mujoco") from None
    if mujoco.get_mju_user_warning() is None:  # by default it writes a file where the process was started
        mujoco.set_mju_user_warning(lambda text: None)  # noqa: ARG005 the engine gives it one
    return mujoco


class MujocoSimulator(Simulator):
    """A joint of a MuJoCo model that advances one control period at a time.

    It begins at rest at `position`; other joints begin as keyframe `home` has them, without one at the model's zero. `friction`
    is 0: the engine does not tell what of its torques is friction, and all of them are in `opposing`. Same model, seed and
    commands: same motion, bit for bit.

    Parameters
    ----------
    axis: whose drive and sensors are simulated; nothing else of it is.
    path: the model, MJCF or URDF.
    joint: name of a hinge or slide in it.
    period, seed, position: as for `Simulator`.

    Raises
    ------
    InputError: the file cannot be read as a model, has no such joint, or one of another kind than the axis; no package.
    """

    def __init__(
        self, axis: Axis, path: Path, joint: str, period: float = 1e-3, seed: int = 0, position: float = 0.0
    ) -> None:
        mujoco = engine()
        self._mujoco, self._path = mujoco, path
        self._model = _compiled(mujoco, path)
        self.joint = joint
        chosen = _chosen(mujoco, self._model, path, joint, axis)
        step = float(self._model.opt.timestep)
        if not period > 0.0:
            raise InputError("simulator: period", repr(period), "a positive number of seconds")
        substeps = max(1, math.ceil(period / step - 1e-9))
        super().__init__(replace(axis, effects=()), period, seed, position, substeps=substeps)
        self._model.opt.timestep = period / substeps
        self.notes = _without_servos(mujoco, self._model, chosen)
        """What was changed in the model, in words."""
        self._data = _at_home(mujoco, self._model)
        self._place, self._dof = int(self._model.jnt_qposadr[chosen]), int(self._model.jnt_dofadr[chosen])
        self._data.qpos[self._place], self._data.qvel[self._dof] = position, 0.0
        self._torques = np.zeros(substeps)
        others = [k for k in _single(mujoco, self._model) if k != chosen]
        self.other_joints = tuple(_name(self._model, k) for k in others)
        """Names of all other hinges and slides of the model."""
        self._places, self._dofs = self._model.jnt_qposadr[others], self._model.jnt_dofadr[others]
        data = self._data
        self._parts = (data.qfrc_bias, data.qfrc_passive, data.qfrc_actuator, data.qfrc_constraint)
        self._qpos, self._qvel, self._push = data.qpos, data.qvel, data.qfrc_applied
        self._troubles = data.warning.number
        kinds = mujoco.mjtWarning
        self._bad = [int(kind) for kind in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)]
        mujoco.mj_forward(self._model, data)

    @property
    def inertia(self) -> float:
        """What moves with the joint where the model is now, the other joints held, kg m^2."""
        full = np.zeros((self._model.nv, self._model.nv))
        self._mujoco.mj_fullM(self._model, self._data, full)
        return float(full[self._dof, self._dof])

    @property
    def armature(self) -> float:
        """The part of it that the model adds to the joint for a rotor, kg m^2."""
        return float(self._model.dof_armature[self._dof])

    def begin(self, position: float, velocity: float) -> None:
        """Begin anew at a position (rad) and velocity (rad/s); all else is as at the start."""
        mujoco, data = self._mujoco, self._data
        _home(mujoco, self._model, data)
        self.hold(position, velocity)
        mujoco.mj_forward(self._model, data)
        body = self.machine.body
        self.machine.states[:] = 0.0
        body[:] = 0.0
        body[[compiled.TRUE_POSITION, compiled.MEASURED, compiled.LAST_MIDDLE]] = position
        body[compiled.TRUE_VELOCITY] = velocity

    @property
    def place(self) -> tuple[float, float]:
        """Where the joint is and how fast, rad and rad/s."""
        return float(self._qpos[self._place]), float(self._qvel[self._dof])

    def hold(self, position: float, velocity: float) -> None:
        """Put the joint where it was measured; bristles and what else the model remembers go on."""
        self._data.qpos[self._place], self._data.qvel[self._dof] = position, velocity

    def other_positions(self) -> tuple[float, ...]:
        """True positions of `other_joints`, rad or m."""
        return tuple(self._qpos[self._places].tolist())

    def other_velocities(self) -> tuple[float, ...]:
        """True speeds of `other_joints`, rad/s or m/s."""
        return tuple(self._qvel[self._dofs].tolist())

    def step(
        self,
        command: float,
        temperature: float = 20.0,
        exogenous: tuple[float, ...] = (),  # noqa: ARG002
        rates: tuple[float, ...] | None = None,  # noqa: ARG002
    ) -> float:
        """As of `Simulator`. The model knows nothing of temperature and signals."""
        return super().step(command, temperature)

    def _tick(self, command: float, torque_normal: float, encoder_normal: float) -> float:
        torques, dof, push = self._torques, self._dof, self._push
        applied = float(compiled.begin_period(self.machine, command, torque_normal, torques))
        if (torques == torques[0]).all():
            push[dof] = torques[0]
            self._mujoco.mj_step(self._model, self._data, len(torques))
        else:
            for torque in torques:
                push[dof] = torque
                self._mujoco.mj_step(self._model, self._data)
        position, velocity = float(self._qpos[self._place]), float(self._qvel[dof])
        if self._troubles[self._bad].any() or not (math.isfinite(position) and math.isfinite(velocity)):
            where = f"at {self.ticks * self.period:g} s"
            raise JobError(str(self._path), f"the model became unstable {where}", "a shorter timestep in it, or lower gains")
        bias, passive, actuators, constraints = self._parts
        opposing = float(bias[dof] - passive[dof] - actuators[dof] - constraints[dof])
        compiled.end_period(self.machine, position, velocity, opposing, encoder_normal)
        return applied


def _compiled(mujoco: Any, path: Path) -> Any:
    """The engine's model of a file. Raises InputError with the engine's own words."""
    if not path.is_file():
        raise InputError(str(path), "no such file", "a model of MuJoCo (MJCF or URDF)")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        found = one_line(str(error).strip()).removeprefix("XML Error: ").removeprefix("Error: ")
        raise InputError(str(path), f"not read by MuJoCo ({found})", "a model in MJCF or URDF") from None


def _name(model: Any, joint: int) -> str:
    return str(model.joint(joint).name) or f"joint{joint}"


def _single(mujoco: Any, model: Any) -> list[int]:
    """The joints with one degree of freedom."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [k for k in range(model.njnt) if int(model.jnt_type[k]) in kinds]


def _chosen(mujoco: Any, model: Any, path: Path, joint: str, axis: Axis) -> int:
    """The number of the joint that is the axis; InputError where it cannot be."""
    named = {_name(model, k): k for k in range(model.njnt)}
    if joint not in named:
        raise InputError(str(path), f"no joint {joint}", nearest(joint, [_name(model, k) for k in _single(mujoco, model)]))
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): ("hinge", "rotary"), int(mujoco.mjtJoint.mjJNT_SLIDE): ("slide", "linear")}
    word, kind = kinds.get(int(model.jnt_type[named[joint]]), ("", ""))
    if not word:
        raise InputError(str(path), f"joint {joint} is neither a hinge nor a slide", "a joint with one degree of freedom")
    if kind != axis.kind:
        raise InputError(str(path), f"joint {joint} is a {word}", f"kind: {kind} in the axis file; it says {axis.kind}")
    if joint != axis.name and axis.name in named:
        found = f"joint {joint} would be published as {axis.name}, the name of another joint"
        raise InputError(str(path), found, f"an axis file whose name is {joint}, or joint {axis.name}")
    return named[joint]


def _without_servos(mujoco: Any, model: Any, chosen: int) -> tuple[str, ...]:
    """Switch off the servos of a joint, for its torque is commanded; returns what was done, in words."""
    on_joint = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    notes = []
    for k in range(len(model.actuator_gaintype)):  # nu counts their inputs
        if int(model.actuator_trntype[k]) not in on_joint or int(model.actuator_trnid[k, 0]) != chosen:
            continue
        affine = int(model.actuator_biastype[k]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
        feedback = affine and bool(model.actuator_gainprm[k, 0]) and bool(model.actuator_biasprm[k, 1:3].any())
        if feedback or int(model.actuator_gaintype[k]) == int(mujoco.mjtGain.mjGAIN_PID):
            model.actuator_gainprm[k] = model.actuator_biasprm[k] = 0.0
            name = model.actuator(k).name or f"number {k}"
            notes.append(f"actuator {name} is a servo of joint {_name(model, chosen)} and switched off: torque is commanded")
    return tuple(notes)


def _at_home(mujoco: Any, model: Any) -> Any:
    """The engine's data where the model begins."""
    data = mujoco.MjData(model)
    _home(mujoco, model, data)
    return data


def _home(mujoco: Any, model: Any, data: Any) -> None:
    """Puts everything to where the model begins."""
    mujoco.mj_resetData(model, data)
    home = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, HOME)
    if home >= 0:
        mujoco.mj_resetDataKeyframe(model, data, home)
