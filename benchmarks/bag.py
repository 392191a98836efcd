"""Reading an hour of JointState at 1 kHz: this package beside rosbags' AnyReader and mcap-ros2-support.

    python -m benchmarks.bag [--seconds 3600] [--full] [--compression zstd] [--json]

All three give the same columns (stamp, position, velocity, effort of one joint), which is checked. The slow readers read the
first tenth and are scaled up, unless --full. Every reader runs in a process of its own, whose peak memory is
counted from after its imports; this package's includes its compiled kernels.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


def ours(bag: Path, limit: int | None) -> Columns:
    """This package."""
    sources = {kind: SignalSource(TOPIC, kind, JOINT) for kind in FIELDS}
    columns, _ = read_columns(Bag(bag), list(sources.values()))
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


READERS: dict[str, Callable[[Path, int | None], Columns]] = {
    "tcs_friction": ours,
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
    np.savez(out, seconds=seconds, peak=peak, size=sum(column.nbytes for column in columns.values()), **columns)


def _memory(what: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(what):
            return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def run(seconds: float = 3600.0, full: bool = False, compression: str = "zstd") -> dict[str, Any]:
    """Make the bag, read it with every reader, compare. Raises AssertionError if columns differ."""
    count = int(seconds * RATE)
    results: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        bag, small = Path(folder, "bag"), Path(folder, "small")
        make_bag(bag, seconds, compression)
        make_bag(small, 1.0, compression)
        reference: Any = None
        rates: dict[str, float] = {}
        for name in READERS:
            limit = None if full or name == "tcs_friction" else count // SHARE
            out = os.path.join(folder, "out.npz")
            process = multiprocessing.get_context("spawn").Process(target=_measure, args=(name, bag, small, limit, out))
            process.start()
            process.join()
            if process.exitcode:
                raise RuntimeError(f"{name} ended with {process.exitcode}")
            with np.load(out) as measured:
                found = {key: measured[key] for key in measured.files}
            reference = reference or found
            for key in ("stamp", *FIELDS):
                assert np.array_equal(found[key], reference[key][: limit or count]), f"{name}: {key} differs"
            rates[name] = len(found["stamp"]) / float(found["seconds"])
            results.append({"name": f"{name}: rate", "value": rates[name], "unit": "messages/s"})
            results.append({"name": f"{name}: seconds for {count} messages" + ("" if limit is None else " (scaled)"),
                            "value": count / rates[name], "unit": "s"})  # fmt: skip
            if name == "tcs_friction":
                ratio = float(found["peak"] / found["size"])
                results.append({"name": "peak memory over size of columns", "value": ratio, "unit": "1", "beside": 3.0})
    beside = max(rate for name, rate in rates.items() if name != "tcs_friction")
    results[0] |= {"beside": beside, "ratio": rates["tcs_friction"] / beside}
    machine = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()}
    return {"benchmark": "bag", "results": results, "machine": machine}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--full", action="store_true", help="let the slow readers read everything")
    parser.add_argument("--compression", choices=("", "lz4", "zstd"), default="zstd")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = run(arguments.seconds, arguments.full, arguments.compression)
    if arguments.json:
        print(json.dumps(result))
        return
    for row in result["results"]:
        ratio = f"  ({row['ratio']:.1f} times the fastest other)" if "ratio" in row else ""
        print(f"{row['name']:60} {row['value']:14.4g} {row['unit']}{ratio}")


if __name__ == "__main__":
    main()
