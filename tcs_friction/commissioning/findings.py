"""What commissioning found, from the runs that were heard to the files that it leaves."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from tcs_friction.commissioning.run import Run
from tcs_friction.config import AxisFile, control_of, write_whole
from tcs_friction.control.compensator import CompensatorConfig
from tcs_friction.control.loop import simulate_loop, without_friction
from tcs_friction.control.reference import Reference
from tcs_friction.control.tracking import Improvement, TrackingErrors, reversals
from tcs_friction.errors import InputError
from tcs_friction.report.commission import CommissionResult, write_report
from tcs_friction.report.identification_files import AXIS, IDENTIFICATION
from tcs_friction.report.runs import FrictionRun, TrackingRun

LOOK = 0.01  # s between two looks at a reference's speed
MOST_LOOKS = 1_000_000


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


def both_directions(friction: CompensatorConfig) -> dict[str, float]:
    """One set of parameters: the mean of the two directions."""
    positive, negative = asdict(friction.positive), asdict(friction.negative)
    return {name: 0.5 * (positive[name] + negative[name]) for name in positive}


def frictionless(file: AxisFile, reference: Reference) -> TrackingRun:
    """The same run offline with friction switched off, and nothing from outside: what no compensation can beat."""
    control = control_of(file)
    axis = replace(file.axis, effects=tuple(item for item in file.axis.effects if not item.signals))
    return TrackingRun.of(simulate_loop(without_friction(axis), reference, control.controller, control.loop))


def without_effects(file: AxisFile, reference: Reference) -> TrackingRun:
    """The same run offline of an axis that has neither friction nor effects: the ideal."""
    return frictionless(file.with_axis(replace(file.axis, effects=())), reference)


def write_outcome(directory: Path, result: CommissionResult) -> None:
    """commission.json, and report.html with its pictures."""
    write_whole(directory / "commission.json", json.dumps(result.to_mapping(), indent=2, allow_nan=False) + "\n")
    write_report(directory, result)


def keep_identification(directory: Path | None, name: str) -> np.ndarray:
    """Copy result and axis of the best round's identification up to where the files of the commissioning are.

    Its report stays where it is. Returns the best cost of each generation of its search; none where the identifier's results
    are on another machine.
    """
    if directory is None or not (directory / name).is_dir():
        return np.zeros(0)
    for file in (IDENTIFICATION, AXIS):
        write_whole(directory / file, (directory / name / file).read_text(encoding="utf-8"))
    content = json.loads((directory / IDENTIFICATION).read_text(encoding="utf-8"))
    return np.array(content["history"], dtype=np.float64)


def check_reversals(name: str, reference: Reference, settle: float) -> None:
    """Raises InputError, before anything moves, when errors at reversals in both directions could not be measured."""
    t = np.linspace(0.0, reference.duration, int(np.clip(reference.duration / LOOK, 2, MOST_LOOKS)))
    crossings = reversals(t, np.asarray(reference.over(t)[:, 1]))
    ways = set(crossings[crossings[:, 0] > settle, 1])
    lacking = [word for sign, word in ((1.0, "positive"), (-1.0, "negative")) if sign not in ways]
    if lacking:
        found = f"no reversal to {' or '.join(lacking)} motion in its {reference.duration:g} s after the {settle:g} s of settle"
        raise InputError(name, found, "one each way")


def verdict(before: TrackingErrors, after: TrackingErrors, gain: Improvement) -> str:
    """What came of it, in words."""
    change = 100.0 * (after.rms / before.rms - 1.0)
    more = f"{abs(change):.0f} % {'more' if change > 0.0 else 'less'}"
    words = f"tracking error {before.rms:.4f} to {after.rms:.4f} arcsec rms ({more}"
    return f"{words}; at the reversals {gain.lowest:.3g} to {gain.highest:.3g} times what it was)"
