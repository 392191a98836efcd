"""How the nodes of an axis are set, in nodes elsewhere: set, checked, set back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcs_friction.commissioning.setup import FRICTION, MODELLED, MODES, SWITCHES, Setup
from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.core.remote import Remotes

Wanted = list[tuple[str, Mapping[str, Any]]]


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


def _wanted(values: tuple[bool, ...]) -> Wanted:
    return [(node, {name: value}) for (node, name), value in zip(SWITCHES, values, strict=True)]
