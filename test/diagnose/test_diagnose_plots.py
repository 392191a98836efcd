"""The arrays behind a diagnosis: as long as each other, each effect by itself over its coordinate, who lost and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import axis, conditioned, settled, unfitted

from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit
from tcs_friction.diagnose.outcome.atlas import AtlasEntry
from tcs_friction.diagnose.outcome.plot_data import Evidence
from tcs_friction.diagnose.outcome.plots import CELLS, MOST_RUNNERS_UP, PLOTTED, evidence_of, where
from tcs_friction.diagnose.search.candidates import Candidate
from tcs_friction.diagnose.search.rivals import Contest
from tcs_friction.diagnose.search.start import Kind, Start
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import Instance, Table, instance

COGGING = instance(effect("cogging"), {"order": 30.0, "amplitude": 2.0, "phase": 0.0})
BIAS = instance(effect("torque_bias"), {"bias": 1.0})
VIBRATION = instance(effect("periodic_vibration"), {"frequency": 8.0, "amplitude": 1.0, "phase": 0.0})
BUMP = instance(effect("local_friction_bump"), {"amplitude": 0.3, "centre": 1.0, "width": 0.2})
WIND = instance(effect("wind_torque"), {"coefficient": 0.5}, signal="wind_speed")


@pytest.fixture(scope="module")
def fitted() -> tuple[TorqueBalance, Fit]:
    return settled(conditioned(np.random.default_rng(1), lambda m: 2.0 * np.cos(30.0 * m.q) + 1.0, seconds=100.0))


def drawn(
    fitted: tuple[TorqueBalance, Fit],
    *items: Instance,
    rounds: Sequence[Sequence[Candidate]] = (),
    contests: Sequence[Contest] = (),
    located: Sequence[AtlasEntry] = (),
) -> Evidence:
    """Evidence of the fit with these effects added."""
    balance, fit = fitted
    improved = unfitted(balance, replace(fit.axis, effects=items), fit.noise)
    axes = {"believed": axis(), "retuned": fit.axis, "improved": improved.axis}
    residuals = {name: balance.residual(x, fit.noise) for name, x in axes.items()}
    return evidence_of(balance, improved, rounds, contests, residuals, located, ("a note",))


def rival(fitted: tuple[TorqueBalance, Fit], gain: float, *items: Instance) -> Candidate:
    fit = fitted[1]
    own = replace(fit, axis=replace(fit.axis, effects=items))
    return Candidate(gain, 20.0, own, Start(items, gain, 1, 1.0, np.empty((0, 0))))


def test_residuals_are_thinned_and_as_long_as_each_other(fitted: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = fitted
    found = drawn(fitted, COGGING, BIAS)
    series = (found.t, found.believed, found.retuned, found.improved, found.held_out)
    assert {len(x) for x in series} == {len(found.t)}
    assert PLOTTED // 2 < len(found.t) < 2 * PLOTTED
    at = np.searchsorted(balance.data.joined("t"), found.t)
    assert (balance.train | balance.held_out)[at].all(), "without the ends of stretches"
    np.testing.assert_array_equal(found.held_out, balance.held_out[at])
    np.testing.assert_array_equal(found.retuned, balance.residual(fit.axis, fit.noise)[at])
    assert np.std(found.improved) < 0.5 * np.std(found.retuned)
    counted = balance.residual(fit.axis, fit.noise)[balance.train | balance.held_out]
    assert (found.retuned.min(), found.retuned.max()) == (counted.min(), counted.max()), "no peak is lost"
    assert (found.torque_unit, found.position_unit, found.notes) == ("N m", "rad", ("a note",))


def test_an_effect_by_itself_is_its_torque_and_what_all_leave(fitted: tuple[TorqueBalance, Fit]) -> None:
    found = drawn(fitted, COGGING, BIAS, WIND)
    wave, bias, wind = found.isolated
    balance, fit = fitted
    counted = np.flatnonzero(balance.train | balance.held_out)
    at = counted[:: max(1, len(counted) // PLOTTED)]
    left = balance.residual(replace(fit.axis, effects=(COGGING, BIAS, WIND)), fit.noise)
    for one in found.isolated:
        np.testing.assert_allclose(one.residual - one.fitted, left[at], atol=1e-9)
    np.testing.assert_allclose(bias.fitted, 1.0, atol=1e-4)
    data = balance.data
    speed = data.stretches[0].signals[1]
    expected = data.narrowed(0.5 * speed * np.abs(speed))  # as every torque is
    np.testing.assert_allclose(wind.fitted, expected[at], atol=1e-3)
    np.testing.assert_allclose(wave.fitted, 2.0 * np.cos(30.0 * wave.x), atol=0.1)
    assert [one.effect for one in found.isolated] == ["cogging", "torque_bias", "wind_torque"]
    assert (wind.coordinate, wind.unit) == ("exogenous:wind_speed", "")
    assert wave.title == "cogging, order 30 1/turn"
    assert bias.title == "torque bias"


def test_a_wave_is_drawn_over_one_period_where_there_are_many(fitted: tuple[TorqueBalance, Fit]) -> None:
    travel = float(np.ptp(fitted[0].data.joined("position")))
    many, few = (COGGING.again().replace(order=2.0 * np.pi * periods / travel) for periods in (5.0, 3.0))
    folded, whole = drawn(fitted, many, few).isolated
    assert folded.coordinate == "position_within_a_period"
    assert np.ptp(folded.x) <= travel / 5.0
    assert whole.coordinate == "position"
    assert np.ptp(whole.x) > 0.9 * travel


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        (COGGING, ("position", None, 2.0 * np.pi / 30.0, None)),
        (WIND, ("exogenous:wind_speed", None, None, None)),
        (instance(effect("load_step"), {"step": 1.0, "time": 7.0}), ("time", [7.0, None], None, None)),
        (VIBRATION, ("frequency", None, None, 8.0)),
        (BUMP, ("position", [0.8, 1.2], None, None)),
    ],
    ids=lambda x: x.term.id if isinstance(x, Instance) else "",
)
def test_where_an_effect_shows(item: Instance, expected: tuple[object, ...]) -> None:
    found = where(item, axis())
    assert tuple(found) == ("coordinate", "range", "period", "frequency")
    for value, wanted in zip(found.values(), expected, strict=True):
        assert value == (wanted if wanted is None or isinstance(wanted, str) else pytest.approx(wanted))


def test_an_order_of_a_linear_axis_is_per_metre() -> None:
    linear = replace(axis(), kind="linear")
    assert where(COGGING, linear)["period"] == pytest.approx(1.0 / 30.0)


def test_a_map_is_drawn_where_there_was_motion(fitted: tuple[TorqueBalance, Fit]) -> None:
    q, v = (fitted[0].data.joined(name) for name in ("position", "velocity"))
    lower, upper = (float(q.min()), float(v.min())), (float(q.max()) + float(np.ptp(q)), float(v.max()))
    table = Table(("position", "velocity"), lower, upper, np.zeros((4, 3)))
    found = drawn(fitted, BIAS, instance(effect("learned_map"), {}, table=table))
    assert found.learned is not None
    assert found.learned.coordinates == ("position", "velocity")
    assert found.learned.units == ("rad", "rad/s")
    assert found.learned.visited.shape == (CELLS, CELLS)
    assert found.learned.visited[: CELLS // 2].any(axis=1).all(), "every place that it passed"
    assert not found.learned.visited[CELLS // 2 + 1 :].any(), "it was never there"
    assert [one.effect for one in found.isolated] == ["torque_bias"], "a map is no effect"
    assert drawn(fitted, BIAS).learned is None


def test_curves_of_one_point_are_not_drawn(fitted: tuple[TorqueBalance, Fit]) -> None:
    def entry(count: int) -> AtlasEntry:
        x = np.arange(float(count))
        return AtlasEntry("time", "s", 1.0, 0.5, 0.25, None, None, x, 2.0 * x, 3.0 * x)

    (curve,) = drawn(fitted, located=[entry(1), entry(4)]).atlas
    assert (curve.coordinate, curve.unit, curve.share, curve.p_value) == ("time", "s", 0.25, 0.5)
    np.testing.assert_array_equal(curve.mean, 2.0 * curve.x)


def test_who_lost_is_told_once_with_the_reason(fitted: tuple[TorqueBalance, Fit]) -> None:
    """Rivals of what was found before candidates of the last round; what was found is no loser."""
    imbalance = instance(effect("imbalance"), {"amplitude": 1.0, "phase": 0.0})
    cable = instance(effect("cable_wrap"), {"stiffness": 1.0})
    lost = Contest(BIAS.identity, Kind("torque_bias"), fitted[1], 100.0, 10.0, (rival(fitted, 60.0, imbalance),))
    last = [
        rival(fitted, 70.0, imbalance.again()),
        rival(fitted, 5.0, WIND),
        rival(fitted, 30.0, cable, imbalance.again()),
        rival(fitted, 90.0, BIAS.again()),
    ]
    earlier = [rival(fitted, 80.0, instance(effect("load_step"), {"step": 1.0, "time": 7.0}))]
    found = drawn(fitted, BIAS, rounds=[earlier, last], contests=[lost]).runners_up
    assert [(one.effect, one.score) for one in found] == [
        ("imbalance", 60.0),
        ("cable_wrap and imbalance", 30.0),
        ("wind_torque from wind_speed", 5.0),
    ]
    assert "explains 60 of 100: 40 behind" in found[0].reason
    assert "may leave as much behind" in found[1].reason
    assert "chance and smoothing may give 20" in found[2].reason


def test_of_many_who_lost_the_best_are_told(fitted: tuple[TorqueBalance, Fit]) -> None:
    items = [instance(effect("exogenous"), {"linear": 1.0}, signal=f"signal_{k}") for k in range(MOST_RUNNERS_UP + 3)]
    found = drawn(fitted, BIAS, rounds=[[rival(fitted, float(k), item) for k, item in enumerate(items)]]).runners_up
    assert [one.score for one in found] == [float(k) for k in range(MOST_RUNNERS_UP + 2, 2, -1)]
