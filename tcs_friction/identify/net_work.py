"""The sign of a recorded torque, by the work that it does: an axis takes energy from its drive and gives none back.

Over a span that ends at the position and speed at which it began, inertia, springs and gravity have given back what they took.
What the torque has done then is what friction took, all of it, whatever its law. That is positive, unless the torque's sign is
turned over.

    u = J a + U'(q) + f,    sum of u v dt over a closed span = sum of f v dt > 0

Where that is not decided (a span that does not close, friction lost in what a wrong clock makes of the inertia), the sign of the
inertia decides, fitted beside all that a position can do.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from tcs_friction.conditioning.motion import Motion
from tcs_friction.identify.linear_balance import linear_balance
from tcs_friction.recording.signals import opposing_torque

DECISIVE = 3.0  # standard errors
CLOCKS = 0.02  # s, by which the stamps of torque and position may differ: as much as the recordings of this project do
BEGINNINGS, ENDS = 64, 20_000  # instants at which a closed span may begin and end: more bring the ends no closer
FULL_TURN = 2.0 * math.pi


class Sign(enum.Enum):
    """What a recording says of the sign of its torque."""

    RIGHT = "right"
    TURNED = "turned over"
    OPEN = "not told"


@dataclass(frozen=True)
class NetWork:
    """What decides over the sign of a torque.

    work: done over closed spans, J. std: of it, by noise and by how far the spans are from closed. clocks: by how much it may be
    wrong since stamps of torque and position differ by up to CLOCKS. seconds: of the spans. inertia: and its std, kg m^2.
    """

    work: float
    std: float
    clocks: float
    seconds: float
    inertia: tuple[float, float]

    @property
    def by_work(self) -> Sign:
        """What the work alone says."""
        return _sign(self.work, DECISIVE * self.std + self.clocks)

    @property
    def by_inertia(self) -> Sign:
        """What the inertia alone says."""
        return _sign(self.inertia[0], DECISIVE * self.inertia[1])

    @property
    def sign(self) -> Sign:
        """By the work; where that is not told, by the inertia. An axis that something else drives contradicts itself."""
        if self.by_work is Sign.OPEN:
            return self.by_inertia
        driven = self.by_work is Sign.TURNED and self.by_inertia is Sign.RIGHT
        return Sign.OPEN if driven else self.by_work

    def __str__(self) -> str:
        spread = self.std + self.clocks
        both = f"{self.work:.3g} J as recorded, {-self.work:.3g} J turned over"
        return f"it does {both} (± {spread:.2g}) over {self.seconds:.3g} s of motion that comes back to where it began"


def _sign(value: float, limit: float) -> Sign:
    if abs(value) > limit:
        return Sign.RIGHT if value > 0.0 else Sign.TURNED
    return Sign.OPEN


def net_work(motion: Motion, kind: str) -> NetWork:
    """The work of the torque over the best closed span of each stretch of a motion; `kind` of axis: rotary or linear."""
    balance = linear_balance(motion, ("constant", "line", *(["gravity"] if kind == "rotary" else [])))
    scale = Scale(abs(float(balance.values[0])), float(np.sqrt(np.mean(motion.torque**2))), balance.residual**2 * balance.memory)
    spans = [closed_span(motion, part, scale, kind == "rotary") for part in motion.stretches]
    work = variance = clocks = seconds = 0.0
    for where, gap in spans:
        v, a, u = (getattr(motion, name)[where] / math.sqrt(motion.rate) for name in ("velocity", "acceleration", "torque"))
        work += float(u @ v)
        variance += gap**2 + scale.density * float(v @ v)
        clocks += CLOCKS * scale.inertia * float(a @ a)
        seconds += len(v) / motion.rate
    return NetWork(work, math.sqrt(variance), clocks, seconds, (float(balance.values[0]), float(balance.std[0])))


@dataclass(frozen=True)
class Scale:
    """What makes an energy of a gap between two ends: inertia kg m^2, force N m rms, and density of the noise (N m)^2 s."""

    inertia: float
    force: float
    density: float


def closed_span(motion: Motion, part: slice, scale: Scale, rotary: bool) -> tuple[slice, float]:
    """Of one stretch, the span over which friction is known best, and by how much (J) it is not closed.

    What is uncertain of the mean friction over a span is its gap and the noise's work, over the way that it goes. Positions of a
    rotary axis that are a turn apart are the same.
    """
    q, v = motion.position[part], motion.velocity[part]
    energy, moving = 0.5 * scale.inertia * v**2, np.abs(v) > motion.resolution
    way = np.cumsum(np.where(moving, np.abs(v), 0.0)) / motion.rate
    noise = np.cumsum(v**2) / motion.rate * scale.density
    ends = np.unique(np.linspace(0, len(q) - 1, min(len(q), ENDS)).astype(np.int64))
    best, span, least = math.inf, part, math.inf
    for i in np.unique(np.linspace(0, len(q) - 2, min(len(q) - 1, BEGINNINGS)).astype(np.int64)).tolist():
        j = ends[ends > i]
        apart = np.abs(q[j] - q[i])
        apart = np.abs((apart + np.pi) % FULL_TURN - np.pi) if rotary else apart
        gap = scale.force * apart + np.abs(energy[j] - energy[i])
        gone = way[j] - way[i]
        unsure = np.divide(gap + np.sqrt(noise[j] - noise[i]), gone, out=np.full(len(j), math.inf), where=gone > 0.0)
        k = int(np.argmin(unsure))
        if unsure[k] < best:
            best, span, least = float(unsure[k]), slice(part.start + i, part.start + int(j[k])), float(gap[k])
    return span, least


def refuse_turned(motion: Motion, kind: str) -> None:
    """Refuse a torque that opposes every motion that it should drive. Raises InputError."""
    if net_work(motion, kind).sign is Sign.TURNED:
        raise opposing_torque()
