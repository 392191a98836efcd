"""Identification in the graph: from what was heard, or from bags, to LuGre parameters for the compensator.

What is identified from are motion and torque, as the command does it from their bag: the observer's estimates have passed its
filter, which bends what friction does at a reversal. They say when friction is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rclpy.clock import Clock
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import FrictionEstimate, LugreParameters
from tcs_friction_msgs.srv import Identify as IdentifyService

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import choice, setting, switch
from tcs_friction.control.plausible import Ranges
from tcs_friction.errors import JobError
from tcs_friction.identify.identification import METHODS, identify
from tcs_friction.identify.minimum import NO_MINIMUM
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.nodes.analysis.heard import LiveRecording, recordings
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived, heard_by_all
from tcs_friction.nodes.core.convert import fill_direction, set_stamp
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import axis_file
from tcs_friction.nodes.core.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.core.peers import ResultsConfig, new_results
from tcs_friction.nodes.core.qos import COLLECT, LATCHED
from tcs_friction.nodes.core.topic_input import EstimateInput
from tcs_friction.physics.axis import Axis
from tcs_friction.recording.recording import Recording
from tcs_friction.report.identification_files import write_identification

Live = tuple[Recording, str]
"""What was heard, and what to call it."""


@dataclass(frozen=True)
class IdentifierConfig(ResultsConfig, Ranges, ClockConfig):
    """How to identify, and Switch2 of the paper."""

    switch2: bool = switch(False, "Switch2: states that an observer gives estimates for are kept for identification")
    method: str = choice("default", METHODS, "of the search")
    seed: int = setting(0, "", 0, 2**31 - 1, "seed of the search")
    memory: float = setting(600.0, "s", 1.0, 1e5, "joint states older than this are forgotten")


def defaults(file: AxisFile) -> IdentifierConfig:
    """The settings that an axis file implies."""
    return derived(IdentifierConfig, control_of(file).loop, heard_by_all(file))


class Identifier(AxisNode[IdentifierConfig]):
    """Publishes what it identified on lugre_parameters, latched.

    Once Switch2 has let an estimate in, only states heard while it is on and the estimates are valid are kept. Before that, all.
    """

    def __init__(self) -> None:
        super().__init__("identifier", defaults)
        self._live = LiveRecording(self)
        self._measured = False  # whether the states kept are those of a measurement of friction
        self._valid = False  # the newest estimate that Switch2 let in
        self._estimates = EstimateInput(self.health, self.lock_step)
        self._publisher = self.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
        self.start()
        self._waiter = Waiter(self)
        self._jobs = Jobs(self, self._waiter, "identify", self._identify, IdentifyAction, IdentifyService)
        self.create_subscription(FrictionEstimate, "friction_estimate", self._on_estimate, COLLECT, raw=True)
        self.hear_driver(self._on_state, COLLECT)

    def configure(self, config: IdentifierConfig) -> None:
        begins = config.switch2 and not self.config.switch2
        super().configure(config)
        another = self._live.follow(self.file.axis.name, round(config.memory / config.period), config)
        if begins and self._measured:
            self._live.clear()
        if begins or another:
            self._measured = self._valid = False
        self._estimates.configure(config)

    def _on_estimate(self, data: bytes) -> None:
        heard = self._estimates.take(data)
        if heard is None or not self.config.switch2:
            return
        _, (_, _, _, valid) = heard
        self._valid = bool(valid)
        if self._valid and not self._measured:
            self._live.clear()
            self._measured = True

    def _on_state(self, data: bytes) -> None:
        if self._live.append(data, keep=not self._measured or (self.config.switch2 and self._valid)):
            self.health.ticks += 1

    async def _identify(self, request: Any, answer: Any, progress: Progress) -> str:
        with new_results(self.config.results, request.directory) as directory:
            file = await self._waiter.in_thread(lambda: axis_file(request.axis)) if request.axis else self.file
            live, config = None if request.bags else self._heard(), self.config
            progress.tell(stage="reading" if request.bags else "searching")
            found, data, source = await self._waiter.in_thread(lambda: identified(request, live, file, config, progress))
            if not found.parameters["coulomb"].determined:
                raise JobError("identification", f"coulomb is not determined: {found.parameters['coulomb'].reason}")
            if directory is not None:
                await self._waiter.in_thread(lambda: write_identification(directory, file, found, data))
        message = lugre_parameters(found, source, self.get_clock())
        answer.parameters, answer.rmse = message, found.rmse.train
        self._publisher.publish(message)
        size = f"{found.parameters['coulomb'].value:.4g}, static {found.parameters['static'].value:.4g}"
        doubt = "" if found.minimum else f"; {NO_MINIMUM}"
        return f"coulomb {size}, residual {found.rmse.train:.3g} {found.offset.unit} rms, from {source}{doubt}"

    def _heard(self) -> Live:
        """The live recording of joint states, and what it is."""
        recording = self._live.recording()
        return recording, f"{len(self._live)} live joint states{' with estimates' if self._measured else ''}"


def identified(
    request: Any, live: Live | None, file: AxisFile, config: IdentifierConfig, progress: Progress
) -> tuple[Identification, list[Recording], str]:
    """The identification asked for, and what it is from, also in words. Runs in a thread of its own."""
    data, source = ([live[0]], live[1]) if live else (recordings(request, file), ", ".join(request.bags))

    def tell(generation: Generation) -> None:
        progress.tell(
            progress=float(generation.share),
            stage="searching",
            generation=int(generation.number),
            cost=float(generation.cost),
        )

    believed = _with_signals_of(data, file.axis)
    found = identify(data, believed, config.method, "lugre", config.seed, tell, progress.cancelled.is_set)
    if progress.cancelled.is_set():
        raise JobError("identification", "was cancelled")
    return found, data, source


def _with_signals_of(data: Sequence[Recording], axis: Axis) -> Axis:
    """The axis without the effects of signals that are not recorded: what is believed of them cannot be taken into account."""
    known = set.intersection(*(set(one.exogenous) for one in data))
    return replace(axis, effects=tuple(item for item in axis.effects if item.signal is None or item.signal in known))


def lugre_parameters(found: Identification, source: str, clock: Clock) -> LugreParameters:
    """A result as a message; what was identified for both directions together serves where one is missing."""
    message = LugreParameters(source=source)
    set_stamp(message, clock.now().nanoseconds)
    for way, target in (("positive", message.positive), ("negative", message.negative)):
        estimates = {**found.parameters, **found.directions.get(way, {})}
        deviations = {name: item.std if item.determined else None for name, item in estimates.items()}
        values = found.friction(way)
        # each direction has a Coulomb torque of its own, but what exceeds it is the same, and may be nothing
        values["static"] = max(values["static"], values["coulomb"])
        fill_direction(target, values, deviations)
    message.torque_offset = float(found.offset.value) if found.offset.determined else 0.0
    return message


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Identifier, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
