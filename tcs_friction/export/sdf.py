"""SDF for Gazebo: `<dynamics>` of the joint's `<axis>`, with a linear spring; limits and all else stay."""

from __future__ import annotations

from tcs_friction.export.dynamics import Layout, export_into
from tcs_friction.export.request import Exported, Request

LAYOUT = Layout("sdf", {"revolute": "rotary", "continuous": "rotary", "prismatic": "linear"}, inside=("axis",), spring=True)


def export(request: Request) -> Exported:
    """The model with the axis as its joint."""
    return export_into(request, "SDF", LAYOUT)
