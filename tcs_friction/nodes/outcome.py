"""What commissioning found, from the runs that were heard to the files that it leaves."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tcs_friction_msgs.msg import LugreParameters

from tcs_friction.config import AxisFile, write_whole
from tcs_friction.control.loop import simulate_loop, without_friction
from tcs_friction.control.reference import Reference
from tcs_friction.nodes.base import control_of
from tcs_friction.nodes.convert import direction
from tcs_friction.nodes.runs import Run
from tcs_friction.report.commission import CommissionResult, write_report
from tcs_friction.report.runs import FrictionRun, TrackingRun


def tracking(run: Run) -> TrackingRun:
    """How the axis followed its reference."""
    (t, position, velocity, _), (_, wanted, speed, _) = run.matched("joint_states", "reference")
    return TrackingRun(t, speed, velocity, wanted - position)


def friction(run: Run, delay: float) -> FrictionRun:
    """What the observer saw, its known delay (s) taken out, beside the true friction if the plant tells it."""
    known = run.matched("true_friction", "friction_estimate") if "true_friction" in run.topics else None
    t, estimate, velocity, *_ = known[1] if known else run.topics["friction_estimate"]
    keep = t <= t[-1] - delay
    seen = np.interp(t + delay, t, estimate)
    return FrictionRun(t[keep], velocity[keep], seen[keep], known[0][1][keep] if known else None)


def both_directions(message: LugreParameters) -> dict[str, float]:
    """One set of parameters: the mean of the two directions."""
    positive, negative = asdict(direction(message.positive)), asdict(direction(message.negative))
    return {name: 0.5 * (positive[name] + negative[name]) for name in positive}


def frictionless(file: AxisFile, reference: Reference) -> TrackingRun:
    """The same run offline with friction switched off: what no compensation can beat."""
    control = control_of(file)
    return TrackingRun.of(simulate_loop(without_friction(file.axis), reference, control.controller, control.loop))


def write_outcome(directory: Path, result: CommissionResult) -> None:
    """commission.json, and report.html with its pictures."""
    write_whole(directory / "commission.json", json.dumps(result.to_mapping(), indent=2, allow_nan=False) + "\n")
    write_report(directory, result)


def search_costs(directory: Path) -> np.ndarray:
    """Best cost of each generation of the identification just written to a directory."""
    content = json.loads((directory / "identification.json").read_text(encoding="utf-8"))
    return np.array(content["history"], dtype=np.float64)
