"""JSON files by anybody: what is wrong with one is said in one line that names the place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tcs_friction import json_files
from tcs_friction.errors import InputError
from tcs_friction.json_files import Json, load_json

KIND, WHAT = "test/1", "a file of the test"
GOOD = {"schema": KIND, "list": [{"std": 0.5}], "name": "a"}


def load(path: Path, content: bytes | str) -> Json:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_json(path, WHAT, KIND)


def test_values_are_found_by_their_way(tmp_path: Path) -> None:
    content = load(tmp_path / "a.json", json.dumps(GOOD))
    assert content.at("list").entries()[0].at("std").number(0.0) == 0.5
    assert content.at("name").text() == "a"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "is no JSON"),
        (b"\xff\xfe\x00", "is no JSON"),
        ("[1]", "has no schema, expected a file of the test (test/1)"),
        ("{}", "has no schema"),
        (json.dumps({"schema": "other/2"}), "has the schema 'other/2', expected a file of the test (test/1)"),
        ('{"schema": "test/1", "x": NaN}', "is no JSON (NaN is no number of JSON)"),
        ("[" * 100_000, "nests too deep"),
    ],
)
def test_files_that_are_none_are_refused_in_one_line(content: bytes | str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path / "a.json", content)
    assert str(caught.value).startswith(f"{tmp_path / 'a.json'}: {expected}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("path", "expected"), [("nowhere.json", "no such file"), (".", "is a directory"), ("a\0b", "null byte")])
def test_what_cannot_be_read_says_why(path: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        load_json(Path(path), WHAT, KIND)


def test_a_large_file_is_read_up_to_the_limit(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(json_files, "LARGEST", 1 << 10)
    with pytest.raises(InputError, match="is too large"):
        load(tmp_path / "a.json", " " * 1025)
    with pytest.raises(InputError, match="is no regular file"):
        load_json(Path("/dev/zero"), WHAT, KIND)


@pytest.mark.parametrize(
    ("value", "look", "expected"),
    [
        ({"a": 1}, lambda one: one.at("b"), "file: b is missing"),
        ([], lambda one: one.at("b"), r"file: \[\], expected a mapping"),
        ({"a": 1}, lambda one: one.at("a").entries(), "file: a: 1, expected a list"),
        ([1], lambda one: one.entries()[0].text(), r"file\[0\]: 1, expected a text"),
        ("x" * 99, lambda one: one.number(), "file: 'x+ ..., expected a finite number"),
        (None, lambda one: one.number(), "file: None, expected a finite number"),
        (True, lambda one: one.number(), "file: True, expected a finite number"),
        (-0.1, lambda one: one.number(0.0), "file: -0.1, expected a number from 0"),
        (1.5, lambda one: one.number(-1.0, 1.0), "file: 1.5, expected a number from -1 to 1"),
        (0.0, lambda one: one.above(0.0), "file: 0.0, expected a number above 0"),
        (float("nan"), lambda one: one.above(0.0), "file: nan, expected a number above 0"),
        ("1", lambda one: one.above(0.0), "file: '1', expected a number above 0"),
        (float("inf"), lambda one: one.number(0.0), "file: inf, expected a number from 0"),
    ],
)
def test_a_value_of_another_kind_is_refused_where_it_stands(value: object, look: object, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        look(Json(value, "file"))  # type: ignore[operator]


def test_numbers_beyond_a_double_are_no_finite_ones(tmp_path: Path) -> None:
    content = load(tmp_path / "a.json", f'{{"schema": "test/1", "a": {"9" * 5000}, "b": 1e999, "c": {"9" * 320}}}')
    for name in "abc":
        with pytest.raises(InputError, match="expected a finite number"):
            content.at(name).number()
