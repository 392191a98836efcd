"""Tables are read back: they give the torque of the axis to 1 %."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_axes import axis, effect_of

from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.errors import InputError
from tcs_friction.export.formats import format_named
from tcs_friction.export.request import Exported, Request
from tcs_friction.physics.axis import Axis, Drive
from tcs_friction.physics.registry import laws
from tcs_friction.physics.steady_friction import over_speed, steady

WAVES = axis("lugre", "cogging", "imbalance", "cable_wrap", "torque_bias")


def made(kind: str, of: Axis, **changes: object) -> Exported:
    request = replace(Request(of, Path("axis.yaml"), Path("t.csv"), joint="azimuth", kind=kind), **changes)  # type: ignore[arg-type]
    return format_named("table").export(request)


def columns(found: Exported) -> np.ndarray:
    (text,) = found.files.values()
    rows = list(csv.reader(io.StringIO(str(text))))[1:]
    return np.array(rows, dtype=float).T


def torque_at(places: np.ndarray) -> np.ndarray:
    wave = 20.0 * np.cos(24.0 * places + 0.3) + 4.0 * np.cos(48.0 * places + 1.0) + 30.0 * np.sin(places + 1.0)
    return wave + 50.0 * (places - 0.1) + 9.0 * (places - 0.1) ** 3 + 12.0


@pytest.mark.parametrize("name", laws())
def test_friction_is_that_of_the_axis_between_the_speeds(name: str) -> None:
    of = axis(name, "coulomb_asymmetry")
    speed, _, torque = columns(made("friction", of, speed=0.5))
    between = np.random.default_rng(0).uniform(0.001, 0.5, 40) * np.where(np.arange(40) % 2, 1.0, -1.0)
    assert np.interp(between, speed, torque) == pytest.approx(steady(of, between), rel=0.01)


def test_friction_over_temperature_has_a_curve_for_each() -> None:
    of = axis("coulomb_viscous", "temperature_dependent_friction")
    speed, temperature, torque = columns(made("friction", of, temperatures=(0.0, 40.0)))
    fastest = speed == 1.0
    assert torque[fastest & (temperature == 0.0)] == pytest.approx(60.0 * 1.2 + 50.0 * 1.4)
    assert torque[fastest & (temperature == 40.0)] == pytest.approx(60.0 * 0.8 + 50.0 * 0.6)
    assert any("only 20 degC" in line for line in made("friction", of).lines)


def test_share_and_rest_band_act_on_friction() -> None:
    config = CancellationConfig(share=0.5, rest_speed=0.1, rest_torque=6.0)
    speed, _, torque = columns(made("friction", axis("coulomb_viscous"), compensation=config))
    assert torque[-1] == pytest.approx(0.5 * 110.0)
    assert abs(torque[np.argmin(np.abs(speed))]) == pytest.approx(3.0, rel=0.02)
    assert made("friction", axis("coulomb_viscous"), compensation=config).lines[0] == "all torque times 0.5 (--share)"


def test_torque_over_position_is_that_of_the_effects() -> None:
    position, torque = columns(made("torque", WAVES, travel=(-1.0, 2.0)))
    between = np.random.default_rng(0).uniform(-1.0, 2.0, 200)
    assert np.abs(np.interp(between, position, torque) - torque_at(between)).max() < 0.01 * np.abs(torque).max()
    lines = made("torque", replace(WAVES, effects=(*WAVES.effects, effect_of("torque_ripple")))).lines
    assert any(line.startswith("torque ripple of order 30: not expressed") for line in lines)
    assert any("--kind friction" in line for line in lines)


def test_a_linear_axis_counts_per_metre() -> None:
    position, torque = columns(made("torque", axis("lugre", "cogging", kind="linear"), travel=(0.0, 0.1)))
    expected = 20.0 * np.cos(48.0 * np.pi * position + 0.3) + 4.0 * np.cos(96.0 * np.pi * position + 1.0)
    assert torque == pytest.approx(expected, abs=1e-6)


def test_beckhoff_has_order_phase_and_amplitude() -> None:
    found = made("beckhoff", axis("lugre", "cogging"), compensation=CancellationConfig(share=0.5))
    (text,) = found.files.values()
    rows = [line.split(",") for line in str(text).splitlines()[1:]]
    assert [row[1] for row in rows] == ["07", "08", "09", "0A", "0B", "0C"]
    values = np.array([float(row[3]) for row in rows]).reshape(2, 3)
    angle = np.linspace(0.0, 6.0, 50)
    torque = sum(r * np.cos(n * angle + math.radians(phi)) for n, phi, r in values)
    assert torque == pytest.approx(0.5 * (torque_at(angle) - 30.0 * np.sin(angle + 1.0) - 50.0 * (angle - 0.1)
                                          - 9.0 * (angle - 0.1) ** 3 - 12.0), abs=1e-6)  # fmt: skip


def test_odrive_has_a_map_over_a_turn() -> None:
    found = made("odrive", axis("lugre", "cogging"))
    index, torque = columns(found)
    assert len(index) == 3600
    angle = np.random.default_rng(0).uniform(0.0, 6.2, 100)
    expected = 20.0 * np.cos(24.0 * angle + 0.3) + 4.0 * np.cos(48.0 * angle + 1.0)
    read = np.interp(angle / (2.0 * np.pi) * 3600, index, torque)
    assert np.abs(read - expected).max() < 0.01 * 24.0
    assert not any("does not close" in line for line in found.lines)
    open_ = made("odrive", axis("lugre", "cable_wrap")).lines
    assert any("does not close with the turn" in line for line in open_)


def test_cia402_is_in_thousandths_of_the_rated_torque() -> None:
    of = replace(WAVES, drive=Drive(rated_torque=200.0))
    position, value = columns(made("cia402", of, travel=(-1.0, 1.0)))
    assert np.abs(value / 1000.0 * 200.0 - torque_at(position)).max() <= 0.5 * 0.2 + 1e-6


@pytest.mark.parametrize("name", ["lugre", "coulomb_viscous", "free_curve"])
def test_linuxcnc_has_sixteen_points(name: str) -> None:
    found = made("linuxcnc", axis(name), speed=0.5)
    (text,) = found.files.values()
    points = re.findall(r"setp azimuth-friction\.([xy])-val-(\d\d) (\S+)", str(text))
    x, y = (np.array([float(value) for letter, _, value in points if letter == which]) for which in "xy")
    assert len(x) <= 16
    assert np.all(np.diff(x) > 0.0)
    assert f"personality={len(x)}" in str(text)
    speeds = np.array([-0.4, -0.03, 0.005, 0.05, 0.3])
    off = float(re.findall(r"at most ([\d.e-]+) % off", "\n".join(found.lines))[0])
    assert off < 1.0
    assert np.interp(speeds, x, y) == pytest.approx(steady(axis(name), speeds), rel=0.011)


@pytest.mark.parametrize(
    ("kind", "of", "words"),
    [
        ("torque", axis("lugre"), "no effect is a torque over the position"),
        ("beckhoff", axis("lugre", "cogging", kind="linear"), "a linear axis"),
        ("beckhoff", axis("lugre", "imbalance"), "no wave over the position"),
        ("beckhoff", replace(axis("lugre"), effects=(effect_of("cogging", order=3.3),)), "no wave over the position"),
        ("odrive", axis("lugre", "cogging", kind="linear"), "a linear axis"),
        ("cia402", WAVES, "rated_torque is missing"),
        ("cia402", replace(WAVES, drive=Drive(rated_torque=1e-3)), "thousandths, expected at most 32767"),
        ("odrive", replace(WAVES, torque_unit="A"), "its torque is in A"),
        ("beckhoff", replace(WAVES, torque_unit="A"), "its torque is in A"),
        ("coffee", WAVES, "no kind 'coffee' of table"),
    ],
)
def test_what_a_drive_cannot_hold_is_refused(kind: str, of: Axis, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(kind, of)


def test_too_fine_a_table_and_no_speed_are_refused() -> None:
    with pytest.raises(InputError, match="at most 200000"):
        made("torque", WAVES, travel=(0.0, 1e5))
    with pytest.raises(InputError, match="a speed above 0"):
        made("friction", WAVES, speed=0.0)


def test_a_wave_that_a_drive_cannot_count_is_said() -> None:
    of = replace(axis("lugre", "cogging"), effects=(effect_of("cogging"), effect_of("cogging", order=150.0)))
    lines = made("beckhoff", of).lines
    assert any("wave 300 is no whole number up to 200" in line for line in lines)
    assert len(over_speed(of)) == 0
