"""What the name of a table's column says: which signal, of which joint, in which unit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from tcs_friction.recording import units

NAMES = {
    "time": ("time", "t", "stamp", "timestamp", "seconds", "secs"),
    "position": ("position", "angle", "pos", "q", "theta"),
    "velocity": ("velocity", "speed", "vel", "omega", "dq", "qd"),
    "torque": ("torque", "effort", "force", "tau", "u", "trq"),
    "temperature": ("temperature", "temp"),
    "reference": ("reference", "setpoint", "target", "desired"),
}
"""What a column of a spreadsheet may be called, in any case, with the unit in brackets or behind it."""

CURRENTS = {"thrust": "", "current": "A", "iq": "A", "voltage": "V"}
"""Words that say a torque where no word of NAMES does: `Motor thrust`, `q-axis current`; and their units where none stands."""

WANTED = (*NAMES["reference"], "ref", "cmd", "command", "commanded", "demand", "demanded", "goal", "des", "setpoint", "set")
"""Words for what somebody asked for."""

DERIVED = ("error", "err", "deviation", "limit", "max", "min", "std", "stddev", "variance", "covariance", "ratio")
"""Words for what is neither recorded of the axis nor asked of it."""

NEUTRAL = ("act", "actual", "meas", "measured", "feedback", "fb", "value", "val", "in", "of", "the")
"""Words that tell no joint and no signal."""

STATES = ("joint", "joints", "state", "states")
"""Words of topics that tell no joint either, where there is another word."""

COUNTS = ("count", "counts", "cts", "tick", "ticks", "lsb", "incr", "increments")
"""Words for what an encoder counts, which is no unit before somebody says what one of them is."""

_HEAD = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*([^\[\]()]*?)\s*[\])])?\s*")
_RAW = re.compile(r"[^\W_]+|[%‰]")
_FINE = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\d_A-Za-z]+|[%‰]")
LONGEST_NAME = 256  # characters that are looked at


@dataclass(frozen=True)
class Said:
    """A column's name taken apart. signal: "" for none. joint: the words that are neither signal nor unit. unit: "" for none.

    sure: whether it says nothing but the signal and the unit. weak: whether only a word of CURRENTS or the unit says the signal.
    """

    signal: str = ""
    joint: tuple[str, ...] = ()
    unit: str = ""
    sure: bool = False
    weak: bool = False


def said(column: str, unit: str = "") -> Said:
    """What a name says: `Angle [deg]`, `angle_deg`, `az_act_deg`, `motorCurrent_A`, `/topic/joint/effort`, `q1`.

    unit: where another line of the table says it.
    """
    match = _HEAD.fullmatch(column[:LONGEST_NAME])
    assert match is not None  # every text matches
    name, inside = match[1], units.spelled(match[2] or "")
    if inside.isdigit():
        name, inside = f"{name} {inside}", ""  # an index
    unit = units.spelled(unit) or inside
    raw = _RAW.findall(name)
    whole = _of(_fine(raw), unit)
    if unit or whole.sure:
        return whole
    for count in (3, 2, 1):
        for words in (raw, _fine(raw)):
            tail = _unit_of(words[len(words) - count :]) if len(words) > count else ""
            told = _of(_fine(words[: len(words) - count]), tail) if tail else Said()
            if told.signal and units.is_unit(tail, told.signal):
                return told
    return whole


def _fine(words: list[str]) -> list[str]:
    """Words between which a name has only a change of case or a digit."""
    return [part for word in words for part in _FINE.findall(word)]


def counts(column: str) -> bool:
    """Whether a name says that a column holds what an encoder counts."""
    return any(word.lower() in COUNTS for word in _fine(_RAW.findall(column[:LONGEST_NAME])))


def _unit_of(words: list[str]) -> str:
    """The unit that some last words are, "" if they are none."""
    for text in ("/".join(words), "".join(words), "_".join(words).replace("_per_", "/")):
        if units.is_unit(units.spelled(text)):
            return units.spelled(text)
    return ""


def _of(words: list[str], unit: str) -> Said:
    """The signal that words say, and what is left of them."""
    known = [word.lower() for word in words]
    plain = [(place, word) for place, word in enumerate(known) if word not in NEUTRAL]
    asked = any(word in WANTED for _, word in plain)
    found = [(place, name, word) for place, word in plain if (name := _named(word, plain))]
    if any(word in DERIVED for _, word in plain):
        return Said(unit=unit)
    if not found and not asked:
        angle = unit != "" and units.is_unit(unit, "position") and bool(plain)
        return Said("position", tuple(word for _, word in plain), unit, weak=True) if angle else Said(unit=unit)
    place, name, word = found[-1] if found else (-1, "position", "")
    if asked and name not in ("position", "reference"):
        return Said(unit=unit)
    signal = "reference" if asked else name
    if signal == "reference" and not found and not _angular(unit):
        return Said(unit=unit)
    rest = tuple(w for p, w in plain if p != place and w not in WANTED)
    return Said(signal, rest, unit or (CURRENTS.get(word, "") if signal == "torque" else ""), not rest, word in CURRENTS)


def _angular(unit: str) -> bool:
    return unit != "" and units.is_unit(unit, "position")


def _named(word: str, plain: list[tuple[int, str]]) -> str:
    """The signal that a word names; a single letter does so only beside numbers."""
    if len(word) == 1 and any(not other.isdigit() for _, other in plain if other != word):
        return ""
    return next((name for name, words in NAMES.items() if word in words), "torque" if word in CURRENTS else "")


def joints_of(columns: Mapping[str, Said]) -> dict[str, tuple[str, ...]]:
    """The joints that have both a position and a torque among the columns: short name -> words, in the order of the table."""
    having: dict[str, dict[tuple[str, ...], None]] = {"position": {}, "torque": {}}
    for told in columns.values():
        if told.signal in having and told.joint:
            having[told.signal][told.joint] = None
    both = [joint for joint in having["position"] if joint in having["torque"]]
    return dict(zip(_short(both), both, strict=True))


def _short(joints: list[tuple[str, ...]]) -> list[str]:
    """Names without the words that all joints begin or end with."""
    if len(joints) == 1:
        return ["_".join([word for word in joints[0] if word not in STATES] or joints[0])]
    begin = 0
    while all(len(joint) > begin + 1 for joint in joints) and len({joint[: begin + 1] for joint in joints}) == 1:
        begin += 1
    end = 0
    while all(len(joint) > begin + end + 1 for joint in joints) and len({joint[len(joint) - end - 1 :] for joint in joints}) == 1:
        end += 1
    return ["_".join(joint[begin : len(joint) - end]) for joint in joints]
