"""Bags made to hurt their reader: small files that claim, unpack to, or ask for much more than they are.

Every function writes one and returns its path; `size` says how large the claim is.
"""

from __future__ import annotations

import bz2
import os
import random
import sqlite3
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from mcap.opcode import Opcode

from tcs_friction.recording.storage import zstd
from tcs_friction.recording.write import EPOCH

TOPIC = "/joint_states"
JOINT_STATE = "sensor_msgs/msg/JointState"
MCAP = b"\x89MCAP0\r\n"
ROS1 = b"#ROSBAG V2.0\n"


def record(operation: int, content: bytes) -> bytes:
    """A record of an mcap file."""
    return struct.pack("<BQ", operation, len(content)) + content


def string(value: bytes) -> bytes:
    """A string of an mcap file."""
    return struct.pack("<I", len(value)) + value


def topic(number: int, name: str, msgtype: str, definition: str = "", encoding: str = "ros2msg") -> bytes:
    """A schema and a channel."""
    schema = struct.pack("<H", number + 1) + string(msgtype.encode()) + string(encoding.encode()) + string(definition.encode())
    channel = struct.pack("<HH", number, number + 1) + string(name.encode()) + string(b"cdr") + struct.pack("<I", 0)
    return record(Opcode.SCHEMA, schema) + record(Opcode.CHANNEL, channel)


def message(number: int, place: int, payload: bytes) -> bytes:
    """A message, a millisecond after the one before."""
    time = EPOCH + 1_000_000 * place
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, place, time, time) + payload)


def chunk(content: bytes) -> bytes:
    """A compressed chunk."""
    packed = zstd.compress(content)
    head = struct.pack("<QQQI", 0, 0, len(content), 0) + string(b"zstd") + struct.pack("<Q", len(packed))
    return record(Opcode.CHUNK, head + packed)


def mcap(path: Path, *records: bytes) -> Path:
    """A file of these records."""
    header = record(Opcode.HEADER, string(b"ros2") + string(b"hostile"))
    path = path.with_suffix(".mcap")
    path.write_bytes(MCAP + header + b"".join(records))
    return path


def joint_state(names: Sequence[str], place: int = 0) -> bytes:
    """A CDR JointState in which every position, velocity and effort is 0."""
    raw = bytearray(b"\0\1\0\0" + struct.pack("<iII", 1, place * 1000, 1) + b"\0")

    def count(number: int, size: int) -> None:
        raw.extend(bytes(-(len(raw) - 4) % 4) + struct.pack("<I", number))
        raw.extend(bytes(-(len(raw) - 4) % size))

    count(len(names), 1)
    for name in names:
        count(len(name) + 1, 1)
        raw.extend(name.encode() + b"\0")
    for _ in range(3):
        count(len(names), 8)
        raw.extend(bytes(8 * len(names)))
    return bytes(raw)


def typed(path: Path, definition: str, encoding: str = "ros2msg") -> Path:
    """Messages of a type of one's own."""
    messages = b"".join(message(0, place, b"\0\1\0\0" + bytes(64)) for place in range(20))
    return mcap(path, topic(0, TOPIC, "a/msg/A", definition, encoding), messages)


def parts(*types: tuple[str, str]) -> str:
    """A definition of several types, the first without a head."""
    rest = "".join(f"\n{'=' * 80}\nMSG: {name}\n{text}" for name, text in types[1:])
    return types[0][1] + rest


def doubling_type(path: Path, size: int) -> Path:
    """Each type holds the next twice, and the last holds nothing: 2^size fields that take no bytes."""
    inner = [(f"a/T{level}", f"a/T{level + 1} x\na/T{level + 1} y") for level in range(size)]
    return typed(path, parts(("a/A", "a/T0 x"), *inner, (f"a/T{size}", "")))


def recursive_type(path: Path, size: int) -> Path:
    """A type that holds itself, at some levels' distance."""
    inner = [(f"a/T{level}", f"a/T{(level + 1) % size} x") for level in range(size)]
    return typed(path, parts(("a/A", "a/T0 x\nfloat64 position"), *inner))


def many_fields(path: Path, size: int) -> Path:
    """One type with `size` fields."""
    return typed(path, "\n".join(f"float64 f{place}" for place in range(size)))


