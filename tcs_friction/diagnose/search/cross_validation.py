"""Cross-validation of candidates: what a candidate gains it has to gain on pieces of the data that it was not fitted to.

In: the base fit and candidates. Out: the candidates, the best of them confirmed. Each piece in turn is left out of the fit of the
candidate's own numbers, linear about the optimum (the closed form of leave-one-block-out least squares, Burman et al. 1994).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.diagnose.dataset.excitation import passes
from tcs_friction.diagnose.fit.balance import TorqueBalance, jumps
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.fit.noise_estimate import misfit
from tcs_friction.diagnose.fit.parameters import belongs_to, bound_reached
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.significance import DISTINGUISHABLE, chance
from tcs_friction.physics.terms import Instance

PLAIN_GROWTH = 1.01  # factor by which the residual that is not whitened may grow on pieces that a candidate was not fitted to
NEAR = 3.0  # widths about its centre, where a local effect that was passed once must account for all
SEVERAL_PIECES = 0.1  # of a candidate's gain, or what chance gives, must come from other pieces than the best


@dataclass(frozen=True)
class SquaresOnPieces:
    """Squares of a fit on pieces (p,) of the train data: whitened, and of the residual itself, N^2 m^2."""

    white: np.ndarray
    plain: np.ndarray


def squares_left_out(balance: TorqueBalance, fit: Fit, items: Sequence[Instance]) -> SquaresOnPieces:
    """Squares on each piece with the numbers of these effects fitted to all other pieces, linear about the optimum.

    A piece is as long as a held-out one. All other numbers follow the effects as they do over the whole data: what one piece
    alone says about a bristle is not asked. The shape of an effect whose torque jumps with it stays: derivatives by it say
    nothing.
    """
    own = np.array([belongs_to(number, items) for number in fit.free])
    residual = balance.residual(fit.axis, fit.noise)
    plain = balance.derivatives(fit.axis, fit.free, fit.noise, residual)
    movable = [
        bound_reached(fit.axis, fit.free, k) == 0 and not (own[k] and jumps(fit.axis, number))
        for k, number in enumerate(fit.free)
    ]
    size = np.linalg.norm(plain, axis=0) * movable
    plain, own = plain[:, size > 0.0] / size[size > 0.0], own[size > 0.0]
    columns, white = fit.noise.whiten(plain), fit.noise.whiten(residual)
    follow = np.linalg.lstsq(columns[:, ~own], columns[:, own], rcond=1e-9)[0]
    plain, columns = plain[:, own] - plain[:, ~own] @ follow, columns[:, own] - columns[:, ~own] @ follow
    normal, scores = columns.T @ columns, columns.T @ white
    samples = balance.samples
    squares = SquaresOnPieces(np.zeros(samples.pieces.max() + 1), np.zeros(samples.pieces.max() + 1))
    for piece in range(len(squares.white)):
        left, every = samples.pieces[samples.rows] == piece, (samples.pieces == piece) & samples.train
        some = columns[left]
        others = normal - some.T @ some
        step = -np.linalg.lstsq(others, scores - some.T @ white[left], rcond=1e-10)[0]
        squares.white[piece] = np.sum((white[left] + some @ step) ** 2)
        squares.plain[piece] = np.sum((residual[every] + plain[every] @ step) ** 2)
    return squares


def squares_as_fitted(balance: TorqueBalance, fit: Fit) -> SquaresOnPieces:
    """Squares of a fit on every piece as it is."""
    samples = balance.samples
    residual = balance.residual(fit.axis, fit.noise)
    count = int(samples.pieces.max()) + 1
    white = np.bincount(samples.pieces[samples.rows], fit.noise.whiten(residual) ** 2, count)
    plain = np.bincount(samples.pieces[samples.train], residual[samples.train] ** 2, count)
    return SquaresOnPieces(white, plain)


def with_best_confirmed(
    balance: TorqueBalance, base: Fit, candidates: list[Candidate], dispersion: float
) -> list[Candidate]:
    """Candidates, best first, the best of them confirmed on pieces that it was not fitted to; a gain that fails is taken back."""
    waiting, done = list(candidates), list[Candidate]()
    if not candidates:
        return []
    before = None
    while True:
        best = simplest(balance, [*waiting, *done])
        if best.score <= 0.0 or any(best is candidate for candidate in done):
            break
        before = squares_as_fitted(balance, base) if before is None else before
        gain = _confirmed_gain(balance, base, best, before, dispersion)
        waiting.remove(best)
        done.append(replace(best, gain=min(best.gain, gain + best.threshold if gain > 0.0 else gain)))
    rest = sorted((c for c in (*waiting, *done) if c is not best), key=lambda candidate: -candidate.score)
    return [best, *rest]


def _confirmed_gain(
    balance: TorqueBalance, base: Fit, candidate: Candidate, before: SquaresOnPieces, dispersion: float
) -> float:
    """Gain on pieces that a candidate was not fitted to, zero where they do not confirm it.

    The residual itself must not grow there, and what depends on the place must not gain in a single piece: it comes back to
    its place. What is in one place only, and was passed once, must account for all that was there instead. The best and worst
    piece of collisions do not count: one lost throws a whole piece out of step.
    """
    items = candidate.items
    once = len(items) == 1 and _passed_once(balance, items[0])
    after = squares_as_fitted(balance, candidate.fit) if once else squares_left_out(balance, candidate.fit, items)
    gains = (before.white - after.white) / dispersion
    gain = float(gains.sum())
    placed = any(item.term.coordinate == "position" for item in items)
    enough = min(SEVERAL_PIECES * gain, chance(candidate.start.count, candidate.start.alternatives))
    if once:
        gain = candidate.gain if _accounts_for_its_place(balance, base, candidate) else 0.0
    elif placed and gain - float(gains.max()) < enough:
        gain = 0.0
    counted = np.argsort(gains)
    if any(item.term.collides for item in items):
        counted = counted[1:-1]
        gain = float(gains[counted].sum())
    return 0.0 if after.plain[counted].sum() > PLAIN_GROWTH * before.plain[counted].sum() else gain


def _near(balance: TorqueBalance, item: Instance, widths: float) -> np.ndarray:
    """Rows (m,) in which the axis is so near to a local effect's place."""
    assert item.term.local is not None
    centre, width = (item.values[name] for name in (item.term.local.centre, item.term.local.width))
    far = np.abs(balance.data.joined("position")[balance.samples.rows] - centre)
    return np.asarray(far < widths * width)


