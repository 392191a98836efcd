"""Torques of terms over a data set: kept or made again, exact between samples, and the same by kernel and by transfer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from concealed_torque_cases import DT, axis, conditioned

from tcs_friction.diagnose.fit.torque import ResultCache, TorqueTerms
from tcs_friction.physics import machine
from tcs_friction.physics.registry import effect, effects
from tcs_friction.physics.terms import Place, Term, instance

FILTERS = [term for term in effects().values() if term.transfer is not None]
VALUES = {
    "actuator_lag": {"time_constant": 0.02},
    "transport_delay": {"delay": 0.013},
    "flexible_mode": {"frequency": 9.0, "damping": 0.05, "inertia_ratio": 0.3},
}


def test_what_is_not_to_be_kept_is_made_again() -> None:
    cache, made = ResultCache(100.0), []

    def make() -> tuple[np.ndarray, ...]:
        made.append(1)
        return (np.zeros(5),)

    for keep, total in ((False, 1), (False, 2), (True, 3), (True, 3), (False, 3)):
        cache.get("key", make, keep)
        assert len(made) == total
    assert cache.held == 40


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
        machine.evaluate_demand(built, t, motion, wave, signals, 1e-6, np.zeros(len(t), bool), wave, out)
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
    never = np.zeros(len(s.t), bool)
    machine.evaluate_demand(built({Place.LAW, Place.BODY}), s.t, motion, rotor, s.signals, 1e-6, never, rotor, demand)
    assert rotor == pytest.approx(out[:, machine.ROTOR])
    assert demand + full.inertia * s.acceleration == pytest.approx(out[:, machine.REQUIRED])


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
    rotor, _ = TorqueTerms(data).rotor(axis().with_effect(item))
    inside = slice(500, -500)
    assert rotor[inside] == pytest.approx(expected[inside], abs=2e-3)


def test_an_encoder_error_too_fast_for_the_samples_is_none() -> None:
    step, speed = 1e-3, 0.15
    q = speed * np.arange(0.0, 2.0, step)
    measured = np.stack([q, np.full(len(q), speed), np.zeros(len(q))])
    for order, error in ((40.0, 1e-3), (40.0 + 2.0 * math.pi / (speed * step), 0.0)):
        item = instance(effect("encoder_periodic_error"), {"order": order, "amplitude": 1e-3, "phase": 0.0})
        true = np.empty_like(measured)
        machine.true_motion(machine.build(axis(), step, terms=[item]), step, measured, true)
        assert np.ptp((true - measured)[0, 10:]) == pytest.approx(2.0 * error, rel=0.01, abs=1e-9)
