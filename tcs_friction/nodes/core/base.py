"""What every node has: a configuration as parameters, a clock, diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.action import ActionClient, ActionServer
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import choice, setting
from tcs_friction.control.plausible import Ranges, heard_ranges
from tcs_friction.errors import TcsError, one_line, refusal
from tcs_friction.nodes.core import parameters
from tcs_friction.nodes.core.arguments import own_arguments
from tcs_friction.nodes.core.files import DEFAULT_AXIS, axis_file
from tcs_friction.nodes.core.health import Health, Judgement
from tcs_friction.nodes.core.joint_states import TOPIC, DriverWatch
from tcs_friction.nodes.core.log_lines import Problems, Warnings
from tcs_friction.nodes.core.qos import PUBLISH, PUBLISH_IN_REAL_TIME
from tcs_friction.nodes.core.steady import steady_timer

LOCK_STEP, REAL_TIME = "lock_step", "real_time"
LOGGED_STATES = ("phase", "life cycle", "live recording")
"""Values of /diagnostics whose changes are in the log."""


@dataclass(frozen=True)
class ClockConfig:
    """The settings that every node in the loop has."""

    clock: str = choice(
        LOCK_STEP,
        (LOCK_STEP, REAL_TIME),
        "lock_step: wait for every input of the same stamp; real_time: use the latest inputs",
        fixed=True,
    )
    period: float = setting(1e-3, "s", 1e-5, 1.0, "control period")
    time_limit: float = setting(5.0, "s", 0.01, 3600.0, "report what is missing, or that nothing comes, after this steady time")
    age_limit: float = setting(0.1, "s", 1e-3, 10.0, "real time: older inputs are not used, and reported")
    patience: float = setting(0.5, "s", 1e-3, 60.0, "real time: a clock or position that has jumped is believed after so long")
    rate_limit: float = setting(0.9, "1", 0.0, 1.0, "real time: share of the ticks that must come")
    overrun_limit: float = setting(0.05, "1", 0.0, 1.0, "real time: share of the ticks that may be late")

C = TypeVar("C", bound=ClockConfig)


def heard_by_all(file: AxisFile) -> Ranges:
    """What nodes that only listen take for plausible."""
    return heard_ranges(file.axis, file.control.controller if file.control else None)


def derived(kind: type[C], *sources: Any, **values: Any) -> C:
    """A node's configuration from the configurations of the core that it contains; later ones win."""
    names = {entry.name for entry in fields(kind)}
    taken: dict[str, Any] = {}
    for source in sources:
        taken.update({entry.name: getattr(source, entry.name) for entry in fields(source) if entry.name in names})
    return kind(**(taken | values))


