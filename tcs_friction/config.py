"""Axis files: what the simulation believes of an axis, where its signals are, how it is controlled.

    axis:     name, kind, inertia, actuation_delay, friction, effects; sensors and drive for an axis that is simulated
    signals:  where the signals are in a bag (see recording.signals)
    control:  controller, observer, compensator, loop (see control), limits (see control.torque_gate)

Unknown keys are refused with the nearest valid one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tcs_friction.control.compensator import CompensatorConfig, LugreParameters
from tcs_friction.control.config_field import from_mapping
from tcs_friction.control.loop import LoopConfig
from tcs_friction.control.observer import NominalPlant
from tcs_friction.control.observer_settings import ObserverSettings
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.torque_gate import TorqueLimits
from tcs_friction.errors import InputError, nearest
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, Table, instance
from tcs_friction.recording.signals import SignalMap
from tcs_friction.writable import scratch_beside, writing
from tcs_friction.yaml_files import dump_yaml, load_yaml

T = TypeVar("T")

AXIS_KEYS = ("name", "kind", "inertia", "actuation_delay", "friction", "effects", "sensors", "drive", "continuous")
EFFECT_KEYS = ("effect", "parameters", "signal", "table")
SPEED_LOOP = 60.0  # rad/s, crossover of a cautious speed loop
PERIODS = 20.0  # of the control, in a cycle of that crossover
TABLE_KEYS = ("coordinates", "lower", "upper", "values")


@dataclass(frozen=True)
class Control:
    """How an axis is controlled: the configurations of the nodes and of the offline loop."""

    controller: PidConfig = field(default_factory=PidConfig)
    observer: ObserverSettings = field(default_factory=ObserverSettings)
    compensator: CompensatorConfig = field(default_factory=CompensatorConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)
    limits: Mapping[str, float] = field(default_factory=dict)
    """Those of `torque_gate.TorqueLimits` that the file states, by name."""

    def to_mapping(self, axis: Axis) -> dict[str, Any]:
        """The `control:` block of this axis' file; a direction of the compensator that has the axis' friction is left out."""
        content = {name: dict(part) for name, part in asdict(self).items() if part}
        for direction in own_friction(axis):
            if content["compensator"][direction] == own_friction(axis)[direction]:
                del content["compensator"][direction]
        return content


def own_friction(axis: Axis) -> dict[str, dict[str, float]]:
    """What a compensator has for each direction where nothing else is stated: the axis' friction, if it is of a LuGre axis."""
    values, names = axis.friction.values, [entry.name for entry in fields(LugreParameters)]
    if not set(names) <= values.keys():
        return {}
    return {direction: {name: float(values[name]) for name in names} for direction in ("positive", "negative")}


def default_control(axis: Axis, period: float = LoopConfig.period) -> Control:
    """A cautious controller for an axis whose file has no control block: gains in proportion to the inertia.

    The speed loop crosses over at SPEED_LOOP, the position loop at a third of it; only the drive limits torque. All are slower
    where the control period (s) is so long that a cycle of the crossover would have fewer than PERIODS of them: held torque
    lags by half a period, which then takes at most 9 degrees of the phase margin.
    """
    slower = min(1.0, 2.0 * math.pi / (PERIODS * period * SPEED_LOOP))
    controller = PidConfig(
        position_proportional=20.0 * slower,
        velocity_proportional=SPEED_LOOP * slower * axis.inertia,
        velocity_integral=1000.0 * slower**2 * axis.inertia,
        inertia_feedforward=axis.inertia,
        velocity_limit=1e6,
        torque_limit=min(axis.drive.limit, 1e12),
    )
    observer = ObserverSettings(
        NominalPlant(first=axis.inertia),
        bandwidth=ObserverSettings.bandwidth * slower,
        actuation_delay=min(axis.actuation_delay, 0.1),
    )
    compensator = from_mapping(CompensatorConfig, own_friction(axis), "control: compensator")
    return Control(controller, observer, compensator, LoopConfig(period=period))


@dataclass(frozen=True)
class AxisFile:
    """An axis file's content; `signals` and `control` are None where the file has no such block."""

    axis: Axis
    signals: SignalMap | None = None
    control: Control | None = None

    def __post_init__(self) -> None:
        if self.signals is None:
            return
        torque = replace(self.signals.torque, rated=self.axis.drive.rated_torque)
        signals = replace(self.signals, torque=torque)
        object.__setattr__(self, "signals", signals)
        if signals.torque_unit:
            object.__setattr__(self, "axis", replace(self.axis, torque_unit=signals.torque_unit))

    def measured_in(self, torque_unit: str) -> AxisFile:
        """The same about an axis whose recordings hold the torque in this unit, "" for N m or N, which then is everywhere."""
        if self.signals is None or torque_unit == self.axis.torque_unit:
            return self
        signals = replace(self.signals, torque=replace(self.signals.torque, unit=torque_unit))
        return replace(self, signals=signals, axis=replace(self.axis, torque_unit=torque_unit))

    def at(self, signals: SignalMap) -> AxisFile:
        """The same with the signals elsewhere in a bag, of another joint, say."""
        return replace(self, signals=signals)

    def with_axis(self, axis: Axis) -> AxisFile:
        """The same file about another axis."""
        return replace(self, axis=axis)

    def mapped(self, where: Path | str) -> SignalMap:
        """Where the signals are in a bag. Raises InputError, naming the file `where`, when it does not say."""
        if self.signals is None:
            raise InputError(str(where), "no signals block", "signals: {position: ..., torque: ...}")
        return self.signals


