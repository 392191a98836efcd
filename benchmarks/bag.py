"""Reading an hour of JointState at 1 kHz: this package beside rosbags' AnyReader and mcap-ros2-support.

All three give the same columns (stamp, position, velocity, effort of one joint), which is checked. The slow readers read the
first tenth and are scaled up, unless --full. Every reader runs in a process of its own, whose peak memory is
counted from after its imports; this package's includes its compiled kernels.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.children import deaf, ended_with_this
from tcs_friction.errors import JobError
from tcs_friction.recording.bags import Bag, read_columns
from tcs_friction.recording.encode import joint_states
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.write import EPOCH, write_bag

RATE = 1000
TOPIC = "/joint_states"
JOINT = "azimuth"
FIELDS = ("position", "velocity", "effort")
SHARE = 10  # the slow readers read one part in so many

Columns = dict[str, NDArray[Any]]


def make_bag(path: Path, seconds: float, compression: str) -> None:
    """A bag of two joints moving with noise."""
    random = np.random.default_rng(0)
    count = int(seconds * RATE)
    times = EPOCH + np.arange(count, dtype=np.int64) * (10**9 // RATE)
    angle = 0.3 * np.sin(times * 1e-9 % 1000.0)
    joints = {
        name: {kind: angle + 1e-6 * random.standard_normal(count) for kind in FIELDS} for name in ("elevation", JOINT)
    }
    write_bag(path, [joint_states(TOPIC, times, joints)], compression)


def ours(bag: Path, _: int | None) -> Columns:
    """This package."""
    sources = {kind: SignalSource(TOPIC, kind, JOINT) for kind in FIELDS}
    columns, _notes = read_columns(Bag(bag), list(sources.values()))
    found = columns[TOPIC]
    assert found.stamps is not None
    return {"stamp": found.stamps, **{kind: found.values[source] for kind, source in sources.items()}}


def any_reader(bag: Path, limit: int | None) -> Columns:
    """rosbags' AnyReader with deserialize."""
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        return _message_by_message(
            (reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()), limit
        )


def mcap_ros2(bag: Path, limit: int | None) -> Columns:
    """mcap with mcap-ros2-support."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with next(bag.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return _message_by_message((item.decoded_message for item in reader.iter_decoded_messages()), limit)


def _message_by_message(messages: Any, limit: int | None) -> Columns:
    rows: dict[str, list[Any]] = {name: [] for name in ("stamp", *FIELDS)}
    for number, message in enumerate(messages):
        if number == limit:
            break
        index = list(message.name).index(JOINT)
        rows["stamp"].append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        for kind in FIELDS:
            rows[kind].append(getattr(message, kind)[index])
    return {name: np.array(values) for name, values in rows.items()}


OURS = "tcs_friction"
READERS: dict[str, Callable[[Path, int | None], Columns]] = {
    OURS: ours,
    "rosbags AnyReader": any_reader,
    "mcap-ros2-support": mcap_ros2,
}


def _measure(name: str, bag: Path, small: Path, limit: int | None, out: str) -> None:
    """In a process of its own: warm up on a small bag, then read, and leave columns, time and memory in `out`."""
    READERS[name](small, None)
    before = _memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    begin = time.perf_counter()
    columns = READERS[name](bag, limit)
    seconds = time.perf_counter() - begin
    peak = _memory("VmHWM") - before
    size = sum(column.nbytes for column in columns.values())
    measured: Columns = {"seconds": np.array(seconds), "peak": np.array(peak), "size": np.array(size), **columns}
    np.savez(out, allow_pickle=False, **measured)


def _memory(what: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(what):
            return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--seconds", type=float, default=3600.0, help="length of the recording")
    parser.add_argument("--full", action="store_true", help="let the slow readers read everything")
    parser.add_argument("--compression", choices=("none", "lz4", "zstd"), default="zstd", help="of the chunks")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: rate and seconds of every reader, peak memory of ours. Raises AssertionError if columns differ."""
    count = int(arguments.seconds * RATE)
    compression = "" if arguments.compression == "none" else arguments.compression
    with tempfile.TemporaryDirectory() as folder:
        bag, small = Path(folder, "bag"), Path(folder, "small")
        make_bag(bag, arguments.seconds, compression)
        make_bag(small, 1.0, compression)
        limits = {name: None if arguments.full or name == OURS else count // SHARE for name in READERS}
        found = {name: _in_own_process(name, bag, small, limit, folder) for name, limit in limits.items()}
    for name, columns in found.items():
        for key in ("stamp", *FIELDS):
            assert len(columns[key]) == (limits[name] or count), f"{name}: messages missing"
            assert np.array_equal(columns[key], found[OURS][key][: len(columns[key])]), f"{name}: {key} differs"
    rates = {name: len(columns["stamp"]) / float(columns["seconds"]) for name, columns in found.items()}
    fastest = max(rate for name, rate in rates.items() if name != OURS)
    memory = float(found[OURS]["peak"] / found[OURS]["size"])
    rows: list[dict[str, Any]] = [
        {"name": f"{OURS} beside the fastest other", "value": rates[OURS], "unit": "messages/s", "beside": fastest,
         "ratio": rates[OURS] / fastest},
        {"name": "peak memory over the columns' size (bar: 3)", "value": memory, "unit": "1"},
    ]  # fmt: skip
    for name, rate in rates.items():
        how = "" if limits[name] is None else f", from {limits[name]}"
        rows.append({"name": f"{name}: {count} messages{how}", "value": count / rate, "unit": "s"})
    return rows


def _in_own_process(name: str, bag: Path, small: Path, limit: int | None, folder: str) -> dict[str, Any]:
    out = os.path.join(folder, "out.npz")
    process = multiprocessing.get_context("spawn").Process(target=_measure, args=(name, bag, small, limit, out))
    with deaf():
        process.start()
    with ended_with_this():
        process.join()
    if process.exitcode:
        raise JobError(f"bench bag: {name}", f"ended with status {process.exitcode}", "mcap and mcap-ros2-support installed")
    with np.load(out) as measured:
        return {key: measured[key] for key in measured.files}
