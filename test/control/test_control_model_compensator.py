"""Everything that an axis model knows is cancelled: a simulated axis with an effect tracks as one without it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.config import Control, load_axis
from tcs_friction.control.compensator import CompensatorConfig, LugreCompensator, LugreParameters
from tcs_friction.control.handover import Handover
from tcs_friction.control.loop import Cancellation, LoopRun, simulate_loop
from tcs_friction.control.model_compensator import (
    CancellationConfig,
    ModelCompensator,
    check_drive,
    check_model,
    effect_names,
    obstacles,
)
from tcs_friction.control.position_correction import PositionCorrection
from tcs_friction.control.reference import Reference, load_reference
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import Instance, Place, Table, Term, instance, kernel

CONFIG = Path(__file__).resolve().parents[2] / "config"
DT = 1e-3
LUGRE = {"coulomb": 78.1, "static": 117.2, "stribeck_velocity": 6.1e-4, "stiffness": 2.96e5, "damping": 3.4e4, "viscous": 572.0}
BARE = Axis("azimuth", 1000.0, instance(law("lugre"), LUGRE))
ARCSEC = math.pi / 648000.0


def item(name: str, signal: str | None = None, **values: float) -> Instance:
    return instance(effect(name), values, signal=signal)


def control() -> Control:
    found = load_axis(CONFIG / "azimuth_1p2m.yaml").control
    assert found is not None
    return found


def tracked(axis: Axis, model: Axis, config: CancellationConfig | None = None, duration: float = 16.0) -> LoopRun:
    """The shipped run over its first reversal, cancelling what a model knows."""
    reference = load_reference(CONFIG / "azimuth_1p2m_run.yaml")
    loop = replace(control().loop, compensation="model", feed_back=False)
    cancellation = Cancellation(model, config or CancellationConfig())
    short = Reference(replace(reference.config, duration=duration))
    return simulate_loop(axis, short, control().controller, loop, cancellation=cancellation)


def error(run: LoopRun) -> float:
    """RMS of the true tracking error after 2 s, arcsec."""
    return float(np.sqrt(np.mean((run.reference - run.true_position)[2000:] ** 2))) / ARCSEC


CANCELLED = {
    "cogging": item("cogging", order=200.0, amplitude=20.0),
    "imbalance": item("imbalance", amplitude=60.0, phase=1.0),
    "coulomb_asymmetry": item("coulomb_asymmetry", asymmetry=0.2),
    "torque_bias": item("torque_bias", bias=30.0),
    "cable_wrap": item("cable_wrap", stiffness=5000.0),
    "cable_hysteresis": item("cable_hysteresis", amplitude=20.0, width=0.002),
    "viscous_asymmetry": item("viscous_asymmetry", asymmetry=3000.0),
    "quadratic_drag": item("quadratic_drag", coefficient=1e6),
    "position_dependent_friction": item("position_dependent_friction", order=100.0, amplitude=0.2),
    "local_friction_bump": item("local_friction_bump", amplitude=0.5, centre=0.0, width=0.005),
    "load_dependent_friction": item("load_dependent_friction", coefficient=0.2),
    "position_dependent_inertia": item("position_dependent_inertia", amplitude=0.5, phase=1.0),
    "flexible_mode": item("flexible_mode", frequency=8.0, inertia_ratio=0.3),
    "torque_ripple": item("torque_ripple", order=300.0, amplitude=0.15),
    "actuator_lag": item("actuator_lag", time_constant=0.003),
    "transport_delay": item("transport_delay", delay=0.002),
    "encoder_periodic_error": item("encoder_periodic_error", order=3000.0, amplitude=4e-7),
}

SEEN = {"cogging", "coulomb_asymmetry", "torque_ripple", "local_friction_bump", "encoder_periodic_error", "cable_hysteresis"}
"""Effects that this run's tracking error shows although the controller works against them."""


@pytest.fixture(scope="module")
def ideal() -> float:
    """Without any effect."""
    return error(tracked(BARE, BARE))


