"""Section 5.1, Fig. 9 and eq. 10: the frequency response of the plant from torque to speed.

Measured as a frequency response analyser does: a periodic multisine, whole periods, the ratio of the spectra at the
excited frequencies, its scatter from period to period as uncertainty. Once on eq. 10 itself, whose coefficients have
to come back, and once on the simulated axis, turning at constant speed so that friction does not reverse. A third time as
`./tcs response` does it: a multisine in the reference, the controller at work, on an axis that has a flexible mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from tcs_friction.config import shipped
from tcs_friction.control.pid import DoubleLoopPid, PidConfig
from tcs_friction.control.reference import load_reference
from tcs_friction.identify import plant_response as closed
from tcs_friction.physics.registry import effect
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance
from tcs_friction.recording.recording import Recording
from tcs_friction.report import published
from tcs_friction.report.figures import (
    BELIEVED,
    IMPROVED,
    MEASURED,
    MUTED,
    Array,
    Picture,
    drawn,
    label,
    panels,
)
from tcs_friction.report.html import Html, picture, section, table
from tcs_friction.report.numbers import with_error
from tcs_friction.report.paper.stand import Chapter, Stand
from tcs_friction.report.response import draw_response
from tcs_friction.report.runs import DEGREE

Complex = NDArray[np.complex128]

PERIOD = 10.0  # s of the multisine
PERIODS = 6  # after SETTLE others
SETTLE = 3
LINES = np.unique(np.round(np.geomspace(1, 1000, 60)).astype(int))  # multiples of 1/PERIOD: 0.1 to 100 Hz
TORQUE = 12.0  # N m rms on the axis: too little to make it reverse
SPEED = 1.0 * DEGREE  # rad/s that the axis turns at
EXCITATION = "azimuth_1p2m_response.yaml"
MODE = {"frequency": 22.0, "damping": 0.03, "inertia_ratio": 0.3}
NOISE = 0.02  # of eq. 10's output, relative to its rms


@dataclass(frozen=True)
class Response:
    """Frequency (k,) Hz, complex response (k,) speed per torque, standard deviation (k,), and fitted (3,) eq. 10 form."""

    frequency: Array
    response: Complex
    std: Array
    coefficients: Array

    def fitted(self) -> Complex:
        """The fitted form at the frequencies."""
        return form(self.coefficients, self.frequency)


@dataclass(frozen=True)
class PlantResult:
    """Eq. 10 found again, and the axis."""

    paper: Response
    axis: Response
    inertia: float  # kg m^2, the axis' own
    flexible: closed.Response
    models: tuple[closed.PlantModel, closed.PlantModel]


def form(coefficients: Array, frequency: Array) -> Complex:
    """Eq. 10: 1 / (second s^2 + first s + constant) at s = 2 pi i f."""
    s = 2j * np.pi * frequency
    second, first, constant = coefficients
    response: Complex = 1.0 / (second * s * s + first * s + constant)
    return response


def measure(stand: Stand) -> PlantResult:
    """Both responses."""
    period = stand.control.loop.period
    excitation = multisine(period)
    flexible = _through_loop(stand)
    return PlantResult(
        _analyse(excitation, _through_paper(excitation, period, stand.seed), period, 0.5 * period, 1),
        _analyse(*_through_axis(stand, excitation * TORQUE), period, stand.axis.actuation_delay, 2),
        stand.axis.inertia,
        flexible,
        (closed.fit_second_order(flexible), closed.fit_two_inertias(flexible)),
    )


def _through_loop(stand: Stand) -> closed.Response:
    """The response of the axis with a flexible mode, from the reference's multisine through the closed loop."""
    mode = instance(effect("flexible_mode"), MODE)
    axis = replace(stand.axis, effects=(*stand.axis.effects, mode))
    run = stand.run(load_reference(shipped(EXCITATION)), axis=axis)
    recording = Recording(run.t, run.position, run.torque, reference=run.reference, source="simulation")
    return closed.of_recordings([recording], 0.75, 45.0, axis.actuation_delay)


