"""The torque gate in a node, of the simulated axis or of a driver: limits from the axis file, what is said of a verdict."""

from __future__ import annotations

from tcs_friction.config import AxisFile, control_of
from tcs_friction.control.torque_gate import TorqueLimits, Verdict
from tcs_friction.nodes.core.health import Health

OVERSPEED_SHARE = 0.9
"""Share of the controller's speed limit; above what a reference asks for, and full torque takes a moment to the rest."""


def torque_limits(file: AxisFile) -> TorqueLimits:
    """The limits that an axis file implies."""
    pid = control_of(file).controller
    return TorqueLimits(torque_limit=pid.torque_limit, overspeed=OVERSPEED_SHARE * pid.velocity_limit)


def say(verdict: Verdict, health: Health) -> None:
    """Torque that is withheld, in the next report."""
    if verdict.doubt:
        health.doubt("holding", f"holding zero torque: {verdict.doubt}")
    else:
        health.well("holding")
    if verdict.limited:
        health.note(verdict.limited)
