"""The simulate benchmark compares like with like: the same motion, by ours and by scipy."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from benchmarks import simulate
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance


def test_scipy_s_right_hand_side_is_the_same_axis() -> None:
    axis = Axis("azimuth", simulate.INERTIA, instance(law("lugre"), simulate.LUGRE))
    held = simulate.smooth_torque(simulate.TICK * np.arange(300))
    ours = simulate._simulate(axis, held, simulate.TICK)[:, 0]
    ends = simulate.TICK * np.arange(1, 301)
    truth = simulate._scipy(held, "DOP853", 1e-11, ends, restart=True)
    assert np.max(np.abs(ours - truth)) < 1e-4 * np.max(np.abs(truth))


def test_rows_say_what_was_compared() -> None:
    parser = argparse.ArgumentParser()
    simulate.add_arguments(parser)
    rows = simulate.run(parser.parse_args(["--seconds", "0.1"]))
    assert all({"name", "value", "unit"} <= set(row) for row in rows)
    ratios = [row["ratio"] for row in rows if row.get("unit") == "s"]
    assert len(ratios) == 2
    assert rows[1]["value"] == pytest.approx(0.0, abs=1e-6)
