"""MJCF: into the user's own model. Joint damping, dry friction, armature, spring; bristles and cogging as motors without input.

MuJoCo's `dcmotor` with input none is nothing but its friction (LuGre) and its cogging; where the installed MuJoCo has none, or no
MuJoCo is installed, the joint has Coulomb and viscous friction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any
from xml.sax.saxutils import escape

from tcs_friction.errors import InputError, TcsError, nearest
from tcs_friction.export.curve import fitted, spring
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.telling import bristles, how_well, in_newton_metres, left_out, periodic_over_position
from tcs_friction.export.xml_edit import Document, Element
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.mujoco_axis import MujocoSimulator, engine
from tcs_friction.physics.registry import usual_law
from tcs_friction.physics.terms import Feature, Instance, Place, instance

KINDS = {"hinge": "rotary", "slide": "linear"}
FRICTION = ("damping", "frictionloss", "stiffness", "springref", "armature")
NO_INPUT = 'motorconst="1e-9" resistance="1" input="none"'
KEYS = ("lugre", "cogging", "biasprm")
LUGRE = ("stiffness", "damping", "coulomb", "static", "stribeck_velocity")
POWERS = 3  # of speed and position, in a MuJoCo whose damping and stiffness are polynomials
PROBE = (
    '<mujoco><worldbody><body><joint name="j" damping="1 1 1" stiffness="1 1 1"/><geom size="1"/></body></worldbody>'
    f'<actuator><dcmotor joint="j" {NO_INPUT} lugre="1 1 1 1 1" cogging="1 1 1"/></actuator></mujoco>'
)


def export(request: Request) -> Exported:
    """The model with the axis as its joint."""
    in_newton_metres(request, "MuJoCo")
    document = Document(request.model(), str(request.into), "mujoco")
    joint = _joint(document, request)
    modern = _modern()
    lines = [f"was there: {words}" for words in found_there(document, joint)]
    before = dict(joint.attributes)
    values, told = _armature(request)
    lines += told
    plan = _plan(request, modern)
    values |= plan.joint
    if "springref" in values and request.axis.kind == "rotary" and not _radian(document):
        values["springref"] = f"{math.degrees(float(values['springref'])):.9g}"
    for name in FRICTION:
        if name not in values and (
            name in before or (name != "armature" and name != "springref" and _by_default(document, name))
        ):
            values[name] = "0" if name != "armature" else before.get(name, "0")
    document.set(joint, **values)
    _act(document, request.joint, plan.actuators)
    return Exported({request.output: document.changed()}, [*lines, *plan.lines])


def _act(document: Document, joint: str, wanted: list[str]) -> None:
    """Actuators take the place of the joint's old ones of their kind; what is left of these goes, what is new stands last."""
    old, new = frictional(document, joint), []
    for line in wanted:
        kind = next(name for name in KEYS if f" {name}=" in line)
        place = next((one for one in old if kind in one.attributes), None)
        if place is None:
            new.append(line)
        else:
            old.remove(place)
            document.replace(place, line)
    for one in old:
        document.remove(one)
    holder = document.root.get("actuator")
    if new and holder is None:
        document.add(document.root, "<actuator>", *(f"  {line}" for line in new), "</actuator>")
    elif new and holder is not None:
        document.add(holder, *new)


@dataclass(frozen=True)
class _Plan:
    """What is written: attributes of the joint, actuators, and what is said of them."""

    joint: dict[str, str]
    actuators: list[str]
    lines: list[str]


