"""Known weaknesses of locked packages, by a clone of the database of the Python Packaging Authority (pypa/advisory-database).

audit_offline.py DATABASE LOCKED...: a line for each one, and the day of the last change in the clone.
Exit status 1 when there is one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from tcs_friction.yaml_files import load_yaml


def main() -> int:
    database, files = Path(sys.argv[1]) / "vulns", map(Path, sys.argv[2:])
    if not database.is_dir():
        print(f"{database}: no such directory, expected a clone of pypa/advisory-database", file=sys.stderr)
        return 2
    pins = sorted({pin for file in files for pin in pinned(file)})
    found = [line for name, version in pins for line in weaknesses(database, name, version)]
    print("\n".join([*found, f"{len(pins)} packages, {len(found)} weaknesses known on {newest(database)}"]))
    return 1 if found else 0


def newest(database: Path) -> str:
    """The day of the last change in the database; weaknesses found later are not in it."""
    changed = re.compile(r"^(?:modified|published): ['\"]?(\d{4}-\d\d-\d\d)", re.MULTILINE)
    days = [day for path in database.rglob("*.yaml") for day in changed.findall(path.read_text(encoding="utf-8"))]
    return max(days, default="no day, since the database is empty")


def pinned(file: Path) -> Iterator[tuple[str, str]]:
    """Name and version of every package of a lock file."""
    for line in file.read_text(encoding="utf-8").splitlines():
        if line and line[0] not in "# ":
            name, _, version = line.split()[0].partition("==")
            yield str(canonicalize_name(name)), version


def weaknesses(database: Path, name: str, version: str) -> Iterator[str]:
    """A line for every entry of the database that is about this version."""
    for path in sorted((database / name).glob("*.yaml")):
        entry = load_yaml(path)
        if "withdrawn" not in entry and any(concerns(affected, version) for affected in entry.get("affected", [])):
            details = " ".join(str(entry.get("details", "")).split())
            yield f"{name} {version}: {entry['id']} {details[:100]}"


def concerns(affected: dict[str, Any], version: str) -> bool:
    """Whether a version is listed, or lies in one of the ranges."""
    if version in affected.get("versions", []):
        return True
    return any(inside(item["events"], version) for item in affected.get("ranges", []) if item.get("type") == "ECOSYSTEM")


def inside(events: list[dict[str, str]], version: str) -> bool:
    """Whether the last event at or before a version introduced the weakness; `last_affected` ends it behind that version."""
    weak = False
    for event in events:
        for kind, bound in event.items():
            try:
                at = Version("0" if bound == "0" else bound)
            except InvalidVersion:
                continue
            if kind == "introduced" and Version(version) >= at:
                weak = True
            elif (kind == "fixed" and Version(version) >= at) or (kind == "last_affected" and Version(version) > at):
                weak = False
    return weak


if __name__ == "__main__":
    sys.exit(main())
