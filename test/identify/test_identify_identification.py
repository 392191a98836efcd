"""Known truths recovered, undetermined parameters named, uncertainty that holds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify_cases import INERTIA, LUGRE, PERIOD, SPEED, axis_of, recording, series, walked
from scipy.signal import butter, sosfilt, sosfilt_zi

from tcs_friction.conditioning.motion import FrictionSeries, prepare
from tcs_friction.config import load_axis
from tcs_friction.errors import InputError
from tcs_friction.identify.comparison import compare_laws
from tcs_friction.identify.identification import IdentifyOptions, identified_axis, identify
from tcs_friction.identify.operators import SwarmOptions
from tcs_friction.numerics.outcome import Outcome
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording

WRONG = {
    name: value * factor
    for (name, value), factor in zip(LUGRE.items(), (1.4, 0.8, 2.0, 0.5, 0.4, 3.0), strict=True)
}
OTHER_LAWS = {
    "coulomb_viscous": {"coulomb": 78.0, "viscous": 3000.0},
    "stribeck_static": {
        "coulomb": 78.0,
        "static": 117.0,
        "stribeck_velocity": 8e-4,
        "viscous": 3000.0,
        "exponent": 1.5,
    },
    "dahl_viscous": {"coulomb": 78.0, "stiffness": 3e5, "viscous": 3000.0},
    "bliman_sorine": {
        "coulomb": 78.0,
        "transient": 40.0,
        "presliding_distance": 1e-3,
        "ratio": 0.3,
        "viscous": 3000.0,
    },
}


def test_lugre_inertia_and_offset_from_a_wrong_belief() -> None:
    truth = axis_of()
    found = identify([recording(truth, offset=2.5)], axis_of(WRONG, inertia=1300.0))
    for name, value in LUGRE.items():
        tolerance = {"coulomb": 0.005, "static": 0.005, "stiffness": 0.03}.get(name, 0.1)
        assert found.parameters[name].determined
        assert found.parameters[name].value == pytest.approx(value, rel=tolerance)
        assert abs(found.parameters[name].value - value) < 5.0 * found.parameters[name].std + 0.01 * value
    assert found.inertia.value == pytest.approx(INERTIA, rel=0.05)
    assert found.offset.value == pytest.approx(2.5, abs=0.1)
    assert found.outcome is Outcome.CONVERGED
    for way in ("positive", "negative"):
        assert found.directions[way]["coulomb"].value == pytest.approx(78.1, rel=0.02)


def test_friction_against_speed_is_the_true_law_within_its_errors() -> None:
    truth = axis_of()
    recorded = recording(truth, seconds=96.0, offset=2.5, rate=250.0)
    found = identify([recorded], axis_of(WRONG, inertia=1300.0)).by_speed
    assert found is not None
    t = recorded.t
    amplitude = SPEED * PERIOD / (2.0 * np.pi)
    position = -amplitude * np.cos(2.0 * np.pi * t / PERIOD)
    velocity, friction = SPEED * np.sin(2.0 * np.pi * t / PERIOD), walked(truth.friction, t, position)
    slowing = ~found.speeding_up & (np.abs(found.speed) > 1e-4) & (np.abs(found.speed) < 0.98 * SPEED)
    for sign in (-1.0, 1.0):
        branch = (velocity * np.gradient(velocity) < 0.0) & (sign * velocity > 0.0) & (t > PERIOD)
        order = np.argsort(velocity[branch])
        bins = slowing & (sign * found.speed > 0.0)
        true = np.interp(found.speed[bins], velocity[branch][order], friction[branch][order])
        std = found.models["identified"].std
        assert std is not None
        assert bins.sum() > 7
        within = 4.0 * np.hypot(found.error, std)[bins] + 0.003 * np.abs(true)  # of a bin in which friction bends
        assert (np.abs(found.measured[bins] - true) < within).all()
        assert (np.abs(found.models["identified"].torque[bins] - true) < within).all()
    assert np.abs(found.residual("believed")).max() > 20.0


@pytest.mark.parametrize("law", OTHER_LAWS)
def test_the_other_laws(law: str) -> None:
    truth = axis_of(OTHER_LAWS[law], law)
    found = identify([recording(truth, seconds=24.0)], axis_of(WRONG), law=law)
    assert found.law == law
    assert found.rmse.held_out < 0.6
    if (
        law == "bliman_sorine"
    ):  # what settles slowly is told from Coulomb torque by the length of the legs alone
        assert found.parameters["coulomb"].value == pytest.approx(78.0, rel=0.1)
        return
    assert found.parameters["coulomb"].value == pytest.approx(78.0, rel=0.02)
    assert found.parameters["viscous"].value == pytest.approx(3000.0, rel=0.15)


def test_a_free_curve_is_found_from_any_belief() -> None:
    true = LUGRE | {"shape_1": 1.12, "shape_2": 1.05, "shape_3": 0.88}
    believed = LUGRE | {"coulomb": 60.0, "static": 70.0, "stribeck_velocity": 3e-3}
    data = [recording(axis_of(true, "free_curve"), seed=seed, period=period) for seed, period in enumerate((12.0, 17.0))]
    found = identify(data, axis_of(believed), law="free_curve")
    for name, value in true.items():
        one = found.parameters[name]
        assert one.determined, one.reason
        assert one.value == pytest.approx(value, abs=4.0 * one.std), name


def test_friction_series_of_an_observer() -> None:
    found = identify([series(axis_of(), seed=1)], axis_of(WRONG))
    assert found.parameters["coulomb"].value == pytest.approx(78.1, rel=0.01)
    assert found.parameters["static"].value == pytest.approx(117.2, rel=0.01)
    assert not found.inertia.determined
    assert found.inertia.reason == "friction estimates hold no inertia"


def test_the_observers_filter_is_part_of_the_model() -> None:
    """Friction that has passed a third-order Butterworth low pass, which lags: known, it does no harm."""
    raw = series(axis_of(), noise=0.2)
    sections = butter(3, 6.0, fs=500.0, output="sos")
    passed = sosfilt(sections, raw.friction, zi=sosfilt_zi(sections) * raw.friction[0])[0]
    known = identify([FrictionSeries(raw.t, raw.velocity, passed, bandwidth=6.0)], axis_of(WRONG))
    unknown = identify([FrictionSeries(raw.t, raw.velocity, passed)], axis_of(WRONG))
    assert known.parameters["stiffness"].value == pytest.approx(LUGRE["stiffness"], rel=0.03)
    assert known.parameters["static"].value == pytest.approx(LUGRE["static"], rel=0.01)
    assert abs(unknown.parameters["stiffness"].value / LUGRE["stiffness"] - 1.0) > 0.05
    assert known.rmse.train < unknown.rmse.train


def test_population_methods_know_the_observers_filter() -> None:
    """PSO-GA alone on friction behind a slow filter: near the truth with the filter known, far off without."""
    raw = series(axis_of(), noise=0.2)
    sections = butter(3, 6.0, fs=500.0, output="sos")
    passed = sosfilt(sections, raw.friction, zi=sosfilt_zi(sections) * raw.friction[0])[0]
    rows = []
    for bandwidth in (6.0, 0.0):
        data = FrictionSeries(raw.t, raw.velocity, passed, bandwidth=bandwidth)
        rows.append(identify([data], axis_of(), method="pso-ga").parameters["static"].value)
    assert rows[0] == pytest.approx(LUGRE["static"], rel=0.02)
    assert abs(rows[1] - LUGRE["static"]) > 2.0 * abs(rows[0] - LUGRE["static"])


def test_gaps_do_not_bend_the_result() -> None:
    whole = recording(axis_of())
    kept = np.ones(len(whole.t), dtype=bool)
    kept[4000:5500] = kept[9000:9400] = False
    cut = Recording(
        whole.t[kept],
        whole.position[kept],
        whole.torque[kept],
        segments=(slice(0, 4000), slice(4000, 7500), slice(7500, int(kept.sum()))),
    )
    found = identify([cut], axis_of(WRONG))
    assert found.parameters["static"].value == pytest.approx(117.2, rel=0.01)
    assert found.parameters["stiffness"].value == pytest.approx(2.96e5, rel=0.05)
    assert found.fit.bounds.tolist()[0] == 0
    assert len(found.fit.bounds) == 4


@pytest.mark.parametrize("start", [6.05, 6.25, 9.0])
def test_the_bristle_at_the_start_may_be_in_any_state(start: float) -> None:
    """Recordings that begin just after a reversal (bristle half way over), and in full motion."""
    whole = recording(axis_of())
    found = identify([whole.part(slice(int(start * 500.0), None))], axis_of(WRONG))
    assert found.parameters["static"].value == pytest.approx(117.2, rel=0.01)
    assert found.parameters["stiffness"].value == pytest.approx(2.96e5, rel=0.03)


def test_without_reversal_there_is_no_stiffness() -> None:
    t = 2e-3 * np.arange(4000)
    velocity = 2e-3 + 1.5e-3 * np.sin(0.7 * t)
    torque = 78.0 + 572.0 * velocity + 0.3 * np.random.default_rng(0).standard_normal(len(t))
    found = identify(
        [Recording(t, np.cumsum(velocity) * 2e-3, torque)],
        axis_of(),
        options=IdentifyOptions(hold_inertia=True),
    )
    for name in ("stiffness", "damping"):
        assert not found.parameters[name].determined
        assert found.parameters[name].reason == "the recording never reverses"
        assert found.parameters[name].value == LUGRE[name]  # as believed
    assert "never reverses" in str(found.offset.reason)
    assert not found.directions
    mapping = found.to_mapping()["parameters"]
    assert mapping["stiffness"] == {
        "value": None, "std": None, "unit": "N m/rad", "determined": False, "reason": "the recording never reverses",
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(2))
def test_without_a_drop_a_free_curve_has_no_shape(seed: int) -> None:
    """One-way motion over a factor of 2.3 in speed: LuGre's curve explains it, and so do many free ones."""
    t = np.arange(0.0, 20.0, 0.002)
    position = 0.05 * t + 0.02 * np.sin(t)
    axis = axis_of(LUGRE, "free_curve")
    torque = axis.inertia * np.gradient(np.gradient(position, t), t) + walked(axis.friction, t, position)
    noise = 0.3 * np.random.default_rng(seed).standard_normal(len(t))
    found = identify([Recording(t[500:], position[500:], (torque + noise)[500:])], axis_of(), law="free_curve")
    for name in ("static", "stribeck_velocity", "shape_1", "shape_2", "shape_3"):
        assert not found.parameters[name].determined, name
    assert [found.parameters[f"shape_{k}"].value for k in (1, 2, 3)] == [1.0] * 3, "LuGre's curve"
    assert found.parameters["shape_1"].reason == "lugre explains as much without it"


