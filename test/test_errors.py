"""Errors pass between processes; names that do not exist are answered with those that do."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from tcs_friction.errors import MOST_LISTED, InputError, nearest


class WrappedError(InputError):
    """An error that is made from another one, as a node's is."""

    def __init__(self, cause: InputError) -> None:
        super().__init__(cause.where, "does not do")
        self.cause = cause


def test_an_error_survives_the_way_to_another_process() -> None:
    error = InputError("axis.yaml", "no inertia", "a number")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is InputError
    assert str(again) == str(error) == "axis.yaml: no inertia, expected a number"
    wrapped = pickle.loads(pickle.dumps(WrappedError(error)))
    assert type(wrapped) is WrappedError
    assert (str(wrapped), wrapped.where, str(wrapped.cause)) == ("axis.yaml: does not do", "axis.yaml", str(error))


def test_the_most_alike_are_named() -> None:
    assert nearest("coulom", ["coulomb", "static"]) == "coulomb"
    assert nearest("/JOINT_STATE", ["/joint_states", "/wind", "/joint_states"]) == "/joint_states"


def test_without_any_alike_all_are_listed() -> None:
    assert nearest("zzz", ["static", "coulomb"]) == "one of static, coulomb"
    assert nearest("zzz", []) == "nothing else there"
    many = nearest("zzz", (f"topic_{number}" for number in range(MOST_LISTED + 1)))
    assert many.endswith(f"topic_{MOST_LISTED - 1}, ...")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://h/a.mcap?sig=1:2,3&x=4: is gone", "https://h/a.mcap?...: is gone"),
        ("('s3://b/k?versionId=9')", "('s3://b/k?...')"),
        ("https://h/a?sig=1, https://h/b?sig=2", "https://h/a?..., https://h/b?..."),
        ("https://h/a.mcap: is it gone?", "https://h/a.mcap: is it gone?"),
        ("what? https://h/a", "what? https://h/a"),
    ],
)
def test_the_query_of_a_url_is_never_repeated(text: str, shown: str) -> None:
    assert str(InputError(text, "x")) == f"{shown}: x"


SIGNED = "https://host/bag.mcap?X-Amz-Signature=5e1f&x=1"


@pytest.mark.parametrize("where", [SIGNED, Path(SIGNED)])
def test_what_permits_is_not_repeated(where: object) -> None:
    """Also where a path has made one slash of two."""
    told = str(InputError(str(where), f"no such file {where}", f"{where}."))
    assert "5e1f" not in told
    assert told.count("bag.mcap?...") == 3

