"""What acts on a simulated axis from outside: other simulated axes beside it, and any other signal that its file names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.node import Node

from tcs_friction.config import AxisFile
from tcs_friction.control.model_compensator import signals_of
from tcs_friction.control.stamps import SECOND
from tcs_friction.nodes.core.health import Health
from tcs_friction.nodes.loop.beside import MOTION, Beside
from tcs_friction.nodes.loop.live_signals import NO_NUMBER, LiveSignals
from tcs_friction.recording.signals import SignalSource

Around = tuple[()] | tuple[tuple[float, ...]] | tuple[tuple[float, ...], tuple[float, ...]]
"""What `Simulator.step` is given beside command and temperature: nothing, values, or values and rates."""


class Surroundings:
    """The signals that the effects of an axis name, each 0, with a warning, where nobody tells it.

    Of an axis beside the true motion is taken, in lock-step that of the plant's own stamp; of anything else what was heard last.
    `began` and `moved` as of `Beside`.
    """

    def __init__(
        self, node: Node, health: Health, beside: Sequence[str], began: Callable[[], None], moved: Callable[[], None]
    ) -> None:
        self._health = health
        spaces = {f"/{space.strip('/')}": None for space in beside}
        self._beside = Beside(node, [space for space in spaces if space != node.get_namespace()], began, moved)
        self._live = LiveSignals(node, health, lambda: None)
        self._joint = ""
        self._names: tuple[str, ...] = ()
        self._held: dict[str, SignalSource] = {}
        self.begin, self.behind = self._beside.begin, self._beside.behind

    def follow(self, file: AxisFile) -> None:
        """The signals of this axis file, and no others."""
        named = file.signals.exogenous if file.signals is not None else {}
        self._joint, self._names = file.axis.name, signals_of(file.axis)
        sources = {name: named[name] for name in self._names if name in named}
        self._held = {name: source for name, source in sources.items() if self._beside.holds(source)}
        self._live.follow({name: source for name, source in sources.items() if name not in self._held})

    def say(self, stamp: int, position: float, velocity: float, torque: float) -> None:
        """What this axis does at a stamp (ns), for those beside: rad, rad/s, N m."""
        self._beside.say(self._joint, stamp, position, velocity, torque)

    def at(self, stamp: int) -> Around:
        """Lock-step: each signal's value at a stamp (ns) that no axis beside is behind."""
        if not self._names:
            return ()
        return (tuple(self._value(name, stamp) for name in self._names),)

    def _value(self, name: str, stamp: int) -> float:
        source = self._held.get(name)
        if source is None:
            return self._live.values([name])[0]
        try:
            return self._beside.value(source, stamp)
        except NO_NUMBER:
            return self._without(source)

    def now(self, age: float) -> Around:
        """Real time: each signal's value as heard last, and its rate, 0 of an axis that was not heard for `age` seconds."""
        if not self._names:
            return ()
        values, rates = zip(*(self._newest(name, age) for name in self._names), strict=True)
        return values, rates

    def _newest(self, name: str, age: float) -> tuple[float, float]:
        source = self._held.get(name)
        if source is None:
            value, rate = self._live.values([name])
            return value, rate if self._live.heard(name, age) else 0.0
        try:
            return self._beside.newest(source, age)
        except NO_NUMBER:
            return self._without(source), 0.0

    def _without(self, source: SignalSource) -> float:
        self._health.refuse(f"{source.topic} has no number {source.field} of {source.joint or 'its own'}")
        return 0.0

    def missing(self, stamp: int) -> str:
        """Lock-step: topics of axes that have not come to a stamp (ns) and are not there; "" if all are."""
        lost = [space for space in self.behind(stamp) if not self._beside.there(space)]
        return " and ".join(f"{space}/{MOTION}" for space in lost)

    def waits(self, stamp: int) -> str:
        """Lock-step: which axes, all of them there, have not come to a stamp (ns) yet; "" if all have."""
        behind = self.behind(stamp)
        if not all(map(self._beside.there, behind)):
            return ""
        return " and ".join(
            f"{space} is at {at / SECOND:.6f} s" if at >= 0 else f"{space} has not begun" for space, at in behind.items()
        )

    def judge(self) -> None:
        """Look for topics that have appeared, and say which signals nobody tells."""
        self._live.look()
        lacking = [name for name in self._names if name not in self._held and not self._live.heard(name)]
        if lacking:
            words = ", ".join(map(self._live.told_on, lacking))
            self._health.doubt("surroundings", f"taken as 0, since nobody tells it: {words}")
        else:
            self._health.well("surroundings")
