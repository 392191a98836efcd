"""Switches and effects of a graph, asked for once a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from rclpy.node import Node

from tcs_friction.commissioning.setup import SWITCHES
from tcs_friction.config import AxisFile
from tcs_friction.errors import JobError, TcsError
from tcs_friction.nodes.core.files import axis_file
from tcs_friction.nodes.core.remote import Remotes
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.page.state import Effect, Switches
from tcs_friction.physics.axis import Axis

ASK_EVERY = 1.0  # s
ANSWER_LIMIT = 2.0  # s
COMPENSATOR = "lugre_compensator"


class SwitchWatch:
    """Tells how the switches are whenever the nodes have answered, or have not."""

    def __init__(self, node: Node, remotes: Remotes, file: AxisFile, tell: Callable[[Switches], None]) -> None:
        self._node, self._remotes, self._file, self._tell = node, remotes, file, tell
        self._asking = False
        self._model: tuple[str, Axis | None] = ("", None)
        steady_timer(node, ASK_EVERY, self._ask)

    def _ask(self) -> None:
        if not self._asking and self._node.executor is not None:
            self._asking = True
            self._node.executor.create_task(self._answer)

    async def _answer(self) -> None:
        try:
            first, second, third = [await self._position(node, name) for node, name in SWITCHES]
            model, left_out = await self._compensation() if third is not None else ("", ())
            effects = effects_of(self._file.axis, self._read(model), left_out, bool(third))
            self._tell(Switches((first, second, third), model, effects))
        finally:
            self._asking = False

    async def _compensation(self) -> tuple[str, Sequence[str]]:
        """The compensator's model, "" for none, and what is left out of it."""
        try:
            found = await self._remotes.get(COMPENSATOR, ("model", "left_out"), ANSWER_LIMIT)
        except JobError:
            return "", ()
        return str(found["model"] or ""), tuple(found["left_out"] or ())

    async def _position(self, node: str, name: str) -> bool | None:
        try:
            value: Any = (await self._remotes.get(node, [name], ANSWER_LIMIT))[name]
        except JobError:
            return None
        return bool(value)

    def _read(self, name: str) -> Axis | None:
        """The model's axis; None where there is none or it cannot be read here."""
        if name != self._model[0]:
            self._model = (name, None)
            with suppress(TcsError, OSError):
                self._model = (name, axis_file(name).axis)
        return self._model[1]


def effects_of(axis: Axis, model: Axis | None, left_out: Sequence[str], compensates: bool) -> tuple[Effect, ...]:
    """The effects of the model and, beyond them, those of the axis file, with what is done about each."""
    cancelled = [item.term.id for item in model.effects] if model is not None else []
    states = dict.fromkeys(cancelled, "cancelled" if compensates else "cancelled once Switch3 is on")
    states |= {name: "left out" for name in cancelled if name in left_out}
    for item in axis.effects:
        states.setdefault(item.term.id, "not cancelled")
    asked = {name: name not in left_out for name in cancelled}
    return tuple(Effect(name, state, asked.get(name)) for name, state in states.items())
