"""How a drive is prepared, by SDO: heartbeats, limits, PDOs, mode. In a thread, since every answer may take a while."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from tcs_friction.errors import JobError
from tcs_friction.nodes.drivers import object_dictionary as od
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings, Scale
from tcs_friction.nodes.drivers.cia402 import CYCLIC_SYNCHRONOUS_TORQUE

try:
    import canopen
except ModuleNotFoundError:  # of the optional set canopen
    canopen = None

EVERY_SYNC = 1
QUICK_STOP = {od.QUICK_STOP_OPTION: 2, od.LOST_OPTION: 3}
"""Slow down and switch off at a quick stop; do that when the heartbeat of this driver fails."""
RECEIVED = (od.CONTROLWORD, od.TARGET)
FIRST_SENT = (od.STATUSWORD, od.POSITION, od.MODE_SHOWN)
CURRENT_TAKEN = "has no torque 0x6077: its current 0x6078, of the rated one, is taken for it of the rated torque"
TORQUES = {od.TORQUE: "", od.CURRENT: CURRENT_TAKEN}
"""What a drive may say of its torque, in per mille, and what is said of that."""
NO_TORQUE = "says no torque (0x6077, 0x6078): what is commanded is taken for it"
REVOLUTIONS, SECONDS = 0xB4, {0x03: 1.0, 0x47: 60.0}
"""Of a unit of speed as CiA 303-2 writes it: numerator, and seconds of the denominator."""


class Unreachable(Exception):  # noqa: N818
    """The drive does not answer (yet)."""


class Objects:
    """The drive's objects. Raises Unreachable for no answer, JobError for a refusal."""

    def __init__(self, node: Any) -> None:
        self._node = node

    def read(self, index: int, sub: int = 0) -> int:
        try:
            return int(self._at(index, sub).raw)
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError, KeyError) as error:
            raise self._failure(error, index, "cannot be read") from None

    def write(self, index: int, value: int, sub: int = 0) -> None:
        try:
            self._at(index, sub).raw = value
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError, KeyError) as error:
            raise self._failure(error, index, f"refuses {value}") from None

    def has(self, index: int, sub: int = 0) -> bool:
        """Whether there is such an object, as far as the drive lets it be read."""
        try:
            self.read(index, sub)
        except JobError:
            return False
        return True

    def _at(self, index: int, sub: int) -> Any:
        entry = self._node.sdo[index]
        return entry[sub] if sub else entry

    def _failure(self, error: Exception, index: int, what: str) -> Exception:
        if isinstance(error, canopen.SdoCommunicationError):
            return Unreachable(f"node {self._node.id} does not answer")
        reason = f"0x{error.code:08X}" if isinstance(error, canopen.SdoAbortedError) else "no such object"
        return JobError(f"node {self._node.id}", f"0x{index:04X} {what} ({reason})", "a drive with profile CiA 402")


@dataclass(frozen=True)
class Prepared:
    """A drive that is ready: its scale, what of it is not as wished, and whether it says its torque."""

    scale: Scale
    notes: list[str]
    says_torque: bool


def prepare(node: Any, settings: DriveSettings, linear: bool, period: float, torque_limit: float) -> Prepared:
    """Prepare a canopen.RemoteNode, up to `operational`.

    period: of SYNC, s. torque_limit: at the axis, N m. Raises Unreachable, or JobError where the axis would not be safe.
    """
    objects = Objects(node)
    node.nmt.state = "PRE-OPERATIONAL"
    objects.read(od.STATUSWORD)
    rated = settings.rated_torque or _rated(objects, settings)
    scale = Scale(settings, linear, rated)
    _choose_mode(objects, settings)
    objects.write(od.CONSUMER, settings.own_id << 16 | round(settings.silence * 1e3), 1)
    objects.write(od.PRODUCER, round(settings.heartbeat * 1e3))
    _limit(objects, settings, scale.limit(torque_limit))
    _wish(objects, {od.SYNC_PERIOD: round(period * 1e6)})
    notes = [f"{note}: what it does then is its own setting" for note in _wish(objects, QUICK_STOP)]
    notes += [*_steepen(objects, scale.limit(torque_limit), period), *_other_units(objects, settings)]
    torque = next((index for index in TORQUES if objects.has(index)), None)
    notes += [note for note in [NO_TORQUE if torque is None else TORQUES[torque]] if note]
    _map(node, torque)
    objects.write(od.TARGET, 0)
    node.nmt.state = "OPERATIONAL"
    return Prepared(scale, notes, torque is not None)


def _steepen(objects: Objects, per_mille: int, period: float) -> list[str]:
    """A drive with a torque slope gets one from limit to limit in a period; the one that it has where it refuses."""
    if not objects.has(od.SLOPE):
        return []
    wanted = math.ceil(2.0 * per_mille / period)
    _wish(objects, {od.SLOPE: wanted})
    found = objects.read(od.SLOPE)
    if found >= wanted:
        return []
    late = 2.0 * per_mille / max(found, 1)
    return [f"torque slope (0x6087) stays {found} per mille/s: a torque may come up to {late:.2g} s late"]


