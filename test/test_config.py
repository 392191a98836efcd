"""Axis files: what they may say, what is said when they say something else, and that nothing is lost on the way."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tcs_friction.config import (
    AxisFile,
    axis_mapping,
    control_of,
    default_control,
    load_axis,
    load_yaml,
    parse_axis,
    parse_control,
    save_axis,
    write_whole,
)
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics.registry import effects, laws
from tcs_friction.physics.terms import Table, instance
from tcs_friction.yaml_files import parse_yaml

FRICTION = {
    "law": "lugre",
    "coulomb": 78.1,
    "static": 117.2,
    "stribeck_velocity": 6.1e-4,
    "stiffness": 2.96e5,
    "damping": 3.4e4,
    "viscous": 572.0,
}
COGGING = {"effect": "cogging", "parameters": {"order": 72, "amplitude": 2.1, "phase": 0.3}}
MAP = {
    "effect": "learned_map",
    "table": {"coordinates": ["position"], "lower": [0.0], "upper": [1.0], "values": [1.0, 2.0]},
}
CONFIGS = Path(__file__).resolve().parent.parent / "config"


def block(**changed: Any) -> dict[str, Any]:
    return {"name": "azimuth", "kind": "rotary", "inertia": 1000.0, "friction": FRICTION, **changed}


def written(folder: Path, content: object) -> Path:
    path = folder / "axis.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_example_of_the_contract() -> None:
    axis = parse_axis(block(actuation_delay=0.001, effects=[COGGING]))
    assert (axis.name, axis.inertia, axis.actuation_delay) == ("azimuth", 1000.0, 0.001)
    assert axis.friction.values["stribeck_velocity"] == 6.1e-4
    assert axis.effects[0].values["order"] == 72.0


def test_numbers_as_people_write_them_are_numbers() -> None:
    """YAML 1.1 takes 2.96e5 for text."""
    content = parse_yaml("{law: dahl_viscous, coulomb: 1e2, stiffness: 2.96e5, viscous: 5}", "here")
    assert parse_axis(block(friction=content)).friction.values["stiffness"] == 2.96e5


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inertias": 1.0}, r"f: axis: unknown key 'inertias', expected inertia"),
        ({"inertia": "1e3"}, "f: axis: inertia: '1e3', expected a finite number"),
        ({"inertia": True}, "f: axis: inertia: True, expected a finite number"),
        ({"inertia": None}, "inertia: None"),
        ({"inertia": math.nan}, "inertia: nan"),
        ({"inertia": -5.0}, "f: axis azimuth: inertia: -5.0, expected a positive number"),
        ({"continuous": 1}, "f: axis: continuous: 1, expected true or false"),
        ({"continuous": True, "kind": "linear"}, "f: axis azimuth: continuous: true of a linear axis, expected kind: rotary"),
        ({"kind": "spiral"}, "f: axis azimuth: kind: 'spiral', expected rotary or linear"),
        ({"actuation_delay": -1.0}, "f: axis azimuth: actuation_delay"),
        ({"friction": {"coulomb": 1.0}}, "f: axis: friction: law is missing"),
        ({"friction": "lugre"}, "f: axis: friction: str 'lugre', expected a mapping"),
        ({"friction": {"law": "luger"}}, "unknown name 'luger', expected lugre"),
        ({"friction": {**FRICTION, "damping": -1.0}}, r"friction lugre: damping is -1.0, expected a number from 0"),
        ({"friction": {**FRICTION, "sigma0": 1.0}}, "friction lugre: unknown parameter 'sigma0'"),
        ({"friction": {"law": "lugre", "coulomb": 1.0}}, "static is missing"),
        ({"friction": {**FRICTION, "damping": "much"}}, "damping is 'much'"),
        ({"effects": {"effect": "cogging"}}, "effects: dict, expected a list"),
        ({"effects": 0}, "effects: int, expected a list"),
        ({"effects": ["cogging"]}, r"effects\[0\]: str 'cogging', expected a mapping"),
        ({"effects": [{"parameters": {}}]}, r"effects\[0\]: effect is missing"),
        ({"effects": [{"effect": "coging"}]}, "unknown name 'coging', expected cogging"),
        ({"effects": [COGGING, {"effect": "cogging", "order": 1}]}, r"effects\[1\]: unknown key 'order'"),
        ({"effects": [{"effect": "cogging", "parameters": {"ordr": 1}}]}, "unknown parameter 'ordr', expected order"),
        ({"effects": [{"effect": "cogging", "parameters": [1]}]}, r"cogging: parameters: list"),
        ({"effects": [{"effect": "wind_torque", "parameters": {"coefficient": 1}}]}, "signal is missing"),
        ({"effects": [{"effect": "learned_map"}]}, "table is missing"),
        ({"effects": [{**MAP, "table": {**MAP["table"], "upper": [0.0]}}]}, "expected lower below upper"),
        ({"effects": [{**MAP, "table": {**MAP["table"], "values": [1.0]}}]}, r"values of shape \(1,\)"),
        ({"effects": [{**MAP, "table": {**MAP["table"], "values": [1.0, math.nan]}}]}, "expected a finite grid"),
        ({"effects": [{**MAP, "table": {**MAP["table"], "values": "much"}}]}, "table: cannot be read"),
        ({"effects": [{**MAP, "table": {"values": [1.0, 2.0]}}]}, r"cannot be read \(KeyError"),
        ({"effects": [{**MAP, "table": {**MAP["table"], "grid": 1}}]}, "unknown key 'grid'"),
        ({"sensors": {"resolutoin": 1.0}}, "sensors: unknown key 'resolutoin', expected resolution"),
        ({"sensors": {"noise": -1.0}}, "sensors: noise: -1.0, expected a number from 0"),
        ({"drive": {"limit": "big"}}, "drive: limit: 'big'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        parse_axis(block(**changed), "f")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("f: ")
    assert caught.value.exit_status == 2


@pytest.mark.parametrize("key", ["inertia", "friction"])
def test_required_keys(key: str) -> None:
    content = block()
    del content[key]
    with pytest.raises(InputError, match=f"{key} is missing"):
        parse_axis(content)


@pytest.mark.parametrize("key", ["effects", "sensors", "drive"])
def test_keys_left_empty_are_absent(key: str) -> None:
    assert parse_axis(block(**{key: None})) == parse_axis(block())


def test_files_that_are_no_axis_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_axis(tmp_path / "missing.yaml")
    with pytest.raises(InputError, match="is a directory"):
        load_axis(tmp_path)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match=r"binary: cannot be read|binary: is not YAML"):
        load_axis(tmp_path / "binary")
    (tmp_path / "broken").write_text("axis: [1,\n  2")
    with pytest.raises(InputError, match="broken: line 3: is not YAML") as caught:
        load_axis(tmp_path / "broken")
    assert "\n" not in str(caught.value)
    for content in ([], None, "text"):
        with pytest.raises(InputError, match="expected a mapping"):
            load_axis(written(tmp_path, content))
    with pytest.raises(InputError, match="no axis block"):
        load_axis(written(tmp_path, {"signals": {}}))
    with pytest.raises(InputError, match="unknown key 'axes', expected axis"):
        load_axis(written(tmp_path, {"axes": block()}))


def test_control_block_is_checked(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"control: unknown key 'pid'"):
        parse_control({"pid": {}}, "control", parse_axis(block()))
    with pytest.raises(InputError, match=r"axis\.yaml: control"):
        load_axis(written(tmp_path, {"axis": block(), "control": {"controller": {"gain": 1.0}}}))
    assert load_axis(written(tmp_path, {"axis": block()})).control is None


LUGRE = {"coulomb": 0.3, "static": 0.5, "stribeck_velocity": 0.01, "stiffness": 1e3, "damping": 1.0, "viscous": 0.02}


def test_friction_stands_once(tmp_path: Path) -> None:
    """A compensator has the axis' friction where the file does not state another, and a file that is written leaves it out."""
    axis = block(friction={"law": "lugre", **LUGRE})
    path = written(tmp_path, {"axis": axis, "control": {"compensator": {"negative": {"coulomb": 0.2}, "actuation_delay": 0.01}}})
    file = load_axis(path)
    assert file.control is not None
    found = file.control.compensator
    assert {name: getattr(found.positive, name) for name in LUGRE} == LUGRE
    assert (found.negative.coulomb, found.negative.static, found.actuation_delay) == (0.2, 0.5, 0.01)
    save_axis(path, file)
    assert "positive" not in path.read_text()
    assert load_axis(path) == file
    for without in ({"axis": axis}, {"axis": axis, "control": {}}):
        assert control_of(load_axis(written(tmp_path, without))).compensator.positive.coulomb == 0.3


