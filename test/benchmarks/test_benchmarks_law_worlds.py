"""Law worlds: every pair is there, what a belief lacks follows from the laws, and a world is what its name says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import law_worlds
from benchmarks.concealed_floor import attainable
from benchmarks.law_worlds import CONTAINS, expected, names, world
from tcs_friction.physics.registry import effects, laws


def test_every_pair_of_laws_is_a_world() -> None:
    assert len(names()) == 2 * len(laws()) ** 2
    assert set(CONTAINS) == set(laws())


@pytest.mark.parametrize(
    ("believed", "true", "lacks", "tolerated"),
    [
        ("lugre", "lugre", set(), set()),
        ("lugre", "dahl_viscous", set(), set()),
        ("lugre", "coulomb_viscous", set(), set()),
        ("dahl_viscous", "lugre", {"stribeck"}, {"presliding"}),
        ("coulomb_viscous", "lugre", {"stribeck", "presliding"}, set()),
        ("stribeck_static", "lugre", {"presliding"}, {"stribeck"}),
        ("stribeck_static", "bam", {"load_dependent_friction"}, {"stribeck"}),
        ("lugre", "maxwell_slip", set(), {"stribeck", "presliding"}),
        ("dahl_viscous", "bliman_sorine", set(), {"stribeck", "presliding"}),
    ],
)
def test_what_a_belief_lacks(believed: str, true: str, lacks: set[str], tolerated: set[str]) -> None:
    found = expected(believed, true, (), 0.3)
    assert {ids[0] for ids in found.effects} == lacks
    assert set(found.tolerated) == tolerated
    assert not found.outside


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law_worlds, "STRETCH", 0.15)


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("true", sorted(laws()))
def test_an_axis_of_every_law_follows_its_reference(true: str) -> None:
    trial = world(f"coulomb_viscous-for-{true}-and-effect", 3)
    speed = trial.recording.velocity
    assert speed is not None
    assert 5.0 < np.ptp(trial.recording.position) < 8.0  # a turn of 5.8 to 6.9 rad
    assert speed.max() > 0.03
    assert speed.min() < -0.03
    assert trial.believed.axis.friction.term.id == "coulomb_viscous"
    concealed = set(trial.details["effect_parameters"])
    assert len(concealed) == 1
    assert concealed <= {ids[0] for ids in trial.expected.effects} <= set(effects())


@pytest.mark.usefixtures("short")
def test_a_world_is_made_by_its_name_and_seed_alone() -> None:
    one, two = world("dahl_viscous-for-lugre", 1), world("dahl_viscous-for-lugre", 1)
    assert np.array_equal(one.recording.torque, two.recording.torque)
    assert one.believed.axis == two.believed.axis
    other = world("dahl_viscous-for-lugre", 2)
    assert other.believed.axis.inertia != one.believed.axis.inertia


@pytest.mark.usefixtures("short")
def test_the_belief_is_off_by_less_than_a_tenth() -> None:
    trial = world("lugre-for-lugre", 5)
    believed, true = trial.believed.axis, trial.details
    assert believed.inertia / true["inertia"] == pytest.approx(1.0, abs=0.1)
    assert believed.inertia != true["inertia"]
    for name, value in true["friction"].items():
        assert believed.friction.values[name] / value == pytest.approx(1.0, abs=0.11), name


@pytest.mark.usefixtures("short")
def test_the_floor_is_above_the_torque_noise_and_a_wrong_law_stays_above_it() -> None:
    """The encoder's noise is in it, and no fit of a law without the drop reaches it."""
    trial = world("dahl_viscous-for-lugre", 1)
    believed = trial.believed.axis
    assert trial.true is not None
    floor = attainable(trial.recording, believed, trial.true)
    assert trial.expected.noise_floor < floor < 10.0 * trial.expected.noise_floor
    assert attainable(trial.recording, believed, believed) > 1.2 * floor
