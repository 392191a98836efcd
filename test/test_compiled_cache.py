"""The cache of compiled kernels never serves code of another version."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tcs_friction import compiled_cache
from tcs_friction.compiled_cache import choose_cache, fingerprint


def package(folder: Path, number: int) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "slots.py").write_text(f"# read by kernels\nSLOT = {number}\n")
    return folder


def test_name_follows_the_kernels_and_nothing_else(tmp_path: Path) -> None:
    first = fingerprint(package(tmp_path / "a", 1))
    assert fingerprint(package(tmp_path / "b", 1)) == first
    assert fingerprint(package(tmp_path / "a", 2)) != first
    (tmp_path / "b" / "plain.py").write_text("x = 1\n")
    assert fingerprint(tmp_path / "b") == first


def test_changed_constant_of_another_file_is_compiled_anew(tmp_path: Path) -> None:
    """What numba's own cache gets wrong: the caller's file is unchanged, the constant it froze is not."""
    root = tmp_path / "sample"
    caller = "import sys; sys.path.insert(0, {!r})\nimport compiled_cache\ncompiled_cache.choose_cache()\n"
    source = Path(compiled_cache.__file__).read_text()

    def run(number: int) -> str:
        package(root, number)
        (root / "compiled_cache.py").write_text(source)
        kernels = root / "kernels.py"
        if not kernels.exists():
            kernels.write_text(
                "from numba import njit\nfrom slots import SLOT\n\n"
                "@njit('i8()', cache=True)\ndef slot():\n    return SLOT\n"
            )
        program = caller.format(str(root)) + "import kernels\nprint(kernels.slot())"
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        environment.pop("NUMBA_CACHE_DIR", None)
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    assert run(1) == "1"
    assert run(2) == "2"
    assert run(1) == "1"
    assert len(list((tmp_path / "cache" / "tcs_friction").iterdir())) == 2


def test_given_directory_is_used_and_inherited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", numba.config.CACHE_DIR)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    choose_cache()
    chosen = os.environ["NUMBA_CACHE_DIR"]
    assert Path(chosen).parent == tmp_path
    assert chosen == numba.config.CACHE_DIR
    choose_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == chosen


def test_unwritable_directory_leaves_the_choice_to_numba(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(file))
    choose_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == str(file)


def test_old_versions_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", numba.config.CACHE_DIR)
    old, recent, foreign = tmp_path / ("a" * 16), tmp_path / ("b" * 16), tmp_path / "something_else"
    for folder in (old, recent, foreign):
        folder.mkdir()
    for folder in (old, foreign):
        os.utime(folder, (time.time() - 1e7,) * 2)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    choose_cache()
    assert not old.exists()
    assert recent.exists()
    assert foreign.exists()
