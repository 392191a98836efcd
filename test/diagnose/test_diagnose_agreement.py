"""What independent pieces of the data say of an effect: the same size again, and more than what is left."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import Motion, Torque, axis, conditioned, settled, unfitted

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.fit.noise_estimate import estimated, noise_floor
from tcs_friction.diagnose.outcome.agreement import (
    Agreement,
    _explained,
    _share_that_it_could_be,
    agreement_on,
    judged,
    multiples,
    random_effects,
    untimed,
)
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, instance


def test_the_interval_of_a_mean_over_scattering_pieces_covers_it() -> None:
    rng = np.random.default_rng(0)
    variances = np.array([0.01, 0.02, 0.05] * 4)
    covered = 0
    for _ in range(400):
        values = 1.0 + rng.normal(0.0, 0.3, 12) + rng.normal(0.0, np.sqrt(variances))
        mean, deviation, _ = random_effects(values, variances)
        covered += abs(mean - 1.0) < 2.2 * deviation  # Student's t of 11 degrees of freedom at 95 %
    assert 0.91 < covered / 400 < 0.985


def test_pieces_that_differ_by_noise_alone_are_weighted_by_it() -> None:
    values, variances = np.array([1.0, 1.0, 1.3]), np.array([0.01, 0.01, 100.0])
    mean, deviation, pieces = random_effects(values, variances)
    assert mean == pytest.approx(1.0, abs=1e-3)
    assert deviation == pytest.approx(math.sqrt(1.0 / 200.01), rel=1e-6)
    assert pieces == pytest.approx(2.0, abs=1e-3)


def test_pieces_in_which_an_effect_hardly_acts_are_no_replications() -> None:
    """A bump in three pieces of sixteen comes back three times: 85 % by Student's t of two degrees of freedom, not of fifteen."""
    rng = np.random.default_rng(0)
    values = np.concatenate([[0.8, 1.0, 1.2], rng.normal(0.0, 1e3, 13)])
    variances = np.concatenate([np.full(3, 0.01), np.full(13, 1e6)])
    _, _, pieces = random_effects(values, variances)
    assert pieces == pytest.approx(3.0, abs=1e-3)
    assert Agreement(1.0, 1.0 / 2.29, pieces, 1.0, 0.0).comes_back == pytest.approx(0.851, abs=2e-3)


def test_too_few_pieces_prove_nothing() -> None:
    assert random_effects(np.zeros(0), np.zeros(0)) == (0.0, math.inf, 0.0)
    alone = random_effects(np.array([1.0]), np.array([1e-4]))
    against = random_effects(np.array([1.0, -1.0]), np.array([1e-4, 1e-4]))
    alike = random_effects(np.array([1.0, 1.01]), np.array([1e-4, 1e-4]))
    none_held_out = random_effects(np.array([1.0, 1.01]), np.array([1e-4, 1e-4]), np.zeros(2, bool))
    again = [Agreement(*one, 1.0, 0.0).comes_back for one in (alone, against, none_held_out, alike)]
    assert again[:3] == [0.0, 0.0, 0.0]
    assert again[3] > 0.95


def test_the_best_of_many_effects_that_are_noise_does_not_come_back() -> None:
    """Its multiples of fitted pieces average one by the normal equations: they alone would name nine in ten."""
    rng, names = np.random.default_rng(1), {"held out": 0, "all": 0}
    pieces = np.repeat(np.arange(16), 40)
    held_out = np.isin(pieces, [1, 6, 9, 14])
    for _ in range(60):
        noise, effects = rng.standard_normal(len(pieces)), rng.standard_normal((300, len(pieces)))
        sizes = (effects * ~held_out) @ noise / np.sum((effects * ~held_out) ** 2, axis=1)
        best = int(np.argmax(np.abs(sizes)))
        values, variances, counted = multiples(pieces, held_out, *2 * (sizes[best] * effects[best],), noise)
        names["held out"] += Agreement(*random_effects(values, variances, counted), 1.0, 0.0).comes_back > 0.9
        names["all"] += Agreement(*random_effects(values, variances), 1.0, 0.0).comes_back > 0.9
    assert names["all"] > 30
    assert names["held out"] <= 7  # one in twenty by chance, of both signs: p < 1e-3 for more


