"""A run over a fleet: look at each recording, work on what is not done yet, keep the rows."""

from __future__ import annotations

import itertools
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from distributed import Client, Future, as_completed
from distributed.scheduler import KilledWorker
from fsspec.core import url_to_fs

from tcs_friction.errors import JobError
from tcs_friction.fleet.axes import FleetAxis
from tcs_friction.fleet.cluster import capacity
from tcs_friction.fleet.look import Look, look_at
from tcs_friction.fleet.plan import Identity, Job, Plan, identity_of, jobs, recording_of
from tcs_friction.fleet.rows import DONE, FAILED, Row
from tcs_friction.fleet.sources import Found
from tcs_friction.fleet.store import Kept, Store
from tcs_friction.fleet.work import Result, Task, failed, work

AHEAD = 2
"""Tasks that the scheduler has for each thread: one at work, one waiting. The rest wait here, so that millions are no matter."""

COUNTED_AGAIN = 5.0
"""Seconds after which the threads of the workers are counted again; some may have come or gone."""

DIED = "its worker process ended each time, perhaps for want of memory"

In = TypeVar("In")
Out = TypeVar("Out")
Progress = Callable[[str, int, int, int], None]
"""Told of what is over: stage, how many, of how many, failed."""


@dataclass
class Summary:
    """What a run did, in pieces of recordings: done before, done now, failed of both.

    seconds, busy: of all processes together, by the clock and of the processor.
    memory: of each process after each of its pieces, bytes.
    """

    recordings: int = 0
    before: int = 0
    now: int = 0
    failed: int = 0
    seconds: float = 0.0
    busy: float = 0.0
    memory: dict[int, list[int]] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)

    def add(self, row: Row | Kept, reason: str | None) -> None:
        """Count a row that failed or not."""
        if row.status == FAILED:
            self.failed += 1
            self.reasons.append(f"{row.recording}: {reason}")


def run(client: Client, found: Sequence[Found], plan: Plan, store: Store, progress: Progress) -> Summary:
    """Do what is to be done; each row is kept as soon as it is there.

    Raises InputError when two axes claim one signal, or an axis none; JobError when the scheduler goes away.
    """
    summary = Summary(len(found))
    todo = jobs(found, _looks(client, found, plan, store, progress), plan)
    left = _not_done(todo, plan, store, summary)
    try:
        _work(client, left, len(todo), store, summary, progress)
    except JobError as error:
        counted = f"{summary.before + summary.now} of {len(todo)} are done and kept"
        raise JobError(error.where, f"{error.found}; {counted}, the same command goes on from there") from None
    store.settle(_superseded(todo, store.kept()))
    return summary


def _looks(client: Client, found: Sequence[Found], plan: Plan, store: Store, progress: Progress) -> dict[str, Look]:
    """A look at each recording; what was seen before and is unchanged is not read again."""
    looks: dict[str, Look] = {}
    unseen: list[tuple[Found, tuple[FleetAxis, ...], str, str]] = []
    for one in found:
        known = store.look(one.look)
        if known is not None and known.axes_key == plan.axes_key and not (known.reason and plan.retry):
            looks[one.name] = known
        else:
            known_hash = known.input_hash if known is not None and not known.reason else ""
            unseen.append((one, plan.axes, plan.axes_key, known_hash))
    for _, look in spread(client, _look, unseen, lambda item: _unseen(item[0], plan)):
        looks[look.name] = look
        store.keep_look(look)
        progress("looking", len(looks), len(found), 0)
    if unseen:
        store.write_looks()
    return looks


def _look(item: tuple[Found, tuple[FleetAxis, ...], str, str]) -> Look:
    return look_at(*item)


def _unseen(found: Found, plan: Plan) -> Look:
    return Look(found.name, found.look, plan.axes_key, f"unread-{found.look[:32]}", reason=DIED)


