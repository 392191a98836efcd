"""Declarations: parameters, instances, tables, and what is said when a value is wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from physics_cases import LUGRE, TABLE, plain

from tcs_friction.errors import InputError
from tcs_friction.physics import terms
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import (
    Local,
    Parameter,
    Place,
    Role,
    Table,
    geometric,
    instance,
    no_scan,
    unit_on,
)

COGGING = {"order": 72.0, "amplitude": 2.0}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -0.1, 1.1, "0.5", None, True])
def test_parameter_refuses_what_is_no_number_in_its_bounds(value: object) -> None:
    parameter = Parameter("share", "1", "a share", lower=0.0, upper=1.0)
    with pytest.raises(InputError, match=r"^axis: share is .*, expected a number from 0 to 1"):
        parameter.check(value, "axis")


@pytest.mark.parametrize("value", [0, 0.0, 0.5, 1.0])
def test_parameter_takes_its_bounds(value: float) -> None:
    assert Parameter("share", "1", "a share", lower=0.0, upper=1.0).check(value, "axis") == value


@pytest.mark.parametrize(
    ("rotary", "linear"),
    [
        ("N m", "N"),
        ("N m s/rad", "N s/m"),
        ("kg m^2", "kg"),
        ("rad", "m"),
        ("1/turn", "1/m"),
        ("s", "s"),
        ("N m/rad^3", "N/m^3"),
    ],
)
def test_units_of_a_linear_axis(rotary: str, linear: str) -> None:
    assert unit_on("linear", rotary) == linear
    assert unit_on("rotary", rotary) == rotary
    assert Parameter("p", rotary, "").unit_for("linear") == linear
    assert Parameter("p", rotary, "").unit_for("rotary") == rotary


def test_a_phase_is_an_angle_on_any_axis() -> None:
    assert Parameter("phase", "rad", "", role=Role.PHASE).unit_for("linear") == "rad"


def test_unknown_parameter_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown parameter 'amplitud', expected amplitude"):
        instance(effect("cogging"), {"order": 72.0, "amplitud": 2.0})


def test_missing_parameter_is_named_with_its_unit() -> None:
    with pytest.raises(InputError, match="stiffness is missing, expected a number in N m/rad"):
        instance(law("dahl_viscous"), {"coulomb": 1.0, "viscous": 1.0})


def test_missing_signal_and_table() -> None:
    with pytest.raises(InputError, match="signal is missing"):
        instance(effect("wind_torque"), {"coefficient": 1.0})
    with pytest.raises(InputError, match="table is missing"):
        instance(effect("learned_map"), {})


def test_defaults_are_filled_and_values_read_only() -> None:
    item = instance(effect("cogging"), COGGING)
    assert item.values["phase"] == 0.0
    assert item.values["amplitude_4"] == 0.0
    with pytest.raises(TypeError):
        item.values["order"] = 1.0  # type: ignore[index]


def test_replace_checks_again_and_keeps_signal_and_table() -> None:
    assert plain("wind_torque").replace(coefficient=3.0).signal == "wind"
    assert plain("learned_map").replace().table is TABLE
    with pytest.raises(InputError, match="stiffness is -1"):
        LUGRE.replace(stiffness=-1.0)


def test_packing_puts_the_signal_slot_behind_the_values() -> None:
    packed = plain("wind_torque").packed(("other", "wind"))
    assert packed.tolist() == [2.0, terms.signal_slot(1)]
    with pytest.raises(InputError, match=r"no recorded signal named 'wind', expected one of: none"):
        plain("wind_torque").packed(())


def test_table_coordinates_have_to_exist() -> None:
    table = Table(("exogenous:sun",), (0.0,), (1.0,), np.zeros(2))
    with pytest.raises(InputError, match="no coordinate 'exogenous:sun'"):
        instance(effect("learned_map"), {}, table=table).packed(("wind",))


def test_term_finds_its_parameters() -> None:
    assert law("lugre").parameter("damping").unit == "N m s/rad"
    assert law("lugre").state_size(LUGRE.values, 1e-3) == 1
    assert effect("transport_delay").state_size({"delay": 0.01}, 1e-3) >= 11


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"coordinate": "positon"}, "term cogging: unknown coordinate 'positon', expected position"),
        ({"periodic": "space"}, "term cogging: periodic is 'space', expected position, time or nothing"),
        ({"frequency": "ordr"}, "term cogging: no parameter 'ordr', expected order"),
        ({"alignment": "phas"}, "term cogging: no parameter 'phas', expected phase"),
        ({"local": Local("order", "width")}, "term cogging: no parameter 'width'"),
        ({"place": Place.LAW}, "the level of its dry friction is unknown, expected one parameter with the feature DRY"),
    ],
)
def test_a_declaration_that_contradicts_itself_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(effect("cogging"), **changes)


def test_harmonics_are_the_amplitudes_with_their_phases() -> None:
    names = [(a.name, p.name) for a, p in effect("cogging").harmonics if p is not None]
    assert names == [("amplitude", "phase"), *((f"amplitude_{j}", f"phase_{j}") for j in (2, 3, 4))]
    assert [a.name for a, _ in effect("periodic_vibration").harmonics] == ["amplitude"]
    assert effect("imbalance").harmonics == ()


def test_where_an_instance_shows() -> None:
    assert plain("cogging").order == 72.0
    assert (plain("periodic_vibration").frequency, plain("flexible_mode").frequency) == (7.0, 20.0)
    assert plain("cogging").frequency is None
    assert plain("local_friction_bump").extent == pytest.approx((0.29, 0.33))
    assert plain("load_step").extent == (1.5, None)
    assert plain("torque_bias").extent is None


def test_orders_to_search() -> None:
    """A torque is periodic with several periods over the travel; uneven friction varies slowly."""
    once = 0.5  # order with one period over two turns
    assert effect("cogging").orders(once, True) == (4.0 * once, math.inf)
    assert effect("cogging").orders(0.1, True)[0] == 1.5  # once per turn is gravity's
    assert effect("cogging").orders(0.1, False)[0] == pytest.approx(0.4)
    assert effect("position_dependent_friction").orders(once, True) == (0.25, 12.0)


def test_which_signal_suits() -> None:
    for name, (wind, other) in {"wind_torque": (1, 0), "cross_axis_coupling": (0, 1), "exogenous": (1, 1)}.items():
        assert (effect(name).suits("Wind_speed"), effect(name).suits("elevation_velocity")) == (wind, other)


def test_geometric_series() -> None:
    assert geometric(1.0, 100.0, 3) == pytest.approx([1.0, 10.0, 100.0])
    assert list(no_scan(None)) == [{}]  # type: ignore[arg-type]
