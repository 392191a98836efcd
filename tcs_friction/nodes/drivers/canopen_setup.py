"""How a drive is prepared, by SDO: heartbeats, limits, PDOs, mode. In a thread, since every answer may take a while."""

from __future__ import annotations

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
SENT = ((od.STATUSWORD, od.POSITION, od.MODE_SHOWN), (od.SPEED, od.TORQUE, od.ERROR))


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

    def has(self, index: int) -> bool:
        """Whether there is such an object, as far as the drive lets it be read."""
        try:
            self.read(index)
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


def prepare(node: Any, settings: DriveSettings, linear: bool, period: float, torque_limit: float) -> tuple[Scale, list[str]]:
    """Prepare a canopen.RemoteNode, up to `operational`; its scale, and what of it is not as wished.

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
    _map(node)
    objects.write(od.TARGET, 0)
    node.nmt.state = "OPERATIONAL"
    return scale, notes


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


def _map(node: Any) -> None:
    """The PDOs, by SYNC: what the drive is told, and what it says."""
    try:
        _map_one(node.rpdo[1], 0x200 + node.id, RECEIVED)
        for number, objects in enumerate(SENT, 1):
            _map_one(node.tpdo[number], 0x80 + 0x100 * number + node.id, objects)
    except canopen.SdoCommunicationError:
        raise Unreachable(f"node {node.id} does not answer") from None
    except (canopen.SdoAbortedError, KeyError) as error:
        raise JobError(f"node {node.id}", f"PDOs cannot be mapped ({error})", "a drive whose PDOs can be") from None


def _map_one(pdo: Any, identifier: int, objects: tuple[int, ...]) -> None:
    pdo.clear()
    for index in objects:
        pdo.add_variable(index)
    pdo.cob_id, pdo.trans_type, pdo.enabled = identifier, EVERY_SYNC, True
    pdo.save()
