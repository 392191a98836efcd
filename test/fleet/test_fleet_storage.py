"""Recordings and results on an object store, a real server on this machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import fsspec
import numpy as np
import pytest
import s3fs
from fleet_cases import START, recording, signals, write_axes, write_bag
from moto.server import ThreadedMotoServer

from tcs_friction.fleet.axes import read_axes
from tcs_friction.fleet.look import look_at
from tcs_friction.fleet.rows import DONE
from tcs_friction.fleet.sources import find
from tcs_friction.fleet.store import Store
from tcs_friction.fleet.work import Task, work
from tcs_friction.recording.encode import joint_states
from tcs_friction.recording.mcap_write import McapWriter
from tcs_friction.recording.write import topic_data, type_hash

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    before = dict(os.environ)
    os.environ.update(
        AWS_ACCESS_KEY_ID="key", AWS_SECRET_ACCESS_KEY="secret", AWS_ENDPOINT_URL=f"http://{host}:{port}",
        AWS_DEFAULT_REGION="us-east-1", NO_PROXY="127.0.0.1",
    )  # fmt: skip
    try:
        fsspec.filesystem("s3").mkdir("fleet")
        yield "s3://fleet"
    finally:
        os.environ.clear()
        os.environ.update(before)
        server.stop()


def test_rows_of_streamed_and_copied_recordings_equal_those_of_local_ones(bucket: str, tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/whole", "a", seconds=60.0)
    file = write_bag(tmp_path / "bags/cut", "a", 1, seconds=60.0) / "cut_0.mcap"
    file.write_bytes(file.read_bytes()[:-40])
    fsspec.filesystem("s3").put(str(tmp_path / "bags"), f"{bucket}/bags", recursive=True)
    found = find([f"{bucket}/bags"])
    assert [one.name for one in found] == ["s3://fleet/bags/cut", "s3://fleet/bags/whole"]
    for far, near in zip(found, find([str(tmp_path / "bags")]), strict=True):
        look, other = look_at(far, [axis], "key"), look_at(near, [axis], "key")
        assert (look.axes, look.starts, look.samples, look.reason) == (other.axes, other.starts, other.samples, "")
        assert look.input_hash == look_at(far, [axis], "key").input_hash
        rows = [work(Task(one, axis, "h", "v", diagnosed=False)).row for one in (far, near)]
        assert rows[0].status == DONE
        assert repr(rows[0]).replace(far.name, near.name) == repr(rows[1])


def test_chunks_without_wanted_topics_are_not_fetched(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    path = tmp_path / "big.mcap"
    size = write_beside_camera(path)
    fsspec.filesystem("s3").put(str(path), f"{bucket}/big.mcap")
    fetched = 0
    original = s3fs.core.S3File._fetch_range

    def counted(self: object, start: int, end: int) -> bytes:
        nonlocal fetched
        fetched += end - start
        return bytes(original(self, start, end))

    monkeypatch.setattr(s3fs.core.S3File, "_fetch_range", counted)
    (found,) = find([f"{bucket}/big.mcap"])
    look = look_at(found, [axis], "key")
    assert look.axes == ("a",)
    row = work(Task(found, axis, look.input_hash, "v", diagnosed=False)).row
    assert (row.status, row.duration) == (DONE, pytest.approx(19.99))
    assert path.stat().st_size > size > 8_000_000
    assert 0 < fetched < 0.1 * size


def write_beside_camera(path: Path) -> int:
    """Joint states in chunks of their own among chunks of another topic; the bytes of the others."""
    random = np.random.default_rng(0)
    one = recording()
    times = START + np.rint(one.t * 1e9).astype(np.int64)
    where = signals("a")
    columns = {source: getattr(one, name) for name, source in where.named() if name != "temperature"}
    states = topic_data("/a/joint_states", times, columns)
    names = [f"j{k}" for k in range(300)]
    values = {name: {"position": random.standard_normal(len(times))} for name in names}
    camera = joint_states("/camera", times, values)
    warm = topic_data("/a/temperature", times, {where.temperature: one.temperature})
    size = 0
    with McapWriter(path, "") as writer:
        numbers = [writer.add_channel(topic.channel, type_hash(topic.channel)) for topic in (states, camera, warm)]
        for start in range(0, len(times), 100):
            part = slice(start, start + 100)
            for number, topic in zip(numbers, (states, camera, warm), strict=True):
                writer.write_chunk([number], [times[part]], [topic.messages[part]])
            size += camera.messages[part].nbytes
    return size


def test_results_may_lie_there_too(bucket: str, tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    write_bag(tmp_path / "bags/one", "a")
    (found,) = find([str(tmp_path / "bags")])
    row = work(Task(found, axis, "h", "v", diagnosed=False)).row
    store = Store(f"{bucket}/out")
    store.write(row)
    (kept,) = store.kept()
    assert repr(store.row(kept)) == repr(row)
    store.settle([])
    store.keep_look(look_at(found, [axis], "key"))
    store.write_looks()
    again = Store(f"{bucket}/out")
    assert again.look(found.look) is not None
    assert len(again.kept()) == 1
    again.settle(again.kept())
    assert again.kept() == []


@pytest.mark.parametrize("damage", ["cut", "scrambled", "no parquet"])
def test_a_file_of_rows_that_cannot_be_read_is_set_aside_and_its_recordings_are_open(damage: str, tmp_path: Path) -> None:
    (axis,) = read_axes(write_axes(tmp_path, ["a"]))
    store = Store(str(tmp_path / "out"))
    for number in range(2):
        write_bag(tmp_path / f"bags/bag{number}", "a", number, seconds=20.0)
    for one in find([str(tmp_path / "bags")]):
        store.write(work(Task(one, axis, one.hash(), "v", diagnosed=False)).row)
    bad, _ = sorted((tmp_path / "out" / "rows").rglob("*.parquet"))
    whole = bad.read_bytes()
    scrambled = whole[:4] + bytes(byte ^ 0x5A for byte in whole[4 : len(whole) // 2]) + whole[len(whole) // 2 :]
    bad.write_bytes({"cut": whole[:-100], "scrambled": scrambled, "no parquet": b"x" * 999}[damage])
    again = Store(str(tmp_path / "out"))
    kept = again.kept()
    again.settle(())
    assert len(kept) == 1 or damage == "scrambled"  # its keys may be whole
    assert [note.split(": ")[0] for note in again.notes] == [str(bad)]
    assert not bad.exists()
    assert bad.with_name(f"{bad.name}.unreadable").is_file()
    assert len(again.kept()) == 1
