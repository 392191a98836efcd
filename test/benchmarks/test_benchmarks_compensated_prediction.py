"""The benchmark of predicted compensation: the stand-in for a drive's noise is unbiased, and a run counts where it should."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.compensated_prediction import SETTLE, _rows, drive_noise, motion


def test_the_noise_of_a_drive_is_found_in_what_a_fit_leaves() -> None:
    random, rate, noise, bandwidth = np.random.default_rng(0), 100.0, 0.3, 8.0
    decay = math.exp(-2.0 * math.pi * bandwidth / rate)
    found, stds = [], []
    for _ in range(20):
        residual = lfilter([noise * math.sqrt(1.0 - decay**2)], [1.0, -decay], random.standard_normal(4000))
        fit: Any = SimpleNamespace(fit=SimpleNamespace(t=np.arange(4000) / rate, residual=residual))
        drive, std = drive_noise(fit)
        found.append(drive.noise)
        stds.append(std)
    assert np.mean(found) == pytest.approx(noise, rel=0.1)
    assert 0.3 < np.mean(stds) / np.std(found) < 3.0


def test_motions_are_longer_than_they_settle_and_begin_at_rest() -> None:
    for seed in range(6):
        reference = motion(np.random.default_rng(seed))
        assert reference.duration > 10.0 * SETTLE
        assert reference.at(0.0)[1] == pytest.approx(0.0, abs=1e-12)


def test_runs_are_counted_in_their_own_interval() -> None:
    stage: Any = SimpleNamespace(gain=0.1, gain_between=(0.09, 0.12), measured_gain=0.2, measured_gain_between=(0.1, 0.3))
    outcome: Any = SimpleNamespace(stage=stage, measured=np.array([[0.1, 0.4], [0.13, 0.2]]))
    for column, ratio in ((0, 1.15), (1, 1.5)):
        rows = {row["name"]: row["value"] for row in _rows([outcome], "error", column)}
        assert rows["runs in the 90 % interval, error"] == 0.5
        assert rows["measured gain over predicted, median, error"] == pytest.approx(ratio)
