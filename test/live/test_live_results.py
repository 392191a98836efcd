"""What is listed and handed out lies below the results directory, whatever is asked for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tcs_friction.live import results as module
from tcs_friction.live.results import Results, contents_of


@pytest.fixture
def results(tmp_path: Path) -> Results:
    root = tmp_path / "results"
    (root / "first/plots").mkdir(parents=True)
    (root / "first/report.html").write_text("report")
    (root / "first/identification.json").write_text("{}")
    (root / "second").mkdir()
    (root / "second/identification.json").write_text("{}")
    (root / "first/bag").mkdir()
    (root / "first/bag/metadata.yaml").write_text("no bag")
    (root / "first/bag/report.html").write_text("inside a bag")
    (root / "first/notes.sh").write_text("#!/bin/sh")
    (tmp_path / "secret.html").write_text("secret")
    return Results(root)


def test_reports_recordings_and_identifications_are_listed_newest_first(results: Results) -> None:
    os.utime(results.root / "first/report.html", (1e9, 1e9))
    listed = results.listed()
    assert {(entry["path"], entry["kind"]) for entry in listed} == {
        ("first/report.html", "report"),
        ("second/identification.json", "identification"),
        ("first/bag", "recording"),
    }
    assert listed[-1]["path"] == "first/report.html"
    assert listed[-1]["bytes"] == 6


def test_a_directory_that_is_not_there_yet_lists_nothing(tmp_path: Path) -> None:
    assert Results(tmp_path / "later").listed() == []


def test_the_walk_does_not_go_on_for_ever(results: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = results.root / "a/b/c/d/e/f"
    deep.mkdir(parents=True)
    (deep / "report.html").write_text("too deep")
    (results.root / "loop").symlink_to(results.root)
    assert len(results.listed()) == 3
    monkeypatch.setattr(module, "MOST_ENTRIES", 0)
    assert Results(results.root).listed() == []


def test_files_below_are_handed_out_with_their_type(results: Results) -> None:
    assert results.file("first/report.html") == ((results.root / "first/report.html").resolve(), "text/html; charset=utf-8")
    assert results.file("first/identification.json")[1] == "application/json"


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../secret.html", "first/../../secret.html", "/etc/passwd", "//etc/passwd", "first", "first/notes.sh",
     "x\0.html", "link.html", "linked/secret.html", "missing.html", "a" * 300 + ".html", "loop.html"],
)  # fmt: skip
def test_nothing_else_is_handed_out(results: Results, name: str, tmp_path: Path) -> None:
    (results.root / "link.html").symlink_to(tmp_path / "secret.html")
    (results.root / "linked").symlink_to(tmp_path)
    (results.root / "loop.html").symlink_to(results.root / "loop.html")
    assert results.file(name) is None
    assert results.recording(name) is None


def test_a_large_file_is_not_handed_out(results: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LARGEST", 5)
    assert results.file("first/report.html") is None


def test_a_recording_with_a_link_to_elsewhere_is_not_looked_into(results: Results, tmp_path: Path) -> None:
    assert results.recording("first/bag") is not None
    (results.root / "first/bag/data.mcap").symlink_to(tmp_path / "secret.html")
    assert results.recording("first/bag") is None


def test_what_is_no_bag_is_said_in_words(results: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = results.root / "first/bag"
    assert "metadata.yaml" in contents_of(bag)
    monkeypatch.setattr(module, "LARGEST_BAG", 1)
    assert "./tcs bag info" in contents_of(bag)
