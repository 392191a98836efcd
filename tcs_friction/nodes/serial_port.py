"""A serial port that never blocks: 8 bits, no parity, 1 stop bit, no flow control. Standard library, POSIX systems."""

from __future__ import annotations

import contextlib
import fcntl
import os
import termios
import tty

from tcs_friction.errors import JobError

BAUD_RATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400)
_IFLAG, _OFLAG, _CFLAG, _LFLAG, _ISPEED, _OSPEED = range(6)


class SerialPort:
    """An open port. Everything raises JobError once the device is gone."""

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise JobError(path, f"cannot be opened ({error.strerror})", "a gauge plugged in") from None
        try:
            self._set_up(baud)
        except (OSError, termios.error) as error:
            self.close()
            raise JobError(path, f"is no serial port ({error.args[-1]})", "a device like /dev/ttyUSB0") from None

    def _set_up(self, baud: int) -> None:
        fcntl.ioctl(self._descriptor, termios.TIOCEXCL)  # nobody else reads half of the replies
        tty.setraw(self._descriptor)
        settings = termios.tcgetattr(self._descriptor)
        settings[_CFLAG] &= ~(termios.CSTOPB | termios.CRTSCTS | termios.HUPCL)
        settings[_CFLAG] |= termios.CLOCAL | termios.CREAD
        settings[_ISPEED] = settings[_OSPEED] = getattr(termios, f"B{baud}")
        termios.tcsetattr(self._descriptor, termios.TCSANOW, settings)
        termios.tcflush(self._descriptor, termios.TCIOFLUSH)

    def read(self) -> bytes:
        """What has come since, perhaps nothing."""
        try:
            received = os.read(self._descriptor, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error.strerror) from None
        if not received:
            raise self._gone("hung up")
        return received

    def write(self, data: bytes) -> None:
        """Send; what does not fit into the port's buffer is lost, and the reply will be missed."""
        try:
            os.write(self._descriptor, data)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._gone(error.strerror) from None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._descriptor)

    def _gone(self, reason: str | None) -> JobError:
        return JobError(self.path, f"is gone ({reason})", "the gauge plugged in again")
