"""References: consistent derivatives, the formulas they stand for, and what a bad file says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tcs_friction.control.reference import (
    KINDS,
    UNSHAPED,
    Legs,
    Multisine,
    Reference,
    ReferenceConfig,
    SatellitePass,
    SiderealTrack,
    Sinusoid,
    Steps,
    SweptSine,
    load_reference,
    reference_from_mapping,
)
from tcs_friction.control.reference_kernels import EARTH_GRAVITY, EARTH_RADIUS, SIDEREAL_RATE
from tcs_friction.control.shaper import Shaper
from tcs_friction.errors import InputError

SMOOTH = [kind for kind in KINDS if kind != "steps"]
number = st.floats


def configurations() -> st.SearchStrategy[ReferenceConfig]:
    axis = st.sampled_from(["azimuth", "elevation"])
    return st.one_of(
        st.builds(Sinusoid, number(0, 2), number(0.5, 100), number(-4, 4), number(-3, 3)),
        st.builds(
            Multisine,
            number(0, 0.1),
            number(0.01, 1),
            number(0.01, 0.2),
            st.integers(1, 20),
            speed=number(-1, 1),
        ),
        st.builds(
            SweptSine, number(0, 0.1), number(0.1, 1), number(1, 5), number(5, 50), speed=number(-1, 1)
        ),
        st.builds(Legs, number(1e-4, 0.1), number(0, 20), number(1e-3, 0.1), number(-3, 3)),
        st.builds(SatellitePass, axis, number(3e5, 2e6), number(0.1, 1.5), number(-100, 100), number(-3, 3)),
        st.builds(
            SiderealTrack, axis, number(-6, 6), st.sampled_from([-1.2, -0.4, 0.1, 1.3]), number(0.2, 0.9)
        ),
    )


@settings(max_examples=150, deadline=None)
@given(configurations(), number(0.1, 200.0))
@example(SweptSine(0.0625, 0.9999999999999999, 1.0, 5.0), 1.0)  # hardly a sweep
def test_speed_and_acceleration_are_the_derivatives(config: ReferenceConfig, t: float) -> None:
    reference = Reference(config)
    h = 1e-4
    before, here, after = (reference.at(t + s) for s in (-h, 0.0, h))
    neighbours = np.array([before, here, after])
    if isinstance(config, SweptSine) and abs(t - config.sweep) < 2 * h:
        return  # the sweep's end is a kink of the acceleration
    size = np.max(np.abs(neighbours), axis=0)
    speed = (after[0] - before[0]) / (2 * h)
    acceleration = (after[1] - before[1]) / (2 * h)
    rounding = 1e-15 * (size[0] + 1.0) / h + 1e-9
    assert speed == pytest.approx(here[1], rel=1e-3, abs=1e-4 * size[1] + h * size[2] + rounding)
    rounding = 1e-15 * (size[1] + 1e-6) / h + 1e-12
    jerk = np.max(np.abs(np.diff(neighbours[:, 2])))
    assert acceleration == pytest.approx(here[2], rel=1e-3, abs=jerk + 1e-5 * size[2] + rounding)


@pytest.mark.parametrize("kind", SMOOTH)
def test_position_is_the_integral_of_the_speed(kind: str) -> None:
    t = np.linspace(0.0, 300.0, 300_001)
    samples = Reference(KINDS[kind]()).over(t)
    for order in (0, 1):
        travelled = np.cumsum(0.5 * (samples[1:, order + 1] + samples[:-1, order + 1])) * 1e-3
        size = np.max(np.abs(samples[:, order])) + 1e-12
        tolerance = 2e-2 if kind == "swept_sine" else 1e-4  # 50 Hz on a 1 kHz grid
        np.testing.assert_allclose(
            samples[1:, order] - samples[0, order], travelled, rtol=0, atol=tolerance * size
        )


@pytest.mark.parametrize("kind", list(KINDS))
def test_one_instant_is_as_many(kind: str) -> None:
    reference = Reference(KINDS[kind]())
    t = np.linspace(0.0, 90.0, 7)
    np.testing.assert_array_equal(reference.over(t), [reference.at(x) for x in t])


def test_sinusoid_starts_at_rest_by_default() -> None:
    position, velocity, _ = Reference(Sinusoid(amplitude=0.5, period=10.0, center=2.0)).at(0.0)
    assert position == pytest.approx(1.5)
    assert velocity == pytest.approx(0.0, abs=1e-15)


def test_multisine_has_its_lines_and_a_low_crest() -> None:
    config = Multisine(velocity_amplitude=0.01, lowest_frequency=0.5, frequency_step=0.5, components=30)
    velocity = Reference(config).over(np.arange(2000) * 1e-3)[:, 1]
    lines = np.abs(np.fft.rfft(velocity)) / 1000
    np.testing.assert_allclose(lines[1:31], 0.01, rtol=1e-9)
    assert np.max(lines[31:]) < 1e-12
    assert np.max(np.abs(velocity)) / np.std(velocity) < 2.0  # 7.7 were they in phase


def test_swept_sine_sweeps() -> None:
    config = SweptSine(velocity_amplitude=0.01, lowest_frequency=1.0, highest_frequency=10.0, sweep=30.0)
    t = np.arange(60_000) * 1e-3
    velocity = Reference(config).over(t)[:, 1]
    turns = t[1:][np.diff(np.sign(velocity)) != 0]
    np.testing.assert_allclose(0.5 / np.diff(turns)[:3], 1.0, rtol=0.15)
    np.testing.assert_allclose(0.5 / np.diff(turns)[-3:], 10.0, rtol=0.02)
    assert np.max(np.abs(velocity)) == pytest.approx(0.01, rel=0.02)


def test_steps_climb_and_descend() -> None:
    reference = Reference(Steps(start=1.0, height=0.5, dwell=2.0, count=2))
    levels = [reference.at(t)[0] for t in (0.0, 1.9, 2.0, 4.0, 6.0, 8.0)]
    assert levels == [1.0, 1.0, 1.5, 2.0, 1.5, 1.0]
    assert reference.at(3.0)[1:] == (0.0, 0.0)


def test_legs_keep_their_limits() -> None:
    config = Legs(speed=2e-3, leg=5.0, acceleration=4e-3, start=0.3)
    samples = Reference(config).over(np.linspace(0.0, 60.0, 60_001))
    assert samples[0].tolist() == [0.3, 0.0, 4e-3]
    assert np.max(np.abs(samples[:, 1])) == pytest.approx(2e-3)
    assert np.max(np.abs(samples[:, 2])) == pytest.approx(4e-3)
    period = 2.0 * (5.0 + 4.0 * 2e-3 / 4e-3)
    again = Reference(config).at(period + 1.234)
    np.testing.assert_allclose(again, Reference(config).at(1.234), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("maximum_elevation", [0.3, 1.0, 1.5])
def test_satellite_pass_is_a_circular_orbit(maximum_elevation: float) -> None:
    """Against vectors: the orbit plane turned about the station's horizon, seen from the station."""
    config = SatellitePass("azimuth", 5e5, maximum_elevation, culmination=0.0)
    azimuth = Reference(config)
    elevation = Reference(replace(config, axis="elevation"))
    assert elevation.at(0.0)[0] == pytest.approx(maximum_elevation, abs=1e-9)
    assert azimuth.at(0.0)[0] == pytest.approx(0.0, abs=1e-12)
    radius = EARTH_RADIUS + 5e5
    rate = math.sqrt(EARTH_GRAVITY / radius**3)
    # the slant range at culmination, by the cosine rule, gives the station's distance from the orbit plane
    s = math.sin(maximum_elevation)
    slant = -EARTH_RADIUS * s + math.sqrt((EARTH_RADIUS * s) ** 2 + radius**2 - EARTH_RADIUS**2)
    central = math.acos((radius**2 + EARTH_RADIUS**2 - slant**2) / (2 * radius * EARTH_RADIUS))
    for t in (-150.0, 40.0, 200.0):
        turn = np.array(
            [[1, 0, 0], [0, math.cos(central), math.sin(central)], [0, -math.sin(central), math.cos(central)]]
        )
        sight = radius * (turn @ [math.sin(rate * t), 0.0, math.cos(rate * t)]) - [0.0, 0.0, EARTH_RADIUS]
        assert azimuth.at(t)[0] == pytest.approx(math.atan2(sight[0], sight[1]), abs=1e-9)
        assert elevation.at(t)[0] == pytest.approx(math.asin(sight[2] / np.linalg.norm(sight)), abs=1e-9)


