"""Bags made to hurt their reader: the end is a recording or one line, and little memory was taken.

On a reader without limits most of these run until the test's time limit or until the memory is full.
"""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
from recording_samples import SIGNALS, samples, write

from benchmarks import hostile_bags as hostile
from tcs_friction import cli
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.info import bag_info

MEMORY = 500_000  # kB


def told(bag: Path) -> tuple[str, str]:
    """What `bag info` and a command say of a bag: notes and findings, or the one line; memory stays small."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said = []
    for read in (bag_info, lambda path: read_recordings([path], SIGNALS)[0]):
        try:
            result = read(bag)
        except InputError as error:
            said.append(str(error))
        else:
            findings = [finding for topic in getattr(result, "topics", ()) for finding in topic.findings]
            said.append("; ".join(["read", *result.notes, *findings]))
        assert "\n" not in said[-1]
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY
    return said[0], said[1]


@pytest.mark.parametrize(
    ("make", "size", "info", "command"),
    [
        (hostile.doubling_type, 60, "more than 10000 fields", "more than 10000 fields"),
        (hostile.doubling_type, 5, "read", "no number position"),
        (hostile.recursive_type, 1, "holds itself", "holds itself"),
        (hostile.recursive_type, 500, "holds itself", "holds itself"),
        (hostile.many_fields, 10_001, "cannot be parsed: it has", "cannot be parsed"),
        (hostile.long_definition, 200_000, "at most 65536 are read", "at most 65536"),
        (hostile.long_annotation, 30_000, "at most 65536 are read", "at most 65536"),
        (hostile.many_types, 400, "takes more work than", "no topic /joint_states"),
        (hostile.empty_elements, 10**9, "read", "position is one number"),
        (hostile.long_names, 1_000_000, "longer than 256 characters", "longer than 256"),
        (hostile.bomb, 60, "impossible size (56 times)", "no message on"),
        (hostile.message_bomb, 60, "impossible size (", "no joint"),
        (hostile.bomb_in_bomb, 1, "impossible size (997 times)", "no message on"),
        (hostile.many_topics, 3000, "messages whose channel is unknown", "no topic /joint_states"),
        (hostile.broken_runs, 2000, "the end of the file is missing", "no joint"),
        (hostile.cut_chunks, 2000, "nothing whole in it", "nothing whole in it"),
        (hostile.many_joints, 20_000, "read", "no joint"),
        (hostile.many_joints, 40_000, "read", "no message on"),
        (hostile.long_joint, 2_000_000, "read", "no message on"),
        (hostile.claimed_elements, 2**32 - 1, "read", "no message on"),
        (hostile.malformed_messages, 300_000, "takes more work than", "takes more work than"),
        (hostile.varying_messages, 200, "read", "no joint"),
        (hostile.ros1_bomb, 40, "impossible size (38 times)", "nothing whole in it"),
        (hostile.ros1_connections, 3000, "read", "no topic"),
        (hostile.ros1_marks, 10_000, "nothing whole in it", "nothing whole in it"),
        (hostile.ros1_counts, 3, "read", "no message"),
        (hostile.fifo, 0, "is no regular file", "is no regular file"),
        (hostile.device, 0, "is no regular file", "is no regular file"),
        (hostile.loop, 0, "does not exist", "does not exist"),
    ],
)
def test_what_a_file_costs_does_not_depend_on_what_it_claims(
    make: hostile.Maker, size: int, info: str, command: str, tmp_path: Path
) -> None:
    said = told(make(tmp_path / "bag", size))
    assert info in said[0]
    assert command in said[1]


@pytest.mark.parametrize("name", hostile.HOSTILE_SCHEMAS)
def test_a_database_is_only_read_never_run(name: str, tmp_path: Path) -> None:
    info, command = told(hostile.database(tmp_path / "bag", 50, hostile.HOSTILE_SCHEMAS[name]))
    if name == "endless view of definitions":  # the standard type serves
        assert info == "read"
        assert command.startswith("read")
    else:
        assert "its topics cannot be read: " in info
        assert "its topics cannot be read: " in command


def test_rows_may_not_claim_one_another_s_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What rows hold together is counted; a database in which they overlap would give far more than the file has."""
    monkeypatch.setattr("tcs_friction.recording.allowance.EXPANSION", 0)
    monkeypatch.setattr("tcs_friction.recording.allowance.FREE_BYTES", 5000)
    bag = hostile.good_database(tmp_path / "bag", 100)
    assert "rows that claim more than the file holds" in told(bag)[1]


@pytest.mark.parametrize("name", hostile.METADATA)
def test_metadata_cannot_lead_astray(name: str, tmp_path: Path) -> None:
    """The one good file is read, once; nothing else is touched."""
    bag = hostile.directory(tmp_path / "bag", 20, hostile.METADATA[name])
    assert told(bag)[1].startswith("read")
    assert len(read_recordings([bag], SIGNALS)[0]) == 20


def test_pipes_in_a_bag_are_passed_over(tmp_path: Path) -> None:
    assert "metadata.yaml is broken (is no regular file" in told(hostile.fifo_in_directory(tmp_path / "bag", 0))[1]


def test_a_count_beyond_what_the_file_can_hold_is_no_loss(tmp_path: Path) -> None:
    assert "18446744073709551" not in told(hostile.infinite_count(tmp_path / "bag", 0))[1]


def test_terminal_escapes_are_shown_and_not_obeyed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = hostile.terminal_escapes(tmp_path / "bag", 0)
    assert cli.main(["bag", "info", str(bag)]) == 0
    printed = capsys.readouterr()
    assert "/\\x1b[2J\\x1b]0;title\\x07\\x1b[31m\\r\\u202e" in printed.out
    with pytest.raises(InputError) as caught:
        read_recordings([bag], SIGNALS)
    for text in (printed.out, printed.err, str(caught.value)):
        assert all(character.isprintable() or character == "\n" for character in text)


@pytest.mark.parametrize("kind", ["mcap-zstd", "db3", "bag", "mcap-message", "mcap-file"])
def test_the_limits_are_far_from_what_recordings_need(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of what is free is enough for ordinary bags of every kind, and is not used up by reading them twice."""
    monkeypatch.setattr("tcs_friction.recording.allowance.FREE_BYTES", 1 << 22)
    monkeypatch.setattr("tcs_friction.recording.allowance.FREE_STEPS", 200_000)
    bag = write(kind, tmp_path / kind, samples(2000))
    for _ in range(2):
        assert len(read_recordings([bag], SIGNALS)[0]) == 2000
        assert bag_info(bag).count == 2000
