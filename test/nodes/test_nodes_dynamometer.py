"""The dynamometer: replies of each protocol, and the real node on a pseudo-terminal, unplugged and plugged in again."""

from __future__ import annotations

import contextlib
import itertools
import os
import pty
import socket
import termios
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
import serial.rfc2217
from conftest import wait_until
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.errors import InputError, JobError
from tcs_friction.nodes.drivers import serial_port
from tcs_friction.nodes.drivers.dynamometer import DynamometerConfig
from tcs_friction.nodes.drivers.gauge import LONGEST, PROTOCOLS, UNITS, GaugeError, newtons
from tcs_friction.nodes.drivers.serial_port import SerialPort

WARN = 1

# What the makers' manuals show, and what it means in N.
SHOWN = [
    ("mark10", "-18.78 lbF", "lbf", -83.5376),
    ("mark10", "4.285 N", "N", 4.285),
    ("mark10", "4.285", "kN", 4285.0),
    ("mecmesin", "  -0.250 kgf", "kgf", -2.45166),
    ("mecmesin", "12", "N", 12.0),
    ("imada", "+12.34NTO", "N", 12.34),
    ("imada", "-1.500KTL", "kgf", -14.70998),
    ("imada", "+100.0OT", "ozf", 27.80139),
    ("sauter", "1021.15", "N", 21.15),
    ("sauter", "0011.70", "N", -11.70),
    ("sauter", "100.005", "kN", 5.0),
]


@pytest.mark.parametrize(("protocol", "reply", "unit", "force"), SHOWN)
def test_replies_of_the_manuals(protocol: str, reply: str, unit: str, force: float) -> None:
    assert newtons(protocol, reply.strip(), unit) == pytest.approx(force, rel=1e-5)


@pytest.mark.parametrize(
    ("protocol", "reply", "unit", "words"),
    [
        ("mark10", "*10", "N", "refuses the request"),
        ("mark10", "4.2 lbF", "N", "shows lbF, expected N"),
        ("mark10", "0.35 Nm", "N", "shows Nm"),
        ("mecmesin", "xxxx", "N", "no valid calibration"),
        ("mecmesin", "12.3.4", "N", "baud rate"),
        ("mecmesin", "", "N", "baud rate"),
        ("imada", "+12.34KTO", "N", "shows K, expected N"),
        ("imada", "+12.34NPO", "N", "peak"),
        ("imada", "+12.34NTE", "N", "beyond its range"),
        ("imada", "E", "N", "refuses the request"),
        ("imada", "12.34 N", "N", "baud rate"),
        ("sauter", "2021.15", "N", "baud rate"),
        ("sauter", "1......", "N", "baud rate"),
        ("sauter", "10211.5.", "N", "baud rate"),
    ],
)
def test_what_is_no_reading_is_named(protocol: str, reply: str, unit: str, words: str) -> None:
    with pytest.raises(GaugeError, match=words):
        newtons(protocol, reply, unit)


def answer(protocol: str, force: float) -> bytes:
    """What a gauge set to N sends for a force."""
    if protocol == "imada":
        return f"{force:+06.2f}NTO\r".encode()
    if protocol == "sauter":
        return f"{'1' if force >= 0.0 else '0'}{abs(force):06.2f}".encode()
    return f"{force:.2f} N\r\n".encode()


@given(st.sampled_from(sorted(PROTOCOLS)), st.integers(-99_999, 99_999), st.integers(1, 5))
def test_a_reading_survives_any_division_into_pieces(protocol: str, hundredths: int, piece: int) -> None:
    sent, rest, found = answer(protocol, hundredths / 100.0), b"", []
    for start in range(0, len(sent), piece):
        replies, rest = PROTOCOLS[protocol].split(rest + sent[start : start + piece])
        found += [newtons(protocol, reply, "N") for reply in replies]
    assert found == [hundredths / 100.0]
    assert rest == b""


@given(st.sampled_from(sorted(PROTOCOLS)), st.binary(max_size=200))
def test_no_bytes_crash_and_none_pile_up(protocol: str, data: bytes) -> None:
    replies, rest = PROTOCOLS[protocol].split(data)
    assert len(rest) <= LONGEST
    for reply in replies:
        with contextlib.suppress(GaugeError):
            assert abs(newtons(protocol, reply, "N")) < float("inf")


