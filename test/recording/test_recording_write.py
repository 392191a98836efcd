"""Bags out: other people's readers open them and find the same; nothing half-written; killed recorders lose little."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from recording_samples import ROS2, samples
from recording_samples import write as sample_bag
from rosbags.highlevel import AnyReader

from tcs_friction.errors import InputError, JobError
from tcs_friction.recording import write
from tcs_friction.recording.bags import Bag, read_recordings
from tcs_friction.recording.encode import OWN_TYPES, channel_of, encoded, joint_states, typestore
from tcs_friction.recording.mcap_write import McapWriter
from tcs_friction.recording.play import as_cdr, first_time, in_log_order
from tcs_friction.recording.record import BagRecorder, definition_text
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.write import EPOCH, write_bag, write_recording

ROOT = Path(__file__).resolve().parents[2]
SIGNALS = SignalMap(
    SignalSource("/joint_states", "position", "azimuth"),
    SignalSource("/joint_states", "effort", "azimuth", 2.0),
    SignalSource("/joint_states", "velocity", "azimuth"),
    SignalSource("/temperature", "temperature"),
    SignalSource("/reference", "position"),
    {"wind": SignalSource("/wind", "vector.x"), "other": SignalSource("/joint_states", "velocity", "elevation")},
)


def recording(count: int = 3000) -> Recording:
    random = np.random.default_rng(0)
    columns = random.standard_normal((7, count))
    t = np.arange(count) * 1e-3
    exogenous = {"wind": columns[5], "other": columns[6]}
    return Recording(t, columns[0], columns[1], columns[2], columns[3], columns[4], exogenous)


def same(first: Recording, second: Recording) -> None:
    for name in ("t", "position", "torque", "velocity", "temperature", "reference"):
        assert np.allclose(getattr(first, name), getattr(second, name), rtol=0, atol=1e-12), name
    for name, values in first.exogenous.items():
        assert np.allclose(values, second.exogenous[name])


def test_a_recording_comes_back_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "bag"
    write_recording(path, recording(), SIGNALS)
    (back,) = read_recordings([path], SIGNALS)
    same(recording(), back)


def test_equal_recordings_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_recording(tmp_path / name / "bag", recording(), SIGNALS)
    assert (tmp_path / "a/bag/bag_0.mcap").read_bytes() == (tmp_path / "b/bag/bag_0.mcap").read_bytes()


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_other_readers_open_what_is_written(compression: str, tmp_path: Path) -> None:
    path = tmp_path / "bag"
    count = 30_000
    times = EPOCH + np.arange(count) * 1_000_000
    angle = np.sin(np.arange(count) * 1e-3)
    topics = [
        joint_states("/joint_states", times, {"azimuth": {"position": angle, "effort": -angle}, "cover": {"position": angle}}),
        encoded("/reference", "tcs_friction_msgs/msg/AxisReference", times[::10] + 7, {"position": angle[::10]}),
    ]
    write_bag(path, topics, compression)
    with AnyReader([path]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == {"/joint_states": count, "/reference": count // 10}
        times_read = [stamp for _, stamp, _ in reader.messages()]
        assert times_read == sorted(np.concatenate((times, times[::10] + 7)).tolist())
        assert reader.duration == int(times[-1] - times[0]) + 1
        for connection, stamp, raw in reader.messages([c for c in reader.connections if c.topic == "/reference"]):
            message = reader.deserialize(raw, connection.msgtype)
            assert message.position == angle[(stamp - EPOCH) // 1_000_000]  # type: ignore[attr-defined]
    with (path / "bag_0.mcap").open("rb") as stream:
        independent = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        summary = independent.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == count + count // 10
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 1
        for number, item in enumerate(independent.iter_decoded_messages(topics=["/joint_states"])):
            assert item.decoded_message.position[0] == angle[number]
            assert item.decoded_message.header.stamp.nanosec == times[number] % 10**9
            assert np.isnan(item.decoded_message.effort[1])


def test_nothing_is_overwritten_and_nothing_half_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_recording(tmp_path / "bag", recording(10), SIGNALS)
    with pytest.raises(InputError, match="exists already"):
        write_recording(tmp_path / "bag", recording(10), SIGNALS)

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(McapWriter, "flush", fail)
    with pytest.raises(JobError, match=r"other: cannot be written \(disk full\)"):
        write_recording(tmp_path / "other", recording(10), SIGNALS)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (SignalSource("/odd", "no.such.field"), "no message type to write no.such.field"),
        (SignalSource("/odd", "actual.positions", "azimuth"), "cannot be written, expected field position"),
    ],
)
def test_signals_that_no_known_message_holds_are_refused(source: SignalSource, said: str, tmp_path: Path) -> None:
    signals = SignalMap(SIGNALS.position, source)
    with pytest.raises(InputError, match=said):
        write_recording(tmp_path / "bag", recording(10), signals)
    assert not list(tmp_path.iterdir())


def test_own_message_types_are_those_of_msg_defs() -> None:
    for name, text in OWN_TYPES.items():
        file = ROOT / "msg_defs" / "msg" / f"{name.rpartition('/')[2]}.msg"
        lines = [line.split("#")[0].split() for line in file.read_text().splitlines()]
        assert [line for line in lines if line] == [line.split() for line in text.splitlines()], name


def test_an_empty_bag_opens(tmp_path: Path) -> None:
    times = np.zeros(0, dtype=np.int64)
    write_bag(tmp_path / "bag", [joint_states("/joint_states", times, {"azimuth": {"position": np.zeros(0)}})])
    with AnyReader([tmp_path / "bag"]) as reader:
        assert [c.topic for c in reader.connections] == ["/joint_states"]
        assert not list(reader.messages())


def record(recorder: BagRecorder, count: int, period: int = 1_000_000) -> None:
    topic = encoded("/reference", "tcs_friction_msgs/msg/AxisReference", EPOCH + np.arange(count) * period, {})
    number = recorder.add_topic(topic.channel, "")
    for stamp, raw in zip(topic.times.tolist(), topic.messages, strict=True):
        recorder.write(number, stamp, raw.tobytes())


REFERENCE = SignalMap(SignalSource("/reference", "position"), SignalSource("/reference", "velocity"))


@pytest.mark.parametrize(("size", "span", "files"), [(0, 0, 1), (0, 500_000_000, 4), (30_000, 0, 6)])
def test_recordings_split_by_time_and_size(size: int, span: int, files: int, tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / "bag", "", size, span)
    record(recorder, 2000)
    assert recorder.counts == {"/reference": 2000}
    recorder.close()
    assert recorder.counts == {"/reference": 2000}
    assert len(list((tmp_path / "bag").glob("*.mcap"))) == pytest.approx(files, abs=1 if size else 0)
    (back,) = read_recordings([tmp_path / "bag"], REFERENCE)
    assert len(back) == 2000
    assert back.notes == ("time base: header stamps of /reference",)
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 2000
        assert len(list(reader.messages())) == 2000
    with pytest.raises(InputError, match="exists already"):
        BagRecorder(tmp_path / "bag")


KILLED = """
import sys, time
from pathlib import Path
from tcs_friction.recording.record import BagRecorder
from tcs_friction.recording.encode import encoded
import numpy as np
recorder = BagRecorder(Path(sys.argv[1]), sys.argv[2])
begin = time.time_ns()
topic = encoded("/reference", "tcs_friction_msgs/msg/AxisReference", begin + np.arange(20000) * 1_000_000, {})
number = recorder.add_topic(topic.channel)
flushed = begin
for stamp, raw in zip(topic.times.tolist(), topic.messages):
    while time.time_ns() < stamp:
        time.sleep(0.0005)
    recorder.write(number, stamp, raw.tobytes())
    if stamp - flushed > 200_000_000:
        recorder.flush()
        flushed = stamp
        print(stamp - begin, flush=True)
