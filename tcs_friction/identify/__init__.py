"""Identification: friction laws, inertia and plant from recordings."""

from __future__ import annotations

import os

# Threads that wait for work sleep instead of spinning: the machine's other cores may belong to control loops. The library that
# runs numba's parallel loops reads this when the first of them is called.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
