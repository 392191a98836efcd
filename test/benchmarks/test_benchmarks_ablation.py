"""The ablation of rules: what their absence does is counted, a table renewed, and a run goes on where it was ended."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import ablation
from benchmarks.ablation_table import (
    BEGIN,
    END,
    FALSE,
    TRUE,
    VERDICT,
    Effect,
    markdown,
    table_rows,
    with_table,
)
from benchmarks.concealed_score import Expected, Judged, Named
from tcs_friction.diagnose.rules import LEFT, MOVES, OF_SEARCH, RULES, SAMPLING, ledger
from tcs_friction.errors import InputError


def judged(verdict: str, right: bool, **names: bool) -> Judged:
    named = tuple(Named(name, 0.99, true) for name, true in names.items())
    return Judged("w", "own", Expected((), 0.1), verdict, named, (), False, right, 1.0, None, 1.0)


def result(world: str, right: bool = True, **effects: Effect) -> dict[str, Any]:
    told = {name: effect.to_mapping() for name, effect in effects.items()}
    return {"world": world, "kind": "own", "effects": told, "said": "match", "right": right}


MATCH = judged("match", True)
FALSE_NAME = Effect.between(MATCH, judged("missing_physics", False, backlash=False))
SAME = Effect.between(MATCH, MATCH)
TRUE_NAME = Effect.between(judged("unexplained", False), judged("missing_physics", True, cogging=True))
WORSE = Effect.between(MATCH, judged("unexplained", False))


def test_what_the_absence_of_a_rule_does_is_a_name_more_or_another_verdict() -> None:
    assert (FALSE_NAME.false_more, FALSE_NAME.true_more, FALSE_NAME.changed) == (1, 0, True)
    assert (TRUE_NAME.false_more, TRUE_NAME.true_more) == (0, 1)
    assert not SAME.changed
    assert WORSE.right == (True, False)


def test_each_rule_is_told_the_worlds_that_need_it() -> None:
    found = dict(table_rows([result("a", left=FALSE_NAME, moves=SAME), result("b", left=TRUE_NAME), result("c", left=WORSE)]))
    assert list(found) == list(RULES)
    assert (found[LEFT][FALSE], found[LEFT][TRUE], found[LEFT][VERDICT]) == (["own a"], ["own b"], ["own c"])
    assert [len(worlds) for worlds in found[MOVES].values()] == [1, 0, 0, 0, 0]


def test_the_table_is_renewed_between_its_marks_and_nothing_else_is() -> None:
    once = with_table(f"before\n{BEGIN}\nstale row\n{END}\nafter\n", [result("a", left=FALSE_NAME)])
    assert once.startswith("before\n")
    assert once.endswith("after\n")
    assert "stale row" not in once
    assert with_table(once, [result("a", left=FALSE_NAME)]) == once
    assert "| `left` |" in markdown([result("a")])
    with pytest.raises(InputError, match="without the table's marks"):
        with_table("nothing", [])


def test_a_run_goes_on_where_it_was_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def ablated(work: Any, kind: str) -> dict[str, Any]:
        made.append(f"{kind} {work.name}")
        return result(work.name)

    monkeypatch.setattr(ablation, "ablated", ablated)
    parser = argparse.ArgumentParser()
    ablation.add_arguments(parser)
    words = ["-o", str(tmp_path), "--kinds", "own", "laws", "--seed", "3", "--count"]
    ablation.run(parser.parse_args([*words, "3"]))
    found = ablation.run(parser.parse_args([*words, "5"]))
    assert len(made) == len(set(made)) == 5
    assert [one.split()[0] for one in made] == ["own", "laws", "own", "laws", "own"]
    assert found[0]["value"] == 5.0
    assert ablation.run(parser.parse_args([*words, "9", "--minutes", "0"]))[0]["value"] == 5.0
    assert all(json.loads(path.read_text())["right"] for path in tmp_path.glob("*/*.json"))


def test_rules_that_decide_are_noted_while_a_ledger_is_open() -> None:
    SAMPLING.decides()
    with ledger() as outer:
        SAMPLING.decides()
        with ledger() as inner:
            LEFT.decides()
        MOVES.decides()
    SAMPLING.decides()
    assert outer == {"sampling", "left", "moves"}
    assert inner == {"left"}
    assert SAMPLING in OF_SEARCH
    assert LEFT not in OF_SEARCH
