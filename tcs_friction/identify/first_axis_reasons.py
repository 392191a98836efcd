"""Why each value of a first axis file is what it is, and what a person should look at before a loop is closed with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from tcs_friction.config import PERIODS
from tcs_friction.identify.first_axis import HEADROOM, FirstAxis
from tcs_friction.identify.net_work import Sign
from tcs_friction.identify.result import Estimate
from tcs_friction.recording.recording import Recording

UNEXPLAINED = 1.5  # times the noise, from which a residual is none, as a diagnosis has it: right models left 1.4 on MuJoCo
Path = tuple[str, ...]
"""Keys down to a value in an axis file."""


def reasons(first: FirstAxis, recordings: Sequence[Recording]) -> dict[Path, str]:
    """Of the values of the file, by their paths; those without one are left out."""
    axis, found, control = first.file.axis, first.found, first.file.control
    assert control is not None
    unit, length = axis.unit("N m"), axis.unit("rad")
    rows = [*(f"{one.law} {one.held_out:.3g}" for one in first.rough), *(f"{law} not fitted" for law in first.left_out)]
    slower = control.controller.position_proportional / (2.0 * math.pi)
    speed = control.controller.velocity_proportional / axis.inertia
    integral = control.controller.velocity_integral / axis.inertia
    fastest = control.controller.velocity_limit / HEADROOM
    seconds = sum(one.duration for one in recordings)
    turned = "turned over: it would take energy out of the motion otherwise" if first.work.sign is Sign.TURNED else ""
    noise = f"{unit} rms, what the fit leaves below the encoder's share of the spectrum" if first.drive_noise else ""
    texts: dict[Path, str] = {
        ("axis",): f"from {seconds:.4g} s in {', '.join(one.source for one in recordings)}",
        ("axis", "inertia"): _estimated(found.inertia),
        ("axis", "friction", "law"): f"held-out residual of each, roughly: {', '.join(rows)} {unit}",
        **{("axis", "friction", name): _estimated(estimate) for name, estimate in found.parameters.items()},
        ("axis", "effects"): _of_position(first, unit, length),
        ("axis", "sensors", "noise"): f"{length} rms, from differences of neighbouring positions at their own stamps",
        ("axis", "sensors", "resolution"): f"{length}, of which all positions are multiples",
        ("axis", "drive", "limit"): f"{unit}, the largest recorded: whether it can do more is not known",
        ("axis", "drive", "noise"): noise,
        ("axis", "drive", "noise_bandwidth"): "Hz, where that spectrum begins to fall" if first.drive_noise else "",
        ("control", "controller", "velocity_limit"): f"{length}/s, {HEADROOM:g} times the fastest recorded ({fastest:.3g})",
        ("control", "controller", "torque_limit"): f"{unit}, as the drive's",
        ("control", "controller", "position_proportional"): f"1/s, cautious: the position loop crosses over at {slower:.2g} Hz",
        ("control", "controller", "velocity_proportional"): f"{speed:.3g} times the inertia: the speed loop crosses over at "
        f"{speed / (2.0 * math.pi):.2g} Hz, a cycle of at least {PERIODS:g} periods",
        ("control", "controller", "velocity_integral"): f"{integral:.4g} times the inertia",
        ("control", "controller", "inertia_feedforward"): "the inertia above",
        ("control", "compensator"): "the friction above, as LuGre's; `./tcs identify --law lugre` fits it",
        ("control", "loop", "period"): f"s, {first.fresh}",
        ("signals", "torque", "scale"): turned,
    }
    return {path: text for path, text in texts.items() if text}


def _of_position(first: FirstAxis, unit: str, length: str) -> str:
    if first.position.gravity is not None:
        return "gravity: it does clearly better than a constant and a straight line over the position"
    if first.position.spring is not None:
        std = float(first.position.balance.std[-1])
        return f"stiffness ± {std:.2g} {unit}/{length}: a straight line over the position, a spring's or gravity's"
    return ""


def _estimated(estimate: Estimate) -> str:
    if not estimate.determined:
        return f"{estimate.unit}, not determined: {estimate.reason}".lstrip(", ")
    spread = f"± {estimate.std:.2g} " if math.isfinite(estimate.std) else ""
    return f"{spread}{estimate.unit}".strip()


def doubts(first: FirstAxis) -> tuple[str, ...]:
    """One line each."""
    return tuple(_doubts(first))


def _doubts(first: FirstAxis) -> Iterator[str]:
    found, motion, axis = first.found, first.motion, first.file.axis
    unit = axis.unit("N m")
    if not found.inertia.determined:
        yield "the inertia, and with it the controller's gains, is not determined: record quicker motion first"
    if first.work.sign is Sign.TURNED:
        yield f"the recorded torque was turned over: {first.work}"
    if first.work.sign is Sign.OPEN:
        yield f"the sign of the torque is not told: {first.work}; push the axis by hand, or command a small torque"
    if not motion.reverses:
        yield "the axis goes one way only, where Coulomb friction is a constant torque: record both ways"
    lacking = [name for name, one in found.parameters.items() if not one.determined]
    if lacking:
        yield f"not determined by this motion: {', '.join(lacking)} of {found.law}"
    if found.rmse.held_out > UNEXPLAINED * found.noise_floor > 0.0:
        more = found.rmse.held_out / found.noise_floor
        left = f"{found.law} leaves {found.rmse.held_out:.3g} {unit} of held-out torque"
        yield f"{left}, {more:.2g} times the noise floor: something is lacking, `./tcs diagnose` looks for it"
    rivals = _rivals(first)
    if rivals:
        yield f"held-out samples do not tell {found.law} from {' and '.join(rivals)}: record reversals and slow motion"
    if first.position.spring is not None:
        yield "the torque grows with the position, as a spring or gravity would have it: over this travel they are not told apart"
    if abs(found.offset.value) > first.largest:
        yield f"a constant torque of {found.offset.value:.3g} {unit} was left out: it is larger than any recorded"
    if first.drive_noise is None:
        yield "the noise of the drive is not told: the recording is too short"


def _rivals(first: FirstAxis) -> list[str]:
    """Other laws that held-out samples like as much as the chosen one."""
    chosen = next(one for one in first.rough if one.law == first.found.law)
    return [one.law for one in first.rough if one is not chosen and one.as_good(chosen)]