def control_of(file: AxisFile) -> Control:
    """How an axis file says to control its axis, or a cautious way where it does not say."""
    return file.control or default_control(file.axis)


def shipped(name: str, folder: str = "config") -> Path:
    """A file of a folder of the checkout or of the installed package; InputError if it has none of that name."""
    prefixes = [prefix for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    places = [Path(__file__).resolve().parents[1] / folder, *(Path(p, "share/tcs_friction", folder) for p in prefixes)]
    for place in places:
        if (place / name).is_file():
            return place / name
    raise InputError(name, f"not in the {folder} folder", f"one of the files in {places[0]}")


def mapping(value: object, where: str, keys: tuple[str, ...] = ()) -> Mapping[str, Any]:
    """`value` as a mapping with none but the given keys (any when empty)."""
    if not isinstance(value, Mapping):
        raise InputError(where, f"{type(value).__name__} {str(value)[:40]!r}", "a mapping")
    for key in value:
        if keys and key not in keys:
            raise InputError(where, f"unknown key {key!r}", nearest(str(key), list(keys)))
    return value


def load_axis(path: Path, inertia: float | None = None) -> AxisFile:
    """Read and check an axis file; InputError names the file, the key and what was expected.

    inertia: of an axis whose file has none; None: it must have one.
    """
    where = str(path)
    content = mapping(load_yaml(path), where, ("axis", "signals", "control"))
    if "axis" not in content:
        raise InputError(where, "no axis block", "axis: {name, inertia, friction, ...}")
    axis = parse_axis(content["axis"], where, inertia)
    signals = (
        SignalMap.from_mapping(content["signals"], where) if content.get("signals") is not None else None
    )
    control = (
        parse_control(content["control"], f"{where}: control", axis) if content.get("control") is not None else None
    )
    return AxisFile(axis, signals, control)


def parse_axis(value: object, source: str = "axis", inertia: float | None = None) -> Axis:
    """The `axis:` block of `source` (a file, say) as an Axis. inertia: where the block has none; None: it must have one."""
    where = f"{source}: axis"
    block = mapping(value, where, AXIS_KEYS)
    if inertia is not None:
        block = {"inertia": inertia, **block}
    for key in ("inertia", "friction"):
        if key not in block:
            raise InputError(
                where, f"{key} is missing", "a positive number" if key == "inertia" else "a friction law"
            )
    parts: dict[str, Any] = {
        "name": str(block.get("name", "axis")),
        "inertia": _number(block["inertia"], f"{where}: inertia"),
        "friction": _parse_friction(block["friction"], f"{where}: friction"),
        "effects": _parse_effects(_given(block, "effects", []), f"{where}: effects"),
        "kind": str(block.get("kind", "rotary")),
        "actuation_delay": _number(block.get("actuation_delay", 0.0), f"{where}: actuation_delay"),
        "sensors": _parse_numbers(Sensors, _given(block, "sensors", {}), f"{where}: sensors"),
        "continuous": _given(block, "continuous", False),
        "drive": _parse_numbers(Drive, _given(block, "drive", {}), f"{where}: drive"),
    }
    if not isinstance(parts["continuous"], bool):
        raise InputError(f"{where}: continuous", repr(parts["continuous"]), "true or false")
    try:
        return Axis(**parts)
    except InputError as error:
        raise InputError(f"{source}: {error.where}", error.found, error.expected) from None


def _given(block: Mapping[str, Any], key: str, default: object) -> object:
    """The key's value, or the default where it is absent or left empty."""
    value = block.get(key)
    return default if value is None else value


def parse_control(value: object, where: str, axis: Axis) -> Control:
    """The `control:` block of an axis' file. Friction that it does not state is that of the axis."""
    block = mapping(value, where, tuple(entry.name for entry in fields(Control)))
    stated = dict(mapping(_given(block, "compensator", {}), f"{where}: compensator"))
    for direction, own in own_friction(axis).items():
        stated[direction] = {**own, **mapping(stated.get(direction, {}), f"{where}: compensator: {direction}")}
    block = {**block, "compensator": stated}
    kinds: dict[str, Any] = {
        "controller": PidConfig,
        "observer": ObserverSettings,
        "compensator": CompensatorConfig,
        "loop": LoopConfig,
        "limits": TorqueLimits,
    }
    parts = {
        name: from_mapping(kinds[name], mapping(part, f"{where}: {name}"), f"{where}: {name}")
        for name, part in block.items()
    }
    if "limits" in parts:
        parts["limits"] = {name: getattr(parts["limits"], name) for name in block["limits"]}
    return Control(**parts)


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(where, repr(value), "a finite number")
    return float(value)


def _parse_numbers(kind: type[T], value: object, where: str) -> T:
    names = tuple(entry.name for entry in fields(kind))  # type: ignore[arg-type]
    block = mapping(value, where, names)
    numbers = {name: _number(entry, f"{where}: {name}") for name, entry in block.items()}
    for name, number in numbers.items():
        if number < 0.0:
            raise InputError(f"{where}: {name}", repr(number), "a number from 0")
    return kind(**numbers)


def _parse_friction(value: object, where: str) -> Instance:
    block = mapping(value, where)
    if "law" not in block:
        raise InputError(where, "law is missing", "the name of a friction law")
    term = law(str(block["law"]), where)
    values = {name: entry for name, entry in block.items() if name != "law"}
    return instance(term, values, f"{where} {term.id}")


def _parse_effects(value: object, where: str) -> tuple[Instance, ...]:
    if not isinstance(value, list):
        raise InputError(where, f"{type(value).__name__}", "a list of {effect, parameters}")
    return tuple(_parse_effect(entry, f"{where}[{i}]") for i, entry in enumerate(value))


def _parse_effect(value: object, where: str) -> Instance:
    block = mapping(value, where, EFFECT_KEYS)
    if "effect" not in block:
        raise InputError(where, "effect is missing", "the name of an effect")
    term = effect(str(block["effect"]), where)
    parameters = mapping(_given(block, "parameters", {}), f"{where} {term.id}: parameters")
    table = (
        _parse_table(block["table"], f"{where} {term.id}: table") if block.get("table") is not None else None
    )
    signal = str(block["signal"]) if block.get("signal") is not None else None
    return instance(term, parameters, f"{where} {term.id}", signal, table)


def _parse_table(value: object, where: str) -> Table:
    block = mapping(value, where, TABLE_KEYS)
    try:
        values = np.asarray(block["values"], dtype=np.float64)
        coordinates = tuple(str(name) for name in block["coordinates"])
        lower, upper = (tuple(float(x) for x in block[key]) for key in ("lower", "upper"))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            where, f"cannot be read ({error!r})", "coordinates, lower, upper and a grid of values"
        ) from None
    dimensions = {values.ndim, len(coordinates), len(lower), len(upper)}
    if (
        len(dimensions) != 1
        or values.ndim not in (1, 2)
        or not np.isfinite(values).all()
        or min(values.shape) < 2
    ):
        raise InputError(
            where,
            f"values of shape {values.shape} over {coordinates}",
            "a finite grid over one or two coordinates",
        )
    if not all(high > low for low, high in zip(lower, upper, strict=True)):
        raise InputError(where, f"range {lower} to {upper}", "lower below upper")
    return Table(coordinates, lower, upper, values)


