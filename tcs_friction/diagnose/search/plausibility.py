"""Whether a fitted effect can be what it says: its size, its values, and whether the recording resolves it.

In: a fit and one of its effects. Out: the reason why it cannot be, or None.
"""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from tcs_friction.diagnose import rules
from tcs_friction.diagnose.dataset.excitation import FASTER
from tcs_friction.diagnose.fit.balance import TorqueBalance, rms
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.search.matched_filter import FEWEST_PERIODS, ONE_WAVE, same_wave, wave_angle
from tcs_friction.diagnose.search.projection import survey
from tcs_friction.diagnose.search.significance import chance
from tcs_friction.numerics.runs import runs
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.steady_friction import over_speed, steady
from tcs_friction.physics.terms import Instance, Parameter, Place, Role, Survey

LARGEST_TORQUE = 1.2  # of the logged torque's rms: an effect that is larger cancels against another one
LEAST_OWN_GAIN = 0.5  # of the least gain that counts, that an effect's own torque must have: it cannot gain more by itself
HALF_A_STEP = 0.5  # of the encoder: the error of rounding is never larger
RESOLVED_PERIOD = 2.0  # steps of the encoder, or standard deviations of its noise: a shorter wave is not sampled
LINE = 10.0  # times the median power beside a frequency; noise alone reaches it at one frequency in a thousand
LINE_WIDTH, BESIDE = 1.0, np.arange(3, 13)  # in units of 1/duration: of a line, and where it has ended under a Hann window
ANSWERED = 2.0  # times a vibration: torque with which a well damped loop answers it at most (Astrom & Murray 2008, 12.2)
SIDE_PERIODS = 1.5  # over the recording: amplitudes that change once in it put a second line one period away
SIDE_SIZE = 0.5  # of a line: what a change of amplitude puts on either side of it is no larger
CONDITION = 30.0  # index from which columns depend strongly on each other (Belsley, Kuh & Welsch 1980, 3.2)
LEFT_OVER = 2.0 / CONDITION  # of two equal torques with that index, when they cancel each other
AT_BOUND = 1e-3  # relative distance from a declared bound that counts as none
BELOW_SEARCH = 0.125  # of the lowest order that is searched, by which a fit may go below it: half a period of four
NEARLY_WHOLE = 0.02  # of a wave's power, that it may lose if its order is whole: the phase moves by a twelfth of a period
TINY = 1e-300  # s, instead of no lag
SPEEDS = 24  # up to the fastest: between two, a drag c v^2 dips by (1/48)^2 of its largest, half of the 0.1 % that may remain
SEARCH_MARGIN = 3.0  # factor beyond the values searched, within which an effect can be told from others


class Doubt(enum.Enum):
    """Why a fitted effect cannot be what it says: the rule that it does not meet."""

    ALIGNMENT = rules.ALIGNMENT
    BEYOND_SAMPLING = rules.SAMPLING
    TWICE = rules.TWICE
    WARNED = rules.WARNED
    TOO_SMALL = rules.TOO_SMALL
    TOO_LARGE = rules.TOO_LARGE
    QUANTISATION = rules.QUANTISATION
    AT_BOUND = rules.AT_BOUND
    SIDE_LINE = rules.SIDE_LINE
    COLLISIONS = rules.COLLISIONS
    NOT_WHOLE = rules.NOT_WHOLE
    DRIVEN = rules.DRIVEN
    ENERGY = rules.ENERGY
    STEADY = rules.STEADY
    CANCELLED = rules.SUMMED
    IMPLAUSIBLE = rules.IMPLAUSIBLE
    NOT_RESOLVED = rules.NOT_RESOLVED

    @property
    def asked(self) -> bool:
        """Whether its rule is asked at all."""
        return self.value.asked


def doubt(balance: TorqueBalance, fit: Fit, item: Instance, base: Axis, decides: bool = True) -> Doubt | None:
    """Why an effect of a fit cannot be what it says.

    base: the axis that it was searched on. decides: whether the answer may change anything; only then is it in the ledger.
    """
    return _first(_doubts(balance, fit, item, base), decides)


