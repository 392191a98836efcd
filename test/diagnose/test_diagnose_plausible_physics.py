"""What each effect asks of a motion before it is believed: a world in which its name was false, and one in which it is right."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import Motion, axis, conditioned, selected, settled, unfitted

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose.dataset.excitation import period, turns
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.fit.joint_fit import Fit, settle
from tcs_friction.diagnose.fit.noise import white_noise
from tcs_friction.diagnose.search.harmonics import with_offsets_joined
from tcs_friction.diagnose.search.hypotheses import starts
from tcs_friction.diagnose.search.plausibility import Doubt, doubt
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.diagnose.search.start import Start
from tcs_friction.physics.registry import effect, effects, law
from tcs_friction.physics.terms import Instance, Survey, instance

STIFFNESS, REST = 6.0, 1.3  # N m/rad, rad
SECONDS = 100.0  # of a world that is fitted


def item(name: str, **values: float) -> Instance:
    return instance(effect(name), values)


def all_but(*names: str) -> frozenset[str]:
    return frozenset(effects()) - set(names)


def fitted_with(data: DataSet, *items: Instance) -> tuple[TorqueBalance, Fit]:
    """The believed axis with these effects, fitted."""
    balance = TorqueBalance(data)
    return balance, settle(balance, replace(axis(), effects=items), white_noise(balance.samples), rounds=1)


def doubted(data: DataSet, *items: Instance) -> Doubt | None:
    """Why the first of these effects is doubted when all of them are fitted."""
    balance, fit = fitted_with(data, *items)
    return doubt(balance, fit, fit.axis.effects[0], axis())


@pytest.fixture(scope="module")
def quiet() -> tuple[TorqueBalance, Fit]:
    """300 s to and fro, nothing concealed."""
    return settled(conditioned(np.random.default_rng(5)))


# A spring whose rest is not at zero


def spring(m: Motion) -> np.ndarray:
    return STIFFNESS * (m.q - REST) + 2.0 * (m.q - REST) ** 3


def test_a_spring_that_rests_elsewhere_is_a_cable_alone() -> None:
    balance = TorqueBalance(conditioned(np.random.default_rng(11), spring, SECONDS))
    (found,) = selected(balance, all_but("cable_wrap", "torque_bias", "imbalance", "coulomb_asymmetry")).found
    assert found.term.id == "cable_wrap"
    assert found.values["neutral"] == pytest.approx(REST, abs=0.05)
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.05)


def test_an_offset_beside_a_spring_is_its_neutral_place() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: STIFFNESS * (m.q - REST), SECONDS)
    balance, fit = fitted_with(data, item("cable_wrap", stiffness=STIFFNESS), item("torque_bias", bias=-STIFFNESS * REST))
    (joined,) = with_offsets_joined(balance, fit, axis()).axis.effects
    assert joined.values["neutral"] == pytest.approx(REST, abs=0.05)


def test_gravity_beside_a_spring_that_does_as_much_alone_is_its_neutral_place() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: STIFFNESS * (m.q - REST), SECONDS)
    balance, fit = fitted_with(data, item("cable_wrap", stiffness=0.5 * STIFFNESS), item("imbalance", amplitude=1.0, phase=1.0))
    (joined,) = with_offsets_joined(balance, fit, axis()).axis.effects
    assert joined.term.id == "cable_wrap"
    assert joined.values["neutral"] == pytest.approx(REST, abs=0.05)


def test_gravity_and_a_constant_torque_that_do_what_a_spring_does_are_one() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: STIFFNESS * (m.q - REST), SECONDS)
    balance, fit = fitted_with(data, item("imbalance", amplitude=1.0, phase=1.0), item("torque_bias", bias=-STIFFNESS * REST))
    (joined,) = with_offsets_joined(balance, fit, axis()).axis.effects
    assert joined.term.id == "cable_wrap"
    assert joined.values["neutral"] == pytest.approx(REST, abs=0.05)
    barred = with_offsets_joined(balance, fit, axis(), frozenset({"cable_wrap"}))
    assert [one.term.id for one in barred.axis.effects] == ["imbalance", "torque_bias"]


def test_gravity_and_a_constant_torque_that_are_there_stay() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: 30.0 * np.sin(m.q + 1.0) + 5.0, SECONDS)
    balance, fit = fitted_with(data, item("imbalance", amplitude=30.0, phase=1.0), item("torque_bias", bias=5.0))
    assert len(with_offsets_joined(balance, fit, axis()).axis.effects) == 2


def test_gravity_beside_a_constant_torque_is_no_spring_that_rests_out_of_reach() -> None:
    """What cannot be a spring would be dropped again, and gravity with it."""
    data = conditioned(np.random.default_rng(11), lambda m: 60.0 * np.sin(m.q + 0.7), SECONDS, speed=0.09)
    balance, fit = fitted_with(data, item("imbalance", amplitude=50.0, phase=0.7), item("torque_bias", bias=5.0))
    assert len(with_offsets_joined(balance, fit, axis()).axis.effects) == 2


def test_gravity_that_is_there_beside_a_spring_stays() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: STIFFNESS * m.q + 30.0 * np.sin(m.q + 1.0), SECONDS)
    balance, fit = fitted_with(data, item("cable_wrap", stiffness=STIFFNESS), item("imbalance", amplitude=30.0, phase=1.0))
    assert len(with_offsets_joined(balance, fit, axis()).axis.effects) == 2


def test_an_offset_that_a_hardening_spring_does_not_share_stays() -> None:
    """A cubic part says where the spring rests."""
    data = conditioned(np.random.default_rng(11), lambda m: STIFFNESS * (m.q - REST) + 4.0 * (m.q - REST) ** 3 + 3.0, SECONDS)
    resting = item("cable_wrap", stiffness=STIFFNESS, cubic=4.0, neutral=REST)
    balance, fit = fitted_with(data, resting, item("torque_bias", bias=3.0))
    assert len(with_offsets_joined(balance, fit, axis()).axis.effects) == 2


def test_a_spring_that_rests_out_of_reach_is_not_told_from_a_constant_torque() -> None:
    data = conditioned(np.random.default_rng(11), lambda m: 0.3 * (m.q + 30.0), SECONDS)
    cable = item("cable_wrap", stiffness=0.3, neutral=-30.0)
    assert doubted(data, cable) is Doubt.IMPLAUSIBLE


# What moves with the motion


def test_turns_and_the_period_of_a_motion() -> None:
    data = conditioned(np.random.default_rng(5), seconds=120.0, speed=0.1)
    found = turns(data, 0.0)
    assert len(found) == 24  # to and fro every 10 s
    assert period(data, axis()) == pytest.approx(10.0, abs=0.1)
    begin, end = found[0]
    assert 2.4 < begin <= end < 2.6
    bent = turns(data, 0.01)
    assert bent[0] == pytest.approx((begin, end + 0.3), abs=0.15)  # three times a hundredth of a radian at 0.1 rad/s
    assert len(bent) < 24  # every third time the motion is too short to bend them


def test_a_motion_that_never_turns_back_has_the_period_of_a_turn() -> None:
    data = conditioned(np.random.default_rng(5), seconds=60.0)
    (s,) = data.stretches
    rising = replace(data, stretches=(replace(s, position=s.t, velocity=np.ones(len(s.t))),))
    assert turns(rising, 0.0) == ()
    assert period(rising, axis()) == pytest.approx(2.0 * math.pi, rel=0.01)
    assert math.isinf(period(rising, replace(axis(), kind="linear")))


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("warmup_drift", {"dry": 0.2, "time_constant": 15.0}, Doubt.IMPLAUSIBLE),  # the motion comes back every 10 s
        ("warmup_drift", {"dry": 0.2, "time_constant": 60.0}, None),
        ("warmup_drift", {"dry": -0.2, "viscous": 0.1, "time_constant": 60.0}, Doubt.IMPLAUSIBLE),  # dry friction rises
        ("cable_hysteresis", {"amplitude": 4.0, "width": 3e-3}, Doubt.IMPLAUSIBLE),  # a bristle's
        ("cable_hysteresis", {"amplitude": 4.0, "width": 0.05}, None),
        ("cable_hysteresis", {"amplitude": -4.0, "width": 0.05}, Doubt.IMPLAUSIBLE),  # no cable pushes the axis on
        ("load_step", {"step": 2.0, "time": 150.0}, None),
        ("presliding", {"stiffness": 60.0 / 0.005}, None),
        ("presliding", {"stiffness": 60.0 / 0.04}, None),
        ("presliding", {"stiffness": 60.0 / 0.1}, Doubt.IMPLAUSIBLE),  # a fifth of the travel
        ("stribeck", {"drop": 50.0, "stribeck_velocity": 0.01}, None),
    ],
)
def test_what_a_motion_cannot_show_is_not_named(name: str, values: dict[str, float], expected: Doubt | None) -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5), speed=0.1))
    concealed = item(name, **values)
    assert doubt(balance, unfitted(balance, fit.axis.with_effect(concealed), fit.noise), concealed, fit.axis) is expected


@pytest.mark.parametrize(
    ("time", "expected"), [(25.0, None), (45.2, Doubt.IMPLAUSIBLE), (60.0, None), (78.76, Doubt.IMPLAUSIBLE)]
)
def test_what_begins_while_the_axis_turns_back_is_no_load_step(time: float, expected: Doubt | None) -> None:
    """The axis turns back at 45.2 s and at 78.8 s."""
    balance, fit = settled(conditioned(np.random.default_rng(5), seconds=100.0))
    step = item("load_step", step=4.0, time=time)
    assert [round(begin, 1) for begin, _ in turns(balance.data, 0.0)] == [45.2, 78.8]
    assert doubt(balance, unfitted(balance, fit.axis.with_effect(step), fit.noise), step, fit.axis) is expected


@pytest.mark.parametrize(("number", "expected"), [(0, Doubt.IMPLAUSIBLE), (1, None), (-1, Doubt.IMPLAUSIBLE)])
def test_a_step_at_a_turn_is_told_from_friction_where_others_come_before_and_after(number: int, expected: Doubt | None) -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5), seconds=150.0))
    begins = [begin for begin, _ in turns(balance.data, 0.0)]
    assert len(begins) > 2
    step = item("load_step", step=4.0, time=begins[number] + 0.01)
    assert doubt(balance, unfitted(balance, fit.axis.with_effect(step), fit.noise), step, fit.axis) is expected


@pytest.mark.parametrize(
    ("turns", "told"),
    [
        ([(10.0, 10.5), (20.0, 20.5), (30.0, 30.5)], True),
        ([(18.0, 19.0), (20.0, 20.5), (21.5, 22.5)], False),  # as much again belongs to each: it never slides between them
        ([(20.0, 20.5), (30.0, 30.5)], False),
    ],
)
def test_a_step_at_a_turn_is_told_where_the_axis_slides_both_ways_beside_it(turns: list[tuple[float, float]], told: bool) -> None:
    view = Survey((0.0, 1.0), 0.01, 0.1, 0.0, 40.0, 50.0, 1e-8, 900.0, 60.0, 0.0, turns=lambda _: turns)
    assert (effect("load_step").implausible({"step": 1.0, "time": 20.2}, view) == "") is told


@pytest.mark.parametrize(("contact", "told"), [(3.5, False), (12.0, True), (50.0, True)])
def test_a_contact_softer_than_its_gap_is_wide_is_no_backlash(contact: float, told: bool) -> None:
    """At 8 rad/s^2 it gives way by 17 mrad at 3.5 Hz, and by 1.4 mrad at 12 Hz."""
    view = Survey((0.0, 1.0), 0.01, 0.1, 0.0, 40.0, 50.0, 1e-8, 1.0, 0.6, 0.0, acceleration=8.0)
    values = {"gap": 4e-3, "inertia_ratio": 0.3, "contact_frequency": contact, "contact_damping": 0.2}
    assert (effect("backlash").implausible(values, view) == "") is told


def test_bristles_of_the_law_set_the_least_width_of_a_cable(quiet: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = quiet
    soft = instance(law("dahl_viscous"), {"coulomb": 60.0, "stiffness": 1500.0, "viscous": 500.0})
    cable = item("cable_hysteresis", amplitude=4.0, width=0.15)  # the bristles turn over within 0.04 rad
    bristly = replace(fit.axis, friction=soft)
    assert doubt(balance, unfitted(balance, bristly.with_effect(cable), fit.noise), cable, bristly) is Doubt.IMPLAUSIBLE
    wide = item("cable_hysteresis", amplitude=4.0, width=0.3)
    assert doubt(balance, unfitted(balance, bristly.with_effect(wide), fit.noise), wide, bristly) is None


# Energy


@pytest.mark.parametrize(("share", "expected"), [(-1.0, None), (0.5, None), (1.5, Doubt.ENERGY)])
def test_a_drag_that_feeds_energy_into_the_axis_is_none(share: float, expected: Doubt | None) -> None:
    """A negative drag bends friction down by this share of what the law has at twice the fastest speed."""
    data = conditioned(np.random.default_rng(8), seconds=SECONDS)
    fastest = 2.0 * float(np.abs(data.joined("velocity")).max())
    coefficient = -share * (60.0 + 500.0 * fastest) / fastest**2
    balance, fit = settled(data)
    bent = replace(fit.axis, effects=(item("quadratic_drag", coefficient=coefficient),))
    assert doubt(balance, unfitted(balance, bent, fit.noise), bent.effects[0], axis()) is expected


# Lines


def with_torque(data: DataSet, extra: Callable[[np.ndarray], np.ndarray]) -> DataSet:
    """The data with a line in torque and acceleration alike: motion."""
    (s,) = data.stretches
    wave = extra(s.t)
    return replace(data, stretches=(replace(s, torque=s.torque + 900.0 * wave, acceleration=s.acceleration + wave),))


@pytest.mark.parametrize(
    ("torque", "busy", "expected"),
    [
        (0.0, 0.0, None),
        (45.0, 0.0, Doubt.DRIVEN),
        (1.5, 0.0, Doubt.DRIVEN),
        (1.5, 10.0, None),  # an answer to the vibration and what the motion has at every frequency are as large
        (45.0, 10.0, Doubt.DRIVEN),
    ],
)
def test_a_line_of_the_motion_is_no_vibration(torque: float, busy: float, expected: Doubt | None) -> None:
    """Motion at 6 Hz with some N m of inertial torque, half a newton metre left there, N m rms of motion at all frequencies."""
    data = conditioned(np.random.default_rng(8), lambda m: 0.5 * np.sin(2.0 * np.pi * 6.0 * m.t), SECONDS)
    random = np.random.default_rng(9)

    def motion(t: np.ndarray) -> np.ndarray:
        return (torque * np.sin(2.0 * np.pi * 6.0 * t + 1.0) + busy * random.standard_normal(len(t))) / 900.0

    moved = with_torque(data, motion)
    assert doubted(moved, item("periodic_vibration", frequency=6.0, amplitude=0.5, phase=0.0)) is expected


@pytest.mark.parametrize(("wobble", "expected"), [(0.0, Doubt.STEADY), (0.5, None)])
def test_a_vibration_that_follows_the_position_may_be_a_wave_over_it(wobble: float, expected: Doubt | None) -> None:
    """At 0.3 rad/s a vibration of 1.5 Hz is a wave of 31.4 periods a turn. `wobble`: rad, amplitude of an uneven motion."""
    data = conditioned(np.random.default_rng(8), lambda m: 3.0 * np.sin(2.0 * np.pi * 1.5 * m.t), SECONDS)
    (s,) = data.stretches
    slow = 2.0 * np.pi * 0.1
    even = replace(
        s,
        position=0.3 * s.t + wobble * np.sin(slow * s.t),
        velocity=0.3 + wobble * slow * np.cos(slow * s.t),
        acceleration=-wobble * slow**2 * np.sin(slow * s.t),
    )
    changed = {name: getattr(even, name) - getattr(s, name) for name in ("acceleration", "velocity")}
    required = 900.0 * changed["acceleration"] + 60.0 * (1.0 - np.sign(s.velocity)) + 500.0 * changed["velocity"]
    moved = replace(data, stretches=(replace(even, torque=s.torque + required),))
    assert doubted(moved, item("periodic_vibration", frequency=1.5, amplitude=3.0, phase=0.0)) is expected


@pytest.mark.parametrize(("order", "expected"), [(7.0, None), (7.55, Doubt.NOT_WHOLE)])
@pytest.mark.parametrize("name", ["cogging", "torque_ripple"])
def test_an_order_that_does_not_close_with_the_turn_is_not_the_motors(name: str, order: float, expected: Doubt | None) -> None:
    data = conditioned(np.random.default_rng(9), lambda m: (name == "cogging") * 2.0 * np.cos(order * m.q), SECONDS)
    if name == "torque_ripple":
        (s,) = data.stretches
        data = replace(data, stretches=(replace(s, torque=s.torque / (1.0 + 0.05 * np.cos(order * s.position))),))
    size = {"cogging": 2.0, "torque_ripple": 0.05}[name]
    assert doubted(data, item(name, order=order, amplitude=size, phase=0.0)) is expected


def test_an_order_that_the_travel_hardly_passes_is_none(quiet: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = quiet
    once = 2.0 * math.pi / float(np.ptp(balance.data.joined("position")))
    for periods, expected in ((2.0, Doubt.NOT_RESOLVED), (8.0, None)):
        wave = item("cogging", order=periods * once, amplitude=2.0, phase=0.0)
        assert doubt(balance, unfitted(balance, fit.axis.with_effect(wave), fit.noise), wave, fit.axis) is expected


def test_a_vibration_of_few_periods_is_none(quiet: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = quiet
    once = 1.0 / float(np.ptp(balance.data.joined("t")))
    for periods, expected in ((4.7, Doubt.NOT_RESOLVED), (8.3, None)):
        wave = item("periodic_vibration", frequency=periods * once, amplitude=2.0, phase=0.0)
        assert doubt(balance, unfitted(balance, fit.axis.with_effect(wave), fit.noise), wave, fit.axis) is expected


def test_a_wave_that_the_encoder_does_not_sample_is_none(quiet: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = quiet
    wave = item("cogging", order=60.0, amplitude=2.0, phase=0.0)
    noisy = TorqueBalance(replace(balance.data, position_noise=0.06))
    for balance_, expected in ((balance, None), (noisy, Doubt.NOT_RESOLVED)):
        assert doubt(balance_, unfitted(balance_, fit.axis.with_effect(wave), fit.noise), wave, fit.axis) is expected


@pytest.mark.parametrize(("beside", "amplitude", "expected"), [(1.0, 0.8, Doubt.SIDE_LINE), (1.0, 1.8, None), (3.0, 0.8, None)])
def test_a_line_beside_another_is_its_changing_amplitude(
    quiet: tuple[TorqueBalance, Fit], beside: float, amplitude: float, expected: Doubt | None
) -> None:
    """`beside`: in periods over the travel. Unless it is too large for one, or too far away."""
    balance, fit = quiet
    once = 2.0 * math.pi / float(np.ptp(balance.data.joined("position")[balance.train]))
    strong = item("cogging", order=72.0, amplitude=2.0, phase=0.0)
    side = item("cogging", order=72.0 - beside * once, amplitude=amplitude, phase=0.0)
    base = fit.axis.with_effect(strong)
    assert doubt(balance, unfitted(balance, base.with_effect(side), fit.noise), side, base) is expected
    assert doubt(balance, unfitted(balance, base.with_effect(side), fit.noise), strong, base) is None


# Together


@pytest.mark.parametrize(("bias", "expected"), [(-20.0 * math.sin(1.2), Doubt.CANCELLED), (3.0, None)])
def test_torques_that_cancel_each_other_are_not_named_each(bias: float, expected: Doubt | None) -> None:
    """Gravity about a place where it hardly changes, and a constant torque against it: 19 N m each for less than 1 N m."""
    data = conditioned(np.random.default_rng(12), seconds=120.0, speed=0.02)
    balance, fit = settled(data)
    gravity = item("imbalance", amplitude=20.0, phase=1.2)
    both = fit.axis.with_effect(gravity).with_effect(item("torque_bias", bias=bias))
    for chosen in both.effects:
        assert doubt(balance, unfitted(balance, both, fit.noise), chosen, fit.axis) is expected


def test_nothing_that_filters_is_named_beside_collisions(quiet: tuple[TorqueBalance, Fit]) -> None:
    balance, fit = quiet
    mode = item("flexible_mode", frequency=12.0, damping=0.05, inertia_ratio=0.3)
    knocking = item("backlash", gap=1e-3, inertia_ratio=0.2)
    alone, beside = fit.axis.with_effect(mode), fit.axis.with_effect(mode).with_effect(knocking)
    assert doubt(balance, unfitted(balance, alone, fit.noise), mode, fit.axis) is None
    assert doubt(balance, unfitted(balance, beside, fit.noise), mode, fit.axis) is Doubt.COLLISIONS


def uneven(m: Motion) -> np.ndarray:
    """Friction that differs by 0.3 N m from place to place, over a tenth of a radian."""
    rng = np.random.default_rng(3)
    return np.sign(m.v) * np.interp(m.q, np.arange(-1.0, 6.0, 0.1), 0.3 * rng.standard_normal(70))


def bump(m: Motion) -> np.ndarray:
    return np.sign(m.v) * 3.0 * np.exp(-(((m.q - 2.0) / 0.1) ** 2))


def test_a_bump_stands_out_of_what_other_places_differ_by() -> None:
    term = effect("local_friction_bump")

    def best(concealed: Callable[[Motion], np.ndarray]) -> Start:
        projected = ProjectedResidual(*settled(conditioned(np.random.default_rng(5), concealed, SECONDS)))
        return starts(projected, term, None)[0]

    plain, rough, both = best(bump), best(uneven), best(lambda m: bump(m) + uneven(m))
    print([(one.gain, one.noise_excess, dict(one.instance.values)) for one in (plain, rough, both)])
    assert plain.promise > 500.0
    assert rough.gain > 50.0
    assert rough.promise < 25.0  # chance
    assert both.noise_excess > 3.0
    assert both.promise > 100.0
    assert both.instance.values["centre"] == pytest.approx(2.0, abs=0.05)
