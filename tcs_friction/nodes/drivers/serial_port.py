"""A serial port that never blocks, here or of a serial server: 8 bits, no parity, 1 stop bit, no flow control."""

from __future__ import annotations

import contextlib
import os
from typing import Any
from urllib.parse import urlsplit

from tcs_friction.errors import InputError, JobError

try:
    import serial
except ModuleNotFoundError:  # of the optional set for hardware
    serial = None

BAUD_RATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400)
SCHEMES = ("rfc2217", "socket")
"""Of the URLs that pyserial knows those of serial servers; others are for tests, or write files."""

MOST = 4096
"""Bytes taken at a time."""

PATIENCE = 0.02
"""s to wait for room in the port's buffer; a request has two bytes."""


def check_port(port: str) -> None:
    """Raises InputError for what can never become a port: an unknown URL, or no pyserial."""
    expected = "a device like /dev/ttyUSB0, rfc2217://HOST:PORT or socket://HOST:PORT"
    if "://" in port:
        try:
            parts = urlsplit(port)
            whole = parts.scheme in SCHEMES and parts.hostname and parts.port
        except ValueError:
            whole = None
        if not whole:
            raise InputError("dynamometer: parameter port", repr(port), expected)
    if serial is None:
        raise InputError("dynamometer", "needs the package pyserial", "./tcs node dynamometer, or pip install pyserial")


class SerialPort:
    """An open port, nobody else's. Everything raises JobError once the device or the server is gone."""

    def __init__(self, port: str, baud: int) -> None:
        self.port = port
        patience = None if port.startswith("rfc2217:") else PATIENCE  # pyserial has none there; the network's buffer is large
        try:
            self._line: Any = serial.serial_for_url(port, baud, timeout=0, write_timeout=patience, exclusive=True)
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            raise JobError(port, f"cannot be opened ({_reason(error)})", "a gauge plugged in") from None

    def read(self) -> bytes:
        """What has come since, perhaps nothing."""
        received = b""
        try:
            while len(received) < MOST and (part := self._line.read(MOST)):  # by RFC 2217 a byte comes at a time
                received += part
            return received
        except (OSError, TypeError) as error:  # TypeError: closed by pyserial itself
            raise self._gone(error) from None

    def write(self, data: bytes) -> None:
        """Send; what does not fit into the port's buffer is lost, and the reply will be missed."""
        try:
            self._line.write(data)
        except serial.SerialTimeoutException:
            return
        except (OSError, TypeError) as error:
            raise self._gone(error) from None

    def close(self) -> None:
        """Give the port back."""
        with contextlib.suppress(OSError):
            self._line.close()

    def _gone(self, error: Exception) -> JobError:
        return JobError(self.port, f"is gone ({_reason(error)})", "the gauge plugged in again")


def _reason(error: Exception) -> str:
    """The system's words where there are some, else pyserial's."""
    number = getattr(error, "errno", None)
    words = os.strerror(number) if number else str(error).rpartition("] ")[2]
    return " ".join(words.split())
