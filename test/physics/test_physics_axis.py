"""The axis as data: what it accepts, the order of its terms, the step it asks for."""

from __future__ import annotations

import math
from typing import Any

import pytest
from physics_cases import COULOMB, LUGRE, plain

from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law, laws
from tcs_friction.physics.simulate import LONGEST_STEP, substeps_for
from tcs_friction.physics.terms import Feature, Place, instance


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


def test_only_what_is_fast_asks_for_short_steps() -> None:
    """A damping ratio and a relative change of viscous friction are no rates, however light the axis."""
    plainly = Axis("a", 1e-4, COULOMB.replace(viscous=0.0))
    mode = plain("flexible_mode").replace(damping=0.9)
    assert plainly.with_effect(mode).fastest_rate() == pytest.approx(2.0 * math.pi * 20.0)
    assert plainly.with_effect(plain("warmup_drift")).fastest_rate() == plainly.fastest_rate()


@pytest.mark.parametrize("name", sorted(laws()))
def test_a_law_with_bristles_asks_for_steps_that_resolve_them(name: str) -> None:
    """As stiff as its level over the travel in which it builds up."""
    values = {"coulomb": 78.0, "static": 110.0, "stribeck_velocity": 6e-4, "stiffness": 3e9, "damping": 0.0, "viscous": 5.0}
    values |= {"transient": 30.0, "presliding_distance": 1e-7}
    known = {p.name for p in law(name).parameters}
    axis = Axis("a", 10.0, instance(law(name), {key: value for key, value in values.items() if key in known}))
    assert axis.dry_level == 78.0
    assert (axis.bristle > 0.0) == (Feature.PRESLIDING in law(name).features)
    if axis.bristle > 0.0:
        assert axis.fastest_rate() >= math.sqrt(axis.dry_level / axis.bristle / axis.inertia)