def examples() -> list[dict[str, Any]]:
    """One axis block for every law and effect, values from the declarations."""
    found = []
    for name, term in laws().items():
        values = {p.name: p.default if p.default is not None else max(p.lower, 0.5) for p in term.parameters}
        found.append(block(friction={"law": name, **values}))
    for name, term in effects().items():
        values = {p.name: min(max(p.lower, 0.5), p.upper) for p in term.parameters}
        entry: dict[str, Any] = {"effect": name, "parameters": values}
        if term.signals:
            entry["signal"] = "wind"
        if term.tabulated:
            entry["table"] = MAP["table"]
        found.append(block(effects=[entry], actuation_delay=0.002, kind="linear"))
    return found


@pytest.mark.parametrize(
    "content",
    examples(),
    ids=lambda c: str(c["effects"][0]["effect"] if "effects" in c else c["friction"]["law"]),
)
def test_every_law_and_effect_survives_a_file(content: dict[str, Any], tmp_path: Path) -> None:
    axis = parse_axis(content)
    save_axis(tmp_path / "a.yaml", AxisFile(axis), comment="first\nsecond")
    text = (tmp_path / "a.yaml").read_text()
    again = load_axis(tmp_path / "a.yaml").axis
    assert text.startswith("# first\n# second\n")
    assert axis_mapping(again) == axis_mapping(axis)
    assert [item.values for item in again.terms] == [item.values for item in axis.terms]
    assert [item.signal for item in again.effects] == [item.signal for item in axis.effects]


