"""Kernels in C: what is translated is tested by what the code computes (`test_export_c`), here is what is refused."""

# ruff: noqa: ARG001, RET504 every kernel has the one signature

from __future__ import annotations

import math
from typing import Any

import pytest
from numba import njit

from tcs_friction.errors import JobError
from tcs_friction.export.translate import Library, bare
from tcs_friction.physics.registry import effects, laws

SOMETHING = {"a": 1.0}


def looping(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    while dt > 0.0:
        dt -= 1.0
    return dt


def naming(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return dt * SOMETHING["a"]


def calling(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return math.gamma(dt)


def dividing(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return dt % 2.0


def iterating(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    for value in parameters:
        dt += value
    return dt


def comparing(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return 1.0 if dt in parameters else 0.0


def assigning(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    motion.first = dt
    return dt


def retyping(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    dt = int(dt)
    return dt


def formatting(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    return float(f"{dt}")


def short(motion: Any) -> float:
    return float(motion[0])


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (looping, "While in line 2"),
        (naming, "the name SOMETHING in line 2"),
        (calling, r"math\.gamma\(\) in line 2"),
        (dividing, "Mod in line 2"),
        (iterating, "a loop over anything but a range or a tuple in line 2"),
        (comparing, "In in line 2"),
        (assigning, "such an assignment in line 2"),
        (retyping, "another kind of number for dt in line 2"),
        (formatting, "JoinedStr in line 2"),
        (short, "its arguments in line 1"),
    ],
)
def test_what_is_not_translated_is_named(function: Any, words: str) -> None:
    with pytest.raises(JobError, match=f"^C of {__name__}.{function.__name__}: ({words}) is not translated"):
        Library().kernel(function)


def test_a_kernel_without_source_is_refused() -> None:
    space: dict[str, Any] = {}
    exec("def made(motion, parameters, state, dt):\n    return dt", space)
    space["made"].__module__ = "elsewhere"
    with pytest.raises(JobError, match=r"C of elsewhere\.made: its source is not to be had"):
        Library().kernel(njit(space["made"]))


def test_every_function_is_there_once_and_takes_what_it_uses() -> None:
    library = Library()
    names = [library.kernel(term.kernel).name for term in (*laws().values(), *effects().values())]
    assert len(set(names)) == len(names)
    for one in library.done.values():
        assert library.text.count(f" {one.name}({one.text.partition('(')[2].partition(')')[0]})\n{{") == 1
        body = one.text.partition("{")[2]
        assert all(word.removesuffix("_size") in body for word, _ in one.arguments)


@pytest.mark.parametrize(
    ("text", "expected"), [("(a + b)", "a + b"), ("(a) + (b)", "(a) + (b)"), ("a", "a"), ("f(a)", "f(a)")]
)
def test_only_parentheses_around_all_of_it_go(text: str, expected: str) -> None:
    assert bare(text) == expected