class AxisNode(Node, Generic[C]):
    """A node of one axis. Subclasses set `self.config` through `configure` and count ticks in `self.health`."""

    def __init__(self, name: str, defaults: Callable[[AxisFile], C]) -> None:
        super().__init__(name, namespace="azimuth", cli_args=own_arguments())
        self._defaults = defaults
        described = ParameterDescriptor(description="axis file, a path or a name in the package's config folder")
        path = str(self.declare_parameter("axis", DEFAULT_AXIS, described).value)
        self.file = self._accepted = axis_file(path)
        self.health = Health()
        self._said: dict[str, str] = {}
        self._problem_lines, self._warning_lines = Problems(), Warnings()
        self.config: C = parameters.declare(self, defaults(self.file))
        parameters.refuse_unknown(self)
        self._given = parameters.given(self)
        self.lock_step = self.config.clock == LOCK_STEP
        self.publish_profile = PUBLISH if self.lock_step else PUBLISH_IN_REAL_TIME
        self.check(self.config, self.file)
        self.add_on_set_parameters_callback(self._accept)
        self.add_post_set_parameters_callback(self._apply)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def start(self) -> None:
        """To be called at the end of a subclass' constructor: configure it and begin to report."""
        self.configure(self.config)
        steady_timer(self, 1.0, self._report_or_wait)

    def destroy_node(self) -> None:
        """Actions first: rclpy leaves them to the garbage collector, and rcl crashes where that ends the node's clock earlier."""
        for entity in list(self.waitables):
            if isinstance(entity, (ActionServer, ActionClient)):
                entity.destroy()
        super().destroy_node()

    def check(self, config: C, file: AxisFile) -> None:
        """Raises InputError where valid settings do not go together. For subclasses."""

    def configure(self, config: C) -> None:
        """Use a configuration that has been checked. For subclasses."""
        self.config = config

    hears = TOPIC
    """The input that makes the node tick."""

    names_rate = False
    """Whether the node says that what it hears comes at another rate than its period; others leave that to the controller."""

    def missing(self) -> str:
        """What keeps the node from answering its last input, "" for nothing. For subclasses; asked while no tick comes."""
        return ""

    def waits(self) -> str:
        """What the node stands still for on purpose, "" for nothing. For subclasses; asked while no tick comes."""
        return ""

    _driver: DriverWatch | None = None

    _joint_heard = ""

    def hear_driver(
        self, callback: Callable[[bytes], None], profile: QoSProfile, topic: str = TOPIC, joint: str = ""
    ) -> None:
        """Subscribe to joint states, serialised, in whatever quality a driver publishes them. `joint`: none is the axis."""

        def hear(data: bytes) -> None:
            callback(data)
            if self._report_is_due:
                self._report()

        self._joint_heard = joint
        self._driver = DriverWatch(self, hear, profile, joint or self.file.axis.name, topic)

    # Parameters

    def _accept(self, changes: Sequence[Parameter]) -> SetParametersResult:
        """Whether a change may be made, with the reason when not. Files are read here, once; `_apply` uses what was read."""
        try:
            file = self._file_after(changes)
            self.check(self._wanted(file, changes), file)
        except TcsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except OSError as error:
            return SetParametersResult(successful=False, reason=str(refusal(error)))
        except Exception as error:  # a defect of ours that a file brings out must not take the node with it
            return SetParametersResult(successful=False, reason=one_line(f"{type(error).__name__}: {error}"))
        self._accepted = file
        return SetParametersResult(successful=True)

    def _wanted(self, file: AxisFile, changes: Sequence[Parameter]) -> C:
        """The configuration after a change; another axis brings its own values for all but what is fixed or given."""
        base = self.config if file is self.file else parameters.keep(self._defaults(file), self.config, self._given)
        return parameters.with_parameters(base, changes, self.get_name())

    def _file_after(self, changes: Sequence[Parameter]) -> AxisFile:
        for item in changes:
            if item.name == "axis":
                return axis_file(str(item.value))
        return self.file

    changing: frozenset[str] = frozenset()
    """Names of the parameters that were asked to be set, while `configure` applies them; empty at the start."""

    def _apply(self, changes: Sequence[Parameter]) -> None:
        file, asked = self._accepted, frozenset(item.name for item in changes)
        if not self.changing:
            self._given |= asked
        wanted = self._wanted(file, changes)
        if file is not self.file:
            self.file, self.changing = file, asked
            self.set_parameters_atomically(parameters.as_parameters(wanted))
            self.changing = frozenset()
            return
        self.changing = self.changing or asked
        self._log_switches(changes)
        self.configure(wanted)
        self.changing = frozenset()

    def replace_given(self, values: Mapping[str, Any]) -> SetParametersResult:
        """Set parameters, all or none, to what was found out about the axis; another axis file replaces them."""
        result = self.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
        if result.successful:
            self._given -= values.keys()
        return result

    def _log_switches(self, changes: Sequence[Parameter]) -> None:
        for item in changes:
            if isinstance(item.value, bool) and item.value != getattr(self.config, item.name, item.value):
                self.get_logger().info(f"{item.name} {'on' if item.value else 'off'}")

    # Diagnostics

    @property
    def introduction(self) -> str:
        """What the log says when the node is ready."""
        return f"ready: axis {self.file.axis.name}, {self.config.clock.replace('_', '-')}, period {self.config.period:g} s"

    _report_is_due = False

    def _report_or_wait(self) -> None:
        """In real time a report takes as long as a tick. While states come it follows one, so that the next does not wait."""
        heard = self.health.inputs.get(TOPIC)
        if heard and not self._report_is_due and time.monotonic() - heard.last < 2.0 * self.config.period:
            self._report_is_due = True
        else:
            self._report()

    def _report(self) -> None:
        self._report_is_due = False
        now = time.monotonic()
        self._watch(now)
        level, problem, warning = self.health.level(), self.health.problem, self.health.warning
        well = f"waiting: {self._waits}" if self._waits else self.config.clock.replace("_", "-")
        message = "; ".join(filter(None, (problem, warning))) or well
        status = DiagnosticStatus(level=bytes([level]), name=self.get_fully_qualified_name(), message=message)
        status.hardware_id = self.file.axis.name
        status.values = [KeyValue(key=key, value=value) for key, value in self.health.report(now).items()]
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(report)
        self._log(warning)

    def _log(self, warning: str) -> None:
        """A problem once when it comes and once when all are gone, a change of state once; a warning when it comes, throttled."""
        log = self.get_logger()
        for state in LOGGED_STATES:
            value = self.health.values.get(state, "")
            if value != self._said.get(state, ""):
                log.info(f"{state}: {value}")
                self._said[state] = value
        if line := self._warning_lines.line(warning, time.monotonic()):
            log.warning(line)
        wrong = self._problem_lines.any
        for problem in self._problem_lines.lines(self.health.problems):
            log.error(problem)
        if wrong and not self._problem_lines.any:
            log.info("all is well again")

    _last_progress: tuple[int, float] = (-1, 0.0)

    def _watch(self, now: float) -> None:
        """Notice that nothing goes on although something is awaited, and in real time what comes late."""
        self._judge(now)
        self._judge_driver()
        ticks, since = self._last_progress
        if self.health.ticks != ticks:
            self._last_progress = (self.health.ticks, now)
            self.health.last_tick = now
            self.health.well("missing", "idle")
            self._waits = ""
            return
        if self._waiting_on_purpose() or now - since < self.config.time_limit:
            return
        awaited = self.missing() if self.lock_step else ""
        if awaited:
            self.health.well("idle")
            self.health.fail("missing", f"no {awaited} within {self.config.time_limit:g} s")
            return
        self.health.well("missing")
        if self.hears and self.hears not in self.health.inputs:
            self.health.doubt("idle", f"idle: no new {self.hears} for {now - since:.0f} s")

    _waits = ""

    def _waiting_on_purpose(self) -> bool:
        """Whether the node stands still because it is told to; said once in the log, and in every report."""
        waits = self.waits()
        if waits and waits != self._waits:
            self.get_logger().info(f"waiting: {waits}")
        self._waits = waits
        if waits:
            self.health.well("missing", "idle")
        return bool(waits)

    def _judge_driver(self) -> None:
        """Say what the driver's messages lack: once in the log what is made up for, as a warning what makes them useless."""
        if self._driver is None:
            return
        found = self._driver.judge(self._joint_heard or self.file.axis.name)
        if found.useless:
            self.health.doubt("driver", found.useless)
        else:
            self.health.well("driver")
        served = "; ".join(found.served)
        if served and served != self.health.values.get("driver"):
            self.get_logger().info(f"joint_states: {served}")
        if served or "driver" in self.health.values:
            self.health.values["driver"] = served or "complete"

    def _judge(self, now: float) -> None:
        config = self.config
        if config.clock == REAL_TIME:
            limits = (config.period, config.age_limit, config.rate_limit, config.overrun_limit, config.time_limit)
            self.health.judge(now, Judgement(*limits, self.names_rate))
        if self.get_parameter("use_sim_time").value and not self.get_clock().now().nanoseconds:
            self.health.doubt("clock", "use_sim_time is set and there is no /clock: stamps of messages are not known")
        else:
            self.health.well("clock")
