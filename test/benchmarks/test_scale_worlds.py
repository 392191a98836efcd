"""Worlds of every scale: their physics, what their logs mean, and the bound, against Monte Carlo."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular

from benchmarks import scale_accuracy
from benchmarks.scale_bound import BOUNDED, bound, known_torque, look
from benchmarks.scale_physics import NAMES, TOLERANCE, Array, Control, rates, simulate
from benchmarks.scale_worlds import BLOCK, ScaleWorld, Simulated, draw, plan

# Friction of 1 N m on 0.5 kg m^2: presliding 1 mrad, bristles of 7 Hz, damped with 0.5.
AXIS = np.array([1.0, 1.4, 0.05, 1000.0, 2.0 * 0.5 * np.sqrt(1000.0 * 0.5), 0.3, 0.5, 0.1])
SCALES = np.array([1e-3, 0.05])


def open_loop(torque: Array) -> Control:
    """No controller."""
    nothing = np.zeros(torque.size)
    return Control(nothing, nothing, torque, nothing == 0.0, 0.0, 0.0, 0.0, 1.0)


def applied(
    torque: Array,
    ticks: Array,
    samples: Array,
    axis: Array = AXIS,
    noise: Array | None = None,
) -> Array:
    """States under a torque without controller."""
    nothing = np.zeros(torque.size)
    control = open_loop(torque)
    noise = nothing[:, None] if noise is None else noise
    return simulate(ticks, noise, samples, axis, SCALES, control, nothing, 0.0)[1]


def recorded(
    torque: Array, rate: float, axis: Array, noise: float, corner: float, step: float, seed: int
) -> ScaleWorld:
    """A log of an axis under `torque`, held from the stamps, the drive's noise over quarters of a tick."""
    rng = np.random.default_rng(seed)
    ticks = np.arange(torque.size + 1) / rate
    keep = np.exp(-corner / rate / 4.0)
    drive = noise * rng.standard_normal(4 * torque.size)
    for i in range(1, drive.size):
        drive[i] = keep * drive[i - 1] + np.sqrt(1.0 - keep**2) * drive[i]
    states = applied(torque, ticks, ticks[:-1], axis, drive.reshape(-1, 4))
    position = states[:, 0] + step * rng.standard_normal(torque.size)
    logged = np.ones(torque.size, dtype=bool)
    behind = Simulated(
        ticks,
        open_loop(torque),
        torque,
        logged,
        drive.reshape(-1, 4),
        noise,
        corner,
        np.zeros(torque.size),
        step,
        0.0,
        states,
        SCALES,
    )
    truth = dict(zip(NAMES, axis.tolist(), strict=True))
    return ScaleWorld(
        "test", "rotary", ticks[:-1], position, ticks[:-1], torque, truth, {}, 0.0, 1 / rate, {}, behind
    )


@pytest.mark.parametrize("number", [0, 5, 23])  # open loop; fine encoder; bristles nearly as fast as the log
def test_half_the_step_moves_the_axis_by_much_less_than_the_encoder_sees(number: int) -> None:
    world = draw(1, number)
    behind = world.simulated
    axis = np.array([world.truth[name] for name in NAMES])
    usual, finer = (  # without rounding, whose every step would count
        simulate(
            behind.ticks,
            behind.noise,
            world.t,
            axis,
            behind.scales,
            behind.control,
            behind.reading_noise,
            0.0,
            tolerance,
        )[1][:, 0]
        for tolerance in (TOLERANCE, TOLERANCE / 2**4)
    )
    seen = np.hypot(behind.encoder_noise, behind.encoder_step / np.sqrt(12.0))
    assert np.abs(usual - finer).max() < 0.1 * seen


def test_the_work_of_the_torque_is_stored_or_lost() -> None:
    ticks = np.arange(2001) / 1000.0
    torque = np.where(ticks[:-1] < 0.7, 3.0, 0.0)
    samples = np.linspace(0.0, 2.0, 80001)[:-1]
    _, v, z = applied(torque, ticks, samples).T
    acting = torque[np.minimum((samples * 1000.0 + 1e-6).astype(int), 1999)]
    power = np.array([AXIS[6] * rates(a, b, u, AXIS)[0] * a for a, b, u in zip(v, z, acting, strict=True)])
    kinetic = 0.5 * AXIS[6] * v**2
    stored = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(samples))])
    assert stored == pytest.approx(kinetic, abs=1e-4 * kinetic.max())
    free = kinetic[samples > 0.7] + AXIS[7] * applied(torque, ticks, samples)[samples > 0.7, 0]
    assert np.diff(free[v[samples > 0.7] > AXIS[2]]).max() < 0.0
    assert abs(v[-1]) < 1e-3 * AXIS[2]
    assert AXIS[3] * z[-1] == pytest.approx(
        -AXIS[7], abs=0.02
    )  # at rest the bristles hold against the offset


