"""Signals named on the command line, `torque=/drive/torque:wrench.force.z`, and joints by name or by number."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from tcs_friction.errors import InputError, nearest
from tcs_friction.recording.choice import joint_number, no_joint
from tcs_friction.recording.signals import OPTIONAL, REQUIRED

FORM = "SIGNAL=/TOPIC:FIELD or SIGNAL=/TOPIC:FIELD@JOINT"
FIRST = "[0]"


def add_signals(parser: argparse.ArgumentParser) -> None:
    """--signal, for recordings whose signals lie where nobody would look for them."""
    parser.add_argument(
        "--signal", action="append", default=[], metavar="SIGNAL=/TOPIC:FIELD[@JOINT]",
        help="of a bag: where a signal is, as often as needed (torque=/drive/torque:wrench.force.z); others are proposed",
    )  # fmt: skip


def named_signals(words: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Signal -> entry of a `signals:` block. Raises InputError for a word of another form, and for a signal named twice."""
    found: dict[str, dict[str, Any]] = {}
    for word in words:
        name, _, place = word.partition("=")
        topic, _, rest = place.partition(":")
        field, _, joint = rest.partition("@")
        if not (name and topic.startswith("/") and field) or (joint == "" and rest.endswith("@")):
            raise InputError("--signal", repr(word), FORM)
        if name in found:
            raise InputError("--signal", f"{name} named twice", "each signal once")
        found[name] = {"topic": topic, "field": field} | ({"joint": joint} if joint else {})
    return found


def with_signals(block: Mapping[str, Any], named: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """A proposed block with the named signals in it; other names than those of an axis are exogenous.

    What was proposed beside another position or joint than the one that is named is no signal of this axis.
    """
    merged: dict[str, Any] = {name: entry for name, entry in block.items() if name != "exogenous"}
    position = named.get("position")
    if position is not None and merged.get("position") != position:
        known = ("topic", "joint")
        same = [position.get(key) for key in known] == [merged.get("position", {}).get(key) for key in known]
        merged = {name: entry for name, entry in merged.items() if same or name in ("torque", "temperature")}
    exogenous = dict(block.get("exogenous", {}))
    for name, entry in named.items():
        (merged if name in (*REQUIRED, *OPTIONAL) else exogenous)[name] = dict(entry)
    return merged | ({"exogenous": exogenous} if exogenous else {})


def of_joint(block: Mapping[str, Any], joints: Sequence[str], asked: str | None) -> dict[str, Any]:
    """The proposal for another joint than the first, by name, or by number from 0 on as in position[0].

    Raises InputError naming the joints there are.
    """
    merged = {name: dict(entry) for name, entry in block.items()}
    if asked is None:
        return merged
    if not joints:
        return _numbered(merged, asked)
    if asked not in joints:
        number = joint_number(asked)
        if number is None:
            raise no_joint(asked, nearest(asked, joints))
        if number >= len(joints):
            raise no_joint(asked, f"0 to {len(joints) - 1} or a name")
        asked = joints[number]
    first = merged["position"].get("joint")
    if asked == first:
        return merged
    for name in ("position", "velocity", "torque"):
        if name in merged and merged[name].get("joint") == first:
            merged[name]["joint"] = asked
    exogenous = merged.pop("exogenous", {})
    exogenous.pop(f"{asked}_velocity", None)
    if "velocity" in merged and merged["velocity"].get("joint") == asked:
        exogenous[f"{first}_velocity"] = {**merged["velocity"], "joint": first}
    return merged | ({"exogenous": exogenous} if exogenous else {})


def _numbered(block: dict[str, Any], asked: str) -> dict[str, Any]:
    """The same for arrays whose elements have no names."""
    numbered = [entry for name, entry in block.items() if name != "exogenous" and str(entry.get("field", "")).endswith(FIRST)]
    number = joint_number(asked)
    if not numbered or number is None:
        raise no_joint(asked, "a number from 0 on" if numbered else "none, since the topic names no joints")
    for entry in numbered:
        entry["field"] = entry["field"].removesuffix(FIRST) + f"[{number}]"
    return block
