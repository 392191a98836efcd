"""What reading a bag or table may cost, in proportion to the size of its files.

What a file claims, or unpacks to, does not count: whoever makes somebody wait has to send as much.
"""

from __future__ import annotations

from tcs_friction.errors import InputError
from tcs_friction.recording.definitions import MAX_DEFINITION

EXPANSION = 100
"""Times its size that a file may unpack to; joint states that hardly change reach 20."""

FREE_BYTES = 1 << 26
"""Bytes that any file may unpack to, however small it is: 0.4 million messages of 150 bytes."""

STEPS_PER_BYTE = 4
"""Steps of interpreted work that a byte of a file pays for. A step is about 1 us; a compressed joint state, whose every field
is walked, takes 100 steps and 25 bytes or more."""

STEPS_PER_CHARACTER = 8
"""Steps of parsing a character of a type's definition."""

FREE_STEPS = 2_000_000
"""Steps that any file may take, however small it is."""


class Allowance:
    """What is left of the bytes and steps for one reading of a bag."""

    def __init__(self, where: str, size: int) -> None:
        """size: bytes of the bag's files."""
        self.where = where
        self.size = size
        self.renew()

    def renew(self) -> None:
        """For another reading from the start."""
        self._bytes = FREE_BYTES + EXPANSION * self.size
        self._steps = FREE_STEPS + STEPS_PER_BYTE * self.size
        self._parsed: set[str] = set()

    def unpack(self, count: int) -> bool:
        """Take bytes for something to be unpacked; False, and none taken, if they are not there."""
        if count > self._bytes:
            return False
        self._bytes -= count
        return True

    def parse(self, definition: str) -> None:
        """Take the steps of parsing a type's definition, once for each. Raises InputError when there are too few."""
        if definition not in self._parsed:
            self._parsed.add(definition)
            self.spend(STEPS_PER_CHARACTER * min(len(definition), MAX_DEFINITION))  # a longer one is not parsed

    def spend(self, steps: int) -> None:
        """Take steps. Raises InputError when they are used up."""
        self._steps -= steps
        if self._steps < 0:
            found = f"takes more work than {self.size} bytes of recording can need"
            raise InputError(self.where, found, "a recording of simple messages")
