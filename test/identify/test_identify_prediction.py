"""The Kalman filter against a slow one, and what predictions find that torques cannot."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from identify_cases import INERTIA, LUGRE, axis_of
from scipy import linalg

from benchmarks import accuracy, law_axes
from tcs_friction.conditioning.hold import LoggedTorque
from tcs_friction.conditioning.motion import prepare, windows
from tcs_friction.control.loop import LoopRun
from tcs_friction.identify import forced_kernel, identification
from tcs_friction.identify.identification import identify
from tcs_friction.identify.prediction import FINEST, ForcedPredictor
from tcs_friction.identify.prediction_kernel import LANES, SLOW, predict
from tcs_friction.identify.problem import pose, settled
from tcs_friction.identify.sharpen import WHITE, Sharpened, widened
from tcs_friction.identify.start import space_of
from tcs_friction.physics.axis import Drive, Sensors
from tcs_friction.physics.registry import effect
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording

DT = 1e-3
DRIVEN = np.array([[DT**2 / 3.0, DT / 2.0], [DT / 2.0, 1.0]])  # of velocity and itself, by a random acceleration
CANDIDATE = np.array([*LUGRE.values(), INERTIA, 1.5, 60.0, 2e-4, 5e-8, 1e-4, 0.5, 1.0])
LIGHT = np.array([20.0, 28.0, 0.02, 2.2e6, 3e3, 12.0, 4.0, 0.0, 100.0, 1e-15, 1e-9, 1e-15, 0.0, 0.0])
"""Of noises so small that nothing slips by chance."""
SWING = DT * max(math.sqrt(LIGHT[3] / LIGHT[6]), (LIGHT[4] + LIGHT[5]) / LIGHT[6])  # rad in a sample, of its bristle
LATE = 0.4 * DT
ROUGH = 0.3  # N m, of a torque's changes


@pytest.fixture(scope="module")
def run() -> LoopRun:
    """A closed loop on an axis drawn at random."""
    return accuracy.run_axis(accuracy.draw(np.random.default_rng(5)), 3, 30.0)


def folded(v: float, deviation: float) -> float:
    """Mean of |v|, of a normal velocity."""
    u = v / (math.sqrt(2.0) * deviation)
    return v * math.erf(u) + deviation * math.sqrt(2.0 / math.pi) * math.exp(-u * u)


def level(v: float, p: np.ndarray) -> float:
    """Friction of LuGre in the long run, N m."""
    return float(p[0] + (p[1] - p[0]) * np.exp(-((v / p[2]) ** 2)))


def forgetting(p: np.ndarray) -> float:
    """1/s: one over the integral of the squared autocorrelation of an axis' velocity at rest, by matrices."""
    stiffness, damping, inertia, rate = p[3], p[4] + p[5], p[6], p[8]
    matrix = np.array([[0.0, 1.0, 0.0], [-stiffness / inertia, -damping / inertia, 1.0], [0.0, 0.0, -rate]])
    spread = linalg.solve_continuous_lyapunov(matrix, -np.diag([0.0, 0.0, 1.0]))
    decay = spread[:, 1] / spread[1, 1]
    return float(1.0 / linalg.solve_continuous_lyapunov(matrix, -np.outer(decay, decay))[1, 1])


def after_step(x: np.ndarray, push: float, p: np.ndarray, deviation: float, slipped: float = 0.0) -> np.ndarray:
    """State a step later: position, velocity, deflection, disturbance. deviation: of the velocity; slipped: z, by chance."""
    stiffness, damping, viscous, inertia = p[3:7]
    keep, stay = np.exp(-p[8] * DT), np.exp(-SLOW * DT)

    def bristle(v: float) -> float:
        forget = stiffness * folded(v, deviation) / level(v, p)
        return slipped + float(x[2] * np.exp(-forget * DT) + (v / forget) * -np.expm1(-forget * DT))

    def acceleration(v: float, z: float, w: float) -> float:
        rate = (bristle(v) - x[2]) / DT
        return float((push - stiffness * z - damping * rate - viscous * v) / inertia + w + x[4])

    middle = x[1] + 0.5 * DT * acceleration(x[1], x[2], x[3])
    end = bristle(middle)
    a = acceleration(middle, 0.5 * (x[2] + end), 0.5 * (1.0 + keep) * x[3])
    return np.array([x[0] + DT * x[1] + 0.5 * DT**2 * a, x[1] + DT * a, end, x[3] * keep, x[4] * stay])