def multisine(period: float) -> Array:
    """Unit rms, equal amplitudes, Schroeder's phases; SETTLE + PERIODS periods."""
    count = round(PERIOD / period)
    t = np.arange(count) / count
    k = np.arange(len(LINES))
    phases = -np.pi * k * (k - 1) / len(LINES)
    one = np.sum(np.cos(2.0 * np.pi * LINES[:, None] * t + phases[:, None]), axis=0)
    values: Array = np.tile(one / np.sqrt(np.mean(one**2)), PERIODS + SETTLE)
    return values


def _through_paper(torque: Array, period: float, seed: int) -> Array:
    """Eq. 10's speed under a held torque, with noise."""
    numerator, denominator, _ = cont2discrete(([1.0], list(published.PLANT)), period)
    speed: Array = lfilter(numerator.ravel(), denominator, torque)
    noise = np.random.default_rng(seed).standard_normal(len(speed))
    return speed + NOISE * float(np.std(speed)) * noise


def _through_axis(stand: Stand, excitation: Array) -> tuple[Array, Array]:
    """Torque applied and speed measured while the axis turns at SPEED under its controller."""
    period = stand.control.loop.period
    plant = Simulator(stand.axis, period, stand.seed)
    controller = DoubleLoopPid(soft(stand), period)
    torque, speed = np.empty(len(excitation)), np.empty(len(excitation))
    ramp = np.minimum(np.arange(len(excitation)) * period / 5.0, 1.0)
    wanted = np.concatenate([[0.0], np.cumsum(SPEED * ramp * period)])
    for k, extra in enumerate(excitation):
        q, v = plant.measured_position, plant.measured_velocity
        torque[k] = plant.step(controller.step(q, v, wanted[k], SPEED * ramp[k], 0.0, extra))
        speed[k] = plant.measured_velocity
    # the sensor's own lag is known: a difference of positions through a first-order filter
    return torque, _unfiltered(speed, stand)


def soft(stand: Stand) -> PidConfig:
    """A controller that keeps the mean speed and leaves the excitation alone."""
    return replace(
        stand.control.controller,
        position_proportional=0.0,
        velocity_proportional=1.0 * stand.axis.inertia,
        velocity_integral=0.3 * stand.axis.inertia,
    )


def _unfiltered(speed: Array, stand: Stand) -> Array:
    """The plain difference of measured positions that the velocity filter was given."""
    bandwidth = stand.axis.sensors.velocity_bandwidth
    if bandwidth == 0.0:
        return speed
    decay = np.exp(-2.0 * np.pi * bandwidth * stand.control.loop.period)
    raw = speed.copy()
    raw[1:] = (speed[1:] - decay * speed[:-1]) / (1.0 - decay)
    return raw


def _analyse(torque: Array, speed: Array, period: float, delay: float, holds: int) -> Response:
    """Ratio of the spectra at the excited lines.

    Known and taken out: `delay` (s) between torque and speed, and the averaging over one tick that a held torque, and
    a speed from the difference of positions, bring with them (`holds` times).
    """
    count = round(PERIOD / period)
    blocks = [np.reshape(values[SETTLE * count :], (PERIODS, count)) for values in (torque, speed)]
    inputs, outputs = (np.fft.rfft(block, axis=1)[:, LINES] for block in blocks)
    frequency = LINES / PERIOD
    known = np.sinc(frequency * period) ** holds * np.exp(-2j * np.pi * frequency * delay)
    response = outputs.mean(axis=0) / inputs.mean(axis=0) / known
    std: Array = np.std(np.abs(outputs / inputs), axis=0, ddof=1) / np.sqrt(PERIODS)
    return Response(frequency, response, std, fit(frequency, response, std))


def fit(frequency: Array, response: Complex, std: Array) -> Array:
    """Coefficients (3,) of eq. 10's form, by least squares of 1 = G (second s^2 + first s + constant)."""
    s = 2j * np.pi * frequency
    weight = np.abs(response) / np.maximum(std, 1e-4 * np.abs(response))
    columns = np.stack([response * s * s, response * s, response], axis=1) * weight[:, None]
    matrix = np.concatenate([columns.real, columns.imag])
    right = np.concatenate([weight, np.zeros(len(weight))])
    scale = np.linalg.norm(matrix, axis=0)
    found: Array = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
    return found


