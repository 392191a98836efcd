"""Where the optional packages of fleets are not installed, their tests are left out; `./tcs test` installs them."""

from __future__ import annotations

import importlib.util

NEEDED = {
    "test_fleet_[!r]*.py": ("fsspec",),
    "test_fleet_ru*.py": ("distributed", "fsspec"),
    "test_fleet_storage.py": ("s3fs", "moto"),
}
collect_ignore_glob = [
    pattern for pattern, packages in NEEDED.items() if any(importlib.util.find_spec(name) is None for name in packages)
]