def _plan(request: Request, modern: bool) -> _Plan:
    axis, powers, own = request.axis, POWERS if modern else 1, escape(request.joint, {'"': "&quot;"})
    bristle = as_bristle(axis.friction) if modern else None
    known = None if bristle is None else replace(axis, friction=bristle, effects=())
    if known is not None:
        known = known.with_friction({p.name: 0.0 for p in known.friction.term.parameters if p.feature is Feature.VISCOUS})
    fit = fitted(axis, request.speed, powers, known)
    joint, actuators, lines, done = {"damping": _numbers(fit.damping)}, [], [], set()
    if bristle is not None:
        values = " ".join(f"{bristle.values[name]:.9g}" for name in LUGRE)
        actuators.append(f'<dcmotor name="{own}_friction" joint="{own}" {NO_INPUT} lugre="{values}"/>')
        lines += [f"dry friction with its bristles as dcmotor {request.joint}_friction (LuGre)"]
        lines += how_well(fit, axis, "LuGre and damping")
    else:
        joint["frictionloss"] = f"{fit.dry:.9g}"
        lines += [*how_well(fit, axis, "frictionloss and damping"), *bristles(axis)]
    if modern:
        for item, number, order, amplitude, phase in periodic_over_position(axis):
            name = f"{own}_{item.term.id}_{order:g}".replace(".", "_")
            wave = f"{amplitude:.9g} {order:.9g} {phase - 0.5 * math.pi:.9g}"
            actuators.append(f'<dcmotor name="{name}" joint="{own}" {NO_INPUT} cogging="{wave}"/>')
            lines.append(f"{item.words}, harmonic {number}: as dcmotor {name}, exactly")
            done.add(item.identity)
    springs = tuple(item for item in axis.effects if item.term.neutral)
    if springs:
        found = spring(axis, springs, request.travel, powers)
        joint |= {"stiffness": _numbers(found.stiffness), "springref": f"{found.neutral:.9g}"}
        words = " and ".join(item.words for item in springs)
        reach = f"from {request.travel[0]:.3g} to {request.travel[1]:.3g} {axis.unit('rad')}"
        lines.append(f"{words}: as stiffness, {100.0 * found.off:.2g} % of its torque left over {reach}")
        done |= {item.identity for item in springs}
    for item in axis.effects:
        if item.term.offset and item.term.place is Place.OPPOSING:
            push = f'gainprm="0" biastype="affine" biasprm="{-item.values[item.term.offset]:.9g} 0 0"'
            actuators.append(f'<general name="{own}_{item.term.id}" joint="{own}" {push}/>')
            lines.append(f"{item.words}: as actuator {request.joint}_{item.term.id}, exactly")
            done.add(item.identity)
    lines += left_out(axis, done, "if it is gravity, the model has its own")
    return _Plan(joint, actuators, lines)


def _numbers(values: tuple[float, ...]) -> str:
    """Coefficients without the zeros at their end, beside which a coefficient is rounding."""
    largest = max(map(abs, values))
    kept = [value if abs(value) > 1e-9 * largest else 0.0 for value in values]
    while len(kept) > 1 and kept[-1] == 0.0:
        kept.pop()
    return " ".join(f"{value:.9g}" for value in kept)


def as_bristle(friction: Instance) -> Instance | None:
    """A law with bristles as the usual law with all features, what it lacks at no effect; None for one without."""
    if not friction.term.bristle(friction.values) > 0.0:
        return None
    whole, known = usual_law(frozenset(Feature)), dict(friction.values_of_law)
    dry = friction.values[friction.term.level.name]
    spare = {"static": max(known.get("static", dry), dry), "stribeck_velocity": 1.0, "damping": 0.0, "viscous": 0.0}
    stiffness = dry / friction.term.bristle(friction.values)
    values = {p.name: known.get(p.name, spare.get(p.name, dry)) for p in whole.parameters}
    return instance(whole, values | {"stiffness": known.get("stiffness", stiffness)})


def _joint(document: Document, request: Request) -> Element:
    bodies = [joint for body in document.root.all("body") for joint in body.children if joint.tag == "joint"]
    named = {joint.attributes.get("name", ""): joint for joint in bodies}
    if request.joint not in named:
        included = ", ".join(one.attributes.get("file", "") for one in document.root.all("include"))
        hint = f"; it includes {included}, which may have it" if included else ""
        raise InputError(
            document.where, f"no joint {request.joint}{hint}", f"{nearest(request.joint, filter(None, named))} (--joint)"
        )
    joint = named[request.joint]
    kind = joint.attributes.get("type", "hinge")
    if KINDS.get(kind) != request.axis.kind:
        raise InputError(document.where, f"joint {request.joint} is a {kind}", f"the kind of the axis, {request.axis.kind}")
    return joint


