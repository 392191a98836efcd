"""Sentences about what a simulator's numbers say of an axis and what they cannot."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from tcs_friction.errors import InputError
from tcs_friction.export.curve import Fitted
from tcs_friction.export.request import Request
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.steady_friction import over_speed
from tcs_friction.physics.terms import Instance, Place


def in_newton_metres(request: Request, target: str) -> None:
    """Raises InputError for an axis whose torque is known up to a constant: no simulator takes that."""
    unit = request.axis.torque_unit
    if unit:
        found = f"its torque is in {unit}"
        raise InputError(str(request.source), found, f"N m or N for {target}: signals: torque: scale in the axis file")


def how_well(fit: Fitted, axis: Axis, words: str) -> Iterator[str]:
    """Of friction over the speed."""
    speed, torque = axis.unit("rad/s"), axis.unit("N m")
    off = f"at most {100.0 * fit.off:.2g} % off up to {fit.fastest:g} {speed} (at {fit.where:.3g} {speed})"
    yield f"friction over speed as {words}: {off}"
    if fit.uneven > 1e-9 * max(fit.dry, axis.dry_level):
        yield f"difference between directions: not expressed ({fit.uneven:.3g} {torque} rms)"


def bristles(axis: Axis) -> Iterator[str]:
    """What a simulator without bristles loses of the law."""
    if axis.bristle > 0.0:
        travel = f"{axis.bristle:.3g} {axis.unit('rad')} of travel"
        yield f"{axis.friction.term.words}: pre-sliding is not expressed, the axis sticks rigidly ({travel})"


def left_out(axis: Axis, done: Collection[int], gravity: str = "") -> Iterator[str]:
    """A line for each effect that is neither in the friction over speed nor among those expressed (identities)."""
    shown = {item.identity for item in over_speed(axis)} | set(done)
    for item in axis.effects:
        if item.identity not in shown:
            size = _size(axis, item)
            yield f"{item.words}: not expressed{f' ({size})' if size else ''}{_of_model(item, gravity)}"
    if axis.actuation_delay:
        yield f"actuation delay of {1e3 * axis.actuation_delay:g} ms: not expressed"


def _of_model(item: Instance, gravity: str) -> str:
    """Gravity is the model's own."""
    weighs = item.term.coordinate == "position" and item.term.subsystem == "structure"
    return f"; {gravity}" if gravity and weighs else ""


def _size(axis: Axis, item: Instance) -> str:
    """Its largest linear value, in its unit."""
    values = [(abs(item.values[p.name]), p) for p in item.term.parameters if p.role.value == "linear" and item.values[p.name]]
    if item.table is not None:
        return f"up to {np.abs(item.table.values).max():.3g} {axis.unit('N m')}"
    if not values:
        return ""
    value, parameter = max(values, key=lambda pair: pair[0])
    return f"{parameter.name} {value:.3g} {parameter.unit_for(axis.kind, axis.torque_unit)}".rstrip()


def periodic_over_position(axis: Axis) -> list[tuple[Instance, int, float, float, float]]:
    """Each wave of opposing torque over the position: effect, harmonic, order (1/rad of phase), amplitude (N m), phase (rad)."""
    waves = []
    for item in axis.effects:
        if item.term.place is Place.OPPOSING and item.term.periodic == "position":
            for number, harmonic in enumerate(item.term.harmonics, 1):
                amplitude = item.values[harmonic.amplitude.name]
                phase = item.values[harmonic.phase.name] if harmonic.phase is not None else 0.0
                if amplitude:
                    waves.append((item, number, number * item.order * axis.cycle, amplitude, phase))
    return waves