@pytest.mark.parametrize("name", CANCELLED)
def test_an_effect_that_is_known_costs_nothing(name: str, ideal: float) -> None:
    """Beside an axis that never had it; and unknown it costs, unless the feedback makes up for it."""
    axis = BARE.with_effect(CANCELLED[name])
    assert error(tracked(axis, axis)) < 1.1 * ideal
    if name in SEEN:
        assert error(tracked(axis, BARE)) > 1.4 * ideal
    left_out = CancellationConfig(left_out=(name,))
    assert error(tracked(axis, axis, left_out)) == pytest.approx(error(tracked(axis, BARE)), rel=1e-9)


def test_every_effect_of_the_vocabulary_is_cancelled_or_says_why_not() -> None:
    known = {"wind_torque", "exogenous", "cross_axis_coupling", "temperature_dependent_friction", "learned_map"}
    known |= {"presliding", "stribeck"}  # of a law without them
    hindered = {name for name, term in effects().items() if term.obstacle}
    assert hindered == {"backlash", "load_step", "periodic_vibration", "warmup_drift"}
    assert set(effects()) <= hindered | known | set(CANCELLED)


def test_the_law_alone_is_what_the_lugre_compensator_gives() -> None:
    parameters = LugreParameters(**LUGRE)
    lugre = LugreCompensator(CompensatorConfig(parameters, parameters, 2e-3), DT)
    model = ModelCompensator(replace(BARE, actuation_delay=2e-3), DT)
    for k in range(3000):
        t = DT * k
        speed, acceleration = 1e-3 * math.sin(3.0 * t), 3e-3 * math.cos(3.0 * t)
        torque = model.step(t, 0.0, speed, acceleration)
        assert torque == pytest.approx(lugre.step(speed, acceleration), rel=1e-9, abs=1e-9)


def test_an_effect_enters_and_leaves_slowly() -> None:
    axis = BARE.with_effect(item("torque_bias", bias=50.0))
    model = ModelCompensator(axis, DT, CancellationConfig(entry_time=0.1))
    assert model.step(0.0, 0.0, 0.0, 0.0) == pytest.approx(50.0), "it begins with all of it"
    model.configure(CancellationConfig(left_out=("torque_bias",), entry_time=0.1))
    leaving = [model.step(0.0, 0.0, 0.0, 0.0) for _ in range(120)]
    assert np.max(np.abs(np.diff([50.0, *leaving]))) == pytest.approx(0.5), "50 N m in 100 ticks"
    assert leaving[-1] == 0.0
    assert model.parts == {"torque_bias": 0.0}
    model.configure(CancellationConfig(entry_time=0.1))
    assert model.step(0.0, 0.0, 0.0, 0.0) == pytest.approx(0.5)


def test_another_share_of_all_comes_slowly_and_the_rest_band_is_of_friction_alone() -> None:
    axis = BARE.with_effect(item("torque_bias", bias=50.0))
    model = ModelCompensator(axis, DT, CancellationConfig(share=0.5, rest_speed=1e-3, rest_torque=3.0, entry_time=0.1))
    for _ in range(3000):
        moving = model.step(0.0, 0.0, 0.01, 0.0)
    assert moving == pytest.approx(0.5 * (50.0 + 78.1 + 5.72), rel=1e-6)
    assert model.step(0.0, 0.0, 0.0, 0.0) == pytest.approx(0.5 * 53.0), "of a bristle still bent"
    model.configure(CancellationConfig(rest_speed=1e-3, rest_torque=3.0, entry_time=0.1))
    coming = [model.step(0.0, 0.0, 0.0, 0.0) for _ in range(60)]
    assert np.max(np.diff(coming)) == pytest.approx(0.53)
    assert coming[-1] == pytest.approx(53.0)