def test_the_error_of_a_multiple_is_that_of_white_noise() -> None:
    """In pieces of data whose band ends below half the rate; half as much too large where it ends at two fifths of that."""
    wave, away = instance(effect("cogging"), {"order": 150.0, "amplitude": 2.0, "phase": -0.5 * math.pi}), []
    for seed in range(4):
        data = conditioned(np.random.default_rng(seed), lambda m: 2.0 * np.sin(150.0 * m.q), seconds=80.0)
        balance = TorqueBalance(replace(data, cutoff=20.0))
        noise = estimated(balance, axis().with_effect(wave), white_noise(balance.samples))
        known, weight = balance.train | balance.held_out, np.sqrt(noise.local_weight)
        base, after = (
            np.where(known, weight * noise.whitening.apply(balance.residual(one, noise), balance.samples), 0.0)
            for one in (axis(), axis().with_effect(wave))
        )
        values, variances, _ = multiples(balance.samples.pieces, balance.held_out, *2 * (base - after,), base)
        away.append((values - 1.0) / np.sqrt(variances))
    assert 0.8 < float(np.std(np.concatenate(away))) < 1.25


@pytest.mark.parametrize(
    ("multiple", "deviation", "explained", "lowest", "highest"),
    [
        (1.0, 0.01, 0.99, 0.99, 1.0),  # it comes back, and hardly anything is left
        (1.0, 0.01, 0.5, 0.49, 0.51),  # as much is left as it explains
        (0.3, 0.3, 0.99, 0.0, 0.7),  # it does not come back
        (-1.0, 0.1, 0.99, 0.0, 0.0),  # it comes back with the other sign
        (1.0, 0.01, 0.0, 0.0, 0.0),  # it explains nothing that was held out
    ],
)
def test_a_name_is_probable_if_the_effect_comes_back_and_outweighs_what_is_left(
    multiple: float, deviation: float, explained: float, lowest: float, highest: float
) -> None:
    assert lowest <= Agreement(multiple, deviation, 12, math.sqrt(explained), math.sqrt(1.0 - explained)).probability <= highest


def test_an_effect_that_is_there_agrees_and_one_that_is_not_does_not() -> None:
    balance, retuned = settled(conditioned(np.random.default_rng(3), lambda m: np.full(len(m.t), 4.0), seconds=80.0))
    bias = instance(effect("torque_bias"), {"bias": 4.0})
    there = unfitted(balance, axis().with_effect(bias), retuned.noise)
    known = agreement_on(balance, there, retuned, bias)
    assert known.multiple == pytest.approx(1.0, abs=4.0 * known.deviation + 0.02)
    assert known.probability > 0.95
    drag = instance(effect("quadratic_drag"), {"coefficient": 30.0})
    more = unfitted(balance, there.axis.with_effect(drag), retuned.noise)
    assert agreement_on(balance, more, there, drag).probability < 0.5


def test_what_fitted_data_leave_counts_beside_quiet_held_out_data() -> None:
    """A torque that comes and goes is in fitted pieces only: a constant one explains what is held out, and less of the rest."""

    def torque(m: Motion) -> np.ndarray:
        fitted = np.arange(len(m.t)) * 16 // len(m.t) % 4 != 2
        return 4.0 + 4.0 * fitted * np.sin(0.1 * m.t)

    bias = instance(effect("torque_bias"), {"bias": 4.0})
    assert explained(bias, lambda m: np.full(len(m.t), 4.0)) > 0.98
    assert explained(bias, torque) < 0.8


