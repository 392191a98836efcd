"""Terms are found by name: the package's own and those of other packages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.physics import registry
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.effects import torque_bias
from tcs_friction.physics.registry import (
    alignment,
    compared_laws,
    effect,
    effects,
    law,
    laws,
    tabulated,
    usual_law,
)
from tcs_friction.physics.simulate import simulate_open_loop
from tcs_friction.physics.terms import Feature, Place, instance

FOREIGN = replace(torque_bias.TERM, id="magnet")
NOT_A_TERM = "just text"


class Raising:
    """What stands where a plug-in has its term, and raises when it is looked at."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    @property
    def term(self) -> None:
        raise self.error


RAISES, ENDS = Raising(ZeroDivisionError("two\nlines")), Raising(SystemExit(3))
VOCABULARY = {
    "stribeck",
    "presliding",
    "coulomb_asymmetry",
    "viscous_asymmetry",
    "position_dependent_friction",
    "local_friction_bump",
    "quadratic_drag",
    "temperature_dependent_friction",
    "warmup_drift",
    "load_dependent_friction",
    "cogging",
    "torque_ripple",
    "torque_bias",
    "transport_delay",
    "actuator_lag",
    "backlash",
    "flexible_mode",
    "position_dependent_inertia",
    "imbalance",
    "cable_wrap",
    "cable_hysteresis",
    "encoder_periodic_error",
    "periodic_vibration",
    "load_step",
    "cross_axis_coupling",
    "wind_torque",
    "exogenous",
    "learned_map",
}


@pytest.fixture(autouse=True)
def _fresh() -> Iterator[None]:
    laws.cache_clear()
    effects.cache_clear()
    yield
    laws.cache_clear()
    effects.cache_clear()


def offer(monkeypatch: pytest.MonkeyPatch, group: str, name: str, attribute: str) -> None:
    """As if an installed package declared this entry point."""
    entry = EntryPoint(name, f"{__name__}:{attribute}", group)

    def found(**selection: str) -> EntryPoints:
        return EntryPoints([entry]).select(**selection)

    monkeypatch.setattr(registry, "entry_points", found)


def test_the_whole_vocabulary_is_there() -> None:
    assert set(effects()) == VOCABULARY
    assert {"coulomb_viscous", "stribeck_static", "dahl_viscous", "lugre"} <= set(laws())
    assert all(term.place is Place.LAW for term in laws().values())
    assert set(laws()) - set(compared_laws()) == {"free_curve"}
    assert all(term.place is not Place.LAW for term in effects().values())


def test_effect_of_another_package_works_like_an_own_one(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "tcs_friction.effects", "magnet", "FOREIGN")
    item = instance(effect("magnet"), {"bias": -100.0})
    free = instance(law("coulomb_viscous"), {"coulomb": 1e-9, "viscous": 0.0})
    moved = simulate_open_loop(Axis("a", 10.0, free, (item,)), np.zeros(100), 1e-3)
    assert moved.velocity[-1] == pytest.approx(1.0, rel=1e-3)


def test_law_group_is_separate(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "tcs_friction.effects", "magnet", "FOREIGN")
    assert "magnet" not in laws()


def test_taken_name_is_left_out_and_said(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(f"{__name__}.FOREIGN", torque_bias.TERM)
    offer(monkeypatch, "tcs_friction.effects", "magnet", "FOREIGN")
    assert set(effects()) == VOCABULARY
    (line,) = caplog.messages
    assert line.startswith("tcs-friction: entry point magnet of tcs_friction.effects: the name 'torque_bias' is taken, ")
    assert line.endswith(", left out")


@pytest.mark.parametrize(
    ("attribute", "why"),
    [
        ("NOT_A_TERM", "is a str, expected a Term"),
        ("nowhere", "cannot be loaded (AttributeError: "),
        ("RAISES.term", "cannot be loaded (ZeroDivisionError: two lines)"),
        ("ENDS.term", "cannot be loaded (SystemExit: 3)"),
    ],
)
def test_entry_point_that_is_no_term_ends_only_what_needs_it(
    attribute: str, why: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    offer(monkeypatch, "tcs_friction.laws", "wrong", attribute)
    assert "lugre" in laws()
    (line,) = caplog.messages
    assert line.startswith("tcs-friction: entry point wrong of tcs_friction.laws: ")
    assert line.endswith(", left out")
    assert why in line
    with pytest.raises(InputError, match=r"file: friction law: 'wrong' is left out, expected entry point wrong of"):
        law("wrong", "file")
    assert law("lugre").id == "lugre"


def test_what_a_plug_in_raises_later_is_put_down_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "tcs_friction.effects", "magnet", "FOREIGN")
    with pytest.raises(ZeroDivisionError) as caught:
        RAISES.term  # noqa: B018
    assert registry.raised_by_plug_in(caught.value) == "entry point magnet of tcs_friction.effects"
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([EntryPoint("x", "elsewhere:TERM", "g")]))
    assert registry.raised_by_plug_in(caught.value) is None


def test_what_the_package_asks_for_is_found_by_its_declaration() -> None:
    assert alignment().id == "transport_delay"
    assert tabulated().id == "learned_map"
    assert usual_law(frozenset(Feature)).id == "lugre"
    assert usual_law(frozenset({Feature.DRY, Feature.VISCOUS})).id == "coulomb_viscous"


def test_unknown_names_name_the_nearest() -> None:
    with pytest.raises(InputError, match="friction law: unknown name 'luger', expected lugre"):
        law("luger")
    with pytest.raises(InputError, match="file: effect: unknown name 'coging', expected cogging"):
        effect("coging", "file")
