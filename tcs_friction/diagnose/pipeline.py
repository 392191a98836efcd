"""A diagnosis from recordings to verdict: the stages in the order in which a recording goes through them.

    recordings ─▶ dataset ─▶ fit ─▶ search ─▶ remainder ─▶ outcome ─▶ Diagnosis

    dataset    filters motion and torque, sets held-out data aside
    fit        retunes what the model has, estimates the noise
    search     adds effects that earn their place
    remainder  finds structure that they leave
    outcome    judges on held-out data, draws conclusions

Each stage takes and returns frozen records and knows nothing of the later ones. The search asks the remainder once an effect
or two are found whether to go on makes sense; held-out data are first looked at in the outcome, and untouched ones when that has
decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from tcs_friction.conditioning.checks import check_units
from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.conditioning.timing import LogTiming
from tcs_friction.config import AxisFile
from tcs_friction.diagnose import rules
from tcs_friction.diagnose.dataset.excitation import barred, lacking
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.fit.noise_estimate import surprise
from tcs_friction.diagnose.fit.parameters import INERTIA
from tcs_friction.diagnose.outcome.conclusion import TOLERANCE, conclude
from tcs_friction.diagnose.outcome.explanation import Explanation
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.remainder.maps import remaining_structure
from tcs_friction.diagnose.remainder.remainder import Remainder, remainder_of, with_map
from tcs_friction.diagnose.rules import Refusal, Refused, Rule
from tcs_friction.diagnose.search.late_log import as_timed, out_of_step
from tcs_friction.diagnose.search.laws import contradicted_at_rest, lacks, law_without_memory, shows_bristles
from tcs_friction.diagnose.search.rivals import contested
from tcs_friction.diagnose.search.significance import DISTINGUISHABLE
from tcs_friction.diagnose.search.start import kind_of
from tcs_friction.diagnose.search.stepwise import (
    Progress,
    Selection,
    beyond_remaining_spectrum,
    select_effects,
)
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Need
from tcs_friction.recording.recording import Recording

WRONG_INERTIA = 0.4  # of its logarithm, by which the believed inertia is not expected to be wrong: a spring feigns another
STAYS = 3.0  # standard deviations within which an inertia did not change
Explained = tuple[TorqueBalance, Explanation]

FORGOTTEN = 10.0  # bristle deflections, after which exp(-10) is left of how friction was bent before the recording


def diagnose(
    recordings: Sequence[Recording],
    file: AxisFile,
    progress: Progress = lambda share, stage: None,  # noqa: ARG005 names are the interface
    tolerance: float = TOLERANCE,
) -> Diagnosis:
    """Find what the axis file lacks against recordings of the real axis.

    Held-out data are cut off before anything is fitted or chosen. `progress(share, stage)` may raise to cancel. tolerance: share
    of the friction below which what remains is no verdict.

    Raises InputError when the recordings cannot carry a torque balance.
    """
    progress = _never_back(progress)
    balance, explanation = explain(recordings, file, progress)
    progress(0.92, "proving on held-out data")
    return conclude(balance, file, explanation, tolerance)


def explain(
    recordings: Sequence[Recording],
    file: AxisFile,
    progress: Progress = lambda share, stage: None,  # noqa: ARG005 names are the interface
) -> Explained:
    """All of a diagnosis before held-out data are looked at: what explains the recordings, and the balance that says so.

    Raises InputError when the recordings cannot carry a torque balance.
    """
    progress(0.02, "conditioning the recording")
    data = _prepared(recordings, file.axis, None)
    check_units(data, file.axis)
    balance = TorqueBalance(data)

    progress(0.1, "retuning what the model has")
    retuned = settle(balance, file.axis, white_noise(balance.samples))
    prepared = partial(_prepared, recordings, file.axis)
    balance, retuned = as_timed(balance, retuned, prepared)
    late = out_of_step(balance, retuned, prepared)
    explained = _explained(recordings, file.axis, balance, retuned, progress)
    return explained if late is None else _likelier(explained, _explained(recordings, file.axis, *late, progress))


def _prepared(recordings: Sequence[Recording], believed: Axis, timings: Sequence[LogTiming] | None) -> DataSet:
    """The data set of a believed axis, with timings of the torque; None: as the recordings have it."""
    memory, at_rest = FORGOTTEN * believed.bristle, not believed.friction.term.without_memory
    return prepare(recordings, memory=memory, at_rest=at_rest, timings=timings, untouched=True)


def _explained(
    recordings: Sequence[Recording], believed: Axis, balance: TorqueBalance, retuned: Fit, progress: Progress
) -> Explained:
    """What explains the recordings with one timing of the torque, from the retuned fit on, and the balance that says so."""
    balance, retuned, base = _unless_contradicted_at_rest(recordings, believed, balance, retuned)
    lacks = lacking(balance.data, believed)
    if Need.FREE_ACCELERATION in lacks:
        instead = _instead_of_wrong_inertia(retuned.axis, believed)
        balance, retuned, base = _with_known_inertia(balance, retuned, base, instead)
        lacks = lacks if instead is None else lacks - {Need.FREE_ACCELERATION}

    remainder, selection = _searched(balance, retuned, base, believed, lacks, progress)
    if balance.inertia_known and selection.found:
        inertia = _inertia_beside(balance, selection, believed)
        if inertia is not None:
            balance, retuned, base = _with_known_inertia(balance, retuned, base, inertia)
            lacks = lacks | {Need.FREE_ACCELERATION}
            remainder, selection = _searched(balance, retuned, base, believed, lacks, progress)
    elif _inertia_lost(balance, selection, believed):
        instead = _instead_of_wrong_inertia(retuned.axis, believed)
        balance, retuned, base = _with_known_inertia(balance, retuned, base, instead)
        remainder, selection = _searched(balance, retuned, base, believed, lacks, progress)

    progress(0.75, "looking for structure that remains")
    left = remainder(selection.base, selection.chosen)
    if left.instead is None and rules.SPECTRUM.asked:
        left = remainder(selection.base, beyond_remaining_spectrum(balance, selection.chosen, retuned))
    return balance, _explanation(balance, believed, selection, left, progress)


def _likelier(in_step: Explained, out_of_step: Explained) -> Explained:
    """What explains the recordings with the log in step or, where that is likelier by more than chance, out of it.

    A delay or a lag beside a log that is out of step would undo it: that log is in step.
    """
    if any(item.term.filters for item in out_of_step[1].unmapped.axis.effects):
        return in_step

    def surprised(one: Explained) -> float:
        balance, fit = one[0], one[1].unmapped
        left = surprise(balance, balance.residual(fit.axis, fit.noise))
        return left + len(fit.free) * math.log(balance.samples.effective_count)

    return out_of_step if surprised(out_of_step) + DISTINGUISHABLE < surprised(in_step) else in_step


def _never_back(progress: Progress) -> Progress:
    """The same, with a share that stays where it is while a search is made again."""
    reached = 0.0

    def forward(share: float, stage: str) -> None:
        nonlocal reached
        reached = max(reached, share)
        progress(reached, stage)

    return forward


def _unless_contradicted_at_rest(
    recordings: Sequence[Recording], believed: Axis, balance: TorqueBalance, retuned: Fit
) -> tuple[TorqueBalance, Fit, Fit]:
    """Balance, retuned fit and the fit to start a search from.

    Where the recording contradicts the law's memory at rest, or retuning leaves bristles too narrow to be seen in it, that has
    a law without memory, and nothing is compared where such friction is unknown.
    """
    if retuned.axis.friction.term.without_memory:
        return balance, retuned, retuned
    try:
        moving = prepare(recordings, at_rest=False, timings=balance.data.timings, untouched=True)
    except InputError:  # the axis hardly moves: too few samples are left to ask
        return balance, retuned, retuned
    other = TorqueBalance(moving)
    again = settle(other, believed, white_noise(other.samples), rounds=1)
    asked = not shows_bristles(balance, retuned.axis) or contradicted_at_rest(other, retuned, again)
    law = law_without_memory(other, again, believed) if asked else None
    if law is None:
        return balance, retuned, retuned
    return other, again, settle(other, law.axis, law.noise, rounds=2)


def _with_known_inertia(
    balance: TorqueBalance, retuned: Fit, base: Fit, inertia: float | None
) -> tuple[TorqueBalance, Fit, Fit]:
    """The same where acceleration follows position, and a spring could stand for any inertia: it stays, or is that given."""
    known = TorqueBalance(balance.data, inertia_known=True)
    fits = []
    for fit in (retuned, base):
        axis = fit.axis if inertia is None else replace(fit.axis, inertia=inertia)
        fits.append(settle(known, axis, white_noise(known.samples)))
    return known, fits[0], fits[0] if base is retuned else fits[1]


def _wrong_inertia(fitted: Axis, believed: Axis) -> bool:
    """Whether a fitted inertia is further from the believed one than that is expected to be wrong."""
    return abs(math.log(fitted.inertia / believed.inertia)) >= WRONG_INERTIA


def _instead_of_wrong_inertia(fitted: Axis, believed: Axis) -> float | None:
    """The believed inertia (kg m^2) where a fitted one is wrong; None where that may stay."""
    return believed.inertia if _wrong_inertia(fitted, believed) else None


def _inertia_beside(balance: TorqueBalance, selection: Selection, believed: Axis) -> float | None:
    """The inertia (kg m^2) beside the effects found, where it was taken as known; None where it stays.

    It was retuned while what the recording shows was not yet found. Springs and gravity that were found with it may only mend it.
    """
    known = selection.chosen.axis
    others = tuple(item for item in known.effects if Need.FREE_ACCELERATION not in item.term.needs)
    free = TorqueBalance(balance.data)
    fit = settle(free, replace(known, effects=others), selection.chosen.noise, rounds=2)
    error = dict(zip(fit.free, np.sqrt(np.diag(fit.covariance)), strict=True))[INERTIA]
    changed = abs(math.log(fit.axis.inertia / known.inertia)) > STAYS * error
    return fit.axis.inertia if changed and not _wrong_inertia(fit.axis, believed) else None


def _inertia_lost(balance: TorqueBalance, selection: Selection, believed: Axis) -> bool:
    """Whether the inertia beside what was found is far from the believed one, and its torque within the residual.

    The recording does not tell the inertia then: noise of the measured acceleration draws it to zero.
    """
    fit = selection.chosen
    torque = fit.axis.inertia * rms(balance.data.joined("acceleration")[balance.train])
    return _wrong_inertia(fit.axis, believed) and torque < rms(balance.residual(fit.axis, fit.noise)[balance.train])


def _searched(
    balance: TorqueBalance, retuned: Fit, base: Fit, believed: Axis, lacks: frozenset[Need], progress: Progress
) -> tuple[Callable[[Fit, Fit], Remainder], Selection]:
    """What a base and a fit leave, as a function that remembers its last answer, and what the search chose by asking it."""
    remainder = lru_cache(maxsize=1)(partial(remainder_of, balance))  # the search and the next stage ask of one fit
    selection = select_effects(
        balance,
        retuned,
        base,
        believed,
        barred(lacks),
        enough=lambda base, fit: remainder(base, fit).further_effects_are_map,
        progress=progress,
    )
    return remainder, selection


def _explanation(
    balance: TorqueBalance, believed: Axis, selection: Selection, left: Remainder, progress: Progress
) -> Explanation:
    """The map that stands for all effects, or the effects after their contests with a map for the rest."""
    if left.instead is not None:
        over = " and ".join(left.instead.structure.coordinates)
        dropped = _dropped(selection, left.instead.fit, rules.MAP_INSTEAD, f"a map over {over} does as well as all of them")
        fits = selection.retuned, selection.retuned, left.instead.fit
        return Explanation(*fits, left.instead.structure, selection.rounds, dropped=dropped)
    chosen, lacking = lacks(balance, left.fit, believed)
    kept = Selection(selection.retuned, selection.base, chosen, selection.rounds)
    fit, contests = contested(balance, kept, progress)
    structure = left.structure if fit is left.fit else remaining_structure(balance, fit, fit.noise)
    improved = fit if structure is None else with_map(balance, fit, structure)
    dropped = _dropped(selection, left.fit, rules.SPECTRUM, "what remains may explain it by chance")
    return Explanation(selection.retuned, fit, improved, structure, selection.rounds, contests, lacking, dropped)


def _dropped(selection: Selection, kept: Fit, rule: Rule, words: str) -> tuple[Refused, ...]:
    """The effects that a search found and that are not in the fit that was kept, refused by a rule."""
    identities = {item.identity for item in kept.axis.effects}
    gone = [kind_of(item).words for item in selection.found if item.identity not in identities]
    return tuple(Refused(name, Refusal(rule, words)) for name in dict.fromkeys(gone))
