"""The JSON form of an effect that was found: equivalents by their ids, and the signals that they act through."""

from __future__ import annotations

import json

from tcs_friction.config import AxisFile
from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.rules import LEFT, MOVES, RULES, Refusal, without
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.terms import Instance, instance

FILE = AxisFile(Axis("axis", 1.0, instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.1})))


def found(item: Instance, *equivalent: Kind) -> Found:
    agreement = Agreement(1.0, 0.01, 12, 1.0, 0.1)
    return Found(item, equivalent, 0.5, {}, {"coordinate": "position"}, 1.0, 2.0, 1.0, -10.0, agreement)


def through(signal: str) -> Instance:
    return instance(effect("exogenous"), {"linear": 1.0}, signal=signal)


def test_what_is_not_named_says_which_rule_refused_it() -> None:
    one = found(instance(effect("torque_bias"), {"bias": 1.0}))
    assert one.established
    assert "refused" not in one.to_mapping(FILE)
    refused = one.unless(None).unless(Refusal(LEFT, "what is left could be it: 0.2 N m against 0.04", {"left": 0.2, "own": 0.04}))
    assert not refused.established
    (why,) = refused.to_mapping(FILE)["refused"]
    assert (why["rule"], why["family"]) == ("left", "what is left could be it")
    assert why["question"].endswith("?")
    assert why["numbers"] == {"left": 0.2, "own": 0.04}


def test_each_rule_has_a_name_of_its_own_and_can_be_left_out() -> None:
    names = [rule.name for rule in RULES]
    assert len(set(names)) == len(names)
    with without(["left"]):
        assert not LEFT.asked
        with without(["left", "moves"]):
            assert not MOVES.asked
        assert not LEFT.asked
    assert all(rule.asked for rule in RULES)


def test_an_equivalent_through_another_signal_says_through_which() -> None:
    content = found(through("flow"), Kind("exogenous", "pressure"), Kind("torque_bias")).to_mapping(FILE)
    assert content["effect"] == "exogenous"
    assert content["signal"] == "flow"
    assert content["equivalent"] == ["exogenous", "torque_bias"]
    assert content["equivalent_signals"] == {"exogenous": "pressure"}
    assert json.loads(json.dumps(content)) == content


def test_an_id_is_said_once_with_the_signal_of_the_best() -> None:
    content = found(through("flow"), Kind("exogenous", "pressure"), Kind("exogenous", "heat")).to_mapping(FILE)
    assert content["equivalent"] == ["exogenous"]
    assert content["equivalent_signals"] == {"exogenous": "pressure"}


def test_without_signals_there_are_none() -> None:
    content = found(instance(effect("torque_bias"), {"bias": 1.0}), Kind("imbalance")).to_mapping(FILE)
    assert content["equivalent"] == ["imbalance"]
    assert not {"signal", "equivalent_signals"} & set(content)
