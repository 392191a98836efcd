"""Section 5.3, Figs. 16 to 19 and Table 2: PSO-GA against PSO alone on the observed friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from tcs_friction.conditioning.motion import FrictionSeries
from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.control.loop import LoopRun
from tcs_friction.identify.cost import Box
from tcs_friction.identify.identification import IdentifyOptions, identify
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.identify.pso_ga import Generation
from tcs_friction.identify.result import Identification
from tcs_friction.report import published
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    drawn,
    label,
    legend,
    line,
    panels,
)
from tcs_friction.report.html import Cell, Html, picture, section, table
from tcs_friction.report.paper.stand import Chapter, Stand
from tcs_friction.report.runs import DEGREE

METHODS = ("pso-ga", "pso", "default")
NAMES = {"pso-ga": "PSO-GA", "pso": "PSO", "ga": "GA", "default": "swarm, then Levenberg-Marquardt"}
SEEDS = 9
NEAR = 0.01  # relative, of an RMSE that is as good as the least
SWARM = SwarmOptions()


@dataclass(frozen=True)
class SearchResult:
    """The data (two directions together) and what each method made of it."""

    data: FrictionSeries
    found: dict[str, Identification]
    true: dict[str, float]
    spread: dict[str, tuple[float, ...]]  # RMSE (N m) of each method over SEEDS seeds
    histories: dict[str, tuple[np.ndarray, ...]]  # best cost of each generation, likewise
    asymmetry: float  # by which the directions' dry friction differs from the mean, relative

    def above(self, method: str) -> float:
        """RMSE above the least found by any method, in squares, median over the seeds, N m."""
        least = min(min(values) for values in self.spread.values())
        return float(np.sqrt(np.median(np.square(self.spread[method])) - least**2))

    def reached(self, method: str) -> float:
        """Generations (median over the seeds) after which the RMSE was within NEAR of the least; infinite if it never was."""
        least = min(float(h[-1]) for name in ("pso-ga", "pso") for h in self.histories[name])
        limit = least * (1.0 + NEAR) ** 2
        return float(
            np.median(
                [np.argmax(h <= limit) + 1 if h[-1] <= limit else np.inf for h in self.histories[method]]
            )
        )

    def compensator(self, like: CompensatorConfig) -> CompensatorConfig:
        """A compensator with what the best method identified, direction by direction."""
        best = self.found["default"]
        positive, negative = (LugreParameters(**best.friction(way)) for way in ("positive", "negative"))
        return replace(like, positive=positive, negative=negative)


def paper_box() -> Box:
    """The paper's search box, in SI units; sigma1 up to twice the bristle's critical damping on 1000 kg m^2.

    The printed range of sigma1 cannot be meant for motion at 0.1 deg/s (docs/paper-errata.md).
    """
    names = ("coulomb", "static", "stribeck_velocity", "stiffness", "damping", "viscous")
    lower = np.array([50.0, 50.0, 1e-3 * DEGREE, 4000.0 / DEGREE, 0.0, 0.0])
    upper = np.array([100.0, 200.0, 1.0 * DEGREE, 6000.0 / DEGREE, 6.8e4, 50.0 / DEGREE])
    return Box(names, lower, upper, np.zeros(6, dtype=bool))


def measure(stand: Stand, run: LoopRun, progress: Callable[[Generation], None]) -> SearchResult:
    """Identify from the paper's number of friction-speed points in each direction of a measured run."""
    every = slice(None, None, max(1, len(run.t) // (2 * published.POINTS)))
    observer = stand.control.observer
    lag, bandwidth = observer.estimate_filter
    data = FrictionSeries(
        run.t[every],
        run.reference_velocity[every],
        run.friction_estimate[every],
        lag + observer.velocity_delay,
        bandwidth,
    )
    options = IdentifyOptions(swarm=SWARM, box=paper_box())
    believed = replace(stand.axis, effects=())  # nobody is told of cogging and asymmetry

    def found_with(method: str, seed: int) -> Identification:
        return identify([data], believed, method, "lugre", seed, progress, options=options)

    found = {method: found_with(method, stand.seed) for method in METHODS}
    others = range(stand.seed + 1, stand.seed + SEEDS)
    seeded = {
        method: (first, *(found_with(method, seed) for seed in others)) for method, first in found.items()
    }
    spread = {method: tuple(rmse(item) for item in items) for method, items in seeded.items()}
    histories = {method: tuple(item.history for item in items) for method, items in seeded.items()}
    asymmetries = [
        item.values["asymmetry"] for item in stand.axis.effects if item.term.id == "coulomb_asymmetry"
    ]
    return SearchResult(data, found, dict(stand.axis.friction.values), spread, histories, sum(asymmetries))


def rmse(found: Identification) -> float:
    """RMS of measured less modelled friction over all points, N m."""
    return float(np.sqrt(np.mean(found.fit.residual**2)))


@drawn(
    "figure_16",
    "Fig. 16. The friction-speed points near zero speed that the identification gets, by direction.",
)
def draw_points(data: FrictionSeries) -> Figure:
    """Negative (CCW) on the left, positive (CW) on the right."""
    figure, (left, right) = panels(1, 2, height=2.8)
    t, friction = data.t, np.interp(data.t + data.lag, data.t, data.friction)
    for axes, sign, name in ((left, -1.0, "CCW (negative)"), (right, 1.0, "CW (positive)")):
        keep = (np.sign(data.velocity) == sign) & (t > t[0] + 10.0) & (t < t[-1] - data.lag)
        axes.plot(data.velocity[keep] / DEGREE, friction[keep], ".", ms=2, color=MEASURED)
        label(axes, "speed (deg/s)", "", name)
    left.set_ylabel("friction (N m)")
    return figure


@drawn("figure_17", "Fig. 17. Best cost of each generation.")
def draw_costs(result: SearchResult) -> Figure:
    """PSO-GA and PSO on the same cost."""
    figure, (axes,) = panels(height=2.6)
    for method, color in (("pso", BELIEVED), ("pso-ga", IMPROVED)):
        history = result.found[method].history
        axes.semilogy(np.arange(1, len(history) + 1), history, color=color, label=NAMES[method])
    label(axes, "generation", "best cost, eq. 5 ((N m)²)")
    legend(axes)
    return figure


@drawn("figure_18", "Fig. 18. Friction observed and simulated with the laws that PSO-GA and PSO alone found; below, the "
       "differences.")  # fmt: skip
def draw_series(result: SearchResult) -> Figure:
    """Series on top, differences below."""
    figure, (top, bottom) = panels(2, height=2.2, sharex=True)
    fit = result.found["pso-ga"].fit
    line(top, fit.t, fit.friction_measured, MEASURED, "observed", lw=2.2)
    for method, color in (("pso", BELIEVED), ("pso-ga", IMPROVED)):
        fit = result.found[method].fit
        line(top, fit.t, fit.friction_modelled, color, NAMES[method], lw=1.0)
        line(
            bottom,
            fit.t,
            fit.residual,
            color,
            f"{NAMES[method]}: {rmse(result.found[method]):.3f} N m rms",
            lw=0.9,
        )
    label(top, "", "friction (N m)")
    label(bottom, "time (s)", "difference (N m)")
    legend(top)
    legend(bottom)
    return figure


@drawn("figure_19", "Fig. 19. Friction over speed, observed and simulated with the law that PSO-GA found.")
def draw_hysteresis(result: SearchResult) -> Figure:
    """One loop over the other."""
    figure, (axes,) = panels(height=3.2)
    fit = result.found["pso-ga"].fit
    keep = fit.t > fit.t[0] + 10.0
    axes.plot(
        fit.velocity[keep] / DEGREE, fit.friction_measured[keep], ".", ms=3, color=MUTED, label="observed"
    )
    axes.plot(
        fit.velocity[keep] / DEGREE, fit.friction_modelled[keep], color=IMPROVED, lw=1.2, label="PSO-GA"
    )
    label(axes, "speed (deg/s)", "friction (N m)")
    legend(axes)
    return figure


def in_paper_units(name: str, value: float) -> float:
    """A parameter in Table 2's unit, from SI."""
    scale = {"stiffness": DEGREE, "damping": DEGREE, "viscous": DEGREE, "stribeck_velocity": 1.0 / DEGREE}
    return value * scale.get(name, 1.0)


def _table_2(result: SearchResult) -> Html:
    rows = []
    for name, (ccw, cw, unit) in published.TABLE_2.items():
        ours = [_shown(result, way, name) for way in ("negative", "positive")]
        true = in_paper_units(name, result.true[name])
        rows.append([published.SYMBOLS[name], *ours, f"{true:.4g}", f"{ccw:.5g}", f"{cw:.5g}", unit])
    head = ["parameter", "ours CCW", "ours CW", "true (mean)", "paper CCW", "paper CW", "unit"]
    caption = "Table 2. Ours: swarm, then Levenberg-Marquardt, each direction by itself"
    return table(head, rows, caption)


def _shown(result: SearchResult, way: str, name: str) -> str:
    estimate = result.found["default"].directions.get(way, {}).get(name)
    if estimate is None or not estimate.determined:
        return "– (undetermined)"
    return f"{in_paper_units(name, estimate.value):.4g}"


def _errors_table(result: SearchResult) -> Html:
    paper = {"pso-ga": f"{published.RMSE_PSO_GA:.3f} N m", "pso": f"{published.RMSE_PSO:.3f} N m"}
    rows: list[list[str | Cell]] = [
        [
            NAMES[method],
            f"{rmse(found):.3f} N m",
            f"{np.median(result.spread[method]):.3f} N m",
            f"{max(result.spread[method]):.3f} N m",
            f"{result.above(method):.3f} N m",
            _generations(result.reached(method)) if method in paper else "–",
            paper.get(method, "–"),
            str(len(found.history)),
            f"{found.evaluations:,}",
            f"{found.seconds:.1f} s",
        ]
        for method, found in result.found.items()
    ]
    head = [
        "method",
        "RMSE",
        f"median of {SEEDS} seeds",
        "worst",
        "median above the least",
        "generations to 1 %",
        "paper",
    ]
    return table([*head, "generations", "evaluations", "time"], rows)


def _ranking(result: SearchResult) -> str:
    """PSO-GA against PSO alone over the seeds, in words."""
    hybrid, swarm = result.spread["pso-ga"], result.spread["pso"]
    least = min(min(hybrid), min(swarm))
    as_good = (1.0 + NEAR) * least
    if np.median(hybrid) < as_good and np.median(swarm) < as_good:
        ranked = f"On most seeds both come within {100 * NEAR:.0f} % of the least RMSE that this data allow"
    elif np.median(hybrid) < np.median(swarm):
        ranked = "As in the paper, PSO-GA comes nearer than PSO alone"
    else:
        ranked = "The paper's ranking is not confirmed here: PSO alone comes nearer on most seeds"
    return (
        f"{ranked}: {result.above('pso-ga'):.3f} and {result.above('pso'):.3f} N m above it in the median. PSO-GA is there "
        f"after {_generations(result.reached('pso-ga'))} generations, PSO after {_generations(result.reached('pso'))}; their "
        f"worst seeds end at {max(hybrid):.3f} and {max(swarm):.3f} N m ({max(hybrid) / max(swarm):.2f} times; the paper's two "
        f"numbers: {published.RMSE_PSO_GA / published.RMSE_PSO:.2f} times). PSO alone had as many generations and more "
        "evaluations. The swarm that hands over to a "
        "local search finds the same optimum on every seed."
    )


def _generations(count: float) -> str:
    return f"{count:.0f}" if np.isfinite(count) else "never"


def chapter(result: SearchResult) -> Chapter:
    """Figs. 16 to 19 and Table 2."""
    pictures = (draw_points(result.data), draw_costs(result), draw_series(result), draw_hysteresis(result))
    ranking = _ranking(result)
    words = (
        "The paper's RMSE is against friction observed on a telescope, ours against friction observed on the simulated "
        "axis: what remains here is the observer's noise, the cogging and the direction asymmetry "
        f"of ±{100 * result.asymmetry:.0f} %. The paper's cost of 4.033e-10 contradicts its own RMSE (2.573 N m over "
        "4600 points make about 15,000), so costs are not compared."
    )
    html = section(
        "5.3 PSO-GA identification",
        picture(pictures[0]),
        picture(pictures[1]),
        _errors_table(result),
        ranking,
        words,
        _table_2(result),
        picture(pictures[2]),
        picture(pictures[3]),
    )
    return Chapter(html, pictures)
