"""The sentence: a few effects with their numbers, no name twice, what can be cancelled."""

from __future__ import annotations

from tcs_friction.diagnose.outcome.agreement import Agreement
from tcs_friction.diagnose.outcome.result import Errors, Found, Unexplained
from tcs_friction.diagnose.outcome.statement import statement
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance

ERRORS = {name: Errors(x, x) for name, x in (("believed", 3.0), ("retuned", 2.0), ("improved", 0.5))}


def found(name: str, **values: float) -> Found:
    given = {k: {"value": v, "std": 0.1, "unit": effect(name).parameter(k).unit} for k, v in values.items()}
    item = instance(effect(name), values)
    return Found(item, (), 1.0, given, {}, 0.7, 2.0, 0.5, -100.0, Agreement(1.0, 0.01, 12, 1.0, 0.1))


def said(*effects: Found, verdict: str = "missing_physics", mapped: bool = False) -> str:
    where = Unexplained(verdict == "unexplained", 0.4, {"coordinates": ["position", "time"]})
    return statement(verdict, effects, where, ERRORS, 0.45, (), "N m", mapped)


def test_two_orders_of_one_effect_are_two_effects_and_one_remedy() -> None:
    text = said(*(found("cogging", order=order, amplitude=1.0) for order in (7.0, 28.0)))
    assert "cogging (order 7 1/turn, amplitude 1 N m; 0.7 N m rms) and cogging (order 28 1/turn" in text
    assert text.endswith("Compensation can cancel cogging.")


def test_what_no_compensator_can_cancel_is_not_said_to_be_cancelled() -> None:
    assert said(found("encoder_periodic_error", order=5.0, amplitude=1e-5)).endswith("cancel encoder periodic error.")
    assert "cancel" not in said(found("load_step", step=3.0, time=10.0), found("load_step", step=-1.0, time=50.0))


def test_more_than_three_effects_are_not_all_spelled_out() -> None:
    ripple = found("torque_ripple", order=18.0, amplitude=0.1)
    large = [found("cogging", order=order, amplitude=1.0) for order in (7.0, 12.0, 28.0)]
    text = said(*large, ripple, ripple)
    assert text.count("(order") == 3
    assert ", and smaller torque ripple: with them the held-out residual falls from 2 (retuned) to 0.5 N m" in text


def test_another_law_is_said_to_do_better_only_where_it_does() -> None:
    nothing = Unexplained(False, 0.0, None)
    better = statement("parameters", (), nothing, ERRORS, 0.45, (), "N m", False, law="stribeck static")
    assert "another friction law, stribeck static, takes the held-out residual from 2 (retuned) to 0.5 N m" in better
    same = {**ERRORS, "improved": ERRORS["retuned"]}
    equal = statement("parameters", (), nothing, same, 0.45, (), "N m", False, law="stribeck static")
    assert "stribeck static, does as well as the retuned one, with 2 N m left of held-out data" in equal


def test_without_a_name_it_says_where_to_look() -> None:
    text = said(verdict="unexplained", mapped=True)
    assert "remains, 0.4 N m rms over position and time; with a learned map the held-out residual falls" in text
    assert text.endswith("look at what changes with position and time.")
    assert "compensator" not in text


def test_without_a_map_it_claims_none() -> None:
    text = said(verdict="unexplained")
    assert "over position and time, which no map predicts; with what is described the held-out residual falls from 2 " in text
    where = Unexplained(True, 0.4, {"coordinates": ["time"]})
    text = statement("unexplained", (), where, {**ERRORS, "improved": ERRORS["retuned"]}, 0.45, (), "N m")
    assert "over time, which no map predicts; the held-out residual stays at 2 N m" in text
    named = said(found("torque_bias", bias=3.0), verdict="unexplained")
    assert "beside torque bias (bias 3 N m; 0.7 N m rms); with what is named the held-out residual falls" in named
