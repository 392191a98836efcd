"""Identification in the graph: from what the observer sees, or from bags, to LuGre parameters for the compensator.

Where no observer's estimates are heard, the joint states are what is identified from, as the command does it from their bag.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.clock import Clock
from tcs_friction_msgs.action import Identify as IdentifyAction
from tcs_friction_msgs.msg import FrictionEstimate, LugreParameters
from tcs_friction_msgs.srv import Identify as IdentifyService

from tcs_friction.conditioning.motion import Data, FrictionSeries
from tcs_friction.config import AxisFile, save_axis, write_whole
from tcs_friction.control.config_field import choice, setting, switch
from tcs_friction.control.plausible import Ranges
from tcs_friction.errors import JobError, writing_into
from tcs_friction.identify.identification import METHODS, identified_axis, identify
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.nodes.base import AxisNode, ClockConfig, control_of, derived, heard_by_all
from tcs_friction.nodes.convert import fill_direction, set_stamp
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.files import axis_file
from tcs_friction.nodes.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.live import LiveRecording, recordings
from tcs_friction.nodes.peers import ResultsConfig, new_results
from tcs_friction.nodes.qos import COLLECT, LATCHED
from tcs_friction.nodes.series import Series
from tcs_friction.nodes.topic_input import EstimateInput

Live = tuple[list[Data], str]
"""What was heard, and what to call it."""


@dataclass(frozen=True)
class IdentifierConfig(ResultsConfig, Ranges, ClockConfig):
    """How to identify, and Switch2 of the paper."""

    switch2: bool = switch(False, "Switch2: the observer's estimates are kept for identification")
    method: str = choice("default", METHODS, "of the search")
    seed: int = setting(0, "", 0, 2**31 - 1, "seed of the search")
    settle: float = setting(1.0, "s", 0.0, 1e4, "estimates so soon after the first one are not used")
    estimate_delay: float = setting(0.0, "s", 0.0, 10.0, "by how much the observer's estimate is late, its filter apart")
    estimate_bandwidth: float = setting(0.0, "Hz", 0.0, 1000.0, "of the observer's filter, which the model passes too; 0: none")
    memory: float = setting(600.0, "s", 1.0, 1e5, "estimates older than this are forgotten")


def defaults(file: AxisFile) -> IdentifierConfig:
    """The settings that an axis file implies."""
    control = control_of(file)
    delay, bandwidth = control.observer.estimate_filter
    return derived(
        IdentifierConfig, control.loop, heard_by_all(file), estimate_delay=delay, estimate_bandwidth=bandwidth
    )


class Identifier(AxisNode[IdentifierConfig]):
    """Publishes what it identified on lugre_parameters, latched."""

    def __init__(self) -> None:
        super().__init__("identifier", defaults)
        self._series = Series(2)  # velocity, torque
        self._live = LiveRecording(self)
        self._estimates = EstimateInput(self.health, self.lock_step)
        self._publisher = self.create_publisher(LugreParameters, "lugre_parameters", LATCHED)
        self.start()
        self._waiter = Waiter(self)
        self._jobs = Jobs(self, self._waiter, "identify", self._identify, IdentifyAction, IdentifyService)
        self.create_subscription(FrictionEstimate, "friction_estimate", self._on_estimate, COLLECT, raw=True)
        self.hear_driver(self._on_state, COLLECT)

    def configure(self, config: IdentifierConfig) -> None:
        if config.switch2 and not self.config.switch2:
            self._series.clear()
        super().configure(config)
        self._series.limit = round(config.memory / config.period)
        self._live.follow(self.file.axis.name, self._series.limit, config)
        self._estimates.configure(config)

    def _on_estimate(self, data: bytes) -> None:
        heard = self._estimates.take(data)
        if heard is None or not self.config.switch2:
            return
        stamp, (torque, velocity, _, valid) = heard
        if valid and self._series.append(stamp, velocity, torque) and not self._live.heard:
            self.health.ticks += 1  # otherwise the states are counted

    def _on_state(self, data: bytes) -> None:
        if self._live.append(data, keep=not len(self._series)):
            self.health.ticks += 1

    async def _identify(self, request: Any, answer: Any, progress: Progress) -> str:
        with new_results(self.config.results, request.directory) as directory:
            file = await self._waiter.in_thread(lambda: axis_file(request.axis)) if request.axis else self.file
            live, config = None if request.bags else self._heard(), self.config
            progress.tell(stage="reading" if request.bags else "searching")
            found, file, source = await self._waiter.in_thread(lambda: identified(request, live, file, config, progress))
            if not found.parameters["coulomb"].determined:
                raise JobError("identification", f"coulomb is not determined: {found.parameters['coulomb'].reason}")
            if directory is not None:
                await self._waiter.in_thread(lambda: write_result(directory, file, found))
        message = lugre_parameters(found, source, self.get_clock())
        answer.parameters, answer.rmse = message, found.rmse.train
        self._publisher.publish(message)
        size = f"{found.parameters['coulomb'].value:.4g}, static {found.parameters['static'].value:.4g}"
        return f"coulomb {size}, residual {found.rmse.train:.3g} {found.offset.unit} rms, from {source}"

    def _heard(self) -> Live:
        """A copy of the series of live estimates, or without any of the live recording of joint states, and what it is."""
        if not len(self._series):
            return [self._live.recording()], f"{len(self._live)} live joint states"
        t, velocity, torque = self._series.arrays()
        keep = t >= (t[0] if len(t) else 0.0) + self.config.settle
        if np.count_nonzero(keep) < 2:
            raise JobError("live recording", f"{len(t)} estimates heard", "a run in mode MEASURE before")
        delay, bandwidth = self.config.estimate_delay, self.config.estimate_bandwidth
        return [FrictionSeries(t[keep], velocity[keep], torque[keep], delay, bandwidth)], f"{len(t)} live estimates"


def identified(
    request: Any, live: Live | None, file: AxisFile, config: IdentifierConfig, progress: Progress
) -> tuple[Identification, AxisFile, str]:
    """The identification asked for, the axis file as it was believed, and what it is from. Runs in a thread of its own."""
    data, source = live or (recordings(request, file), ", ".join(request.bags))
    believed = replace(file.axis, effects=()) if isinstance(data[0], FrictionSeries) else file.axis

    def tell(generation: Generation) -> None:
        progress.tell(
            progress=float(generation.share),
            stage="searching",
            generation=int(generation.number),
            cost=float(generation.cost),
        )

    found = identify(data, believed, config.method, "lugre", config.seed, tell, progress.cancelled.is_set)
    if progress.cancelled.is_set():
        raise JobError("identification", "was cancelled")
    return found, replace(file, axis=believed), source


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


def write_result(directory: Path, file: AxisFile, found: Identification) -> None:
    """identification.json and axis.yaml, as the command writes them."""
    with writing_into(directory):
        write_whole(directory / "identification.json", json.dumps(found.to_mapping(), indent=2, allow_nan=False) + "\n")
        save_axis(directory / "axis.yaml", replace(file, axis=identified_axis(file.axis, found)))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Identifier, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