def measured(
    state: np.ndarray, spread: np.ndarray, position: float, encoder: float
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """State and covariance after a measured position, its error of prediction and the variance of that."""
    variance, error = float(spread[0, 0] + encoder**2), float(position - state[0])
    gain = spread[:, 0] / variance
    return state + gain * error, spread - np.outer(gain, spread[0]), error, variance


def by_chance(state: np.ndarray, after: np.ndarray, deviation: float, p: np.ndarray) -> float:
    """Variance of what a bristle moves in a step, beside what goes with the velocity, times 1/s of how soon that is over."""
    v, z = 0.5 * (state[1] + after[1]), 0.5 * (state[2] + after[2])
    mean, sign = folded(v, deviation), math.erf(v / (math.sqrt(2.0) * deviation))
    forget = p[3] * mean / level(v, p)
    slip = z * -np.expm1(-forget * DT) / (mean * DT)
    return float(2.0 * DT * slip**2 * (v**2 + deviation**2 * (1.0 - sign**2) - mean**2))


def slow(position: np.ndarray, torque: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same filter with matrices and numerical derivatives, one sample at a time."""
    offset, rate, size, encoder, drift, missed = p[7:13]
    keep = np.exp(-rate * DT)
    power = size**2 * (1.0 - keep**2)
    noise = np.zeros((5, 5))
    noise[np.ix_([1, 3], [1, 3])] = power * DRIVEN
    noise[4, 4] = drift**2 * (1.0 - np.exp(-2.0 * SLOW * DT))
    state = np.array([position[0], (position[1] - position[0]) / DT, 0.0, 0.0, 0.0])
    known_for = forgetting(p)
    first = [encoder**2, 2 * (encoder / DT) ** 2 + state[1] ** 2, (p[1] / p[3]) ** 2, size**2, drift**2]
    spread = np.diag(first)
    errors, variances = [], []
    for k in range(len(position)):
        before = spread[1, 1]
        state, spread, error, variance = measured(state, spread, position[k], encoder)
        deviation, learnt = math.sqrt(spread[1, 1]), before / spread[1, 1] - 1.0
        errors.append(error)
        variances.append(variance)
        share = LATE / DT  # of the step in which the torque before still acts
        after = torque[min(k + 1, len(torque) - 1)]
        push = (1.0 - share) * after + share * torque[k] - offset

        def step(x: np.ndarray, push: float = push, deviation: float = deviation) -> np.ndarray:
            return after_step(x, push, p, deviation)

        scale = np.array([1e-8, 1e-9, 1e-9, 1e-8, 1e-8])
        turn = np.column_stack([(step(state + d) - step(state - d)) / (2 * d.sum()) for d in np.diag(scale)])
        driven = (step(state, push + 1.0) - step(state, push - 1.0)) / 2.0
        slip = (after_step(state, push, p, deviation, 1e-9) - step(state)) / 1e-9
        slips = by_chance(state, step(state), deviation, p) / min(known_for + learnt / DT, 2.0 / DT)
        state = step(state)
        spread = turn @ spread @ turn.T + noise + (missed * ROUGH) ** 2 * np.outer(driven, driven) + slips * np.outer(slip, slip)
    return np.array(errors), np.array(variances)


def pushed(torque: np.ndarray, late: float = LATE) -> tuple[np.ndarray, ...]:
    """firsts, steps, pushes, moves and roughness of a torque that was held up to its stamps and acts so much later."""
    count = len(torque)
    log = LoggedTorque(np.arange(count) * DT, torque, DT)
    pushes, _ = log.pushes(np.arange(count) * DT, late - DT)
    firsts = np.append(np.arange(count), count - 1)
    return firsts, np.full(count - 1, DT), pushes[None], pushes[None], np.full(count - 1, ROUGH)


def test_lanes_equal_a_slow_filter(run: LoopRun) -> None:
    position, torque = run.position[2000:2400] - run.position[2000], run.torque[2000:2400].copy()
    candidates = np.tile(CANDIDATE, (LANES + 1, 1))
    candidates[:, 3] *= np.linspace(0.8, 1.2, LANES + 1)
    errors, variances = np.empty((LANES + 1, 400)), np.empty((LANES + 1, 400))
    row = np.zeros(LANES + 1, dtype=np.int64)
    predict(position, np.array([0, 400]), *pushed(torque), row, candidates, errors, variances)
    for k in (0, LANES):
        expected, spread = slow(position, torque, candidates[k])
        assert variances[k, 5:] == pytest.approx(spread[5:], rel=1e-2)
        assert errors[k, 5:] == pytest.approx(expected[5:], rel=1e-2, abs=0.02 * np.sqrt(spread[-1]))


def test_each_stretch_starts_afresh(run: LoopRun) -> None:
    position, torque = run.position[1000:2000] - run.position[1000], run.torque[1000:2000].copy()
    both, second = np.empty((2, 1, 1000)), np.empty((2, 1, 500))
    one = np.zeros(1, dtype=np.int64)
    predict(position, np.array([0, 500, 1000]), *pushed(torque), one, CANDIDATE[None], *both)
    later = [values[..., 500:] for values in pushed(torque)]
    predict(position[500:].copy(), np.array([0, 500]), later[0] - 500, *later[1:], one, CANDIDATE[None], *second)
    assert both[0, 0, 502:] == pytest.approx(second[0, 0, 2:], abs=1e-11)
    assert both[1, 0, 502:] == pytest.approx(second[1, 0, 2:], rel=1e-6)


def followed(torque: np.ndarray, late: float, parts: int) -> np.ndarray:
    """(n,) position of a light axis under a torque held for DT, which acts so much late; Runge-Kutta's rule in `parts` of DT."""
    coulomb, static, stribeck, stiffness, damping, viscous, inertia = LIGHT[:7]

    def rates(v: float, z: float, push: float) -> tuple[float, float]:
        bend = v - stiffness * abs(v) * z / (coulomb + (static - coulomb) * math.exp(-((v / stribeck) ** 2)))
        return (push - stiffness * z - damping * bend - viscous * v) / inertia, bend

    x, v, z, h, found = 0.0, 0.0, 0.0, DT / parts, []
    for k in range(len(torque) * parts):
        if k % parts == 0:
            found.append(x)
        push = float(torque[max(math.floor((k + 0.5 - late / h) / parts), 0)])
        a1, b1 = rates(v, z, push)
        a2, b2 = rates(v + 0.5 * h * a1, z + 0.5 * h * b1, push)
        a3, b3 = rates(v + 0.5 * h * a2, z + 0.5 * h * b2, push)
        a4, b4 = rates(v + h * a3, z + h * b3, push)
        x += h * v + h * h / 6.0 * (a1 + a2 + a3)
        v, z = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4), z + h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    return np.array(found)


def test_noise_lets_an_axis_at_rest_slip() -> None:
    """Predictions of a dwell are white; with |v| at the mean velocity, which is none, their power was 300."""
    step, noise, bandwidth, encoder, count = 10.0 * DT, 1.0, 8.0, 3e-6, 8000
    axis = replace(axis_of(), drive=Drive(noise=noise, noise_bandwidth=bandwidth), sensors=Sensors(noise=encoder))
    simulator = Simulator(axis, step, substeps=20, seed=2)
    torque = np.where(np.arange(count) < 30, 300.0, 70.0)  # a push, and then less than Coulomb friction
    position = np.empty(count)
    for k, value in enumerate(torque.tolist()):
        simulator.step(value)
        position[k] = simulator.measured_position
    candidate = np.array([*LUGRE.values(), INERTIA, 0.0, 2.0 * math.pi * bandwidth, noise / INERTIA, encoder, 1e-12, 0.0, 1.0])
    parts, last, out = 4, count - 1, np.empty((2, 1, count))
    firsts, steps = np.append(np.arange(count), last) * parts, np.full(last * parts, step / parts)
    push, row = np.repeat(torque[1:], parts)[None], np.zeros(1, np.int64)
    predict(position, np.array([0, count]), firsts, steps, push, push, np.zeros(len(steps)), row, candidate[None], *out)
    rest = slice(count // 4, None)
    errors = (out[0, 0] / np.sqrt(out[1, 0]))[rest]
    assert np.ptp(position[rest]) > 100.0 * encoder, "it slips"
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(errors[1:] * errors[:-1])) < WHITE / math.sqrt(len(errors))


def test_finer_steps_of_a_walk_come_near_to_the_motion() -> None:
    """Steps err by their fourth power, wherever the torque changes; at FINEST by less than 3e-4 of stiffness moves."""
    random, count, late = np.random.default_rng(0), 300, 0.375 * DT
    torque = 25.0 * np.sin(0.03 * np.arange(count)) + np.repeat(10.0 * random.standard_normal(count // 4), 4)
    position, log = followed(torque, late, 64), LoggedTorque(np.arange(count) * DT, torque, DT)

    def errors(parts: int, stiffness: float = 1.0) -> np.ndarray:
        firsts, steps = np.append(np.arange(count), count - 1) * parts, np.full((count - 1) * parts, DT / parts)
        pushes, moves = (one[None] for one in log.pushes(np.arange((count - 1) * parts + 1) * (DT / parts), late))
        out, candidate = np.empty((2, 1, count)), LIGHT[None].copy()
        candidate[0, 3] *= stiffness
        row, rough = np.zeros(1, np.int64), np.zeros(len(steps))
        predict(position, np.array([0, count]), firsts, steps, pushes, moves, rough, row, candidate, *out)
        return np.asarray(out[0, 0])

    finest = math.ceil(SWING / FINEST)
    two, four, missed = (float(np.abs(errors(parts) - less).max()) for parts, less in ((2, 0.0), (4, 0.0), (finest, errors(64))))
    assert four < 0.25 * two
    assert four < 1e-3 * float(np.ptp(position))
    assert missed < float(np.abs(errors(64, 1.0 + 3e-4) - errors(64)).max())


def test_intervals_hold_and_errors_stay_at_the_bound() -> None:
    """Three axes of `./tcs bench accuracy`; loose limits, since 21 numbers scatter."""
    found, _ = accuracy.trials(3, 1, 30.0)
    every = np.vstack(list(found.values()))
    assert len(every) == 21
    assert accuracy.coverage(every) >= 0.8
    assert accuracy.over_bound(every) < 1.8
    for name, limit in (("coulomb", 0.005), ("static", 0.005), ("stiffness", 0.03)):
        assert np.abs(found[name][:, 0] / found[name][:, 3]).max() < limit


def test_scatter_is_that_of_a_mean_of_axes() -> None:
    """Trials of one axis that are all alike count as one."""
    random = np.random.default_rng(0)
    rows = np.zeros((90, 5))
    rows[:, 4] = np.repeat(np.arange(30), 3)
    rows[:, 0] = np.repeat(random.standard_normal(30), 3)
    found = accuracy.scatter(rows, lambda chosen: float(chosen[:, 0].mean()))
    assert found == pytest.approx(np.std(rows[:, 0]) / np.sqrt(30.0), rel=0.15)


def test_intervals_without_predictions_hold_what_smoothing_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Smoothing moves the jumps of this friction, and the fit of torques by several times its scatter."""
    monkeypatch.setattr(identification, "sharpen", lambda *_: None)
    found, _ = accuracy.trials(1, 1, 48.0, "reset_integrator")
    every = np.vstack(list(found.values()))
    assert len(every) == len(found)
    assert np.abs(every[:, 0] / every[:, 1]).max() < 4.0


def test_friction_that_jumps_is_predicted_between_its_jumps() -> None:
    """The bond lets go within a sample at every reversal. A fit of torques misses this inertia by some 10 %."""
    found, _ = accuracy.trials(1, 1, 48.0, "reset_integrator")
    every = np.vstack(list(found.values()))
    assert len(every) == len(found)
    assert np.abs(every[:, 0] / every[:, 1]).max() < 4.0
    assert np.abs(found["inertia"][:, 0] / found["inertia"][:, 3]).max() < 0.04


@pytest.fixture(scope="module")
def slipping() -> tuple[ForcedPredictor, np.ndarray]:
    """Predictions on an axis with Maxwell's elements, and the true unknowns."""
    axis = law_axes.draw("maxwell_slip", np.random.default_rng([7, 0]))
    run = accuracy.run_axis(axis, 1, 30.0)
    problem = pose(axis, prepare([Recording(run.t, run.position, run.torque)]))
    values = np.array([axis.friction.values[p.name] for p in axis.friction.term.parameters])
    fine = settled(problem, values).fine
    assert fine is not None
    size = len(values) + 3
    space = widened(space_of(problem, True, True, True).first(size), fine)
    return ForcedPredictor(fine, space), np.array([*values, axis.inertia, 0.0, 0.0, 60.0, 2e-4, 1e-5, 0.0])


def test_the_slope_of_friction_with_a_memory_is_that_of_its_level(
    slipping: tuple[ForcedPredictor, np.ndarray],
) -> None:
    """A memory keeps up with a level that changes slowly; one that is shaken fast would seem half as steep."""
    predictor, unknowns = slipping
    coulomb, static, fall, _, _, viscous = unknowns[:6]
    predictor.weigh(unknowns)
    velocity = predictor.fine.samples.at(predictor.fine.velocity)
    drop = (static - coulomb) * np.exp(-((velocity / fall) ** 2))
    friction = predictor.fine.samples.at(predictor.fine.model.torque(unknowns[:7], np.zeros(0)))
    slides = np.abs(np.abs(friction) - (coulomb + drop + viscous * np.abs(velocity))) < 1e-9 * coulomb
    slides &= np.abs(velocity) < 2.0 * fall
    assert np.count_nonzero(slides) > 1000
    expected = viscous - 2.0 * drop * np.abs(velocity) / fall**2
    away = np.abs(predictor.slope - expected)[slides] / np.abs(expected[slides]).max()
    assert np.quantile(away, 0.9) < 0.01


def test_derivatives_of_predictions_are_those_of_their_errors(
    slipping: tuple[ForcedPredictor, np.ndarray],
) -> None:
    predictor, unknowns = slipping
    predictor.weigh(unknowns)
    found, columns = predictor.linearised(unknowns)
    for k in range(6):
        moved = unknowns.copy()
        moved[k] *= 1.0 + 1e-4
        apart = (predictor.evaluated(moved) - found) / (moved[k] - unknowns[k])
        assert np.linalg.norm(apart - columns[:, k]) < 0.05 * np.linalg.norm(columns[:, k])


@pytest.mark.parametrize(("name", "axes"), [("coulomb_viscous", 2), ("stribeck_static", 1)])
def test_laws_without_memory_are_predicted_while_they_slide(name: str, axes: int) -> None:
    """Fits of torques miss the inertia of these axes by 60 to 100 %, for they stick at every reversal."""
    found, _ = accuracy.trials(axes, 1, 48.0, name)
    every = np.vstack(list(found.values()))
    assert accuracy.coverage(every) >= 0.75
    assert np.abs(every[:, 0] / every[:, 1]).max() < 4.0
    assert np.abs(found["inertia"][:, 0] / found["inertia"][:, 3]).max() < 0.05


def test_a_late_log_is_found_and_does_no_harm() -> None:
    random = np.random.default_rng(9)
    axis = accuracy.draw(random)
    run = accuracy.run_axis(axis, 2, 24.0)
    late = 7
    record = Recording(run.t[late:], run.position[late:], run.torque[late:])
    early = Recording(run.t[late:], run.position[late:] * 1.0, np.roll(run.torque, -late)[late:])
    believed = accuracy.believed(axis, random)
    plain, shifted = identify([record], believed), identify([early], replace(believed, actuation_delay=5e-3))
    assert plain.timing is not None
    assert shifted.timing is not None
    assert plain.timing.acts.value == pytest.approx(-DT, abs=0.3 * DT)
    total = shifted.timing.acts.value + shifted.timing.delay
    assert total - plain.timing.acts.value == pytest.approx(7.0 * DT, abs=0.5 * DT)
    assert shifted.inertia.value == pytest.approx(plain.inertia.value, abs=2.0 * plain.inertia.std)


def test_predictions_that_contradict_the_torques_are_dropped(
    run: LoopRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identification, "WORSE", 0.0)
    monkeypatch.setattr(Sharpened, "sound", False)
    part = slice(12_000)
    found = identify([Recording(run.t[part], run.position[part], run.torque[part])], axis_of())
    assert identification.CONTRADICTED in found.notes
    assert found.rmse.train < 0.5


def test_a_long_recording_is_predicted_in_windows(run: LoopRun) -> None:
    motion = prepare([Recording(run.t, run.position, run.torque)])
    part = windows(motion, 5000, 1000)
    assert len(part) == part.bounds[-1] <= 6000
    assert all(len(grid.t) == 1000 for grid in part.grids[:-1])
    for grid in part.grids:
        first = int(np.searchsorted(run.t, grid.t[0]))
        assert (grid.position == run.position[first : first + 1000]).all()
    assert len(part.sources) == len(part.stretches)
    assert windows(motion, len(motion), 1000) is motion


def test_only_runs_that_are_long_enough_are_predicted(run: LoopRun) -> None:
    fine = pose(axis_of(), prepare([Recording(run.t, run.position, run.torque)])).fine
    assert fine is not None
    mask = np.zeros(len(fine.samples), dtype=bool)
    mask[100:150] = mask[1000:1200] = mask[3000:3300] = True
    part = fine.only(mask)
    assert part is not None
    assert part.samples.bounds.tolist() == [0, 200, 500]
    assert part.samples.before[[0, 199, 200]].tolist() == fine.samples.before[[1000, 1199, 3000]].tolist()
    assert part.samples.steps[[0, 199, 200, 499]].tolist() == pytest.approx([DT, 0.0, DT, 0.0])
    assert fine.only(np.zeros_like(mask)) is None


def forced(
    position: np.ndarray, push: np.ndarray, drag: np.ndarray, p: np.ndarray, inertia: float
) -> tuple[np.ndarray, np.ndarray]:
    """The filter of `forced_kernel` with matrices; push (n - 1,) and drag (n - 1,) of each step, rad/s^2 and 1/s."""
    rate, size, encoder, drift, missed = p
    keep, stay, half = np.exp(-rate * DT), np.exp(-SLOW * DT), 0.5 * DT**2
    power = size**2 * (1.0 - keep**2)
    noise = np.zeros((4, 4))
    noise[np.ix_([1, 2], [1, 2])] = power * DRIVEN
    noise[3, 3] = drift**2 * (1.0 - stay**2)
    v = (position[1] - position[0]) / DT
    state, spread = (
        np.array([position[0], v, 0.0, 0.0]),
        np.diag([encoder**2, 2 * (encoder / DT) ** 2 + v**2, size**2, drift**2]),
    )
    errors, variances = [], []
    for k in range(len(position)):
        state, spread, error, variance = measured(state, spread, position[k], encoder)
        errors.append(error)
        variances.append(variance)
        if k == len(push):
            break
        along = 1.0 - 0.5 * DT * drag[k]
        turn = np.array([
            [1.0, DT * along, half, half],
            [0.0, 1.0 - DT * drag[k] * along, DT * along * 0.5 * (1.0 + keep), DT * along],
            [0.0, 0.0, keep, 0.0],
            [0.0, 0.0, 0.0, stay],
        ])  # fmt: skip
        moved = turn @ state + np.array([0.0, DT * along * push[k], 0.0, 0.0])
        a = (moved[1] - state[1]) / DT
        state = np.array([state[0] + DT * state[1] + half * a, *moved[1:]])
        driven = np.array([half, DT * along, 0.0, 0.0]) * missed * ROUGH / inertia
        spread = turn @ spread @ turn.T + noise + np.outer(driven, driven)
    return np.array(errors), np.array(variances)


def test_known_friction_drives_a_slow_filter_alike(run: LoopRun) -> None:
    position, torque = run.position[2000:2300] - run.position[2000], run.torque[2000:2300].copy()
    velocity = np.gradient(position, DT)
    friction, slope = 80.0 + 500.0 * velocity, np.linspace(-2e4, 4e4, 300)
    candidates = np.array([[1000.0, 1.5, 60.0, 2e-4, 5e-8, 1e-4, 0.5], [900.0, 0.0, 30.0, 3e-4, 6e-8, 2e-4, 0.0]])
    errors, variances = np.empty((2, 300)), np.empty((2, 300))
    push = np.append(torque[1:], 0.0)[None]
    steps = np.append(np.full(299, DT), 0.0)
    forced_kernel.predict(
        position, np.array([0, 300]), steps, push, push, np.full(300, ROUGH), np.array([0, 0]),
        np.vstack([friction, 1.1 * friction]), np.array([1, 0]), velocity, slope, candidates, errors, variances,
    )  # fmt: skip
    for k, scale in enumerate((1.1, 1.0)):
        inertia, offset = candidates[k, :2]
        drag = 0.5 * (slope[1:] + slope[:-1]) / inertia
        pull = 0.5 * scale * (friction[1:] + friction[:-1]) - drag * inertia * 0.5 * (
            velocity[1:] + velocity[:-1]
        )
        expected, spread = forced(position, (torque[1:] - offset - pull) / inertia, drag, candidates[k, 2:], inertia)
        assert variances[k] == pytest.approx(spread, rel=1e-6)
        assert errors[k] == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.sqrt(spread[-1]))


def test_what_a_recording_starts_with_is_not_compared() -> None:
    """Maxwell's elements remember the way that each of them last slipped."""
    random = np.random.default_rng([7, 0])
    axis = law_axes.draw("maxwell_slip", random)
    run = accuracy.run_axis(axis, 1, 30.0)
    problem = pose(axis, prepare([Recording(run.t, run.position, run.torque)]))
    values = np.array([axis.friction.values[p.name] for p in axis.friction.term.parameters])
    less = settled(problem, values)
    share = np.cumsum(
        np.ones(values[-1].astype(int))
    )  # distance at which each element slips, over the first's
    distances = ((share - 0.5) / values[-1]) ** values[4] * np.sum(((share - 0.5) / values[-1]) ** -values[4])
    longest = 2.0 * axis.friction.values["coulomb"] / values[-1] / values[3] * distances[-1]
    travel = np.abs(problem.motion.position[problem.thin.centres] - problem.motion.position[0])
    first = int(np.flatnonzero(less.weights)[0])
    assert travel[first] == pytest.approx(longest, rel=0.3)
    assert less.fine is not None
    assert problem.fine is not None
    assert len(less.fine.samples) < len(problem.fine.samples)


def test_a_law_without_memory_is_not_asked_about_torque_at_rest() -> None:
    axis = law_axes.draw("coulomb_viscous", np.random.default_rng([7, 0]))
    run = accuracy.run_axis(axis, 1, 30.0)
    problem = pose(axis, prepare([Recording(run.t, run.position, run.torque)]))
    still = np.abs(problem.velocity) < problem.motion.resolution
    assert still.any()
    assert (problem.weights[still] == 0.0).all()
    assert problem.explained[still].any()
    assert np.mean(problem.weights) > 0.5
    found = identify([Recording(run.t, run.position, run.torque)], axis)
    assert found.rmse.train < 0.5  # what holds the axis at rest, up to 80 N m, is within the law's bound


def test_what_the_law_lacks_does_not_bend_the_inertia() -> None:
    """Directions that differ by 2 %, which nobody believes: taken for a slow drift, not for another inertia."""
    random = np.random.default_rng([7, 1])
    axis = accuracy.draw(random)
    differing = replace(axis, effects=(instance(effect("coulomb_asymmetry"), {"asymmetry": 0.01}),))
    found = accuracy.found_by(axis, accuracy.run_axis(differing, 5, 36.0), random)
    assert found.inertia.value == pytest.approx(axis.inertia, rel=0.15)
    assert abs(found.inertia.value - axis.inertia) < 3.0 * found.inertia.std
    assert found.parameters["static"].value == pytest.approx(axis.friction.values["static"], rel=0.005)


def test_a_bristle_too_stiff_for_the_step_does_no_harm() -> None:
    """Fast motion over bristles that saturate within a sample: predicted, with standard errors that mean something."""
    axis = axis_of({**LUGRE, "stiffness": 3e6, "damping": 0.0, "static": 78.1}, inertia=100.0)
    t = DT * np.arange(8_000)
    velocity = 0.4 * np.sin(2.0 * np.pi * t / 4.0)
    acceleration = np.gradient(velocity, t)
    random = np.random.default_rng(1)
    torque = 100.0 * acceleration + 78.1 * np.tanh(velocity / 1e-3) + 572.0 * velocity
    position = np.cumsum(velocity) * DT + 1e-6 * random.standard_normal(len(t))
    found = identify([Recording(t, position, torque + 0.5 * random.standard_normal(len(t)))], axis)
    assert found.parameters["coulomb"].value == pytest.approx(78.1, rel=0.02)
    assert found.inertia.value == pytest.approx(100.0, rel=0.02)
    assert found.inertia.std > 1e-4
