"""Confirmation: what a candidate gains it has to gain on pieces of the data that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tcs_friction.diagnose.dataset.excitation import passes
from tcs_friction.diagnose.fit.balance import Balance, Fit
from tcs_friction.diagnose.fit.parameters import Free, at_bound
from tcs_friction.diagnose.search.candidates import SAME, Candidate, chance
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.terms import Instance, Role

WORSE = 1.01  # by which the plain residual may grow on pieces that a candidate was not fitted to
AROUND = 3.0  # widths about its centre, where a local effect that was passed once must account for all
ONCE = 0.1  # of a candidate's gain, or what chance gives, must come from other pieces than the best


@dataclass(frozen=True)
class LeftOut:
    """Squares of a fit on pieces (p,) of the train data that it is not fitted to: whitened, and of the plain residual."""

    white: np.ndarray
    plain: np.ndarray


def left_out(balance: Balance, fit: Fit, count: int = 1) -> LeftOut:
    """The numbers of the last `count` effects without one piece at a time, linear about the optimum.

    A piece is as long as a held-out one. All other numbers follow the effects as they do over the whole data: what one piece
    alone says about a bristle is not asked.
    The shape of a jagged effect stays as it is: derivatives by it say nothing.
    """
    own = np.array([f.owner >= len(fit.axis.effects) - count for f in fit.free])
    still = [mine and _jagged(fit.axis, f) for mine, f in zip(own, fit.free, strict=True)]
    residual = balance.residual(fit.axis)
    plain = balance.columns(fit.axis, fit.free, residual)
    size = np.linalg.norm(plain, axis=0) * [
        at_bound(fit.axis, fit.free, k) == 0 and not still[k] for k in range(len(fit.free))
    ]
    plain, own = plain[:, size > 0.0] / size[size > 0.0], own[size > 0.0]
    columns, white = balance.whiten(plain), balance.whiten(residual)
    follow = np.linalg.lstsq(columns[:, ~own], columns[:, own], rcond=1e-9)[0]
    plain, columns = plain[:, own] - plain[:, ~own] @ follow, columns[:, own] - columns[:, ~own] @ follow
    normal, scores = columns.T @ columns, columns.T @ white
    piece = balance.pieces
    squares = LeftOut(np.zeros(piece.max() + 1), np.zeros(piece.max() + 1))
    for number in range(len(squares.white)):
        left, every = piece[balance.rows] == number, (piece == number) & balance.train
        some = columns[left]
        others = normal - some.T @ some
        step = -np.linalg.lstsq(others, scores - some.T @ white[left], rcond=1e-10)[0]
        squares.white[number] = np.sum((white[left] + some @ step) ** 2)
        squares.plain[number] = np.sum((residual[every] + plain[every] @ step) ** 2)
    return squares


def _jagged(axis: Axis, number: Free) -> bool:
    """Whether its effect's torque jumps with a number."""
    item = axis.effects[number.owner]
    return item.term.jagged and item.term.parameter(number.name).role is Role.SHAPE


def as_fitted(balance: Balance, fit: Fit) -> LeftOut:
    """Squares of a fit on every piece as it is."""
    residual = balance.residual(fit.axis)
    count = int(balance.pieces.max()) + 1
    white = np.bincount(balance.pieces[balance.rows], balance.whiten(residual) ** 2, count)
    plain = np.bincount(balance.pieces[balance.train], residual[balance.train] ** 2, count)
    return LeftOut(white, plain)


def confirmed(balance: Balance, fit: Fit, candidates: list[Candidate], spread: float) -> list[Candidate]:
    """Candidates, best first, the best of them confirmed: what it gains, it gains on pieces that it was not fitted to.

    There the plain residual must not grow, and what depends on the place not gain in a single piece: it comes back to its place.
    What is in one place only, and was passed once, must account for all that was there instead.
    The best and worst piece of collisions do not count: one lost throws a whole piece out of step.
    """
    before: LeftOut | None = None
    if not candidates:
        return []
    waiting: list[Candidate] = list(candidates)
    done: list[Candidate] = []
    while True:
        best = simplest(balance, [*waiting, *done])
        if best.score <= 0.0 or any(best is candidate for candidate in done):
            break
        before = as_fitted(balance, fit) if before is None else before
        lone = len(best.items) == 1 and _passed_once(balance, best.items[0])
        after = as_fitted(balance, best.fit) if lone else left_out(balance, best.fit, len(best.items))
        gains = (before.white - after.white) / spread
        gain = float(gains.sum())
        placed = any(item.term.coordinate == "position" for item in best.items)
        enough = min(ONCE * gain, chance(best.start.count, best.start.looks))
        if lone:
            gain = best.gain if _accounts(balance, fit, best) else 0.0
        elif placed and gain - float(gains.max()) < enough:
            gain = 0.0
        kept = np.argsort(gains)
        if any(item.term.collides for item in best.items):
            kept = kept[1:-1]
            gain = float(gains[kept].sum())
        if after.plain[kept].sum() > WORSE * before.plain[kept].sum():
            gain = 0.0
        waiting.remove(best)
        done.append(replace(best, gain=min(best.gain, gain + best.threshold if gain > 0.0 else gain)))
    rest = sorted((c for c in (*waiting, *done) if c is not best), key=lambda candidate: -candidate.score)
    return [best, *rest]


def _near(balance: Balance, item: Instance, widths: float) -> np.ndarray:
    """Rows in which the axis is so near to a local effect's place."""
    far = np.abs(balance.data.joined("position")[balance.rows] - item.values["centre"])
    return np.asarray(far < widths * item.values["width"])


def _passed_once(balance: Balance, item: Instance) -> bool:
    """Whether an effect is local and its place was passed once, or in one piece only: nothing is left to confirm it by."""
    if not item.term.local:
        return False
    near = _near(balance, item, 1.0)
    return passes(near) < 2 or len(np.unique(balance.pieces[balance.rows][near])) < 2


def _accounts(balance: Balance, base: Fit, candidate: Candidate) -> bool:
    """Whether a local effect takes away nearly all that the base left around its place, but the noise."""
    near = _near(balance, candidate.items[0], AROUND)
    before, after = (balance.whiten(balance.residual(fit.axis))[near] for fit in (base, candidate.fit))
    noise = len(after) * balance.effective_count / len(balance.rows)
    return bool(after @ after - noise < ONCE * (before @ before))


def simplest(balance: Balance, candidates: list[Candidate]) -> Candidate:
    """The best candidate; of those that the data cannot tell from it, the one with the fewest declared parameters."""
    best = max(candidates, key=lambda candidate: candidate.score)
    if best.score <= 0.0:
        return best
    same = SAME * balance.misfit(best.fit.axis)
    close = [c for c in candidates if c.score > max(best.score - same, 0.0)]
    return min(close, key=lambda c: (sum(len(item.term.parameters) for item in c.items), -c.score))
