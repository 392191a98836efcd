"""A drive on a CAN bus: prepared, moved, stopped; every fault takes its torque away, whoever has it.

The drive is `canopen.LocalNode` on python-can's virtual bus, moved by the simulated axis.
"""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import wait_until

from tcs_friction.config import load_axis, shipped
from tcs_friction.control.config_field import validate
from tcs_friction.errors import InputError

can = pytest.importorskip("can", reason="of the optional set canopen")
canopen = pytest.importorskip("canopen", reason="of the optional set canopen")

from benchmarks.can_server import CanServer  # noqa: E402
from benchmarks.listening import Listening  # noqa: E402
from benchmarks.simulated_drive import Faults, SimulatedDrive  # noqa: E402
from tcs_friction.nodes.drivers import object_dictionary as od  # noqa: E402
from tcs_friction.nodes.drivers.canopen_hardware import FIRST, SECOND_PART, CanopenHardware  # noqa: E402
from tcs_friction.nodes.drivers.canopen_settings import DriveSettings, Scale  # noqa: E402
from tcs_friction.nodes.drivers.cia402 import State  # noqa: E402
from tcs_friction.nodes.drivers.hardware import Measured  # noqa: E402
from tcs_friction.nodes.drivers.sync_times import SyncTimes  # noqa: E402

PERIOD = 0.01
AXIS = load_axis(shipped("azimuth_1p2m.yaml")).axis
SETTINGS = DriveSettings(
    interface="virtual",
    counts_per_turn=2.0**24,
    gear=4.0,
    heartbeat=0.1,  # a busy machine may stand still for a moment
    enable_time=3.0,
)
DRIVE_LIMIT = 0.6  # s without SYNC


class Rig:
    """A drive, its driver, and the loop in which a node would run it."""

    def __init__(self, channel: str, settings: DriveSettings = SETTINGS, faults: Faults | None = None) -> None:
        self.settings = replace(settings, channel=channel)
        self.posted: deque[Callable[[], None]] = deque()
        self.heard: list[Measured] = []
        self.hardware = CanopenHardware(self.settings, False, PERIOD, 500.0, time.time_ns, self.posted.append)
        self.drive = SimulatedDrive(AXIS, self.settings, self.settings.bus(), 250.0, DRIVE_LIMIT, faults=faults or Faults())
        self.hardware.open(self.heard.append)

    def until(self, done: Callable[[], bool], torque: float | None = None, limit: float = 8.0) -> bool:
        """Let on a torque, or none, until something holds; whether it does within the limit (s)."""
        end = time.monotonic() + limit
        while not done() and time.monotonic() < end:
            while self.posted:
                self.posted.popleft()()
            if torque is None:
                self.hardware.stop("the test wants none")
            else:
                self.hardware.apply(torque)
            self.hardware.tick()
            time.sleep(PERIOD)
        return done()

    def enabled(self, torque: float = 0.0) -> Rig:
        assert self.until(lambda: not self.hardware.waits, torque), (self.hardware.fault, self.hardware.waits)
        assert self.drive.state is State.ENABLED
        return self

    def object(self, index: int, sub: int = 0) -> int:
        return self.drive._value(index, sub)

    def close(self) -> None:
        self.hardware.close()
        self.drive.close()


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Callable[..., Rig]]:
    """Makes a rig on a bus of its own."""
    made: list[Rig] = []

    def make(**changes: Any) -> Rig:
        made.append(Rig(f"{request.node.name}", **changes))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_drive_is_prepared_enabled_moved_and_stopped(rig: Callable[..., Rig]) -> None:
    one = rig(settings=replace(SETTINGS, current_limit=4.0)).enabled()
    assert one.drive.seen == [State.READY, State.SWITCHED_ON, State.ENABLED]
    assert one.object(od.MOST_TORQUE) == 500, "500 N m of 1000 N m at the axis"
    assert one.object(od.MOST_CURRENT) == 400, "4 A of 10 A"
    assert one.object(od.CONSUMER, 1) == 127 << 16 | 300
    assert (one.object(od.PRODUCER), one.object(od.SYNC_PERIOD)) == (100, 10_000)
    assert (one.object(od.QUICK_STOP_OPTION), one.object(od.LOST_OPTION)) == (2, 3)
    assert not one.hardware.notes
    assert one.until(lambda: one.heard[-1].speed > 2e-3, 300.0)
    measured = one.heard[-1]
    assert measured.torque == pytest.approx(300.0, abs=0.51), "the drive says it in per mille of 1000 N m"
    assert measured.position == pytest.approx(one.drive.simulator.position, abs=1e-3)
    stamps = [state.stamp for state in one.heard]
    assert stamps == sorted(set(stamps))
    assert one.until(lambda: one.drive.state is State.DISABLED, None)
    assert State.QUICK_STOP in one.drive.seen
    assert abs(one.drive.simulator.velocity) < 1e-3, "it was slowed down"
    assert not one.hardware.fault
    one.enabled()


