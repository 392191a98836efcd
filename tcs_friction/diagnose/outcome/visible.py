"""What a diagnosis could have seen: up to which frequency, in how much of the data, and which effects from which size on.

"Nothing is missing" has a size only then. The size of an effect at which it would have been found follows from what its torque
does to the whitened squares beside all that retuning explains: they grow with the square of the torque.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.search.hypotheses import eligible
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes, survey
from tcs_friction.physics.terms import Place, Survey, Term

FOUND = 7.1  # standard deviations at which half of all effects are found, median of 26 (docs/diagnosis.md, `--limits`)


@dataclass(frozen=True)
class Visible:
    """What a diagnosis could have seen.

    band: up to which frequency torques were compared, Hz. share: of the data that was compared. sizes: by effect, the torque
    (N m rms) at which it would about have been found. tolerance: share of the friction below which a remainder is no verdict.
    """

    band: float
    share: float
    sizes: Mapping[str, float]
    tolerance: float

    def to_mapping(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return {"band": self.band, "share": self.share, "sizes": dict(self.sizes), "tolerance": self.tolerance}

    def words(self, unit: str) -> str:
        """Two sentences; unit: of torque."""
        asked = f"Asked were {100.0 * self.share:.0f} % of the data, up to {self.band:.3g} Hz"
        least = sorted(self.sizes.items(), key=lambda one: one[1])
        if not least:
            return f"{asked}."
        (first, small), (last, large) = least[0], least[-1]
        told = f"{asked}; seen would be {first} from about {small:.2g} {unit} rms on"
        return f"{told}, {last} from {large:.2g}." if len(least) > 1 else f"{told}."


def visible(balance: TorqueBalance, fit: Fit, excluded: Collection[str], tolerance: float) -> Visible:
    """What could have been seen beside a fit. excluded: ids of effects that the data cannot carry.

    Bodies and filters have no size of their own that says how much they show.
    """
    projected, sizes = ProjectedResidual(balance, fit), dict[str, float]()
    view = survey(balance, fit.axis)
    for term, signal in eligible(fit.axis, balance):
        if term.id in excluded or term.place in (Place.BODY, Place.SENSOR) or term.filters or term.features:
            continue
        shape = _usual_shape(term, view, balance, fit)
        size = None if shape is None else _size(projected, term, shape, signal)
        if size is not None:
            sizes[term.id] = min(size, sizes.get(term.id, math.inf))
    data = balance.data
    share = float(np.mean(balance.train | balance.held_out))
    return Visible(data.cutoff, share, sizes, tolerance)


def _usual_shape(term: Term, view: Survey, balance: TorqueBalance, fit: Fit) -> dict[str, float] | None:
    """Values of an effect's shape in the middle of those that are searched; None where there are none."""
    if term.periodic == "time":
        return {term.order.name: 0.1 * balance.data.cutoff}
    if term.periodic:
        once = 2.0 * math.pi / (view.span * fit.axis.cycle)
        low, high = term.orders(once, fit.axis.kind == "rotary")
        fastest = 2.0 * math.pi * balance.data.cutoff / (fit.axis.cycle * max(view.fast, 1e-300))  # that the band carries
        middle = math.sqrt(low * max(min(high, fastest), low))
        return {term.order.name: float(round(middle)) if term.whole and fit.axis.kind == "rotary" else middle}
    scans = list(term.scan(view))
    return dict(scans[len(scans) // 2]) if scans else None


def _size(projected: ProjectedResidual, term: Term, shape: Mapping[str, float], signal: str | None) -> float | None:
    """Torque (N m rms) at which an effect of this shape would about have been found; None where it does nothing."""
    sizes = []
    for item in probes(term, shape, signal)[:2]:
        change = projected.change(item)
        white = projected.project(projected.noise.whiten(change))
        seen = math.sqrt(float(white @ white) / projected.dispersion)
        if seen > 0.0:
            sizes.append(FOUND * rms(change[projected.balance.train]) / seen)
    return float(np.mean(sizes)) if sizes else None
