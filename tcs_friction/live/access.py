"""Who may look and who may give orders: names of hosts, origins, the token.

What somebody else's site runs in the operator's browser reaches this server as well. Two checks keep it out: the Host header must
name this machine (DNS rebinding), the Origin header of a WebSocket or a form must be this server's own.
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tcs_friction.errors import InputError, refusal

LOOPBACK = "127.0.0.1"
VARIABLE = "TCS_LIVE_TOKEN"
SHORTEST, LONGEST = 16, 200
"""Characters of a token."""
COOKIE = "tcs_live"


@dataclass(frozen=True)
class Access:
    """host: what the server is bound to. token: "" for none. names: more names by which it is reached."""

    host: str = LOOPBACK
    token: str = ""
    control: bool = True
    names: tuple[str, ...] = ()
    session: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    """What the cookie of somebody who knows the token says, until this process ends."""

    def knows(self, name: str | None) -> bool:
        """Whether a Host header names this server: by an address, or by a name that is this machine's own."""
        host = host_of(name)
        if host is None:
            return False
        if host == "localhost" or host in (known.lower() for known in self.names):
            return True
        if is_loopback(self.host):
            return is_loopback(host)
        return _address(host) is not None or host == self.host.lower() or host == socket.gethostname().lower()

    def welcomes(self, cookie: str | None, authorization: str | None) -> bool:
        """Whether somebody with this cookie and Authorization header may look."""
        if not self.token:
            return True
        bearer = (authorization or "").removeprefix("Bearer ") if (authorization or "").startswith("Bearer ") else ""
        known = _equal(cookie or "", self.session)
        return _equal(bearer, self.token) or known

    def accepts(self, token: str) -> bool:
        """Whether a token is the right one; takes as long for a wrong one."""
        return bool(self.token) and _equal(token, self.token)


def access(
    host: str, token_file: str, control: bool, names: tuple[str, ...], environment: Mapping[str, str] = os.environ
) -> Access:
    """The rules for an address to be bound to. Raises InputError where others could reach it without a token."""
    token = _token(token_file, environment.get(VARIABLE, ""))
    near = is_loopback(host)
    if not near and not token:
        raise InputError("--host", f"{host} can be reached from other machines", f"--token-file FILE or {VARIABLE} beside it")
    return Access(host, token, near or control, names)


def same_origin(origin: str | None, host: str | None) -> bool:
    """Whether an Origin header is that of the server which the Host header names."""
    if not origin or not host:
        return False
    scheme, mark, rest = origin.partition("://")
    return bool(mark) and scheme in ("http", "https") and rest.lower() == host.lower()


def host_of(header: str | None) -> str | None:
    """The name in a Host header without its port, in lower case; None where it is not well-formed."""
    name = (header or "").strip().lower()
    if name.startswith("["):
        inside, mark, rest = name[1:].partition("]")
        port = rest.removeprefix(":")
        good = bool(mark) and (not rest or (rest.startswith(":") and port.isdecimal()))
        return inside if good and _address(inside) is not None else None
    host, _, port = name.partition(":")
    good = bool(host) and (not port or port.isdecimal()) and all(sign.isalnum() or sign in ".-_" for sign in host)
    return host if good else None


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    address = _address(host)
    return host.lower() == "localhost" or (address is not None and address.is_loopback)


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _equal(given: str, right: str) -> bool:
    return hmac.compare_digest(given.encode(), right.encode())


def _token(path: str, variable: str) -> str:
    """The token from a file or from the environment, "" for none."""
    if path and variable:
        raise InputError("--token-file", f"{VARIABLE} is set as well", "one of the two")
    where = path or VARIABLE
    token = _read(Path(path)) if path else variable
    if (path or variable) and not (SHORTEST <= len(token) <= LONGEST and token.isprintable() and " " not in token):
        expected = f"{SHORTEST} to {LONGEST} characters without blanks, such as `openssl rand -hex 16` gives"
        raise InputError(where, "no usable token", expected)
    return token


def _read(path: Path) -> str:
    try:
        with path.open(encoding="utf-8") as file:
            if os.fstat(file.fileno()).st_mode & 0o077:
                raise InputError(str(path), "others may read it", f"a file for its owner alone (chmod 600 {path})")
            return file.read(LONGEST + 2).rstrip("\n")
    except UnicodeDecodeError:
        raise InputError(str(path), "is no text", "a token") from None
    except OSError as error:
        raise InputError(str(path), str(refusal(error).found), "a file with a token") from None
