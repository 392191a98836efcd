"""What a gain is worth: the part of it that chance, noise and the errors of other effects would give.

A gain is the drop of the whitened squares when numbers are added to a model, divided by their dispersion. Where nothing is
missing it is chi-squared with as many degrees of freedom as numbers were added. The test is made for every effect of the
vocabulary and for every alternative (order, place, time) that was searched through, hence Bonferroni's correction for all of
them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy import stats

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.physics.registry import effects
from tcs_friction.physics.terms import Place, Term

FALSE_ALARM = 0.01  # chance that any effect is named in a recording in which nothing is missing
ODDS = 100.0  # to one, by which an effect must beat another one before these data tell them apart
DISTINGUISHABLE = 2.0 * math.log(ODDS)  # difference of gains that has these odds: twice a log-likelihood ratio
NOISE_SHARE = 0.006  # of the noise power, that effects which feed on noise must explain: a filter of the residual's own noise
# explains a share of it however long the recording is, and no test of significance sees that
IMPERFECT = 1e-3  # of the power that effects explain, that their errors may leave to others: they are known to about 3 %
IMPERFECT_AT_MOST = 0.02  # the same at most, of the noise power
FEEDBACK_SHARE = 0.02  # of a gain: what noise in motion and torque does to it through the feedback, whatever its statistics say


def chance(count: int, alternatives: float = 1.0) -> float:
    """Gain that `count` free numbers reach by chance, the best of so many alternatives of every effect."""
    return float(stats.chi2.isf(FALSE_ALARM / (alternatives * len(effects())), max(count, 1)))


def threshold(balance: TorqueBalance, terms: Sequence[Term], count: int, alternatives: float = 1.0) -> float:
    """Gain that chance gives, and noise to effects that feed on it; each further effect at once costs a number more."""
    from_noise = NOISE_SHARE * balance.samples.effective_count if any(map(feeds_on_noise, terms)) else 0.0
    return chance(count, alternatives) + from_noise + (len(terms) - 1) * chance(1)


def feeds_on_noise(term: Term) -> bool:
    """Whether noise of the residual is in what an effect is made from: logged torque, acceleration, or a memory of motion."""
    torque = "torque" in term.reads and not term.periodic
    memory = term.states != 0 and not term.signals
    return torque or memory or term.place is Place.BODY


def imperfection(retuned: Fit, fit: Fit, balance: TorqueBalance) -> float:
    """Gain that the effects of a fit may leave to others because they are not known exactly."""
    explained = balance.squares(retuned.axis, fit.noise) - fit.squares
    share = IMPERFECT * explained / fit.squares.dispersion
    return min(share, IMPERFECT_AT_MOST * balance.samples.effective_count)
