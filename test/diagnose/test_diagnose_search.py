"""What makes the search quick: maps over all cores, filters found by their spectra, torques that are not remembered."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_loop_cases import telescope
from scipy import ndimage
from structure_cases import DT, Motion, axis, conditioned, settled

from tcs_friction.config import load_axis
from tcs_friction.control.loop import simulate_loop
from tcs_friction.control.reference import Reference, Sinusoid
from tcs_friction.diagnose import parallel
from tcs_friction.diagnose.dataset.preprocessing import Conditioned, condition
from tcs_friction.diagnose.fit.balance import Balance, Fit
from tcs_friction.diagnose.fit.joint_fit import joined, settle
from tcs_friction.diagnose.fit.torque import Memory, Parts
from tcs_friction.diagnose.search.candidates import _driven_gain, implausible
from tcs_friction.diagnose.search.hypotheses import gain_by_motion, starts
from tcs_friction.diagnose.search.matched_filter import same_wave, spectrum
from tcs_friction.diagnose.search.projection import Background, probe, survey
from tcs_friction.physics import machine
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import Place, Term, instance
from tcs_friction.recording.recording import Recording

FILTERS = [term for term in effects().values() if term.transfer is not None]
VALUES = {
    "actuator_lag": {"time_constant": 0.02},
    "transport_delay": {"delay": 0.013},
    "flexible_mode": {"frequency": 9.0, "damping": 0.05, "inertia_ratio": 0.3},
}


def test_a_map_keeps_its_order_and_runs_on_several_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=10.0)

    def work(x: int) -> int:
        together.wait()
        return x * x

    assert parallel.side_by_side(work, range(4)) == [0, 1, 4, 9]


def test_a_thread_without_work_helps_in_a_map_within_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=10.0)

    def inner(x: int) -> int:
        together.wait()
        return x + 1

    def outer(x: int) -> list[int]:
        return parallel.side_by_side(inner, range(4)) if x == 1 else []

    assert parallel.side_by_side(outer, range(2)) == [[], [1, 2, 3, 4]]


@pytest.mark.parametrize("place", range(4))
def test_an_error_in_a_map_is_the_caller_s(place: int) -> None:
    with pytest.raises(ZeroDivisionError):
        parallel.side_by_side(lambda x: 1 // (x - place), range(4))
    assert parallel.side_by_side(lambda x: x, range(3)) == [0, 1, 2]


def test_what_is_not_to_be_remembered_is_made_again() -> None:
    memory, made = Memory(100.0), []

    def make() -> tuple[np.ndarray, ...]:
        made.append(1)
        return (np.zeros(5),)

    for remember, total in ((False, 1), (False, 2), (True, 3), (True, 3), (False, 3)):
        memory.get("key", make, remember)
        assert len(made) == total
    assert memory.held == 40


@pytest.mark.parametrize("term", FILTERS, ids=lambda term: term.id)
def test_a_transfer_is_what_the_kernel_does(term: Term) -> None:
    """At 3 Hz: the amplitude that the kernel adds, once its transient is over."""
    step, frequency = 1e-4, 3.0
    t = np.arange(0.0, 4.0, step)
    w = 2.0 * math.pi * frequency
    wave = np.sin(w * t)
    item = instance(term, VALUES[term.id])
    plain = axis()
    motion, out = np.stack([-np.cos(w * t) / w**2, -np.cos(w * t) / w, wave]), np.empty(len(t))
    if term.place is Place.BODY:
        motion[0], motion[1] = -wave / w**2, -np.cos(w * t) / w
    built = machine.build(plain, step, terms=[item])
    signals = np.full((1, len(t)), 20.0)
    if term.place is Place.DRIVE:
        machine.evaluate_drive(built, t, 0.0 * motion, wave, signals, out)
        out -= wave
    else:
        machine.evaluate_demand(built, t, motion, wave, signals, 1e-6, out)
        out /= plain.inertia
    late = t > 2.0
    got = 2.0 * np.mean(out[late] * np.exp(-1j * w * t[late])) * 1j
    assert term.transfer is not None
    assert got == pytest.approx(complex(term.transfer(item.values, np.array([1j * w]))[0]), abs=2e-3)


def test_lean_loops_agree_with_the_full_one() -> None:
    data = conditioned(np.random.default_rng(1), seconds=20.0)
    s = data.stretches[0]
    full = axis().with_effect(instance(effect("actuator_lag"), {"time_constant": 0.05}))
    full = full.with_effect(instance(effect("flexible_mode"), VALUES["flexible_mode"]))
    motion, out = np.stack([s.position, s.velocity, s.acceleration]), np.empty((len(s.t), 8))

    def built(places: set[Place]) -> machine.Machine:
        terms = [item for item in full.terms if item.term.place in places]
        return machine.build(full, DT, signals=data.names, position=float(s.position[0]), terms=terms)

    everything = built(set(Place))
    machine.evaluate(everything, s.t, *motion, s.torque, s.signals, 1e-6, out)
    rotor, demand = np.empty(len(s.t)), np.empty(len(s.t))
    machine.evaluate_drive(built({Place.DRIVE}), s.t, motion, s.torque, s.signals, rotor)
    machine.evaluate_demand(built({Place.LAW, Place.BODY}), s.t, motion, rotor, s.signals, 1e-6, demand)
    assert rotor == pytest.approx(out[:, machine.ROTOR])
    assert demand + full.inertia * s.acceleration == pytest.approx(out[:, machine.REQUIRED])


def test_a_body_s_column_by_its_transfer_is_that_of_the_kernel() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(2)))
    background = Background(balance, fit.axis, fit.free)
    slow = {"frequency": 3.0}  # a mode that this slow motion wakes
    item = instance(effect("flexible_mode"), VALUES["flexible_mode"] | slow)
    columns = (background.column(item), background.swung(item))
    exact, quick = (ndimage.uniform_filter1d(x, 20)[2000:-2000] for x in columns)
    assert np.std(quick - exact) < 0.05 * np.std(exact)


@pytest.mark.parametrize("name", ["transport_delay", "actuator_lag"])
def test_a_filter_of_the_drive_is_exact_between_samples(name: str) -> None:
    """A torque as fast as any that is compared: on the line between two samples its peaks would be cut."""
    data = conditioned(np.random.default_rng(2))
    w = 2.0 * math.pi * 0.9 * data.cutoff
    stretches = tuple(replace(s, torque=np.sin(w * s.t)) for s in data.stretches)
    data = replace(data, stretches=stretches)
    value = {"transport_delay": "delay", "actuator_lag": "time_constant"}[name]
    item = instance(effect(name), {value: 0.5 * data.dt / data.stride})
    assert item.term.transfer is not None
    response = 1.0 + item.term.transfer(item.values, np.array([1j * w]))[0]
    expected = data.narrowed(np.imag(response * np.exp(1j * w * data.stretches[0].t)))
    rotor, _ = Parts(data).rotor(axis().with_effect(item))
    inside = slice(500, -500)
    assert rotor[inside] == pytest.approx(expected[inside], abs=2e-3)


def test_a_wave_is_found_at_its_order_and_not_at_one_that_samples_pretend() -> None:
    """At one speed a wave of which whole periods are passed from sample to sample looks the same."""
    order, speed = 40.0, 0.15
    data = conditioned(np.random.default_rng(5), lambda m: 2.0 * np.cos(order * m.q), speed=speed)
    pretended = order + 2.0 * math.pi / (speed * DT)
    balance, fit = settled(data)
    background = Background(balance, fit.axis, fit.free)
    grid, gain, _ = spectrum(background, effect("cogging"), survey(balance, fit.axis))
    assert grid[np.argmax(gain)] == pytest.approx(order, abs=2.0)
    assert grid[-1] > pretended
    assert gain[abs(grid - pretended) < 10.0].max() < 0.1 * gain.max()
    item = instance(effect("cogging"), {"order": pretended, "amplitude": 2.0, "phase": 0.0})
    assert np.std(background.column(item)[np.abs(data.joined("velocity")) == speed]) < 0.1


@pytest.mark.parametrize("lines", [(11.3,), tuple(np.arange(10.0, 13.0, 0.1))])
def test_a_strong_line_is_not_taken_for_noise(lines: tuple[float, ...]) -> None:
    """Gaps of held-out data spread it over its neighbourhood; a resonance of the noise, which is many lines, is noise."""
    term = effect("periodic_vibration")
    balance, fit = settled(conditioned(np.random.default_rng(5), seconds=12.0))
    background = Background(balance, fit.axis, fit.free)
    for line in lines:
        column = background.columns(probe(term, {"frequency": line}, None, 1.0))[:, 0]
        background.white = background.white + 60.0 * column / np.linalg.norm(column) * math.cos(9.0 * line**2)
    found = {start.instance.values["frequency"]: start for start in starts(background, term, None)}
    near = [start for frequency, start in found.items() if abs(frequency - 11.3) < 2.0]
    assert max(start.gain for start in near) > 1000.0
    assert all(start.excess < 2.0 if len(lines) == 1 else start.excess > 100.0 for start in near)


def test_a_wave_that_is_there_is_not_proposed_again() -> None:
    """Nor as the fundamental of another one, of which that is the fourth harmonic."""

    def two(m: Motion) -> np.ndarray:
        return 4.0 * np.cos(7.0 * m.q) + 2.0 * np.cos(28.0 * m.q + 1.0)

    balance, fit = settled(conditioned(np.random.default_rng(5), two))
    nearly = instance(effect("cogging"), {"order": 7.3, "amplitude": 3.0, "phase": 0.0})
    for known, orders in ((fit.axis, {7.0, 28.0}), (fit.axis.with_effect(nearly), {28.0})):
        found = starts(Background(balance, known, fit.free), effect("cogging"), None)
        near = {order for order in (7.0, 28.0) for s in found if abs(s.instance.values["order"] - order) < 0.5}
        assert near == orders


def test_an_encoder_error_too_fast_for_the_samples_is_none() -> None:
    step, speed = 1e-3, 0.15
    q = speed * np.arange(0.0, 2.0, step)
    measured = np.stack([q, np.full(len(q), speed), np.zeros(len(q))])
    for order, error in ((40.0, 1e-3), (40.0 + 2.0 * math.pi / (speed * step), 0.0)):
        item = instance(effect("encoder_periodic_error"), {"order": order, "amplitude": 1e-3, "phase": 0.0})
        true = np.empty_like(measured)
        machine.true_motion(machine.build(axis(), step, terms=[item]), step, measured, true)
        assert np.ptp((true - measured)[0, 10:]) == pytest.approx(2.0 * error, rel=0.01, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "values", "moved"),
    [
        ("encoder_periodic_error", {"order": 40.0, "amplitude": 1e-3, "phase": 0.0}, 1e-3),
        ("periodic_vibration", {"frequency": 8.0, "amplitude": 2.0, "phase": 0.0}, 2.0 / (900.0 * (16.0 * math.pi) ** 2)),
    ],
)
def test_a_wave_within_the_steps_of_a_coarse_encoder_is_not_named(
    name: str, values: dict[str, float], moved: float
) -> None:
    """What the steps leave repeats with time and position, too."""
    item = instance(effect(name), values)
    balance, fit = settled(conditioned(np.random.default_rng(5)))
    with_wave = balance.fit(fit.axis.with_effect(item), [], iterations=0)
    for step, seen in ((0.0, True), (1.8 * moved, True), (2.2 * moved, False)):
        balance.data = replace(balance.data, position_step=step)
        assert implausible(balance, fit.axis, with_wave, len(fit.axis.effects)) is not seen


@pytest.mark.parametrize(
    ("name", "values", "named"),
    [
        ("torque_bias", {"bias": 1e-6}, False),
        ("torque_bias", {"bias": 1.0}, True),
        ("transport_delay", {"delay": 0.4 * DT}, False),  # torque and position in the log are no better aligned
        ("transport_delay", {"delay": 0.6 * DT}, True),
        ("periodic_vibration", {"frequency": 8.001, "amplitude": 2.0, "phase": 0.0}, False),  # beside one of 8 Hz
        ("periodic_vibration", {"frequency": 8.01, "amplitude": 2.0, "phase": 0.0}, True),
    ],
)
def test_what_is_hardly_there_or_there_twice_is_not_named(
    name: str, values: dict[str, float], named: bool
) -> None:
    balance, fit = settled(conditioned(np.random.default_rng(5)))
    wave = instance(effect("periodic_vibration"), {"frequency": 8.0, "amplitude": 2.0, "phase": 0.0})
    before = fit.axis.with_effect(wave)
    after = balance.fit(before.with_effect(instance(effect(name), values)), [], iterations=0)
    assert implausible(balance, before, after, len(before.effects)) is not named


@pytest.mark.parametrize(("swing", "same"), [(0.02, True), (0.5, False)])
def test_a_wave_over_time_is_one_over_the_position_where_the_axis_moves_steadily(swing: float, same: bool) -> None:
    """At 0.5 rad/s the fourth wave per turn passes 0.318 times a second, its second harmonic 0.637 times."""
    t = np.arange(0.0, 20.0, DT)
    q = 0.5 * t + swing * np.sin(3.0 * t)
    rng = np.random.default_rng(5)
    balance = Balance(condition([Recording(t, q + 1e-7 * rng.normal(size=len(t)), rng.normal(size=len(t)))]))
    harmonic = {"order": 4.0, "amplitude": 1.0, "phase": 0.0, "amplitude_2": 0.5, "phase_2": 1.0}
    over_position, its_second = (
        instance(effect("cogging"), values) for values in (harmonic, harmonic | {"amplitude": 0.0})
    )
    for frequency, item in ((1.0 / math.pi, over_position), (2.0 / math.pi, its_second)):
        over_time = instance(effect("periodic_vibration"), {"frequency": frequency, "amplitude": 1.0, "phase": 0.0})
        assert same_wave(balance, axis(), over_time, item) is same
        assert same_wave(balance, axis(), item, over_time) is same
    ripple = instance(effect("torque_ripple"), {"order": 4.0, "amplitude": 0.01, "phase": 0.0})
    assert not same_wave(balance, axis(), ripple, over_position)


def test_noise_of_the_torque_is_no_load_dependence() -> None:
    """All noise is in the logged torque, which the effect could make smaller; a gravity load makes it identifiable."""
    term = effect("load_dependent_friction")
    for coefficient in (0.0, 0.05):
        data = conditioned(np.random.default_rng(9))
        s = data.stretches[0]
        gravity = 100.0 * np.sin(s.position)
        load = 900.0 * s.acceleration + 500.0 * s.velocity + 60.0 * np.sign(s.velocity) + gravity
        torque = s.torque + gravity + coefficient * np.abs(load) * np.sign(s.velocity)
        balance, fit = settled_with_gravity(replace(data, stretches=(replace(s, torque=torque),)))
        found = starts(Background(balance, fit.axis, fit.free), term, None)
        if coefficient == 0.0:
            assert all(start.gain < 30.0 for start in found)
        else:
            assert found[0].gain > 1000.0
            assert found[0].instance.values["coefficient"] == pytest.approx(coefficient, rel=0.35)


def test_noise_of_the_encoder_is_no_load_dependence() -> None:
    """It is in the acceleration, so in a load that is taken from the motion and in the residual."""
    file = load_axis(Path(__file__).parents[2] / "config" / "azimuth_1p2m.yaml")
    assert file.control is not None
    reference = Reference(Sinusoid(amplitude=0.2, period=20.0, duration=60.0))
    run = simulate_loop(file.axis, reference, file.control.controller, seed=1)
    balance = Balance(condition([Recording(run.t, run.position, run.torque, source="simulated")]))
    fit = settle(balance, file.axis)
    item = instance(effect("load_dependent_friction"), {"coefficient": 0.07})
    assert gain_by_motion(Background(balance, fit.axis, fit.free), item) < 30.0


def test_what_answers_a_torque_that_is_not_logged_is_no_load_dependence() -> None:
    """Noise of the drive moves the axis; the controller answers it with a logged torque that is a multiple of it."""
    recording, believed = telescope(drive_noise=0.87, speed=0.027)
    data = condition([recording])
    balance = Balance(data, believed.actuation_delay)
    base = settle(balance, believed)
    item = instance(effect("load_dependent_friction"), {"coefficient": 0.01})
    fit = joined(balance, base.axis.with_effect(item), iterations=10)
    assert base.squares - fit.squares > 50.0
    assert _driven_gain(balance, base, fit, data.joined("torque")) < 0.0


def settled_with_gravity(data: Conditioned) -> tuple[Balance, Fit]:
    believed = axis().with_effect(instance(effect("imbalance"), {"amplitude": 100.0, "phase": 0.0}))
    balance = Balance(data)
    return balance, settle(balance, believed)


def test_a_search_looks_at_the_survey_of_the_recording() -> None:
    balance, fit = settled(conditioned(np.random.default_rng(0), seconds=60.0))
    view = survey(balance, fit.axis)
    assert view.duration == pytest.approx(60.0 - DT)
    assert view.travel[0] < view.travel[1]
    assert view.slow < view.fast
