"""A watch over the running axis: it tells when the physics differs from what a learning period has shown.

On a change it says what changed where, since when and with what certainty, records the bag around it, and has it diagnosed on
request or by parameter.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from std_srvs.srv import Trigger
from tcs_friction_msgs.msg import AxisEvidence
from tcs_friction_msgs.srv import Diagnose

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.config_field import setting, switch, text, texts
from tcs_friction.control.plausible import Ranges
from tcs_friction.control.stamps import NEW_RUN, NEXT, SECOND
from tcs_friction.errors import JobError, TcsError
from tcs_friction.monitor.watch import Watch, WatchConfig, compiled
from tcs_friction.nodes.analysis.learned import LearnedFile, identity
from tcs_friction.nodes.analysis.monitor_words import counted, said
from tcs_friction.nodes.bags.event_ring import EventRing, RingTopics, new_name, write_bag
from tcs_friction.nodes.core.base import AxisNode, ClockConfig, derived, heard_by_all
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.health import Level
from tcs_friction.nodes.core.jobs import Jobs, Progress, Waiter
from tcs_friction.nodes.core.joint_input import JointInput
from tcs_friction.nodes.core.joint_states import TOPIC, CommandedTorque
from tcs_friction.nodes.core.peers import ResultsConfig
from tcs_friction.nodes.core.qos import COLLECT
from tcs_friction.nodes.core.wire import EVIDENCE
from tcs_friction.nodes.loop.measured_surroundings import MeasuredSurroundings

EVIDENCE_TOPIC = "axis_evidence"
LOST_AXIS = 5.0  # s on top of `after` in which the axis says nothing, and the bag is written without more


@dataclass(frozen=True)
class MonitorConfig(ResultsConfig, WatchConfig, Ranges, ClockConfig):
    """How long to learn, what to record and whether to diagnose it."""

    learned: str = text("", "file that keeps what was learned over a restart; none: a restart learns anew", fixed=True)
    before: float = setting(60.0, "s", 1.0, 3600.0, "of the bag around a change, before it is told")
    after: float = setting(30.0, "s", 0.0, 3600.0, "of that bag, after it is told")
    record: bool = switch(True, "write the bag around a change below `results`")
    topics: tuple[str, ...] = texts("topics in that bag beside the axis' own and those of the axis file's signals", fixed=True)
    diagnose: bool = switch(False, "have the bag diagnosed as soon as it is written; else on request")
    diagnoser: str = text("diagnoser", "node that is asked to diagnose", fixed=True)
    diagnosis_limit: float = setting(1800.0, "s", 1.0, 1e5, "a diagnosis that takes longer is given up")
    temperature_age: float = setting(60.0, "s", 0.1, 1e5, "real time: without a newer one nothing is judged where it matters")
    signal_age: float = setting(1.0, "s", 0.001, 1e5, "real time: likewise without newer signals of the axis file's effects")


def defaults(file: AxisFile) -> MonitorConfig:
    """The settings that an axis file implies."""
    return derived(MonitorConfig, control_of(file).loop, heard_by_all(file))


class Monitor(AxisNode[MonitorConfig]):
    """Publishes the evidence of every block; a change is a warning on /diagnostics until it is forgotten."""

    _watch_over: Watch

    def __init__(self) -> None:
        self._watched: tuple[AxisFile, float] | None = None
        super().__init__("monitor", defaults)
        self._state = JointInput(self.health, self.lock_step, Level.WARN)
        self._commanded = CommandedTorque(self)
        self._around = MeasuredSurroundings(self, self.health)
        self._publisher = self.create_publisher(AxisEvidence, EVIDENCE_TOPIC, self.publish_profile)
        self._ring = EventRing(0)
        self._before = -1  # ns, stamp of the last state that was followed
        self._learning = False
        self._told_at: tuple[int, float] | None = None  # ns and steady time of a change whose bag has yet to be written
        self._bag: Path | None = None
        self._waiter = Waiter(self)
        self._kept = LearnedFile(self.health, self._waiter)
        self.start()
        heard = [self.resolve_topic_name(name) for name in (TOPIC, EVIDENCE_TOPIC)]
        own = [self.resolve_topic_name(name) for name in ("reference", "temperature", "torque_command", *self.config.topics)]
        signals = self.file.signals.topics if self.file.signals is not None else ()
        self._topics = RingTopics(self, self._ring, [*own, *signals], heard)
        self._own_topics = heard
        self._jobs = Jobs(self, self._waiter, "diagnose", self._on_diagnose, service=Trigger)
        self._client = self.create_client(Diagnose, f"{self.config.diagnoser}/diagnose")
        self.create_service(Trigger, "~/learn", self._on_learn)
        self.create_service(Trigger, "~/forget", self._on_forget)
        self.hear_driver(self._on_state, COLLECT)

    def configure(self, config: MonitorConfig) -> None:
        super().configure(config)
        self._state.configure(self.file.axis.name, config)
        self._ring.span = round((config.before + config.after) * SECOND)
        if self._watched is not None and self._watched == (self.file, config.period):
            self._watch_over.config = config
            return
        self._watched = (self.file, config.period)
        self._around.follow(self.file)
        self._lacking = self._around.lacking()
        self._watch_over = Watch(self.file.axis, config.period, config, self._around.names)
        self._forget()
        before = self._kept.recall(config.learned, identity(self.file.axis, config.period, self._around.names))
        if before is not None:
            compiled(before)
            self._watch_over.adopt(before)

    def _forget(self) -> None:
        """No change is known."""
        self._told_at, self._bag, self._said_of = None, None, 0.0
        self.health.well("change")
        for name in ("bag", "diagnosis"):
            self.health.values.pop(name, None)

    # States

    def _on_state(self, data: bytes) -> None:
        step, state = self._state.take(data), self._state
        if step is not NEXT and step is not NEW_RUN:
            return
        stamp, torque = state.stamp, state.acted(self._commanded)
        if step is NEW_RUN and self._before >= 0:
            self._begin_run()
        self._ring.now = stamp
        self._keep(0, data)
        self.health.ticks += 1
        if torque != torque or self._lacking:
            self._before = -1
            return
        watch, period = self._watch_over, self.config.period
        if self._before < 0:
            watch.interrupt()
        span = (stamp - self._before) / SECOND if self._before >= 0 else period
        self._before = stamp
        if watch.tick(span, state.position, torque, self._around.temperature, self._around.values()):
            self._on_block(stamp)

    _lacking: Sequence[str] = ()

    def _keep(self, own: int, data: bytes) -> None:
        number = self._topics.numbers.get(self._own_topics[own])
        if number is not None:
            self._ring.keep(number, data)

    def _begin_run(self) -> None:
        """The axis has begun anew: what is recorded of a change is what there was until then."""
        if self._told_at is not None:
            self._record_now()
        self._ring.restart()
        self._before = -1

    def _on_block(self, stamp: int) -> None:
        watch = self._watch_over
        numbers = (watch.residual, watch.left, watch.over_alarm, *watch.evidence_by_coordinate().values())
        message = EVIDENCE.write(stamp, *numbers, watch.learned_share, watch.told is not None)
        self._publisher.publish(message)
        self._keep(1, message)
        if watch.told is not None and not self._said_of:
            self._told_at = (stamp, time.monotonic())
            self._say_change()
        if watch.has_seen_enough and not self._learning:
            self._begin_to_judge()
        if self._told_at is not None and stamp - self._told_at[0] >= self.config.after * SECOND:
            self._record_now()

    # Learning

    def _begin_to_judge(self) -> None:
        """Learn from the period that is over, in a thread; states go on to be heard."""
        watch, rows = self._watch_over, self._watch_over.rows
        self._learning = True

        async def learn() -> None:
            try:
                found = await self._waiter.in_thread(lambda: watch.learned(rows))
                if watch is self._watch_over and watch.is_learning:
                    watch.adopt(found)
                    self.health.well("learning")
                    await self._kept.keep(found)
            except TcsError as error:
                watch.learn_anew()
                self.health.doubt("learning", f"learning anew: {error}")
            finally:
                self._learning = False

        assert self.executor is not None
        self.executor.create_task(learn)

    def _on_learn(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self._watch_over.learn_anew()
        self._kept.forget()
        self._forget()
        answer.success, answer.message = True, f"learning from the next {self.config.learning_time:g} s of motion"
        return answer

    def _on_forget(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        answer.success = self._watch_over.told is not None
        answer.message = "watching on, with what was learned before" if answer.success else "no change has been told"
        if answer.success:
            self._watch_over.forget_change()
            self._forget()
        return answer

    # A change

    def _say_change(self) -> None:
        """Say what is known of a change; again when the evidence has doubled, which may name it more exactly."""
        watch = self._watch_over
        found = watch.strongest if watch.told is not None else None
        if found is not None and found.evidence >= 2.0 * self._said_of:
            self._said_of = found.evidence
            self.health.doubt("change", said(found, self._state.stamp, watch.clock))

    def _record_now(self) -> None:
        """Write the bag around the change, in a thread, and have it diagnosed if that is wanted."""
        self._told_at = None
        if not self.config.record:
            return
        channels, kept = self._ring.copy()
        name = f"change_{self.file.axis.name}_{time.strftime('%Y%m%d_%H%M%S')}"

        async def record() -> None:
            path = new_name(Path(self.config.results).resolve(), name)
            try:
                await self._waiter.in_thread(lambda: write_bag(path, channels, kept))
            except TcsError as error:
                self.health.doubt("bag", f"bag around the change: {error}")
                return
            self._bag = path
            self.health.values["bag"] = str(path)
            self.get_logger().info(f"bag around the change: {path}")
            if self.config.diagnose:
                await self._jobs.run(Trigger.Request(), Trigger.Response())

        assert self.executor is not None
        self.executor.create_task(record)

    async def _on_diagnose(self, _: Trigger.Request, __: Trigger.Response, ___: Progress) -> str:
        if self._told_at is not None:
            left = self.config.after - (self._state.stamp - self._told_at[0]) / SECOND
            raise JobError("monitor/diagnose", f"the bag around the change is complete in {max(left, 0.0):.0f} s")
        if self._bag is None:
            raise JobError("monitor/diagnose", "no bag around a change", "a change to have been told, and parameter record")
        path = str(self._bag)
        request = Diagnose.Request(bags=[path], directory=f"{self._bag.name}_diagnosis")
        answer = await self._waiter.call(self._client, request, self.config.diagnosis_limit)
        if not answer.success:
            raise JobError("monitor/diagnose", answer.message)
        self.health.values["diagnosis"] = answer.statement
        return str(answer.statement)

    # Diagnostics

    def _watch(self, now: float) -> None:
        self._around.look()
        self._topics.look()
        ages = () if self.lock_step else (self.config.temperature_age, self.config.signal_age)
        self._lacking = self._around.lacking(*ages)
        if self._lacking:
            self.health.doubt("surroundings", f"nothing is judged: no {' and no '.join(self._lacking)}")
        else:
            self.health.well("surroundings")
        if self._told_at is not None and now - self._told_at[1] > self.config.after + LOST_AXIS and self._is_quiet(now):
            self._record_now()
        self._say_change()
        self.health.values |= counted(self._watch_over)
        super()._watch(now)

    def _is_quiet(self, now: float) -> bool:
        return now - self.health.last_tick > LOST_AXIS

    def destroy_node(self) -> None:
        """A bag that is due is written before the end. Raises JobError when the disk does not take it."""
        try:
            if self._told_at is not None and self.config.record:
                name = f"change_{self.file.axis.name}_{time.strftime('%Y%m%d_%H%M%S')}"
                write_bag(new_name(Path(self.config.results).resolve(), name), *self._ring.copy())
        finally:
            super().destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Monitor, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