def frictional(document: Document, joint: str) -> list[Element]:
    """The actuators of a joint that are nothing but its friction: motors without an input, and constant torques of an export."""
    holder = document.root.get("actuator")
    own = [one for one in (holder.children if holder else []) if one.attributes.get("joint") == joint]
    constant = [
        one for one in own if one.attributes.get("name", "").startswith(f"{joint}_") and one.attributes.get("gainprm") == "0"
    ]
    return [one for one in own if one.tag == "dcmotor" and one.attributes.get("input") == "none"] + constant


def found_there(document: Document, joint: Element) -> list[str]:
    """What of friction, spring and inertia a joint has already, in words."""
    own = [f"{name} {joint.attributes[name]}" for name in FRICTION if name in joint.attributes]
    defaults = [name for name in FRICTION if name not in joint.attributes and _by_default(document, name)]
    found = [f"joint {joint.attributes['name']} with {', '.join(own)}"] if own else []
    found += [f"a default for joints with {', '.join(defaults)}"] if defaults else []
    for one in frictional(document, joint.attributes["name"]):
        words = [
            f"{name} {one.attributes[name]}" for name in ("lugre", "damping", "cogging", "biasprm") if name in one.attributes
        ]
        found.append(f"{one.tag} {one.attributes.get('name', '')} with {', '.join(words)}")
    return found


def _by_default(document: Document, name: str) -> bool:
    return any(
        name in one.attributes for default in document.root.all("default") for one in default.children if one.tag == "joint"
    )


def _radian(document: Document) -> bool:
    return any(one.attributes.get("angle") == "radian" for one in document.root.all("compiler"))


def _modern() -> bool:
    """Whether the installed MuJoCo has motors with LuGre's bristle and damping that is a polynomial."""
    try:
        engine().MjModel.from_xml_string(PROBE)
    except (TcsError, ValueError):
        return False
    return True


def _armature(request: Request) -> tuple[dict[str, str], list[str]]:
    """What the model's own inertia lacks of the axis', as armature; and what is said of it."""
    assert request.into is not None
    unit, wanted = request.axis.unit("kg m^2"), request.axis.inertia
    try:
        model: Any = MujocoSimulator(replace(request.axis, effects=()), request.into, request.joint)
    except InputError as error:
        return {}, [f"inertia: not compared with the model's, armature as it was ({error})"]
    own = model.inertia
    lacks = wanted - own + model.armature
    if lacks < 0.0:
        return {}, [f"inertia: the model has {own:.4g} {unit}, more than the {wanted:.4g} {unit} found; armature as it was"]
    return {"armature": f"{lacks:.9g}"}, [
        f"inertia: {wanted:.4g} {unit} where the model had {own:.4g} {unit}, as armature {lacks:.4g}"
    ]


def read(text: str, where: str, joint: str) -> Mapping[str, tuple[float, ...]]:
    """What a model says of a joint's friction, by attribute: `damping`, `frictionloss`, `lugre`, `cogging` and so on."""
    document = Document(text, where, "mujoco")
    element = next(one for one in document.root.all("joint") if one.attributes.get("name") == joint)
    entries = {name: element.attributes[name] for name in FRICTION if name in element.attributes}
    for one in frictional(document, joint):
        entries |= {name: one.attributes[name] for name in ("lugre", "cogging", "biasprm") if name in one.attributes}
    return {name: tuple(map(float, value.split())) for name, value in entries.items()}


def read_axis(text: str, where: str, joint: str, axis: Axis) -> Axis:
    """`axis` with the friction law that a model has of its joint: the way back."""
    found = read(text, where, joint)
    viscous = found.get("damping", (0.0,))[0]
    if "lugre" in found:
        law = usual_law(frozenset(Feature))
        return replace(
            axis, friction=instance(law, dict(zip(LUGRE, found["lugre"], strict=True)) | {"viscous": viscous}), effects=()
        )
    law = usual_law(frozenset({Feature.DRY, Feature.VISCOUS}))
    return replace(axis, friction=instance(law, {"coulomb": found["frictionloss"][0], "viscous": viscous}), effects=())
