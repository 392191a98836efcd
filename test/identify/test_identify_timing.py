"""Timing of the torque: told where a motion tells it, left alone where it does not, and in every interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import LUGRE, axis_of

from tcs_friction.conditioning.hold import Between
from tcs_friction.conditioning.motion import prepare
from tcs_friction.identify.identification import identify
from tcs_friction.identify.timing import likely_timing
from tcs_friction.physics.axis import Drive, Sensors
from tcs_friction.physics.simulate import Simulator
from tcs_friction.recording.recording import Recording

PERIOD, COUNT = 4e-3, 9000
"""s of a tick, and how many: a coarse log, of which half a tick moves the torque by 20 % of a bristle's swing."""
PARAMETERS = ("coulomb", "static", "stiffness", "damping", "viscous")


@pytest.fixture(scope="module")
def driven() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and torques of an axis under several sines of torque, the torque as it is when its tick is over."""
    axis = replace(
        axis_of(), sensors=Sensors(noise=5e-8), drive=Drive(limit=2000.0, noise=0.3, noise_bandwidth=20.0)
    )
    simulator = Simulator(axis, PERIOD, substeps=20, seed=4)
    t = PERIOD * np.arange(1, COUNT + 1)
    command = 80.0 * np.sin(2 * np.pi * 0.21 * t) + 50.0 * np.sin(2 * np.pi * 0.93 * t) + 25.0 * np.sin(2 * np.pi * 4.1 * t)
    torque, position = np.empty(COUNT), np.empty(COUNT)
    for k, value in enumerate(command.tolist()):
        torque[k] = simulator.step(value)
        position[k] = simulator.measured_position
    return t, position, torque


@pytest.mark.parametrize("late", [-3, 0, 5])
def test_any_stamps_lead_to_the_same_axis(driven: tuple[np.ndarray, np.ndarray, np.ndarray], late: int) -> None:
    """Torque logged at the end of its tick, three ticks late or five early: found, stated, and no parameter minds."""
    t, position, torque = driven
    log = np.vstack([t - late * PERIOD, torque])
    recording = Recording(t, position, np.interp(t, log[0], torque), torque_log=log, source="test")
    found = identify([recording], axis_of(LUGRE | {"coulomb": 70.0, "static": 105.0}))
    assert found.timing is not None
    assert found.timing.acts.determined
    assert found.timing.acts.value == pytest.approx((late - 1) * PERIOD, abs=0.05 * PERIOD)
    truth = axis_of().friction.values
    for name in PARAMETERS:
        one = found.parameters[name]
        assert one.determined, name
        assert one.value == pytest.approx(truth[name], abs=4.0 * one.std), name
    assert found.inertia.value == pytest.approx(1000.0, abs=4.0 * found.inertia.std)


def test_a_torque_that_is_held_up_to_jittered_stamps() -> None:
    """Ticks that jitter by a quarter, each logged when it is over with the torque that acted in it."""
    axis = replace(axis_of(), sensors=Sensors(noise=5e-8), drive=Drive(limit=2000.0))
    simulator, random = Simulator(axis, 0.25 * PERIOD, substeps=5, seed=4), np.random.default_rng(1)
    count = COUNT // 3
    lengths = random.integers(3, 6, count)
    t = 0.25 * PERIOD * np.cumsum(lengths)
    torque = sum(size * np.sin(2 * np.pi * rate * t) for size, rate in ((80.0, 0.21), (50.0, 0.93), (25.0, 4.1)))
    torque += 2.0 * random.standard_normal(count)
    position = np.empty(count)
    for k, (value, length) in enumerate(zip(torque.tolist(), lengths.tolist(), strict=True)):
        for _ in range(length):
            simulator.step(value)
        position[k] = simulator.measured_position
    found = identify([Recording(t, position, torque)], axis_of(LUGRE | {"coulomb": 70.0, "static": 105.0}))
    assert found.timing is not None
    assert found.timing.between == Between.HELD_UP_TO.value
    assert found.timing.acts.value == pytest.approx(-PERIOD, abs=0.02 * PERIOD)
    for name, truth in axis_of().friction.values.items():
        one = found.parameters[name]
        assert one.value == pytest.approx(truth, abs=4.0 * one.std), name


def test_a_stated_timing_is_not_searched(driven: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    t, position, torque = driven
    found = identify([Recording(t, position, torque, acts=-PERIOD)], axis_of())
    assert found.timing is not None
    assert found.timing.acts.value == -PERIOD
    assert found.timing.acts.reason == "as stated"
    assert found.parameters["stiffness"].value == pytest.approx(2.96e5, rel=0.02)


def test_slow_motion_tells_no_timing() -> None:
    """Without torque of the inertia any timing is as good: the usual one stays."""
    t = 2e-3 * np.arange(10000)
    position = 1e-3 * np.sin(2 * np.pi * 0.05 * t)
    torque = 80.0 * np.tanh(np.gradient(position, t) / 1e-6) + 0.3 * np.random.default_rng(0).standard_normal(len(t))
    motion = prepare([Recording(t, position + 1e-8 * np.random.default_rng(1).standard_normal(len(t)), torque)])
    assert likely_timing(motion) == motion.timing
