"""Axis files, references and models as nodes name them: a path, or a name in the package's config folder."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from tcs_friction.config import AxisFile, load_axis
from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.errors import InputError
from tcs_friction.nodes.core.peers import LONGEST_NAME, unquoted
from tcs_friction.plain_files import plain_file

DEFAULT_AXIS = "azimuth_1p2m.yaml"
KINDS = (".yaml", ".xml")
"""Files of the config folder: axes and references, models of MuJoCo."""


def config_file(name: str) -> Path:
    """An existing file as named, or the one of that name in the config folder of the checkout or of the installed package."""
    with contextlib.suppress(OSError, ValueError):  # a name too long for a file, say
        if Path(name).exists():
            return plain_file(Path(name), "an ordinary file")
    folders = [Path(__file__).resolve().parents[3] / "config"]
    with contextlib.suppress(PackageNotFoundError):
        folders.append(Path(get_package_share_directory("tcs_friction")) / "config")
    for folder in folders:
        with contextlib.suppress(OSError):
            if (folder / name).is_file():
                return folder / name
    kind = Path(name).suffix if Path(name).suffix in KINDS else KINDS[0]
    known = sorted({path.name for folder in folders for path in folder.glob(f"*{kind}")})
    raise InputError(name[:LONGEST_NAME], "no such file", f"a path, or one of {', '.join(known)}")


def axis_file(name: str) -> AxisFile:
    """An axis file by path or name. Raises InputError, which does not quote it to others: see `ContentError`."""
    path = config_file(name)
    with unquoted():
        return load_axis(path)


def reference_file(name: str) -> Reference:
    """A reference by path or name of its file. Raises InputError, which does not quote it to others: see `ContentError`."""
    path = config_file(name)
    with unquoted():
        return load_reference(path)
