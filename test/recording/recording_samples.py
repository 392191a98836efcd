"""Small good bags of every kind, written by other people's writers (rosbags, mcap)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tcs_friction.recording.signals import SignalMap, SignalSource

TOPIC = "/joint_states"
START = 1_700_000_000_000_000_000
ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)

SIGNALS = SignalMap(
    SignalSource(TOPIC, "position", "azimuth"),
    SignalSource(TOPIC, "effort", "azimuth"),
    SignalSource(TOPIC, "velocity", "azimuth"),
)

ROSBAG2 = (
    "mcap", "mcap-zstd", "mcap-lz4", "mcap-loose", "mcap-bare", "mcap-file", "mcap-message", "db3", "db3-file", "db3-message",
)  # fmt: skip
ROSBAG1 = ("bag", "bag-bz2", "bag-lz4")
KINDS = (*ROSBAG2, *ROSBAG1)


@dataclass
class Sample:
    """One message: stamp in ns, position, velocity and effort of the azimuth, as floats; joint names in order."""

    stamp: int
    values: tuple[float, float, float]
    names: tuple[str, ...] = ("azimuth", "elevation")
    log: int | None = None

    @property
    def log_time(self) -> int:
        return self.stamp if self.log is None else self.log


def samples(count: int = 400, period: int = 1_000_000) -> list[Sample]:
    """A smooth motion at 1 kHz."""
    phase = np.arange(count) * 0.01
    return [
        Sample(START + i * period, (float(np.sin(phase[i])), float(np.cos(phase[i])), 5.0 + i))
        for i in range(count)
    ]


def joint_state(sample: Sample, store: Any = ROS2) -> Any:
    """The sample as sensor_msgs/JointState; the other joints have the negative values."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=sample.stamp // 10**9, nanosec=sample.stamp % 10**9)
    extra = {"seq": 0} if store is ROS1 else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **extra)
    columns = [np.array([v if name == "azimuth" else -v for name in sample.names]) for v in sample.values]
    return types["sensor_msgs/msg/JointState"](header, list(sample.names), *columns)


def write(kind: str, path: Path, messages: list[Sample]) -> Path:
    """A bag of one kind at `path` (a suffix is added where the kind needs one); returns what to read."""
    if kind in ROSBAG1:
        return _write1(kind, path.with_suffix(".bag"), messages)
    if kind in ("mcap-zstd", "mcap-lz4", "mcap-loose", "mcap-bare"):
        return _write_library(kind, path, messages)
    storage, _, mode = kind.partition("-")
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if mode:
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(TOPIC, "sensor_msgs/msg/JointState", typestore=ROS2)
        for sample in messages:
            raw = ROS2.serialize_cdr(joint_state(sample), "sensor_msgs/msg/JointState")
            writer.write(connection, sample.log_time, raw)
    return path


def _write1(kind: str, path: Path, messages: list[Sample]) -> Path:
    writer = Writer1(path)
    if kind != "bag":
        writer.set_compression(Writer1.CompressionFormat[kind.partition("-")[2].upper()])
    with writer:
        connection = writer.add_connection(TOPIC, "sensor_msgs/msg/JointState", typestore=ROS1)
        for sample in messages:
            raw = ROS1.serialize_ros1(joint_state(sample, ROS1), "sensor_msgs/msg/JointState")
            writer.write(connection, sample.log_time, raw)
    return path


def _write_library(kind: str, path: Path, messages: list[Sample]) -> Path:
    """A bare file by the mcap library: small chunks, or none."""
    path = path.with_suffix(".mcap")
    how = {"mcap-zstd": CompressionType.ZSTD, "mcap-lz4": CompressionType.LZ4}.get(kind, CompressionType.NONE)
    with path.open("wb") as stream:
        writer = McapLibraryWriter(stream, chunk_size=8192, compression=how, use_chunking=kind != "mcap-loose")
        writer.start(profile="ros2")
        text, _ = ROS2.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", text.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for sample in messages:
            raw = bytes(ROS2.serialize_cdr(joint_state(sample), "sensor_msgs/msg/JointState"))
            writer.add_message(channel, sample.log_time, raw, sample.log_time)
        writer.finish()
    return path
