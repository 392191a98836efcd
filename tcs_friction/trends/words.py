"""What physics a change is, in words: from what a law's parameters describe and from the part that an effect belongs to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta

from tcs_friction.errors import InputError
from tcs_friction.physics.parameters import Feature, Parameter
from tcs_friction.physics.registry import effect, law
from tcs_friction.trends.changes import Change
from tcs_friction.trends.presence import Presence

SUBSYSTEMS = {
    "bearing": "bearing, damage or dirt",
    "actuator": "motor or drive",
    "structure": "balance, coupling or gear",
    "cable": "a cable that was dressed anew or chafes",
    "sensor": "encoder",
    "timing": "timing of drive or bus",
    "environment": "surroundings",
}
ALIKE = 3.0  # standard deviations within which relative changes are the same


def feature_of(law_name: str, parameter: str) -> Feature | None:
    """What of the friction a parameter of a law describes; None of others."""
    declared = _declared(law_name, parameter)
    return declared.feature if declared else None


def _declared(law_name: str, parameter: str) -> Parameter | None:
    try:
        return next((p for p in law(law_name).parameters if p.name == parameter), None)
    except InputError:  # a law of a package that is not installed here
        return None


def spoken(parameter: str, law_name: str = "") -> str:
    """A parameter's name as people say it."""
    words = parameter.replace(".", ": ").replace("_", " ")
    declared = _declared(law_name, parameter)
    if declared is None or not parameter.isalpha():
        return words
    if declared.feature is Feature.DRY:
        return f"{words.capitalize()} friction"
    torque = declared.feature is Feature.STRIBECK and declared.unit == "N m"
    return f"{words} friction" if torque or declared.feature is Feature.VISCOUS else words


def date(day: float) -> str:
    """The date of a day since 1970."""
    return f"{datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=day):%Y-%m-%d}"


def when(day: float, earliest: float, latest: float) -> str:
    """A date with as many digits as are known."""
    if latest - earliest > 45.0:
        return f"{date(day)[:7]} (from {date(earliest)} to {date(latest)})"
    return f"{date(day)} (± {max(0.5 * (latest - earliest), 0.5):.0f} days)"


def amount(change: Change) -> str:
    """`14.0 ± 0.3 % up`, or in the parameter's unit where the level is near zero."""
    way = "up" if change.size > 0.0 else "down"
    share = abs(change.level) / abs(change.size)
    if share > 3.0 or (share > 0.2 and change.parameter != "offset"):
        scale = 100.0 / abs(change.level)
        return f"{abs(change.size) * scale:.3g} ± {change.std * scale:.2g} % {way}"
    return f"{abs(change.size):.3g} ± {change.std:.2g} {change.unit} {way}"


def cause(law_name: str, changes: Sequence[Change], presences: Sequence[Presence]) -> str:
    """What may have happened to the axis."""
    if presences:
        return _cause_of_effects(presences)
    own = [change for change in changes if "." not in change.parameter]
    parts = {feature_of(law_name, change.parameter) for change in own}
    names = {change.parameter for change in own}
    if _scaled_alike(own):
        return "torque constant or current sensor, since every torque changed by the same factor"
    rises = any(change.size > 0.0 for change in own if feature_of(law_name, change.parameter) is not None)
    if Feature.DRY in parts and Feature.VISCOUS in parts:
        return "the lubricant, aged or thickened" if rises else "the lubricant, renewed or thinned"
    if Feature.DRY in parts:
        return "lubrication or preload" if rises else "preload lost, or new lubricant"
    if Feature.VISCOUS in parts:
        return "the lubricant, its viscosity or amount"
    if Feature.STRIBECK in parts or Feature.PRESLIDING in parts:
        return "lubrication or preload of the bearing, at rest and at low speed"
    if "inertia" in names:
        return "what is mounted on the axis, or the torque constant"
    if "offset" in names:
        return "balance, a cable, or the zero of the torque sensor"
    named = sorted({change.parameter.partition(".")[0] for change in changes} - names)
    return _subsystems(named) or "not known"


def _cause_of_effects(presences: Sequence[Presence]) -> str:
    first = max(presences, key=lambda one: one.torque_rms)
    verb = "" if first.appears else " (repaired, or no longer seen)"
    return _subsystems([first.effect, *first.equivalent]) + verb


def _subsystems(names: Iterable[str]) -> str:
    found = []
    for name in names:
        try:
            found.append(effect(name).subsystem)
        except InputError:  # an effect of a package that is not installed here
            continue
    return ", or ".join(dict.fromkeys(SUBSYSTEMS.get(part, part) for part in found))


def _scaled_alike(changes: Sequence[Change]) -> bool:
    """Whether inertia and at least two other parameters changed by the same factor."""
    relative = [(change.relative, change.std / abs(change.level)) for change in changes if change.level]
    if "inertia" not in {change.parameter for change in changes} or len(relative) < 3:
        return False
    middle = sorted(value for value, _ in relative)[len(relative) // 2]
    return all(abs(value - middle) < ALIKE * std + 0.1 * abs(middle) for value, std in relative)