def doubtful_size(balance: TorqueBalance, fit: Fit, item: Instance) -> Doubt | None:
    """Why an effect's size or values cannot be."""
    return _first(_doubts_of_size(balance, fit, item))


def _first(doubts: Iterator[Doubt], decides: bool = True) -> Doubt | None:
    """The first of the doubts whose rule is asked, which is noted if it decides something."""
    found = next((one for one in doubts if one.asked), None)
    if found is not None and decides:
        found.value.decides()
    return found


def _doubts(balance: TorqueBalance, fit: Fit, item: Instance, base: Axis) -> Iterator[Doubt]:
    """All doubts about an effect, cheap ones first."""
    if item.term.alignment and item.values[item.term.alignment] <= balance.data.leeway:
        yield Doubt.ALIGNMENT
    if _beyond_sampling(balance, item):
        yield Doubt.BEYOND_SAMPLING
    others = [other for other in fit.axis.effects if other is not item]
    if any(same_wave(balance, fit.axis, item, other) for other in others):
        yield Doubt.TWICE
    if any(_side_line(balance, fit.axis, item, other) for other in others):
        yield Doubt.SIDE_LINE
    if item.term.transfer is not None and any(other.term.collides for other in others):
        yield Doubt.COLLISIONS
    yield from _doubts_of_size(balance, fit, item)
    yield from _unresolved(balance, fit, item)
    yield from _out_of_range(balance, base, item)
    yield from _unlike_physics(balance, fit, item, base)


def _beyond_sampling(balance: TorqueBalance, item: Instance) -> bool:
    """Whether an effect's frequency, or the corner of its lag, is above half the rate of new samples.

    What such a mode, contact or lag does below it is no more than what hold and stamps of the log may do as well.
    """
    found = [p for p in item.term.parameters if p.role is Role.SHAPE and item.values[p.name] != p.default]
    rates = [item.values[p.name] for p in found if p.unit == "Hz"]
    if item.term.filters and not item.term.alignment:
        rates += [1.0 / (2.0 * math.pi * max(item.values[p.name], TINY)) for p in found if p.unit == "s"]
    return any(rate >= balance.data.nyquist for rate in rates)


def _unlike_physics(balance: TorqueBalance, fit: Fit, item: Instance, base: Axis) -> Iterator[Doubt]:
    """Why no such effect is known, or could be told in this motion."""
    if item.term.implausible(item.values, survey(balance, base)):
        yield Doubt.IMPLAUSIBLE
    if not _whole(balance, fit, item):
        yield Doubt.NOT_WHOLE
    if item.term.periodic == "time" and _driven(balance, fit, item):
        yield Doubt.DRIVEN
    if item.term.periodic == "time" and _steady(balance, fit.axis, item):
        yield Doubt.STEADY
    if item in over_speed(fit.axis) and _feeds_energy(balance, fit.axis):
        yield Doubt.ENERGY
    if _cancelled(balance, fit, item):
        yield Doubt.CANCELLED


def _feeds_energy(balance: TorqueBalance, axis: Axis) -> bool:
    """Whether friction over the speed feeds energy into the axis at some speed that a motion may have, which no friction does.

    A drag of negative sign may bend a law's friction down, as far as that is larger. A simulation that comes to where it is not
    runs away: looked at are speeds up to FASTER times the fastest one that was seen.
    """
    velocity = balance.data.joined("velocity")
    alone = replace(axis, effects=over_speed(axis))
    fastest = FASTER * float(np.abs(velocity).max())
    speeds = np.linspace(1.0 / SPEEDS, 1.0, SPEEDS) * fastest
    ways = [way for way in (-1.0, 1.0) if (way * velocity > balance.data.speed_threshold).any()]
    return any(bool((way * steady(alone, way * speeds) < 0.0).any()) for way in ways)


def _doubts_of_size(balance: TorqueBalance, fit: Fit, item: Instance) -> Iterator[Doubt]:
    if item.term.warn(item.values):
        yield Doubt.WARNED
    torque = own_torque(balance, fit, item)
    white = fit.noise.whiten(torque)
    if float(white @ white) < LEAST_OWN_GAIN * chance(1):
        yield Doubt.TOO_SMALL
    if rms(torque[balance.train]) > LARGEST_TORQUE * balance.torque_size:
        yield Doubt.TOO_LARGE


