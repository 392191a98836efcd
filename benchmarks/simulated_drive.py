"""A servo drive with profile CiA 402 on a CAN bus, moved by the simulated axis; faults can be put into it.

It is a `canopen.LocalNode` whose PDOs are mapped by whoever uses it. It watches SYNC and the driver's heartbeat as a drive does,
and stops its axis by itself.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import canopen

from tcs_friction.nodes.drivers import object_dictionary as od
from tcs_friction.nodes.drivers.canopen_settings import WRAP, DriveSettings, Scale
from tcs_friction.nodes.drivers.cia402 import CYCLIC_SYNCHRONOUS_TORQUE, State, after
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.simulate import Simulator

STATUS = {
    State.NOT_READY: 0x0000,
    State.DISABLED: 0x0240,
    State.READY: 0x0221,
    State.SWITCHED_ON: 0x0223,
    State.ENABLED: 0x1227,
    State.QUICK_STOP: 0x0207,
    State.REACTION: 0x020F,
    State.FAULT: 0x0208,
}
"""With bits that mean nothing to the state machine."""
HEARTBEAT, SYNC_LOST = 0x8130, 0x8700
"""Error codes of CiA 301."""
STEP = 1e-3  # s, of the simulation
LOOK_EVERY = 0.005  # s
AT_REST = 1e-4  # rad/s
READ_ONLY = 0x06010002
"""Abort code of CiA 301."""


@dataclass
class Faults:
    """What is wrong with a drive."""

    deaf_to_sync: bool = False
    refuses_mode: bool = False
    """It takes the mode and does not show it."""
    no_such_mode: bool = False
    answers_every: int = 1
    """Of so many SYNCs it answers one."""
    dead: bool = False
    """It says nothing and hears nothing."""
    lacks: tuple[int, ...] = ()
    """Objects that it does not have."""
    has: Mapping[tuple[int, int], int] = field(default_factory=dict)
    """Values of further objects, by index and subindex."""
    keeps: tuple[int, ...] = ()
    """Objects that it does not let be written."""


@dataclass
class SimulatedDrive:
    """The drive on an open bus (arguments of `can.Bus`), until `close`. sync_limit: s without SYNC that make a fault."""

    axis: Axis
    settings: DriveSettings
    bus: dict[str, object]
    rated_torque: float = 1000.0
    sync_limit: float = 0.1
    seed: int = 0
    faults: Faults = field(default_factory=Faults)
    torque: float = 0.0
    """What acts now, N m."""
    state: State = State.DISABLED
    seen: list[State] = field(default_factory=list)
    """The states it has been in."""

    def __post_init__(self) -> None:
        self.scale = Scale(self.settings, self.axis.kind == "linear", self.rated_torque)
        self.simulator = Simulator(self.axis, STEP, self.seed)
        self._lock, self._ended = threading.RLock(), threading.Event()
        self._began, self._steps = time.monotonic(), 0
        self._word, self._target, self._error = 0, 0, 0
        self._synced = self._beaten = 0.0
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.1
        self.network.connect(**self.bus)
        self.node = canopen.LocalNode(self.settings.node_id, od.minimal())
        self.network.add_node(self.node)
        self._boot()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def _boot(self) -> None:
        values = {od.RATED_TORQUE: round(1e3 * self.rated_torque), od.RATED_CURRENT: 10_000, od.MODES: 1 << 9, od.MODE: 0}
        for index, value in {**values, od.MOST_TORQUE: 1000, od.MOST_CURRENT: 1000}.items():
            self._put(index, value)
        for (index, sub), value in self.faults.has.items():
            self.node.set_data(index, sub, self.node.object_dictionary.get_variable(index, sub).encode_raw(value))
        for index in self.faults.lacks:
            del self.node.object_dictionary[index]
        self.node.add_write_callback(self._refuse)
        self._put(od.PRODUCER, 0)
        self.node.add_read_callback(self._read)
        for identifier, hear in ((0x80, self._on_sync), (0x200 + self.settings.node_id, self._on_target)):
            self.network.subscribe(identifier, hear)
        self.network.subscribe(0x700 + self.settings.own_id, self._on_heartbeat)
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def restart(self) -> None:
        """As when its power failed for a moment."""
        with self._lock:
            self._become(State.DISABLED)
            self.node.nmt.state = "INITIALISING"
            self.node.nmt.state = "PRE-OPERATIONAL"

    def emergency(self, code: int) -> None:
        """It says so, and goes on."""
        self.node.emcy.send(code, 1)

    def fail(self, code: int) -> None:
        """It reacts to a fault of its own: transitions 13 and 14."""
        with self._lock:
            if self.state not in (State.FAULT, State.REACTION):
                self._error = code
                self._become(State.REACTION if self.state in (State.ENABLED, State.QUICK_STOP) else State.FAULT)
                self.emergency(code)

    def close(self) -> None:
        self._ended.set()
        self._watcher.join()
        self.node.nmt.stop_heartbeat()
        self.network.disconnect()

    # Objects

    def _put(self, index: int, value: int) -> None:
        self.node.set_data(index, 0, self.node.object_dictionary[index].encode_raw(value))

    def _value(self, index: int, sub: int = 0) -> int:
        variable = self.node.object_dictionary.get_variable(index, sub)
        try:
            return int(variable.decode_raw(self.node.data_store[index][sub]))
        except KeyError:
            return 0

    def _refuse(self, index: int, **_: Any) -> None:
        if index in self.faults.keeps:
            raise canopen.SdoAbortedError(READ_ONLY)

    def _read(self, index: int, **_: Any) -> int | None:
        """The objects that are measured."""
        if index == od.MODES and self.faults.no_such_mode:
            return 0x80
        return int(self._measured()[index]) if index in MEASURED else None

    def _measured(self) -> dict[int, int]:
        axis = self.simulator
        mode = 0 if self.faults.refuses_mode else self._value(od.MODE)
        counts = round(axis.measured_position / self.scale.position_step + self.settings.zero)
        return {
            od.STATUSWORD: STATUS[self.state],
            od.POSITION: (counts + WRAP // 2) % WRAP - WRAP // 2,
            od.MODE_SHOWN: mode,
            od.SPEED: round(axis.measured_velocity / self.scale.speed(1)),
            od.TORQUE: self.scale.per_mille(self.torque),
            od.CURRENT: self.scale.per_mille(self.torque),
            od.ERROR: self._error,
        }

    def _mapped(self, index: int) -> list[Any]:
        """The objects of a PDO."""
        entries = [self._value(index, n + 1) for n in range(self._value(index))]
        return [self.node.object_dictionary[entry >> 16] for entry in entries]

    # The bus

    def _on_target(self, _identifier: int, data: bytes, _timestamp: float) -> None:
        self._received = bytes(data)

    _received, _heard = b"", 0

    def _on_heartbeat(self, _identifier: int, _data: bytes, _timestamp: float) -> None:
        self._beaten = time.monotonic()

    def _on_sync(self, _identifier: int, _data: bytes, _timestamp: float) -> None:
        if self.faults.deaf_to_sync or self.faults.dead or self.node.nmt.state != "OPERATIONAL":
            return
        with self._lock:
            self._synced = time.monotonic()
            self._advance(self._synced)
            self._obey()
            self._heard += 1
            if self._heard % self.faults.answers_every:
                return
            measured = self._measured()
            for number, identifier in enumerate((0x180, 0x280)):
                parts = [variable.encode_raw(measured[variable.index]) for variable in self._mapped(0x1A00 + number)]
                if parts:
                    self.network.send_message(identifier + self.settings.node_id, b"".join(parts))

    def _obey(self) -> None:
        """Take over what the last PDO said."""
        data, at = self._received, 0
        for variable in self._mapped(0x1600):
            part, at = data[at : at + len(variable) // 8], at + len(variable) // 8
            if len(part) == len(variable) // 8:
                self._put(variable.index, variable.decode_raw(part))
        word = self._value(od.CONTROLWORD)
        limit = self._value(od.MOST_TORQUE)
        self._target = max(-limit, min(limit, self._value(od.TARGET)))
        if self.state is State.FAULT and after(State.FAULT, word, self._word) is State.DISABLED:
            self._error = 0
        self._become(after(self.state, word, self._word))
        self._word = word

    def _become(self, state: State) -> None:
        if state is not self.state:
            self.seen.append(state)
        self.state = state

    # The axis

    def _advance(self, now: float) -> None:
        """The periods that are over, under what acted in them."""
        due = int((now - self._began) / STEP)
        for _ in range(min(due - self._steps, 2000)):
            self.torque = self.simulator.step(self._drive_torque())
        self._steps = due

    def _drive_torque(self) -> float:
        if self.state is State.ENABLED and self._value(od.MODE) == CYCLIC_SYNCHRONOUS_TORQUE and not self.faults.refuses_mode:
            return self.scale.torque(self._target)
        if self.state not in (State.QUICK_STOP, State.REACTION):
            return 0.0
        speed = self.simulator.velocity
        if abs(speed) < AT_REST:
            self._become(State.DISABLED if self.state is State.QUICK_STOP else State.FAULT)  # 12, 14
            return 0.0
        return -0.2 * self.rated_torque * max(-1.0, min(1.0, speed / (10.0 * AT_REST)))

    def _watch(self) -> None:
        """What stops the axis when nobody speaks to it any more."""
        while not self._ended.wait(LOOK_EVERY):
            with self._lock:
                now = time.monotonic()
                self._advance(now)
                patience = (self._value(od.CONSUMER, 1) & 0xFFFF) * 1e-3
                if self._beaten and patience and now - self._beaten > patience:
                    self._beaten = 0.0
                    self.fail(HEARTBEAT)
                if self._synced and now - self._synced > self.sync_limit:
                    self._synced = 0.0
                    self.fail(SYNC_LOST)
                if self.faults.dead:
                    self.node.nmt.stop_heartbeat()


MEASURED = (od.STATUSWORD, od.POSITION, od.MODE_SHOWN, od.SPEED, od.TORQUE, od.CURRENT, od.ERROR)
