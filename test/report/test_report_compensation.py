"""What a predicted compensation says: units without powers of ten, the gain first, and what pictures show is what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcs_friction.control.loop import LoopRun
from tcs_friction.control.pid import PidConfig
from tcs_friction.control.shown_controller import Shown
from tcs_friction.control.spread import Spread
from tcs_friction.control.tracking import ARCSEC
from tcs_friction.control.worth import ALL, LAW, NOTHING, Beside, Interval, Stage, Worth
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.report.compensation import (
    Prediction,
    draw,
    draw_errors,
    lines,
    text_table,
    to_mapping,
    unit_of,
)
from tcs_friction.report.compensation_words import doubt, encoder_sentences, gains_words, sentence
from tcs_friction.report.error_units import UNITS, plain, unit_for

AXIS = Axis("azimuth", 1.0, instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 1.0}))
T = np.arange(0.0, 10.0, 0.1)


def run(error: float) -> LoopRun:
    course = error * np.sin(T)
    still = np.zeros(len(T))
    return LoopRun(T, course, *(still.copy() for _ in range(11)))


def stage(name: str, rms: float, before: float, width: float | None = 0.1) -> Stage:
    def around(value: float) -> Interval | None:
        return None if width is None else (value * (1.0 - width), value * (1.0 + width))

    gain = rms / before
    return Stage(
        name, rms, 3.0 * rms, rms, gain, gain, around(rms), around(rms), around(gain), around(gain), run(1.4 * rms)
    )


def worth(*rms: float, width: float | None = 0.1, unit: float = ARCSEC) -> Worth:
    names = (NOTHING, LAW, ALL)[: len(rms)]
    stages = tuple(stage(name, unit * one, unit * rms[0], width) for name, one in zip(names, rms, strict=True))
    ratio = rms[-1] / rms[1]
    sure = None if width is None else (ratio * (1.0 - width), ratio * (1.0 + width))
    return Worth(stages, {}, 0.0, 1.0, draws=19, beyond=(ratio, sure) if len(rms) == 3 else None)


@pytest.mark.parametrize(
    ("rms", "width", "expected"),
    [
        ((2.9, 0.083), 0.1, "cuts the tracking error from 2900 to 83.0 mas rms (90 %: 75 to 91)."),
        ((2.9, 1.1), None, "cuts the tracking error from 2.90 to 1.10 arcsec rms."),
        ((2.0, 3.0), 0.1, "raises the tracking error from 2.00 to 3.00 arcsec rms (90 %: 2.70 to 3.30)."),
        ((2.0, 1.9), 0.1, "may change nothing: 2.00 arcsec rms without, 1.90 with it (90 %: 1.71 to 2.09)."),
    ],
)
def test_the_headline_says_what_compensation_gains_against_none(
    rms: tuple[float, ...], width: float | None, expected: str
) -> None:
    found = worth(*rms, width=width)
    said = sentence(found, unit_of(Prediction(found), AXIS))
    assert said == f"Compensating the friction law {expected}"
    assert len(said.split()) <= 20


def test_what_effects_add_comes_second() -> None:
    def second(*rms: float) -> str:
        return lines(Prediction(worth(*rms)), AXIS)[1]

    assert second(30.0, 10.0) == "Beside it no effect of the axis file can be cancelled."
    assert second(30.0, 10.0, 4.0) == (
        "With effects cancelled too 4.00 arcsec rms remain (90 %: 3.60 to 4.40), 60 % less than with the law alone."
    )
    assert "50 % more than with the law alone" in second(30.0, 10.0, 15.0)
    assert second(30.0, 10.0, 9.9).startswith("Cancelling effects too changes nothing that can be told: 9.90")


def test_units_keep_numbers_between_one_and_a_thousand() -> None:
    for kind, sizes in (("rotary", np.geomspace(1e-8, 1.0, 200)), ("linear", np.geomspace(1e-8, 1.0, 200))):
        for size in sizes:
            assert 1.0 <= size / unit_for(kind, [size]).size <= 1000.0, size
    assert unit_for("rotary", []) == UNITS["rotary"][0]
    assert unit_for("rotary", [0.0, float("nan")]) == UNITS["rotary"][0]
    assert plain(1e-7) == "0.0000001", "no power of ten, whatever it costs"


def test_pictures_show_what_is_said_without_factors() -> None:
    found = worth(2.9, 0.083, 0.05, unit=1e-3 * ARCSEC)
    unit = unit_of(Prediction(found), AXIS)
    figure = draw.__wrapped__(found, unit)  # type: ignore[attr-defined]
    (bars,) = figure.axes
    shown = " ".join(text.get_text() for text in bars.texts)
    assert f"{plain(found.stage(LAW).rms / unit.size)} {unit.name}, 35 times less" in shown
    assert f"{plain(found.stage(NOTHING).rms / unit.size)} {unit.name}" in shown
    figure.canvas.draw()
    labels = [label.get_text() for which in ("major", "minor") for label in bars.get_xticklabels(which=which)]
    assert not any("e" in label or "10^" in label for label in labels)
    assert not bars.xaxis.get_offset_text().get_text()
    plot = draw_errors(found, unit).plot
    assert plot is not None
    assert [[curve.name for curve in panel.curves] for panel in plot.panels] == [
        ["no compensation", "friction law"],
        ["friction law", "law and all effects"],
    ]
    alone = draw_errors(worth(2.9, 0.083), unit).plot
    assert alone is not None
    assert [curve.name for curve in alone.panels[1].curves] == ["friction law"]
    assert "1.1 times as much" in " ".join(
        text.get_text() for text in draw.__wrapped__(worth(2.0, 2.2), unit).axes[0].texts  # type: ignore[attr-defined]
    )


def test_the_recording_is_held_beside_the_simulation() -> None:
    unit = UNITS["rotary"][0]
    beside = Beside(NOTHING, 3.0 * ARCSEC, 2.0 * ARCSEC, (1.8 * ARCSEC, 2.2 * ARCSEC))
    assert doubt(beside, unit) == (
        "3.00 arcsec rms recorded, 2.00 simulated with no compensation (90 %: 1.80 to 2.20), 50 % off: "
        "the axis file's controller or model is not the one that recorded it."
    )
    assert doubt(replace(beside, recorded=2.1 * ARCSEC), unit).startswith("The recording agrees: 2.10 arcsec")
    unknown = replace(beside, stage=LAW, between=None)
    assert unknown.agrees is None
    assert doubt(unknown, unit).endswith("simulated with the law compensated: how far that may differ is not known.")
    content = to_mapping(Prediction(worth(2.0, 1.0), None, beside), AXIS)
    assert content["recording"]["agrees"] is False
    assert content["recording"]["rms"] == pytest.approx(3.0)
    assert content["statement"].endswith("is not the one that recorded it.")


def test_an_encoders_own_errors_are_told_where_they_are_seen() -> None:
    found, unit = worth(2.0, 1.0), UNITS["rotary"][0]
    assert encoder_sentences(found, unit) == []
    noisy = replace(found.stages[1], measured=1.5 * ARCSEC)
    assert "2.00 becomes 1.50 arcsec rms" in encoder_sentences(replace(found, stages=(found.stages[0], noisy)), unit)[0]


def test_the_controller_is_named_with_how_well_it_explains_the_torque() -> None:
    gains = np.array([[100.0, 1.0], [2000.0, 10.0], [0.0, 0.0], [1.0, 0.1], [0.0, 0.0]])
    shown = Shown(PidConfig(), Spread(), True, 0.9994, 0.3, gains)
    assert gains_words(shown, str) == (
        "Controller: as the recording shows it, 100.0 N m s/rad ± 1.0 %, 2000 N m/rad ± 0.5 %; "
        "it explains 99.940 % of the torque, the file's 30 %."
    )
    assert "100.0 N s/m" in gains_words(shown, replace(AXIS, kind="linear").unit)
    file = replace(shown, estimated=False)
    assert gains_words(file, str).startswith("Controller: the axis file's, which explains 30 % of the recorded torque")
    neither = replace(file, explained=-0.1, by_file=-2.0)
    assert "though it does not explain the recorded torque; no double-loop PID fits it" in gains_words(neither, str)
    content = to_mapping(Prediction(worth(2.0, 1.0), replace(neither, by_file=float("-inf"))), AXIS)
    assert content["controller"]["explained_by_file"] is None


def test_the_table_has_gains_with_their_intervals() -> None:
    table = text_table(Prediction(worth(30.0, 10.0, 4.0)), AXIS).splitlines()
    assert table[0].split()[:3] == ["cancelled", "rms", "(arcsec)"]
    assert "33.3 %" in table[2]
    assert "30.0 to 36.7" in table[2]