def own_torque(balance: TorqueBalance, fit: Fit, item: Instance) -> np.ndarray:
    """Torque (n,) that an effect of a fit adds, N m."""
    return balance.torque_residual(fit.axis.without_effect(item)) - balance.torque_residual(fit.axis)


def _side_line(balance: TorqueBalance, axis: Axis, item: Instance, other: Instance) -> bool:
    """Whether a wave is what another one of its kind, whose amplitude changes in the recording, has beside its line."""
    if item.term is not other.term or not item.term.periodic:
        return False
    one, two = (max(abs(x.values[wave.amplitude.name]) for wave in x.term.harmonics) for x in (item, other))
    angle = wave_angle(balance, axis, item.term)[balance.train]
    parted = abs(item.order - other.order) * float(np.ptp(angle))
    return one <= SIDE_SIZE * two and parted < 2.0 * math.pi * SIDE_PERIODS


def _whole(balance: TorqueBalance, fit: Fit, item: Instance) -> bool:
    """Whether the order of a wave that has to close with the turn may be a whole number.

    It may if that would lose no more than chance gives, or little of the wave: what else is missing moves its order.
    """
    if not item.term.whole or fit.axis.kind != "rotary":
        return True
    k = next((k for k, n in enumerate(fit.free) if n.is_order_of(item)), None)
    if k is None:
        return True
    away = math.log(max(round(item.order), 1) / item.order)  # orders are fitted as logarithms
    white = fit.noise.whiten(own_torque(balance, fit, item))
    lost = away**2 / max(float(fit.covariance[k, k]), 1e-300)
    return lost <= max(chance(1) * fit.squares.dispersion, NEARLY_WHOLE * float(white @ white))


def _driven(balance: TorqueBalance, fit: Fit, item: Instance) -> bool:
    """Whether the logged torque has a line at a vibration's frequency beyond any answer to the vibration.

    The line is then the motion's own or friction's harmonic of it, and what a model of friction leaves there is no vibration. A
    line of the motion is one of the torque: by the balance their sizes differ by no more than the vibration and friction's line.
    """
    data = balance.data
    longest = [(s, max(runs(~s.untouched), key=np.ptp)) for s in data.stretches]
    s, (a, b) = max(longest, key=lambda one: np.ptp(one[1]))
    t, torque = s.t[:: data.stride][a:b], s.torque[:: data.stride][a:b]
    window = np.hanning(len(t))
    series = window * (torque - np.mean(torque))

    def amplitude(offset: float) -> float:
        """Of the torque, N m, so many 1/duration beside the frequency."""
        frequency = item.order + offset / float(t[-1] - t[0])
        return 2.0 * abs(complex(np.exp(-2j * math.pi * frequency * t) @ series)) / float(window.sum())

    line = max(map(amplitude, np.linspace(-LINE_WIDTH, LINE_WIDTH, 5)))
    beside = float(np.median([amplitude(float(k)) ** 2 for k in (*-BESIDE, *BESIDE)]))
    own = math.sqrt(2.0) * rms(own_torque(balance, fit, item)[balance.train])
    return line - ANSWERED * own > math.sqrt(LINE * beside)


def _steady(balance: TorqueBalance, axis: Axis, item: Instance) -> bool:
    """Whether a vibration's phase follows the position: its cause may be the axis itself then, a wave over the position."""
    data, train = balance.data, balance.train
    phase = 2.0 * math.pi * item.order * data.joined("t")[train]
    angle = axis.cycle * data.joined("position")[train]
    order = abs(float(np.cov(angle, phase)[0, 1])) / max(float(np.var(angle, ddof=1)), 1e-300)
    parted = min(float(np.ptp(phase - way * order * angle)) for way in (1.0, -1.0))
    wave = 2.0 * math.pi / max(order * axis.cycle, 1e-300)  # rad, of position
    return parted < 2.0 * math.pi * ONE_WAVE and wave > max(_finest(balance), 2.0 * axis.bristle)