def test_limits_hold_for_each_effect_and_for_all_of_them() -> None:
    axis = BARE.with_effect(item("torque_bias", bias=50.0)).with_effect(item("coulomb_asymmetry", asymmetry=0.5))
    model = ModelCompensator(axis, DT, CancellationConfig(effect_limit=10.0))
    for _ in range(5000):
        torque = model.step(0.0, 0.0, 0.01, 0.0)
    assert model.parts == {"torque_bias": 10.0, "coulomb_asymmetry": pytest.approx(10.0, rel=0.05)}
    assert torque == pytest.approx(10.0 + 10.0 + 78.1 + 5.72, rel=0.01)
    model.configure(CancellationConfig(total_limit=20.0))
    assert model.step(0.0, 0.0, 0.01, 0.0) == 20.0
    assert model.step(0.0, 0.0, -0.01, 0.0) >= -20.0


def test_what_is_not_measured_leaves_and_comes_back() -> None:
    warm = item("temperature_dependent_friction", dry=0.02)
    windy = item("wind_torque", "wind", coefficient=1.0)
    model = ModelCompensator(BARE.with_effect(warm).with_effect(windy), DT, CancellationConfig(entry_time=0.0), ("wind",))
    assert model.needs == {"temperature_dependent_friction": ("temperature",), "wind_torque": ("wind",)}

    def friction(temperature: float) -> float:
        return [model.step(0.0, 0.0, 0.01, 0.0, temperature) for _ in range(3000)][-1] - 5.72

    assert friction(30.0) == pytest.approx(1.2 * 78.1, rel=1e-3)
    model.without({"temperature_dependent_friction"})
    assert friction(30.0) == pytest.approx(78.1, rel=1e-3)
    model.without(())
    assert friction(40.0) == pytest.approx(1.4 * 78.1, rel=1e-3)


def test_effects_have_names_of_their_own() -> None:
    axis = BARE.with_effect(item("cogging", order=24.0, amplitude=1.0)).with_effect(item("cogging", order=72.0, amplitude=2.0))
    assert list(effect_names(axis)) == ["cogging", "cogging_2"]
    assert effect_names(axis)["cogging_2"].values["order"] == 72.0
    with pytest.raises(InputError, match="no effect 'coging'"):
        ModelCompensator(axis, DT, CancellationConfig(left_out=("coging",)))


def test_a_term_of_a_user_takes_part() -> None:
    @kernel
    def push(motion, parameters, state, dt):  # type: ignore[no-untyped-def]  # noqa: ARG001
        return parameters[0] * 2.0

    parameter = replace(effect("torque_bias").parameters[0], name="push")
    own = Term(id="own_push", place=Place.OPPOSING, form="x = 2 push", parameters=(parameter,), kernel=push, coordinate="torque")
    axis = BARE.with_effect(instance(own, {"push": 4.0}))
    assert ModelCompensator(axis, DT).step(0.0, 0.0, 0.0, 0.0) == pytest.approx(8.0)
    drive = replace(own, id="own_drive", place=Place.DRIVE)
    assert obstacles(BARE.with_effect(instance(drive, {"push": 4.0}))) == {"own_drive": "no inverse of it is known"}


def test_a_map_is_cancelled_unless_it_is_one_of_time() -> None:
    def mapped(coordinate: str) -> Axis:
        table = Table((coordinate,), (-1.0,), (1.0,), np.array([-5.0, 5.0]))
        return BARE.with_effect(instance(effect("learned_map"), {}, table=table))

    assert ModelCompensator(mapped("position"), DT).step(0.0, 0.5, 0.0, 0.0) == pytest.approx(2.5)
    assert ModelCompensator(mapped("time"), DT).step(0.5, 0.0, 0.0, 0.0) == 0.0
    assert "time" in obstacles(mapped("time"))["learned_map"]


