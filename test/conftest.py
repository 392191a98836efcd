"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recordings that lies beside the checkout or where TCS_FRICTION_DATA says."""
    named = os.environ.get("TCS_FRICTION_DATA")
    folder = Path(named) if named else ROOT.parent / "shared"
    if folder.is_dir():
        return folder
    reason = f"no recordings at {folder}; set TCS_FRICTION_DATA to the folder that holds data/ and practice/"
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)
