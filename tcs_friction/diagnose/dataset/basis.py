"""Smooth functions of one coordinate from which maps of the residual are made: hats, waves, powers of a speed.

A map is the product of two of them. Both are sparse (a sample touches one or two columns), so that chunk means of hundreds of
columns are one pass over the samples, and both can be sampled on the regular grid of a table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse


class Basis(Protocol):
    """Functions of one coordinate over [lower, upper].

    count: of columns. nodes: of the grid that shows it. `evaluate` gives for x (n,) the touched columns (n, s) and their
    values (n, s). `roughness` (count, count) is what a smooth function has little of.
    """

    @property
    def coordinate(self) -> str: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def nodes(self) -> int: ...
    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
    def roughness(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Hats:
    """Piecewise linear between `count` equidistant nodes, constant outside."""

    coordinate: str
    lower: float
    upper: float
    count: int

    @property
    def nodes(self) -> int:
        return self.count

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = (x - self.lower) / (self.upper - self.lower) * (self.count - 1)
        place = np.clip(place, 0.0, self.count - 1.0)
        index = np.minimum(place.astype(np.int64), self.count - 2)
        share = place - index
        return np.stack([index, index + 1], axis=1), np.stack([1.0 - share, share], axis=1)

    def roughness(self) -> np.ndarray:
        steps = np.diff(np.eye(self.count), axis=0)
        return np.asarray(steps.T @ steps)


def hats(x: np.ndarray, count: int) -> sparse.csr_array:
    """Hats over all of a series' values (n, count), none where it does not vary."""
    lower, upper = float(x.min()), float(x.max())
    if not upper - lower > 1e-12 * max(abs(lower), abs(upper), math.ulp(1.0)):
        return sparse.csr_array((len(x), 0))
    index, value = Hats("", lower, upper, count).evaluate(x)
    ends = np.arange(0, index.size + 1, index.shape[1])
    return sparse.csr_array((value.ravel(), index.ravel(), ends), shape=(len(x), count))


@dataclass(frozen=True)
class One:
    """The constant: makes a product a map over the other coordinate alone."""

    coordinate: str = ""
    lower: float = 0.0
    upper: float = 1.0
    count: int = 1
    nodes: int = 1

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((len(x), 1), np.int64), np.ones((len(x), 1))

    def roughness(self) -> np.ndarray:
        return np.zeros((1, 1))


@dataclass(frozen=True)
class Odd:
    """Proportional to the coordinate, within [-upper, upper]; one at the end."""

    coordinate: str
    upper: float
    count: int = 1
    nodes: int = 2

    @property
    def lower(self) -> float:
        return -self.upper

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((len(x), 1), np.int64), np.clip(x / self.upper, -1.0, 1.0)[:, None]

    def roughness(self) -> np.ndarray:
        return np.zeros((1, 1))


@dataclass(frozen=True)
class Even(Odd):
    """Proportional to the coordinate's amount."""

    nodes: int = 3

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        index, value = super().evaluate(x)
        return index, np.abs(value)


@dataclass(frozen=True)
class Wave:
    """Cosine and sine of `order` (rad of phase per unit of the coordinate)."""

    coordinate: str
    lower: float
    upper: float
    order: float
    count: int = 2

    @property
    def nodes(self) -> int:
        """As many as a straight line between them needs, fewer a period where there are many."""
        periods = (self.upper - self.lower) * self.order / (2.0 * math.pi)
        return 1 + math.ceil(periods * min(max(600.0 / max(periods, 1.0), 6.0), 24.0))

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        index = np.broadcast_to(np.arange(2), (len(x), 2))
        phase = self.order * np.clip(x, self.lower, self.upper)
        return index, np.stack([np.cos(phase), np.sin(phase)], axis=1)

    def roughness(self) -> np.ndarray:
        return np.zeros((2, 2))


@dataclass(frozen=True)
class Product:
    """Map made of two bases; columns are ordered first basis by second."""

    first: Basis
    second: Basis

    @property
    def coordinates(self) -> tuple[str, ...]:
        return tuple(b.coordinate for b in (self.first, self.second) if b.coordinate)

    @property
    def count(self) -> int:
        return self.first.count * self.second.count

    def evaluate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Touched columns and their values for coordinates (n,) each."""
        i, a = self.first.evaluate(x)
        j, b = self.second.evaluate(y)
        index = i[:, :, None] * self.second.count + j[:, None, :]
        return index.reshape(len(x), -1), (a[:, :, None] * b[:, None, :]).reshape(len(x), -1)

    def roughness(self) -> np.ndarray:
        """Steps along both coordinates, and a little of the size itself so that columns without data stay near zero."""
        one, two = self.first, self.second
        steps = np.kron(one.roughness(), np.eye(two.count)) + np.kron(np.eye(one.count), two.roughness())
        return np.asarray(steps + 0.02 * np.eye(self.count))

    def grid(self, coefficients: np.ndarray) -> np.ndarray:
        """Values (first.nodes,) or (first.nodes, second.nodes) on the regular grid, from coefficients (count,)."""
        square = coefficients.reshape(self.first.count, self.second.count)
        values = _sampled(self.first) @ square @ _sampled(self.second).T
        return np.asarray(values if self.second.coordinate else values[:, 0])


def _sampled(basis: Basis) -> np.ndarray:
    """(nodes, count): the columns on the basis' grid."""
    x = np.linspace(basis.lower, basis.upper, basis.nodes)
    index, value = basis.evaluate(x)
    columns = np.zeros((len(x), basis.count))
    for k in range(index.shape[1]):  # a column is touched once by each k
        columns[np.arange(len(x)), index[:, k]] += value[:, k]
    return columns