def test_sidereal_track_culminates_where_it_must() -> None:
    config = SiderealTrack("elevation", 0.0, 0.3, 0.75)
    assert Reference(config).at(0.0)[0] == pytest.approx(math.pi / 2 - 0.45)
    azimuth, rate, _ = Reference(replace(config, axis="azimuth")).at(0.0)
    assert azimuth == pytest.approx(math.pi)
    assert rate == pytest.approx(SIDEREAL_RATE * math.cos(0.3) / math.sin(0.45))  # Meeus


def test_sidereal_track_agrees_with_the_book() -> None:
    """Meeus, Astronomical Algorithms, example 13.b: azimuth from the south 68.0337, altitude 15.1249 deg."""
    degree = math.pi / 180.0
    config = SiderealTrack("azimuth", 64.352133 * degree, -6.719892 * degree, 38.921389 * degree)
    assert Reference(config).at(0.0)[0] == pytest.approx((68.0337 + 180.0) * degree, abs=1e-5)
    elevation = Reference(replace(config, axis="elevation"))
    assert elevation.at(0.0)[0] == pytest.approx(15.1249 * degree, abs=1e-5)


@pytest.mark.parametrize(("declination", "latitude"), [(0.3, 1.4), (1.3, 0.7), (-0.3, -1.4), (-1.3, -0.7)])
def test_azimuth_of_a_circumpolar_star_never_jumps(declination: float, latitude: float) -> None:
    t = np.arange(0.0, 3 * 86164.0, 20.0)
    azimuth = Reference(SiderealTrack("azimuth", 0.0, declination, latitude)).over(t)[:, 0]
    assert np.max(np.abs(np.diff(azimuth))) < 0.02