def _passed_once(balance: TorqueBalance, item: Instance) -> bool:
    """Whether an effect is local and its place was passed once, or in one piece only: nothing is left to confirm it by."""
    if item.term.local is None:
        return False
    near = _near(balance, item, 1.0)
    return passes(near) < 2 or len(np.unique(balance.samples.pieces[balance.samples.rows][near])) < 2


def _accounts_for_its_place(balance: TorqueBalance, base: Fit, candidate: Candidate) -> bool:
    """Whether a local effect takes away nearly all that the base left around its place, but the noise."""
    near = _near(balance, candidate.items[0], NEAR)
    before, after = (base.noise.whiten(balance.residual(x.axis, base.noise))[near] for x in (base, candidate.fit))
    noise = len(after) * balance.samples.effective_count / len(balance.samples.rows)
    return bool(after @ after - noise < SEVERAL_PIECES * (before @ before))


def simplest(balance: TorqueBalance, candidates: Sequence[Candidate]) -> Candidate:
    """The best candidate; of those that the data cannot tell from it, the one with the fewest declared parameters."""
    best = max(candidates, key=lambda candidate: candidate.score)
    if best.score <= 0.0:
        return best
    same = DISTINGUISHABLE * misfit(balance, balance.residual(best.fit.axis, best.fit.noise))
    close = [c for c in candidates if c.score > max(best.score - same, 0.0)]
    return min(close, key=lambda c: (sum(len(item.term.parameters) for item in c.items), -c.score))
