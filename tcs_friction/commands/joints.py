"""`--joint all`: a command for each joint of a recording, in a folder of its own, and one page over all."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tcs_friction.errors import JobError, TcsError, printable, writing_into

ALL = "all"
PLAIN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,99}")
"""A name that a folder may have everywhere."""


@dataclass(frozen=True)
class Done:
    """What a command did for one joint, or for the only one.

    text: for people. content: for machines. sentence: what was found, for the page over all. link: file to look at, in the
    command's output. failure: what is told after everything is written, None where there is a result.
    """

    text: str
    content: Mapping[str, Any]
    sentence: str
    link: str
    failure: TcsError | None = None


def tell(arguments: argparse.Namespace, done: Done) -> None:
    """Print what was done. Raises its failure."""
    print(json.dumps(done.content, allow_nan=False) if arguments.json else done.text)
    if done.failure is not None:
        raise done.failure


def for_each(
    arguments: argparse.Namespace,
    title: str,
    bags: Sequence[Path],
    joints: Sequence[str],
    one: Callable[[argparse.Namespace, Path], Done],
) -> None:
    """Run `one` with each joint and its folder; what is refused for one is a row of the page. Raises JobError if any was."""
    # imports what draws, which takes a second and is not there everywhere
    from tcs_friction.report.joints import JointRow, write_joints

    rows: list[JointRow] = []
    contents: dict[str, Any] = {}
    failures: list[str] = []
    for joint, folder in zip(joints, folders(joints), strict=True):
        print(f"tcs-friction: joint {printable(joint)}", file=sys.stderr)
        given = argparse.Namespace(**{**vars(arguments), "joint": joint})
        failure: TcsError | None
        try:
            done = one(given, arguments.output / folder)
        except TcsError as error:
            row, content, failure = JointRow(joint, str(error), False), {"refused": str(error)}, error
        else:
            failure = done.failure
            found = done.sentence if failure is None else f"{done.sentence}; {failure}"
            row, content = JointRow(joint, found, failure is None, f"{folder}/{done.link}"), dict(done.content)
            if not arguments.json:
                print(done.text)
        rows.append(row)
        contents[joint] = content
        if failure is not None:
            failures.append(f"{joint}: {failure}")
    with writing_into(arguments.output):
        page = write_joints(arguments.output, title, [str(bag) for bag in bags], rows)
    print(json.dumps({"joints": contents, "page": str(page)}, allow_nan=False) if arguments.json else page)
    if failures:
        raise JobError(str(bags[0]), f"{len(failures)} of {len(rows)} joints without a result, the first: {failures[0]}")


def folders(joints: Sequence[str]) -> Iterator[str]:
    """A folder for each joint: its name, where a folder may have it, else its number."""
    taken: set[str] = set()
    for number, joint in enumerate(joints):
        name = joint if PLAIN.fullmatch(joint) and joint.lower() not in taken else f"joint_{number}"
        while name.lower() in taken or (name != joint and name in joints):
            name += "_"
        taken.add(name.lower())
        yield name
