"""The objects of a CiA 402 drive that its driver uses, where no EDS file says what the drive has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcs_friction.errors import InputError

try:
    import canopen
    from canopen import objectdictionary as kinds
except ModuleNotFoundError:  # of the optional set canopen
    canopen = None

CONTROLWORD, STATUSWORD = 0x6040, 0x6041
MODE, MODE_SHOWN, MODES = 0x6060, 0x6061, 0x6502
POSITION, SPEED, TORQUE, CURRENT = 0x6064, 0x606C, 0x6077, 0x6078
TARGET, MOST_TORQUE, MOST_CURRENT = 0x6071, 0x6072, 0x6073
RATED_CURRENT, RATED_TORQUE = 0x6075, 0x6076
SLOPE, GEAR_RATIO, FEED, SPEED_UNIT = 0x6087, 0x6091, 0x6092, 0x60A9
ERROR, QUICK_STOP_OPTION, LOST_OPTION = 0x603F, 0x605A, 0x6007
SYNC_PERIOD, CONSUMER, PRODUCER = 0x1006, 0x1016, 0x1017

_TYPES = {"i8": 0x02, "i16": 0x03, "i32": 0x04, "u8": 0x05, "u16": 0x06, "u32": 0x07}
_SINGLE = (
    (0x1001, "u8"), (0x1005, "u32"), (SYNC_PERIOD, "u32"), (0x1014, "u32"), (PRODUCER, "u16"),
    (LOST_OPTION, "i16"), (ERROR, "u16"), (CONTROLWORD, "u16"), (STATUSWORD, "u16"), (QUICK_STOP_OPTION, "i16"),
    (MODE, "i8"), (MODE_SHOWN, "i8"), (POSITION, "i32"), (SPEED, "i32"), (TARGET, "i16"), (MOST_TORQUE, "u16"),
    (MOST_CURRENT, "u16"), (RATED_CURRENT, "u32"), (RATED_TORQUE, "u32"), (TORQUE, "i16"), (CURRENT, "i16"), (MODES, "u32"),
    (SLOPE, "u32"), (SPEED_UNIT, "u32"),
)  # fmt: skip
_RECORDS = {
    0x1003: ("u32",) * 4,
    CONSUMER: ("u32",),
    GEAR_RATIO: ("u32",) * 2,
    FEED: ("u32",) * 2,
    **{base + n: ("u32", "u8", "u16", "u8", "u16") for base in (0x1400, 0x1800) for n in range(4)},
    **{base + n: ("u32",) * 8 for base in (0x1600, 0x1A00) for n in range(4)},
}
NEEDED = (CONTROLWORD, STATUSWORD, MODE, MODE_SHOWN, POSITION, SPEED, TARGET, CONSUMER, PRODUCER)


def minimal() -> Any:
    """A canopen.ObjectDictionary of what is used, with four PDOs each way."""
    made = kinds.ObjectDictionary()
    for index, kind in _SINGLE:
        made.add_object(_variable(index, 0, kind))
    for index, members in _RECORDS.items():
        record = kinds.ODRecord(f"{index:04X}", index)
        for sub, kind in enumerate(("u8", *members)):
            record.add_member(_variable(index, sub, kind))
        made.add_object(record)
    return made


def _variable(index: int, sub: int, kind: str) -> Any:
    variable = kinds.ODVariable(f"{index:04X}:{sub:02X}", index, sub)
    variable.data_type = _TYPES[kind]
    variable.pdo_mappable = True
    return variable


def dictionary(eds: str, node: int) -> Any:
    """The object dictionary of an EDS (or DCF) file, or the minimal one for "". Raises InputError for what is none."""
    if canopen is None:
        raise InputError("canopen_drive", "needs the package canopen", "./tcs node canopen_drive, or pip install canopen")
    if not eds:
        return minimal()
    if not Path(eds).is_file():
        raise InputError(eds, "no such file", "an EDS or DCF file of the drive, or none")
    try:
        made = canopen.import_od(eds, node)
    except Exception as error:  # a parser of strangers' files, with errors of many kinds
        raise InputError(eds, f"cannot be read ({type(error).__name__}: {error})", "an EDS or DCF file") from None
    missing = [f"0x{index:04X}" for index in NEEDED if index not in made]
    if missing:
        raise InputError(eds, f"has no object {', '.join(missing)}", "a drive with profile CiA 402")
    return made