def test_a_moment_without_answers_is_no_fault(rig: Callable[..., Rig]) -> None:
    one = rig(settings=replace(SETTINGS, enable_time=0.3)).enabled(50.0)
    one.until(lambda: False, 50.0, 0.4)
    time.sleep(0.12)
    one.enabled(50.0)
    assert not one.hardware.fault


def test_an_answer_that_is_read_after_the_next_sync_has_the_stamp_of_its_own() -> None:
    posted: deque[Any] = deque()
    hardware = CanopenHardware(replace(SETTINGS, channel="late"), False, PERIOD, 500.0, time.time_ns, posted.append)
    hardware._syncs, now = SyncTimes(), time.monotonic()
    for number, before in enumerate((0.2, 0.1), 1):
        hardware._syncs.sent(number, now - before)
    for timestamp in (50.0, 50.0 - 0.15):  # read at once, and a tenth of a second too late
        hardware._on_first(0x181, FIRST.pack(0, 0, 0), timestamp)
        hardware._on_second(0x281, SECOND_PART.pack(0, 0, 0), timestamp)
    assert [answer.args[0] for answer in posted] == [2, 1]


def bus_off(one: Rig) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise can.CanOperationError("bus off")

    one.hardware._network.bus.send = refuse


FAULTS: dict[str, tuple[Callable[[Rig], Any], str]] = {
    "emergency": (lambda one: one.drive.emergency(0x4210), "node 1: emergency 0x4210, Temperature"),
    "fault": (lambda one: one.drive.fail(0x2310), "node 1: emergency 0x2310"),
    "silent fault": (lambda one: one.drive._become(State.FAULT), "node 1: fault, error 0x0000"),
    "lost SYNC": (lambda one: setattr(one.drive.faults, "deaf_to_sync", True), r"node 1: (emergency 0x8700|answers \d+ of 50)"),
    "slow answers": (lambda one: setattr(one.drive.faults, "answers_every", 4), r"node 1: answers \d+ of 50 SYNCs in time"),
    "dead drive": (lambda one: setattr(one.drive.faults, "dead", True), "node 1: no heartbeat for 0.3 s"),
    "restart": (lambda one: one.drive.restart(), "node 1: started anew"),
    "switched off": (lambda one: one.drive._become(State.DISABLED), "node 1: stopped by itself: switch on disabled"),
    "other mode": (lambda one: setattr(one.drive.faults, "refuses_mode", True), "stopped by itself: shows mode 0 instead of 10"),
    "bus off": (bus_off, "bus: bus off"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_takes_the_torque_away_until_somebody_activates_again(name: str, rig: Callable[..., Rig]) -> None:
    happens, words = FAULTS[name]
    one = rig().enabled(200.0)
    assert one.until(lambda: one.drive.torque > 150.0, 200.0)
    happens(one)
    assert one.until(lambda: bool(one.hardware.fault), 200.0)
    assert re.search(words, one.hardware.fault), one.hardware.fault
    assert one.until(lambda: one.drive.state is not State.ENABLED and one.drive.torque <= 0.0, 200.0), one.drive.state
    one.drive.faults = Faults()
    one.until(lambda: False, 200.0, 0.1)
    assert one.drive.state is not State.ENABLED, "not by itself"
    one.hardware.reset()
    one.enabled()


@pytest.mark.parametrize(
    ("faults", "changes", "words"),
    [
        (Faults(no_such_mode=True), {}, "has no cyclic synchronous torque mode (0x6502 is 0x80), expected a drive that has it"),
        (Faults(refuses_mode=True), {"enable_time": 0.5}, "not enabled within 0.5 s: shows mode 0 instead of 10"),
    ],
)
def test_a_drive_that_refuses_the_mode_gets_no_torque(
    faults: Faults, changes: dict[str, float], words: str, rig: Callable[..., Rig]
) -> None:
    one = rig(faults=faults, settings=replace(SETTINGS, **changes))
    assert one.until(lambda: bool(one.hardware.fault), 200.0)
    assert words in one.hardware.fault
    assert one.drive.torque == 0.0
    assert one.hardware.waits


@pytest.mark.parametrize(
    ("index", "words"),
    [
        (od.RATED_TORQUE, "does not say its rated torque (0x6076), expected parameter rated_torque"),
        (od.MOST_TORQUE, "has no torque limit (0x6072), expected parameter current_limit"),
    ],
)
def test_a_drive_that_lacks_what_safety_needs_is_refused(
    index: int, words: str, rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    boot = SimulatedDrive._boot

    def without(drive: SimulatedDrive) -> None:
        boot(drive)
        del drive.node.data_store[index]

    monkeypatch.setattr(SimulatedDrive, "_boot", without)
    one = rig()
    assert one.until(lambda: bool(one.hardware.fault))
    assert words in one.hardware.fault


def test_a_drive_with_a_quick_stop_of_its_own_is_noted(rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch) -> None:
    boot = SimulatedDrive._boot

    def without(drive: SimulatedDrive) -> None:
        boot(drive)
        for index in (od.LOST_OPTION, od.SYNC_PERIOD):
            del drive.node.object_dictionary[index]

    monkeypatch.setattr(SimulatedDrive, "_boot", without)
    assert rig().enabled().hardware.notes == ["0x6007 refuses 3 (0x06020000): what it does then is its own setting"]


CURRENT_FOR_TORQUE = "has no torque 0x6077: its current 0x6078, of the rated one, is taken for it of the rated torque"


@pytest.mark.parametrize(
    ("lacks", "note", "torque"),
    [
        ((od.TORQUE,), CURRENT_FOR_TORQUE, 150.0),
        ((od.TORQUE, od.CURRENT), "says no torque (0x6077, 0x6078): what is commanded is taken for it", math.nan),
    ],
)
def test_a_drive_that_says_no_torque_is_used(lacks: tuple[int, ...], note: str, torque: float, rig: Callable[..., Rig]) -> None:
    one = rig(faults=Faults(lacks=lacks)).enabled(150.0)
    assert one.hardware.notes == [note]
    assert one.until(lambda: one.heard[-1].torque == pytest.approx(torque, abs=0.51, nan_ok=True), 150.0)
    assert one.until(lambda: one.heard[-1].speed > 2e-3, 150.0), "the other numbers are where they are looked for"


def mapped(number: int, identifier: int, *objects: tuple[int, int]) -> dict[tuple[int, int], int]:
    """A PDO as it stands in a drive: communication (at 0x1400, 0x1800) and mapping, of objects with their bits."""
    entries = {(number + 0x200, n): index << 16 | bits for n, (index, bits) in enumerate(objects, 1)}
    return {(number, 1): identifier, (number, 2): 1, (number + 0x200, 0): len(objects), **entries}


FIXED = (0x1400, 0x1600, 0x1800, 0x1A00, 0x1801, 0x1A01)
WANTED = {
    **mapped(0x1400, 0x201, (od.CONTROLWORD, 16), (od.TARGET, 16)),
    **mapped(0x1800, 0x181, (od.STATUSWORD, 16), (od.POSITION, 32), (od.MODE_SHOWN, 8)),
    **mapped(0x1801, 0x281, (od.SPEED, 32), (od.TORQUE, 16), (od.ERROR, 16)),
}


def test_a_drive_whose_pdos_stand_as_they_are_is_used_where_they_fit(rig: Callable[..., Rig]) -> None:
    one = rig(faults=Faults(has=WANTED, keeps=FIXED)).enabled(150.0)
    assert one.until(lambda: one.heard[-1].torque == pytest.approx(150.0, abs=0.51), 150.0)
    assert not one.hardware.notes


def test_a_drive_whose_pdos_stand_otherwise_is_refused_in_one_line(rig: Callable[..., Rig]) -> None:
    other = WANTED | mapped(0x1800, 0x181, (od.STATUSWORD, 16))
    one = rig(faults=Faults(has=other, keeps=FIXED))
    assert one.until(lambda: bool(one.hardware.fault))
    assert one.hardware.fault == (
        "node 1: PDO 0x181 holds 0x6041, of type 1, and cannot be mapped (0x06010002), "
        "expected 0x181 with 0x6041, 0x6064, 0x6061, of type 1"
    )


TURN = round(SETTINGS.counts_per_turn)


@pytest.mark.parametrize(
    ("has", "notes"),
    [
        ({(od.FEED, 1): TURN, (od.FEED, 2): 1}, []),
        ({(od.FEED, 1): 36000, (od.FEED, 2): 1, (od.GEAR_RATIO, 1): 4, (od.GEAR_RATIO, 2): 1},
         [f"its factor group (0x6092, 0x6091) says 9000 position units in a motor turn, counts_per_turn is {TURN}"]),
        ({(od.SPEED_UNIT, 0): 0x00B40300 + 0x4400},
         [f"0x60A9 says 60 at one motor turn per s, speed_per_turn is {TURN}"]),
        ({(od.SPEED_UNIT, 0): 0xFDB44700},
         [f"0x60A9 says 60000 at one motor turn per s, speed_per_turn is {TURN}"]),
        ({(od.SPEED_UNIT, 0): 0x00010300}, []),
    ],
)  # fmt: skip
def test_other_units_of_a_factor_group_are_named(
    has: dict[tuple[int, int], int], notes: list[str], rig: Callable[..., Rig]
) -> None:
    assert rig(faults=Faults(has=has)).enabled().hardware.notes == notes


def test_a_torque_slope_is_set_out_of_the_way_or_named(rig: Callable[..., Rig]) -> None:
    one = rig(faults=Faults(has={(od.SLOPE, 0): 500})).enabled()
    assert one.object(od.SLOPE) == 100_000, "from -500 to 500 per mille in 10 ms"
    assert not one.hardware.notes


def test_a_torque_slope_that_stays_is_named(rig: Callable[..., Rig]) -> None:
    note = "torque slope (0x6087) stays 500 per mille/s: a torque may come up to 2 s late"
    assert rig(faults=Faults(has={(od.SLOPE, 0): 500}, keeps=(od.SLOPE,))).enabled().hardware.notes == [note]


def test_a_drive_is_used_with_its_eds_file(rig: Callable[..., Rig], tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    canopen.export_od(od.minimal(), str(path))
    one = rig(settings=replace(SETTINGS, eds=str(path))).enabled(50.0)
    assert one.until(lambda: one.drive.torque > 45.0, 50.0)


def test_a_drive_that_comes_later_is_waited_for() -> None:
    settings = replace(SETTINGS, channel="later")
    posted: deque[Callable[[], None]] = deque()
    hardware = CanopenHardware(settings, False, PERIOD, 500.0, time.time_ns, posted.append)
    hardware.open(lambda _: None)
    end = time.monotonic() + 5.0
    while "does not answer" not in hardware.waits and time.monotonic() < end:
        time.sleep(0.01)
        while posted:
            posted.popleft()()
    assert hardware.waits == "node 1 does not answer"
    assert not hardware.fault
    drive = SimulatedDrive(AXIS, settings, settings.bus(), 250.0, DRIVE_LIMIT)
    while "prepared" not in str(posted) and time.monotonic() < end:
        time.sleep(0.01)
    hardware.close()
    drive.close()
    assert "prepared" in str(posted)


def test_the_end_of_the_driver_is_a_quick_stop(rig: Callable[..., Rig]) -> None:
    one = rig().enabled(200.0)
    assert one.until(lambda: one.drive.torque > 150.0, 200.0)
    one.hardware.close()
    end = time.monotonic() + 3.0
    while one.drive.torque > 0.0 and time.monotonic() < end:
        time.sleep(0.01)
    assert State.QUICK_STOP in one.drive.seen


@pytest.mark.parametrize("direction", [1, -1])
def test_scales_are_those_of_gear_and_encoder(direction: int) -> None:
    settings = DriveSettings(counts_per_turn=1000.0, speed_per_turn=60.0, gear=10.0, direction=direction, zero=500.0)
    scale = Scale(settings, False, 2.0)
    assert scale.position(500) == 0.0
    assert scale.position(1500) == pytest.approx(direction * 2.0 * math.pi / 10.0)
    assert scale.speed(60) == pytest.approx(direction * 2.0 * math.pi / 10.0)
    assert scale.torque(1000) == pytest.approx(direction * 20.0)
    assert scale.per_mille(-10.0) == -500 * direction
    assert scale.per_mille(1e9) == 32767 * direction
    assert scale.limit(10.0) == 500
    assert scale.limit(9.999) == 499, "never more"
    linear = Scale(replace(settings, gear=200.0), True, 2.0)
    assert linear.position(1500) == pytest.approx(direction * 0.005)
    power = linear.torque(1000) * linear.speed(60)
    assert power == pytest.approx(2.0 * 2.0 * math.pi), "rated torque at one turn per s"


def test_a_position_goes_on_where_its_32_bits_begin_anew() -> None:
    scale = Scale(DriveSettings(counts_per_turn=1000.0), False, 1.0)
    step = 2.0 * math.pi / 1000.0
    end = 2**31 - 1
    positions = [scale.position(counts) / step for counts in (end, -end - 1, end, -end - 1, 0, end - 5, -end)]
    assert positions == pytest.approx([end, end + 1, end, end + 1, 2**32, 2**32 + end - 5, 2**32 + end + 2])


@pytest.mark.parametrize("begin", [-500, 0])
def test_a_position_goes_on_where_an_encoder_of_a_turn_begins_anew(begin: int) -> None:
    scale = Scale(DriveSettings(counts_per_turn=1000.0, position_range=1000.0), False, 1.0)
    found = [scale.position((counts - begin) % 1000 + begin) for counts in range(900, 3300, 100)]
    assert np.diff(found) == pytest.approx(2.0 * math.pi / 10.0)
    back = [scale.position((counts - begin) % 1000 + begin) for counts in range(3100, 800, -100)]
    assert back == pytest.approx(found[-2::-1])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"direction": 0}, "direction is 0, expected 1 or -1"),
        ({"own_id": 1}, "own_id is 1, expected another than node_id"),
        ({"bus_options": ("port",)}, "bus_options has 'port', expected NAME=VALUE"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        validate(replace(SETTINGS, **changes), "canopen_drive")


def test_options_of_an_adapter_are_numbers_truths_and_texts() -> None:
    settings = DriveSettings(bus_options=("host = pi", "port=29536", "tcp_tune=true", ""))
    wanted = {"interface": "socketcan", "channel": "can0", "bitrate": 1000000, "host": "pi", "port": 29536, "tcp_tune": True}
    assert settings.bus() == wanted


EDS = """[FileInfo]\nFileName=x.eds\n[DeviceInfo]\n[MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n
[1000]\nParameterName=Device type\nObjectType=0x7\nDataType=0x0007\nAccessType=ro\n"""


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file, expected an EDS or DCF file of the drive, or none"),
        ("torque: 3\n", "cannot be read .*, expected an EDS or DCF file"),
        (EDS, "has no object 0x6040, .*expected a drive with profile CiA 402"),
    ],
)
def test_an_eds_file_that_is_none_is_refused(content: str | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=words):
        od.dictionary(str(path), 1)


def test_an_adapter_that_python_can_does_not_know_is_refused() -> None:
    with pytest.raises(InputError, match="interface: socketcam, expected socketcan"):
        CanopenHardware(replace(SETTINGS, interface="socketcam"), False, PERIOD, 1.0, time.time_ns, lambda _: None)


def test_without_the_package_the_node_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(od, "canopen", None)
    with pytest.raises(InputError, match=r"needs the package canopen, expected \./tcs node canopen_drive"):
        od.dictionary("", 1)


# The node


def words_of(settings: DriveSettings, *more: str) -> list[str]:
    """Arguments of the node for a rig's drive."""
    given = {
        "clock": "real_time", "period": PERIOD, "watchdog": 0.3, "age_limit": 0.3, "state_limit": 0.3, "ramp_time": 0.2,
        "interface": settings.interface, "channel": settings.channel, "counts_per_turn": settings.counts_per_turn,
        "gear": settings.gear, "heartbeat": settings.heartbeat, "enable_time": settings.enable_time,
    }  # fmt: skip
    return [word for name, value in given.items() for word in ("-p", f"{name}:={value}")] + list(more)


@pytest.fixture
def drive(request: pytest.FixtureRequest) -> Iterator[SimulatedDrive]:
    """A drive on a virtual bus of its own."""
    settings = replace(SETTINGS, channel=request.node.name)
    made = SimulatedDrive(AXIS, settings, settings.bus(), 250.0, DRIVE_LIMIT)
    yield made
    made.close()


class Commander:
    """What answers every state of a driver with a torque, on a node of a test."""

    def __init__(self, node: Any, torque: float, begin: Callable[[], None] = lambda: None) -> None:
        from sensor_msgs.msg import JointState
        from tcs_friction_msgs.msg import AxisTorque

        from tcs_friction.nodes.core.qos import LISTEN, PUBLISH
        from tcs_friction.nodes.core.wire import TORQUE, JointWire

        self.torque: float | None = torque
        self._publisher = node.create_publisher(AxisTorque, "torque_command", PUBLISH)
        self._wire, self._command = JointWire("azimuth"), TORQUE
        node.create_subscription(JointState, "joint_states", self._on_state, LISTEN, raw=True)
        begin()

    def _on_state(self, data: bytes) -> None:
        if self.torque is not None:
            self._publisher.publish(self._command.write(self._wire.read(data)[0], self.torque))


def test_the_node_passes_torque_on_within_its_limits_only(together: Callable[..., Any], drive: SimulatedDrive) -> None:
    from rclpy.parameter import Parameter

    graph = together(*words_of(drive.settings), nodes=["canopen_drive"])
    node = graph["canopen_drive"]
    commander = Commander(graph.driver, 40.0)  # less than friction: the axis rests
    assert graph.until(lambda: drive.torque > 39.0, 20.0), (node.hardware.fault, node.hardware.waits, node.health.problem)

    node.set_parameters([Parameter("travel_to", value=-0.1)])
    assert graph.until(lambda: drive.torque < 1.0, 5.0), "not outward"
    assert drive.state is State.ENABLED
    assert "beyond the travel to -0.1 rad: no torque that way" in node.health.warning
    commander.torque = -40.0
    assert graph.until(lambda: drive.torque < -39.0, 5.0), "but back"
    node.set_parameters([Parameter("travel_margin", value=0.05)])
    assert graph.until(lambda: drive.state is State.DISABLED, 5.0)
    assert "more than 0.05 rad beyond the travel" in node.health.warning
    node.set_parameters([Parameter("travel_to", value=1.0)])
    assert graph.until(lambda: drive.torque < -39.0, 5.0)

    commander.torque = 1000.5
    assert graph.until(lambda: drive.state is State.DISABLED, 5.0), "it is refused, and nothing else is commanded"
    assert "1000.5 N m was refused, the limit is 1000" in " ".join(node.health._events)
    commander.torque = 40.0
    assert graph.until(lambda: drive.torque > 39.0, 5.0)

    node.trigger_deactivate()
    assert graph.until(lambda: drive.state is State.DISABLED, 5.0)
    node.trigger_activate()
    assert graph.until(lambda: drive.torque > 39.0, 5.0)

    drive.emergency(0x3210)
    assert graph.until(lambda: "emergency 0x3210" in node.health.problem, 5.0)
    assert "activate the node again" in node.health.problem
    assert graph.until(lambda: drive.state is State.DISABLED, 5.0)
    graph.for_seconds(0.3)
    assert drive.state is State.DISABLED
    node.trigger_deactivate()
    node.trigger_activate()
    assert graph.until(lambda: drive.torque > 39.0, 8.0), (node.hardware.fault, node.hardware.waits)
    assert not node.set_parameters([Parameter("period", value=0.02)])[0].successful


def test_lock_step_is_refused(together: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="clock: lock_step, expected real_time: a drive does not wait"):
        together("-p", "clock:=lock_step", nodes=["canopen_drive"])


@pytest.fixture
def commander() -> Iterator[Commander]:
    """A controller of 40 N m in a thread of its own."""
    ears = Listening("commander")
    yield Commander(ears.node, 40.0, ears.begin)
    ears.close()


def test_a_killed_driver_leaves_no_torque(processes: Any, commander: Commander, drive: SimulatedDrive) -> None:
    """Over sockets, since the driver is a process of its own."""
    server = CanServer(drive.settings.channel)
    options = f"[{', '.join(repr(option) for option in server.options())}]"
    served = replace(drive.settings, interface="socketcand")
    processes.start("canopen_drive", *words_of(served, "-p", f"bus_options:={options}"))
    assert wait_until(lambda: drive.torque > 39.0, 40.0), processes.log("canopen_drive")
    commander.torque = None
    assert wait_until(lambda: drive.state is State.DISABLED, 10.0), "no commands"
    assert State.QUICK_STOP in drive.seen
    commander.torque = 40.0
    assert wait_until(lambda: drive.torque > 39.0, 10.0)
    processes.kill("canopen_drive")
    assert wait_until(lambda: drive.state is State.FAULT, 10.0)
    assert drive.torque == 0.0
    assert drive._error == 0x8130, "it missed the heartbeat"
    server.close()
