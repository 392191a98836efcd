"""URDF: `<dynamics>` of the joint; limits and all else stay."""

from __future__ import annotations

from tcs_friction.export.dynamics import Layout, export_into
from tcs_friction.export.request import Exported, Request

LAYOUT = Layout("robot", {"revolute": "rotary", "continuous": "rotary", "prismatic": "linear"}, inside=())


def export(request: Request) -> Exported:
    """The robot's description with the axis as its joint."""
    return export_into(request, "URDF", LAYOUT)
