"""A first axis file from recordings in memory: which law is fitted, what is doubted, and what the controller is like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import axis_of, recording

from tcs_friction.errors import InputError
from tcs_friction.identify import first_axis as module
from tcs_friction.identify.first_axis import FirstAxis, first_axis
from tcs_friction.identify.first_axis_reasons import doubts, reasons
from tcs_friction.identify.gravity import PositionTorque
from tcs_friction.identify.identification import identify
from tcs_friction.identify.net_work import NetWork
from tcs_friction.identify.result import Identification
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap, SignalSource

SOURCE = SignalSource("/joint_states", "position", "a")
SIGNALS = SignalMap(SOURCE, replace(SOURCE, field="effort"))
DAHL = {"coulomb": 60.0, "stiffness": 3e5, "viscous": 500.0}


@pytest.fixture(scope="module")
def recorded() -> Recording:
    return recording(axis_of(), seconds=36.0, rate=250.0)


@pytest.fixture(scope="module")
def found(recorded: Recording) -> FirstAxis:
    return first_axis([recorded], "axis", "rotary", SIGNALS)


def test_a_good_recording_leaves_nothing_to_doubt(found: FirstAxis) -> None:
    assert found.file.axis.friction.term.id == "lugre"
    assert found.file.axis.friction.values["coulomb"] == pytest.approx(78.1, rel=0.02)
    assert not doubts(found)


def test_the_laws_are_counted_while_they_are_fitted(recorded: Recording) -> None:
    told: list[str] = []
    first_axis([recorded], "axis", "rotary", SIGNALS, told.append)
    assert told[1:5] == [f"law {k} of 4 ({name})" for k, name in enumerate(module.LAWS, 1)]
    assert told[5].startswith("law 4 of 4 (lugre): ")
    assert told[-1].endswith(" %")


def changed(first: FirstAxis, /, **what: object) -> str:
    return " ".join(doubts(replace(first, **what)))  # type: ignore[arg-type]


def test_each_doubt_is_said(found: FirstAxis) -> None:
    """What a recording lacks, one at a time."""
    turned, told_nothing = NetWork(-9.0, 1.0, 0.1, 30.0, (-1.0, 0.1)), NetWork(1.0, 9.0, 0.1, 30.0, (1.0, 9.0))
    assert "turned over: it does -9 J as recorded, 9 J turned over (± 1.1)" in changed(found, work=turned)
    assert "the sign of the torque is not told: it does 1 J" in changed(found, work=told_nothing)
    assert "a spring or gravity" in changed(found, position=PositionTorque(found.position.balance, spring=4.0))
    assert "noise of the drive is not told" in changed(found, drive_noise=None)
    quiet = replace(found.found, noise_floor=found.found.rmse.held_out / 2.0)
    assert "2 times the noise floor: something is lacking" in changed(found, found=quiet)
    one_way = replace(found.motion, velocity=np.abs(found.motion.velocity) + 1.0)
    assert "goes one way only" in changed(found, motion=one_way)
    offset = replace(found.found.offset, value=2.0 * found.largest)
    assert "it is larger than any recorded" in changed(found, found=replace(found.found, offset=offset))
    inertia = replace(found.found.inertia, determined=False, reason="slow")
    assert "record quicker motion" in changed(found, found=replace(found.found, inertia=inertia))
    lugre = next(one for one in found.rough if one.law == "lugre")
    alike = replace(lugre, law="dahl_viscous")
    assert "do not tell lugre from dahl_viscous" in changed(found, rough=(lugre, alike))


def test_a_constant_torque_is_written_where_it_is_no_chance(recorded: Recording) -> None:
    shifted = replace(recorded, torque=recorded.torque + 5.0)
    effects = first_axis([shifted], "axis", "rotary", SIGNALS).file.axis.effects
    assert [(one.term.id, one.values) for one in effects] == [("torque_bias", {"bias": pytest.approx(5.0, abs=0.2)})]


def test_a_law_of_which_nothing_is_determined_makes_room_for_a_plainer_one(
    recorded: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def undetermined(*given: object, **named: object) -> Identification:
        asked.append(str(given[3]))
        result = identify(*given, **named)  # type: ignore[arg-type]
        if given[3] != "lugre":
            return result
        return replace(result, parameters={k: replace(one, determined=False) for k, one in result.parameters.items()})

    monkeypatch.setattr(module, "identify", undetermined)
    assert first_axis([recorded], "axis", "rotary", SIGNALS).found.law == "lugre", "all others err more"
    assert asked == ["lugre"]
    monkeypatch.setattr("tcs_friction.identify.rough_comparison.RoughFit.as_good", lambda *_: True)
    found = first_axis([recorded], "axis", "rotary", SIGNALS)
    assert found.found.law == "coulomb_viscous"


def test_refused_laws_are_passed_over_and_the_last_refusal_is_told(
    recorded: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refusing(*given: object, **named: object) -> Identification:
        if given[3] == "lugre":
            raise InputError("identification", "no candidate", "a longer run")
        return identify(*given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "identify", refusing)
    found = first_axis([recorded], "axis", "rotary", SIGNALS)
    assert found.found.law == "dahl_viscous"
    assert found.left_out == {"lugre": "identification: no candidate, expected a longer run"}
    monkeypatch.setattr(module, "LAWS", ("lugre",))
    with pytest.raises(InputError, match="no candidate"):
        first_axis([recorded], "axis", "rotary", SIGNALS)


def test_a_slow_controller_is_a_cautious_one() -> None:
    slow = recording(axis_of(DAHL, "dahl_viscous"), seconds=60.0, rate=50.0)
    found = first_axis([slow], "axis", "rotary", SIGNALS)
    control, told = found.file.control, reasons(found, [slow])
    assert control is not None
    assert control.loop.period == pytest.approx(0.02)
    crossover = control.controller.velocity_proportional / found.file.axis.inertia / (2.0 * np.pi)
    assert crossover == pytest.approx(50.0 / 20.0)
    assert control.controller.position_proportional / (2.0 * np.pi) == pytest.approx(crossover / 3.0)
    assert told["control", "loop", "period"] == "s, between the samples of the log"
    assert "crosses over at 2.5 Hz, a cycle of at least 20 periods" in told["control", "controller", "velocity_proportional"]
