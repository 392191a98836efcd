"""The table rules x worlds of an ablation, as numbers and as Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.concealed_score import Judged
from tcs_friction.diagnose.rules import RULES, Rule
from tcs_friction.errors import InputError

BEGIN, END = "<!-- rules by worlds: ./tcs bench ablation --table -->", "<!-- end of the table -->"
DECIDED, FALSE, TRUE, VERDICT, LOST = "decided in", "false names without it", "true names without it", "verdicts worse", "better"
SHOWN = 3  # worlds named in a row


@dataclass(frozen=True)
class Effect:
    """What the absence of a rule does to a world: names more and less, false and true.

    right: whether the diagnosis is, with the rule and without it. changed: whether verdict or names are other ones at all.
    """

    false_more: int
    false_less: int
    true_more: int
    true_less: int
    right: tuple[bool, bool]
    changed: bool

    @classmethod
    def between(cls, having: Judged, without: Judged) -> Effect:
        """From a diagnosis with the rule and one without it."""
        counts = {
            true: [Counter(name.effect for name in one.names if name.true is true) for one in (having, without)]
            for true in (False, True)
        }
        more = {true: (sum((b - a).values()), sum((a - b).values())) for true, (a, b) in counts.items()}
        changed = having.verdict != without.verdict or any(sum(pair) for pair in more.values())
        return cls(*more[False], *more[True], (having.right, without.right), changed)

    def to_mapping(self) -> dict[str, Any]:
        """As a world's result has it."""
        return asdict(self)


Entries = dict[str, list[str]]


def table_rows(results: Sequence[Mapping[str, Any]]) -> Iterator[tuple[Rule, Entries]]:
    """Each rule and the worlds in which it decided, and in which its absence does what."""
    for rule in RULES:
        found: Entries = {what: [] for what in (DECIDED, FALSE, VERDICT, TRUE, LOST)}
        for result in results:
            effect = result["effects"].get(rule.name)
            if effect is None:
                continue
            name = f"{result['kind']} {result['world']}"
            found[DECIDED].append(name)
            if effect["false_more"] > effect["false_less"]:
                found[FALSE].append(name)
            elif effect["true_more"] > effect["true_less"]:
                found[TRUE].append(name)
            elif tuple(effect["right"]) == (True, False):
                found[VERDICT].append(name)
            elif tuple(effect["right"]) == (False, True) or effect["false_less"] > effect["false_more"]:
                found[LOST].append(name)
        yield rule, found


def markdown(results: Sequence[Mapping[str, Any]]) -> str:
    """The table with a line above it that says which worlds it is about."""
    kinds = Counter(result["kind"] for result in results)
    right = sum(bool(result["right"]) for result in results)
    told = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    lines = [
        f"{len(results)} worlds ({told}), {right} diagnosed right. Counted are worlds in which a rule decided, and in which",
        "one without it has a false name more, a wrong verdict instead of a right one, a true name more, or is better otherwise.",
        "",
        "| rule | question | decided | false name | verdict worse | true name | better | for example |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for rule, found in table_rows(results):
        counts = " | ".join(str(len(worlds)) for worlds in found.values())
        shown = ", ".join([*found[FALSE], *found[VERDICT]][:SHOWN])
        lines.append(f"| `{rule.name}` | {rule.question} | {counts} | {shown} |")
    return "\n".join(lines)


def with_table(text: str, results: Sequence[Mapping[str, Any]]) -> str:
    """A text with the table renewed between its marks. InputError where they are missing."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError("--table", "a text without the table's marks", f"lines {BEGIN!r} and {END!r}")
    return f"{before}{BEGIN}\n\n{markdown(results)}\n\n{END}{after}"
