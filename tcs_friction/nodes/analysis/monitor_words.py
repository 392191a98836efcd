"""What the monitor says on /diagnostics."""

from __future__ import annotations

import time

from tcs_friction.control.stamps import SECOND
from tcs_friction.monitor.finding import Finding
from tcs_friction.monitor.watch import Watch

A_DATE = 1_000_000_000
"""s from which on a stamp is a date; before, it is the time of a simulation."""


LEAST_CHANCE = 1e-15
"""What the residual's distribution is like farther out than that nobody knows."""


def said(found: Finding, stamp: int, clock: float) -> str:
    """A change in one line: what, where, since when, with what certainty. `stamp` (ns) is that of `clock` (s) on the watch."""
    since = stamp / SECOND - (clock - found.since)
    others = f"; {' and '.join(found.others)} show it as well" if found.others else ""
    return f"physics changed: {found.sentence}, since {moment(since)}, {certainty(found.chance)}{others}"


def moment(seconds: float) -> str:
    """A stamp in words."""
    if seconds < A_DATE:
        return f"{seconds:.1f} s"
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def certainty(chance: float) -> str:
    """How sure a change is, given the bound on the probability that chance alone does as much."""
    return f"by chance with a probability of {max(chance, LEAST_CHANCE):.1g} at most"


def counted(watch: Watch) -> dict[str, str]:
    """Values of a report: phase, evidence by coordinate, what it speaks for."""
    values = {f"evidence, {name} [log10]": f"{value:.2f}" for name, value in watch.evidence_by_coordinate().items()}
    values["evidence over an alarm's [log10]"] = f"{watch.over_alarm:.2f}"
    values["motion learned from [s]"] = f"{watch.learned_time:.0f} of {watch.config.learning_time:g}"
    values["motion like what was learned [%]"] = f"{100.0 * watch.judged_share:.0f}"
    found = watch.told
    values["phase"] = "learning" if watch.is_learning else "watching" if found is None else "changed"
    if found is not None and watch.strongest is not None:
        strongest = watch.strongest
        values |= {
            "what changed": strongest.sentence,
            "where": f"{strongest.coordinate} {strongest.where}".strip(),
            "chance of a false alarm": f"{max(strongest.chance, LEAST_CHANCE):.1g} at most",
        }
    return values
