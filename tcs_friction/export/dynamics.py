"""`<dynamics>` of URDF and SDF: Coulomb and viscous friction. The one has attributes, the other tags, and a spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tcs_friction.errors import InputError, nearest
from tcs_friction.export.curve import fitted, spring
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.telling import bristles, how_well, in_newton_metres, left_out
from tcs_friction.export.xml_edit import Document, Element


@dataclass(frozen=True)
class Layout:
    """Where a format has it. inside: tags between joint and <dynamics>. spring: whether there is one; numbers are tags then."""

    root: str
    kinds: Mapping[str, str]
    inside: tuple[str, ...]
    spring: bool = False


def export_into(request: Request, target: str, layout: Layout) -> Exported:
    """The model with friction and damping of one joint changed, or added where it had none."""
    in_newton_metres(request, target)
    document = Document(request.model(), str(request.into), layout.root)
    holder = _holder(document, request, layout)
    fit = fitted(request.axis, request.speed, 1)
    values = {"damping": fit.damping[0], "friction": fit.dry}
    lines, done = [*how_well(fit, request.axis, "friction and damping"), *bristles(request.axis)], set()
    springs = tuple(item for item in request.axis.effects if item.term.neutral) if layout.spring else ()
    if springs:
        found = spring(request.axis, springs, request.travel, 1)
        values |= {"spring_reference": found.neutral, "spring_stiffness": found.stiffness[0]}
        reach = f"from {request.travel[0]:.3g} to {request.travel[1]:.3g} {request.axis.unit('rad')}"
        words = " and ".join(item.words for item in springs)
        lines.append(f"{words}: as a linear spring, {100.0 * found.off:.2g} % of its torque left over {reach}")
        done = {item.identity for item in springs}
    before = _write(document, holder, {name: f"{value:.9g}" for name, value in values.items()}, layout.spring)
    unit = request.axis.unit("kg m^2")
    lines.append(
        f"inertia of {request.axis.inertia:.4g} {unit}: not expressed, {target} has no rotor inertia; links stay as they are"
    )
    lines += left_out(request.axis, done, "if it is gravity, the model has its own")
    return Exported({request.output: document.changed()}, [*(["was there: " + ", ".join(before)] if before else []), *lines])


def _holder(document: Document, request: Request, layout: Layout) -> Element:
    joints = [one for one in document.root.all("joint") if "type" in one.attributes]
    named: dict[str, Element] = {}
    for joint in joints:
        name = joint.attributes.get("name", "")
        if name == request.joint and name in named:
            raise InputError(document.where, f"joint {name} twice", "every joint once")
        named[name] = joint
    if request.joint not in named:
        raise InputError(document.where, f"no joint {request.joint}", f"{nearest(request.joint, filter(None, named))} (--joint)")
    element = named[request.joint]
    kind = element.attributes["type"]
    if layout.kinds.get(kind) != request.axis.kind:
        raise InputError(document.where, f"joint {request.joint} is {kind}", f"the kind of the axis, {request.axis.kind}")
    for tag in layout.inside:
        inner = element.get(tag)
        if inner is None:
            raise InputError(document.where, f"joint {request.joint} has no <{tag}>", f"one with <{tag}>")
        element = inner
    return element


def _write(document: Document, holder: Element, values: Mapping[str, str], tags: bool) -> list[str]:
    """Writes <dynamics>; returns what it had, in words."""
    dynamics = holder.get("dynamics")
    if not tags:
        if dynamics is None:
            document.add(holder, "<dynamics " + " ".join(f'{name}="{value}"' for name, value in values.items()) + "/>")
            return []
        document.set(dynamics, **values)
        return [f"{name} {value}" for name, value in dynamics.attributes.items() if name in values]
    if dynamics is None:
        inner = [f"  <{name}>{value}</{name}>" for name, value in values.items()]
        document.add(holder, "<dynamics>", *inner, "</dynamics>")
        return []
    before, new = [], []
    for name, value in values.items():
        one = dynamics.get(name)
        if one is None:
            new.append(f"<{name}>{value}</{name}>")
        else:
            before.append(f"{name} {document.text(one)}")
            document.write(one, value)
    if new:
        document.add(dynamics, *new)
    return before
