"""The next experiment: a motion within reach, runnable as it is, that separates what the recording cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from open_loop_cases import axis, conditioned, item, recorded, scaled

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.control.reference import load_reference
from tcs_friction.diagnose.dataset.excitation import FASTER
from tcs_friction.diagnose.outcome.experiment import library, next_experiment, reference_text
from tcs_friction.physics.terms import Instance

PAIRS = [
    (item("transport_delay", delay=0.004), item("actuator_lag", time_constant=0.004)),
    (item("imbalance", amplitude=5.0, phase=0.3), item("cable_wrap", stiffness=5.0)),
]


@pytest.fixture(scope="module")
def data() -> DataSet:
    return conditioned(scaled(recorded(axis(), duration=20.0), position=4.0))


@pytest.mark.parametrize(("a", "b"), PAIRS, ids=lambda e: str(e.term.id))
def test_proposal_stays_within_reach_and_loads(
    data: DataSet, tmp_path: Path, a: Instance, b: Instance
) -> None:
    found = next_experiment(axis(), a, b, data)
    assert found is not None
    assert found["separates"] == [a.term.id, b.term.id]
    path = tmp_path / "next_experiment.yaml"
    path.write_text(reference_text(found), encoding="utf-8")
    reference = load_reference(path)
    samples = reference.over(np.linspace(0.0, reference.duration, 20000))
    position = data.joined("position")
    slack = 1e-3 * np.ptp(position)
    assert samples[:, 0].min() > position.min() - slack
    assert samples[:, 0].max() < position.max() + slack
    assert np.abs(samples[:, 1]).max() <= 1.02 * FASTER * np.abs(data.joined("velocity")).max()
    assert found["difference"] > 0.0


def test_same_effect_twice_cannot_be_separated(data: DataSet) -> None:
    a, b = item("torque_bias", bias=2.0), item("torque_bias", bias=3.0)
    assert next_experiment(axis(), a, b, data) is None


def test_differences_below_the_noise_are_not_proposed(data: DataSet) -> None:
    assert next_experiment(axis(), *PAIRS[0], data, noise_floor=1e6) is None


def test_timing_is_separated_by_a_fast_motion(data: DataSet) -> None:
    found = next_experiment(axis(), *PAIRS[0], data)
    assert found is not None
    assert "multisine" in found["why"]


def test_every_motion_of_the_library_says_what_it_is(data: DataSet) -> None:
    words = [text for _, text in library(data, axis())]
    assert len(words) == len(set(words)) >= 8
