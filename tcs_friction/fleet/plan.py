"""What is to be done for each recording of a run: pieces to work on, or rows of what cannot be."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata

from tcs_friction.errors import InputError
from tcs_friction.fleet.axes import FleetAxis, fingerprint
from tcs_friction.fleet.look import Look
from tcs_friction.fleet.rows import Row
from tcs_friction.fleet.sources import Found
from tcs_friction.fleet.work import Task, unassigned
from tcs_friction.recording.pieces import Span, spans

MOST_SAMPLES = 600_000
"""Samples of a piece; a longer recording is worked on in several."""

Identity = tuple[str, str, int]
"""Hash of the input, version, piece: what is equal in two rows that say the same."""


@dataclass(frozen=True)
class Plan:
    """What a run shall do. where: the file of the axes. retry: also what failed before. samples: most of a piece."""

    axes: tuple[FleetAxis, ...]
    where: str
    retry: bool = False
    diagnosed: bool = True
    samples: int = MOST_SAMPLES

    @cached_property
    def axes_key(self) -> str:
        """Changes with anything that says which axis a recording is of."""
        return fingerprint(self.axes)

    def version(self, axis: FleetAxis | None) -> str:
        """Of this package, and a hash of what decides about the rows of an axis, or of recordings of none."""
        decides = f"{axis.decides if axis else self.axes_key} {self.diagnosed} {self.samples}"
        return f"{package_version()}+{hashlib.sha256(decides.encode()).hexdigest()[:12]}"


def package_version() -> str:
    """Of tcs_friction."""
    try:
        return metadata.version("tcs_friction")
    except metadata.PackageNotFoundError:
        return "unknown"


Job = Task | Row
"""A piece to work on, or the row of a recording that cannot be worked on."""


def recording_of(job: Job) -> str:
    """The recording's name."""
    return job.recording if isinstance(job, Row) else job.found.name


def identity_of(job: Job) -> Identity:
    """What the row of a job is known by."""
    return job.input_hash, job.version, job.piece


def jobs(found: Sequence[Found], looks: Mapping[str, Look], plan: Plan) -> list[Job]:
    """All of a run, in the order of the recordings; a bag of a whole mount is a recording of each of its axes.

    Raises InputError when two axes claim the same signals of a recording, or an axis none.
    """
    check(looks.values(), plan)
    axes = {axis.name: axis for axis in plan.axes}
    result: list[Job] = []
    for one in found:
        look = looks[one.name]
        if not look.axes:
            result.append(unassigned(one.name, look.input_hash, plan.version(None), look.reason))
            continue
        for name, start, samples in zip(look.axes, look.starts, look.samples, strict=True):
            axis = axes[name]
            cuts: tuple[Span | None, ...] = spans(samples, plan.samples)
            cuts = (None,) if len(cuts) == 1 else cuts
            result.extend(
                Task(one, axis, look.input_hash, plan.version(axis), piece, span, start, plan.diagnosed)
                for piece, span in enumerate(cuts)
            )
    return result


def check(looks: Iterable[Look], plan: Plan) -> None:
    """Raises InputError when two axes claim the same position of a recording, or an axis claims none."""
    met: set[str] = set()
    claims = {axis.name: axis.signals.position for axis in plan.axes}
    count = 0
    for look in looks:
        count += 1
        met.update(look.axes)
        pairs = itertools.combinations(look.axes, 2)
        rivals = next((two for two in pairs if look.table or claims[two[0]] == claims[two[1]]), ())
        if rivals:
            found = f"axes {' and '.join(rivals)} both match"
            raise InputError(look.name, found, f"one: topic, joint, path, from or to in {plan.where} tell them apart")
    for axis in plan.axes:
        if axis.name not in met:
            recordings = f"{count} recordings" if count != 1 else "1 recording"
            found = f"axis {axis.name} matches none of {recordings}"
            raise InputError(plan.where, found, "signals, topic, joint, path and dates that fit one")
