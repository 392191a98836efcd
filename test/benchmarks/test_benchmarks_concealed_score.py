"""Judging a diagnosis: true names, missed effects, the verdict that follows; and how far a probability can be believed."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.concealed_report import (
    reliability_diagram,
    reliability_rows,
    rule_rows,
    summary,
    write_report,
)
from benchmarks.concealed_score import (
    Expected,
    Judged,
    Kept,
    Named,
    failed,
    judge,
    matched,
    reliability,
    wilson,
)
from tcs_friction.errors import InputError


def entry(effect: str, *equivalent: str, probability: float = 0.9) -> dict[str, Any]:
    return {"effect": effect, "equivalent": list(equivalent), "probability": probability}


def diagnosis(*entries: dict[str, Any], verdict: str = "", unexplained: bool = False) -> dict[str, Any]:
    verdict = verdict or ("missing_physics" if entries else "parameters")
    return {
        "verdict": verdict,
        "effects": list(entries),
        "described": [{"effect": "cogging", "refused": [{"rule": "left"}]}],
        "refused": [{"effect": "exogenous from wind", "rule": "too_small"}],
        "unexplained": {"present": unexplained},
        "fit": {"improved": {"held_out": 0.6}, "noise_floor": 0.4},
        "free_run": {"position_rms": {"believed": 3.0, "retuned": 2.0, "improved": 1.0}},
    }


def judged(
    expected: Expected, *entries: dict[str, Any], verdict: str = "", unexplained: bool = False
) -> Judged:
    found = diagnosis(*entries, verdict=verdict, unexplained=unexplained)
    return judge("world-1", "mujoco", expected, found, 2.0)


def wants(*effects: str | tuple[str, ...], **others: Any) -> Expected:
    return Expected(tuple((e,) if isinstance(e, str) else e for e in effects), 0.5, **others)


@pytest.mark.parametrize(
    ("expected", "entries", "right"),
    [
        (wants(), [], True),
        (wants(), [entry("cogging")], False),
        (wants("cogging"), [entry("cogging")], True),
        (wants("cogging"), [], False),
        (wants("cogging"), [entry("torque_ripple", "cogging")], True),
        (wants("cogging"), [entry("torque_ripple")], False),
        (wants("cogging"), [entry("cogging"), entry("imbalance")], False),
        (wants("cogging", "imbalance"), [entry("imbalance"), entry("cogging")], True),
        (wants("cogging"), [entry("cogging"), entry("torque_ripple", "cogging")], False),
        (wants("cogging"), [entry("cogging"), entry("learned_map")], True),
        (wants(("actuator_lag", "transport_delay")), [entry("transport_delay")], True),
        (wants("cogging", tolerated=frozenset({"imbalance"})), [entry("cogging"), entry("imbalance")], True),
        (wants(tolerated=frozenset({"imbalance"})), [entry("imbalance")], True),
    ],
)
def test_right_is_all_that_is_missing_and_no_name_too_many(
    expected: Expected, entries: list[dict[str, Any]], right: bool
) -> None:
    assert judged(expected, *entries).right is right


@pytest.mark.parametrize(
    ("expected", "names", "verdict", "unexplained", "right"),
    [
        (wants(), (), "match", False, True),
        (wants(), (), "unexplained", True, False),
        (wants(partial=True), (), "unexplained", True, True),
        (wants("cogging"), ("cogging",), "unexplained", True, False),
        (wants("cogging", partial=True), ("cogging",), "unexplained", True, True),
        (wants(outside=True), (), "unexplained", True, True),
        (wants(outside=True), (), "parameters", False, False),
        (wants(outside=True), ("cogging",), "unexplained", True, False),
        (wants("cogging", outside=True), ("cogging",), "missing_physics", True, True),
        (wants("cogging", outside=True), ("cogging",), "missing_physics", False, False),
    ],
)
def test_the_verdict_has_to_follow(
    expected: Expected, names: tuple[str, ...], verdict: str, unexplained: bool, right: bool
) -> None:
    found = judged(expected, *(entry(name) for name in names), verdict=verdict, unexplained=unexplained)
    assert found.right is right


def test_what_was_missed_and_what_is_false_is_named() -> None:
    found = judged(
        wants("cogging", ("actuator_lag", "transport_delay")),
        entry("cogging"),
        entry("imbalance", probability=0.97),
    )
    assert found.missed == ("actuator_lag/transport_delay",)
    assert found.false_names == ("imbalance",)
    assert found.names[1] == Named("imbalance", 0.97, False)
    assert found.held_out == pytest.approx(1.2)
    assert found.free_run == pytest.approx(0.5)


def test_the_floor_is_what_the_true_model_leaves_or_else_the_larger_noise() -> None:
    """Held-out 0.6 N m: beside a given floor, the torque noise (0.5), the reported noise (0.4) if that is larger."""
    assert judge("world-1", "laws", wants(), diagnosis(), 2.0, floor=0.3).held_out == pytest.approx(2.0)
    assert judge("world-1", "laws", wants(), diagnosis(), 2.0).held_out == pytest.approx(1.2)
    quiet = Expected((), 0.1)
    assert judge("world-1", "mujoco", quiet, diagnosis(), 2.0).held_out == pytest.approx(1.5)


def test_as_many_names_as_possible_find_their_effect() -> None:
    """The first claim could take what the second one needs; it takes the other."""
    assert matched([{"a", "b"}, {"a"}], [("a",), ("b",)]) == [1, 0]
    assert matched([{"a"}, {"a"}], [("a",)]) == [0, None]
    assert matched([{"a"}], []) == [None]


def test_an_expected_name_has_to_be_in_the_vocabulary() -> None:
    for expected in ((("coging",),), (("learned_map",),)):
        with pytest.raises(InputError, match="unknown name"):
            Expected(expected, 1.0)
    with pytest.raises(InputError, match="unknown name"):
        Expected((), 1.0, tolerated=frozenset({"rust"}))


def test_wilsons_interval() -> None:
    """8 of 10 by the formula of Wilson (1927); of nothing, nothing is known."""
    low, high = wilson(8, 10)
    assert low == pytest.approx(0.4902, abs=1e-3)
    assert high == pytest.approx(0.9433, abs=1e-3)
    assert wilson(10, 10)[1] == pytest.approx(1.0)
    assert wilson(0, 0) == (0.0, 1.0)


def test_reliability_counts_what_is_stated_beside_what_is_true() -> None:
    names = [Named("cogging", 0.96, True)] * 3 + [
        Named("imbalance", 0.98, False),
        Named("cogging", 1.0, True),
    ]
    names.append(Named("torque_bias", 0.4, False))
    low, sure, surest = reliability(names)
    assert (low.count, low.share, low.stated) == (1, 0.0, pytest.approx(0.4))
    assert (sure.low, sure.high, sure.count) == (0.95, 0.99, 4)
    assert sure.share == pytest.approx(0.75)
    assert sure.stated == pytest.approx(0.965)
    assert surest.count == 1
    assert sure.interval[0] < sure.share < sure.interval[1]
    assert reliability([]) == []


def test_the_summary_counts_every_bar() -> None:
    found = [
        judged(wants("cogging"), entry("cogging", probability=0.97)),
        judged(wants(), entry("imbalance", probability=0.99)),
        judged(wants(outside=True), verdict="unexplained", unexplained=True),
        judged(wants(outside=True), entry("cogging"), verdict="unexplained", unexplained=True),
    ]
    values = {row["name"]: row["value"] for row in summary("mujoco", found) + reliability_rows(found)}
    assert values["mujoco: right and no name too many"] == 50.0
    assert values["mujoco: recordings with a false name"] == 50.0
    assert values["mujoco: outside the vocabulary, said so"] == 100.0
    assert values["mujoco: outside, a false name beside it"] == 50.0
    assert values["mujoco: free run better than retuned"] == 100.0
    assert values["mujoco: nothing missing, said so"] == 0.0
    assert values["names stated with at least 0.95, true"] == 50.0
    assert any("imbalance (false)" in name for name in values)


def test_a_diagnosis_that_fails_is_wrong() -> None:
    found = failed("world-1", "laws", wants("cogging"), "no reversal", 1.0)
    assert not found.right
    assert found.missed == ("cogging",)
    assert "error: no reversal" in " ".join(row["name"] for row in summary("laws", [found]))


def test_the_report_has_the_diagram(tmp_path: Any) -> None:
    found = [judged(wants(), entry("imbalance", probability=0.99))]
    page = write_report(tmp_path, found, summary("mujoco", found))
    assert "0 of 1 worlds" in page.read_text()
    assert (tmp_path / "reliability.png").read_bytes()[1:4] == b"PNG"
    assert (tmp_path / "judged.json").is_file()
    assert reliability_diagram([]).png


def test_names_that_rules_refused_are_told_from_true_ones() -> None:
    assert judged(wants("cogging")).refused == (Kept("left", "cogging", True), Kept("too_small", "exogenous", False))
    rows = {entry[0]: entry[2:4] for entry in rule_rows([judged(wants("cogging")), judged(wants())])}
    assert rows == {"left": ["1", "1"], "too_small": ["2", "0"]}
