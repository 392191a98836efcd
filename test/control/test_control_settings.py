"""Settings: what is declared once is what validation, files and parameter descriptors see."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field

import pytest

from tcs_friction.control.config_field import choice, from_mapping, parts, setting, settings, switch, validate
from tcs_friction.errors import InputError


@dataclass(frozen=True)
class Sample:
    gain: float = setting(2.0, "1/s", 0.5, 10.0, "a gain")
    count: int = setting(3, "", 1, 5, "a count")
    active: bool = switch(False, "whether it is on")
    axis: str = choice("azimuth", ("azimuth", "elevation"), "which axis")


def test_declaration_is_readable() -> None:
    gain, count, active, axis = settings(Sample)
    assert (gain.name, gain.default, gain.unit, gain.lower, gain.upper) == ("gain", 2.0, "1/s", 0.5, 10.0)
    assert (count.default, type(count.default)) == (3, int)
    assert active.default is False
    assert axis.options == ("azimuth", "elevation")


def test_bounds_are_inclusive() -> None:
    validate(Sample(gain=0.5, count=5), "sample")
    validate(Sample(gain=10.0, count=1), "sample")


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({"gain": math.nan}, "gain is nan, expected a number from 0.5 to 10 1/s"),
        ({"gain": math.inf}, "gain is inf"),
        ({"gain": 0.49}, "gain is 0.49"),
        ({"gain": "fast"}, "gain is 'fast'"),
        ({"gain": True}, "gain is True"),
        ({"count": 2.5}, "count is 2.5, expected a whole number from 1 to 5"),
        ({"count": 6}, "count is 6"),
        ({"active": 1}, "active is 1, expected true or false"),
        ({"axis": "polar"}, "axis is 'polar', expected one of azimuth, elevation"),
    ],
)
def test_bad_value_is_refused(values: dict[str, object], found: str) -> None:
    with pytest.raises(InputError, match=found.replace("(", r"\(")) as caught:
        from_mapping(Sample, values, "file.yaml sample")
    assert str(caught.value).startswith("file.yaml sample: ")


def test_every_bad_value_is_named_at_once() -> None:
    with pytest.raises(InputError) as caught:
        validate(Sample(gain=-1.0, count=9), "sample")
    assert "gain is -1" in str(caught.value)
    assert "count is 9" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_key_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown key 'gian'.*gain"):
        from_mapping(Sample, {"gian": 1.0}, "sample")


def test_whole_number_serves_as_float() -> None:
    assert type(from_mapping(Sample, {"gain": 3}, "sample").gain) is float


@pytest.mark.parametrize("default", [math.nan, 11.0])
def test_wrong_declaration_is_caught_where_it_is_written(default: float) -> None:
    with pytest.raises(ValueError, match="outside its range"):
        setting(default, "", 0.0, 10.0, "")
    with pytest.raises(ValueError, match="not one of"):
        choice("c", ("a", "b"), "")


@dataclass(frozen=True)
class Outer:
    inner: Sample = field(default_factory=Sample)
    scale: float = setting(1.0, "", 0.0, 2.0, "a scale")


def test_nested_configuration_goes_to_a_mapping_and_back() -> None:
    config = Outer(Sample(gain=3.0, axis="elevation"), 0.5)
    assert from_mapping(Outer, asdict(config), "outer") == config
    assert parts(Outer) == {"inner": Sample}
    assert [entry.name for entry in settings(Outer)] == ["scale"]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({"inner": {"gain": 99.0}, "scale": 3.0}, r"outer: scale is 3, .*; inner\.gain is 99"),
        ({"inner": {"gian": 1.0}}, r"outer inner: unknown key 'gian', expected gain"),
        ({"iner": {}}, r"unknown key 'iner', expected inner"),
        ({"inner": 5}, "outer inner: 5, expected a mapping"),
    ],
)
def test_bad_nested_value_is_refused(values: dict[str, object], found: str) -> None:
    with pytest.raises(InputError, match=found):
        from_mapping(Outer, values, "outer")


def test_a_text_is_no_number() -> None:
    """The reader of YAML makes a number of 1e0; what is in quotes is a text."""
    with pytest.raises(InputError, match="gain is '1e0', expected a number"):
        from_mapping(Sample, {"gain": "1e0"}, "sample")
