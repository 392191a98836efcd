"""A servo drive on a CAN bus in place of the simulated axis (`canopen_hardware.py`); ROS knows it as `plant`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.drivers.canopen_hardware import CanopenHardware
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings
from tcs_friction.nodes.drivers.driver_node import DriverConfig, DriverNode


@dataclass(frozen=True)
class CanopenDriveConfig(DriveSettings, DriverConfig):
    """Settings of the driver: its drive and its limits."""

    def conflict(self) -> list[str]:
        """What does not go together."""
        return DriveSettings.conflict(self) + DriverConfig.conflict(self)


class CanopenDrive(DriverNode[CanopenDriveConfig]):
    """A driver whose drive is on a CAN bus."""

    def __init__(self) -> None:
        self._posted: deque[Callable[[], None]] = deque()
        super().__init__(CanopenDriveConfig)

    def make(self, config: CanopenDriveConfig) -> CanopenHardware:
        linear = self.file.axis.kind == "linear"
        now = self.get_clock().now
        return CanopenHardware(config, linear, config.period, config.torque_limit, lambda: now().nanoseconds, self._post)

    def _post(self, work: Callable[[], None]) -> None:
        """From any thread: has something done in the executor's."""
        self._posted.append(work)
        if self.executor is not None:
            self.executor.create_task(self._work)

    def _work(self) -> None:
        while self._posted:
            self._posted.popleft()()

    def _on_timer(self) -> None:
        self._work()  # what came before there was an executor
        super()._on_timer()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(CanopenDrive, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
