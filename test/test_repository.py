"""What the repository holds: sources and small pictures, no results and no memory images of crashed processes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LARGEST = 1 << 20  # bytes; the largest file today is a lock file with the hashes of all packages


def test_no_tracked_file_is_larger_than_a_mebibyte() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    large = [name for name in listed.split("\0") if (ROOT / name).is_file() and (ROOT / name).stat().st_size > LARGEST]
    assert not large
