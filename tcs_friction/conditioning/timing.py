"""When the torque of a recording acts, before anything is fitted: what is stated, or what conventions of stamping allow.

A drive renews its torque every so often. Where nobody says which end of that time a stamp is, a logged value begins to act
anywhere from one renewal before its stamp to the stamp: that is a nuisance of the recording, and no physics. Beyond it a log is
late (the value acted before), or early, which a delay of the drive cannot be told from.

Of what is held, the middle is half a renewal before the stamp or after it; a momentary value of a torque that changes more often
than it is logged is its own middle. Where nobody says which it is, values are taken for momentary unless the fit has their middle
nearer to one of a hold's, or the log itself repeats each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tcs_friction.conditioning.hold import Between, stale_stride
from tcs_friction.recording.recording import Recording

LONGEST = 0.05
"""s: clocks of a drive and its encoder differ by less, or nobody could control with them."""


@dataclass(frozen=True)
class LogTiming:
    """When the torque of one recording acts.

    acts: s after its stamp at which a logged value begins to act; where that is not stated, the middle of what is possible.
    leeway: s by which that may be sooner or later, 0 where it is stated. own_clock: the torque has stamps of its own. source: of
    the recording. between: what the torque does between logged values.
    """

    acts: float
    leeway: float
    own_clock: bool = False
    source: str = "recording"
    between: Between = Between.HELD

    @property
    def stated(self) -> bool:
        """Whether the recording says when its torque acts."""
        return self.leeway == 0.0


@dataclass(frozen=True)
class TorqueActs:
    """When the torque of one recording acts, as a fit has found it or a file states it.

    acts: s after its stamp at which a logged value begins to act. std: its standard deviation, s; 0 where it is stated.
    determined: whether the fit tells it better than the conventions of stamping do. timing: what was known before.
    """

    acts: float
    std: float
    determined: bool
    timing: LogTiming

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        told = {"acts": self.acts, "std": self.std, "stated": self.timing.stated, "determined": self.determined}
        return {"recording": self.timing.source, **told}

    @property
    def usual(self) -> bool:
        """Whether stamps are usually meant so: a value acts from its stamp on, or did up to it."""
        return self.timing.stated or abs(self.acts + self.timing.leeway) <= self.timing.leeway

    @property
    def words(self) -> str:
        """One line for a report."""
        acts, std = 1e3 * self.acts, 1e3 * self.std
        if self.timing.stated:
            return f"the logged torque acts from {acts:.3g} ms after its stamp on, as stated"
        if not self.determined:
            within = f"anywhere within {2e3 * self.timing.leeway:.3g} ms before its stamp is possible"
            return f"when the torque acts is not told: {within}"
        if self.timing.between is Between.LINE:
            return f"the logged torque is momentary and acts {acts + 1e3 * self.timing.leeway:.3g} ± {std:.2g} ms after its stamp"
        line = f"the logged torque is held and begins to act {acts:.3g} ± {std:.2g} ms after its stamp"
        return line if self.usual else f"{line}, which is outside what stamps usually mean: the log is out of step"


def log_timing(recording: Recording) -> LogTiming:
    """The timing of a recording's torque, as stated or as far as conventions allow.

    Momentary values act at their stamps, in the middle of what is possible.
    """
    own = recording.torque_log is not None
    if recording.acts is not None:
        return LogTiming(recording.acts, 0.0, own, recording.source)
    parts = [part for part in recording.segments if part.stop - part.start > 1]
    logs = [recording.logged(part) for part in parts]
    strides = [stale_stride(*log) for log in logs]
    half = 0.5 * max(stride * float(np.median(np.diff(t))) for (t, _), stride in zip(logs, strides, strict=True))
    repeated = max(strides) > 1 or any(stale_stride(recording.t[part], recording.position[part]) > 1 for part in parts)
    return LogTiming(-half, half, own, recording.source, Between.HELD if repeated else Between.LINE)
