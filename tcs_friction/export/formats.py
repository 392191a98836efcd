"""The formats by name: what each makes, and the one function behind it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

from tcs_friction.errors import InputError, nearest
from tcs_friction.export.request import Exported, Request


@dataclass(frozen=True)
class Format:
    """A format; its module in this package has `export(request)`. changes: whether it changes a model of the user's own."""

    name: str
    makes: str
    changes: bool = False
    kinds: tuple[str, ...] = ()

    def export(self, request: Request) -> Exported:
        """Files and what is said of them."""
        if request.into is not None and not self.changes:
            raise InputError("--into", f"given for {self.name}, which makes files of its own", "nothing, or mjcf, urdf or sdf")
        if request.kind and request.kind not in self.kinds:
            expected = nearest(request.kind, self.kinds) if self.kinds else f"nothing for {self.name}"
            raise InputError("--kind", f"no kind {request.kind!r} of {self.name}", expected)
        module = importlib.import_module(f"tcs_friction.export.{self.name}")
        exported: Exported = module.export(request)
        return exported


FORMATS = {
    one.name: one
    for one in (
        Format("c", "C99 and C++: friction, its compensation, the axis in motion, test vectors, a ros2_control controller"),
        Format("mjcf", "a MuJoCo model with the axis as one of its joints", changes=True),
        Format("urdf", "a URDF with the joint's <dynamics>", changes=True),
        Format("sdf", "an SDF (Gazebo) with the joint's <dynamics>", changes=True),
        Format("table", "tables for drives", kinds=("friction", "torque", "beckhoff", "odrive", "cia402", "linuxcnc")),
        Format("modelica", "a Modelica block around the C code"),
        Format(
            "fmu",
            "an FMU for co-simulation, with its C code compiled",
            kinds=("fmi3-axis", "fmi3-friction", "fmi2-axis", "fmi2-friction"),
        ),
    )
}


def format_named(name: str) -> Format:
    """The format of that name; InputError names the nearest."""
    if name not in FORMATS:
        raise InputError("--to", f"no format {name!r}", nearest(name, FORMATS))
    return FORMATS[name]
