"""JSON files by anybody: read within bounds, and what is not as it should be is refused in one line that says where.

    file = load_json(path, "the diagnosis.json of ./tcs diagnose")
    file.at("effects").entries()[0].at("parameters").at("order").at("std").number(0.0)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from tcs_friction.errors import InputError
from tcs_friction.plain_files import read_plain

LARGEST = 16 << 20
"""Bytes of a file: a hundred times those of an identification with its profiles, or of a diagnosis with its atlas."""
SHOWN = 40
"""Characters of a value in a message."""


@dataclass(frozen=True)
class Json:
    """A value in a JSON file. where: the file and the way to the value.

    Every method raises InputError for another kind of value.
    """

    value: Any
    where: str

    def at(self, key: str) -> Json:
        """The entry of a mapping."""
        inner = self.mapping()
        if key not in inner:
            raise InputError(self.where, f"{key} is missing", f"a mapping with {key}")
        return inner[key]

    def mapping(self) -> dict[str, Json]:
        """All entries of a mapping."""
        if not isinstance(self.value, Mapping):
            self._refuse("a mapping")
        return {key: Json(value, f"{self.where}: {key}") for key, value in self.value.items()}

    def entries(self) -> list[Json]:
        """The elements of a list."""
        if not isinstance(self.value, list):
            self._refuse("a list")
        return [Json(value, f"{self.where}[{number}]") for number, value in enumerate(self.value)]

    def text(self) -> str:
        """A text."""
        if not isinstance(self.value, str):
            self._refuse("a text")
        return str(self.value)

    def number(self, lower: float = -math.inf, upper: float = math.inf) -> float:
        """A finite number within these limits."""
        limits = [f"from {lower:g}"] if math.isfinite(lower) else []
        limits += [f"to {upper:g}"] if math.isfinite(upper) else []
        expected = " ".join(["a number", *limits]) if limits else "a finite number"
        number = self._number(expected)
        if not lower <= number <= upper:
            self._refuse(expected)
        return number

    def above(self, limit: float) -> float:
        """A finite number above this limit."""
        expected = f"a number above {limit:g}"
        number = self._number(expected)
        if not number > limit:
            self._refuse(expected)
        return number

    def _number(self, expected: str) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not abs(self.value) < math.inf:
            self._refuse(expected)
        return float(self.value)

    def _refuse(self, expected: str) -> NoReturn:
        shown = repr(self.value)
        raise InputError(self.where, shown if len(shown) <= SHOWN else f"{shown[:SHOWN]} ...", expected)


def load_json(path: Path, what: str, schema: str) -> Json:
    """A JSON file whose top level is a mapping with this `schema`; `what` is expected where it is none.

    Raises InputError in one line.
    """
    where = str(path)
    data = read_plain(path, LARGEST + 1, what)
    if len(data) > LARGEST:
        raise InputError(where, "is too large", f"{what}, {LARGEST >> 20} MB at most")
    try:
        content = json.loads(data.decode(), parse_constant=_no_constant, parse_int=_whole)
    except RecursionError:
        raise InputError(where, "nests too deep", what) from None
    except ValueError as error:
        raise InputError(where, f"is no JSON ({error})", what) from None
    found = content.get("schema") if isinstance(content, Mapping) else None
    if found != schema:
        said = "has no schema" if found is None else f"has the schema {str(found)[:SHOWN]!r}"
        raise InputError(where, said, f"{what} ({schema})")
    return Json(content, where)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _whole(digits: str) -> int | float:
    """A whole number; one too large for a double is infinite, as a number with a point would be."""
    return int(digits) if len(digits) < 300 else float(digits)
