"""The headline: one sentence of at most twenty words, whatever was found; and the table of parameters beside it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled

from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.headline import headline
from tcs_friction.diagnose.outcome.parameter_table import parameter_table
from tcs_friction.diagnose.outcome.result import Found, Unexplained
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import instance


def found(name: str) -> Found:
    signal = "wind" if effect(name).signals else None
    values = {p.name: min(1.0, 0.9 * p.upper) for p in effect(name).parameters if p.default is None}
    item = instance(effect(name), values, signal=signal)
    return Found(item, (), 1.0, {}, {}, 1.0, 2.0, 1.0, -10.0, Agreement(1.0, 0.01, 12, 1.0, 0.1))


def test_no_headline_is_longer_than_twenty_words() -> None:
    longest = sorted((t.id for t in effects().values() if not t.tabulated), key=lambda name: -len(effect(name).words.split()))
    left = Unexplained(True, 1.0, {"coordinates": ["time_since_reversal", "position"]})
    for count, verdict, rest in itertools.product(range(7), ("missing_physics", "unexplained"), (left, Unexplained())):
        said = headline(verdict, [found(name) for name in longest[:count]], rest)
        assert len(said.split()) <= 20, said
        assert said.count(".") == 1
        assert said.endswith(".")


@pytest.mark.parametrize(
    ("verdict", "names", "law", "said"),
    [
        ("match", [], "", "The model matches the recording: what it leaves is noise."),
        ("parameters", [], "", "No named physics is missing, but parameters are off."),
        ("missing_physics", ["cogging"], "", "The model lacks cogging."),
        ("unexplained", ["cogging"], "", "A simulation with cogging moves no better."),
    ],
)
def test_a_headline_says_the_verdict(verdict: str, names: list[str], law: str, said: str) -> None:
    assert headline(verdict, [found(name) for name in names], Unexplained(), law) == said


def test_parameters_are_told_believed_retuned_and_improved() -> None:
    _, fit = settled(conditioned(np.random.default_rng(3), seconds=80.0))
    told = {one.name: one for one in parameter_table(axis(), fit, fit)}
    assert list(told) == ["inertia", "coulomb", "viscous"]
    inertia = told["inertia"]
    assert inertia.unit == "kg m^2"
    assert inertia.believed == 900.0
    assert inertia.retuned is not None
    value, std = inertia.retuned
    assert std is not None
    assert abs(value - 900.0) < 5.0 * std
    improved = told["coulomb"].to_mapping()["improved"]
    assert improved["value"] == fit.axis.friction.values["coulomb"]
    assert improved["std"] > 0.0
