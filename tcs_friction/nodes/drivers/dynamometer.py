"""A push-pull force gauge on a serial port, published as the friction torque that it measures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import WrenchStamped

from tcs_friction.control.config_field import choice, setting, switch, text
from tcs_friction.errors import InputError, TcsError
from tcs_friction.nodes.core.convert import SECOND, set_stamp
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.plain_node import PlainNode
from tcs_friction.nodes.core.qos import PUBLISH
from tcs_friction.nodes.core.steady import steady_timer
from tcs_friction.nodes.drivers.gauge import PROTOCOLS, UNITS, GaugeError, newtons
from tcs_friction.nodes.drivers.serial_port import BAUD_RATES, SerialPort, check_port

LOOK = 0.005  # s between two looks at the port
SEEK = 0.5  # s between two attempts to open it
FRESH = 2.0  # s for which trouble is reported


@dataclass(frozen=True)
class DynamometerConfig:
    """The gauge, its port, and how it pulls."""

    port: str = text("/dev/ttyUSB0", "serial port of the gauge: a device, rfc2217://HOST:PORT or socket://HOST:PORT")
    protocol: str = choice("mecmesin", tuple(PROTOCOLS), "what the gauge speaks")
    baud: int = setting(9600, "1/s", min(BAUD_RATES), max(BAUD_RATES), "baud rate, as set in the gauge")
    unit: str = choice("N", tuple(UNITS), "unit that the gauge is set to; a reply in another one is refused")
    lever_arm: float = setting(1.0, "m", -100.0, 100.0, "from the axis to the line of pull; negative: readings change sign")
    rate: float = setting(10.0, "1/s", 0.1, 200.0, "how often the gauge is asked")
    poll: bool = switch(True, "ask for readings; off for a gauge that is set to send by itself")
    latency: float = setting(0.0, "s", 0.0, 1.0, "known age of a reading when it arrives")
    answer_limit: float = setting(1.0, "s", 0.01, 60.0, "a gauge that is silent for so long is reported")
    frame: str = text("", "frame name of the messages")

    def check(self) -> None:
        """Raises InputError for values that the ranges alone do not forbid, and where pyserial is missing."""
        check_port(self.port)
        if self.baud not in BAUD_RATES:
            raise InputError("dynamometer: parameter baud", str(self.baud), f"one of {', '.join(map(str, BAUD_RATES))}")
        if self.lever_arm == 0.0:
            raise InputError("dynamometer: parameter lever_arm", "0", "the distance in m from the axis to the line of pull")
        if PROTOCOLS[self.protocol].length and not self.poll:
            raise InputError("dynamometer: parameter poll", f"false with {self.protocol}", "true: its replies have no end")


class Dynamometer(PlainNode[DynamometerConfig]):
    """Publishes `dynamometer`: force.x what the gauge shows (N), torque.z that times the lever arm (N m).

    A gauge that is unplugged is looked for until it is back; a reply that is no reading is counted and named.
    """

    def __init__(self) -> None:
        super().__init__("dynamometer", DynamometerConfig())
        self.config.check()
        self._protocol = PROTOCOLS[self.config.protocol]
        self._publisher = self.create_publisher(WrenchStamped, "dynamometer", PUBLISH)
        self._port: SerialPort | None = None
        self._received = b""
        self._noise = False  # something has come since the last reading
        self._heard = time.monotonic()
        self._asked = self._sought = 0.0
        self._trouble, self._troubled = "", 0.0
        self._count = {"readings": 0, "refused": 0, "reconnected": -1}
        steady_timer(self, LOOK, self._look)

    def destroy_node(self) -> None:
        """Give the port back."""
        if self._port is not None:
            self._port.close()
        super().destroy_node()

    def condition(self) -> tuple[str, dict[str, str]]:
        """What is wrong with the gauge, and counters."""
        now = time.monotonic()
        silent = now - self._heard
        problem = self._trouble if now - self._troubled < FRESH else ""
        if not problem and silent > self.config.answer_limit:
            problem = f"{self.config.port}: no reading for {silent:.0f} s"
            problem += " although it sends: is the baud rate right, and the protocol?" if self._noise else ""
        counters = {name: str(max(value, 0)) for name, value in self._count.items()}
        return problem, {"port": self.config.port, "protocol": self.config.protocol, **counters}

    def _look(self) -> None:
        """Take what has come and ask again when it is time."""
        now = time.monotonic()
        try:
            if self._port is None:
                self._seek(now)
            else:
                self._take(self._port)
                self._ask(self._port, now)
        except TcsError as error:
            self._lose(str(error))

    def _seek(self, now: float) -> None:
        if now < self._sought:
            return
        self._sought = now + SEEK
        self._port = SerialPort(self.config.port, self.config.baud)
        self._received, self._asked, self._heard, self._trouble = b"", 0.0, now, ""
        self._noise = False
        self._count["reconnected"] += 1
        self.get_logger().info(f"{self.config.port} opened at {self.config.baud} baud, {self.config.protocol}")

    def _lose(self, trouble: str) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None
        if trouble != self._trouble:
            self.get_logger().warning(trouble)
        self._trouble, self._troubled = trouble, time.monotonic()

    def _ask(self, port: SerialPort, now: float) -> None:
        if self.config.poll and now - self._asked >= 1.0 / self.config.rate:
            if self._protocol.length:
                self._received = b""  # a reply without an end can only be told from its beginning
            port.write(self._protocol.request)
            self._asked = now

    def _take(self, port: SerialPort) -> None:
        received = port.read()
        if not received:
            return
        self._noise = True
        stamp = self.get_clock().now().nanoseconds - round(self.config.latency * SECOND)
        replies, self._received = self._protocol.split(self._received + received)
        for reply in replies:
            self._publish(reply, stamp)

    def _publish(self, reply: str, stamp: int) -> None:
        try:
            force = newtons(self.config.protocol, reply, self.config.unit)
        except GaugeError as error:
            self._count["refused"] += 1
            self._trouble, self._troubled = f"{self.config.port}: {error}", time.monotonic()
            self.get_logger().warning(self._trouble, throttle_duration_sec=5.0)
            return
        self._trouble, self._noise = "", False
        self._heard = time.monotonic()
        self._count["readings"] += 1
        message = WrenchStamped()
        message.header.frame_id = self.config.frame
        set_stamp(message, stamp)
        message.wrench.force.x = force
        message.wrench.torque.z = force * self.config.lever_arm
        self._publisher.publish(message)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Dynamometer, args=args)


if __name__ == "__main__":
    raise SystemExit(main())