def test_a_constant_torque_ends_in_the_speed_at_which_friction_equals_it() -> None:
    ticks = np.arange(40001) / 1000.0
    v = applied(np.full(40000, 2.0), ticks, ticks[-1:])[0, 1]
    g = AXIS[0] + (AXIS[1] - AXIS[0]) * np.exp(-((v / AXIS[2]) ** 2))
    assert g + AXIS[5] * v + AXIS[7] == pytest.approx(2.0, rel=1e-6)


def test_the_plan_of_a_block_has_everything_in_its_share_and_every_size() -> None:
    worlds = [plan(3, number) for number in range(BLOCK)]
    assert Counter(w["logging"] for w in worlds) == dict.fromkeys(
        ("held_from_stamp", "held_up_to_stamp", "point", "stale"), 10
    )
    assert Counter(w["kind"] for w in worlds) == {"rotary": 27, "linear": 13}
    for kind, count in (("rotary", 27), ("linear", 13)):
        ranks = sorted(int(w["size"] * count) for w in worlds if w["kind"] == kind)
        assert ranks == list(range(count))
    assert plan(3, 0) != plan(3, BLOCK)


def test_the_same_seed_is_the_same_world_and_another_number_is_not() -> None:
    first, again, other = draw(5, 1), draw(5, 1), draw(5, 2)
    np.testing.assert_array_equal(first.position, again.position)
    np.testing.assert_array_equal(first.torque, again.torque)
    assert first.truth == again.truth
    assert first.truth != other.truth


def test_what_is_logged_acts_when_the_world_says() -> None:
    seen = set()
    for number in range(BLOCK):
        if plan(7, number)["stamps"] == "regular" and plan(7, number)["logging"] not in seen:
            world = draw(7, number)
            seen.add(world.drawn["logging"])
            behind = world.simulated
            begins = world.torque_t + world.acts
            tick = np.searchsorted(behind.ticks, begins + 1e-6 * world.log_period, side="right") - 1
            every = int(world.drawn["fresh_every"])
            fresh = (tick >= 0) & (np.arange(tick.size) % every == 0)
            np.testing.assert_array_equal(world.torque[fresh], behind.torque[tick[fresh]])
            assert begins[fresh] == pytest.approx(behind.ticks[tick[fresh]], abs=1e-6 * world.log_period)
            assert (
                np.abs(world.position - behind.states[:, 0]).max()
                < 6.0 * behind.encoder_noise + 0.51 * behind.encoder_step
            )
            assert all(abs(world.believed[name] / world.truth[name] - 1.0) <= 0.2 for name in NAMES[2:-1])
            assert world.believed["static"] >= world.believed["coulomb"]
    assert len(seen) == 4


def test_torque_between_logged_values_is_open_as_much_as_a_walk_leaves_it() -> None:
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal(40000))
    world = recorded(walk, 1000.0, AXIS, 0.0, 1.0, 1e-6, 0)
    logged = np.arange(40000) % 5 == 0
    known, (keeps, adds) = known_torque(replace(world, simulated=replace(world.simulated, logged=logged)))
    assert np.all(known[logged] == walk[logged])
    assert np.all(keeps[logged] + adds[logged] == 0.0)
    variance, all_of_them = 0.0, []
    for keep, add in zip(keeps, adds, strict=True):
        variance = keep**2 * variance + add
        all_of_them.append(variance)
    for place, expected in enumerate((0.0, 0.8, 1.2, 1.2, 0.8)):  # k (5 - k) / 5
        assert np.mean(all_of_them[1000 + place : 39000 : 5]) == pytest.approx(expected, rel=0.1)


def linear_positions(theta: Array, torque: Array, rate: float) -> Array:
    """Exact positions of J dv/dt = u - s2 v - offset from rest, the torque beginning to act later by theta[3] (first order)."""
    viscous, inertia, offset, late = theta
    decay = viscous / inertia
    fade = np.exp(-decay / rate)
    x, v, found = 0.0, 0.0, []
    before = 0.0
    for u in torque:
        found.append(x)
        v -= late * (u - before) / inertia
        before = u
        final = (u - offset) / viscous
        x += final / rate + (v - final) * (1.0 - fade) / decay
        v = final + (v - final) * fade
    return np.array(found)