def _not_done(todo: Sequence[Job], plan: Plan, store: Store, summary: Summary) -> list[Task]:
    """The pieces that have no row yet; recordings that cannot be worked on get theirs here."""
    by_name: dict[tuple[str, Identity], Kept] = {}
    by_content: dict[Identity, Kept] = {}
    for kept in store.kept():
        if kept.status == DONE or not plan.retry:
            by_name[kept.recording, kept.identity] = by_content[kept.identity] = kept
    left: list[Task] = []
    for job in todo:
        name, identity = recording_of(job), identity_of(job)
        known = by_name.get((name, identity))
        if known is None and (other := by_content.get(identity)) is not None and (row := store.row(other)) is not None:
            store.write(replace(row, recording=name))  # the same content under another name
            known = other
        if known is not None:
            summary.before += 1
            summary.add(known, "failed before")
        elif isinstance(job, Row):
            store.write(job)
            summary.now += 1
            summary.add(job, job.reason)
        else:
            left.append(job)
    return left


def _work(client: Client, left: Sequence[Task], total: int, store: Store, summary: Summary, progress: Progress) -> None:
    progress("working", total - len(left), total, summary.failed)
    for _, result in spread(client, work, left, lambda task: Result(failed(task, DIED), 0.0, 0.0, 0, 0)):
        store.write(result.row)
        summary.now += 1
        summary.add(result.row, result.row.reason)
        summary.seconds += result.seconds
        summary.busy += result.busy
        summary.memory.setdefault(result.process, []).append(result.memory)
        progress("working", summary.before + summary.now, total, summary.failed)


def _superseded(todo: Sequence[Job], kept: Sequence[Kept]) -> list[Kept]:
    """Rows of this run's recordings that are of an older content, version or cut; and of files that have moved away."""
    current = {(recording_of(job), identity_of(job)) for job in todo}
    names, contents = {name for name, _ in current}, {identity for _, identity in current}
    return [
        row
        for row in kept
        if (row.recording, row.identity) not in current
        and (row.recording in names or (row.identity in contents and not _there(row.recording)))
    ]


def _there(name: str) -> bool:
    try:
        fs, path = url_to_fs(name)
        return bool(fs.exists(path))
    except Exception:  # nobody can say
        return True


def spread(
    client: Client, function: Callable[[In], Out], items: Iterable[In], died: Callable[[In], Out]
) -> Iterator[tuple[In, Out]]:
    """Results of a function as workers finish them, never many ahead. died: in place of what a worker's end has taken along.

    Raises JobError when the scheduler goes away, or workers cannot run the function.
    """
    left, finished = iter(items), as_completed(loop=client.loop)
    at_work: dict[str, In] = {}
    room, counted = AHEAD * _capacity(client), time.monotonic()

    def more() -> None:
        for item in itertools.islice(left, max(0, room - len(at_work))):
            future = client.submit(function, item, key=f"{function.__name__}-{uuid.uuid4().hex}", pure=False)
            at_work[future.key] = item
            finished.add(future)

    more()
    while at_work:
        future = next(finished)
        item = at_work.pop(future.key)
        yield item, _outcome(client, future, item, died)
        if time.monotonic() - counted > COUNTED_AGAIN:
            room, counted = AHEAD * _capacity(client), time.monotonic()
        more()


def _capacity(client: Client) -> int:
    try:
        return capacity(client)
    except (OSError, TimeoutError):
        raise _gone(client) from None


def _gone(client: Client) -> JobError:
    return JobError(_where(client), "the scheduler has gone")


def _where(client: Client) -> str:
    return str(getattr(client.scheduler, "address", None) or "scheduler")


def _outcome(client: Client, future: Future, item: In, died: Callable[[In], Out]) -> Out:
    if future.status == "finished":
        value: Out = future.result()
        return value
    if future.status == "cancelled":
        raise _gone(client)
    error = future.exception()
    if isinstance(error, KilledWorker):
        return died(item)
    said = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    raise JobError(_where(client), f"its workers cannot do this work ({said})")