def test_an_event_in_held_out_data_is_not_judged_by_its_moment() -> None:
    """The axis is loaded in the midst of a held-out block; the train data put the moment anywhere in that block."""
    block = 80.0 / 16
    begins = 6.5 * block
    data = conditioned(np.random.default_rng(3), lambda m: 4.0 * (m.t >= begins), seconds=80.0)
    balance, retuned = settled(data)
    assert balance.held_out[np.searchsorted(data.joined("t"), begins)]
    late = instance(effect("load_step"), {"step": 4.0, "time": begins + 0.45 * block})
    known = agreement_on(balance, unfitted(balance, axis().with_effect(late), retuned.noise), retuned, late)
    assert known.explained > 0.98
    ((event, begin, end),) = untimed(balance, axis().with_effect(late))
    assert event.term.id == "load_step"
    assert 6.0 * block - 1.0 < begin < 6.0 * block + 0.1
    assert 7.0 * block - 0.1 < end < 7.0 * block + 1.0
    kept = judged(balance, axis().with_effect(late))
    t = data.joined("t")
    assert not kept[(t > begin) & (t < end)].any()
    assert np.array_equal(kept[(t < begin) | (t > end)], balance.held_out[(t < begin) | (t > end)])


def test_an_event_in_the_only_held_out_data_is_judged_there() -> None:
    """Names are not proven by data that were fitted."""
    data = conditioned(np.random.default_rng(3), seconds=80.0)
    (whole,) = data.stretches
    block = np.arange(len(whole.held_out)) * 16 // len(whole.held_out)
    balance = TorqueBalance(replace(data, stretches=(replace(whole, held_out=whole.held_out & (block == 6)),)))
    late = axis().with_effect(instance(effect("load_step"), {"step": 4.0, "time": 32.5}))
    assert len(untimed(balance, late)) == 1
    assert balance.held_out.any()
    assert np.array_equal(judged(balance, late), balance.held_out)


def test_an_event_between_fitted_samples_is_judged_everywhere() -> None:
    balance, _ = settled(conditioned(np.random.default_rng(3), seconds=80.0))
    timed = axis().with_effect(instance(effect("load_step"), {"step": 4.0, "time": 42.0}))
    assert untimed(balance, timed) == []
    assert np.array_equal(judged(balance, timed), balance.held_out)


def test_noise_of_the_acceleration_says_nothing_of_an_inertia() -> None:
    """It is in the torque of an effect on the inertia and in the residual, most of all where the axis hardly accelerates."""
    item = instance(effect("position_dependent_inertia"), {"amplitude": 0.2, "phase": 0.5})
    rng = np.random.default_rng(4)
    plain = conditioned(rng, seconds=160.0, speed=0.3)
    (stretch,) = plain.stretches
    angle = 2.0 * stretch.position + 0.5
    hidden = 180.0 * (np.cos(angle) * stretch.acceleration - np.sin(angle) * stretch.velocity**2)
    noisy = stretch.acceleration + 40.0 / 900.0 * rng.standard_normal(len(stretch.t))
    data = replace(plain, stretches=(replace(stretch, torque=stretch.torque + hidden, acceleration=noisy),))
    balance, retuned = settled(data)
    without = unfitted(balance, replace(axis(), inertia=1080.0), retuned.noise)
    known = agreement_on(balance, unfitted(balance, axis().with_effect(item), retuned.noise), without, item)
    assert known.multiple == pytest.approx(1.0, abs=0.015)


def test_what_little_held_out_data_have_by_chance_is_not_left() -> None:
    """Noise alone exceeds its usual power by some percent in so few samples: the share is that of an effect that explains all."""
    for seed in range(8):
        data = conditioned(np.random.default_rng(seed), lambda m: np.full(len(m.t), 0.12), seconds=40.0)
        balance, retuned = settled(data)
        bias = instance(effect("torque_bias"), {"bias": 0.12})
        residuals = [balance.residual(x, retuned.noise) for x in (axis(), axis().with_effect(bias))]
        floor = noise_floor(balance, residuals[1])
        gone, left = _explained(balance, *residuals, balance.held_out, 1.0, floor)
        assert gone**2 > 0.85 * (gone**2 + left**2), seed


def explained(item: Instance, torque: Torque) -> float:
    """The share that a torque of the right size explains beside another one that no model has."""
    balance, retuned = settled(conditioned(np.random.default_rng(5), torque, seconds=300.0))
    without = unfitted(balance, axis(), retuned.noise)
    return agreement_on(balance, unfitted(balance, axis().with_effect(item), retuned.noise), without, item).explained