def test_too_fast_for_the_stribeck_velocity() -> None:
    """A hundred times faster: the drop is over within a sample of each reversal."""
    t = 2e-3 * np.arange(6000)
    position = -0.6 * np.cos(2.0 * np.pi * t / 12.0)
    velocity = np.gradient(position, t)
    torque = (
        78.0 * np.sign(velocity) + 572.0 * velocity + 0.3 * np.random.default_rng(0).standard_normal(len(t))
    )
    found = identify([Recording(t, position, torque)], axis_of(), options=IdentifyOptions(hold_inertia=True))
    assert not found.parameters["stribeck_velocity"].determined
    assert not found.parameters["static"].determined
    assert found.parameters["coulomb"].value == pytest.approx(78.0, rel=0.01)


def test_huber_shrugs_at_outliers() -> None:
    clean = recording(axis_of(), rate=200.0)
    torque = clean.torque.copy()
    torque[np.random.default_rng(4).integers(0, len(torque), 60)] += 400.0
    dirty = Recording(clean.t, clean.position, torque)
    plain = identify([dirty], axis_of())
    robust = identify([dirty], axis_of(), options=IdentifyOptions(loss="huber"))
    assert abs(robust.offset.value) < 0.5 * abs(plain.offset.value)
    assert robust.parameters["coulomb"].value == pytest.approx(78.1, rel=0.01)


