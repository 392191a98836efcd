"""What push-pull force gauges say over a serial line: requests, replies, readings. No ROS and no port here.

Every gauge is asked for its current reading and answers in ASCII (8 bits, no parity, 1 stop bit):

| protocol | gauges | request | reply |
|---|---|---|---|
| mark10 | Mark-10 series 3 to 7, BG | `?C` CR | `-18.78 lbF` CR LF; `*10`, `*11` ... where a request is refused |
| mecmesin | Mecmesin AFG, BFG, CFG+; Dillon | `?` | `12.34 N` CR LF; `xxxx` while it has no calibration |
| imada | Imada DS2, DPS, DST | `D` CR | `+12.34NT`, `+12.34NTO` CR: value, unit, mode, judgement; `E` where it is refused |
| sauter | Sauter FH, FL | `9` | seven characters and no end: 1 tension, 0 compression, then the value: `1021.15` |

From the makers' manuals; how a Mecmesin ends its reply they do not say: CR, LF and both are taken. The unit may be switched
off in the first two and is never sent by the last.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from tcs_friction.errors import TcsError

UNITS = {
    "N": 1.0,
    "mN": 1e-3,
    "kN": 1e3,
    "gf": 9.80665e-3,
    "kgf": 9.80665,
    "ozf": 0.2780138509537812,
    "lbf": 4.4482216152605,
}
"""Units of force that a gauge can be set to, in N."""

LONGEST = 64
"""Characters without an end of reply that are kept."""

_PLAIN = re.compile(r"([+-]? *\d*\.?\d+|[+-]? *\d+\.) *([A-Za-z][A-Za-z.·-]*)?")
_IMADA = re.compile(r"([+-] *\d*\.?\d+)([A-Z])([A-Z])([A-Z]?)")
_SAUTER = re.compile(r"([01])((?=[\d.]{6}$)\d*\.?\d*)")
_IMADA_UNITS = {"N": ("N", "mN", "kN"), "K": ("kgf", "gf"), "O": ("lbf", "ozf")}


class GaugeError(TcsError):
    """A reply that is no reading; `found` says why."""


@dataclass(frozen=True)
class Protocol:
    """One gauge's language. `length`: characters of a reply that has no end, 0 where CR or LF ends it.

    `read(reply, unit)` gives the value shown, or raises GaugeError; `unit` is what the gauge should be set to.
    """

    request: bytes
    read: Callable[[str, str], float]
    length: int = 0

    def split(self, received: bytes) -> tuple[list[str], bytes]:
        """Whole replies among the bytes received, and the rest; a rest too long to become a reply is dropped."""
        if self.length:
            whole = [received[: self.length]] if len(received) >= self.length else []
            rest = b"" if whole else received
        else:
            *whole, rest = re.split(rb"[\r\n]+", received)
        replies = [part.decode("ascii", "replace").strip() for part in whole if part.strip()]
        return replies, rest if len(rest) <= LONGEST else b""


def newtons(protocol: str, reply: str, unit: str) -> float:
    """The force (N) in one reply, with the gauge's own sign. Raises GaugeError saying what is wrong with it."""
    return PROTOCOLS[protocol].read(reply, unit) * UNITS[unit]


def _plain(reply: str, unit: str) -> float:
    """A number and perhaps its unit."""
    if re.fullmatch(r"\*\d\d", reply):
        raise GaugeError("gauge", f"refuses the request (error {reply})", "a gauge that knows this protocol")
    if reply and not reply.strip("x"):
        raise GaugeError("gauge", "has no valid calibration (sends xxxx)", "a reading")
    match = _PLAIN.fullmatch(reply)
    if match is None:
        raise _garbage(reply)
    if match[2] and match[2].lower() != unit.lower():
        raise _wrong_unit(match[2], unit)
    return float(match[1].replace(" ", ""))


def _imada(reply: str, unit: str) -> float:
    """Value, unit (N, K for kgf or gf, O for lbf or ozf), T real time or P peak, judgement (E beyond the range)."""
    if reply == "E":
        raise GaugeError("gauge", f"refuses the request ({reply})", "a gauge that knows this protocol")
    match = _IMADA.fullmatch(reply)
    if match is None:
        raise _garbage(reply)
    if unit not in _IMADA_UNITS.get(match[2], ()):
        raise _wrong_unit(match[2], unit)
    if match[3] != "T":
        raise GaugeError("gauge", f"is in mode {match[3]} (peak)", "real time (T)")
    if match[4] == "E":
        raise GaugeError("gauge", "is beyond its range", "a force within it")
    return float(match[1].replace(" ", ""))


def _sauter(reply: str, unit: str) -> float:  # noqa: ARG001
    """Direction and value; tension is positive."""
    match = _SAUTER.fullmatch(reply)
    if match is None or not any(character.isdigit() for character in match[2]):
        raise _garbage(reply)
    return float(match[2]) * (1.0 if match[1] == "1" else -1.0)


def _garbage(reply: str) -> GaugeError:
    shown = reply if len(reply) <= 20 else f"{reply[:20]}..."
    return GaugeError("gauge", f"sends {shown!r}", "a reading (is the baud rate right, and the protocol?)")


def _wrong_unit(found: str, unit: str) -> GaugeError:
    return GaugeError("gauge", f"shows {found}", f"{unit}: set the gauge, or the parameter unit")


PROTOCOLS = {
    "mark10": Protocol(b"?C\r", _plain),
    "mecmesin": Protocol(b"?", _plain),
    "imada": Protocol(b"D\r", _imada),
    "sauter": Protocol(b"9", _sauter, length=7),
}