def _cancelled(balance: TorqueBalance, fit: Fit, item: Instance) -> bool:
    """Whether an effect's torque and those of others nearly add up to nothing: only their sum is known then."""
    others = [other for other in fit.axis.effects if other is not item]
    if not others:
        return False
    torques = np.stack([own_torque(balance, fit, x)[balance.train] for x in (item, *others)])
    gram = torques @ torques.T
    for chosen in itertools.product((0.0, 1.0), repeat=len(others)):
        together = np.array([1.0, *chosen])
        if float(together @ gram @ together) < LEFT_OVER**2 * gram[0, 0]:
            return True
    return False


def _unresolved(balance: TorqueBalance, fit: Fit, item: Instance) -> Iterator[Doubt]:
    """Whether a wave passes too seldom or too fast to be seen, or moves the axis within half a step of a coarse encoder.

    At steady speed the error of the steps repeats with time and position, and sampling makes it slow.
    """
    if not item.term.periodic:
        return
    if item.term.periodic == "position" and not _sampled(balance, fit.axis, item):
        yield Doubt.NOT_RESOLVED
    if item.term.periodic == "time" and item.order * float(np.ptp(balance.data.joined("t"))) < FEWEST_PERIODS:
        yield Doubt.NOT_RESOLVED
    if _within_half_a_step(balance, fit, item):
        yield Doubt.QUANTISATION


def _within_half_a_step(balance: TorqueBalance, fit: Fit, item: Instance) -> bool:
    """Whether a wave moves the axis, or the reading of it, by less than half a step of a coarse encoder."""
    step = balance.data.position_step
    if step == 0.0:
        return False
    if item.term.place is Place.SENSOR:
        error = max(abs(item.values[p.name]) for p in item.term.parameters if p.role is Role.LINEAR)
        return error < HALF_A_STEP * step
    phase_rate = 2.0 * math.pi
    if item.term.periodic == "position":
        phase_rate = fit.axis.cycle * float(np.median(np.abs(balance.data.joined("velocity")[balance.train])))
    rate = phase_rate * item.order
    amplitude = math.sqrt(2.0) * rms(own_torque(balance, fit, item)[balance.train])
    return amplitude < HALF_A_STEP * step * fit.axis.inertia * rate**2


def _sampled(balance: TorqueBalance, axis: Axis, item: Instance) -> bool:
    """Whether a wave over the position has enough periods in the travel, and the encoder enough steps in a period."""
    once = 2.0 * math.pi / (float(np.ptp(balance.data.joined("position"))) * axis.cycle)
    lowest, _ = item.term.orders(once, axis.kind == "rotary")
    return item.order > (1.0 - BELOW_SEARCH) * lowest and 2.0 * math.pi > item.order * axis.cycle * _finest(balance)


def _finest(balance: TorqueBalance) -> float:
    """Shortest wave over the position that the encoder samples, rad."""
    return RESOLVED_PERIOD * max(balance.data.position_step, balance.data.position_noise)


def _out_of_range(balance: TorqueBalance, base: Axis, item: Instance) -> Iterator[Doubt]:
    """Whether a fit ended at a declared bound, or far from all values that the effect is searched at in such a recording."""
    if any(_at_bound(item, parameter) for parameter in item.term.parameters):
        yield Doubt.AT_BOUND
    if not within_search(item, survey(balance, base), item.values):
        yield Doubt.NOT_RESOLVED


def _at_bound(item: Instance, parameter: Parameter) -> bool:
    value = item.values[parameter.name]
    if parameter.role in (Role.FIXED, Role.PHASE) or value == parameter.default or value == 0.0:
        return False
    near = AT_BOUND * abs(value)
    return abs(value - parameter.lower) < near or abs(value - parameter.upper) < near


def within_search(item: Instance, view: Survey, names: Collection[str]) -> bool:
    """Whether these values of a term are near those that it is searched at in such a recording; beyond them it cannot be told."""
    scans = item.term.scan(view)
    for name in scans[0] if len(scans) else ():
        searched = {scan[name] for scan in scans}
        given = name in names and item.values[name] != item.term.parameter(name).default
        lowest, highest = min(searched) / SEARCH_MARGIN, max(searched) * SEARCH_MARGIN
        if given and len(searched) > 2 and not lowest < item.values[name] < highest:
            return False
    return True