def axis_mapping(axis: Axis) -> dict[str, Any]:
    """The `axis:` block that `parse_axis` reads back to an equal axis; defaults are left out."""
    block: dict[str, Any] = {"name": axis.name, "kind": axis.kind, "inertia": float(axis.inertia)}
    if axis.actuation_delay:
        block["actuation_delay"] = float(axis.actuation_delay)
    if axis.continuous:
        block["continuous"] = True
    block["friction"] = {"law": axis.friction.term.id, **_plain(axis.friction.values)}
    block["effects"] = [_effect_mapping(item) for item in axis.effects]
    for name, part in (("sensors", axis.sensors), ("drive", axis.drive)):
        changed = {key: value for key, value in asdict(part).items() if value != asdict(type(part)())[key]}
        if changed:
            block[name] = _plain(changed)
    return block


def _plain(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _effect_mapping(item: Instance) -> dict[str, Any]:
    defaults = {p.name: p.default for p in item.term.parameters}
    values = {name: float(value) for name, value in item.values.items() if value != defaults[name]}
    block: dict[str, Any] = {"effect": item.term.id, "parameters": values}
    if item.signal is not None:
        block["signal"] = item.signal
    if item.table is not None:
        table = item.table
        block["table"] = {
            "coordinates": list(table.coordinates),
            "lower": [float(x) for x in table.lower],
            "upper": [float(x) for x in table.upper],
            "values": table.values.tolist(),
        }
    return block


def axis_file_mapping(file: AxisFile) -> dict[str, Any]:
    """The whole axis file as YAML would give it."""
    content: dict[str, Any] = {"axis": axis_mapping(file.axis)}
    if file.signals is not None:
        content["signals"] = file.signals.to_mapping()
    if file.control is not None:
        content["control"] = file.control.to_mapping(file.axis)
    return content


def save_axis(path: Path, file: AxisFile, comment: str = "") -> None:
    """Write an axis file; `comment` lines go on top. The file appears whole or not at all."""
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_whole(path, head + dump_yaml(axis_file_mapping(file)))


def write_whole(path: Path, text: str) -> None:
    """Write a text file through a temporary name, so that nothing half-written is left under the final one."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """The same for any content; JobError names the file where the system refuses it."""
    partial = scratch_beside(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(content)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
