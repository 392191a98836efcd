"""The axis as data: what it accepts, the order of its terms, the step it asks for."""

from __future__ import annotations

import math
from typing import Any

import pytest
from physics_cases import COULOMB, LUGRE, plain

from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.simulate import LONGEST_STEP, substeps_for
from tcs_friction.physics.terms import Place


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inertia": 0.0}, "axis a: inertia: 0.0, expected a positive number"),
        ({"inertia": -1.0}, "inertia"),
        ({"inertia": math.nan}, "inertia"),
        ({"inertia": math.inf}, "inertia"),
        ({"kind": "sideways"}, "axis a: kind: 'sideways', expected rotary or linear"),
        ({"actuation_delay": -1e-3}, "actuation_delay: -0.001, expected 0 to 10 s"),
        ({"actuation_delay": math.nan}, "actuation_delay"),
        ({"friction": plain("cogging")}, "friction: cogging is an effect, expected a friction law"),
        ({"effects": (COULOMB,)}, "effects: coulomb_viscous is a friction law, expected an effect"),
    ],
)
def test_wrong_axis_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Axis(**{"name": "a", "inertia": 1.0, "friction": LUGRE, **changed})


def test_terms_act_in_the_order_of_their_places() -> None:
    names = (
        "encoder_periodic_error",
        "flexible_mode",
        "presliding",
        "cogging",
        "coulomb_asymmetry",
        "actuator_lag",
    )
    axis = Axis("a", 1.0, COULOMB, tuple(plain(name) for name in names), actuation_delay=1e-3)
    order = [item.term.id for item in axis.terms]
    places = [list(Place).index(item.term.place) for item in axis.terms]
    assert places == sorted(places)
    assert order[0] == "transport_delay"
    assert order.index("presliding") < order.index("cogging")  # it changes the friction that others may read


def test_no_delay_no_term() -> None:
    assert [item.term.id for item in Axis("a", 1.0, LUGRE).terms] == ["lugre"]


def test_changed_axes_leave_the_old_one() -> None:
    axis = Axis("a", 1.0, LUGRE)
    assert axis.with_friction({"coulomb": 50.0}).friction.values["coulomb"] == 50.0
    assert [item.term.id for item in axis.with_effect(plain("cogging")).effects] == ["cogging"]
    assert axis.friction.values["coulomb"] == 78.0
    assert axis.effects == ()


def test_phase_per_unit() -> None:
    assert Axis("a", 1.0, LUGRE).cycle == 1.0
    assert Axis("a", 1.0, LUGRE, kind="linear").cycle == pytest.approx(2.0 * math.pi)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("flexible_mode", 2.0 * math.pi * 20.0),
        ("backlash", 2.0 * math.pi * 50.0),
        ("actuator_lag", 0.1 / 0.004),
        ("periodic_vibration", 2.0 * math.pi * 7.0),
    ],
)
def test_step_resolves_the_fastest_effect(name: str, least: float) -> None:
    assert Axis("a", 1000.0, LUGRE, (plain(name),)).fastest_rate() >= least


def test_substeps_are_short_against_stiff_friction() -> None:
    assert substeps_for(Axis("a", 1000.0, LUGRE), 1e-3) == math.ceil(1e-3 / LONGEST_STEP)
    stiff = Axis("a", 1.0, LUGRE.replace(stiffness=1e10, damping=0.0))
    assert 1e-3 / substeps_for(stiff, 1e-3) <= 0.2 / 1e5
    assert substeps_for(Axis("a", 1000.0, LUGRE), 1e-5) == 1
