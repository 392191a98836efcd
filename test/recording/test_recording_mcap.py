"""What mcap allows, or people do with its files: chunks in any order, files one behind the other, bytes behind the end."""

from __future__ import annotations

import io
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_samples import SIGNALS, Sample, samples, write

from tcs_friction.recording.bags import Bag, read_recordings
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.kernels import HEAD
from tcs_friction.recording.mcap_index import IndexedBag, NoIndexError
from tcs_friction.recording.mcap_read import CHUNK, MESSAGE_INDEX
from tcs_friction.recording.recording import Recording


def read(path: Path) -> Recording:
    (recording,) = read_recordings([path], SIGNALS)
    return recording


def is_whole(recording: Recording, messages: list[Sample]) -> None:
    assert np.array_equal(recording.position, [one.values[0] for one in messages])
    assert np.array_equal(recording.torque, [one.values[2] for one in messages])
    assert len(recording.segments) == 1


def in_another_order(path: Path, order: str) -> None:
    """The chunks of a file, each with its indexes, in another order; where the summary lies does not change."""
    data = path.read_bytes()
    at, head, tail, chunks = 8, b"", b"", []
    while at < len(data) - 8:
        operation, length = struct.unpack_from("<BQ", data, at)
        record = data[at : at + HEAD + length]
        if operation == CHUNK:
            chunks.append(record)
        elif operation == MESSAGE_INDEX:
            chunks[-1] += record
        elif chunks:
            tail += record
        else:
            head += record
        at += len(record)
    assert len(chunks) > 4
    number = list(range(len(chunks)))
    if order == "swapped":
        number[1], number[2] = 2, 1
    else:
        number.reverse()
    path.write_bytes(data[:8] + head + b"".join(chunks[k] for k in number) + tail + data[-8:])


@pytest.mark.parametrize("kind", ["mcap-zstd", "mcap-lz4", "mcap-bare"])
@pytest.mark.parametrize("order", ["swapped", "reversed"])
def test_chunks_in_another_order_are_sorted(kind: str, order: str, tmp_path: Path) -> None:
    messages = samples(1000)
    path = write(kind, tmp_path / "bag", messages)
    in_another_order(path, order)
    found = read(path)
    is_whole(found, messages)
    assert any("stand in another order than they were logged in, sorted" in note for note in found.notes)
    (topic,) = bag_info(path).topics
    assert topic.gaps == topic.missing == 0
    assert topic.duration == pytest.approx(0.999)


@pytest.mark.parametrize("kind", ["mcap-zstd", "mcap-loose"])
def test_files_one_behind_the_other_are_all_read(kind: str, tmp_path: Path) -> None:
    """The numbers of topics are each file's own: in the second the joints stand the other way round."""
    messages = samples(900)
    parts = [messages[:300], [replace(one, names=("elevation", "azimuth")) for one in messages[300:600]], messages[600:]]
    files = [write(kind, tmp_path / f"part{k}", part) for k, part in enumerate(parts)]
    path = tmp_path / "cat.mcap"
    path.write_bytes(b"".join(file.read_bytes() for file in files))
    found = read(path)
    is_whole(found, messages)
    assert found.notes[0] == "mended: cat.mcap: 3 mcap files one behind the other, all read"
    with pytest.raises(NoIndexError):
        IndexedBag(str(path), [(str(path), io.BytesIO(path.read_bytes()), path.stat().st_size)])


@pytest.mark.parametrize("behind", [bytes(5000), b"\x89MCAP0\r\n", b"something else" * 300])
def test_bytes_behind_the_end_are_told(behind: bytes, tmp_path: Path) -> None:
    messages = samples(300)
    path = write("mcap-zstd", tmp_path / "bag", messages)
    path.write_bytes(path.read_bytes() + behind)
    found = read(path)
    is_whole(found, messages)
    assert f"bytes behind the end of the file, not read; lost: {len(behind)} bytes" in found.notes[0]


def test_a_second_file_that_is_cut_costs_what_comes_after_the_cut(tmp_path: Path) -> None:
    messages = samples(600)
    files = [write("mcap-zstd", tmp_path / f"part{k}", messages[300 * k : 300 * k + 300]) for k in range(2)]
    path = tmp_path / "cat.mcap"
    second = files[1].read_bytes()
    path.write_bytes(files[0].read_bytes() + second[: len(second) // 2])
    found = read(path)
    assert 300 < len(found) < 600
    assert "mended: cat.mcap: 2 mcap files one behind the other, all read" in found.notes
    assert any("the end of the file is missing" in note for note in found.notes)
    assert {channel.topic for channel in _channels(path)} == {"/joint_states"}


def _channels(path: Path) -> set[Channel]:
    bag = Bag(path)
    for _ in bag.batches():
        pass
    return set(bag.channels)
