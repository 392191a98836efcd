"""The three switches of the paper as modes, and what compensation an axis has, in nodes elsewhere: set, checked, set back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from tcs_friction_msgs.srv import SetMode

from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.parameters import changed
from tcs_friction.nodes.remote import Remotes

SWITCHES = (("dob", "switch1"), ("identifier", "switch2"), ("lugre_compensator", "switch3"))
MODES = {
    SetMode.Request.PLAIN: (False, False, False),
    SetMode.Request.MEASURE: (True, True, False),
    SetMode.Request.COMPENSATE: (False, False, True),
}
NAMES = {SetMode.Request.PLAIN: "PLAIN", SetMode.Request.MEASURE: "MEASURE", SetMode.Request.COMPENSATE: "COMPENSATE"}
MODELLED = ("controller", "dob", "lugre_compensator")
"""The nodes that are given an axis model whose effects are cancelled."""
CORRECTED = ("controller", "dob")
"""Those of them that take the model's errors of the encoder from the measured position, and nothing else."""
FRICTION = tuple(f"{side}.{entry.name}" for side in ("positive", "negative") for entry in fields(LugreParameters))

Wanted = list[tuple[str, Mapping[str, Any]]]


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


class Modes:
    """Every method raises JobError when a node does not answer within `limit` seconds of its call."""

    def __init__(self, remotes: Remotes) -> None:
        self._remotes = remotes

    async def set(self, mode: int, limit: float) -> None:
        """Set the switches. Raises JobError, all of them as they were, when one cannot be set."""
        if mode not in MODES:
            raise InputError("set_mode", f"mode {mode}", "0 (PLAIN), 1 (MEASURE) or 2 (COMPENSATE)")
        await self._remotes.set_all_or_none(_wanted(MODES[mode]), limit)

    async def check(self, mode: int, limit: float) -> None:
        """Raises JobError naming the node whose switch is no longer as `set` left it."""
        switches = await self._switches(limit)
        for (node, name), found, wanted in zip(SWITCHES, switches, MODES[mode], strict=True):
            if found != wanted:
                raise JobError(f"node {node}", f"{name} was changed during the run", f"{wanted} until its end")

    async def found(self, limit: float) -> Setup:
        """How everything is set now."""
        friction = await self._remotes.get("lugre_compensator", FRICTION, limit)
        models = {node: await self._remotes.get(node, ("model", "left_out"), limit) for node in MODELLED}
        return Setup(await self._switches(limit), friction, models)

    async def restore(self, setup: Setup, limit: float) -> None:
        """Set everything back: compensation off first, and on only with the model and the friction parameters that go with it."""
        off = (*setup.switches[:2], False)
        await self._remotes.set_all_or_none(_wanted(off), limit)
        await self._remotes.set("lugre_compensator", setup.friction, limit)
        await self._remotes.set_all_or_none(list(setup.models.items()), limit)
        await self._remotes.set_all_or_none(_wanted(setup.switches), limit)

    async def _switches(self, limit: float) -> tuple[bool, ...]:
        return tuple([bool((await self._remotes.get(node, [name], limit))[name]) for node, name in SWITCHES])


def modelled(model: str, left_out: Sequence[str] = ()) -> dict[str, Mapping[str, Any]]:
    """The parameters of every node of MODELLED that cancel an axis file's effects but those left out."""
    return {node: {"model": model, "left_out": list(left_out)} for node in MODELLED}


def _wanted(values: tuple[bool, ...]) -> Wanted:
    return [(node, {name: value}) for (node, name), value in zip(SWITCHES, values, strict=True)]