def test_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "reference.yaml"
    file.write_text("reference: {kind: sinusoid, amplitude: 0.02, period: 8, duration: 30}\n")
    reference = load_reference(file)
    assert reference.config == Sinusoid(amplitude=0.02, period=8.0, duration=30.0)
    assert reference.duration == 30.0
    assert reference.shaper == UNSHAPED
    file.write_text("reference: {kind: sinusoid}\nshaper: {kind: zvd, frequency: 7, damping: 0.02}\n")
    assert load_reference(file).shaper == Shaper("zvd", 7.0, 0.02)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("reference: {kind: sinusiod}", r"unknown kind 'sinusiod', expected sinusoid"),
        ("reference: {amplitude: 1.0}", "kind is missing, expected one of hold"),
        ("reference: {kind: sinusoid, amplitud: 1.0}", r"unknown key 'amplitud', expected amplitude"),
        ("reference: {kind: sinusoid, period: 0}", "period is 0, expected a number from 0.001"),
        ("reference: {kind: sinusoid, amplitude: .nan}", "amplitude is nan"),
        ("reference: {kind: satellite_pass, axis: polar}", "axis is 'polar', expected one of azimuth"),
        ("reference: 3", "no mapping named reference"),
        ("reference: {kind: hold}\nother: 1", "unknown key 'other', expected reference or shaper"),
        ("reference: {kind: hold}\nshaper: {kind: zv, frequenzy: 3}", "shaper: unknown key 'frequenzy', expected frequency"),
        ("reference: {kind: hold}\nshaper: {kind: zv, damping: 2}", "shaper: damping is 2, expected a number from 0 to 0.99"),
        ("reference: {kind: hold}\nshaper: zv", "shaper: 'zv', expected a mapping"),
        ("reference: {", "not YAML"),
        ("", "expected a mapping"),
    ],
)
def test_bad_file_is_refused_in_one_line(tmp_path: Path, text: str, found: str) -> None:
    file = tmp_path / "reference.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=found) as caught:
        load_reference(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.yaml: no such file"):
        load_reference(tmp_path / "nothing.yaml")


def test_values_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(InputError, match="highest_frequency is 1, expected at least lowest_frequency"):
        Reference(SweptSine(lowest_frequency=2.0, highest_frequency=1.0))
    with pytest.raises(InputError, match="leads through the zenith"):
        reference_from_mapping({"kind": "sidereal_track", "declination": 0.5, "latitude": 0.5}, "reference")
