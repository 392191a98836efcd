"""The headline of a diagnosis: one sentence of at most twenty words; the statement has the details."""

from __future__ import annotations

from collections.abc import Sequence

from tcs_friction.diagnose.outcome.result import Found, Unexplained
from tcs_friction.diagnose.outcome.statement import effect_words, listed

NAMED_FIRST = 3  # effects by their names, of three words at most: a fourth would make more than twenty words


def headline(verdict: str, effects: Sequence[Found], unexplained: Unexplained, law: str = "") -> str:
    """One sentence for a verdict. law: the friction law that serves better than the believed one, in words."""
    names = effect_words(effects)
    named = _first(names, NAMED_FIRST)
    if verdict == "match":
        return "The model matches the recording: what it leaves is noise."
    if verdict == "parameters":
        return f"No named physics is missing, but {f'{law} serves better' if law else 'parameters are off'}."
    if verdict == "missing_physics":
        return f"The model lacks {named}."
    if names and not unexplained.present:
        return f"A simulation with {named} moves no better."
    over = " and ".join((unexplained.where or {}).get("coordinates", [])) or "time"
    return f"Something outside the vocabulary remains over {over}{f', beside {_first(names, 1)}' if names else ''}."


def _first(names: Sequence[str], count: int) -> str:
    """The first names, and how many more there are."""
    return listed(names) if len(names) <= count else listed([*names[:count], f"{len(names) - count} more"])
