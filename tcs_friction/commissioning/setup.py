"""The three switches of the paper as modes, and what compensation an axis has: how the nodes of an axis are set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.control.config_field import changed, flatten

PLAIN, MEASURE, COMPENSATE = 0, 1, 2
"""As in tcs_friction_msgs/srv/SetMode."""
SWITCHES = (("dob", "switch1"), ("identifier", "switch2"), ("lugre_compensator", "switch3"))
MODES = {
    PLAIN: (False, False, False),
    MEASURE: (True, True, False),
    COMPENSATE: (False, False, True),
}
NAMES = {PLAIN: "PLAIN", MEASURE: "MEASURE", COMPENSATE: "COMPENSATE"}
MODELLED = ("controller", "dob", "lugre_compensator")
"""The nodes that are given an axis model whose effects are cancelled."""
CORRECTED = ("controller", "dob")
"""Those of them that take the model's errors of the encoder from the measured position, and nothing else."""
FRICTION = tuple(f"{side}.{entry.name}" for side in ("positive", "negative") for entry in fields(LugreParameters))


@dataclass(frozen=True)
class Setup:
    """How the nodes are set: the switches, the compensator's friction parameters by name, the model and what is left out of it.

    models: of each of MODELLED its parameters `model` and `left_out`.
    """

    switches: tuple[bool, ...]
    friction: Mapping[str, float]
    models: Mapping[str, Mapping[str, Any]]

    def plain(self) -> Setup:
        """The same with every switch off and without a model."""
        return replace(self, switches=(False, False, False), models=modelled(""))

    def compensation(self) -> CompensatorConfig:
        """The friction parameters as the compensator's configuration."""
        return changed(CompensatorConfig(), self.friction)


def modelled(model: str, left_out: Sequence[str] = ()) -> dict[str, Mapping[str, Any]]:
    """The parameters of every node of MODELLED that cancel an axis file's effects but those left out."""
    return {node: {"model": model, "left_out": list(left_out)} for node in MODELLED}


def friction_parameters(config: CompensatorConfig) -> dict[str, float]:
    """The friction parameters by the names that the compensator's node gives them."""
    return {name: value for name, (_, value) in flatten(config).items() if name in FRICTION}
