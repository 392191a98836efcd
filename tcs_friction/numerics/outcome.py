"""How a search for the least cost ended."""

from __future__ import annotations

import enum


class Outcome(enum.Enum):
    """How a search ended. A numerical outcome is data, not an error."""

    CONVERGED = "converged"
    STAGNATED = "stagnated"
    BUDGET_SPENT = "budget spent"
    CANCELLED = "cancelled"
    TOLERANCE = "cost tolerance reached"
    UNDEFINED = "cost or derivatives are not finite"
