"""Profile likelihoods drawn: one small picture for each parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from tcs_friction.identify.result import Identification, Profile
from tcs_friction.report.figures import BELIEVED, IMPROVED, MUTED, drawn, label, panels
from tcs_friction.report.html import Cell, Html, table

CHI_95 = 3.841  # 95 % quantile of chi squared with one degree of freedom
COLUMNS = 4


@drawn("profiles", "Profile likelihood: how much worse the data are explained where a parameter is held and the others give "
       "way; below the dotted line lies its 95 % interval. Dashed: the parabola of the standard error.")  # fmt: skip
def draw_profiles(found: Identification) -> Figure:
    """Rise of -2 log likelihood over each parameter."""
    shown = found.profiles
    rows = math.ceil(len(shown) / COLUMNS)
    figure, axes = panels(rows, min(COLUMNS, len(shown)), height=2.0, width=9.4)
    for place, (name, profile) in zip(axes, shown.items(), strict=False):
        estimate = {**found.parameters, "inertia": found.inertia, "offset": found.offset}[name]
        place.plot(profile.values, profile.rise, "o-", ms=3, color=IMPROVED)
        fine = np.linspace(profile.values[0], profile.values[-1], 60)
        place.plot(fine, ((fine - estimate.value) / estimate.std) ** 2, "--", lw=0.9, color=BELIEVED)
        place.axhline(CHI_95, color=MUTED, ls=":", lw=0.9)
        place.locator_params(axis="x", nbins=3)
        label(place, f"{name.replace('_', ' ')} ({estimate.unit})", "")
    for place in axes[len(shown) :]:
        place.set_visible(False)
    return figure


def profile_table(profiles: Mapping[str, Profile]) -> Html:
    """The 95 % intervals."""
    rows: list[list[str | Cell]] = [
        [name, *("open" if end is None else f"{end:.6g}" for end in profile.interval)]
        for name, profile in profiles.items()
    ]
    return table(["parameter", "from", "to"], rows, "95 % intervals from the profile likelihood")
