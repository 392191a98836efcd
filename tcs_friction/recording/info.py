"""What is in a bag: topics, types, rates, gaps, and which signals of an axis it could hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcs_friction.errors import InputError, printable
from tcs_friction.recording import clock
from tcs_friction.recording.allowance import Allowance
from tcs_friction.recording.bags import Bag, read_columns
from tcs_friction.recording.columns import Nanoseconds
from tcs_friction.recording.decode import Batch, Blocks, Decoder
from tcs_friction.recording.definitions import Channel
from tcs_friction.recording.propose import Proposal, proposed_signals
from tcs_friction.recording.recording import Column
from tcs_friction.recording.signals import SignalSource
from tcs_friction.yaml_files import dump_yaml

SECOND = 1e-9


@dataclass(frozen=True)
class TopicInfo:
    """One topic. Times in s; `rate` in Hz is 1 over the usual period, 0 if there are too few messages.

    stamps: `header` or `log`, where the times come from. latency: median of log time minus header stamp, or None.
    gaps: pauses longer than clock.GAP_PERIODS usual periods. findings: what else is odd, in words.
    """

    topic: str
    type: str
    count: int
    duration: float
    rate: float
    stamps: str
    latency: float | None
    gaps: int
    longest_gap: float
    missing: int
    findings: tuple[str, ...]


@dataclass(frozen=True)
class BagInfo:
    """A bag. start: s since the epoch of the first message logged. notes: damage, in words. signals: a proposal for an axis file.

    joints: those that the proposed position may be of, in the order of its topic.
    """

    path: str
    start: float
    duration: float
    count: int
    topics: tuple[TopicInfo, ...]
    notes: tuple[str, ...]
    signals: dict[str, Any]
    joints: tuple[str, ...] = ()

    def to_mapping(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class _Topic:
    """Times and stamps of one topic while batches come in, and its first message."""

    def __init__(self, channel: Channel, first: bytes, bag: str, allowance: Allowance) -> None:
        self.channel = channel
        self.first = first
        self.log_times, self.stamps = Blocks(np.int64), Blocks(np.int64)
        self.findings: list[str] = []
        self.decoder: Decoder | None = None
        self.spoilt = 0
        try:
            self.decoder = Decoder(channel, [], bag, allowance)
        except InputError as error:
            self.findings.append(error.found)

    def add(self, batch: Batch) -> None:
        good: Any = slice(None)
        if self.decoder is not None and self.decoder.stamp is not None:
            _, _, stamps, fits = self.decoder.decode(batch)
            good = np.flatnonzero(fits)
            self.spoilt += len(batch) - len(good)
            assert stamps is not None
            self.stamps.add(stamps[good])
        self.log_times.add(batch.log_times[good])


def bag_info(path: Path) -> BagInfo:
    """Read a bag once from end to end. Raises InputError if it is none or holds nothing whole."""
    bag = Bag(path)
    topics: dict[str, _Topic] = {}
    for batch in bag.batches():
        if len(batch):
            name = batch.channel.topic
            if name not in topics:
                topics[name] = _Topic(batch.channel, batch.payload(0), str(path), bag.allowance)
            topics[name].add(batch)
    readable = {topic.channel: topic.first for topic in topics.values() if topic.decoder is not None}
    proposal = proposed_signals(readable, bag.allowance)
    signals = _with_torque(proposal, path)
    infos: list[TopicInfo] = []
    first, last = [], []
    for name in sorted(topics):
        log_times = topics[name].log_times.joined()
        infos.append(_topic_info(topics[name], log_times))
        if len(log_times):
            first.append(int(log_times.min()))
            last.append(int(log_times.max()))
    silent = {c.topic: c for c in bag.channels if c.topic not in topics}
    infos += [TopicInfo(n, silent[n].msgtype, 0, 0.0, 0.0, "log", None, 0, 0.0, 0, ()) for n in sorted(silent)]
    start, end = min(first, default=0), max(last, default=0)
    count = sum(info.count for info in infos)
    begin, duration = start * SECOND, (end - start) * SECOND
    return BagInfo(str(path), begin, duration, count, tuple(infos), tuple(bag.notes), signals, proposal.joints)


def _with_torque(proposal: Proposal, path: Path) -> dict[str, Any]:
    """The proposal with the component of a wrench that varies most, where nothing else is a torque or that never changes."""
    block = proposal.signals
    if not proposal.wrenches or "position" not in block:
        return block
    entry = block.get("torque")
    own = [SignalSource(entry["topic"], entry["field"], entry.get("joint"))] if entry else []
    try:
        columns, _ = read_columns(Bag(path), [*own, *proposal.wrenches])
    except InputError:
        return block
    varies = {one: _variance(columns[one.topic].values[one]) for one in (*own, *proposal.wrenches)}
    if own and varies[own[0]] > 0.0:
        return block
    chosen = max(proposal.wrenches, key=lambda one: varies[one])
    return block | {"torque": {"topic": chosen.topic, "field": chosen.field}} if varies[chosen] > 0.0 else block


def _variance(values: Column) -> float:
    fine = values[np.isfinite(values)]
    return float(np.var(fine)) if len(fine) else 0.0


def _topic_info(topic: _Topic, log_times: Nanoseconds) -> TopicInfo:
    findings = list(topic.findings)
    if topic.spoilt:
        findings.append(f"{topic.spoilt} messages do not fit their type")
    stamps = topic.stamps.joined()
    times, own, source, latency = log_times, log_times, "log", None
    empty = clock.empty_stamps(stamps)
    if empty:
        findings.append(f"{empty} header stamps are empty")
    if len(stamps) and 2 * empty < len(stamps):
        good = stamps > 0 if empty else slice(None)
        times, own, source = stamps[good], log_times[good], "header"
        latency = float(np.median(own - times)) * SECOND
    line = clock.timeline(times, own)
    findings.extend(line.notes)
    steps = np.diff(line.times)
    wide = steps[steps > clock.gap_limit(line.times)]
    period = clock.usual_period(line.times)
    duration = float(line.times[-1] - line.times[0]) * SECOND if len(line.times) else 0.0
    return TopicInfo(
        topic.channel.topic, topic.channel.msgtype, len(log_times), duration, 1e9 / period if period else 0.0, source,
        latency, len(wide), float(wide.max()) * SECOND if len(wide) else 0.0, clock.dropped(line.times), tuple(findings),
    )  # fmt: skip


def info_text(info: BagInfo, looked_at: Sequence[str] = ()) -> str:
    """A bag's contents for people; looked_at: what reading its signals found."""
    lines = [f"{info.path}: {info.count} messages, {info.duration:.6g} s"]
    lines += [f"  {note}" for note in info.notes]
    width = max((len(topic.topic) for topic in info.topics), default=0)
    kind = max((len(topic.type) for topic in info.topics), default=0)
    lines += [_topic_line(topic, width, kind) for topic in info.topics]
    lines += ["", *looked_at] if looked_at else []
    if info.signals:
        lines += ["", "# proposal for the axis file; check it, above all the torque's scale"]
        lines.append(dump_yaml({"signals": info.signals}, 120, None).rstrip())
    else:
        lines += ["", "# nothing here looks like position and torque of an axis"]
    return "\n".join(printable(part) for line in lines for part in line.split("\n"))


def _topic_line(topic: TopicInfo, width: int, kind: int) -> str:
    line = f"  {topic.topic:{width}}  {topic.type:{kind}}  {topic.count:>9}  {topic.rate:8.4g} Hz  {topic.stamps} time"
    odd = list(topic.findings)
    if topic.latency is not None and abs(topic.latency) > 1e-6:
        odd.append(f"latency {topic.latency:.3g} s")
    if topic.gaps:
        odd.append(f"gaps: {topic.gaps}, longest {topic.longest_gap:.3g} s")
    if topic.missing:
        odd.append(f"missing: {topic.missing}")
    return f"{line}; {'; '.join(odd)}" if odd else line
