"""The one sentence a control engineer would say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tcs_friction.diagnose.outcome.result import Errors, Found, Unexplained
from tcs_friction.physics.terms import Role

SPOKEN = 3  # effects with their numbers in the sentence; the table has them all


def statement(
    verdict: str,
    effects: Sequence[Found],
    unexplained: Unexplained,
    errors: Mapping[str, Errors],
    noise_floor: float,
    limits: Sequence[str],
    unit: str,
    mapped: bool = False,
    late: float = 0.0,
    law: str = "",
    worse: Sequence[Found] = (),
) -> str:
    """What was found, how much it matters, how well it is proven, what the data cannot say.

    unit: of torque. `mapped`: with a learned map. `late`: s by which the logged torque acts later than stated, if that matters.
    `law`: the friction law of the improved axis, where it is another than believed. `worse`: effects with which a simulation
    moves worse, so that they are not named.
    """
    held = {name: f"{value.stated:.3g}" for name, value in errors.items()}
    data = "held-out" if errors["improved"].untouched is None else "untouched"
    floor = f"noise floor {noise_floor:.3g} {unit}"
    if verdict == "match":
        text = f"The model matches the recording: it leaves {held['retuned']} {unit} of {data} data ({floor})."
        if late:
            when = f"{abs(1e3 * late):.2g} ms {'later' if late > 0.0 else 'earlier'} than stated"
            text += f" Its torque acts {when}, within the log's sampling."
    elif verdict == "parameters" and law:
        text = f"No named physics is missing, but another friction law, {law}, "
        if held["retuned"] == held["improved"]:
            text += f"does as well as the retuned one, with {held['improved']} {unit} left of {data} data ({floor})."
        else:
            text += f"takes the {data} residual from {held['retuned']} (retuned) to {held['improved']} {unit} ({floor})."
    elif verdict == "parameters":
        text = (
            f"No physics is missing, but parameters are off: retuning takes the {data} residual from {held['believed']}"
            f" to {held['retuned']} {unit} ({floor})."
        )
    else:
        names = listed([_phrase(found, unit) for found in effects[:SPOKEN]])
        if len(effects) > SPOKEN:
            names += f", and smaller {listed(effect_words(effects[SPOKEN:]))}"
        way = "falls" if errors["improved"].stated < errors["retuned"].stated else "does not fall:"
        gain = f"the {data} residual {way} from {held['retuned']} (retuned) to {held['improved']} {unit} ({floor})"
        over = " and ".join((unexplained.where or {}).get("coordinates", []))
        if verdict == "missing_physics":
            text = f"The model lacks {names}: with {'it' if len(effects) == 1 else 'them'} {gain}."
            if unexplained.present:
                text += f" Something else remains, {unexplained.torque_rms:.3g} {unit} rms over {over}."
        elif not unexplained.present:
            text = f"With {names} {gain}, but a simulation with that moves no better."
        else:
            text = f"Something outside the vocabulary remains, {unexplained.torque_rms:.3g} {unit} rms over {over}"
            text += f", beside {names}" if names else ""
            if mapped or effects:
                text += f"; with {'a learned map' if mapped else 'what is named'} {gain}"
            elif held["retuned"] != held["improved"]:
                text += f", which no map predicts; with what is described {gain}"
            else:
                text += f", which no map predicts; the {data} residual stays at {held['improved']} {unit} ({floor})"
            text += f": look at what changes with {over}."
    if worse:
        text += f" A simulation with {listed(effect_words(worse))} predicts torque better and moves worse: described, not named."
    cancel = effect_words([f for f in effects if not f.instance.obstacle])
    if cancel:
        text += f" Compensation can cancel {listed(cancel)}."
    return text + "".join(f" Not to be judged from this: {line}." for line in limits)


def effect_words(effects: Sequence[Found]) -> list[str]:
    """The effects' names in words, each once."""
    return list(dict.fromkeys(found.instance.term.words for found in effects))


def listed(words: Sequence[str]) -> str:
    """Words as a sentence has them.

    >>> listed(["cogging", "drag", "wind"]), listed(["cogging", "drag"]), listed(["cogging"]), listed([])
    ('cogging, drag and wind', 'cogging and drag', 'cogging', '')
    """
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _phrase(found: Found, unit: str) -> str:
    """An effect with its most telling numbers."""
    parts = []
    for parameter in found.instance.term.parameters:
        entry = found.parameters.get(parameter.name)
        if entry is None or parameter.role is Role.PHASE or not parameter.stated:
            continue
        parts.append(f"{parameter.name} {entry['value']:.4g} {entry['unit']}".rstrip())
    numbers = f" ({', '.join(parts[:3])}; {found.torque_rms:.3g} {unit} rms)"
    others = " or ".join(kind.words for kind in found.equivalent)
    doubt = f", which this data cannot tell from {others}" if others else ""
    signal = f" from {found.instance.signal}" if found.instance.signal else ""
    return found.instance.term.words + signal + numbers + doubt
