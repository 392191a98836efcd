"""Several axes in one graph: what the nodes of each are told. Each axis is in the namespace of its name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from tcs_friction.errors import InputError
from tcs_friction.nodes.core.files import axis_file, config_file
from tcs_friction.nodes.graph import arguments_for

REFERENCE = "azimuth_1p2m_run.yaml"


def arguments_by_axis(
    axes: Sequence[str], references: Sequence[str] = (), ros_arguments: Sequence[str] = ()
) -> dict[str, list[str]]:
    """ROS arguments of each axis' nodes, by namespace: "" for a single axis, which has the namespace that nodes have by default.

    references: one for each axis, in their order, or one for all; without any see `reference_of`.

    Raises InputError where two axes have one name, a name is no namespace, or references and axes are not as many.
    """
    if len(references) not in (0, 1, len(axes)):
        expected = "one for each axis, in their order, or one for all"
        raise InputError("--reference", f"{len(references)} for {len(axes)} axes", expected)
    chosen = list(references) or [reference_of(axis) for axis in axes]
    if len(chosen) < len(axes):
        chosen *= len(axes)
    if len(axes) == 1:
        return {"": arguments_for(axes[0], chosen[0], [*_measuring(axes[0]), *ros_arguments])}
    if any("__ns:=" in word for word in ros_arguments):
        raise InputError("--ros-args", "a namespace for several axes", "none: each axis is in the namespace of its name")
    spaces = _namespaces(axes)
    found = {}
    for space, axis, reference in zip(spaces, axes, chosen, strict=True):
        own = ["-r", f"__ns:={space}", *_beside(space, spaces), *_measuring(axis)]
        found[space] = arguments_for(axis, reference, [*own, *ros_arguments])
    return found


def reference_of(axis: str) -> str:
    """The reference of an axis file NAME.yaml where none is named: NAME_run.yaml beside it, else the azimuth's."""
    return _companion(axis, "run") or REFERENCE


def _measuring(axis: str) -> list[str]:
    """The reference on which commissioning measures friction: NAME_measure.yaml beside the axis file, where there is one."""
    path = _companion(axis, "measure")
    return ["-p", f"measure_file:={path}"] if path else []


def _companion(axis: str, purpose: str) -> str:
    """The file NAME_PURPOSE.yaml beside an axis file NAME.yaml, "" if there is none."""
    path = Path(config_file(axis))
    beside = path.with_name(f"{path.stem}_{purpose}{path.suffix}")
    return str(beside) if beside.is_file() else ""


def _beside(own: str, spaces: Sequence[str]) -> list[str]:
    others = ", ".join(f"'{space}'" for space in spaces if space != own)
    return ["-p", f"beside:=[{others}]"]


def _namespaces(axes: Sequence[str]) -> list[str]:
    found: dict[str, str] = {}
    for axis in axes:
        name = axis_file(axis).axis.name
        space = f"/{name}"
        try:
            validate_namespace(space)
        except InvalidNamespaceException:
            expected = "letters, digits and underscores, for it becomes the namespace"
            raise InputError(f"{axis}: axis: name", repr(name), expected) from None
        if space in found:
            raise InputError(f"{axis}: axis: name", f"{name!r} is that of {found[space]}, too", "a name of its own for each axis")
        found[space] = axis
    return list(found)
