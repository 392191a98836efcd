"""The atlas points at the coordinate a residual lives on, and at none when it is noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import Motion, Torque, axis, coloured, conditioned, settled
from scipy import stats

from tcs_friction.diagnose.outcome.atlas import AtlasEntry, atlas, time_since_reversal


def look(torque: Torque | None, seed: int = 1) -> dict[str, AtlasEntry]:
    balance, fit = settled(conditioned(np.random.default_rng(seed), torque))
    return {e.coordinate: e for e in atlas(balance, fit.noise, fit.axis, balance.residual(fit.axis, fit.noise))}


def test_covers_every_coordinate_that_was_recorded() -> None:
    assert set(look(None)) == {
        "time",
        "position",
        "velocity",
        "direction",
        "acceleration",
        "torque",
        "time_since_reversal",
        "temperature",
        "exogenous:wind_speed",
        "frequency",
    }


def test_noise_lives_nowhere() -> None:
    """p-values of coloured noise are uniform, shares nothing."""
    balance, fit = settled(conditioned(np.random.default_rng(2)))
    rng, found = np.random.default_rng(3), []
    for _ in range(25):
        found.append(atlas(balance, fit.noise, fit.axis, coloured(rng, len(balance.train))))
    for entries in zip(*found, strict=True):
        name, p_values = entries[0].coordinate, [e.p_value for e in entries]
        assert min(p_values) > 1e-4, name
        assert np.mean([e.share for e in entries]) < 0.02, name
        if name not in ("position", "frequency"):  # two looks each: conservative
            assert stats.kstest(p_values, "uniform").pvalue > 1e-4, name


def test_cogging_lives_on_position_with_its_period() -> None:
    entries = look(lambda m: 1.0 * np.cos(30.0 * m.q + 0.4))
    here = entries["position"]
    assert here.p_value < 1e-10
    assert here.period == pytest.approx(2.0 * np.pi / 30.0, rel=0.01)
    assert here.share == pytest.approx(0.5 / (0.5 + 0.09), abs=0.1)
    assert here.range is None
    assert here.unit == "rad"


def test_a_hill_has_a_range() -> None:
    here = look(lambda m: 2.0 * np.exp(-(((m.q - 1.0) / 0.2) ** 2)))["position"]
    assert here.p_value < 1e-10
    assert here.range is not None
    assert here.range[0] < 1.0 < here.range[1]
    assert here.range[1] - here.range[0] < 2.0
    assert 1.0 < np.max(here.mean) < 2.2


def test_a_step_lives_in_time() -> None:
    entries = look(lambda m: 2.0 * (m.t > 150.0))
    here = entries["time"]
    assert here.p_value < 1e-10
    assert here.share > 0.7
    assert here.share == max(e.share for e in entries.values() if e.coordinate != "frequency")


def test_asymmetry_lives_in_direction() -> None:
    here = look(lambda m: 1.0 * (m.v > 0))["direction"]
    assert here.p_value < 1e-10
    assert here.share > 0.4
    np.testing.assert_array_equal(here.x, [-1.0, 1.0])
    np.testing.assert_allclose(here.mean, 0.5, atol=0.1)  # the other half is retuned Coulomb friction


def test_vibration_lives_at_its_frequency() -> None:
    here = look(lambda m: 0.4 * np.sin(2 * np.pi * 7.3 * m.t))["frequency"]
    assert here.p_value < 1e-10
    assert here.period == pytest.approx(1.0 / 7.3, rel=1e-3)
    assert here.range is not None
    assert here.range[0] < 7.3 < here.range[1]


def test_several_recordings_have_their_lines_together() -> None:
    one = conditioned(np.random.default_rng(1), lambda m: 0.4 * np.sin(2 * np.pi * 7.3 * m.t))
    two = conditioned(np.random.default_rng(2), lambda m: 0.4 * np.sin(2 * np.pi * 7.3 * m.t + 2.0), seconds=200.0)
    balance, fit = settled(replace(one, stretches=(*one.stretches, *two.stretches)))
    here = atlas(balance, fit.noise, fit.axis, balance.residual(fit.axis, fit.noise))[-1]
    assert here.period == pytest.approx(1.0 / 7.3, rel=1e-3)
    assert here.share == pytest.approx(0.08 / (0.08 + 0.09), abs=0.1)


def test_a_band_of_lines_has_a_range() -> None:
    def torque(m: Motion) -> np.ndarray:
        return np.sum([0.2 * np.sin(2 * np.pi * f * m.t + f * f) for f in np.arange(6.0, 9.0, 0.1)], axis=0)

    here = look(torque)["frequency"]
    assert here.p_value < 1e-10
    assert here.share == pytest.approx(0.6 / (0.6 + 0.09), abs=0.1)
    assert here.period is None
    assert here.range is not None
    assert here.range[0] == pytest.approx(6.0, abs=1.0)
    assert here.range[1] == pytest.approx(8.9, abs=1.0)


def test_signal_lives_on_itself() -> None:
    rng = np.random.default_rng(5)
    data = conditioned(rng)
    (stretch,) = data.stretches
    stretch.torque[:] += 0.8 * (np.abs(stretch.signals[1]) - np.mean(np.abs(stretch.signals[1])))
    balance, fit = settled(data)
    entries = {e.coordinate: e for e in atlas(balance, fit.noise, fit.axis, balance.residual(fit.axis, fit.noise))}
    del entries["frequency"]  # the wind is slow
    best = max(entries.values(), key=lambda e: e.share)
    assert best.coordinate == "exogenous:wind_speed"
    assert best.p_value < 1e-10


def test_held_out_data_are_not_looked_at() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(6)))
    residual = balance.residual(fit.axis, fit.noise)
    changed = np.where(balance.data.train, residual, 1e3)
    found = [atlas(balance, fit.noise, fit.axis, x) for x in (residual, changed)]
    for one, two in zip(*found, strict=True):
        assert one.p_value == pytest.approx(two.p_value, rel=1e-9)  # spectra of all samples round
        np.testing.assert_array_equal(one.mean, two.mean)


def test_time_since_reversal_starts_anew_at_every_reversal() -> None:
    balance, _ = settled(conditioned(np.random.default_rng(7)))
    since = time_since_reversal(balance)
    velocity = balance.data.joined("velocity")
    turned = np.flatnonzero(np.sign(velocity[1:]) != np.sign(velocity[:-1])) + 1
    assert np.mean(since[turned] < 0.02) > 0.8  # a shorter turn than the velocity's noise is none
    assert since[turned[0] - 1] > 1.0


def test_short_data_have_no_atlas() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(8), seconds=5.0))
    assert atlas(balance, fit.noise, axis(), balance.residual(fit.axis, fit.noise)) == ()
