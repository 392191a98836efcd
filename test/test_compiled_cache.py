"""The cache of compiled kernels never serves code of another version."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from full_disk import full_beyond

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


KERNEL = (
    "import sys, compiled_cache; compiled_cache.choose_cache()\n"
    "assert 'numba' not in sys.modules\n"
    "from numba import njit\n\n"
    "@njit('i8()', cache=True)\ndef one():\n    return 1\n\n"
    "@njit('i8()', cache=True)\ndef two():\n    return one() + 1\n\n"
    "print(two(), sum(one.stats.cache_hits.values()))\n"
)


def run_kernel(folder: Path, **environment: str) -> tuple[str, str]:
    """A process that compiles two kernels, or takes them from the cache: its result and its words on stderr."""
    root = package(folder / "sample", 1)
    (root / "compiled_cache.py").write_text(Path(compiled_cache.__file__).read_text())
    (root / "main.py").write_text(KERNEL)
    variables = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "TMPDIR": str(folder), **environment}
    variables.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, str(root / "main.py")], env=variables, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


def test_a_broken_cache_is_made_anew(tmp_path: Path) -> None:
    assert run_kernel(tmp_path) == ("2 0", "")
    files = sorted(path for path in (tmp_path / "cache").rglob("*") if path.suffix in (".nbi", ".nbc"))
    assert len(files) == 4
    for path in files:
        path.write_bytes(b"")
    assert run_kernel(tmp_path) == ("2 0", "")
    assert run_kernel(tmp_path) == ("2 1", "")


@pytest.fixture
def cache_file(tmp_path: Path) -> Any:
    """One of numba's files, with an entry."""
    from numba.core import caching

    compiled_cache._forgive(caching)
    file: Any = caching.IndexDataCacheFile(str(tmp_path), "kernel", (1.0, 2))
    file.save("key", list(range(1000)))
    assert file.load("key") == list(range(1000))
    return file


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", [lambda _: b"", lambda content: content[: len(content) // 2], lambda _: b"\x80\x05garbage."])
def test_what_cannot_be_read_is_not_there(
    damage: Callable[[bytes], bytes], suffix: str, cache_file: Any, tmp_path: Path
) -> None:
    (path,) = tmp_path.glob(f"*{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    assert cache_file.load("key") is None
    cache_file.save("key", [1])
    assert cache_file.load("key") == [1]


def test_a_full_disk_is_told_once(
    cache_file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled_cache, "_said", [])
    with full_beyond(100):
        for key in ("other", "key"):
            cache_file.save(key, list(range(1000)))
    words = capsys.readouterr().err
    assert words.count("\n") == 1
    assert f"compiled code cannot be kept in {tmp_path} (File too large)" in words
    assert cache_file.load("other") is None
    assert cache_file.load("key") == list(range(1000)), "what was there before"


def test_a_cache_that_cannot_be_made_lies_elsewhere_for_one_run(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result, words = run_kernel(tmp_path, XDG_CACHE_HOME=str(tmp_path / "file"))
    assert result == "2 0"
    assert words.count("\n") == 1
    assert "file/tcs_friction" in words
    assert "Not a directory" in words
    assert not list(tmp_path.glob("tcs_friction-*")), "it goes with the process"


HOMES = {"a home that is a file": "file", "a home that cannot be made": "/proc/home", "no home": None}


@pytest.mark.parametrize("home", HOMES)
def test_pictures_are_drawn_without_a_home_with_one_line(home: str, tmp_path: Path) -> None:
    """Both the compiled code and matplotlib want to keep something there."""
    program = "from tcs_friction.report import figures; figures.drawn('a', 'b')(lambda: figures.panels()[0])()"
    words = without_home(home, tmp_path, program)
    assert words.count("\n") == (1 if home != "no home" else words.count("cannot be kept")), words
    assert not list(tmp_path.glob("*/tcs_friction-*")), "it goes with the process"


def without_home(home: str, folder: Path, program: str) -> str:
    """What a process says on stderr that has no home directory to write to."""
    (folder / "file").touch()
    (folder / "tmp").mkdir()
    names = ("HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "ROS_LOG_DIR", "ROS_HOME")
    variables = {name: value for name, value in os.environ.items() if name not in names} | {"TMPDIR": str(folder / "tmp")}
    if HOMES[home] is not None:
        variables["HOME"] = str(folder / str(HOMES[home]))
    done = subprocess.run([sys.executable, "-c", program], env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


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
