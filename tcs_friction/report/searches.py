"""PSO-GA beside PSO alone: how the best cost fell over the evaluations, and what both found."""

from __future__ import annotations

from tcs_friction.identify.searches import HYBRID, NAMES, SWARM, Searches, residual_rms
from tcs_friction.report.figures import BELIEVED, IMPROVED, Picture
from tcs_friction.report.html import Html, table
from tcs_friction.report.plot import Curve, Panel, Plot, Scale, Spacing
from tcs_friction.report.plot_picture import drawn_plot

COLORS = {SWARM: BELIEVED, HYBRID: IMPROVED}


def draw_searches(searches: Searches) -> Picture:
    """Best cost of both over evaluations, and in the legend the residual that each leaves in the end."""
    unit = searches.found[HYBRID].offset.unit
    curves = []
    for method, color in COLORS.items():
        item = searches.found[method]
        name = f"{NAMES[method]}: {residual_rms(item):.4g} {unit} rms"
        curves.append(Curve(name, color, item.evaluated.astype(float), item.history, size=2.0))
    cost = Scale("best cost", f"({unit})²", Spacing.LOG)
    caption = "Best cost over evaluations of PSO-GA and of PSO alone, from the same seed, and the residual that each leaves."
    panel = Panel(Scale("evaluations of the cost"), cost, tuple(curves))
    return drawn_plot(Plot("searches", caption, ((panel,),), heights=(2.8,)))


def search_table(searches: Searches) -> Html:
    """What both found, number by number."""
    head = ["", *(NAMES[method] for method in searches.found), "unit"]
    return table(head, searches.rows(), "The same seed, as many evaluations, neither refined")
