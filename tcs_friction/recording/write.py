"""Bags out: rosbag2 directories (mcap, metadata version 9) that every ROS tool opens."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.recording.columns import Nanoseconds
from tcs_friction.recording.definitions import Channel, parsed, standard_types
from tcs_friction.recording.encode import TopicData, encoded, joint_states, simple_type, typestore
from tcs_friction.recording.mcap_write import CHUNK_BYTES, McapWriter
from tcs_friction.recording.recording import Column, Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.writable import scratch_beside, writing
from tcs_friction.yaml_files import dump_yaml, parse_yaml

EPOCH = 1_700_000_000_000_000_000
"""ns; when recordings without a date of their own are written to begin, so that equal input gives equal bags."""


@dataclass(frozen=True)
class StorageFile:
    """One finished storage file, for the metadata."""

    name: str
    start: int
    end: int
    counts: tuple[int, ...]


def write_bag(path: Path, topics: Sequence[TopicData], compression: str = "zstd") -> None:
    """Write a bag directory. Raises InputError if the path exists; nothing half-written ever bears its name."""
    with new_directory(path) as scratch:
        name = f"{path.name}_0.mcap"
        with McapWriter(scratch / name, compression) as writer:
            numbers = [writer.add_channel(topic.channel, type_hash(topic.channel)) for topic in topics]
            for part in _in_time(topics, numbers):
                writer.write_chunk(*part)
        file = StorageFile(name, writer.start, writer.end, tuple(writer.counts))
        write_metadata(scratch, [topic.channel for topic in topics], [file])


def write_recording(path: Path, recording: Recording, signals: SignalMap, start: int = EPOCH) -> None:
    """Write a recording as a bag in which `signals` finds everything again.

    Signals of joints go into JointState, the others into the first of encode.SIMPLE_TYPES that has their fields.
    `start`: ns since the epoch at t = 0. Raises InputError when a signal cannot be written that way.
    """
    times = start + np.rint(recording.t * 1e9).astype(np.int64)
    columns: dict[str, dict[SignalSource, Column]] = {}
    for name, source in signals.named():
        values = recording.exogenous.get(name) if name in signals.exogenous else getattr(recording, name)
        if values is not None:
            columns.setdefault(source.topic, {})[source] = source.recorded(values)
    write_bag(path, [topic_data(topic, times, sources) for topic, sources in columns.items()])


def topic_data(topic: str, times: Nanoseconds, sources: Mapping[SignalSource, Column]) -> TopicData:
    """Messages that hold the sources' values (as in the message, before any scale)."""
    if all(source.joint is None for source in sources):
        msgtype = simple_type(topic, list(sources))
        return encoded(topic, msgtype, times, {source.field: values for source, values in sources.items()})
    joints: dict[str, dict[str, Column]] = {}
    for source, values in sources.items():
        if source.joint is None or source.field not in ("position", "velocity", "effort"):
            raise InputError(str(source), "cannot be written", "field position, velocity or effort with a joint")
        joints.setdefault(source.joint, {})[source.field] = values
    return joint_states(topic, times, joints)


def _in_time(
    topics: Sequence[TopicData], numbers: Sequence[int]
) -> Iterator[tuple[list[int], list[Nanoseconds], list[Any]]]:
    """The messages of all topics cut at common times into parts of about one chunk."""
    filled = [(number, topic) for number, topic in zip(numbers, topics, strict=True) if len(topic.times)]
    if not filled:
        return
    size = sum(topic.messages.size for _, topic in filled)
    merged = np.sort(np.concatenate([topic.times for _, topic in filled]))
    edges = merged[:: max(1, len(merged) * CHUNK_BYTES // max(size, 1))][1:]
    cuts = {number: [0, *np.searchsorted(topic.times, edges).tolist(), len(topic.times)] for number, topic in filled}
    for place in range(len(edges) + 1):
        part: tuple[list[int], list[Nanoseconds], list[Any]] = ([], [], [])
        for number, topic in filled:
            start, stop = cuts[number][place : place + 2]
            if stop > start:
                part[0].append(number)
                part[1].append(topic.times[start:stop])
                part[2].append(topic.messages[start:stop])
        if part[0]:
            yield part


def type_hash(channel: Channel) -> str:
    """The RIHS01 hash of a channel's type by its own definition, "" if that cannot be parsed."""
    store = typestore()
    if channel.msgtype not in store.fielddefs:
        store = type(store)(None)
        store.register(dict(standard_types().fielddefs))
        try:
            store.register(parsed(channel.definition, "ros2msg", channel.msgtype))
        except Exception:  # any parser error: the hash is a convenience for other tools
            return ""
    return str(store.hash_rihs01(channel.msgtype))


def write_metadata(directory: Path, channels: Sequence[Channel], files: Sequence[StorageFile]) -> None:
    """metadata.yaml of a bag directory, written whole or not at all."""
    filled = [file for file in files if sum(file.counts)]
    start = min((file.start for file in filled), default=0)
    end = max((file.end for file in filled), default=0)
    totals = [sum(file.counts[number] for file in files if number < len(file.counts)) for number in range(len(channels))]
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(totals),
        "topics_with_message_count": [
            {"topic_metadata": _topic_metadata(channel), "message_count": total}
            for channel, total in zip(channels, totals, strict=True)
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [_file_metadata(file) for file in files],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    scratch = directory / ".metadata.yaml.part"
    scratch.write_text(dump_yaml({"rosbag2_bagfile_information": information}))
    scratch.replace(directory / "metadata.yaml")


def _topic_metadata(channel: Channel) -> dict[str, Any]:
    return {
        "name": channel.topic,
        "type": channel.msgtype,
        "serialization_format": "cdr",
        "offered_qos_profiles": parse_yaml(channel.qos, channel.topic) if channel.qos else [],
        "type_description_hash": type_hash(channel),
    }


def _file_metadata(file: StorageFile) -> dict[str, Any]:
    count = sum(file.counts)
    return {
        "path": file.name,
        "starting_time": {"nanoseconds_since_epoch": file.start if count else 0},
        "duration": {"nanoseconds": file.end - file.start if count else 0},
        "message_count": count,
    }


@contextmanager
def new_directory(path: Path) -> Iterator[Path]:
    """A directory to fill, which gets its name only when all went well. Raises InputError if the name is taken."""
    if path.exists():
        raise InputError(str(path), "exists already", "a new name for the bag")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = scratch_beside(path)
        scratch.mkdir()
        try:
            yield scratch
            os.rename(scratch, path)
        except BaseException:
            shutil.rmtree(scratch, ignore_errors=True)
            raise
