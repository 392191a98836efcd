"""What effects leave: a map is taken only where it makes the residual smaller."""

from __future__ import annotations

import numpy as np
from concealed_torque_cases import conditioned, settled

from tcs_friction.diagnose.remainder.maps import Structure
from tcs_friction.diagnose.remainder.remainder import with_map
from tcs_friction.physics.terms import Table


def test_a_map_that_makes_it_worse_is_not_taken() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(12), lambda m: 2.0 * np.sin(3.0 * m.q)))
    q = balance.data.joined("position")
    grid = np.linspace(q.min(), q.max(), 200)
    for sign in (1.0, -1.0):
        table = Table(("position",), (float(q.min()),), (float(q.max()),), sign * 2.0 * np.sin(3.0 * grid))
        found = with_map(balance, fit, Structure(("position",), 0.0, 1.4, 1.0, None, table))
        assert (found is fit) == (sign < 0.0)