def test_units_are_what_they_are() -> None:
    assert UNITS["lbf"] == pytest.approx(0.45359237 * 9.80665)
    assert UNITS["ozf"] == pytest.approx(UNITS["lbf"] / 16.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"port": "spy:///dev/ttyUSB0?file=/tmp/x"}, "rfc2217://HOST:PORT"),
        ({"port": "socket://lab"}, "socket://HOST:PORT"),
        ({"port": "socket://lab:99999"}, "socket://HOST:PORT"),
        ({"baud": 9601}, "baud"),
        ({"lever_arm": 0.0}, "lever_arm"),
        ({"protocol": "sauter", "poll": False}, "poll"),
    ],
)
def test_settings_that_cannot_work_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        DynamometerConfig(**changes).check()


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JobError, match=r"cannot be opened .*Inappropriate ioctl"):
        SerialPort(str(tmp_path / "file"), 9600)
    with pytest.raises(JobError, match=r"cannot be opened \(No such file or directory\)"):
        SerialPort(str(tmp_path / "nothing"), 9600)
    with pytest.raises(JobError, match=r"cannot be opened \(Connection refused\)"):
        SerialPort("socket://127.0.0.1:1", 9600)


def test_a_port_is_nobody_else_s(gauge: Any) -> None:
    made = gauge("mecmesin")
    first = SerialPort(str(made.name), 9600)
    with pytest.raises(JobError, match="cannot be opened"):
        SerialPort(str(made.name), 9600)
    first.close()
    SerialPort(str(made.name), 9600).close()


def test_a_gauge_that_takes_nothing_does_not_hold_the_node_up() -> None:
    """Requests that do not fit into the port's buffer are dropped."""
    master, slave = pty.openpty()
    port = SerialPort(os.ttyname(slave), 9600)
    for _ in range(100):
        port.write(bytes(1000))
    assert port.read() == b""
    port.close()
    os.close(slave)
    os.close(master)


def test_without_pyserial_the_node_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_port, "serial", None)
    with pytest.raises(InputError, match=r"needs the package pyserial, expected \./tcs node dynamometer"):
        DynamometerConfig().check()


