"""Commissioning after the paper's loop: diagnose the axis, cancel what is named, keep what measured tracking is better for.

Every round diagnoses the axis as it is believed so far, in a motion made for it, and tries the effects that are named and that
would matter on the run to be tracked. Rounds end when a diagnosis names nothing new, or when nothing helps.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tcs_friction.commissioning.findings import both_directions, tracking
from tcs_friction.commissioning.run import Run
from tcs_friction.commissioning.setup import COMPENSATE, CORRECTED, Setup, modelled
from tcs_friction.commissioning.stages import DiagnosisError, Stages
from tcs_friction.config import AxisFile, control_of, load_axis, save_axis
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.guard import Chosen, choose, windowed
from tcs_friction.control.model_compensator import effect_names, obstacles
from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.control.worth import ALL, LAW, Task, worth
from tcs_friction.diagnose.verification import sensor_effects, sensor_gains
from tcs_friction.errors import InputError, JobError, TcsError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import Instance, Place, instance
from tcs_friction.recording.signals import graph_signals
from tcs_friction.report.commission import TORQUE, Judged
from tcs_friction.report.diagnosis_files import DESCRIBED, DIAGNOSIS, EXPERIMENT, UNKNOWN, told_by

Array = NDArray[np.float64]

MATTERS = 0.01
"""Share of the predicted rms error below which an effect is not tried: no run of a minute shows so little."""
FRESH = 1
"""Number of the noise of a simulated plant in a run that no diagnosis has seen; that of the others is 0."""


class SetupError(JobError):
    """A node refuses the model or the parameters that a trial needs."""


@dataclass(frozen=True)
class Motions:
    """Files of the references that the axis follows; diagnose: None without one."""

    reference: Path
    measure: Path
    diagnose: Path | None


@dataclass(frozen=True)
class Base:
    """What new compensation has to be better than: the stage in which it was measured, its mode, and how the axis was set."""

    stage: str
    mode: int
    setup: Setup


@dataclass(frozen=True)
class Cancelled:
    """What is cancelled in the end. run: how it tracks then, None where nothing came of it."""

    run: Run | None = None
    judged: tuple[Judged, ...] = ()
    statements: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class Cancelling:
    """The rounds of one goal. `setup` is how the axis is left when they are given up: the best that has been verified."""

    def __init__(
        self, stages: Stages, file: AxisFile, motions: Motions, friction: CompensatorConfig, base: Base, setup: Setup
    ) -> None:
        self._stages, self._config = stages, stages.config
        assert stages.directory is not None
        self._directory: Path = stages.directory
        self._file, self._motions = file, motions
        self._path = motions.reference
        self._reference: Reference = load_reference(self._path)
        self._base, self.setup = base, setup
        self._believed = believed(file, friction, self._config.known, stages.nodes.namespace)
        self._judged: dict[str, Judged] = {}
        self._notes: list[str] = []
        self._statements: list[str] = []
        self._diagnosed: list[str] = []  # stages of the runs made for diagnoses
        self._kept: tuple[str, ...] = ()  # names of the effects that are cancelled
        self._model: AxisFile | None = None  # with those alone

    async def rounds(self, paper: tuple[str, ...]) -> Cancelled:
        """All of them. paper: stages of the paper's loop, which are diagnosed where no motion is made for it."""
        run: Run | None = None
        for number in range(1, self._config.diagnoses + 1):
            try:
                model = await self._diagnosis(number, paper)
            except DiagnosisError as error:
                self._notes.append(f"Not diagnosed: {error.found}.")
                break
            if model is None:
                break
            found = await self._tried(number, model)
            if found is None:
                break
            run = found
        if self._model is not None:
            path = self._directory / "model.yaml"
            save_axis(path, self._model, "What is cancelled: verified on measured tracking")
            given = {node: given for node, given in modelled(str(path)).items() if self.setup.models[node]["model"]}
            self.setup = replace(self.setup, models={**self.setup.models, **given})
        return Cancelled(run, tuple(self._judged.values()), tuple(self._statements), tuple(self._notes))

    # Diagnosis

    async def _diagnosis(self, number: int, paper: tuple[str, ...]) -> Path | None:
        """The axis file that a diagnosis of the axis as it is believed ends with; None where it names nothing new."""
        motion = self._motion(number)
        if motion is not None:
            self._diagnosed.append(f"diagnose_{number}")
            await self._set(self._base.setup)
            await self._stages.run(self._diagnosed[-1], self._base.mode, motion, "moving the axis for a diagnosis")
        bags = self._diagnosed or list(dict.fromkeys([*paper, self._base.stage]))
        axis, name = self._directory / f"believed_{number}.yaml", f"diagnosis_{number}"
        save_axis(axis, self._believed, "What was believed of the axis before its diagnosis")
        verdict, statement = await self._stages.diagnosed(name, axis, [self._directory / bag for bag in bags])
        self._statements.append(statement)
        return self._directory / name / "axis.yaml" if verdict in ("missing_physics", "unexplained") else None

    def _motion(self, number: int) -> Path | None:
        """What the last diagnosis has asked for, if the controller may move so fast; else the motion given, if any."""
        asked = self._directory / f"diagnosis_{number - 1}" / EXPERIMENT
        if asked.is_file():
            reference = load_reference(asked)
            speeds = np.abs(reference.over(np.linspace(0.0, reference.duration, 10_000))[:, 1])
            if float(speeds.max()) <= control_of(self._file).controller.velocity_limit:
                return asked
        return self._motions.diagnose

    # Trials

    async def _tried(self, number: int, path: Path) -> Run | None:
        """The run with the best set of a model's effects; None where no set is better than what was there."""
        file = load_axis(path)
        effects = effect_names(file.axis)
        names = self._worth_a_trial(number, path, file.axis)
        if not names:
            return None
        sensed = await self._sensed(number, file.axis, names)
        names = [name for name in names if name not in sensor_effects(file.axis)]

        def cancelling(chosen: Sequence[str]) -> Setup:
            left_out = tuple(name for name in effects if name not in (*chosen, *sensed))
            return replace(self._base.setup, switches=(False, False, True), models=modelled(str(path), left_out))

        stages: dict[tuple[str, ...], str] = {}
        before = await self._errors(self._base.stage, self._base.mode, self._base.setup)
        trials = choose(names, before)
        wanted = next(trials)
        while True:
            stages[wanted] = f"trial_{number}_{len(stages) + 1}"
            errors: Array | None = None
            try:
                errors = await self._errors(stages[wanted], COMPENSATE, cancelling(wanted), words_of(wanted))
            except SetupError as error:
                self._notes.append(f"Not tried: {words_of(wanted)}, since {error}.")
            try:
                wanted = trials.send(errors)
            except StopIteration as end:
                chosen: Chosen = end.value
                break
        self._judge(names, chosen, sensed)
        if chosen.effects is not None:
            self.setup = cancelling(chosen.effects)
            self._base = Base(stages[chosen.effects], COMPENSATE, self.setup)
            self._model = _with_effects(file, self._kept)
        elif all(name in self._kept for name in sensed):
            return None
        else:
            await self._keep_sensed(number, path, sensed)
        described = told_by(path.parent / DIAGNOSIS, file.axis)[0]
        put_back = [name for name in (*names, *sensor_effects(file.axis)) if name not in self._kept]
        doubtful = {*put_back, *(name for name, why in described.items() if why == DESCRIBED)}
        self._believed = self._believed.with_axis(_with_effects(file, [n for n in effects if n not in doubtful]).axis)
        self._rename(effects, number)
        return self._corrected(self._stages.runs[self._base.stage], self._base.setup)

    def _rename(self, effects: Mapping[str, Instance], number: int) -> None:
        """From the names of a round's model to those of what is believed, where the second of a kind may be the first."""
        places = {id(item): name for name, item in effect_names(self._believed.axis).items()}
        now = {name: places[id(item)] for name, item in effects.items() if id(item) in places}
        self._kept = tuple(now[name] for name in self._kept)
        judged = {now.get(name, f"{name} of round {number}"): one for name, one in self._judged.items()}
        self._judged = {name: replace(one, name=now.get(one.name, one.name)) for name, one in judged.items()}

    # Effects of the sensor

    async def _sensed(self, number: int, model: Axis, names: Sequence[str]) -> tuple[str, ...]:
        """Those of these effects that are of the sensor and explain a recording made after the diagnosis."""
        wanted = [name for name in sensor_effects(model) if name in names]
        if not wanted:
            return ()
        motion, stage = self._motion(number) or self._path, f"check_{number}"
        await self._set(self._base.setup)
        run = await self._stages.run(stage, self._base.mode, motion, "checking what was found of the encoder", noise=FRESH)
        effects = effect_names(model)
        told = [name for name, item in effects.items() if not item.signals]  # the run has no other signals
        try:
            gains = await self._stages.nodes.in_thread(
                lambda: sensor_gains([run.recording()], only(model, told), wanted)
            )
        except InputError as error:
            self._notes.append(f"Not tried: {words_of(tuple(wanted))}, since {error}.")
            return ()
        for name in wanted:
            kept = gains[name].proven
            why = "" if kept else "a recording made after the diagnosis does not show it"
            self._judged[name] = replace(self._judged[name], kept=kept, why=why, gain=gains[name], of=TORQUE)
        return tuple(name for name in wanted if gains[name].proven)

    async def _keep_sensed(self, number: int, path: Path, sensed: Sequence[str]) -> None:
        """Correct the position that controller and observer are given, and leave the compensation as it was."""
        model = load_axis(path)
        left_out = [name for name in effect_names(model.axis) if name not in sensed]
        own = {node: {"model": str(path), "left_out": left_out} for node in CORRECTED}
        setup = replace(self._base.setup, models={**self._base.setup.models, **own})
        stage = f"corrected_{number}"
        await self._errors(stage, self._base.mode, setup, "correcting the encoder")
        self.setup = replace(self.setup, models=setup.models)
        self._base = Base(stage, self._base.mode, setup)
        before = self._model or self._believed
        effects = [item for name, item in effect_names(model.axis).items() if name in sensed]
        rest = [item for item in before.axis.effects if item.term.place is not Place.SENSOR] if self._model else []
        self._model = before.with_axis(replace(before.axis, effects=(*rest, *effects)))

    def _corrected(self, run: Run, setup: Setup) -> Run:
        """A run as the controller saw it: without the errors of the encoder that its model knows."""
        given = setup.models[CORRECTED[0]]
        if not given["model"]:
            return run
        return run.corrected(load_axis(Path(given["model"])).axis, given["left_out"])

    async def _set(self, setup: Setup) -> None:
        """Everything but the switches, which are off until the next run."""
        await self._stages.nodes.restore(replace(setup, switches=(False, False, False)))

    async def _errors(self, stage: str, mode: int, setup: Setup, words: str = "measuring again what it was") -> Array:
        """Rms errors (w,) in the windows of every run of a stage, whose first may have been made before.

        Raises SetupError where a node refuses the setup.
        """
        try:
            await self._set(setup)
        except JobError as error:
            raise SetupError(error.where, error.found, error.expected) from None
        parts = []
        for trial in range(self._config.trials):
            name = stage if trial == 0 else f"{stage}_{trial + 1}"
            run = await self._stages.run(name, mode, self._path, words, noise=trial)
            followed = tracking(self._corrected(run, setup))
            parts.append(windowed(followed.t, followed.error, self._config.settle))
        return np.concatenate(parts)

    def _worth_a_trial(self, number: int, path: Path, model: Axis) -> list[str]:
        """Effects that are known or named, can be cancelled in the graph and matter on this run, by the model's own prediction.

        None of them where no new one is among them.
        """
        left_out, named = told_by(path.parent / DIAGNOSIS, model)
        effects, known = effect_names(model), {item.term for item in self._believed.axis.effects}
        why = {name: reason for name, reason in left_out.items() if reason != UNKNOWN or effects[name].term not in known}
        why |= obstacles(model)
        why |= {name: "no topic gives its signal" for name, item in effects.items() if item.signals}
        control = control_of(self._file)
        task = Task(self._reference, control.controller, control.loop, control.observer, settle=self._config.settle)
        try:
            predicted = worth(model, task, why, draws=0)
        except TcsError as error:
            self._notes.append(f"Nothing of diagnosis {number} was tried: {error}.")
            return []
        rms = {stage.name: stage.rms for stage in predicted.stages}
        names = []
        for name, item in effects.items():
            if name not in why and abs(1.0 - rms.get(name, rms[ALL]) / rms[LAW]) >= MATTERS:
                names.append(name)
            elif name not in self._kept:
                small = f"it changes this run's error by less than {100.0 * MATTERS:g} %, as the model predicts"
                self._judged[name] = Judged(name, item.words, False, why.get(name, small), None)
        for name in names:
            self._judged.setdefault(name, Judged(name, effects[name].words, False, "", None))
        return names if any(name in named for name in names) else []

    def _judge(self, names: Sequence[str], chosen: Chosen, sensed: Sequence[str]) -> None:
        """Where no set was better, what is cancelled already stays."""
        before = self._kept if chosen.effects is None else chosen.effects
        self._kept = (*before, *(name for name in sensed if name not in before))
        for name in names:
            kept = name in self._kept
            if kept and chosen.effects is None:
                continue
            why = "" if kept else "tracking is not measurably better with it"
            self._judged[name] = replace(self._judged[name], kept=kept, why=why, gain=chosen.gains.get(name))


def only(axis: Axis, names: Collection[str]) -> Axis:
    """An axis with these of its effects."""
    return replace(axis, effects=tuple(item for name, item in effect_names(axis).items() if name in names))


def _with_effects(file: AxisFile, names: Collection[str]) -> AxisFile:
    """An axis file with these of its effects."""
    return file.with_axis(only(file.axis, names))


def words_of(effects: tuple[str, ...]) -> str:
    """What is being tried."""
    return f"trying {', '.join(effects).replace('_', ' ')}" if effects else "trying the model's friction alone"


def believed(file: AxisFile, friction: CompensatorConfig, known: bool, namespace: str) -> AxisFile:
    """The axis as it is before a diagnosis: the friction identified, the inertia that the controller is told.

    known: the axis file is the truth about a simulated plant, whose effects nobody is told.
    """
    control = control_of(file)
    axis = replace(
        file.axis,
        friction=instance(law("lugre"), both_directions(friction)),
        inertia=control.controller.inertia_feedforward or file.axis.inertia,
        effects=() if known else file.axis.effects,
    )
    return replace(file, axis=axis, signals=graph_signals(namespace.rstrip("/"), axis.name))