def long_definition(path: Path, size: int) -> Path:
    """Comments and blank lines, for which parsers take the square of their number."""
    return typed(path, "#\n\n" * size + "float64 position")


def long_annotation(path: Path, size: int) -> Path:
    """An IDL text that no parser gets far in."""
    return typed(path, "@v " * size, encoding="ros2idl")


def many_types(path: Path, size: int) -> Path:
    """A topic for each of many types, all different."""
    texts = ["\n".join(f"float64 f{n}_{k}" for k in range(50)) for n in range(size)]
    topics = [topic(n, f"/t{n}", f"a/msg/T{n}", texts[n]) for n in range(size)]
    messages = [message(n, n, b"\0\1\0\0" + bytes(400)) for n in range(size)]
    return mcap(path, chunk(b"".join([*topics, *messages])))


def many_topics(path: Path, size: int) -> Path:
    """As many channels as there are messages."""
    topics = b"".join(topic(n, f"/t{n}", JOINT_STATE) for n in range(min(size, 65535)))
    payload = joint_state(["a"])
    return mcap(path, chunk(topics), chunk(b"".join(message(n % 65535, n, payload) for n in range(size))))


def long_names(path: Path, size: int) -> Path:
    """Names of topics and types with `size` characters."""
    return mcap(path, topic(0, "/" + "n" * size, "a/msg/" + "N" * size), message(0, 0, joint_state(["a"])))


def many_joints(path: Path, size: int) -> Path:
    """Messages of many joints, whose names come in another order each time."""
    names = [f"joint_{place}" for place in range(size)]
    messages = [message(0, n, joint_state(names[n:] + names[:n], n)) for n in range(8)]
    return mcap(path, topic(0, TOPIC, JOINT_STATE), chunk(b"".join(messages)))


def long_joint(path: Path, size: int) -> Path:
    """One joint with a name of `size` characters."""
    return mcap(path, topic(0, TOPIC, JOINT_STATE), *(chunk(message(0, n, joint_state(["j" * size], n))) for n in range(3)))


def claimed_elements(path: Path, size: int) -> Path:
    """A list that says it has more elements than the file has bytes."""
    payload = b"\0\1\0\0" + struct.pack("<iIII", 1, 0, 1, 0) + struct.pack("<I", size)
    return mcap(path, topic(0, TOPIC, JOINT_STATE), *(message(0, n, payload) for n in range(20)))


def empty_elements(path: Path, size: int) -> Path:
    """Arrays of arrays of messages without a field."""
    return typed(path, parts(("a/A", f"a/B[{size}] b\nfloat64 position"), ("a/B", f"a/C[{size}] c"), ("a/C", "")))


def bomb(path: Path, size: int) -> Path:
    """Chunks of zeros: 16 MB from 1 kB, `size` times."""
    return mcap(path, topic(0, TOPIC, JOINT_STATE), chunk(bytes(1 << 24)) * size)


def message_bomb(path: Path, size: int) -> Path:
    """Tiny messages, all the same, in chunks that shrink to nothing."""
    content = chunk(message(0, 0, joint_state(["a"])) * 100_000)
    return mcap(path, topic(0, TOPIC, JOINT_STATE), content * size)


def bomb_in_bomb(path: Path, size: int) -> Path:
    """A compressed file of compressed chunks."""
    plain = bomb(path, 1000 * size)
    path = path.with_suffix(".mcap.zstd")
    path.write_bytes(zstd.compress(plain.read_bytes()))
    plain.unlink()
    return path


def varying_messages(path: Path, size: int) -> Path:
    """Messages of which no two have the same structure, in a chunk that shrinks well."""
    names = ["j" * (1 + n % 251) for n in range(997)]
    messages = [message(0, n, joint_state([names[n % 997], names[n % 601]], n)) for n in range(size)]
    return mcap(path, topic(0, TOPIC, JOINT_STATE), chunk(b"".join(messages)))


def malformed_messages(path: Path, size: int) -> Path:
    """Messages that do not fit their type, one as the other."""
    return mcap(path, topic(0, TOPIC, JOINT_STATE), chunk(message(0, 0, b"\0\1\0\0\1") * size))


