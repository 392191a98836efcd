"""Bags in: every recording that rosbag2 or ROS 1 wrote becomes a Recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from tcs_friction.errors import InputError
from tcs_friction.recording.align import align
from tcs_friction.recording.columns import TopicColumns
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource, nearest

NAME_LISTS = ("name", "joint_names", "names")


def read_recordings(bags: Sequence[Path], signals: SignalMap) -> tuple[Recording, ...]:
    """One recording a bag. Raises InputError when a bag is none, or lacks a topic, field or joint."""
    return tuple(_read(Path(bag), signals) for bag in bags)


def _read(bag: Path, signals: SignalMap) -> Recording:
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            columns = {topic: _columns(reader, topic, signals, bag) for topic in signals.topics}
    except (AnyReaderError, FileNotFoundError) as error:
        raise InputError(str(bag), str(error), "a bag") from None
    return align(columns, signals, str(bag))


def _columns(reader: AnyReader, topic: str, signals: SignalMap, bag: Path) -> TopicColumns:
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if not connections:
        known = [connection.topic for connection in reader.connections]
        raise InputError(str(bag), f"no topic {topic}", nearest(topic, known))
    sources = [source for _, source in signals.named() if source.topic == topic]
    log_times, stamps = [], []
    values: dict[SignalSource, list[float]] = {source: [] for source in sources}
    for connection, time, raw in reader.messages(connections):
        message: Any = reader.deserialize(raw, connection.msgtype)
        log_times.append(time)
        if hasattr(message, "header"):
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        for source in sources:
            values[source].append(_value(message, source, bag))
    return TopicColumns(
        topic,
        np.array(log_times, dtype=np.int64),
        np.array(stamps, dtype=np.int64) if stamps else None,
        {source: np.array(column) * source.scale for source, column in values.items()},
    )


def _value(message: Any, source: SignalSource, bag: Path) -> float:
    names = next((list(getattr(message, key)) for key in NAME_LISTS if hasattr(message, key)), [])
    for step in source.steps:
        if isinstance(step, int):
            message = message[step]
        elif not hasattr(message, step):
            raise InputError(str(bag), f"no field {step} in {source.topic}", nearest(step, vars(message)))
        else:
            message = getattr(message, step)
    if source.joint is not None:
        if source.joint not in names:
            raise InputError(str(bag), f"no joint {source.joint} in {source.topic}", nearest(source.joint, names))
        message = message[names.index(source.joint)]
    return float(message)
