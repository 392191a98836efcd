"""A CAN bus for several processes: python-can's virtual bus of this one, served to others by the protocol of socketcand."""

from __future__ import annotations

import contextlib
import re
import socket
import threading

import can

SENT = re.compile(rb"< send ([0-9A-Fa-f]+) ([0-9A-Fa-f]+) ([0-9A-Fa-f ]*)>")


class CanServer:
    """Serves the virtual bus `channel` on a port of this machine, until `close`."""

    def __init__(self, channel: str, port: int = 0) -> None:
        """port: 0 for any that is free."""
        self._channel = channel
        self._listening = socket.create_server(("127.0.0.1", port))
        self.port: int = self._listening.getsockname()[1]
        self._clients: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def options(self) -> tuple[str, ...]:
        """Parameter `bus_options` of who uses it."""
        return ("host=127.0.0.1", f"port={self.port}", "tcp_tune=true")

    def close(self) -> None:
        for connection in (self._listening, *self._clients):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                client = self._listening.accept()[0]
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._clients.append(client)
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        bus = can.Bus(interface="virtual", channel=self._channel)
        notifier = None
        try:
            client.sendall(b"< hi >")
            for _ in range(2):  # open, rawmode
                client.recv(256)
                client.sendall(b"< ok >")
            notifier = can.Notifier(bus, [lambda message: self._forward(client, message)], 0.1)
            rest = b""
            while data := client.recv(4096):
                rest += data
                done = 0
                for found in SENT.finditer(rest):
                    done = found.end()
                    payload = bytes(int(part, 16) for part in found[3].split())
                    bus.send(can.Message(arbitration_id=int(found[1], 16), data=payload, is_extended_id=False))
                rest = rest[done:]
        except OSError:
            pass  # the client has gone
        finally:
            if notifier is not None:
                notifier.stop(1.0)
            bus.shutdown()
            client.close()

    @staticmethod
    def _forward(client: socket.socket, message: can.Message) -> None:
        with contextlib.suppress(OSError):
            client.sendall(f"< frame {message.arbitration_id:03X} {message.timestamp:.6f} {message.data.hex()} >".encode())