class Gauge:
    """A gauge on a pseudo-terminal behind a name that stays the same, as udev's names do."""

    def __init__(self, name: Path, protocol: str) -> None:
        self.name, self.protocol = name, protocol
        self.force = 12.5
        self.reply: bytes | None = None  # instead of a reading
        self.requests: list[bytes] = []
        self.plug_in()

    def plug_in(self) -> None:
        self.master, self._slave = pty.openpty()
        self.name.symlink_to(os.ttyname(self._slave))
        self._thread = threading.Thread(target=self._answer, args=(self.master,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        self.name.unlink()
        os.close(self._slave)
        os.close(self.master)
        self._thread.join(5.0)

    @property
    def speed(self) -> int:
        return int(termios.tcgetattr(self._slave)[4])

    def _answer(self, master: int) -> None:
        with contextlib.suppress(OSError):
            while True:
                self.requests.append(os.read(master, 64))
                os.write(master, answer(self.protocol, self.force) if self.reply is None else self.reply)


class WithoutModem(serial.Serial):  # type: ignore[misc]
    """A serial port whose modem lines are nowhere: a pseudo-terminal has none."""

    cts = dsr = ri = cd = False
    dtr = rts = True


class SerialServer:
    """A serial port on the network, raw (socket) or by RFC 2217, for one client at a time, as a thread."""

    def __init__(self, device: str, scheme: str, number: int = 0) -> None:
        self._port = WithoutModem(device, timeout=0.01)
        self._listening = socket.create_server(("127.0.0.1", number))
        self._listening.settimeout(0.1)
        self.number = self._listening.getsockname()[1]
        self._scheme, self._open = scheme, True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._open = False
        self._thread.join(5.0)
        self._listening.close()
        self._port.close()

    def _serve(self) -> None:
        while self._open:
            with contextlib.suppress(OSError):
                client, _ = self._listening.accept()
                client.settimeout(0.01)
                with client:
                    self._pass_on(client)

    def _pass_on(self, client: socket.socket) -> None:
        class Writer:
            write = staticmethod(client.sendall)

        manager = serial.rfc2217.PortManager(self._port, Writer()) if self._scheme == "rfc2217" else None
        while self._open:
            with contextlib.suppress(TimeoutError):
                received = client.recv(1024)
                if not received:
                    return
                self._port.write(b"".join(manager.filter(received)) if manager else received)
            sent = self._port.read(100)
            client.sendall(b"".join(manager.escape(sent)) if manager else sent)


@pytest.fixture
def gauge(tmp_path: Path) -> Iterator[Any]:
    """Makes gauges; they are unplugged afterwards."""
    made: list[Gauge] = []

    def make(protocol: str) -> Gauge:
        made.append(Gauge(tmp_path / "gauge", protocol))
        return made[-1]

    yield make
    for item in made:
        with contextlib.suppress(OSError):
            item.unplug()


@pytest.fixture
def readings(listener: Any) -> list[Any]:
    """The messages on `dynamometer`."""
    from geometry_msgs.msg import WrenchStamped

    heard: list[Any] = []
    listener.node.create_subscription(WrenchStamped, "dynamometer", heard.append, 100)
    return heard


@pytest.mark.parametrize("protocol", ["imada", "sauter"])
def test_readings_come_as_torque(protocol: str, gauge: Any, processes: Any, readings: list[Any]) -> None:
    made = gauge(protocol)
    arguments = ("-p", f"port:={made.name}", "-p", f"protocol:={protocol}", "-p", "lever_arm:=-0.8", "-p", "baud:=19200")
    processes.start("dynamometer", *arguments, "-p", "frame:=azimuth", "-p", "rate:=50")
    assert wait_until(lambda: len(readings) > 10), processes.log("dynamometer")
    made.force = -3.25
    assert wait_until(lambda: readings[-1].wrench.force.x == -3.25)
    assert readings[-1].wrench.torque.z == pytest.approx(0.8 * 3.25)
    assert readings[-1].header.frame_id == "azimuth"
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in readings]
    assert all(later >= earlier for earlier, later in itertools.pairwise(stamps))  # two lines may come at once
    assert made.speed == termios.B19200
    assert b"".join(made.requests).replace(PROTOCOLS[protocol].request, b"") == b""


def test_garbage_wrong_units_and_a_pulled_plug_are_named_and_survived(
    gauge: Any, processes: Any, listener: Any, readings: list[Any]
) -> None:
    made = gauge("mark10")
    processes.start("dynamometer", "-p", f"port:={made.name}", "-p", "protocol:=mark10", "-p", "answer_limit:=0.5")
    assert wait_until(lambda: bool(readings)), processes.log("dynamometer")

    def said(words: str) -> bool:
        level, message = listener.health.get("dynamometer", (0, ""))
        return (level == WARN and words in message) if words else level == 0 and bool(message)

    for reply, words in ((b"4.2 lbF\r\n", "shows lbF"), (b"\x8f\xfe~\r", "baud rate"), (b"\xfe\x80", "although it sends")):
        made.reply = reply
        assert wait_until(lambda words=words: said(words), 10.0), (words, listener.health)  # type: ignore[misc]
    count = len(readings)
    made.reply = b""
    assert wait_until(lambda: said("no reading"), 10.0), listener.health
    assert len(readings) == count, "what is no reading must not be published"
    made.unplug()
    assert wait_until(lambda: said("cannot be opened"), 10.0), listener.health
    made.reply = None
    made.plug_in()
    assert wait_until(lambda: len(readings) > count + 2, 10.0), listener.health
    assert wait_until(lambda: said(""), 10.0), listener.health
    assert processes.alive("dynamometer")


def test_a_gauge_that_sends_by_itself_is_not_asked(gauge: Any, processes: Any, readings: list[Any]) -> None:
    made = gauge("mecmesin")
    processes.start("dynamometer", "-p", f"port:={made.name}", "-p", "poll:=false")
    assert wait_until(lambda: made.speed == termios.B9600), processes.log("dynamometer")

    def heard() -> bool:
        os.write(made.master, b"7.5 N\r\n")
        return bool(readings)

    assert wait_until(heard)
    assert readings[0].wrench.force.x == 7.5
    assert made.requests == []


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_a_gauge_behind_a_serial_server(scheme: str, gauge: Any, processes: Any, listener: Any, readings: list[Any]) -> None:
    """The server is real, on the loopback; it goes and comes back."""
    made = gauge("imada")
    server = SerialServer(str(made.name), scheme)
    url = f"{scheme}://127.0.0.1:{server.number}"
    processes.start("dynamometer", "-p", f"port:={url}", "-p", "protocol:=imada", "-p", "baud:=19200")
    assert wait_until(lambda: len(readings) > 2, 90.0), processes.log("dynamometer")
    assert readings[-1].wrench.force.x == 12.5
    if scheme == "rfc2217":
        assert made.speed == termios.B19200
    server.close()
    assert wait_until(lambda: listener.health.get("dynamometer", (0, ""))[0] == WARN)
    count = len(readings)
    server = SerialServer(str(made.name), scheme, server.number)
    assert wait_until(lambda: len(readings) > count), processes.log("dynamometer")
    server.close()