def broken_runs(path: Path, size: int) -> Path:
    """A byte that is no record behind every record."""
    return mcap(path, topic(0, TOPIC, JOINT_STATE), (message(0, 0, joint_state(["a"])) + b"\xff") * size)


def cut_chunks(path: Path, size: int) -> Path:
    """Chunk heads that claim the rest of the file, one behind the other."""
    head = struct.pack("<QQQI", 0, 0, 1 << 20, 0) + string(b"zstd") + struct.pack("<Q", 1 << 40)
    return mcap(path, (struct.pack("<BQ", Opcode.CHUNK, (1 << 40) + len(head)) + head) * size)


def infinite_count(path: Path, size: int) -> Path:
    """Statistics that claim all the messages there can be."""
    statistics = record(Opcode.STATISTICS, struct.pack("<QHIIIIQQI", (1 << 64) - 1 - size, 1, 1, 0, 0, 0, 0, 0, 0))
    messages = [message(0, n, joint_state(["azimuth"], n)) for n in range(20)]
    return mcap(path, topic(0, TOPIC, JOINT_STATE), *messages, statistics)


def terminal_escapes(path: Path, _: int) -> Path:
    """Names that would clear a terminal, set its title and colour."""
    name = "\x1b[2J\x1b]0;title\x07\x1b[31m\r\u202e"
    return mcap(path, topic(0, f"/{name}", f"{name}/msg/A", f"float64 {name}"), message(0, 0, b"\0\1\0\0"))


SCHEMA = (
    "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)",
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL)",
)
FOREVER = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
HOSTILE_SCHEMAS = {
    "endless view of messages": f"CREATE VIEW messages AS {FOREVER} i AS id, 1 AS topic_id, i AS timestamp, x'' AS data FROM n",
    "endless view without rows": f"CREATE VIEW messages AS {FOREVER} i AS id, 1 AS topic_id, i AS timestamp, x'' AS data"
    " FROM n WHERE i < 0",
    "endless view of topics": f"CREATE VIEW topics AS {FOREVER} i AS id, '/t' || i AS name, 'a/msg/A' AS type,"
    " 'cdr' AS serialization_format, '' AS offered_qos_profiles FROM n",
    "endless view of definitions": f"CREATE VIEW message_definitions AS {FOREVER} 'a' AS topic_type, 'b' AS encoding,"
    " hex(zeroblob(100000)) AS encoded_message_definition FROM n",
    "computed payload": "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
    " data BLOB AS (zeroblob(100000000)))",
    "ids that are no key": "CREATE TABLE messages(id, topic_id INTEGER, timestamp INTEGER, data BLOB)",
    "virtual table": "CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data)",
}


