"""A servo drive on a CAN bus, with profile CiA 402 in cyclic synchronous torque mode. No ROS here.

Threads meet in one place. What blocks (SDO, opening the bus) is done in a thread of its own, what arrives is heard in
python-can's; both only call `post`, which has a function run in the executor's thread. Everything cyclic is sent from that
thread: torque, SYNC and heartbeat end when it ends or hangs, and the drive stops by itself.

A period: `tick` sends the newest controlword and torque, then SYNC. On SYNC the drive takes them, measures, and answers with two
PDOs; when both have come they are a state with the stamp of their SYNC. Which SYNC that is, the adapter's own time of the PDOs
says (`sync_times.py`), so that a thread that is late does not make the answer to one SYNC that of the next.
"""

from __future__ import annotations

import logging
import math
import struct
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from tcs_friction.errors import InputError, JobError, nearest, one_line
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings, Scale
from tcs_friction.nodes.drivers.canopen_setup import Prepared, Unreachable, prepare
from tcs_friction.nodes.drivers.cia402 import CYCLIC_SYNCHRONOUS_TORQUE, Command, State, controlword, state_of
from tcs_friction.nodes.drivers.hardware import Hardware, Measured
from tcs_friction.nodes.drivers.object_dictionary import dictionary
from tcs_friction.nodes.drivers.sync_times import SyncTimes

try:
    import can
    import canopen
except ModuleNotFoundError:  # of the optional set canopen
    can = canopen = None

SYNC, NMT_OPERATIONAL = 0x080, 5
RETRY = 0.5  # s between two attempts to reach a drive
UNANSWERED = 0.1  # s without an answer to SYNC until it is said
COUNTED = 50
"""SYNCs of which at least half have to be answered: a loop that hears fewer states is another one than was tuned."""
FIRST, SECOND_PART, COMMAND = struct.Struct("<HiB"), struct.Struct("<ihH"), struct.Struct("<Hh")
WITHOUT_TORQUE = struct.Struct("<iH")
"""The PDOs, as `canopen_setup` maps them; the second of a drive that does not say its torque."""


