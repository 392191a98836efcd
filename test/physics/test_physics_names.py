"""Nothing knows an effect or a law by name but its own file: what others need of it, it declares."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import tcs_friction
from tcs_friction.physics.registry import effects, laws

PACKAGE = Path(tcs_friction.__file__).parent
SAME_WORD = {"exogenous"}  # also the recorded signals' block in an axis file, and their coordinate
PAPER = "report/paper/"  # its measurements and its plant, described as they are
# A file, what it names and why it may.
ALLOWED = {
    ("report/diagnosis_plots.py", "learned_map"): "the name of a picture's file",
    ("report/diagnosis_files.py", "learned_map"): "the name of a picture's file",
    ("control/loop.py", "stribeck"): "a kind of compensation",
    ("export/mjcf.py", "cogging"): "an attribute of MuJoCo's dcmotor",
    ("identify/first_axis.py", "imbalance"): "the gravity that a first axis file is given",
    ("identify/first_axis.py", "cable_wrap"): "the straight line over the position that it is given, where gravity is not told",
}


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """The syntax tree of a file."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def texts(path: Path) -> Iterator[str]:
    """The strings of a file that are no docstrings."""
    prose = {id(node.value) for node in nodes(path) if isinstance(node, ast.Expr)}
    for node in nodes(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node.value


def named(path: Path, names: set[str]) -> set[str]:
    """Which of the names a file has in its strings: as a whole one or, where no other word looks like it, within one."""
    found = set()
    for text in texts(path):
        words = set(text.replace(":", " ").replace("+", " ").replace(".", " ").split())
        found |= {name for name in names if text == name or ("_" in name and name in words)}
    return found


def package_files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def test_no_effect_is_named_outside_its_own_file() -> None:
    names = set(effects()) - SAME_WORD
    found = set()
    for path in package_files():
        where = path.relative_to(PACKAGE).as_posix()
        if not where.startswith(PAPER):
            own = path.stem if path.parent.name == "effects" else ""
            found |= {(where, name) for name in named(path, names - {own})}
    assert found == set(ALLOWED)


@pytest.mark.parametrize("room", ["physics", "diagnose"])
def test_no_law_is_named_outside_its_own_file(room: str) -> None:
    found = set()
    for path in (PACKAGE / room).rglob("*.py"):
        own = path.stem if path.parent.name == "friction" else ""
        found |= {(path.relative_to(PACKAGE).as_posix(), name) for name in named(path, set(laws()) - {own})}
    assert found == set()


@pytest.mark.parametrize("room", ["physics", "diagnose"])
def test_no_parameter_is_asked_for_by_name_outside_the_terms(room: str) -> None:
    """Neither `item.values["order"]` nor `item.values.get("order")`."""
    asking = set()
    for path in (PACKAGE / room).rglob("*.py"):
        if path.parent.name not in ("effects", "friction") and any(map(by_name, nodes(path))):
            asking.add(path.relative_to(PACKAGE).as_posix())
    assert asking == set()


def by_name(node: ast.AST) -> bool:
    """Whether it reads a value of an instance by a name that stands there."""
    if isinstance(node, ast.Subscript):
        owner, key = node.value, node.slice
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "get" and node.args:
        owner, key = node.func.value, node.args[0]
    else:
        return False
    of_values = getattr(owner, "attr", getattr(owner, "id", "")) == "values"  # item.values, or values = item.values before
    return of_values and isinstance(key, ast.Constant) and isinstance(key.value, str)
