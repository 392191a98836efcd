"""Bags of every kind give the same recording; fields, joints and types are found or the nearest ones named."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from recording_samples import KINDS, ROS2, SIGNALS, START, TOPIC, Sample, samples, write
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg

from tcs_friction.errors import InputError
from tcs_friction.recording.bags import Bag, read_columns, read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource


def read(bag: Path, signals: SignalMap = SIGNALS) -> Recording:
    (recording,) = read_recordings([bag], signals)
    return recording


def matches(recording: Recording, messages: list[Sample]) -> None:
    position, velocity, effort = np.array([sample.values for sample in messages]).T
    assert np.array_equal(recording.position, position)
    assert np.array_equal(recording.torque, effort)
    assert recording.velocity is not None
    assert np.array_equal(recording.velocity, velocity)
    assert np.allclose(recording.t, (np.array([s.stamp for s in messages]) - messages[0].stamp) * 1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_bag_gives_the_recording(kind: str, tmp_path: Path) -> None:
    messages = samples(150)
    recording = read(write(kind, tmp_path / "bag", messages))
    matches(recording, messages)
    assert recording.segments == (slice(0, 150),)
    assert recording.notes == (f"time base: header stamps of {TOPIC}",)


def test_joints_are_found_by_name_wherever_they_stand(tmp_path: Path) -> None:
    orders = [("azimuth", "elevation"), ("elevation", "azimuth"), ("cover", "azimuth", "elevation")]
    messages = [dataclasses.replace(sample, names=orders[i * 7 % 3]) for i, sample in enumerate(samples(200))]
    matches(read(write("mcap", tmp_path / "bag", messages)), messages)


def test_more_layouts_than_are_tried_in_bulk_still_decode(tmp_path: Path) -> None:
    messages = [
        dataclasses.replace(sample, names=(*(f"joint_{i}_{j}" for j in range(i % 45)), "azimuth"))
        for i, sample in enumerate(samples(90))
    ]
    matches(read(write("mcap", tmp_path / "bag", messages)), messages)


def test_messages_of_another_publisher_on_the_topic_are_passed_over(tmp_path: Path) -> None:
    messages = samples(100)
    others = [dataclasses.replace(sample, stamp=sample.stamp + 300_000, names=("cover",)) for sample in messages]
    both = sorted([*messages, *others], key=lambda sample: sample.stamp)
    recording = read(write("mcap", tmp_path / "bag", both))
    matches(recording, messages)
    assert f"{TOPIC}: 100 messages without joint azimuth passed over" in recording.notes
    assert len(recording.segments) == 1


def test_shared_recordings_are_what_the_plain_reader_says(shared_data: Path) -> None:
    folders = sorted(path for path in (shared_data / "data").iterdir() if (path / "axis.yaml").exists())
    assert folders
    for folder in folders:
        block = yaml.safe_load((folder / "axis.yaml").read_text())["signals"]
        signals = SignalMap.from_mapping(block, str(folder))
        recording = read(folder / "recording", signals)
        joint = signals.position.joint
        with AnyReader([folder / "recording"]) as reader:
            rows = []
            for connection, _, raw in reader.messages():
                if connection.topic == signals.position.topic:
                    message: Any = reader.deserialize(raw, connection.msgtype)
                    index = message.name.index(joint)
                    rows.append((message.position[index], message.effort[index]))
        assert np.array_equal(np.array(rows), np.column_stack((recording.position, recording.torque)))
        assert len(recording.segments) == 1


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_split_bags_are_read_in_their_order(suffix: str, tmp_path: Path) -> None:
    messages = samples(120)
    kind = suffix[1:].replace("db3", "db3")
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in range(12):
        piece = write(kind, tmp_path / f"part_{part}", messages[10 * part : 10 * part + 10])
        shutil.move(next(piece.glob(f"*{suffix}")), folder / f"bag_{part}{suffix}")
    recording = read(folder)
    matches(recording, messages)
    assert recording.notes[0] == "metadata.yaml is missing; 12 storage files found by name"
    (folder / f"bag_5{suffix}").unlink()
    names = [f"bag_{part}{suffix}" for part in range(12)]
    (folder / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": {"relative_file_paths": names, "message_count": 120}})
    )
    recording = read(folder)
    assert len(recording) == 110
    assert recording.notes[0] == f"damaged: bag_5{suffix} missing, the rest read"


def test_several_bags_are_several_recordings(tmp_path: Path) -> None:
    first, second = samples(50), samples(80)
    bags = [write("mcap", tmp_path / "a", first), write("bag", tmp_path / "b", second)]
    recordings = read_recordings(bags, SIGNALS)
    assert [len(recording) for recording in recordings] == [50, 80]
    assert recordings[1].source == str(bags[1])


def test_bare_storage_files_are_bags(tmp_path: Path) -> None:
    messages = samples(50)
    for kind, pattern in (("db3", "*.db3"), ("mcap", "*.mcap"), ("mcap-file", "*.zstd")):
        folder = write(kind, tmp_path / kind, messages)
        matches(read(next(folder.glob(pattern))), messages)


CUSTOM = "float64[3] fixed\nfloat32[] list\nInner[] inner\nint16 count\nbool on\nstring text\nbuiltin_interfaces/Time stamp"
INNER = "string name\nfloat64 value\nuint8[] raw"


def write_custom(path: Path, count: int = 20) -> Path:
    """A bag with a type nobody else has, its stamp at the top, strings of changing length inside."""
    types = get_types_from_msg(CUSTOM, "my_msgs/msg/Odd") | get_types_from_msg(INNER, "my_msgs/msg/Inner")
    store = type(ROS2)(None)
    store.register(dict(ROS2.fielddefs))
    store.register(types)
    odd, inner = store.types["my_msgs/msg/Odd"], store.types["my_msgs/msg/Inner"]
    time = store.types["builtin_interfaces/msg/Time"]
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/odd", "my_msgs/msg/Odd", typestore=store)
        for i in range(count):
            parts = [inner(name="x" * (i % 3), value=10.0 * i + k, raw=np.zeros(i % 4, np.uint8)) for k in range(3)]
            stamp = time(sec=1000 + i, nanosec=5)
            message = odd(
                fixed=np.array([i, i + 0.5, -i], dtype=float), list=np.arange(i % 2 + 2, dtype=np.float32) + i,
                inner=parts, count=-i, on=i % 2 == 1, text="t" * i, stamp=stamp,
            )  # fmt: skip
            writer.write(connection, START + i, store.serialize_cdr(message, "my_msgs/msg/Odd"))
    return path


def test_any_type_with_its_definition_in_the_bag(tmp_path: Path) -> None:
    signals = SignalMap(
        SignalSource("/odd", "fixed[1]"),
        SignalSource("/odd", "inner[2].value", scale=0.5),
        SignalSource("/odd", "list[1]"),
        exogenous={"count": SignalSource("/odd", "count"), "on": SignalSource("/odd", "on")},
    )
    recording = read(write_custom(tmp_path / "bag"), signals)
    i = np.arange(20.0)
    assert np.array_equal(recording.position, i + 0.5)
    assert np.array_equal(recording.torque, 5.0 * i + 1.0)
    assert recording.velocity is not None
    assert np.array_equal(recording.velocity, i + 1.0)
    assert np.array_equal(recording.exogenous["count"], -i)
    assert np.array_equal(recording.exogenous["on"], i % 2)
    assert np.array_equal(recording.t, i)


GOOD = SIGNALS.position


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (SignalSource("/joint_sates", "position", "azimuth"), "no topic /joint_sates, expected /joint_states"),
        (SignalSource(TOPIC, "positon", "azimuth"), "positon in /joint_states (sensor_msgs/msg/JointState), expected position"),
        (SignalSource(TOPIC, "position.x", "azimuth"), "no number position.x"),
        (SignalSource(TOPIC, "header.frame_id"), "header.frame_id is text, expected a number"),
        (SignalSource(TOPIC, "header.stamp"), "no number header.stamp"),
        (SignalSource(TOPIC, "position", "azimut"), "no joint azimut, expected azimuth"),
        (SignalSource(TOPIC, "position"), "position is an array, expected a joint, or an index as in position[0]"),
        (SignalSource(TOPIC, "position[7]"), "position[7] is empty in every message"),
        (SignalSource(TOPIC, "header[0]"), "[0] on something that is no array"),
        (SignalSource(TOPIC, "name[0]"), "name[0] is text"),
        (SignalSource("/odd", "fixed[3]"), "index 3, expected less than 3"),
        (SignalSource("/odd", "fixed", "azimuth"), "has no list of joint names, expected an index as in fixed[0]"),
        (SignalSource("/odd", "count", "azimuth"), "count is one number, expected no joint"),
        (SignalSource("/odd", "inner"), "no number inner in /odd (my_msgs/msg/Odd), expected"),
    ],
)
def test_what_is_not_there_is_answered_with_what_is(source: SignalSource, said: str, tmp_path: Path) -> None:
    bag = write_custom(tmp_path / "b") if source.topic == "/odd" else write("mcap", tmp_path / "b", samples(3))
    with pytest.raises(InputError) as caught:
        read_columns(Bag(bag), [source])
    assert said in str(caught.value)
    assert str(bag) in str(caught.value)


def test_an_empty_array_is_named(tmp_path: Path) -> None:
    types = ROS2.types
    header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=1, nanosec=0), frame_id="")
    message = types["sensor_msgs/msg/JointState"](header, ["azimuth"], np.ones(1), np.zeros(0), np.zeros(0))
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(TOPIC, "sensor_msgs/msg/JointState", typestore=ROS2)
        writer.write(connection, 1, ROS2.serialize_cdr(message, "sensor_msgs/msg/JointState"))
    with pytest.raises(InputError, match="effort is empty for joint azimuth in every message"):
        read(tmp_path / "bag")


def test_a_topic_without_messages_is_named(tmp_path: Path) -> None:
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection(TOPIC, "sensor_msgs/msg/JointState", typestore=ROS2)
    with pytest.raises(InputError, match="no message on /joint_states"):
        read(tmp_path / "bag")