def test_models_that_cannot_be_cancelled_are_refused() -> None:
    with pytest.raises(InputError, match="of a linear axis"):
        check_model(replace(BARE, kind="linear"), BARE)
    with pytest.raises(InputError, match="of another joint"):
        check_model(replace(BARE, name="altitude"), BARE)
    with pytest.raises(InputError, match="300 ms ahead"):
        ModelCompensator(BARE.with_effect(item("transport_delay", delay=0.2995)), DT)
    motion = np.array([[0.0, 0.0, 2.0]])
    with pytest.raises(InputError, match="takes 2100 N m, expected at most the drive's 1000 N m"):
        check_drive(np.array([100.0]), motion, BARE, 1000.0)
    axis = BARE.with_effect(item("imbalance", amplitude=2000.0, phase=0.5 * math.pi))
    with pytest.raises(InputError, match="at most the drive's"):
        tracked(axis, axis)
    assert ModelCompensator(axis, DT).largest() == pytest.approx(2000.0 + 117.2, rel=0.03)


def test_the_loop_says_what_it_needs() -> None:
    reference = load_reference(CONFIG / "azimuth_1p2m_run.yaml")
    loop = replace(control().loop, compensation="model")
    with pytest.raises(InputError, match="compensation is model without parameters"):
        simulate_loop(BARE, reference, control().controller, loop)
    windy = BARE.with_effect(item("wind_torque", "wind", coefficient=1.0))
    with pytest.raises(InputError, match="no recorded signal named 'wind'"):
        tracked(BARE, windy)


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_position_and_speed_are_those_behind_the_encoders_error(slope: float) -> None:
    amplitude = 1e-4 if slope == 0.0 else slope / 40.0
    correction = PositionCorrection(BARE.with_effect(item("encoder_periodic_error", order=40.0, amplitude=amplitude)), DT)
    speed = 1e-3
    for k in range(1000):
        true = speed * DT * k
        measured = true + amplitude * math.sin(40.0 * true)
        position, velocity = correction.step(measured, speed * (1.0 + 40.0 * amplitude * math.cos(40.0 * true)))
    assert abs(position - true) < 1.1 * amplitude * (40.0 * amplitude) ** 3, "each pass is nearer by the slope"
    assert velocity == pytest.approx(speed, rel=2.0 * (40.0 * amplitude) ** 3 + 1e-4)
    correction.configure(("encoder_periodic_error",), 0.0)
    assert correction.step(0.123, 0.1) == (0.123, 0.1)


def test_one_feed_forward_hands_over_to_another_without_a_step() -> None:
    begun: list[str] = []
    source = Handover(lambda *_: 10.0, lambda: None)
    source.replace(lambda *_: 50.0, lambda: None, 40.0)
    torques = [source.step(0.0) for _ in range(20)]
    source.replace(lambda *_: -30.0, lambda: None, 80.0)  # before the first one has taken over
    torques += [source.step(0.0) for _ in range(100)]
    assert torques[0] == pytest.approx(11.0)
    assert np.max(np.abs(np.diff(torques))) < 1.6
    assert torques[-1] == -30.0
    source.replace(lambda *_: 5.0, lambda: begun.append("new"), 80.0)
    source.reset()
    assert begun == ["new"]
    assert source.step(0.0) == 5.0, "at rest nothing is leaving"


def test_with_other_limits_it_goes_on_from_where_it_is() -> None:
    axis = BARE.with_effect(item("torque_bias", bias=50.0)).with_effect(item("imbalance", amplitude=5.0, phase=1.0))
    first = ModelCompensator(axis, DT, CancellationConfig(left_out=("imbalance",), entry_time=1.0))
    never = ModelCompensator(axis, DT, CancellationConfig(left_out=("imbalance",), entry_time=1.0))
    for model in (first, never):
        for k in range(50):
            model.step(DT * k, 0.0, 0.01, 0.0)
        model.configure(CancellationConfig(entry_time=1.0))
        for k in range(50, 80):
            model.step(DT * k, 0.0, 0.01, 0.0)
    other = first.continued(CancellationConfig(entry_time=1.0, effect_limit=40.0))
    assert other.step(0.08, 0.0, 0.01, 0.0) == pytest.approx(never.step(0.08, 0.0, 0.01, 0.0) - 10.0), "bristles and shares go on"
    assert first.config.effect_limit == 1e12