def database(path: Path, size: int, replaced: str) -> Path:
    """A sqlite3 bag, one of whose tables is something else; `size` rows in what is ordinary."""
    path = path.with_suffix(".db3")
    with closing(sqlite3.connect(path)) as connection:
        for statement in SCHEMA:
            connection.execute(statement)
        for name in ("messages", "topics"):
            if f" {name}" in replaced.partition("AS")[0]:
                connection.execute(f"DROP TABLE {name}")
        connection.execute(replaced)
        if "VIEW topics" not in replaced:
            connection.execute("INSERT INTO topics VALUES (1, ?, ?, 'cdr', '', '')", (TOPIC, JOINT_STATE))
        times = range(EPOCH, EPOCH + size * 1_000_000, 1_000_000)
        if "data BLOB AS" in replaced:
            connection.executemany("INSERT INTO messages(topic_id, timestamp) VALUES (1, ?)", [(time,) for time in times])
        elif "VIEW messages" not in replaced:
            rows = [(n, 1, time, joint_state(["azimuth"], n)) for n, time in enumerate(times)]
            connection.executemany("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows)
        connection.commit()
    return path


def ros1_field(name: bytes, value: bytes) -> bytes:
    """A field of a ROS 1 header."""
    return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value


def ros1_record(fields: dict[bytes, bytes], data: bytes) -> bytes:
    """A record of a ROS 1 bag."""
    head = b"".join(ros1_field(name, value) for name, value in fields.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def ros1_connection(number: int, name: bytes) -> bytes:
    """A connection record of a topic."""
    inner = ros1_field(b"type", b"sensor_msgs/JointState") + ros1_field(b"message_definition", b"float64 a\n")
    return ros1_record({b"op": b"\x07", b"conn": struct.pack("<I", number), b"topic": name}, inner)


def ros1_bomb(path: Path, size: int) -> Path:
    """bz2 chunks of zeros: 32 MB from 45 bytes."""
    packed = bz2.compress(bytes(1 << 25))
    fields = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", 1 << 25)}
    return ros1(path, ros1_record(fields, packed) * size)


def ros1_connections(path: Path, size: int) -> Path:
    """More connections than any robot has topics."""
    content = b"".join(ros1_connection(n, b"/t%d" % n) for n in range(size))
    packed = bz2.compress(content)
    fields = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", len(content))}
    return ros1(path, ros1_record(fields, packed))


def ros1_marks(path: Path, size: int) -> Path:
    """What begins a chunk, over and over, and no chunk."""
    return ros1(path, b"\x04\0\0\0op=\x05" * size)


def ros1_counts(path: Path, size: int) -> Path:
    """Chunk infos that claim all the messages there can be."""
    info = ros1_record({b"op": b"\x06", b"ver": b"\1\0\0\0", b"count": b"\1\0\0\0"}, struct.pack("<II", 0, 0xFFFFFFFF))
    return ros1(path, ros1_connection(0, b"/joint_states") + info * size)


def ros1(path: Path, content: bytes) -> Path:
    """A ROS 1 bag of these records."""
    path = path.with_suffix(".bag")
    path.write_bytes(ROS1 + content)
    return path


def directory(path: Path, size: int, metadata: str) -> Path:
    """A bag directory with one good file and a metadata.yaml of one's own."""
    path.mkdir()
    messages = [message(0, n, joint_state(["azimuth"], n)) for n in range(size)]
    mcap(path / "bag_0.mcap", topic(0, TOPIC, JOINT_STATE), *messages)
    (path / "metadata.yaml").write_text(metadata)
    return path


METADATA = {
    "the folder itself": "rosbag2_bagfile_information: {relative_file_paths: [., .., /, '']}",
    "long name": f"rosbag2_bagfile_information: {{relative_file_paths: [{'n' * 5000}]}}",
    "same name": f"rosbag2_bagfile_information: {{relative_file_paths: [{'bag_0.mcap, ' * 20_000}]}}",
    "endless count": "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap], message_count: .inf}",
    "count of 5000 digits": f"rosbag2_bagfile_information: {{relative_file_paths: [bag_0.mcap], message_count: {'9' * 5000}}}",
    "sexagesimal count": f"rosbag2_bagfile_information: {{relative_file_paths: [bag_0.mcap], message_count: 1{':1' * 100_000}}}",
    "no date": "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap], message_count: 2001-99-99}",
    "levels": f"rosbag2_bagfile_information: {'[' * 50_000}",
    "aliases": "a0: &a0 [x, x]\n"
    + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))
    + "rosbag2_bagfile_information: {relative_file_paths: *a11}",
    "merges": "a0: &a0 {x: y}\n"
    + "".join(f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}\n" for n in range(1, 9))
    + "rosbag2_bagfile_information: *a8",
    "lists for names": "rosbag2_bagfile_information: {relative_file_paths: [[a], {b: c}]}",
    "null": "rosbag2_bagfile_information: {relative_file_paths: [\"a\\0b\"]}",
}


def damaged(data: bytes, chance: random.Random) -> bytes:
    """The bytes cut, flipped, overwritten, shortened or lengthened in one to three ways."""
    raw = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        if not raw:
            break
        at = chance.randrange(len(raw))
        length = min(len(raw) - at, chance.choice((1, 4, 8, 100, 5000)))
        how = chance.randrange(7)
        if how == 0:
            del raw[at:]
        elif how == 1:
            for _ in range(chance.choice((1, 1, 5, 50))):
                raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
        elif how == 2:
            raw[at : at + length] = bytes(length)
        elif how == 3:
            raw[at : at + length] = b"\xff" * length
        elif how == 4:
            del raw[at : at + length]
        elif how == 5:
            raw[at:at] = raw[at : at + length]
        else:
            raw[at : at + length] = chance.randbytes(length)
    return bytes(raw)