def test_the_bound_is_what_exact_least_squares_reaches_on_a_linear_axis() -> None:
    rate, count = 100.0, 300
    axis = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.8, 0.5, 0.1])
    torque = 2.0 * np.sin(2.0 * np.pi * 0.5 * np.arange(count) / rate) + np.where(
        np.arange(count) % 60 < 30, 0.5, -0.5
    )
    noise, corner, step = 0.05, 20.0, 1e-3
    picked = [5, 6, 7, 8]
    found, _ = look(recorded(torque, rate, axis, noise, corner, step, 0))
    least = np.sqrt(np.diag(np.linalg.inv(found[np.ix_(picked, picked)])))
    theta = np.array([0.8, 0.5, 0.1, 0.0])
    quarter = linear_positions(theta, np.eye(1, 4 * count)[0], 4.0 * rate) - linear_positions(
        theta, np.zeros(4 * count), 4.0 * rate
    )
    response = np.array(
        [[quarter[4 * i - j] if 4 * i > j else 0.0 for j in range(4 * count)] for i in range(count)]
    )
    lags = np.abs(np.subtract.outer(np.arange(4 * count), np.arange(4 * count)))
    covariance = noise**2 * response @ np.exp(-corner / rate / 4.0 * lags) @ response.T + step**2 * np.eye(
        count
    )
    # As in the filter: the position is known at the start as well as one reading tells it, the speed nearly.
    started = (1.0 - np.exp(-theta[0] / theta[1] * np.arange(count) / rate)) * theta[1] / theta[0]
    covariance += step**2 + (0.01 * SCALES[1]) ** 2 * np.outer(started, started)
    root = cholesky(covariance, lower=True)
    centre = linear_positions(theta, torque, rate)
    slopes = [(linear_positions(theta + d, torque, rate) - centre) / 1e-5 for d in 1e-5 * np.eye(4)]
    whitened = solve_triangular(root, np.stack(slopes, axis=1), lower=True)
    exact = np.sqrt(np.diag(np.linalg.inv(whitened.T @ whitened)))
    assert least == pytest.approx(exact, rel=0.02)
    runs = [recorded(torque, rate, axis, noise, corner, step, seed).position - centre for seed in range(200)]
    errors = np.linalg.lstsq(
        whitened, solve_triangular(root, np.stack(runs, axis=1), lower=True), rcond=None
    )[0]
    assert errors.std(axis=1) == pytest.approx(least, rel=0.2)  # 200 runs: 5 % of scatter


def test_the_bound_is_what_one_step_of_the_filter_reaches_on_an_axis_with_friction() -> None:
    times = np.arange(3000) / 500.0
    torque = 4.0 * np.sin(2.0 * np.pi * 1.5 * times) * (1.0 + 0.3 * np.sin(2.0 * np.pi * 0.4 * times))
    errors = []
    for seed in range(40):
        world = recorded(torque, 500.0, AXIS, 0.005, 300.0, 2e-6, seed)
        found, score = look(world, world.position)
        size = np.sqrt(np.diag(found))
        least = bound(world)
        estimate = np.linalg.solve(found / np.outer(size, size), score / size) / size
        errors.append(estimate / np.array([least[name] for name in BOUNDED]))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert spread == pytest.approx(np.ones(len(BOUNDED)), abs=0.45)  # 40 runs: 11 % of scatter, four of them


def test_the_bound_is_of_the_true_motion_where_a_replay_would_leave_it() -> None:
    world = draw(1, 13)  # slow, where friction falls with speed
    behind = world.simulated
    touched = replace(world, simulated=replace(behind, noise=behind.noise + 1e-9 * behind.noise_level))
    first, second = bound(world), bound(touched)
    assert first["viscous"] > 0.5 * world.truth["viscous"]  # never fast
    assert list(second.values()) == pytest.approx(list(first.values()), rel=0.01)


def counted(monkeypatch: pytest.MonkeyPatch, row: scale_accuracy.Row) -> dict[str, float]:
    """The bench's results if every number of two worlds had this row."""
    monkeypatch.setattr(scale_accuracy, "draw", lambda *_: None)
    monkeypatch.setattr(scale_accuracy, "rows", lambda _: dict.fromkeys(scale_accuracy.NAMES, row))
    return {line["name"]: line["value"] for line in scale_accuracy.run(1, 2)}


def test_errors_are_counted_beside_intervals_and_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = counted(monkeypatch, (0.02, 0.01, 0.02, 1.0))
    assert found["determined"] == 14
    assert found["95 % intervals that hold the truth"] == 0.0
    assert found["beyond 6 standard deviations"] == 0
    assert found["inertia: median error over that of the bound"] == pytest.approx(1.0 / 0.6745)


def test_what_is_undetermined_with_a_low_bound_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "undetermined with a bound below 10 %"
    assert counted(monkeypatch, (0.2, np.nan, 0.02, 1.0))[name] == 14
    assert counted(monkeypatch, (0.2, np.nan, 0.2, 1.0))[name] == 0


def test_a_log_is_read_with_its_own_stamps() -> None:
    t = np.arange(10) * 1e-3
    world = SimpleNamespace(name="test", t=t, position=t**2, torque_t=t[1:] + 2e-4, torque=t[1:])
    read = scale_accuracy.recorded(world)  # type: ignore[arg-type]
    assert read.torque_log is not None
    assert read.torque_log[0].tolist() == world.torque_t.tolist()
    assert read.torque.tolist() == [t[1], t[1], *t[1:9]]
    world.torque_t, world.torque = t, t
    assert scale_accuracy.recorded(world).torque_log is None  # type: ignore[arg-type]