def test_a_wave_is_a_part_of_what_is_left_around_its_order_only() -> None:
    """An eighth of what is left at most, since more of it has to be in a few lines to be around one order."""
    wave = instance(effect("cogging"), {"order": 20.0, "amplitude": 2.0, "phase": -0.5 * math.pi})
    in_time = explained(wave, lambda m: 2.0 * np.sin(20.0 * m.q) + 4.0 * np.sin(9.0 * m.t))
    beside = explained(wave, lambda m: 2.0 * np.sin(20.0 * m.q) + 4.0 * np.sin(22.0 * m.q))
    assert in_time > 0.9
    assert 0.5 < beside < 0.8, "4 / (4 + 16 / 8), but for what the two have in common"


def test_a_torque_of_the_position_is_a_part_of_what_depends_on_it_only() -> None:
    gravity = instance(effect("imbalance"), {"amplitude": 2.0, "phase": 0.5 * math.pi})
    in_time = explained(gravity, lambda m: 2.0 * np.cos(m.q) + 4.0 * np.sin(9.0 * m.t))
    of_the_position = explained(gravity, lambda m: 2.0 * np.cos(m.q) + 4.0 * np.sin(8.0 * m.q))
    assert in_time > 0.9
    assert of_the_position < 0.5


def test_friction_of_the_position_is_a_part_of_what_reverses_and_depends_on_it_only() -> None:
    values = {"amplitude": 0.2, "centre": 2.0, "width": 0.5}

    def bump(m: Motion) -> np.ndarray:
        return np.asarray(12.0 * np.exp(-(((m.q - 2.0) / 0.5) ** 2)) * np.sign(m.v))  # of 60 N m

    item = instance(effect("local_friction_bump"), values)
    in_time = explained(item, lambda m: bump(m) + 6.0 * np.sin(9.0 * m.t))
    elsewhere = explained(item, lambda m: bump(m) + 6.0 * np.sin(8.0 * m.q) * np.sign(m.v))
    assert in_time > 0.9
    assert elsewhere < 0.6


def test_a_constant_torque_is_a_part_of_what_changes_slowly_only() -> None:
    bias = instance(effect("torque_bias"), {"bias": 2.0})
    assert explained(bias, lambda m: 2.0 + 4.0 * np.sin(9.0 * m.t)) > 0.9
    assert explained(bias, lambda m: 2.0 + 4.0 * np.sin(0.1 * m.t)) < 0.5
    assert explained(bias, lambda m: 2.0 + 4.0 * np.sin(4.0 * m.q)) < 0.5


@pytest.mark.parametrize(
    ("item", "torque"),
    [
        (instance(effect("quadratic_drag"), {"coefficient": 10.0}), lambda m: 10.0 * m.v * np.abs(m.v)),
        (instance(effect("coulomb_asymmetry"), {"asymmetry": 0.2 / 60.0}), lambda m: np.full(len(m.v), 0.2)),
    ],
    ids=["drag", "asymmetry"],
)
def test_a_torque_of_the_velocity_is_a_part_of_what_depends_on_it_only(item: Instance, torque: Torque) -> None:
    """Unless more is left than noise: what a wrong friction law leaves does not depend on the velocity alone."""
    in_time = explained(item, lambda m: torque(m) + 0.4 * np.sin(9.0 * m.t))
    of_the_velocity = explained(item, lambda m: torque(m) + 0.4 * np.sin(100.0 * m.v))
    beside_more = explained(item, lambda m: torque(m) + 0.8 * np.sin(9.0 * m.t))
    assert in_time > 0.9
    assert of_the_velocity < 0.6
    assert beside_more < 0.3


def test_what_collisions_leave_is_theirs_unless_it_is_more_than_noise() -> None:
    data = conditioned(np.random.default_rng(3), seconds=80.0)
    balance, fit = settled(data)
    values = {"gap": 1e-3, "inertia_ratio": 0.2, "contact_frequency": 20.0, "contact_damping": 0.2}
    backlash = instance(effect("backlash"), values)
    left = np.random.default_rng(4).standard_normal(len(balance.train))
    assert _share_that_it_could_be(balance, fit.axis, backlash, left, floor=0.8) == 0.0
    assert _share_that_it_could_be(balance, fit.axis, backlash, left, floor=0.5) == 1.0
