"""Where compiled kernels are kept between processes.

numba renews a cached function when that function's own file changes. Ours are inlined across files and freeze
the slot numbers they import, so a change in one file would leave stale code in the others. The cache is
therefore kept under a name made from the contents of every file with kernels in it.

A cache can do no harm: what cannot be read from it is compiled and written anew, and where nothing can be written the
process says so once and goes on. The same holds for other things that a home directory has room for and that may be lost:
matplotlib's list of fonts, logs of ROS.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import importlib.util
import os
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

_VARIABLE = "NUMBA_CACHE_DIR"
_KEPT_FOR = 30 * 86400.0  # s, how long the caches of other versions stay
_FILES = "numba.core.caching"
_COMPILED = ("compiled code", "so that each start takes longer")


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
    be written, it lies in a temporary directory for as long as this process runs.
    """
    if _FILES in sys.modules:
        _forgive(sys.modules[_FILES])
    else:
        sys.meta_path.insert(0, _AfterImport())
    name = fingerprint(Path(__file__).parent)
    given = os.environ.get(_VARIABLE)
    if given and Path(given).name == name:
        return  # a parent process has chosen
    user = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = (Path(given) if given else Path(user) / "tcs_friction") / name
    new = not folder.is_dir()
    try:
        if kept(folder, *_COMPILED) != folder:
            folder = kept(_temporary() / name, *_COMPILED)
    except OSError:  # nothing can be written anywhere: numba may look
        return
    if new:
        _forget_old(folder)
    os.environ[_VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def choose_pictures_cache() -> None:
    """Where matplotlib could keep nothing it would say so at length: it gets a temporary directory."""
    if "MPLCONFIGDIR" in os.environ:
        return
    homes = {"XDG_CONFIG_HOME": "~/.config", "XDG_CACHE_HOME": "~/.cache"}
    folders = [Path(os.environ.get(name) or os.path.expanduser(usual)) for name, usual in homes.items()]
    with suppress(OSError):
        chosen = {kept(folder, "fonts for pictures", "so that each start takes longer") for folder in folders}
        if not chosen <= set(folders):
            os.environ["MPLCONFIGDIR"] = str(_temporary())


def kept(folder: Path, what: str, consequence: str) -> Path:
    """The directory, made if need be; where nothing can be written there, one that goes with this process, and a line on stderr.

    Several lines in one process would say the same: there is one. Raises OSError where nothing can be written anywhere.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        _say_once(folder, what, consequence, error)
        return _temporary()
    return folder


def lasts() -> bool:
    """Whether what is compiled now will be there at the next start, as far as is known."""
    return not _said


def _forget_old(current: Path) -> None:
    for folder in current.parent.iterdir():
        ours = len(folder.name) == len(current.name) and set(folder.name) <= set("0123456789abcdef")
        if ours and folder.is_dir() and time.time() - folder.stat().st_mtime > _KEPT_FOR:
            shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def _temporary() -> Path:
    """A temporary directory that goes with this process; those that it starts use it too. Nobody else can write to it."""
    folder, owner = Path(tempfile.mkdtemp(prefix="tcs_friction-")), os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder


_said: list[Path] = []


def _say_once(folder: Path, what: str, consequence: str, error: OSError) -> None:
    if not _said:
        _said.append(folder)
        text = f"{what} cannot be kept in {folder} ({error.strerror or error}); going on without, {consequence}"
        print(f"tcs-friction: {text}", file=sys.stderr)


class _AfterImport:
    """Waits for numba to be imported: importing it here would cost commands that need no kernel a second."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:  # noqa: ARG002
        """Let the others find the module, and change it once it has been loaded."""
        if name != _FILES:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_forgive(module: ModuleType) -> None:
                load(module)
                _forgive(module)

            spec.loader.exec_module = load_and_forgive  # type: ignore[method-assign]
        return spec


def _forgive(caching: ModuleType) -> None:
    """No error of a cache file is one of the program: what cannot be read is compiled anew, what cannot be written is lost."""
    files: Any = caching.IndexDataCacheFile
    if hasattr(files, "forgiving"):
        return
    load_index, load, save = files._load_index, files.load, files.save

    def forgiving_index(self: Any) -> Any:
        try:
            return load_index(self)
        except Exception:  # an unpickled file that was cut or overwritten can raise anything
            return {}

    def forgiving_load(self: Any, key: Any) -> Any:
        try:
            return load(self, key)
        except Exception:
            return None

    def forgiving_save(self: Any, key: Any, data: Any) -> None:
        try:
            save(self, key, data)
        except OSError as error:
            _say_once(Path(self._cache_path), *_COMPILED, error)

    files._load_index, files.load, files.save, files.forgiving = forgiving_index, forgiving_load, forgiving_save, True
