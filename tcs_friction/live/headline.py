"""How the axis is, in one line that can be taken in at a glance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tcs_friction.nodes.page.state import Condition, Job, Switches

WELL, WARNING, WRONG = "well", "warning", "wrong"
LOST_AFTER = 2.0  # s without a joint state
SILENT_AFTER = 4.0  # s without a report; nodes report every second
MONITOR = "monitor"
"""The node whose words come first: a change of physics must not be cut off behind what busy nodes say."""
WAITING = "waiting: "
"""How the report of a node begins that stands still on purpose."""
MODES = {
    "plain": "friction is not compensated",
    "measure": "friction is being measured",
    "compensate": "friction is compensated",
    "mixed": "the switches are set one by one",
    "": "the switches are not known",
}


@dataclass(frozen=True)
class Headline:
    """One of WELL, WARNING and WRONG, what it is in a word or two, and the sentence."""

    level: str
    state: str
    sentence: str


@dataclass(frozen=True)
class Situation:
    """All that the headline depends on. Times are steady, s.

    heard: when the newest joint state came, -1 for never. error: RMS tracking error with its unit, "" while there is none.
    """

    now: float
    heard: float
    conditions: Mapping[str, Condition]
    switches: Switches
    job: Job
    error: str


def headline(at: Situation) -> Headline:
    """The worst comes first: a lost graph, an axis that stands still, a node in trouble, a warning."""
    reporting = {name: c for name, c in at.conditions.items() if at.now - c.at <= SILENT_AFTER}
    age = at.now - at.heard
    wrong = _said(reporting, 2)
    if at.heard < 0.0 and not reporting:
        return Headline(WRONG, "No graph", "Nothing has been heard of the axis yet: is its graph running?")
    if not reporting and age > LOST_AFTER:
        return Headline(WRONG, "Graph lost", f"Nothing has been heard for {age:.0f} s. The curves are what was heard last.")
    if at.heard < 0.0 or age > LOST_AFTER:
        since = "yet" if at.heard < 0.0 else f"for {age:.0f} s"
        waits = [f"{name}: {c.message}" for name, c in sorted(reporting.items()) if c.message.startswith(WAITING)]
        if waits and not wrong:
            return Headline(WARNING, "Standing still", f"No joint states {since}, on purpose. {'; '.join(waits)}")
        return Headline(WRONG, "Standing still", f"No joint states {since}. {wrong or _said(reporting, 1)}".rstrip())
    if wrong:
        return Headline(WRONG, "Trouble", wrong)
    silent = sorted(set(at.conditions) - set(reporting))
    if silent:
        return Headline(WRONG, "Node lost", f"{', '.join(silent)} {'has' if len(silent) == 1 else 'have'} not reported any more.")
    running = _running(at)
    warned = _said(reporting, 1)
    if warned:
        return Headline(WARNING, "Running with warnings", warned)
    return Headline(WELL, "Well", running)


def _running(at: Situation) -> str:
    """What goes on while all is well."""
    words = MODES.get(at.switches.mode, MODES[""])
    error = f"Tracking error {at.error} rms over the last 5 s; " if at.error else ""
    job = f" {at.job.name}: {at.job.stage} ({at.job.progress:.0%})." if at.job.running else ""
    sentence = f"{error}{words}.{job}"
    return sentence[0].upper() + sentence[1:]


def _said(conditions: Mapping[str, Condition], level: int) -> str:
    """What the nodes of one level say."""
    ordered = sorted(conditions, key=lambda name: (name != MONITOR, name))
    names = [name for name in ordered if min(conditions[name].level, 2) == level]
    return "; ".join(f"{name}: {conditions[name].message}" for name in names)
