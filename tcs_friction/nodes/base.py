"""What every node has: a configuration as parameters, a clock, diagnostics."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from tcs_friction.config import AxisFile, Control, default_control, load_axis
from tcs_friction.control.config_field import choice, setting
from tcs_friction.errors import InputError, TcsError, one_line, refusal
from tcs_friction.nodes import parameters
from tcs_friction.nodes.health import Health

DEFAULT_AXIS = "azimuth_1p2m.yaml"
LOCK_STEP, REAL_TIME = "lock_step", "real_time"


@dataclass(frozen=True)
class ClockConfig:
    """The settings that every node in the loop has."""

    clock: str = choice(
        LOCK_STEP,
        (LOCK_STEP, REAL_TIME),
        "lock_step: wait for every input of the same stamp; real_time: use the latest inputs",
    )
    period: float = setting(1e-3, "s", 1e-5, 1.0, "control period")
    time_limit: float = setting(5.0, "s", 0.01, 3600.0, "lock-step: report what is missing after this wall time")


C = TypeVar("C", bound=ClockConfig)


def config_file(name: str) -> Path:
    """An existing file as named, or the one of that name in the config folder of the checkout or of the installed package."""
    if Path(name).is_file():
        return Path(name)
    folders = [Path(__file__).resolve().parents[2] / "config"]
    with contextlib.suppress(PackageNotFoundError):
        folders.append(Path(get_package_share_directory("tcs_friction")) / "config")
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    known = sorted({path.name for folder in folders for path in folder.glob("*.yaml")})
    raise InputError(name, "no such file", f"a path, or one of {', '.join(known)}")


def control_of(file: AxisFile) -> Control:
    """How an axis file says to control its axis, or a cautious way where it does not say."""
    return file.control or default_control(file.axis)


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
        super().__init__(name, namespace="azimuth")
        self._defaults = defaults
        described = ParameterDescriptor(description="axis file, a path or a name in the package's config folder")
        path = str(self.declare_parameter("axis", DEFAULT_AXIS, described).value)
        self.file = self._accepted = load_axis(config_file(path))
        self.health = Health()
        self._reported_problem = ""
        self.config: C = parameters.declare(self, defaults(self.file))
        self.check(self.config, self.file)
        self.add_on_set_parameters_callback(self._accept)
        self.add_post_set_parameters_callback(self._apply)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def start(self) -> None:
        """To be called at the end of a subclass' constructor: configure it and begin to report."""
        self.configure(self.config)
        self.create_timer(1.0, self._report)

    def check(self, config: C, file: AxisFile) -> None:
        """Raises InputError where valid settings do not go together. For subclasses."""

    def configure(self, config: C) -> None:
        """Use a configuration that has been checked. For subclasses."""
        self.config = config

    hears = "joint_states"
    """The input that makes the node tick."""

    def missing(self) -> str:
        """What keeps the node from answering its last input, "" for nothing. For subclasses; asked while no tick comes."""
        return ""

    def progress(self) -> None:
        """Count a tick."""
        self.health.ticks += 1

    # Parameters

    def _accept(self, changes: Sequence[Parameter]) -> SetParametersResult:
        """Whether a change may be made, with the reason when not. Files are read here, once; `_apply` uses what was read."""
        try:
            file = self._file_after(changes)
            base = self.config if file is self.file else self._defaults(file)
            self.check(parameters.with_parameters(base, changes, self.get_name()), file)
        except TcsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except OSError as error:
            return SetParametersResult(successful=False, reason=str(refusal(error)))
        except Exception as error:  # a defect of ours that a file brings out must not take the node with it
            return SetParametersResult(successful=False, reason=one_line(f"{type(error).__name__}: {error}"))
        self._accepted = file
        return SetParametersResult(successful=True)

    def _file_after(self, changes: Sequence[Parameter]) -> AxisFile:
        for item in changes:
            if item.name == "axis":
                return load_axis(config_file(str(item.value)))
        return self.file

    def _apply(self, changes: Sequence[Parameter]) -> None:
        file = self._accepted
        if file is not self.file:  # another axis brings its own values for everything not named beside it
            self.file = file
            wanted = parameters.with_parameters(self._defaults(file), changes, self.get_name())
            self.set_parameters_atomically(parameters.as_parameters(wanted))
            return
        self.configure(parameters.with_parameters(self.config, changes, self.get_name()))

    # Diagnostics

    def _report(self) -> None:
        now = time.monotonic()
        self._watch(now)
        counters = self.health.report(now)
        level, message = DiagnosticStatus.OK, self.config.clock.replace("_", "-")
        if self.health.problem:
            level, message = DiagnosticStatus.ERROR, self.health.problem
        elif self.health.warning:
            level, message = DiagnosticStatus.WARN, self.health.warning
        status = DiagnosticStatus(level=level, name=self.get_fully_qualified_name(), message=message, hardware_id="")
        status.values = [KeyValue(key=key, value=value) for key, value in counters.items()]
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(report)
        if self.health.problem != self._reported_problem:
            if self.health.problem:
                self.get_logger().error(self.health.problem)
            else:
                self.get_logger().info("all is well again")
            self._reported_problem = self.health.problem
        self.health.warning = ""

    _last_progress: tuple[int, float] = (-1, 0.0)

    def _watch(self, now: float) -> None:
        """Notice in lock-step that nothing goes on although something is awaited."""
        ticks, since = self._last_progress
        if self.health.ticks != ticks:
            self._last_progress = (self.health.ticks, now)
            self.health.last_tick = now
            self.health.problem = ""
            return
        if self.config.clock != LOCK_STEP or now - since < self.config.time_limit:
            return
        awaited = self.missing()
        self.health.problem = f"no {awaited} within {self.config.time_limit:g} s" if awaited else ""
        if not awaited and self.hears:
            self.health.warning = f"idle: no {self.hears} for {now - since:.0f} s"