"""


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_a_killed_recorder_leaves_everything_up_to_the_last_flush(compression: str, tmp_path: Path) -> None:
    path = tmp_path / "bag"
    command = [sys.executable, "-c", KILLED, str(path), compression]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(4)]
        time.sleep(0.05)
        os.kill(process.pid, signal.SIGKILL)
    (back,) = read_recordings([path], REFERENCE)
    assert back.duration * 1e9 >= int(lines[-1]) - 2_000_000
    assert len(back.segments) == 1
    assert "the end of the file is missing" in " ".join(back.notes)
    with next(path.glob("*.mcap")).open("rb") as stream:  # other readers that read on without a summary
        found = 0
        with contextlib.suppress(EndOfFile):
            for item in StreamReader(stream).records:
                found += isinstance(item, Message)
        assert found == len(back)


def test_definitions_are_put_together_from_installed_files() -> None:
    texts = {
        "a/msg/Top": "# comment\nstd_msgs/Header header\nInner[<=3] inner # b/No x\nint8 X=3\nstring<=5 name\nb/Far far",
        "a/msg/Inner": "float64[3] x",
        "b/msg/Far": "Inner near",
        "b/msg/Inner": "bool y",
        "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
        "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    }
    text = definition_text("a/msg/Top", texts.get)
    assert [line for line in text.splitlines() if line.startswith("MSG")] == [
        "MSG: std_msgs/Header", "MSG: a/Inner", "MSG: b/Far", "MSG: builtin_interfaces/Time", "MSG: b/Inner",
    ]  # fmt: skip
    assert definition_text("a/msg/Top", {k: v for k, v in texts.items() if k != "b/msg/Inner"}.get) == ""


def test_hash_of_a_type_is_what_ros_says() -> None:
    name = "sensor_msgs/msg/JointState"
    known = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"  # sensor_msgs 5.3.6
    assert write.type_hash(channel_of("/x", name)) == known
    assert typestore().hash_rihs01(name) == known


def test_ros1_messages_are_played_as_ros2_messages(tmp_path: Path) -> None:
    messages = samples(5)
    bag = sample_bag("bag", tmp_path / "bag", messages)
    for (_, channel, payload), sample in zip(in_log_order(Bag(bag)), messages, strict=True):
        raw = as_cdr(channel, payload)
        assert raw is not None
        message = ROS2.deserialize_cdr(raw, "sensor_msgs/msg/JointState")
        assert message.position[0] == sample.values[0]
        assert message.header.stamp.nanosec == sample.stamp % 10**9
        assert as_cdr(channel, payload[:-3]) is None


def test_playing_order_is_that_of_the_log_across_chunks_and_topics(tmp_path: Path) -> None:
    times = EPOCH + np.arange(20_000) * 1_000_000
    topics = [
        encoded("/a", "std_msgs/msg/Float64", times, {"data": np.arange(20_000.0)}),
        encoded("/b", "std_msgs/msg/Float64", times[::7] + 400_000, {"data": np.arange(len(times[::7])) * 1.0}),
    ]
    write_bag(tmp_path / "bag", topics)
    bag = Bag(tmp_path / "bag")
    order = [stamp for stamp, _, _ in in_log_order(bag)]
    assert order == sorted(np.concatenate([topic.times for topic in topics]).tolist())
    late = list(in_log_order(bag, ["/b"], EPOCH + 10 * 10**9))
    assert late[0][0] >= EPOCH + 10 * 10**9
    assert {channel.topic for _, channel, _ in late} == {"/b"}
    assert first_time(bag, ["/b"]) == EPOCH + 400_000
    assert first_time(bag, ["/c"]) == 0
