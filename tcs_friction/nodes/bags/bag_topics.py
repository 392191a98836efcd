"""Topics between the graph and a bag: message classes by name, definitions, quality of service."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from tcs_friction.errors import InputError
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.encode import known_definition
from tcs_friction.recording.metadata import whole_number
from tcs_friction.recording.record import definition_text
from tcs_friction.yaml_files import parse_yaml

DEPTH = 1000
"""Messages that a recorder's subscription, or a player's publisher, keeps while the other side is busy."""

MOST_DEPTH = 100_000
"""Messages that a player keeps at most, whatever the bag says."""

POLICIES = {
    "history": HistoryPolicy,
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "liveliness": LivelinessPolicy,
}
FOREVER = {"sec": 9223372036, "nsec": 854775807}


def message_class(msgtype: str) -> Any:
    """The class of `package/msg/Name`; None if its package is not installed."""
    package, _, name = msgtype.partition("/msg/")
    try:
        get_package_share_directory(package)  # a bag may name any Python module, whose import could do anything
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (PackageNotFoundError, ImportError, AttributeError, ValueError, OSError):
        return None


@functools.cache
def installed_definition(msgtype: str) -> str | None:
    """The .msg text of an installed type, None if there is none."""
    package, _, name = msgtype.partition("/msg/")
    try:
        return Path(get_package_share_directory(package), "msg", f"{name}.msg").read_text()
    except (PackageNotFoundError, OSError, ValueError):
        return None


def recorded_channel(topic: str, msgtype: str, offered: Sequence[Any]) -> tuple[Channel, str]:
    """A topic as a bag has it, and the hash of its type; `offered`: what its publishers say of themselves."""
    definition = definition_text(msgtype, installed_definition) or known_definition(msgtype)
    profiles = profiles_text([endpoint.qos_profile for endpoint in offered])
    return Channel(topic, msgtype, "cdr", definition, "ros2msg", profiles), str(offered[0].topic_type_hash)


def subscription_profile(offered: Sequence[QoSProfile]) -> QoSProfile:
    """A profile that hears every publisher: no stricter than the least of what they offer."""
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in offered)
    latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched and offered else DurabilityPolicy.VOLATILE,
    )


def profiles_text(offered: Sequence[QoSProfile]) -> str:
    """Offered profiles as a bag of metadata version 9 holds them."""
    return str(yaml.safe_dump([_entry(profile) for profile in offered], sort_keys=False)).strip()


def _entry(profile: QoSProfile) -> dict[str, Any]:
    names = {key: getattr(profile, key).name.lower() for key in POLICIES}
    return {
        "history": names["history"],
        "depth": profile.depth,
        "reliability": names["reliability"],
        "durability": names["durability"],
        "deadline": _span(profile.deadline),
        "lifespan": _span(profile.lifespan),
        "liveliness": names["liveliness"],
        "liveliness_lease_duration": _span(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": bool(profile.avoid_ros_namespace_conventions),
    }


def _span(duration: Duration) -> dict[str, int]:
    seconds, nanoseconds = divmod(duration.nanoseconds, 10**9)
    return {"sec": seconds, "nsec": nanoseconds} if duration.nanoseconds else dict(FOREVER)


def publisher_profile(text: str) -> QoSProfile:
    """The profile of a recorded topic, from metadata of any version; reliable and volatile where it says nothing.

    A publisher offers what all recorded ones offered: reliable, or latched, if one of them was. Only to those who come late does
    the depth of a latched topic matter; of others it keeps as much as a slow subscriber may want again.
    """
    try:
        read = parse_yaml(text, "quality of service")
        entries = [entry for entry in read if isinstance(entry, Mapping)] if isinstance(read, list) else []
    except InputError:
        entries = []
    reliability = [_policy(entry, "reliability") for entry in entries]
    durability = [_policy(entry, "durability") for entry in entries]
    depths = [depth for entry in entries if (depth := whole_number(entry.get("depth"), MOST_DEPTH))]
    best_effort = bool(reliability) and all(policy == ReliabilityPolicy.BEST_EFFORT for policy in reliability)
    latched = DurabilityPolicy.TRANSIENT_LOCAL in durability
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(depths, default=10) if latched else max([*depths, DEPTH]),
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _policy(entry: Mapping[str, Any], key: str) -> Any:
    """A policy by number (metadata up to version 8) or name (from 9); None for what is neither."""
    value = entry.get(key)
    try:
        return POLICIES[key](value) if isinstance(value, int) else POLICIES[key][str(value).upper()]
    except (ValueError, KeyError):
        return None
