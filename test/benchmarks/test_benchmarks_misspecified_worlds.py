"""Misspecified worlds: each kind simulates and differs from an ordinary axis as it says, and no name is right."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import misspecified_worlds
from benchmarks.concealed_motion import draw_environment
from benchmarks.concealed_physics import PERIOD, Encoder, Environment, Physics
from benchmarks.concealed_physics import simulate as simulate_concealed
from benchmarks.misspecified_worlds import KINDS, SUBSTEPS, names, ordinary, simulate, world
from benchmarks.trials import save_trial
from benchmarks.worlds import draw_axis
from tcs_friction.config import load_axis
from tcs_friction.recording.bags import read_recordings

SHORT = 0.1


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(misspecified_worlds, "STRETCH", SHORT)


def drawn() -> tuple[np.random.Generator, Environment, Physics]:
    """Without the slow sinusoid at the end, which takes half of the time."""
    rng = np.random.default_rng(4)
    whole = draw_environment(rng, SHORT)
    return rng, Environment(*(x[: len(x) - int(20.0 / PERIOD)] for x in whole)), draw_axis(rng)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_is_a_recording_of_which_nothing_may_be_named(kind: str) -> None:
    trial = world(f"{kind}-1", 0)
    assert trial.expected.effects == ()
    assert not trial.expected.outside
    assert not trial.expected.tolerated
    assert 1.0 < np.ptp(trial.recording.position) < 20.0


def test_without_its_faults_it_is_the_axis_of_the_concealed_worlds() -> None:
    """Written twice, integrated in two ways: the same motion but for what the encoder cannot see."""
    _, environment, physics = drawn()
    here = simulate(physics, environment, Encoder(), ordinary(environment), SUBSTEPS)
    there = simulate_concealed(physics, environment, Encoder(), 40)
    assert np.abs(here[:, 0] - there[:, 0]).max() < 2e-6
    assert np.sqrt(np.mean((here[:, 2] - there[:, 2]) ** 2)) < physics.torque_noise


@pytest.mark.parametrize(
    "kind", ["slip-elements", "wandering-friction", "clipping-drive", "sagging-constant"]
)
def test_half_the_step_changes_little(kind: str) -> None:
    """The motion far below the bristle's width, the torque below the noise."""
    rng, environment, physics = drawn()
    plant = KINDS[kind].plant(rng, physics, environment)
    coarse = simulate(physics, environment, Encoder(), plant, SUBSTEPS)
    fine = simulate(physics, environment, Encoder(), plant, 2 * SUBSTEPS)
    assert np.sqrt(np.mean((coarse[:, 0] - fine[:, 0]) ** 2)) < 1e-2 * physics.coulomb / physics.stiffness
    assert np.sqrt(np.mean((coarse[:, 2] - fine[:, 2]) ** 2)) < physics.torque_noise


def test_the_faults_are_there() -> None:
    rng, environment, physics = drawn()
    plain = simulate(physics, environment, Encoder(), ordinary(environment), SUBSTEPS)
    for kind in ("slip-elements", "wandering-friction", "clipping-drive", "sagging-constant"):
        plant = KINDS[kind].plant(rng, physics, environment)
        out = simulate(physics, environment, Encoder(), plant, SUBSTEPS)
        assert np.sqrt(np.mean((out[:, 2] - plain[:, 2]) ** 2)) > 2.0 * physics.torque_noise, kind


def test_samples_are_lost_or_repeated() -> None:
    lost, repeated = world("lost-samples-1").recording, world("repeated-samples-1").recording
    assert np.diff(lost.t).max() > 0.009
    assert 0.8 < len(lost) * 0.002 / lost.duration < 0.99
    same = np.mean(np.diff(repeated.position) == 0.0)
    assert same > 0.015
    assert np.allclose(np.diff(repeated.t), 0.002)


def test_a_recording_with_gaps_can_be_saved_and_read(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path)) / "world"
    trial = world("lost-samples-2")
    save_trial(trial, folder)
    (read,) = read_recordings([folder / "recording"], load_axis(folder / "axis.yaml").signals)
    assert np.array_equal(read.position, trial.recording.position)
    assert read.segments == trial.recording.segments
    assert len(read.segments) > 5


def test_names_can_be_asked_for_one_by_one() -> None:
    assert len(set(names())) == len(names()) == len(KINDS) * misspecified_worlds.EACH
