"""Bulk decoding against rosbags' own deserialisation, for random messages of types with everything in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.decode import Batch, Decoder
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.layout import MalformedError, layout
from tcs_friction.recording.signals import SignalSource
from tcs_friction.recording.targets import Target

MIX = """
bool flag
string text
int64 big
Leaf[2] pair
Leaf[] leaves
uint8 small
float64[] numbers
string[] words
float32 single
uint16[3] three
std_msgs/Header header
int32 last
"""
LEAF = "int8 tiny\nfloat64 value\nstring label"

TYPES = get_types_from_msg(MIX, "t/msg/Mix") | get_types_from_msg(LEAF, "t/msg/Leaf")


def make_store(kind: Stores) -> Any:
    store = get_typestore(kind)
    store.register(TYPES)
    return store


STORES = {"cdr": make_store(Stores.ROS2_JAZZY), "ros1": make_store(Stores.ROS1_NOETIC)}
TEXT = st.text(st.characters(max_codepoint=0x2FF, exclude_characters="\0", exclude_categories=("Cs",)), max_size=6)
FLOAT = st.floats(width=32)

LEAVES = st.tuples(st.integers(-128, 127), FLOAT, TEXT)
MESSAGES = st.fixed_dictionaries(
    {
        "flag": st.booleans(),
        "text": TEXT,
        "big": st.integers(-(2**53), 2**53),
        "pair": st.tuples(LEAVES, LEAVES),
        "leaves": st.lists(LEAVES, max_size=3),
        "small": st.integers(0, 255),
        "numbers": st.lists(FLOAT, max_size=4),
        "words": st.lists(TEXT, max_size=3),
        "single": FLOAT,
        "three": st.tuples(*[st.integers(0, 65535)] * 3),
        "seconds": st.integers(0, 2**31 - 1),
        "last": st.integers(-(2**31), 2**31 - 1),
    }
)
FIELDS = (
    "flag", "big", "pair[0].tiny", "pair[1].value", "leaves[1].value", "small", "numbers[2]", "single", "three[1]", "last",
)  # fmt: skip


def build(store: Any, values: dict[str, Any]) -> Any:
    types = store.types

    def leaf(item: tuple[int, float, str]) -> Any:
        return types["t/msg/Leaf"](*item)

    stamp = types["builtin_interfaces/msg/Time"](sec=values["seconds"], nanosec=7)
    extra = {"seq": 3} if _has_seq(store) else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="f", **extra)
    return types["t/msg/Mix"](
        flag=values["flag"], text=values["text"], big=values["big"], pair=[leaf(v) for v in values["pair"]],
        leaves=[leaf(v) for v in values["leaves"]], small=values["small"],
        numbers=np.array(values["numbers"], dtype=np.float64), words=values["words"], single=values["single"],
        three=np.array(values["three"], dtype=np.uint16), header=header, last=values["last"],
    )  # fmt: skip


def _has_seq(store: Any) -> bool:
    return any(name == "seq" for name, _ in store.fielddefs["std_msgs/msg/Header"][1])


def expected(values: dict[str, Any], path: str) -> float | None:
    found: Any = {**values}
    for step in SignalSource("", path).steps:
        if isinstance(step, int):
            if step >= len(found):
                return None
            found = found[step]
        else:
            found = found[step] if isinstance(found, dict) else found[("tiny", "value", "label").index(step)]
    return float(found)


def serialised(encoding: str, values: dict[str, Any]) -> bytes:
    store = STORES[encoding]
    message = build(store, values)
    write = store.serialize_cdr if encoding == "cdr" else store.serialize_ros1
    return bytes(write(message, "t/msg/Mix"))


ROOM = Allowance("bag", 1 << 20)


def channel(encoding: str) -> Channel:
    definition, _ = STORES[encoding].generate_msgdef("t/msg/Mix", ros_version=2 if encoding == "cdr" else 1)
    return Channel("/mix", "t/msg/Mix" if encoding == "cdr" else "t/Mix", encoding, definition)


def batch_of(raws: list[bytes], encoding: str) -> Batch:
    lengths = np.array([len(raw) for raw in raws], dtype=np.int64)
    return Batch(
        channel(encoding), np.frombuffer(b"".join(raws), np.uint8), np.arange(len(raws)), np.cumsum(lengths) - lengths, lengths
    )


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@settings(max_examples=60, deadline=None)
@given(messages=st.lists(MESSAGES, min_size=1, max_size=12))
def test_bulk_columns_are_the_fields_of_each_message(encoding: str, messages: list[dict[str, Any]]) -> None:
    batch = batch_of([serialised(encoding, values) for values in messages], encoding)
    decoder = Decoder(batch.channel, [SignalSource("/mix", path) for path in FIELDS], "bag", ROOM)
    values, absent, stamps, good = decoder.decode(batch)
    assert good.all()
    assert stamps is not None
    assert stamps.tolist() == [message["seconds"] * 10**9 + 7 for message in messages]
    for row, path in enumerate(FIELDS):
        for place, message in enumerate(messages):
            true = expected(message, path)
            assert absent[row, place] == (true is None)
            assert np.array_equal(values[row, place], np.nan if true is None else true, equal_nan=True)


def test_big_endian_messages_decode() -> None:
    store = STORES["cdr"]
    values: dict[str, Any] = {
        "flag": True, "text": "abc", "big": 2**40, "pair": ((1, 2.0, ""), (3, 4.0, "x")), "leaves": [], "small": 9,
        "numbers": [1.5, 2.5, 3.5], "words": ["a"], "single": 0.25, "three": (1, 2, 3), "seconds": 5, "last": -6,
    }  # fmt: skip
    raw = bytes(store.serialize_cdr(build(store, values), "t/msg/Mix", little_endian=False))
    decoder = Decoder(channel("cdr"), [SignalSource("/mix", path) for path in FIELDS], "bag", ROOM)
    columns, _, stamps, _ = decoder.decode(batch_of([raw, raw], "cdr"))
    assert [None if np.isnan(v) else v for v in columns[:, 1]] == [expected(values, path) for path in FIELDS]
    assert stamps is not None
    assert stamps[0] == 5_000_000_007


def test_definitions_in_idl_are_understood() -> None:
    text = "=" * 80 + "\nIDL: a/msg/B\nmodule a { module msg { struct B { sequence<double> list; long last; }; }; };\n"
    raw = b"\0\1\0\0" + np.array([2, 0], "<u4").tobytes() + np.array([1.5, 2.5]).tobytes() + np.array([9], "<i4").tobytes()
    batch = batch_of([raw], "cdr")
    idl = Channel("/b", "a/msg/B", "cdr", text, "ros2idl")
    values, _, stamps, good = Decoder(idl, [SignalSource("/b", "list[1]"), SignalSource("/b", "last")], "bag", ROOM).decode(batch)
    assert good.all()
    assert stamps is None
    assert values[:, 0].tolist() == [2.5, 9.0]


def test_messages_that_do_not_fit_are_marked_and_the_rest_decoded() -> None:
    good = serialised("cdr", {
        "flag": False, "text": "", "big": 1, "pair": ((1, 2.0, ""), (3, 4.0, "")), "leaves": [], "small": 0,
        "numbers": [], "words": [], "single": 0.0, "three": (0, 0, 0), "seconds": 1, "last": 7,
    })  # fmt: skip
    raws = [good[:10], good, b"", good, b"\x00\x03\x00\x00" + good[4:], good[:-2]]
    decoder = Decoder(channel("cdr"), [SignalSource("/mix", "last")], "bag", ROOM)
    values, _, _, fits = decoder.decode(batch_of(raws, "cdr"))
    assert fits.tolist() == [False, True, False, True, False, False]
    assert values[0, fits].tolist() == [7.0, 7.0]


def test_a_claim_of_more_elements_than_bytes_is_refused_at_once() -> None:
    types = {"a/msg/A": (("list", STORES["cdr"].fielddefs["t/msg/Mix"][1][6][1]),)}
    with pytest.raises(MalformedError, match="claims 4294967295 elements"):
        layout(b"\x00\x01\x00\x00\xff\xff\xff\xff" + bytes(64), types, "a/msg/A", False, [Target(("list", 0))], None, ROOM)
