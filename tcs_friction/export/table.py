"""Tables for drives, of torque to add: friction over speed and temperature, torque over position, and both as drives take them.

friction   CSV: speed, temperature, torque; lines between the speeds
torque     CSV: position, torque of all effects over the position; lines between the positions
beckhoff   CSV of the objects 0x32CB of AX8000 and AMP8000: n, phi and r of each wave, torque r cos(n angle + phi)
odrive     CSV: 3600 values (N m) over a turn of the motor, as the firmware's anticogging map has them
cia402     CSV: position, 60B2h in 1/1000 of the rated torque (drive: rated_torque of the axis file)
linuxcnc   HAL: a `lincurve` of 16 points over the speed

All are multiplied by the share. Friction has the rest band. What jumps at a reversal jumps between the two speeds nearest to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tcs_friction.control.compensator import rested
from tcs_friction.errors import InputError
from tcs_friction.export.code import identifier, plain
from tcs_friction.export.curve import over_position
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.telling import in_newton_metres, left_out, periodic_over_position
from tcs_friction.physics.steady_friction import over_speed, steady
from tcs_friction.physics.terms import Instance, Place

LOOKS = 800  # speeds at which a curve is known, half of them to each side
SLOWEST = 1e-4  # of the fastest speed: a table begins there
CLOSE = 3e-3  # of the torque: what is left between two points of a table of friction
POINTS_PER_WAVE = 64  # lines between them are (2 pi / 64)^2 / 8, a thousandth, off
MOST_POINTS = 200_000
MAP = 3600  # values of an ODrive's map
THOUSANDTHS = 1000.0
COEFFICIENTS, FIRST_SUBINDEX, HIGHEST_ORDER = 0x32CB, 0x07, 200  # of Beckhoff's drives
LINCURVE = 16  # points of LinuxCNC's component


def export(request: Request) -> Exported:
    """One file of the kind asked for, by default friction."""
    kind = request.kind or "friction"
    text, lines = MAKERS[kind](request)
    c = request.compensation
    if c.share < 1.0:
        lines.insert(0, f"all torque times {c.share:g} (--share)")
    return Exported({request.output: text}, lines)


def curve(request: Request, temperature: float) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (n,) without 0 and the friction (n,) to compensate there."""
    axis, c = request.axis, request.compensation
    if not request.speed > 0.0:
        raise InputError("--speed", f"{request.speed:g}", "a speed above 0")
    half = np.geomspace(SLOWEST * request.speed, request.speed, LOOKS // 2)
    speeds = np.concatenate([-half[::-1], half])
    shaping = tuple(
        item for item in axis.effects if item in over_speed(axis) or (item.thermal and item.term.place is Place.SCALE)
    )
    torque = steady(replace(axis, effects=shaping, actuation_delay=0.0), speeds, temperature)
    return speeds, c.share * np.array(
        [rested(m, v, c.rest_speed, c.rest_torque) for m, v in zip(torque, speeds, strict=True)]
    )


def knots(x: np.ndarray, y: np.ndarray, most: int = LOOKS, close: float = CLOSE) -> np.ndarray:
    """Places of the points that lines between them need to be `close`, the worst first, at most `most`; a gap in the middle."""
    middle = len(x) // 2
    taken = [0, middle - 1, middle, len(x) - 1]
    while len(taken) < most:
        taken.sort()
        off = _off(x, y, taken)
        worst = int(np.argmax(off))
        if off[worst] <= close:
            break
        taken.append(worst)
    return np.array(sorted(taken))


def friction(request: Request) -> tuple[str, list[str]]:
    """Over speed and temperature, with the same speeds at each temperature."""
    axis = request.axis
    curves = [curve(request, temperature) for temperature in request.temperatures]
    taken = np.unique(np.concatenate([knots(*one) for one in curves]))
    unit, torque = axis.unit("rad/s"), axis.unit("N m")
    rows = [f"speed ({unit}),temperature (degC),torque ({torque})"]
    for temperature, (speeds, values) in zip(request.temperatures, curves, strict=True):
        rows += [f"{v:.9g},{temperature:g},{m:.9g}" for v, m in zip(speeds[taken], values[taken], strict=True)]
    off = max(_off(*one, taken).max() for one in curves)
    lines = [f"friction at {len(taken)} speeds up to {request.speed:g} {unit}: at most {100.0 * off:.2g} % off between them"]
    if axis.bristle > 0.0:
        lines.append(f"{axis.friction.term.words}: pre-sliding is not in it, the torque is that of steady sliding")
    thermal = [item.identity for item in axis.effects if item.thermal]
    if thermal and len(request.temperatures) == 1:
        lines.append(f"temperature: only {request.temperatures[0]:g} degC (--temperatures)")
    return "\n".join(rows) + "\n", lines + list(left_out(axis, thermal))


def _off(x: np.ndarray, y: np.ndarray, taken: Sequence[int] | np.ndarray) -> np.ndarray:
    """How far lines between some points are from each point of a curve, over its values; a value near 0 counts a thousandth."""
    return np.abs(np.interp(x, x[taken], y[taken]) - y) / np.maximum(np.abs(y), 1e-3 * np.abs(y).max())


def _lying(request: Request) -> tuple[Instance, ...]:
    """The effects that are a torque of the position alone."""
    items = tuple(
        item for item in request.axis.effects
        if item.term.place is Place.OPPOSING and not item.term.reads and not item.term.states and not item.signals
        and (item.term.coordinate == "position" or item.term.offset)
    )  # fmt: skip
    tables = tuple(
        item for item in request.axis.effects if item.table is not None and item.table.coordinates == ("position",)
    )
    if not items + tables:
        raise InputError(
            str(request.source), "no effect is a torque over the position", "cogging, a spring or gravity in effects"
        )
    return items + tables


def _over(request: Request, places: np.ndarray) -> np.ndarray:
    return request.compensation.share * over_position(request.axis, _lying(request), places)


def torque(request: Request) -> tuple[str, list[str]]:
    """Over the position, on an even grid fine enough for the shortest wave."""
    places, lines = _places(request)
    values, axis = _over(request, places), request.axis
    rows = [f"position ({axis.unit('rad')}),torque ({axis.unit('N m')})"]
    rows += [f"{q:.9g},{m:.9g}" for q, m in zip(places, values, strict=True)]
    return "\n".join(rows) + "\n", lines


def _places(request: Request) -> tuple[np.ndarray, list[str]]:
    start, end = request.travel
    shortest = min(
        [2.0 * math.pi / abs(order) for _, _, order, _, _ in periodic_over_position(request.axis)], default=end - start
    )
    count = max(math.ceil((end - start) / shortest * POINTS_PER_WAVE), 4 * POINTS_PER_WAVE) + 1
    if count > MOST_POINTS:
        raise InputError("--travel", f"{count} points from {start:g} to {end:g}", f"at most {MOST_POINTS}")
    lying, unit = _lying(request), request.axis.unit("rad")
    words = ", ".join(item.words for item in lying)
    lines = [f"{words}: at {count} positions from {start:.4g} to {end:.4g} {unit}, at most 0.2 % of a wave off between them"]
    return np.linspace(start, end, count), lines + _others(request, lying)


def _others(request: Request, items: Iterable[Instance]) -> list[str]:
    lines = list(left_out(request.axis, [item.identity for item in items]))
    return [*lines, f"{request.axis.friction.term.words} and what shapes it over the speed: not in it (--kind friction)"]


def beckhoff(request: Request) -> tuple[str, list[str]]:
    """Order, phase and amplitude of each wave, as the drive's objects hold them."""
    in_newton_metres(request, "the drive")
    if request.axis.kind != "rotary":
        raise InputError(str(request.source), "a linear axis", "a rotary one: the drive counts waves per turn")
    rows, lines = ["index,subindex,name,value,unit"], list[str]()
    done: list[int] = []
    for item, _, order, amplitude, phase in periodic_over_position(request.axis):
        number = len(done)
        if order != round(order) or not order <= HIGHEST_ORDER:
            lines.append(f"{item.words}: not expressed, wave {order:g} is no whole number up to {HIGHEST_ORDER}")
            continue
        amplitude *= request.compensation.share
        degrees = math.degrees(phase + (math.pi if amplitude < 0.0 else 0.0)) % 360.0
        entries = (("n", f"{order:.0f}", ""), ("phi", f"{degrees:.9g}", "deg"), ("r", f"{abs(amplitude):.9g}", "Nm"))
        for k, (name, value, unit) in enumerate(entries):
            where = FIRST_SUBINDEX + 3 * number + k
            rows.append(f"{COEFFICIENTS:04X},{where:02X},Cogging compensation Coef {number} {name},{value},{unit}")
        done.append(item.identity)
    if not done:
        raise InputError(
            str(request.source), "no wave over the position that the drive can hold", "cogging of a whole order"
        )
    lines.append(
        f"{len(done)} waves r cos(n angle + phi) to be added, exactly; angle and sign are those of the recording: try one first"
    )
    return "\n".join(rows) + "\n", lines + _others(request, [i for i in request.axis.effects if i.identity in done])


def odrive(request: Request) -> tuple[str, list[str]]:
    """A map over one turn, and how far it is from closing."""
    in_newton_metres(request, "the drive")
    if request.axis.kind != "rotary":
        raise InputError(str(request.source), "a linear axis", "a rotary one: the map is of a turn")
    values = _over(request, np.linspace(0.0, 2.0 * math.pi, MAP + 1))
    lying = _lying(request)
    lines = [f"{', '.join(item.words for item in lying)}: {MAP} values from angle 0 on, as the recording counts it"]
    open_by = abs(values[-1] - values[0])
    if open_by > CLOSE * np.abs(values).max():
        lines.append(f"the torque does not close with the turn: it jumps by {open_by:.3g} N m at angle 0")
    fastest = max([order for _, _, order, _, _ in periodic_over_position(request.axis)], default=0.0)
    if fastest * POINTS_PER_WAVE > MAP:
        lines.append(
            f"the wave {fastest:g} has only {MAP / fastest:.3g} values: up to {100.0 * math.pi * fastest / MAP:.2g} % of it off"
        )
    rows = ["index,torque (N m)", *(f"{k},{m:.9g}" for k, m in enumerate(values[:-1]))]
    return "\n".join(rows) + "\n", lines + _others(request, lying)


def cia402(request: Request) -> tuple[str, list[str]]:
    """Whole thousandths of the rated torque over the position."""
    rated = request.axis.drive.rated_torque
    if not rated > 0.0:
        raise InputError(
            str(request.source), "rated_torque is missing", "drive: {rated_torque: N m}, of which 60B2h is in thousandths"
        )
    places, lines = _places(request)
    values = np.round(_over(request, places) / rated * THOUSANDTHS)
    if np.abs(values).max() > 32767:
        raise InputError(
            str(request.source), f"a torque of {np.abs(values).max():.0f} thousandths", "at most 32767 (16 bits)"
        )
    lines.append(
        f"rounded to thousandths of {rated:g} {request.axis.unit('N m')}: up to {0.5 * rated / THOUSANDTHS:.3g} off"
    )
    rows = [
        f"position ({request.axis.unit('rad')}),60B2h (1/1000)",
        *(f"{q:.9g},{m:.0f}" for q, m in zip(places, values, strict=True)),
    ]
    return "\n".join(rows) + "\n", lines


def linuxcnc(request: Request) -> tuple[str, list[str]]:
    """A lookup table component with the points where they are needed most."""
    speeds, values = curve(request, request.temperatures[0])
    taken = knots(speeds, values, LINCURVE)
    axis, off = request.axis, _off(speeds, values, taken).max()
    name = f"{identifier(request.joint)}-friction".replace("_", "-")
    rows = [f"# Friction of {plain(axis.name)} over speed: in {axis.unit('rad/s')}, out {axis.unit('N m')} to be added.",
            f"loadrt lincurve names={name} personality={len(taken)}"]  # fmt: skip
    for number, k in enumerate(taken):
        rows += [f"setp {name}.x-val-{number:02d} {speeds[k]:.9g}", f"setp {name}.y-val-{number:02d} {values[k]:.9g}"]
    rows.append(
        f"# addf {name} servo-thread; net the commanded speed to {name}.in and {name}.out to the drive's torque feed-forward"
    )
    where = f"up to {request.speed:g} {axis.unit('rad/s')}, at {request.temperatures[0]:g} degC"
    lines = [f"friction at {len(taken)} speeds {where}: at most {100.0 * off:.2g} % off between them"]
    return "\n".join(rows) + "\n", lines + list(left_out(axis, []))


MAKERS: Mapping[str, Callable[[Request], tuple[str, list[str]]]] = {
    "friction": friction, "torque": torque, "beckhoff": beckhoff, "odrive": odrive, "cia402": cia402, "linuxcnc": linuxcnc,
}  # fmt: skip
