"""The axis model that controller, observer and compensator are given, so that what it knows is cancelled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import text
from tcs_friction.control.handover import Handover, between
from tcs_friction.control.model_compensator import SwitchConfig, check_model, check_names
from tcs_friction.control.position_correction import PositionCorrection
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.files import axis_file
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.signals import SignalSource


@dataclass(frozen=True)
class ModelConfig(SwitchConfig):
    """The model and what is left out of it."""

    model: str = text("", "axis file whose effects are cancelled as far as they can be; none: friction by the LuGre parameters")


Motion = tuple[float, float]
"""Position (rad) and speed (rad/s)."""


class ModelFile:
    """The model that a node has read last. A file is read when its name is given, not again at every other change."""

    def __init__(self) -> None:
        self._name = ""
        self._file: AxisFile | None = None

    @property
    def signals(self) -> Mapping[str, SignalSource]:
        """Where the model's signals are, by name."""
        return self._file.signals.exogenous if self._file is not None and self._file.signals is not None else {}

    def read(self, config: ModelConfig, file: AxisFile) -> Axis | None:
        """The model of a configuration for the axis of a file, None without one.

        Raises InputError for a file that cannot be read, that is of another axis, or that lacks an effect that is left out.
        """
        if not config.model:
            if config.left_out:
                raise InputError("left_out", f"{', '.join(config.left_out)} without a model", "parameter model")
            self._name, self._file = "", None
            return None
        known = self._file
        if known is None or config.model != self._name:
            known = axis_file(config.model)
        check_model(known.axis, file.axis)
        check_names(known.axis, config.left_out)
        self._name, self._file = config.model, known
        return known.axis


class MeasuredMotion:
    """Position and speed of the axis as a model knows them from the measured ones; the measured ones without a model."""

    def __init__(self) -> None:
        self._models = ModelFile()
        self._correction: PositionCorrection | None = None
        self._source = Handover(_as_measured, _nothing, _between)
        self._begun = False

    def check(self, config: ModelConfig, file: AxisFile) -> None:
        """Raises InputError for a model that cannot be used on the axis of a file."""
        self._models.read(config, file)

    def configure(self, config: ModelConfig, file: AxisFile, period: float) -> None:
        """Another model, to which the one before hands over, or other switches; a correction by the same model goes on."""
        model, before = self._models.read(config, file), self._correction
        if model is None:
            self._correction = None
        elif before is None or before.model is not model or before.dt != period:
            self._correction = PositionCorrection(model, period)
        now = self._correction
        if now is not None:
            now.configure(config.left_out, config.entry_time)
        if now is not before:
            step, reset = (now.step, now.reset) if now is not None and now.effects else (_as_measured, _nothing)
            self._source.replace(step, reset, config.entry_time / period)
            if not self._begun:
                self._source.reset()

    def reset(self) -> None:
        """A new run."""
        self._source.reset()
        self._begun = False

    def at(self, position: float, speed: float) -> tuple[float, float]:
        """Position (rad) and speed (rad/s), to be asked once for each state."""
        self._begun = True
        found: Motion = self._source.step(position, speed)
        return found


def _as_measured(position: float, speed: float) -> Motion:
    return position, speed


def _nothing() -> None:
    pass


def _between(new: Motion, old: Motion, share: float) -> Motion:
    return between(new[0], old[0], share), between(new[1], old[1], share)
