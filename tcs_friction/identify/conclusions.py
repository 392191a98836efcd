"""What a fit says: values with uncertainties, correlations, bounds, errors on data it saw and did not see, both directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tcs_friction.identify.determined import LARGEST_RELATIVE, Verdicts
from tcs_friction.identify.prediction import NUISANCES, Predictor
from tcs_friction.identify.problem import Problem
from tcs_friction.identify.refine import Refined, Space, refine
from tcs_friction.identify.result import Errors, Estimate, Fit
from tcs_friction.identify.sharpen import Sharpened
from tcs_friction.identify.uncertainty import block_bootstrap, correlations, cramer_rao, sandwich
from tcs_friction.numerics.by_speed import TorqueBySpeed, linear_std, speed_bins, torque_by_speed

LEAST_ONE_WAY = 50  # compared samples of motion one way, for a fit of their own
UNCERTAINTIES = ("sandwich", "bootstrap")
BOUND_LAGS = 60  # of the residual's autocovariance
BOOTSTRAP_SEED = 0
IDENTIFIED, BELIEVED = "identified", "believed"  # models in friction against speed


@dataclass(frozen=True, eq=False)
class Conclusions:
    """A fit of torques, judged, and that of predictions that sharpened it, if one could be made.

    shifts: by how much the unknowns (p,) move under other assumptions (low pass, timing, way to fit): they are that unsure, too.
    minimum: whether the fit is at a minimum of the cost; elsewhere every standard deviation is NaN.
    """

    problem: Problem
    verdicts: Verdicts
    sharp: Sharpened | None
    loss: str
    uncertainty: str
    shifts: tuple[np.ndarray, ...] = ()
    minimum: bool = True

    @property
    def refined(self) -> Refined:
        """The fit, as residuals of torque."""
        return self.verdicts.refined

    @property
    def end(self) -> tuple[Refined, Space]:
        """The last fit, of predictions if there is one, and the space it moved in."""
        return (
            (self.refined, self.verdicts.space) if self.sharp is None else (self.sharp.fit, self.sharp.space)
        )

    @property
    def aim(self) -> Problem | Predictor:
        """What the last fit brought near its target."""
        return self.problem if self.sharp is None else self.sharp.aim

    @cached_property
    def covariance(self) -> np.ndarray:
        """(p, p) of the unknowns, with what they owe to undetermined ones."""
        if not self.minimum:
            return np.full(self.verdicts.owed.shape, np.nan)
        covariance = _covariance(self.refined, self.verdicts.space.free, self.uncertainty)
        if self.sharp is not None:
            by_derivatives = _covariance(self.sharp.fit, self.sharp.space.free, self.uncertainty)
            own = self.sharp.covariance_as_seen(by_derivatives)[:-NUISANCES, :-NUISANCES]
            covariance[: len(own), : len(own)] = own
        covariance += self.verdicts.owed
        return np.asarray(covariance + sum(np.outer(shift, shift) for shift in self.shifts))

    def estimate(self, k: int) -> Estimate:
        """Unknown k of the problem."""
        return _estimate(self.problem, self.verdicts, self.covariance, k)

    def parameters(self) -> dict[str, Estimate]:
        """Of the law, by name."""
        return {name: self.estimate(k) for k, name in enumerate(self.problem.names[: self.problem.law_size])}

    def directions(self) -> Mapping[str, Mapping[str, Estimate]]:
        """The law fitted to each direction of motion on its own; inertia and offset are those of both together."""
        return {
            way: found
            for way, sign in (("positive", 1.0), ("negative", -1.0))
            if self.problem.motion.reverses and (found := self._one_way(sign))
        }

    def _one_way(self, sign: float) -> dict[str, Estimate]:
        size, space = self.problem.law_size, self.verdicts.space
        part = self.problem.masked(sign * self.problem.velocity > 0.0)
        if np.count_nonzero(part.weights) < LEAST_ONE_WAY:
            return {}
        space = space.holding(np.arange(len(space.free)) >= size)
        fitted = refit(part, self.refined.unknowns, space, self.loss, 20)
        covariance = _covariance(fitted, space.free, self.uncertainty) if self.minimum else self.covariance
        chosen = replace(self.verdicts, refined=fitted)
        return {name: _estimate(part, chosen, covariance, k) for k, name in enumerate(part.names[:size])}

    def errors(self, polished: bool) -> Errors:
        """Residuals of a fit of torques that saw only the training samples; a search has seen all, and says so by both."""
        training = training_mask(self.problem)
        fitted = self.refined
        if polished:
            part = self.problem.masked(training)
            fitted = refit(part, fitted.unknowns, self.verdicts.space, self.loss, 8)
        residual = self.problem.unexplained(fitted)
        counted = self.problem.explained
        return Errors(rms(residual[training & counted]), rms(residual[~training & counted]))

    def fit(self) -> Fit:
        """For pictures."""
        problem, refined = self.problem, self.refined
        rest = problem.beside(refined.unknowns)
        modelled = problem.target - problem.unexplained(refined)
        bounds = np.searchsorted(problem.thin.centres, problem.motion.bounds)
        return Fit(
            problem.times, problem.velocity, problem.target, modelled,
            problem.target - rest, modelled - rest, bounds,
        )  # fmt: skip

    def by_speed(self, believed: Mapping[str, float]) -> TorqueBySpeed | None:
        """Friction against speed: measured, by the fit, and by the law's believed parameters, if given; None without motion."""
        problem, refined, fit = self.problem, self.refined, self.fit()
        size, counted = problem.law_size, problem.explained & (problem.weights > 0.0)
        bins = speed_bins(fit.velocity, problem.motion.resolution, counted)
        if not bins.count:
            return None
        models = {IDENTIFIED: fit.friction_modelled}
        if set(believed) == set(problem.names[:size]):
            unknowns = refined.unknowns.copy()
            unknowns[:size] = [believed[name] for name in problem.names[:size]]
            models[BELIEVED] = problem.torque(unknowns) - (fit.modelled - fit.friction_modelled)
        std = linear_std(bins, refined.jacobian[:, :size], self.covariance[:size, :size])
        stds = {IDENTIFIED: std} if self.minimum else {}
        return torque_by_speed(bins, fit.velocity, fit.friction_measured, models, stds, IDENTIFIED)

    def correlation(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Names and correlations (p, p) of the free unknowns without initial bristle torques; none away from a minimum."""
        if not self.minimum:
            return (), np.zeros((0, 0))
        index = [k for k in np.flatnonzero(self.verdicts.space.free) if k < self.problem.states_index]
        names = tuple(self.problem.names[k] for k in index)
        return names, correlations(self.covariance[np.ix_(index, index)])

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bounds for Gaussian errors with the residual's own autocovariance, or that of the errors of prediction.

        None away from a minimum, where the residual is more than errors.
        """
        fit, space = self.end
        counted, index = fit.weights > 0.0, np.flatnonzero(space.free)
        residual = fit.residual[counted]
        if not self.minimum or not len(residual) or not residual.any():
            return {}
        centred = residual - residual.mean()
        lags = min(max(len(centred) // 4, 1), BOUND_LAGS) if self.sharp is None else 1
        noise = np.array([float(centred[k:] @ centred[: len(centred) - k]) for k in range(lags)]) / len(
            centred
        )
        taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(lags) / lags)
        covariance = cramer_rao(fit.jacobian[np.ix_(counted, index)], noise * taper)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        kept, names = self.problem.states_index, self.problem.names
        return {names[k]: float(std) for k, std in zip(index, deviation, strict=True) if k < kept}


def refit(
    problem: Problem,
    unknowns: np.ndarray,
    space: Space,
    loss: str,
    iterations: int,
    tolerance: float | None = None,
) -> Refined:
    """Refine a few steps on those samples that count."""
    return refine(
        problem.linearised,
        problem.torque,
        problem.target,
        problem.weights,
        unknowns,
        space,
        loss,
        iterations,
        problem.tolerance if tolerance is None else tolerance,
    )


def rms(values: np.ndarray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def training_mask(problem: Problem) -> np.ndarray:
    """(m,) True for samples that train: all recordings but the last, or, with one, eight of ten blocks of it."""
    motion, centres = problem.motion, problem.thin.centres
    owner = np.asarray(motion.sources)[np.searchsorted(motion.bounds, centres, side="right") - 1]
    if len(set(motion.sources)) > 1:
        return np.asarray(owner != max(motion.sources))
    block = np.arange(len(centres)) * 10 // len(centres)
    return np.asarray(~np.isin(block, (3, 7)))


def _covariance(refined: Refined, free: np.ndarray, uncertainty: str) -> np.ndarray:
    index = np.flatnonzero(free)
    result = np.zeros((len(free), len(free)))
    jacobian = refined.jacobian[:, index]
    result[np.ix_(index, index)] = (
        sandwich(jacobian, refined.residual, refined.weights)
        if uncertainty == "sandwich"
        else block_bootstrap(jacobian, refined.residual, refined.weights, BOOTSTRAP_SEED)
    )
    return result


def _unit(problem: Problem, k: int) -> str:
    declared = [p.unit for p in problem.axis.friction.term.parameters]
    return problem.axis.unit([*declared, "kg m^2", "N m", "s"][k])


def _estimate(problem: Problem, verdicts: Verdicts, covariance: np.ndarray, k: int) -> Estimate:
    """Unknown k with its standard error; a positive one that may as well be next to nothing, or twice itself, is undetermined."""
    value, std = float(verdicts.refined.unknowns[k]), float(np.sqrt(max(covariance[k, k], 0.0)))
    reason = verdicts.reasons.get(k)
    if reason is None and verdicts.space.logarithmic[k] and std > LARGEST_RELATIVE * abs(value):
        reason = f"only to {100.0 * std / abs(value):.0f} %, with all that is not known beside it"
    return Estimate(value, std, _unit(problem, k), reason is None, reason)
