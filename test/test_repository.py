"""What the repository holds: sources and small pictures, no results and no memory images of crashed processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
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


def test_where_a_process_was_that_a_signal_ended_goes_to_the_file_that_ci_prints(tmp_path: Path) -> None:
    said = tmp_path / "crashes"
    env = os.environ | {"PYTHONPATH": str(ROOT / ".ci/crashes"), "TCS_FRICTION_CRASHES": str(said)}
    subprocess.run([sys.executable, "-c", "pass"], env=env, check=True)
    assert said.read_text() == ""
    command = [sys.executable, "-c", "import faulthandler, os\nfaulthandler.enable()\ndef here(): os.abort()\nhere()"]
    ended = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True)
    assert ended.returncode == -signal.SIGABRT
    assert "Fatal Python error: Aborted" in said.read_text()
    assert "in here" in said.read_text()