def test_intervals_cover_the_truth() -> None:
    """Standard deviations against the scatter over eight noises of a log, which do not act on the axis.

    Known: predictions take such noise for torque that acts. Where they are not ruled out (two of the eight), stiffness is 1.4 %
    too large, and its interval of 0.3 % does not say so. Where the noise acts, test_identify_prediction asks for intervals.
    """
    truth = axis_of()
    scores = []
    for seed in range(8):
        found = identify([recording(truth, seconds=24.0, seed=seed, rate=250.0)], truth)
        for name in ("coulomb", "static"):
            item = found.parameters[name]
            scores.append((item.value - LUGRE[name]) / item.std)
        assert found.parameters["stiffness"].value == pytest.approx(LUGRE["stiffness"], rel=0.02)
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.6


@pytest.mark.parametrize("method", ["pso-ga", "pso", "ga"])
def test_population_methods_alone(method: str) -> None:
    options = IdentifyOptions(
        swarm=SwarmOptions(population=40, generations=2, swarm_generations=30, genetic_generations=15)
    )
    found = identify([series(axis_of(), seconds=12.0)], axis_of(WRONG), method=method, options=options)
    assert found.method == method
    assert found.rmse.train < 0.2 * float(np.std(found.fit.measured))
    assert found.history[-1] < 0.5 * found.history[0]
    assert (np.diff(found.history) <= 0.0).all()


def test_same_seed_same_numbers() -> None:
    record = recording(axis_of(), seconds=14.0)
    first, again = (identify([record], axis_of(WRONG), seed=3).to_mapping() for _ in range(2))
    for mapping in (first, again):
        mapping.pop("seconds")
    assert json.dumps(first) == json.dumps(again)


def test_cancelling_ends_it() -> None:
    found = identify([series(axis_of(), seconds=12.0)], axis_of(), method="pso-ga", cancel=lambda: True)
    assert found.outcome is Outcome.CANCELLED
    assert len(found.history) == 1