@given(
    st.floats(1e-6, 1e9),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1e-3),
    st.sampled_from(["rotary", "linear"]),
)
def test_numbers_survive_exactly(inertia: float, delay: float, noise: float, kind: str) -> None:
    axis = parse_axis(block(inertia=inertia, actuation_delay=delay, kind=kind, sensors={"noise": noise}))
    again = parse_axis(yaml.safe_load(yaml.safe_dump(axis_mapping(axis))))
    assert again == axis


def test_signals_survive(tmp_path: Path, shared_data: Path) -> None:
    file = load_axis(shared_data / "practice" / "match" / "axis.yaml")
    save_axis(tmp_path / "a.yaml", file)
    again = load_axis(tmp_path / "a.yaml")
    assert file.signals is not None
    assert again.signals == file.signals
    assert again.axis == file.axis


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_files_of_the_repository_load(path: Path) -> None:
    if "axis" in load_yaml(path):
        assert load_axis(path).axis.inertia > 0.0


def test_table_is_written_with_its_grid() -> None:
    table = Table(("position", "velocity"), (0.0, -1.0), (1.0, 1.0), np.arange(6.0).reshape(2, 3))
    axis = parse_axis(block())
    with_map = axis.with_effect(instance(effects()["learned_map"], {}, table=table))
    again = parse_axis(yaml.safe_load(yaml.safe_dump(axis_mapping(with_map))))
    assert again.effects[0].table is not None
    assert np.array_equal(again.effects[0].table.values, table.values)


def test_text_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "new" / "file.txt"
    write_whole(path, "first")

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(JobError, match=r"file\.txt: cannot be written \(disk full"):
        write_whole(path, "second")
    assert path.read_text() == "first"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(("period", "slower"), [(1e-4, 1.0), (1e-3, 1.0), (0.01, 0.5236), (0.02, 0.2618), (0.1, 0.05236)])
def test_a_controller_without_a_block_suits_its_period(period: float, slower: float) -> None:
    """Its speed loop's crossover has 20 periods in a cycle; gains scale with the crossover, an integral one with its square."""
    axis = parse_axis({"inertia": 2.0, "friction": {"law": "coulomb_viscous", "coulomb": 1.0, "viscous": 0.0}})
    control, usual = default_control(axis, period), default_control(axis)
    assert control.loop.period == period
    assert control.controller.velocity_proportional == pytest.approx(120.0 * slower, rel=1e-3)
    assert control.controller.position_proportional == pytest.approx(20.0 * slower, rel=1e-3)
    assert control.controller.velocity_integral == pytest.approx(2000.0 * slower**2, rel=1e-3)
    assert control.observer.bandwidth == pytest.approx(usual.observer.bandwidth * slower, rel=1e-3)
    assert control.controller.velocity_proportional * period / 2.0 <= 2.0 * math.pi / 20.0 * (1.0 + 1e-9)
