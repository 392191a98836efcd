"""Where compiled kernels are kept between processes.

numba renews a cached function when that function's own file changes. Ours are inlined across files and freeze
the slot numbers they import, so a change in one file would leave stale code in the others. The cache is
therefore kept under a name made from the contents of every file with kernels in it.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import time
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"
_KEPT_FOR = 30 * 86400.0  # s, how long the caches of other versions stay


def fingerprint(package: Path) -> str:
    """A name that changes with the text of any file under `package` that has kernels in it."""
    digest = hashlib.blake2b(digest_size=8)
    for file in sorted(package.rglob("*.py")):
        text = file.read_bytes()
        if b"njit" in text or b"kernel" in text:
            digest.update(file.relative_to(package).as_posix().encode())
            digest.update(text)
    return digest.hexdigest()


def choose_cache() -> None:
    """Point numba at this version's cache; called before any kernel is compiled.

    It lies in the directory that NUMBA_CACHE_DIR names, or in the user's cache directory. Where that cannot
    be written, numba falls back to its own choice.
    """
    name = fingerprint(Path(__file__).parent)
    given = os.environ.get(_VARIABLE)
    if given and Path(given).name == name:
        return  # a parent process has chosen
    user = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = (Path(given) if given else Path(user) / "tcs_friction") / name
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True)
            _forget_old(folder)
    except OSError:
        return
    os.environ[_VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _forget_old(current: Path) -> None:
    for folder in current.parent.iterdir():
        ours = len(folder.name) == len(current.name) and set(folder.name) <= set("0123456789abcdef")
        if ours and folder.is_dir() and time.time() - folder.stat().st_mtime > _KEPT_FOR:
            shutil.rmtree(folder, ignore_errors=True)
