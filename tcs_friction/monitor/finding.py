"""What has changed where, since when and with what certainty, in words of an engineer."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from tcs_friction.monitor.bank import BINS, COORDINATES, LINEAR, SPEED_BANDS, WINDOW, described, frequencies
from tcs_friction.monitor.baseline import Baseline
from tcs_friction.monitor.evidence import LOOKS, Evidence, combined
from tcs_friction.physics.axis import Axis

PREFERRED = ("direction", "speed", "position", "order", "frequency", "time")
"""Which coordinate is named where several speak as clearly: friction changes more often than the torque everywhere does."""
AS_CLEAR = math.log(10.0)  # of the evidence
PERIODIC = ("order", "frequency")


@dataclass(frozen=True)
class Finding:
    """A change.

    coordinate: where it shows most, one of COORDINATES. what: a phrase. low, high: where along the coordinate, in `unit`; NaN:
    everywhere. size: of the change in `size_unit`, with its sign; of periodic torques and vibrations the amplitude.
    since: s on the watch's clock, when it began to show. evidence: common logarithm of the e-value. chance: bound on the
    probability that evidence as large comes by chance in as long a watch. others: coordinates that speak as clearly.
    """

    coordinate: str
    what: str
    low: float
    high: float
    unit: str
    size: float
    size_unit: str
    since: float
    evidence: float
    chance: float
    others: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """The place along the coordinate in words, "" for everywhere."""
        if math.isnan(self.low):
            return ""
        if self.coordinate in PERIODIC:
            return f"at {0.5 * (self.low + self.high):.4g} {self.unit}, give or take {0.5 * (self.high - self.low):.2g}"
        return f"at {self.low:.4g} to {self.high:.4g} {self.unit}"

    @property
    def sentence(self) -> str:
        """What changed, where and by how much."""
        if self.coordinate in PERIODIC:
            return f"{self.what} of {self.size:.3g} {self.size_unit} {self.where}"
        way = "grew" if self.size > 0.0 else "fell"
        return " ".join(filter(None, (self.what, self.where, way, f"by {abs(self.size):.3g} {self.size_unit}")))


def finding(base: Baseline, evidence: Evidence, axis: Axis) -> Finding:
    """The change that the evidence speaks for most, whether or not it is an alarm."""
    clearest = _clearest(base, evidence)
    clear = [name for name in PREFERRED if clearest[name] >= max(clearest.values()) - AS_CLEAR]
    coordinate = COORDINATES.index(clear[0])
    total = float(combined(evidence.logs)) / math.log(10.0)
    chance = min(1.0, max(float(evidence.status[LOOKS]), 1.0) * 10.0**-total)
    certainty = (total, chance, tuple(clear[1:]))
    return _line(evidence, axis, certainty) if coordinate == LINEAR else _linear(base, evidence, axis, coordinate, certainty)


def _clearest(base: Baseline, evidence: Evidence) -> dict[str, float]:
    """Logarithm of the evidence of the clearest test of each coordinate: what is named needs no bound on false alarms."""
    starts = (0, *base.known.ends)
    found = [float(evidence.grown[a:b].max()) for a, b in itertools.pairwise(starts)]
    return dict(zip(COORDINATES, [*found, float(evidence.line_grown.max())], strict=True))


def _linear(
    base: Baseline, evidence: Evidence, axis: Axis, coordinate: int, certainty: tuple[float, float, tuple[str, ...]]
) -> Finding:
    """What the clearest test of a coordinate says; friction in a place rather than torque, where both are as clear."""
    first = int(base.known.ends[coordinate - 1]) if coordinate else 0
    grown = evidence.grown[first : int(base.known.ends[coordinate])]
    at, sign, size = (int(i) for i in np.unravel_index(int(np.argmax(grown)), grown.shape))
    if COORDINATES[coordinate] == "position" and at < BINS and grown[at + BINS].max() >= grown.max() - AS_CLEAR:
        at += BINS
        sign, size = (int(i) for i in np.unravel_index(int(np.argmax(grown[at])), grown[at].shape))
    test = described(base.known, first + at, axis.cycle, axis.kind)
    deviation, weight = evidence.moved[first + at, sign, size]
    change, unit = float(deviation / weight) if weight > 0.0 else 0.0, axis.unit("N m")
    if test.coordinate in PERIODIC:
        change = abs(change)
    if test.coordinate == "speed" and at == SPEED_BANDS:
        change, unit = change / float(base.known.speeds[-1]), axis.unit("N m s/rad")
    since = float(evidence.since[first + at, sign, size])
    return Finding(test.coordinate, test.what, test.low, test.high, test.unit, change, unit, since, *certainty)


def _line(evidence: Evidence, axis: Axis, certainty: tuple[float, float, tuple[str, ...]]) -> Finding:
    """The vibration that the spectrum speaks for; its amplitude is that of the last window."""
    line, rise = (int(i) for i in np.unravel_index(int(np.argmax(evidence.line_grown)), evidence.line_grown.shape))
    lines = frequencies()
    step, frequency = float(lines[1] - lines[0]), float(lines[line])
    amplitude = 2.0 * math.sqrt(max(float(evidence.power[line]), 0.0) / WINDOW)
    since, unit = float(evidence.line_since[line, rise]), axis.unit("N m")
    return Finding("frequency", "vibration", frequency - step, frequency + step, "Hz", amplitude, unit, since, *certainty)
