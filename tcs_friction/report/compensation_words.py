"""What is said of a predicted compensation: what it gains against none, what effects add to that, what a recording says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tcs_friction.control.shown_controller import Shown
from tcs_friction.control.worth import ALL, LAW, NOTHING, Beside, Interval, Stage, Worth
from tcs_friction.physics.axis import Unit as UnitOf
from tcs_friction.report.error_units import Unit, between, plain

GAINED = 0.9
"""Share of its largest swing to which a body must come down before a shaped reference is advised."""


def sentence(found: Worth, unit: Unit) -> str:
    """What compensating the friction law gains against no compensation, in at most twenty words."""
    nothing, law = found.stage(NOTHING), found.stage(LAW)
    before, after = (plain(stage.rms / unit.size) for stage in (nothing, law))
    how, sure = _compared(law.gain, law.gain_between), _between(law.between, unit)
    if how == 0:
        return f"Compensating the friction law may change nothing: {before} {unit.name} rms without, {after} with it{sure}."
    verb = "cuts" if how < 0 else "raises"
    return f"Compensating the friction law {verb} the tracking error from {before} to {after} {unit.name} rms{sure}."


def effects_sentence(found: Worth, unit: Unit) -> str:
    """What cancelling effects adds to that."""
    if found.beyond is None:
        return "Beside it no effect of the axis file can be cancelled."
    stage, (ratio, interval) = found.stage(ALL), found.beyond
    what = f"{plain(stage.rms / unit.size)} {unit.name} rms remain{_between(stage.between, unit)}"
    how = _compared(ratio, interval)
    if how == 0:
        return f"Cancelling effects too changes nothing that can be told: {what}."
    share = plain(100.0 * abs(1.0 - ratio), 2)
    return f"With effects cancelled too {what}, {share} % {'less' if how < 0 else 'more'} than with the law alone."


def encoder_sentences(found: Worth, unit: Unit) -> list[str]:
    """What the encoder will show of the last stage, where that is another error than the true one."""
    nothing, last = found.stages[0], found.stages[-1]
    if last.between is None or last.between[0] <= last.measured <= last.between[1]:
        return []
    before, after = (plain(stage.measured / unit.size) for stage in (nothing, last))
    sure = _between(last.measured_between, unit)
    return [f"By the encoder, whose own errors are in it, {before} becomes {after} {unit.name} rms{sure}."]


def doubt(beside: Beside, unit: Unit) -> str:
    """What the recording's own tracking error says of the prediction."""
    recorded, simulated = (plain(value / unit.size) for value in (beside.recorded, beside.simulated))
    off = f"{plain(100.0 * abs(beside.recorded / beside.simulated - 1.0), 2)} %"
    told = f"{recorded} {unit.name} rms recorded, {simulated} simulated with {_of(beside.stage)}{_between(beside.between, unit)}"
    if beside.agrees is None:
        return f"{told}: how far that may differ is not known."
    if beside.agrees:
        return f"The recording agrees: {told}."
    return f"{told}, {off} off: the axis file's controller or model is not the one that recorded it."


def gains_words(shown: Shown, unit_of: UnitOf) -> str:
    """Which controller the prediction is made with, and why. unit_of: `Axis.unit` of the axis."""
    if not shown.estimated:
        fitted = f"gains fitted to it {_percent(shown.explained)}" if shown.explained > 0.0 else "no double-loop PID fits it"
        if shown.by_file > 0.0:
            return f"Controller: the axis file's, which explains {_percent(shown.by_file)} of the recorded torque; {fitted}."
        return f"Controller: the axis file's, though it does not explain the recorded torque; {fitted}."
    units = [unit_of(unit) for unit in ("N m s/rad", "N m/rad", "N m/(rad s)")]
    stated = ", ".join(_gain(gain, unit) for gain, unit in zip(shown.gains.tolist(), units, strict=False) if gain[0])
    shares = f"it explains {_percent(shown.explained)} of the torque, the file's {_percent(max(shown.by_file, 0.0))}"
    return f"Controller: as the recording shows it, {stated}; {shares}."


def stage_words(stage: Stage) -> str:
    """What is cancelled in a stage, for tables and pictures."""
    names = {NOTHING: "no compensation", LAW: "friction law", ALL: "law and all effects"}
    return names.get(stage.name, f"law and {stage.name.replace('_', ' ')}")


def shaping(found: Worth, unit: Unit) -> list[str]:
    """What a shaped reference is worth, a line for each body behind a spring; the encoder does not see how that swings."""
    lines = []
    for one in found.shaping:
        (rms, peak), (shaped_rms, shaped_peak), shaper = one.swing, one.shaped, one.shaper
        name = one.effect.replace("_", " ")
        words = f"the body behind {name} swings {plain(rms / unit.size)} {unit.name} rms, at most {plain(peak / unit.size)}"
        if shaped_peak > GAINED * peak:
            lines.append(f"{words}; a shaped reference would hardly change that")
            continue
        block = f"shaper: {{kind: {shaper.kind}, frequency: {shaper.frequency:.4g}, damping: {shaper.damping:.3g}}}"
        less = f"{plain(shaped_rms / unit.size)} rms, at most {plain(shaped_peak / unit.size)}"
        lines.append(f"{words}; with `{block}` in the reference file {less}, {1e3 * shaper.delay:.3g} ms later")
    return lines


def _compared(ratio: float, between: Interval | None) -> int:
    """-1 for less, 1 for more, 0 where the 90 % interval has both."""
    low, high = between or (ratio, ratio)
    return -1 if high < 1.0 else int(low > 1.0)


def _between(interval: Interval | None, unit: Unit) -> str:
    if interval is None:
        return ""
    low, high = (bound / unit.size for bound in interval)
    return f" (90 %: {between(low, high)})"


def _of(stage: str) -> str:
    return {NOTHING: "no compensation", LAW: "the law compensated"}.get(stage, "all compensated")


def _gain(gain: Sequence[float], unit: str) -> str:
    """A gain and its standard error, with the relative error to 0.01 %."""
    value, std = gain
    return f"{plain(value, 4)} {unit} ± {plain(max(100.0 * std / value, 0.01), 2)} %"


def _percent(share: float) -> str:
    """A share, to as many digits as tell it from 1.

    >>> _percent(0.9), _percent(0.99987), _percent(1.0)
    ('90 %', '99.987 %', 'over 99.999 %')
    """
    missing = 100.0 * (1.0 - share)
    if missing < 1e-3:
        return "over 99.999 %"
    places = max(1 - math.floor(math.log10(missing)), 0) if missing < 1.0 else 0
    return f"{100.0 * share:.{places}f} %"