def test_cancelling_a_free_curve_ends_it_at_the_first_stribeck_velocity() -> None:
    found = identify([recording(axis_of(), seconds=12.0)], axis_of(), law="free_curve", cancel=lambda: True)
    assert found.outcome is Outcome.CANCELLED
    assert len(found.history) == 1


def test_believed_effects_are_taken_off_first() -> None:
    truth = axis_of()
    plain = recording(truth, seconds=24.0)
    biased = Recording(plain.t, plain.position, plain.torque + 7.0)
    believed = replace(truth, effects=(instance(effect("torque_bias"), {"bias": 5.0}),))
    found = identify([biased], believed)
    assert found.offset.value == pytest.approx(2.0, abs=0.1)
    result = identified_axis(believed, found)
    assert [item.values["bias"] for item in result.effects] == [pytest.approx(7.0, abs=0.1)]


def test_laws_are_compared_on_held_out_data() -> None:
    comparison = compare_laws(
        [recording(axis_of(), seconds=24.0, rate=250.0)],
        axis_of(WRONG),
        names=["coulomb_viscous", "lugre", "dahl_viscous"],
    )
    assert comparison.rows[0].law == "lugre"
    assert comparison.best.law == "lugre"
    held_out = [row.held_out for row in comparison.rows]
    assert held_out == sorted(held_out)


def test_a_law_with_many_valleys_is_searched_until_its_best_is_found_twice(shared_data: Path) -> None:
    """One search ends at 2.0 N m on this seed; once the drop is given up, so does the fit that starts from its Coulomb torque."""
    folder = shared_data / "data" / "bam_lift_and_drop_kp800"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    found = identify(
        read_recordings([folder / "recording"], file.signals), file.axis, law="maxwell_slip", seed=1
    )
    assert found.rmse.train < 0.65


def test_emps_within_one_percent_of_the_published(shared_data: Path) -> None:
    folder = shared_data / "data" / "emps"
    file = load_axis(folder / "axis.yaml")
    assert file.signals is not None
    found = identify(read_recordings([folder / "recording"], file.signals), file.axis)
    assert found.inertia.value == pytest.approx(95.109, rel=0.01)
    assert found.parameters["coulomb"].value == pytest.approx(20.394, rel=0.01)
    assert found.parameters["viscous"].value == pytest.approx(203.503, rel=0.01)
    assert found.offset.value == pytest.approx(-3.165, abs=0.1)
    assert 0.05 < found.inertia.std < 1.0
    assert found.inertia.unit == "kg"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda _: identify([], axis_of()), "no recordings"),
        (lambda r: identify([r], axis_of(), method="simplex"), "method"),
        (lambda r: identify([r], axis_of(), law="lugr"), "lugre"),
        (lambda r: identify([r, series(axis_of())], axis_of()), "one kind of data"),
        (lambda _: IdentifyOptions(loss="cubes"), "squares or huber"),
        (lambda _: IdentifyOptions(bandwidth=0.0), "bandwidth"),
        (lambda r: prepare([Recording(r.t[:20], r.position[:20], r.torque[:20])]), "too short"),
        (lambda r: identify([Recording(r.t, 0.0 * r.t, r.torque)], axis_of()), "never moves"),
        (lambda r: FrictionSeries(r.t, r.torque, r.torque[:-1]), "shape"),
        (lambda r: FrictionSeries(r.t, r.torque, np.nan * r.torque), "not finite"),
        (lambda r: FrictionSeries(r.t[::-1], r.torque, r.torque), "strictly increase"),
        (lambda r: FrictionSeries(r.t[:5], r.torque[:5], r.torque[:5]), "at least"),
        (lambda r: FrictionSeries(r.t, r.torque, r.torque, delay=-1.0), "delay"),
        (lambda r: FrictionSeries(r.t, r.torque, r.torque, bandwidth=400.0), "bandwidth"),
    ],
)
def test_misuse_is_named(call: object, message: str) -> None:
    plain = recording(axis_of(), seconds=2.0)
    with pytest.raises(InputError, match=message):
        call(plain)  # type: ignore[operator]


def test_velocity_and_acceleration_of_a_sinusoid() -> None:
    t = 1e-3 * np.arange(8000)
    noise = 1e-7 * np.random.default_rng(0).standard_normal(len(t))
    motion = prepare([Recording(t, 0.01 * np.sin(2.0 * t) + noise, np.cos(2.0 * t))])
    assert motion.velocity == pytest.approx(0.02 * np.cos(2.0 * motion.t), abs=1e-4)
    assert motion.acceleration == pytest.approx(-0.04 * np.sin(2.0 * motion.t), abs=4e-3)
    assert motion.torque == pytest.approx(np.cos(2.0 * motion.t), abs=1e-3)
    assert SPEED > 0.0
