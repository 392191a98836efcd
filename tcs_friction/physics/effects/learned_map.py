"""A smooth table over one or two coordinates: stands in for physics that nobody has named yet."""

from __future__ import annotations

from typing import Any

from tcs_friction.physics.terms import Place, Term, kernel


@kernel
def torque(motion: Any, parameters: Any, state: Any, dt: float) -> float:
    """Bilinear between the nodes, constant outside. Parameters: slot, lower, upper, size of both coordinates, values."""
    n, m = int(parameters[3]), int(parameters[7])
    x = (motion[int(parameters[0])] - parameters[1]) / (parameters[2] - parameters[1]) * (n - 1)
    y = (motion[int(parameters[4])] - parameters[5]) / (parameters[6] - parameters[5]) * (m - 1)
    x, y = min(max(x, 0.0), n - 1.0), min(max(y, 0.0), m - 1.0)
    i, j = min(int(x), max(n - 2, 0)), min(int(y), max(m - 2, 0))
    fx, fy = x - i, y - j
    right, up = min(i + 1, n - 1), min(j + 1, m - 1)
    low = parameters[8 + i * m + j] * (1.0 - fx) + parameters[8 + right * m + j] * fx
    high = parameters[8 + i * m + up] * (1.0 - fx) + parameters[8 + right * m + up] * fx
    return float(low * (1.0 - fy) + high * fy)


TERM = Term(
    id="learned_map",
    place=Place.OPPOSING,
    form="x = table(one or two coordinates)",
    parameters=(),
    kernel=torque,
    reads=("torque",),
    tabulated=True,
    coordinate="position",
    subsystem="unknown",
)
