"""Each effect against its formula in the vocabulary, by calling its kernel on chosen instants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from physics_cases import SIGNALS, TABLE, VALUES, plain

from tcs_friction.physics import terms
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import Instance, Place, Role, Survey, Table, instance

COORDINATES = {
    "time",
    "position",
    "velocity",
    "direction",
    "acceleration",
    "frequency",
    "torque",
    "temperature",
    "time_since_reversal",
    "exogenous",
}


def motion(**values: float) -> np.ndarray:
    """A motion vector; names of slots in lower case, `other` and `wind` for the recorded signals, `other_rate` for a rate."""
    vector = np.zeros(terms.signal_slot(len(SIGNALS)))
    vector[[terms.CYCLE, terms.DRY_SCALE, terms.VISCOUS_SCALE]] = 1.0
    vector[terms.TEMPERATURE], vector[terms.INERTIA] = 20.0, 1000.0
    for name, value in values.items():
        signal = name.removesuffix("_rate")
        slot = terms.signal_slot(SIGNALS.index(signal)) if signal in SIGNALS else getattr(terms, name.upper())
        vector[slot + (signal != name)] = value
    return vector


def called(item: Instance, *vectors: np.ndarray, dt: float = 1e-3) -> float:
    """What the kernel returns at the last of these instants."""
    state = np.zeros(item.term.state_size(item.values, dt))
    packed = item.packed(SIGNALS)
    return [float(item.term.kernel(vector, packed, state, dt)) for vector in vectors][-1]


Q, V, T = terms.POSITION, terms.VELOCITY, terms.TIME
OPPOSING = {
    "cable_wrap": lambda m: 100.0 * (m[Q] - 0.1) + 500.0 * (m[Q] - 0.1) ** 3,
    "cogging": lambda m: 5.0 * math.cos(72.0 * m[Q] + 0.3) + 2.0 * math.cos(144.0 * m[Q] + 1.0),
    "imbalance": lambda m: 20.0 * math.sin(m[Q] + 0.2),
    "load_step": lambda m: 10.0 if m[T] >= 1.5 else 0.0,
    "periodic_vibration": lambda m: 8.0 * math.sin(2.0 * math.pi * 7.0 * m[T] + 1.0),
    "quadratic_drag": lambda m: 3000.0 * m[V] * abs(m[V]),
    "torque_bias": lambda _: 9.0,
    "viscous_asymmetry": lambda m: 100.0 * abs(m[V]),
    "encoder_periodic_error": lambda m: 1e-4 * math.sin(40.0 * m[Q] + 0.4),
}


@pytest.mark.parametrize("name", sorted(OPPOSING))
@given(st.floats(-10.0, 10.0), st.floats(-1.0, 1.0), st.floats(0.0, 100.0))
def test_formula_of_position_velocity_and_time(name: str, q: float, v: float, t: float) -> None:
    vector = motion(position=q, velocity=v, time=t)
    assert called(plain(name), vector) == pytest.approx(OPPOSING[name](vector), rel=1e-9, abs=1e-12)


PERIODIC = sorted(name for name, term in effects().items() if term.periodic == "position")


@pytest.mark.parametrize("name", PERIODIC)
def test_a_wave_is_silent_where_half_of_it_passes_in_a_step(name: str) -> None:
    item = plain(name)
    half = math.pi / item.values["order"]
    silent = (50.0 if item.term.place is Place.DRIVE else 0.0, 1.0)

    def shown(travel: float) -> tuple[float, float]:
        vector = motion(position=0.01, velocity=0.2, torque=50.0, travel=travel)
        result = called(item, vector)
        return result, vector[terms.DRY_SCALE]

    assert shown(-0.4 * half) == shown(0.4 * half) == shown(0.0) != silent
    assert shown(-1.01 * half) == shown(1.01 * half) == silent


@given(st.floats(-30.0, 30.0))
def test_recorded_signals(s: float) -> None:
    assert called(plain("exogenous"), motion(other=s)) == pytest.approx(5.0 * s + 3.0 * s * abs(s))
    assert called(plain("wind_torque"), motion(wind=s)) == pytest.approx(2.0 * s * abs(s))


def test_cross_axis_coupling_takes_the_acceleration_from_the_velocity() -> None:
    """The rate of the recorded velocity, which stands behind its value."""
    assert called(plain("cross_axis_coupling"), motion(other=0.1)) == 0.0
    assert called(plain("cross_axis_coupling"), motion(other=0.1, other_rate=0.4)) == pytest.approx(
        60.0 * 0.4
    )


ONE, NOTHING = (lambda _: 1.0), (lambda _: 0.0)
DRY_FACTORS = {
    "coulomb_asymmetry": lambda m: 1.1 if m[V] >= 0.0 else 0.9,
    "position_dependent_friction": lambda m: 1.0 + 0.2 * math.cos(20.0 * m[Q] + 0.5),
    "local_friction_bump": lambda m: 1.0 + 0.3 * math.exp(-(((m[Q] - 0.31) / 0.02) ** 2)),
    "temperature_dependent_friction": lambda m: 1.0 - 0.02 * (m[terms.TEMPERATURE] - 20.0),
    "warmup_drift": lambda m: 1.0 + 0.2 * math.exp(-m[T] / 1.5),
}
VISCOUS_FACTORS = {
    "temperature_dependent_friction": lambda m: 1.0 - 0.05 * (m[terms.TEMPERATURE] - 20.0),
    "warmup_drift": lambda m: 1.0 + 0.3 * math.exp(-m[T] / 1.5),
}
EXTRA_LEVELS = {
    "load_dependent_friction": lambda m: 0.1 * abs(m[terms.TORQUE]),
    "stribeck": lambda m: 30.0 * math.exp(-((m[V] / 0.02) ** 2)),
}
SCALES = {*DRY_FACTORS, *VISCOUS_FACTORS, *EXTRA_LEVELS}


@pytest.mark.parametrize("name", sorted(SCALES))
@given(
    st.floats(-1.0, 1.0),
    st.floats(0.2, 0.4),
    st.floats(0.0, 10.0),
    st.floats(0.0, 40.0),
    st.floats(-300.0, 300.0),
)
def test_factor_on_the_friction(
    name: str, v: float, q: float, t: float, temperature: float, u: float
) -> None:
    vector = motion(velocity=v, position=q, time=t, temperature=temperature, torque=u)
    assert called(plain(name), vector) == 0.0
    assert vector[terms.DRY_SCALE] == pytest.approx(DRY_FACTORS.get(name, ONE)(vector))
    assert vector[terms.VISCOUS_SCALE] == pytest.approx(VISCOUS_FACTORS.get(name, ONE)(vector))
    assert vector[terms.EXTRA_LEVEL] == pytest.approx(EXTRA_LEVELS.get(name, NOTHING)(vector))


def test_every_scale_term_is_checked_here() -> None:
    assert {name for name, term in effects().items() if term.place is Place.SCALE} == SCALES


def test_torque_ripple() -> None:
    expected = 50.0 * (1.0 + 0.05 * math.cos(30.0 * 0.7 + 0.2))
    assert called(plain("torque_ripple"), motion(torque=50.0, position=0.7)) == pytest.approx(expected)


def test_position_dependent_inertia_is_lagranges() -> None:
    vector = motion(position=0.7, velocity=0.2)
    found = called(plain("position_dependent_inertia"), vector)
    assert vector[terms.INERTIA] == pytest.approx(1000.0 * (1.0 + 0.2 * math.cos(1.4 + 0.3)))
    slope = -2.0 * 1000.0 * 0.2 * math.sin(1.4 + 0.3)
    assert found == pytest.approx(0.5 * slope * 0.2**2)


def test_cable_hysteresis_turns_over_with_travel_only() -> None:
    item = plain("cable_hysteresis")
    there = [motion(travel=0.001)] * 200
    assert called(item, *there) == pytest.approx(10.0, rel=1e-6)
    back = [motion(travel=-0.001)] * 10
    assert called(item, *there, *back) == pytest.approx(10.0 * (2.0 * math.exp(-1.0) - 1.0), rel=1e-6)
    assert called(item, *there, motion(travel=0.0), dt=100.0) == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize("exponent", [0.0, 0.3, 0.5, 1.0 - 1e-9])
def test_cable_hysteresis_follows_the_law_of_dahl(exponent: float) -> None:
    """Steps are exact: one long step does what many short ones do, and those follow ds/dq = (1 - s sign(v))^exponent / width."""
    item = plain("cable_hysteresis").replace(exponent=exponent)
    slope, width = 1e-6, item.values["width"]
    for travel in (0.0, 0.3 * width, -0.7 * width):
        before = called(item, motion(travel=travel)) / 10.0
        after = called(item, motion(travel=travel), motion(travel=slope * width)) / 10.0
        assert (after - before) / slope == pytest.approx((1.0 - before) ** exponent, rel=1e-4)
    assert called(item, *[motion(travel=0.01 * width)] * 70) == pytest.approx(called(item, motion(travel=0.7 * width)), rel=1e-9)


def test_a_cable_that_slips_at_once_is_a_spring_that_gives_way() -> None:
    item = plain("cable_hysteresis").replace(exponent=0.0)
    width = item.values["width"]
    for travel, expected in ((0.4, 4.0), (1.5, 10.0), (-0.25, -2.5)):
        assert called(item, motion(travel=travel * width)) == pytest.approx(expected)
    assert called(item, motion(travel=5.0 * width), motion(travel=-0.5 * width)) == pytest.approx(5.0)


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0031, 0.02])
def test_transport_delay_shifts_a_line_exactly(delay: float) -> None:
    item = instance(effect("transport_delay"), {"delay": delay})
    line = [motion(torque=3.0 * k * 1e-3) for k in range(500)]
    assert called(item, *line) == pytest.approx(3.0 * (499 * 1e-3 - delay), abs=1e-12)


@pytest.mark.parametrize("constant", [0.0, 1e-4, 0.004, 0.1])
def test_actuator_lag_is_exact_for_a_ramp(constant: float) -> None:
    item = instance(effect("actuator_lag"), {"time_constant": constant})
    t = np.arange(400) * 1e-3
    found = called(item, *[motion(torque=3.0 * x) for x in t])
    expected = 3.0 * (t[-1] - constant * (1.0 - math.exp(-t[-1] / constant))) if constant else 3.0 * t[-1]
    assert found == pytest.approx(expected, rel=1e-9)


def test_learned_map_interpolates_and_holds_its_edges() -> None:
    item = plain("learned_map")
    for q, expected in ((0.2, -8.0), (0.25, -1.5), (0.3, 5.0), (0.45, -2.0), (0.1, -8.0), (9.0, -6.0)):
        assert called(item, motion(position=q)) == pytest.approx(expected)
    grid = Table(("velocity", "exogenous:wind"), (0.0, 0.0), (1.0, 2.0), np.array([[0.0, 2.0], [4.0, 8.0]]))
    item = instance(effect("learned_map"), {}, table=grid)
    assert called(item, motion(velocity=0.5, wind=1.0)) == pytest.approx(3.5)
    assert TABLE.values.shape == (4,)


@pytest.mark.parametrize("name", sorted(VALUES))
def test_declaration_is_complete(name: str) -> None:
    term = effect(name)
    assert term.id == name
    assert term.form
    assert term.coordinate in COORDINATES
    for parameter in term.parameters:
        assert parameter.description
        assert parameter.lower < parameter.upper
    roles = [parameter.role for parameter in term.parameters]
    for i, role in enumerate(roles):
        assert role is not Role.PHASE or roles[i - 1] is Role.LINEAR


def linear_parameters(name: str) -> list[str]:
    return [p.name for p in effect(name).parameters if p.role is Role.LINEAR]


PROPORTIONAL = [n for n in VALUES if effect(n).place is Place.OPPOSING and linear_parameters(n)]


@pytest.mark.parametrize("name", sorted(PROPORTIONAL))
def test_linear_parameters_are_linear(name: str) -> None:
    """What is declared proportional to a parameter is: a fit relies on it."""
    item = plain(name)
    instant = motion(position=0.31, velocity=0.01, time=2.0, travel=1e-5, other=0.3, other_rate=0.1, wind=2.0)
    before = motion(position=0.31, velocity=0.01, time=2.0, travel=1e-5, other=0.1, wind=1.0)
    once = called(item, before.copy(), instant.copy())
    doubled = item.replace(**{n: 2.0 * item.values[n] for n in linear_parameters(name)})
    assert once != 0.0
    assert called(doubled, before.copy(), instant.copy()) == pytest.approx(2.0 * once)


@pytest.mark.parametrize("name", sorted(VALUES))
def test_starts_of_a_search_are_within_bounds(name: str) -> None:
    survey = Survey((-0.5, 6.0), 1e-4, 0.16, 0.0, 340.0, 20.0, 5e-8, 1000.0, 80.0, 3e-4)
    term = effect(name)
    starts = list(term.scan(survey))
    assert starts
    for start in starts:
        for key, value in start.items():
            term.parameter(key).check(value, name)