CLOSED_LOOP = (
    "Fig. 9 again, of the axis with a flexible mode, through the closed loop: a multisine in the reference, which also serves "
    "as instrument. Eq. 10's form cannot follow a resonance, two inertias can."
)


@drawn("figure_09", "Fig. 9. Frequency response from torque to speed. Left: eq. 10, measured and fitted again. Right: the "
       "simulated axis turning at 1 deg/s, where its cogging disturbs one line. Bars: twice the standard deviation.")  # fmt: skip
def draw(result: PlantResult) -> Figure:
    """Amplitude on top, phase below."""
    figure, grid = panels(2, 2, height=2.3, width=9.4, sharex=True)
    for column, (response, unit, title) in enumerate(
        (
            (result.paper, "1", "the paper's plant, eq. 10"),
            (result.axis, "deg/s per N m", "the simulated axis"),
        )
    ):
        amplitude, phase = grid[column], grid[2 + column]
        scale = 1.0 if column == 0 else 1.0 / DEGREE
        fine = np.geomspace(response.frequency[0], response.frequency[-1], 400)
        curve = form(response.coefficients, fine)
        size = np.abs(response.response) * scale
        bars = 2.0 * response.std * scale
        amplitude.errorbar(
            response.frequency, size, bars, fmt=".", color=MEASURED, ms=4, lw=0.8, label="measured"
        )
        amplitude.loglog(fine, np.abs(curve) * scale, color=IMPROVED, label="fitted")
        phase.semilogx(response.frequency, _degrees(response.response), ".", color=MEASURED, ms=4)
        phase.semilogx(fine, _degrees(curve), color=IMPROVED)
        if column == 0:
            printed = form(np.array(published.PLANT), fine)
            amplitude.loglog(fine, np.abs(printed), color=BELIEVED, ls="--", label="as printed")
            phase.semilogx(fine, _degrees(printed), color=BELIEVED, ls="--")
        label(amplitude, "", f"amplitude ({unit})", title)
        label(phase, "frequency (Hz)", "phase (deg)")
        phase.set_ylim(-200, 20)
        phase.set_yticks([-180, -90, 0])
        phase.axhline(-90, color=MUTED, lw=0.6)
    grid[0].legend(loc="lower left")
    return figure


def _degrees(response: Complex) -> Array:
    angle: Array = np.degrees(np.angle(response))
    return np.where(angle > 90.0, angle - 360.0, angle)


def chapter(result: PlantResult) -> Chapter:
    """Picture and coefficients."""
    image = draw(result)
    names = ("s²", "s", "1")
    rows = [
        [name, f"{printed:.4f}", f"{found:.4f}", f"{100.0 * (found / printed - 1.0):+.2f} %", f"{ours:.4g}"]
        for name, printed, found, ours in zip(
            names, published.PLANT, result.paper.coefficients, result.axis.coefficients, strict=True
        )
    ]
    head = ["coefficient of", "eq. 10 as printed", "measured again", "off by", "simulated axis (SI)"]
    words = (
        "Eq. 10 is the plant from torque command to speed: as a position plant it could not turn freely. Its units are "
        f"not given, so only the form compares. The axis' coefficient of s is its inertia: {result.axis.coefficients[1]:.0f} "
        f"of {result.inertia:.0f} kg m²."
    )
    second = Picture("figure_09_closed_loop", CLOSED_LOOP, draw_response(result.flexible, result.models, str).png)
    parts = (picture(image), table(head, rows), words, picture(second), closed_loop_table(result.models[1]))
    html: Html = section("5.1 The plant", *parts)
    return Chapter(html, (image, second))


def closed_loop_table(model: closed.PlantModel) -> Html:
    """The flexible mode that was put in and the one that was found."""
    rows = [
        [name.replace("_", " "), f"{value:g}", with_error(model.parameters[name], model.std[name])]
        for name, value in MODE.items()
    ]
    return table(["flexible mode", "put in", "found"], rows, "Two inertias: value ± standard error")
