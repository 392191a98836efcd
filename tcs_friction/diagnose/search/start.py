"""A start: where a joint fit of one more effect may begin, and what it promises.

In: a projected residual, an effect and values of its shape. Out: the `Start` with the best amplitudes. Effects linear in an
amplitude are judged by their columns, others by the residual that they leave.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tcs_friction.diagnose.fit.parameters import amplitudes, small_amplitude
from tcs_friction.diagnose.search.projection import ProjectedResidual, probes
from tcs_friction.physics.terms import Instance, Place, Role, Term, instance

STARTS = 2  # of an effect that are kept
GAIN_PER_NUMBER = 12.0  # about what `chance` asks for each number of an effect that was found among a thousand alternatives


class Kind(NamedTuple):
    """What an effect is, whatever its values: its id and the recorded signal through which it acts."""

    effect: str
    signal: str | None = None

    @property
    def words(self) -> str:
        """Its id with the signal it acts through."""
        return self.effect + (f" from {self.signal}" if self.signal else "")


def kind_of(item: Instance) -> Kind:
    """The kind of an effect."""
    return Kind(item.term.id, item.signal)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a joint fit of one more effect, or of two, may start.

    gain: drop of the whitened squares that it promises. count: of free numbers. alternatives: how many were searched through to
    find it. columns (m, k): projected and whitened, of its linear numbers; none where the gain is not linear. noise_excess: how
    much chance gives near its order, over what the noise estimate says.
    """

    instances: tuple[Instance, ...]
    gain: float
    count: int
    alternatives: float
    columns: np.ndarray
    noise_excess: float = 1.0

    @property
    def instance(self) -> Instance:
        """The effect, the first of two."""
        return self.instances[0]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of its effects."""
        return tuple(map(kind_of, self.instances))

    @property
    def promise(self) -> float:
        """The gain in units of the noise near its order."""
        return self.gain / self.noise_excess


def judged_linear(
    projected: ProjectedResidual,
    term: Term,
    shape: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
) -> Start | None:
    """The start with the best amplitudes for values of the shape."""
    columns = projected.columns(probes(term, shape, signal_name))
    start = with_best_amplitudes(projected, term, shape, signal_name, alternatives, columns)
    if start is None or not follows_load(term):
        return start
    return replace(start, gain=min(start.gain, gain_by_load_from_motion(projected, start.instance)))


def follows_load(term: Term) -> bool:
    """Whether an effect scales friction by the logged torque, whose noise is the residual's own."""
    return term.place is Place.SCALE and "torque" in term.reads


def gain_by_load_from_motion(projected: ProjectedResidual, item: Instance) -> float:
    """Gain of friction that follows the load when the load is taken from the motion: noise of the logged torque gives none."""
    column = projected.project(projected.noise.whiten(projected.change_by_load_from_motion(item)))
    gain, sizes = projected.gain(column[:, None])
    return gain if sizes[0] > 0.0 else 0.0


def with_best_amplitudes(
    projected: ProjectedResidual,
    term: Term,
    shape: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
    columns: np.ndarray,
) -> Start | None:
    """The start with the best amplitudes for the probes' columns (m, k); None where they do nothing or cannot be."""
    norms = np.linalg.norm(columns, axis=0)
    keep = norms > 1e-9 * max(float(norms.max()), 1e-300)
    if not keep.any() or norms.max() == 0.0:
        return None
    gain, sizes = projected.gain(columns[:, keep] / norms[keep])
    multiples = np.zeros(len(norms))
    multiples[keep] = sizes / norms[keep]
    if _forbidden_sign(term, multiples):
        return None
    item = with_multiples(term, shape, signal_name, multiples)
    kept = single_precision(columns[:, keep] / norms[keep])
    return Start((item,), gain, int(keep.sum()) + len(shape), alternatives, kept)


def single_precision(columns: np.ndarray) -> np.ndarray:
    """Columns to be kept while all hypotheses are compared: half the memory, and gains need no more."""
    return columns.astype(np.float32)


def _forbidden_sign(term: Term, multiples: np.ndarray) -> bool:
    """Whether the effect's only linear number has a sign that its declaration forbids."""
    linear = [p for p, phase in amplitudes(term.parameters) if p.role is Role.LINEAR and phase is None]
    return len(linear) == len(multiples) == 1 and linear[0].lower == 0.0 and multiples[0] <= 0.0


def with_multiples(
    term: Term, shape: Mapping[str, float], signal_name: str | None, multiples: np.ndarray
) -> Instance:
    """The instance whose linear numbers are the probes' multiples."""
    values, numbers = dict(shape), iter(multiples)
    for parameter, phase in amplitudes(term.parameters):
        if parameter.role is not Role.LINEAR:
            continue
        value = next(numbers) * small_amplitude(parameter.unit)
        if phase is not None:
            sine = next(numbers) * small_amplitude(parameter.unit)
            values[phase.name] = math.atan2(sine, value) % (2.0 * math.pi)
            value = math.hypot(value, sine)
        values[parameter.name] = min(max(value, parameter.lower), parameter.upper)
    return instance(term, values, signal=signal_name)


def judged_directly(
    projected: ProjectedResidual,
    term: Term,
    values: Mapping[str, float],
    signal_name: str | None,
    alternatives: float,
) -> Start | None:
    """The start of an effect without an amplitude, by the residual that it leaves."""
    item = instance(term, values, signal=signal_name)
    change = projected.change_by_body(item) if term.resonates else projected.change(item)
    left = projected.project(projected.noise.whiten(projected.residual + change))
    gain = projected.squares - float(left @ left)
    return Start((item,), gain, len(values), alternatives, np.empty((len(left), 0)))
