"""Damaged bags: what is whole is read and the loss stated, or one clear line; never a traceback, a hang, a flood of memory."""

from __future__ import annotations

import random
import resource
import shutil
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from recording_samples import KINDS, SIGNALS, Sample, samples, write

from benchmarks.hostile_bags import damaged
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.storage import zstd

MESSAGES = samples(300)
CHUNKED = ("mcap-zstd", "mcap-lz4", "mcap-bare")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("good")
    return {kind: write(kind, folder / kind, MESSAGES) for kind in KINDS}


def read(bag: Path) -> Recording:
    (recording,) = read_recordings([bag], SIGNALS)
    return recording


def storage(bag: Path) -> Path:
    return bag if bag.is_file() else next(path for path in bag.iterdir() if path.name != "metadata.yaml")


def copied(bag: Path, to: Path) -> Path:
    copy = to / bag.name
    if bag.is_dir():
        shutil.copytree(bag, copy)
    else:
        shutil.copy(bag, copy)
    return copy


def agrees(recording: Recording, messages: list[Sample] = MESSAGES) -> None:
    """Every sample read is one that was written."""
    true = {sample.values[0]: sample.values for sample in messages}
    for place, position in enumerate(recording.position.tolist()):
        assert recording.torque[place] == true[position][2]


@pytest.mark.parametrize("kind", ["mcap", *CHUNKED, "mcap-loose", "db3", "bag"])
def test_cut_anywhere_what_was_written_before_is_read(kind: str, good: dict[str, Path], tmp_path: Path) -> None:
    """Lengths read never shrink as the file gets longer, and every sample is right."""
    bag = copied(good[kind], tmp_path)
    data = storage(bag).read_bytes()
    lengths = []
    for share in np.linspace(0.02, 0.999, 40):
        storage(bag).write_bytes(data[: int(len(data) * share)])
        try:
            recording = read(bag)
        except InputError:
            lengths.append(0)
            continue
        agrees(recording)
        lengths.append(len(recording))
        if len(recording) < len(MESSAGES):
            assert any("lost" in note for note in recording.notes)
    assert lengths == sorted(lengths)
    assert lengths[-1] > 250
    assert lengths[len(lengths) // 2] > 0


def spoil_chunk(bag: Path, number: int) -> None:
    """Change two bytes of the content of a chunk."""
    with bag.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    data = bytearray(bag.read_bytes())
    middle = summary.chunk_indexes[number].chunk_start_offset + 9 + 44 + summary.chunk_indexes[number].compressed_size // 2
    data[middle] ^= 255
    data[middle + 1] ^= 255
    bag.write_bytes(data)


@pytest.mark.parametrize("kind", CHUNKED)
def test_a_broken_chunk_costs_only_itself(kind: str, good: dict[str, Path], tmp_path: Path) -> None:
    bag = copied(good[kind], tmp_path)
    spoil_chunk(bag, 2)
    recording = read(bag)
    agrees(recording)
    lost = len(MESSAGES) - len(recording)
    assert 0 < lost < 60
    assert f"lost: {lost} messages" in recording.notes[0]


def test_a_wrong_crc_is_no_data(good: dict[str, Path], tmp_path: Path) -> None:
    """One bit of one number flipped: without the checksum nobody would see it."""
    bag = copied(good["mcap-bare"], tmp_path)
    data = bytearray(bag.read_bytes())
    place = data.index(struct.pack("<d", MESSAGES[150].values[2]))
    data[place + 3] ^= 16
    bag.write_bytes(data)
    recording = read(bag)
    agrees(recording)
    assert MESSAGES[150].values[0] not in recording.position
    assert "a wrong CRC" in recording.notes[0]


def test_messages_left_out_at_a_broken_chunk_are_a_gap(good: dict[str, Path], tmp_path: Path) -> None:
    bag = copied(good["mcap-bare"], tmp_path)
    spoil_chunk(bag, 2)
    assert len(read(bag).segments) == 2


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("mcap-file", "db3-file", "bag-bz2", "bag-lz4")])
def test_a_mistaken_length_costs_little(kind: str, good: dict[str, Path], tmp_path: Path) -> None:
    """Eight bytes of 0xff in the middle: a record that claims more than there is."""
    bag = copied(good[kind], tmp_path)
    data = bytearray(storage(bag).read_bytes())
    data[len(data) // 2 : len(data) // 2 + 8] = b"\xff" * 8
    storage(bag).write_bytes(data)
    recording = read(bag)
    assert len(recording) > 40


def test_without_metadata_the_files_are_found(good: dict[str, Path], tmp_path: Path) -> None:
    for kind in ("mcap", "db3", "mcap-message", "db3-file"):
        bag = copied(good[kind], tmp_path)
        (bag / "metadata.yaml").unlink()
        recording = read(bag)
        assert len(recording) == len(MESSAGES)
        assert recording.notes[0] == "metadata.yaml is missing; 1 storage files found by name"
        (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: [1, {")
        assert read(bag).notes[0].startswith("mended: metadata.yaml is broken")


def test_a_lost_first_chunk_does_not_take_the_topics_along(good: dict[str, Path], tmp_path: Path) -> None:
    """The mcap library announces channels in the first chunk only; the summary repeats them."""
    bag = copied(good["mcap-zstd"], tmp_path)
    data = bytearray(bag.read_bytes())
    data[100:104] = bytes(4)
    bag.write_bytes(data)
    assert len(read(bag)) > 200


def test_a_database_in_its_write_ahead_log_is_read(good: dict[str, Path], tmp_path: Path) -> None:
    bag = copied(good["db3"], tmp_path)
    path = storage(bag)
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode = WAL")
    (row,) = connection.execute("SELECT topic_id, timestamp + 1000000, data FROM messages WHERE id = 300")
    connection.execute("DELETE FROM messages WHERE id <= 100")
    connection.commit()
    kept = tmp_path / "kept"
    shutil.copytree(bag, kept)  # as a recorder leaves it that is killed
    connection.close()
    assert (kept / f"{path.name}-wal").stat().st_size > 0
    assert row is not None
    assert len(read(kept)) == 200


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("empty.mcap", b"", "is empty (0 bytes)"),
        ("empty.db3", b"", "is empty (0 bytes)"),
        ("text.mcap", b"hello" * 100, "nothing whole in it"),
        ("text.db3", b"hello" * 100, "is no sqlite3 database"),
        ("text.log", b"hello" * 100, "begins with b'hellohel'"),
        ("lonely.bag", b"#ROSBAG V2.0\n", "nothing whole in it"),
        ("magic.mcap", b"\x89MCAP0\r\n", "nothing whole in it"),
        ("short.mcap.zstd", b"\x28\xb5\x2f\xfd\x00", "cannot be unpacked"),
    ],
)
def test_what_is_no_bag_is_one_clear_line(name: str, content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(path)
    assert said in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_directories_that_are_no_bag(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"directory without metadata.yaml"):
        read(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [a.mcap]}")
    with pytest.raises(InputError, match="none of its storage files exists"):
        read(tmp_path)


def test_an_unreadable_part_of_a_split_bag_costs_only_itself(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in range(3):
        piece = write("mcap-bare", tmp_path / f"part_{part}", MESSAGES[100 * part : 100 * part + 100])
        shutil.move(piece, folder / f"bag_{part}.mcap")
    (folder / "bag_1.mcap").write_bytes(b"")
    recording = read(folder)
    assert len(recording) == 200
    assert len(recording.segments) == 2
    assert "bag_1.mcap is empty (0 bytes)" in recording.notes[1]


def chunk(compression: bytes, packed: bytes, size: int) -> bytes:
    content = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(compression)) + compression
    content += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(content)) + content


@pytest.mark.parametrize("size", [1 << 62, 1 << 40, 1 << 30, (1 << 64) - 1])
@pytest.mark.parametrize("compression", [b"zstd", b"lz4", b""])
def test_a_claim_of_many_bytes_allocates_few(compression: bytes, size: int, tmp_path: Path) -> None:
    path = tmp_path / "claim.mcap"
    header = struct.pack("<BQ", 1, 8) + struct.pack("<II", 0, 0)
    path.write_bytes(b"\x89MCAP0\r\n" + header + chunk(compression, b"\x28\xb5\x2f\xfd" + bytes(60), size))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match="nothing whole in it"):
        read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@settings(max_examples=150, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32), everywhere=st.booleans())
def test_whatever_is_done_to_a_bag_the_end_is_a_recording_or_one_line(
    kind: str, seed: int, everywhere: bool, good: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    bag = copied(good[kind], folder)
    chance = random.Random(seed)
    paths = [bag] if bag.is_file() else sorted(bag.iterdir())
    for path in paths if everywhere else [storage(bag)]:
        path.write_bytes(damaged(path.read_bytes(), chance))
    try:
        recording = read(bag)
    except InputError:
        pass
    else:
        cut = any("the end of the file is missing" in note for note in recording.notes)
        if kind in CHUNKED and not cut:  # a chunk that is cut has no checksum left
            agrees(recording)
    finally:
        shutil.rmtree(folder)


def test_a_file_that_would_unpack_to_a_flood_is_stopped(tmp_path: Path) -> None:
    path = tmp_path / "flood.mcap.zstd"
    path.write_bytes(zstd.compress(bytes(1 << 28)))
    assert path.stat().st_size < 20_000
    with pytest.raises(InputError, match="flood"):
        read(path)