def good_mcap(path: Path, size: int) -> Path:
    """An ordinary file: loose messages, then a chunk of them."""
    parts = [message(0, n, joint_state(["azimuth", "elevation"], n)) for n in range(size)]
    return mcap(path, topic(0, TOPIC, JOINT_STATE), *parts[: size // 2], chunk(b"".join(parts[size // 2 :])))


def good_database(path: Path, size: int) -> Path:
    """An ordinary database."""
    return database(path, size, "CREATE TABLE more(x)")


def good_ros1(path: Path, size: int) -> Path:
    """An ordinary ROS 1 bag: a chunk as it is, then one compressed."""
    payload = struct.pack("<IIII", 0, 1, 0, 0) + struct.pack("<II", 1, 7) + b"azimuth" + 3 * (struct.pack("<I", 1) + bytes(8))
    fields = {b"op": b"\x02", b"conn": bytes(4)}
    times = [struct.pack("<II", 1 + n // 1000, n % 1000 * 10**6) for n in range(size)]
    records = [ros1_record({**fields, b"time": time}, payload) for time in times]
    content = ros1_connection(0, TOPIC.encode()) + b"".join(records)
    head = {b"op": b"\x05", b"size": struct.pack("<I", len(content))}
    chunks = ((b"none", content), (b"bz2", bz2.compress(content)))
    return ros1(path, b"".join(ros1_record({**head, b"compression": name}, packed) for name, packed in chunks))


def fifo(path: Path, _: int) -> Path:
    """A pipe into which nobody writes."""
    path = path.with_suffix(".mcap")
    os.mkfifo(path)
    return path


def device(path: Path, _: int) -> Path:
    """A device that never ends."""
    path = path.with_suffix(".db3")
    path.symlink_to("/dev/zero")
    return path


def fifo_in_directory(path: Path, _: int) -> Path:
    """A bag whose metadata is a pipe, and one of whose files is."""
    directory(path, 20, "")
    (path / "metadata.yaml").unlink()
    os.mkfifo(path / "metadata.yaml")
    os.mkfifo(path / "bag_1.mcap")
    return path


def loop(path: Path, _: int) -> Path:
    """A link to itself."""
    path.symlink_to(path)
    return path


Maker = Callable[[Path, int], Path]
CASES: dict[str, dict[Maker, tuple[int, int]]] = {
    "types": {
        doubling_type: (1, 60), recursive_type: (1, 500), many_fields: (1, 1_000_000), long_definition: (1, 200_000),
        long_annotation: (1, 50_000), many_types: (1, 2000), empty_elements: (1, 10**9), long_names: (1, 1_000_000),
        terminal_escapes: (1, 1),
    },
    "chunks": {
        bomb: (1, 500), message_bomb: (1, 200), bomb_in_bomb: (1, 20), many_topics: (1, 100_000), broken_runs: (1, 20_000),
        cut_chunks: (1, 20_000), infinite_count: (0, 1),
    },
    "messages": {
        many_joints: (1, 20_000), long_joint: (1, 10_000_000), claimed_elements: (1, 2**32 - 1),
        varying_messages: (1, 30_000), malformed_messages: (1, 1_000_000),
    },
    "ros1": {
        ros1_bomb: (1, 200), ros1_connections: (1, 100_000), ros1_marks: (1, 100_000), ros1_counts: (1, 1000),
    },
    "mcap": {good_mcap: (1, 500)},
    "sqlite3": {good_database: (1, 500), **{partial(database, replaced=text): (1, 500) for text in HOSTILE_SCHEMAS.values()}},
    "ros1 damaged": {good_ros1: (1, 500)},
    "metadata": {partial(directory, metadata=text): (1, 50) for text in METADATA.values()},
    "files": {fifo: (1, 1), device: (1, 1), fifo_in_directory: (1, 1), loop: (1, 1)},
}  # fmt: skip
"""Makers by kind, each with the least and the largest size to draw."""
