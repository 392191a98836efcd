"""The report of a frequency response: gain, phase and coherence with the two fitted forms, and their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tcs_friction.identify.plant_response import SECOND_ORDER, TWO_INERTIAS, PlantModel, Response
from tcs_friction.physics.axis import Unit
from tcs_friction.report.figures import BELIEVED, IMPROVED, MEASURED, MUTED, Array, Picture
from tcs_friction.report.html import Html, Number, key_numbers, page, picture, section, table, write_page
from tcs_friction.report.numbers import with_error
from tcs_friction.report.plot import Curve, Panel, Plot, Scale, Spacing
from tcs_friction.report.plot_picture import drawn_plot

NAMES = {SECOND_ORDER: "eq. 10's form", TWO_INERTIAS: "two inertias"}
CLEARLY = 0.7  # of the other form's misfit, for a resonance to be believed
POOR = 0.5  # misfit beyond which a model says nothing


def write_report(
    directory: Path,
    measured: Response,
    models: Sequence[PlantModel],
    unit_of: Unit,
    sources: Sequence[str],
    notes: Sequence[str] = (),
) -> Path:
    """Write DIR/report.html and its picture; returns the page's path. unit_of: `Axis.unit` of the axis."""
    image = draw_response(measured, models, unit_of)
    sure = measured.sure.frequency
    range_words = f"{sure[0]:.3g} to {sure[-1]:.3g} Hz" if len(sure) else "none"
    numbers = [Number("coherent", range_words, f"{len(sure)} of {len(measured.frequency)} frequencies")]
    for model in models:
        numbers.append(
            Number(NAMES[model.form], f"{100 * model.misfit:.1f} %", "rms misfit, of the response")
        )
    tables = [parameter_table(model, unit_of) for model in models]
    remarks = [section("Notes", *notes)] if notes else []
    document = page(
        "Frequency response from torque to speed",
        sentence(models, unit_of),
        picture(image),
        key_numbers(numbers),
        section("Parameters", *tables),
        *remarks,
        remark=", ".join(sources),
    )
    return write_page(directory / "report.html", document, [image])


def resonant(models: Sequence[PlantModel]) -> PlantModel | None:
    """The two inertias, if they explain the response clearly better and their resonance is determined."""
    plain, coupled = models
    parameters, std = coupled.parameters, coupled.std
    known = (
        std["frequency"] < 0.1 * parameters["frequency"]
        and 3.0 * std["inertia_ratio"] < parameters["inertia_ratio"]
    )
    return coupled if known and coupled.misfit < CLEARLY * plain.misfit else None


def explained(models: Sequence[PlantModel]) -> bool:
    """Whether one of the models fits at all."""
    return min(model.misfit for model in models) < POOR


def sentence(models: Sequence[PlantModel], unit_of: Unit) -> str:
    """What a control engineer would say of the result."""
    unit = unit_of("kg m²")
    coupled, plain = resonant(models), models[0]
    if not explained(models):
        return "Neither model explains the response: was the axis excited, on top of a motion without reversals?"
    if coupled is None:
        shown = with_error(plain.parameters["first"], plain.std["first"])
        return f"Torque meets an inertia of {shown} {unit}; no resonance shows in the range that was excited."
    values, std = coupled.parameters, coupled.std
    return (
        f"Torque meets two inertias of together {with_error(values['inertia'], std['inertia'])} {unit}: "
        f"{100 * values['inertia_ratio']:.0f} % of it hangs on a spring, resonance at "
        f"{with_error(values['frequency'], std['frequency'])} Hz."
    )


def draw_response(measured: Response, models: Sequence[PlantModel], unit_of: Unit) -> Picture:
    """Gain, phase, coherence."""
    sure, every = measured.sure, measured.frequency
    amplitude = np.abs(sure.response)
    reach = np.minimum(2.0 * sure.std, 0.9) * amplitude
    low, high = amplitude - reach, amplitude + reach
    gains = [
        Curve("incoherent", MUTED, every, np.abs(measured.response), points=True, size=1.5),
        Curve("measured", MEASURED, sure.frequency, amplitude, points=True, size=2.5, low=low, high=high),
    ]
    phases = [
        Curve("incoherent", MUTED, every, _degrees(measured.response), points=True, size=1.5),
        Curve("measured", MEASURED, sure.frequency, _degrees(sure.response), points=True, size=2.5),
    ]
    fine = np.geomspace(every[0], every[-1], 600)
    for model, (color, dashed) in zip(models, ((BELIEVED, True), (IMPROVED, False)), strict=True):
        curve, name = model.at(fine), NAMES[model.form]
        gains.append(Curve(name, color, fine, np.abs(curve), dashed=dashed))
        phases.append(Curve(name, color, fine, _degrees(curve), dashed=dashed))
    frequency = Scale("frequency", "Hz", Spacing.LOG)
    limits = (0.5 * float(amplitude.min()), 2.0 * float(amplitude.max())) if len(amplitude) else None
    gain = Scale("gain", unit_of("rad/s per N m"), Spacing.LOG, limits=limits)
    rows = (
        (Panel(frequency, gain, tuple(gains)),),
        (Panel(frequency, Scale("phase", "deg"), tuple(phases)),),
        (Panel(frequency, Scale("coherence", limits=(0.0, 1.05)), (Curve("coherence", MEASURED, every, measured.coherence),)),),
    )
    caption = (
        "Frequency response from torque to speed, measured (grey: incoherent; bars: twice the standard deviation) and fitted, "
        "with the coherence."
    )
    return drawn_plot(Plot("response", caption, rows, heights=(3.0, 2.0, 1.2), linked=True))


def _degrees(response: np.ndarray) -> Array:
    """Phase from -225 to 135 degrees: a plant that is late should not jump at -180."""
    angle: Array = np.degrees(np.angle(response))
    return np.where(angle > 135.0, angle - 360.0, angle)


def parameter_table(model: PlantModel, unit_of: Unit) -> Html:
    """Every parameter with its standard deviation."""
    inertia, damping = unit_of("kg m²"), unit_of("N m s/rad")
    words = {
        "second": ("coefficient of s²", f"{damping} s²"),
        "first": ("coefficient of s: inertia", inertia),
        "constant": ("constant: viscous friction", damping),
        "inertia": ("inertia, both bodies", inertia),
        "viscous": ("viscous friction", damping),
        "inertia_ratio": ("share of it on the spring", "1"),
        "frequency": ("resonance", "Hz"),
        "damping": ("damping ratio of the resonance", "1"),
        "delay": ("delay beside the known one", "ms"),
    }
    rows = []
    for name, value in model.parameters.items():
        scale = 1e3 if name == "delay" else 1.0
        shown = with_error(scale * value, scale * model.std[name]) if value else "does not show"
        rows.append([words[name][0], shown, words[name][1]])
    caption = (
        f"{NAMES[model.form]}: misfit {100 * model.misfit:.1f} % rms of the response. Value ± standard error"
    )
    return table(["parameter", "value", "unit"], rows, caption)
