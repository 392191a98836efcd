"""What a page carries inside itself: the plot library uPlot (MIT licence) and what uses it, as text for elements.

The library's files lie beside this one exactly as the npm registry has them; README.md says which version and how it is renewed.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

VERSION = "1.6.32"

SHA256 = {
    "LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
    "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
"""File name -> checksum of its bytes."""


def uplot_script() -> str:
    """The library, which defines the global `uPlot`, for an inline script element; its licence stands first, as it asks."""
    return f"{_licence()}{_file('uPlot.iife.min.js')}"


def uplot_style() -> str:
    """The library's style sheet, with its licence, for a style element."""
    return f"{_licence()}{_file('uPlot.min.css')}"


def touch_script() -> str:
    """What lets a finger zoom: it defines the global `byFinger`, a plugin of uPlot."""
    return _file("touch.js")


def plots_script() -> str:
    """What makes figures of the plots of a report; it needs the library before it."""
    return f"{touch_script()}{_file('plots.js')}"


def _licence() -> str:
    return f"/*! uPlot {VERSION}\n{_file('LICENSE').strip()}\n*/\n"


@cache
def _file(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
