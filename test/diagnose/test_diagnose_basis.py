"""Products of smooth functions: the table of a map is the map."""

from __future__ import annotations

import numpy as np
import pytest

from tcs_friction.diagnose.dataset.basis import Even, Hats, Odd, One, Product, Wave


@pytest.mark.parametrize(
    "product",
    [
        Product(Hats("position", -1.0, 2.0, 9), One()),
        Product(Hats("position", -1.0, 2.0, 9), Odd("velocity", 0.3)),
        Product(Hats("position", -1.0, 2.0, 9), Even("velocity", 0.3)),
        Product(Wave("position", -1.0, 2.0, 5.0), Hats("velocity", -0.2, 0.2, 5)),
    ],
    ids=["hats", "odd", "even", "wave"],
)
def test_table_shows_the_map(product: Product) -> None:
    """Bilinear interpolation of the grid is the map itself (waves: nearly)."""
    rng = np.random.default_rng(14)
    coefficients = rng.standard_normal(product.count)
    x, y = rng.uniform(-1.0, 2.0, 200), rng.uniform(-0.2, 0.2, 200)
    index, value = product.evaluate(x, y)
    direct = np.sum(value * coefficients[index], axis=1)
    grid = product.grid(coefficients)
    one, two = product.first, product.second
    if grid.ndim == 1:
        shown = np.interp(x, np.linspace(one.lower, one.upper, len(grid)), grid)
    else:
        columns = [np.interp(x, np.linspace(one.lower, one.upper, len(grid)), c) for c in grid.T]
        nodes = np.linspace(two.lower, two.upper, grid.shape[1])
        shown = np.array([np.interp(b, nodes, row) for b, row in zip(y, np.transpose(columns), strict=True)])
    np.testing.assert_allclose(shown, direct, atol=0.05 if isinstance(one, Wave) else 1e-9)