class CanopenHardware(Hardware):
    """The drive. Refusals that are final become `fault`; a drive that is not there yet is waited for."""

    def __init__(
        self,
        settings: DriveSettings,
        linear: bool,
        period: float,
        torque_limit: float,
        now: Callable[[], int],
        post: Callable[[Callable[[], None]], None],
    ) -> None:
        """now: ROS time in ns. post: has a function called in the executor's thread. Raises InputError for settings."""
        self._objects = dictionary(settings.eds, settings.node_id)
        known = sorted(can.interfaces.VALID_INTERFACES)
        if settings.interface not in known:
            raise InputError("canopen_drive: interface", settings.interface, nearest(settings.interface, known))
        for name in ("can", "canopen"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters of it is said here
        self._settings, self._linear, self._period, self._torque_limit = settings, linear, period, torque_limit
        self._now, self._post = now, post
        self._network: Any = None
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()
        self._begin()

    _says_torque = True

    def _begin(self) -> None:
        """As after the start: nothing is known of the drive."""
        self._scale: Scale | None = None
        self._state, self._mode, self._error = State.UNKNOWN, 0, 0
        self._wanted = self._was_ready = self._was_well = False
        self._torque, self._word = 0.0, 0
        self._waits_since = self._answered = self._heard_at = self._beaten = 0.0  # steady times, s
        self._parts: tuple[int, bytes] = (0, b"")
        self._counted = self._answers = 0
        self.waits = "the drive is being prepared"

    def open(self, heard: Callable[[Measured], None]) -> None:
        self._heard = heard
        self._prepare()

    def reset(self) -> None:
        if self.fault and not (self._thread and self._thread.is_alive()):
            self.fault = ""
            self._begin()
            self._prepare()

    def apply(self, torque: float) -> None:
        if not self._wanted:
            self._wanted, self._waits_since = True, time.monotonic()
        self._torque = torque

    def stop(self, reason: str, exceeded: bool = False) -> None:  # noqa: ARG002
        self._wanted = self._was_ready = False
        self._torque = 0.0

    # Preparing, in a thread

    def _prepare(self) -> None:
        self._syncs = SyncTimes()  # another connection may have another clock
        self._thread = threading.Thread(target=self._reach, args=(self._network,), daemon=True)
        self._network = None
        self._thread.start()

    def _reach(self, old: Any) -> None:
        """Until the drive is prepared, refuses, or the driver ends."""
        _disconnect(old)
        while not self._closed.is_set():
            network = canopen.Network()
            network.NOTIFIER_CYCLE = 0.1
            try:
                network.connect(**self._settings.bus())
                node = network.add_node(self._settings.node_id, self._objects)
                prepared = prepare(node, self._settings, self._linear, self._period, self._torque_limit)
                self._says_torque = prepared.says_torque
                self._subscribe(network, node)
                self._post(partial(self._prepared, network, prepared))
                return
            except JobError as error:
                self._post(partial(self._fail, str(error)))
                _disconnect(network)
                return
            except Exception as error:  # an adapter's own, of any kind
                self._post(partial(self._wait_for, str(error) if isinstance(error, Unreachable) else f"bus: {_words(error)}"))
                _disconnect(network)
                self._closed.wait(RETRY)

    def _subscribe(self, network: Any, node: Any) -> None:
        number = self._settings.node_id
        network.subscribe(0x180 + number, self._on_first)
        network.subscribe(0x280 + number, self._on_second)
        node.nmt.add_heartbeat_callback(self._on_heartbeat)
        node.emcy.add_callback(lambda error: self._post(partial(self._on_emergency, error)))

    def _wait_for(self, what: str) -> None:
        self.waits = what

    def _prepared(self, network: Any, prepared: Prepared) -> None:
        self._network, self._scale, self.notes = network, prepared.scale, prepared.notes
        self._prepared_at = self._heard_at = self._answered = time.monotonic()
        self.waits = "no answer to SYNC yet"

    _prepared_at = 0.0

    # Cyclic, in the executor's thread

    def tick(self) -> None:
        if self._network is None:
            return
        now = time.monotonic()
        self._judge(now)
        self._word = controlword(self._state, self._wanted and not self.fault, self._word)
        try:
            if now - self._beaten >= self._settings.heartbeat - 0.5 * self._period:
                self._beaten = now
                self._network.send_message(0x700 + self._settings.own_id, bytes([NMT_OPERATIONAL]))
            self._send(self._word, self._torque if self._ready() else 0.0)
        except Exception as error:  # an adapter's own, of any kind
            self._fail(f"bus: {_words(error)}")

    def _send(self, word: int, torque: float) -> None:
        assert self._scale is not None
        data = COMMAND.pack(word, self._scale.per_mille(torque))
        self._network.send_message(0x200 + self._settings.node_id, data)
        self._syncs.sent(self._now(), time.monotonic())
        self._network.send_message(SYNC, b"")

    def _judge(self, now: float) -> None:
        """What has not happened in time."""
        settings = self._settings
        if now - self._heard_at > settings.silence:
            self._fail(f"node {settings.node_id}: no heartbeat for {settings.silence:g} s")
        if now - self._answered > UNANSWERED:
            self.waits = f"no answer to SYNC for {UNANSWERED:g} s"
        self._counted += 1
        if self._counted == COUNTED:
            if 2 * self._answers < COUNTED and self._was_well:
                self._fail(f"node {settings.node_id}: answers {self._answers} of {COUNTED} SYNCs in time")
            self._counted = self._answers = 0
        if self._wanted and self.waits and now - self._waits_since > settings.enable_time and not self.fault:
            self._fail(f"node {settings.node_id}: not enabled within {settings.enable_time:g} s: {self.waits}")

    def _ready(self) -> bool:
        return self._wanted and not self.waits and not self.fault

    def _fail(self, reason: str) -> None:
        """The first reason stands: others follow from it."""
        self.fault = self.fault or one_line(reason)

    # What arrives, in python-can's thread

    def _on_first(self, _identifier: int, data: bytes, timestamp: float) -> None:
        self._parts = (self._syncs.answered(timestamp, time.monotonic())[0], bytes(data))

    def _on_second(self, _identifier: int, data: bytes, timestamp: float) -> None:
        (number, stamp), (begun, first) = self._syncs.answered(timestamp, time.monotonic()), self._parts
        kind = SECOND_PART if self._says_torque else WITHOUT_TORQUE
        if number and begun == number and len(first) >= FIRST.size and len(data) >= kind.size:
            speed, *torque, error = kind.unpack_from(data)
            self._post(partial(self._on_answer, stamp, FIRST.unpack_from(first), (speed, *(torque or [math.nan]), error)))

    def _on_heartbeat(self, state: int) -> None:
        self._heard_at = time.monotonic()  # here, so that a late executor is no silent drive
        if state != NMT_OPERATIONAL:
            self._post(partial(self._on_other_state, state))

    # What is made of it, in the executor's thread

    def _on_other_state(self, state: int) -> None:
        just_left = state != 0 and time.monotonic() - self._prepared_at < self._settings.silence
        if self._network is not None and not just_left:
            what = "started anew" if state == 0 else f"is not operational (NMT state {state})"
            self._fail(f"node {self._settings.node_id}: {what}")

    def _on_emergency(self, error: Any) -> None:
        if self._network is not None and error.code & 0xFF00:
            described = f", {error.get_desc()}" if error.get_desc() else ""
            self._fail(f"node {self._settings.node_id}: emergency 0x{error.code:04X}{described}")

    def _on_answer(self, stamp: int, first: tuple[int, int, int], second: tuple[int, float, int]) -> None:
        if self._scale is None:
            return
        self._answered = time.monotonic()
        self._answers += 1
        (status, counts, self._mode), (speed, torque, self._error) = first, second
        self._follow(state_of(status))
        self._heard(Measured(stamp, self._scale.position(counts), self._scale.speed(speed), self._scale.torque(torque)))

    def _follow(self, state: State) -> None:
        """The drive's state: what is still waited for, and what it must not have become."""
        self._state = state
        faulty = state in (State.FAULT, State.REACTION)
        error = f", error 0x{self._error:04X}" if faulty else ""
        if faulty and self._was_well:
            self._fail(f"node {self._settings.node_id}: {state.value}{error}")
        self._was_well |= not faulty
        if state is not State.ENABLED:
            self.waits = f"{state.value}{error}"
        elif self._mode != CYCLIC_SYNCHRONOUS_TORQUE:
            self.waits = f"shows mode {self._mode} instead of {CYCLIC_SYNCHRONOUS_TORQUE}"
        else:
            self.waits = ""
            self._waits_since = self._answered
        if self._was_ready and self.waits:
            self._fail(f"node {self._settings.node_id}: stopped by itself: {self.waits}")
        self._was_ready = self._ready()

    def close(self) -> None:
        self._closed.set()
        if self._network is not None:
            try:
                self._send(Command.QUICK_STOP, 0.0)
            except Exception as error:  # nothing more can be done; the drive misses the heartbeat
                self._fail(f"bus: {_words(error)}")
        if self._thread is not None:
            self._thread.join(2.0)
        _disconnect(self._network)
        self._network = None


def _words(error: Exception) -> str:
    return one_line(str(error) or type(error).__name__)


def _disconnect(network: Any) -> None:
    """Whatever state the adapter is in."""
    try:
        if network is not None and network.bus is not None:
            network.disconnect()
    except Exception as error:
        logging.getLogger(__name__).debug("%s", error)