def _other_units(objects: Objects, settings: DriveSettings) -> list[str]:
    """Where the drive's factor group gives position or speed another unit than the settings do."""
    notes = []
    if objects.has(od.FEED, 1):
        feed, turns = objects.read(od.FEED, 1), objects.read(od.FEED, 2)
        motor, shaft = (objects.read(od.GEAR_RATIO, sub) if objects.has(od.GEAR_RATIO, sub) else 1 for sub in (1, 2))
        counts = feed * shaft / (turns * motor) if turns and motor else math.nan
        if not math.isclose(counts, settings.counts_per_turn, rel_tol=1e-6):
            said = f"its factor group (0x6092, 0x6091) says {counts:.9g} position units in a motor turn"
            notes.append(f"{said}, counts_per_turn is {settings.counts_per_turn:.9g}")
    if objects.has(od.SPEED_UNIT):
        unit = objects.read(od.SPEED_UNIT).to_bytes(4, "big", signed=False)
        power = int.from_bytes(unit[:1], "big", signed=True)
        said_speed = SECONDS.get(unit[2], math.nan) * 10.0**-power if unit[1] == REVOLUTIONS else math.nan
        speed = settings.speed_per_turn or settings.counts_per_turn
        if said_speed == said_speed and not math.isclose(said_speed, speed, rel_tol=1e-6):
            notes.append(f"0x60A9 says {said_speed:g} at one motor turn per s, speed_per_turn is {speed:.9g}")
    return notes


def _rated(objects: Objects, settings: DriveSettings) -> float:
    rated = objects.read(od.RATED_TORQUE) / 1e3 if objects.has(od.RATED_TORQUE) else 0.0
    if not rated:
        raise JobError(f"node {settings.node_id}", "does not say its rated torque (0x6076)", "parameter rated_torque")
    return rated


def _choose_mode(objects: Objects, settings: DriveSettings) -> None:
    if objects.has(od.MODES) and not objects.read(od.MODES) >> (CYCLIC_SYNCHRONOUS_TORQUE - 1) & 1:
        found = f"has no cyclic synchronous torque mode (0x6502 is 0x{objects.read(od.MODES):X})"
        raise JobError(f"node {settings.node_id}", found, "a drive that has it")
    objects.write(od.MODE, CYCLIC_SYNCHRONOUS_TORQUE)


def _limit(objects: Objects, settings: DriveSettings, per_mille: int) -> None:
    """The drive's own limits, of torque and of current. One of them it has to have."""
    if objects.has(od.MOST_TORQUE):
        objects.write(od.MOST_TORQUE, per_mille)
        if objects.read(od.MOST_TORQUE) > per_mille:
            raise JobError(f"node {settings.node_id}", "does not keep to its torque limit (0x6072)", f"at most {per_mille}")
    elif not settings.current_limit:
        raise JobError(f"node {settings.node_id}", "has no torque limit (0x6072)", "parameter current_limit")
    if settings.current_limit:
        rated = objects.read(od.RATED_CURRENT) / 1e3
        if not rated:
            raise JobError(f"node {settings.node_id}", "rated current (0x6075) is 0", "the motor's, for current_limit")
        objects.write(od.MOST_CURRENT, min(65535, int(1e3 * settings.current_limit / rated)))


def _wish(objects: Objects, values: dict[int, int]) -> list[str]:
    """Objects that a drive may lack; what it refuses."""
    notes = []
    for index, value in values.items():
        try:
            objects.write(index, value)
        except JobError as error:
            notes.append(error.found)
    return notes


def _map(node: Any, torque: int | None) -> None:
    """The PDOs, by SYNC: what the drive is told, and what it says. torque: the object that says its torque, None for none."""
    second = (od.SPEED, *([] if torque is None else [torque]), od.ERROR)
    try:
        _map_one(node, node.rpdo[1], 0x200 + node.id, RECEIVED)
        for number, objects in enumerate((FIRST_SENT, second), 1):
            _map_one(node, node.tpdo[number], 0x80 + 0x100 * number + node.id, objects)
    except canopen.SdoCommunicationError:
        raise Unreachable(f"node {node.id} does not answer") from None
    except (canopen.SdoAbortedError, KeyError) as error:
        raise JobError(f"node {node.id}", f"PDOs cannot be mapped ({error})", "a drive whose PDOs can be") from None


def _map_one(node: Any, pdo: Any, identifier: int, objects: tuple[int, ...]) -> None:
    """A drive whose PDOs stand as they are is served where they hold what is wanted."""
    pdo.clear()
    for index in objects:
        pdo.add_variable(index)
    pdo.cob_id, pdo.trans_type, pdo.enabled = identifier, EVERY_SYNC, True
    try:
        pdo.save()
    except canopen.SdoAbortedError as error:
        pdo.read()
        found = [variable.index for variable in pdo.map]
        if found != list(objects) or (pdo.cob_id, pdo.trans_type, pdo.enabled) != (identifier, EVERY_SYNC, True):
            holds = ", ".join(f"0x{index:04X}" for index in found) or "nothing"
            said = f"PDO 0x{pdo.cob_id or 0:X} holds {holds}, of type {pdo.trans_type}, and cannot be mapped (0x{error.code:08X})"
            wanted = ", ".join(f"0x{index:04X}" for index in objects)
            raise JobError(f"node {node.id}", said, f"0x{identifier:X} with {wanted}, of type {EVERY_SYNC}") from None
