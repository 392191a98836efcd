"""The JSON form of an effect that was found: equivalents by their ids, and the signals that they act through."""

from __future__ import annotations

import json

from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.result import Found
from tcs_friction.diagnose.search.start import Kind
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance


def found(item: Instance, *equivalent: Kind) -> Found:
    agreement = Agreement(1.0, 0.01, 12, 0.99)
    return Found(item, equivalent, 0.5, {}, {"coordinate": "position"}, 1.0, 2.0, 1.0, -10.0, agreement, True)


def through(signal: str) -> Instance:
    return instance(effect("exogenous"), {"linear": 1.0}, signal=signal)


def test_an_equivalent_through_another_signal_says_through_which() -> None:
    content = found(through("flow"), Kind("exogenous", "pressure"), Kind("torque_bias")).to_mapping()
    assert content["effect"] == "exogenous"
    assert content["signal"] == "flow"
    assert content["equivalent"] == ["exogenous", "torque_bias"]
    assert content["equivalent_signals"] == {"exogenous": "pressure"}
    assert json.loads(json.dumps(content)) == content


def test_an_id_is_said_once_with_the_signal_of_the_best() -> None:
    content = found(through("flow"), Kind("exogenous", "pressure"), Kind("exogenous", "heat")).to_mapping()
    assert content["equivalent"] == ["exogenous"]
    assert content["equivalent_signals"] == {"exogenous": "pressure"}


def test_without_signals_there_are_none() -> None:
    content = found(instance(effect("torque_bias"), {"bias": 1.0}), Kind("imbalance")).to_mapping()
    assert content["equivalent"] == ["imbalance"]
    assert not {"signal", "equivalent_signals"} & set(content)
