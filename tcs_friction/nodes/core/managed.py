"""Nodes that decide whether there is torque: managed by the life cycle of ROS 2, with torque only while active.

    unconfigured --configure--> inactive --activate--> active --deactivate--> inactive --cleanup--> unconfigured
    any of them --shutdown--> finalized, for good

The services are those of every managed node (`ros2 lifecycle set /azimuth/controller deactivate`). In real time torque comes
and goes over `ramp_time`: after `deactivate` or `shutdown` it is gone when that has passed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from tcs_friction.config import AxisFile
from tcs_friction.control.config_field import setting, switch
from tcs_friction.nodes.core.base import AxisNode, ClockConfig


@dataclass(frozen=True)
class ManagedConfig(ClockConfig):
    """How a managed node starts, and how its torque comes and goes."""

    auto_activate: bool = switch(True, "configure and activate at the start; else a life-cycle manager does", fixed=True)
    ramp_time: float = setting(0.5, "s", 0.0, 60.0, "real time: torque and compensation come and go over this time")


C = TypeVar("C", bound=ManagedConfig)


class ManagedNode(LifecycleNodeMixin, AxisNode[C]):
    """An AxisNode with a life cycle. Subclasses ask `active` and `configured`, and hear of changes in `state_changed`."""

    def __init__(self, name: str, defaults: Callable[[AxisFile], C]) -> None:
        AxisNode.__init__(self, name, defaults)
        self.configured = self.active = False
        LifecycleNodeMixin.__init__(self)

    def start(self) -> None:
        super().start()
        self._change(False, False)
        if self.config.auto_activate:
            self.trigger_configure()
            self.trigger_activate()
            self.health.forget_events()  # of no interest: nobody has deactivated anything

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:  # noqa: N802
        """rclpy's callback of the service, which ends the node by an exception where the state has no such transition."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)
        except rclpy_implementation.RCLError:
            wanted = request.transition.label or f"number {request.transition.id}"
            self.health.note(f"life cycle: no transition {wanted} from here; nothing was changed")
            response.success = False
            return response

    def state_changed(self) -> None:
        """After every transition. For subclasses."""

    def _change(self, configured: bool, active: bool, finalized: bool = False) -> TransitionCallbackReturn:
        self.configured, self.active = configured, active
        name = "active" if active else "inactive" if configured else "finalized" if finalized else "unconfigured"
        self.health.values["life cycle"] = name
        if active:
            self.health.well("life cycle")
        else:
            until = "the node is started anew" if finalized else "it is activated"
            self.health.doubt("life cycle", f"{name}: no torque until {until}")
        self.state_changed()
        return TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(True, False)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(True, True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(True, False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(False, False)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(False, False, finalized=True)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._change(False, False)
