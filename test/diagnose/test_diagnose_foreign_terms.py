"""A friction law and an effect of another package, one file each: simulated, concealed, diagnosed, reported and drawn.

Their parameters have names that nothing here knows. The package is installed as far as Python can tell: a folder on the path
with its entry points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.conditioning.preprocessing import prepare
from tcs_friction.config import AxisFile
from tcs_friction.diagnose.dataset.excitation import barred, lacking
from tcs_friction.diagnose.fit.balance import TorqueBalance
from tcs_friction.diagnose.outcome.plots import where
from tcs_friction.diagnose.outcome.result import Diagnosis
from tcs_friction.diagnose.pipeline import diagnose
from tcs_friction.diagnose.search.hypotheses import eligible
from tcs_friction.physics import registry
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect, effects, law, laws
from tcs_friction.physics.simulate import LONGEST_STEP, simulate_open_loop, substeps_for
from tcs_friction.physics.terms import Instance, instance
from tcs_friction.recording.recording import Recording
from tcs_friction.report.diagnosis_files import write_diagnosis

LAW = '''
"""Friction that turns over smoothly within a small velocity: F = grip v / sqrt(v^2 + creep^2) + drag v."""
import math

from tcs_friction.physics.terms import (
    DRY, LEVEL, MOBILISED, VELOCITY, VISCOUS, Feature, Parameter, Place, Role, Term, kernel, spring_rate,
)


@kernel
def friction(motion, parameters, state, dt):
    v = motion[VELOCITY]
    motion[LEVEL] = parameters[1]
    motion[MOBILISED] = v / math.sqrt(v * v + parameters[2] * parameters[2])
    motion[DRY] = motion[LEVEL] * motion[MOBILISED]
    motion[VISCOUS] = parameters[0] * v
    return motion[DRY] + motion[VISCOUS]


def rate(values, inertia):
    return spring_rate(0.0, values["drag"] + values["grip"] / values["creep"], inertia)


TERM = Term(
    id="oozing",
    place=Place.LAW,
    form="F = grip v / sqrt(v^2 + creep^2) + drag v",
    parameters=(
        Parameter("drag", "N m s/rad", "viscous", lower=0.0, role=Role.LINEAR, feature=Feature.VISCOUS),
        Parameter("grip", "N m", "level", lower=1e-12, feature=Feature.DRY),
        Parameter("creep", "rad/s", "velocity of turning over", lower=1e-12, role=Role.FIXED),
    ),
    kernel=friction,
    reads=(),
    rate=rate,
)
'''

EFFECT = '''
"""A magnet beside the path: x = pull exp(-((q - spot) / reach)^2)."""
import math

from tcs_friction.physics.terms import (
    POSITION, Local, Need, Parameter, Place, Role, Term, geometric, kernel, spring_rate,
)


@kernel
def torque(motion, parameters, state, dt):
    distance = (motion[POSITION] - parameters[1]) / parameters[2]
    return parameters[0] * math.exp(-distance * distance)


def scan(survey):
    return [{"spot": 0.0, "reach": w} for w in geometric(survey.span / 100.0, survey.span / 5.0, 6)]


def rate(values, inertia):
    return spring_rate(abs(values["pull"]) / values["reach"], 0.0, inertia)


TERM = Term(
    id="guide_magnet",
    place=Place.OPPOSING,
    form="x = pull exp(-((q - spot)/reach)^2)",
    parameters=(
        Parameter("pull", "N m", "largest torque", role=Role.LINEAR),
        Parameter("spot", "rad", "where"),
        Parameter("reach", "rad", "how wide", lower=1e-12, stated=False),
    ),
    kernel=torque,
    reads=(),
    coordinate="position",
    subsystem="guide",
    scan=scan,
    local=Local("spot", "reach"),
    needs=frozenset({Need.BOTH_DIRECTIONS}),
    rate=rate,
)
'''
ENTRY_POINTS = """
[tcs_friction.laws]
oozing = workshop.oozing:TERM
[tcs_friction.effects]
guide_magnet = workshop.guide_magnet:TERM
"""
PERIOD = 2e-3
PULL, SPOT, REACH = 25.0, 0.03, 0.01


def forget() -> None:
    """The registry looks for terms anew."""
    for known in (laws, effects, registry.alignment, registry.tabulated):
        known.cache_clear()


@pytest.fixture(scope="module", autouse=True)
def _workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("site")
    package, told = folder / "workshop", folder / "workshop-1.0.dist-info"
    for path in (package, told):
        path.mkdir()
    (package / "__init__.py").touch()
    (package / "oozing.py").write_text(LAW, encoding="utf-8")
    (package / "guide_magnet.py").write_text(EFFECT, encoding="utf-8")
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: workshop\nVersion: 1.0\n", encoding="utf-8")
    (told / "entry_points.txt").write_text(ENTRY_POINTS, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        forget()
        yield
    forget()


def friction(creep: float = 0.02) -> Instance:
    return instance(law("oozing"), {"drag": 500.0, "grip": 60.0, "creep": creep})


def magnet(pull: float = PULL, reach: float = REACH) -> Instance:
    return instance(effect("guide_magnet"), {"pull": pull, "spot": SPOT, "reach": reach})


def recorded(true: Axis, duration: float = 24.0) -> Recording:
    """As a controller logs it: the position, then the torque that is held from there on."""
    t = PERIOD * np.arange(round(duration / PERIOD))
    torque = 160.0 * np.sin(2.0 * np.pi * 0.11 * t) + 80.0 * np.sin(2.0 * np.pi * 0.9 * t)
    noise = 1e-7 * np.random.default_rng(0).standard_normal(len(t))
    after = simulate_open_loop(true, torque, PERIOD).position
    return Recording(t=t, position=np.append(0.0, after[:-1]) + noise, torque=torque, source="bag")


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    believed = Axis("test", 1000.0, friction())
    return diagnose([recorded(believed.with_effect(magnet()))], AxisFile(believed))


def test_it_is_named_with_its_numbers(found: Diagnosis) -> None:
    print(found.statement)
    (item,) = found.effects
    assert (item.effect, item.equivalent) == ("guide_magnet", ())
    assert item.parameters["pull"]["value"] == pytest.approx(PULL, rel=0.02)
    assert item.parameters["spot"]["value"] == pytest.approx(SPOT, abs=0.02 * REACH)
    assert item.parameters["reach"]["value"] == pytest.approx(REACH, rel=0.02)
    assert found.axis_file.axis.friction.values["creep"] == 0.02  # the law said that it is fixed
    assert found.improved.held_out < 1.2 * found.noise_floor < found.retuned.held_out


def test_the_sentence_and_the_place_follow_its_declaration(found: Diagnosis) -> None:
    assert "guide magnet (pull 25" in found.statement
    assert "reach" not in found.statement
    (item,) = found.effects
    assert item.where["coordinate"] == "position"
    assert item.where["range"] == pytest.approx([SPOT - REACH, SPOT + REACH], abs=1e-3)
    assert item.where == where(item.instance, found.axis_file.axis)


def test_the_report_has_it_and_its_picture(found: Diagnosis, tmp_path: Path) -> None:
    write_diagnosis(tmp_path, found)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "guide magnet" in page
    (isolated,) = found.evidence.isolated
    assert (isolated.effect, isolated.coordinate) == ("guide_magnet", "position")
    assert "guide magnet" in isolated.title
    assert np.abs(isolated.fitted).max() == pytest.approx(PULL, rel=0.05)


@pytest.mark.parametrize("stiff", ["law", "effect"])
def test_a_stiff_one_is_integrated_finely_enough(stiff: str) -> None:
    """At the rate that it declares. Steps as long as for any axis are in error by three parts in a thousand or more."""
    if stiff == "law":
        axis = Axis("stiff", 1.0, friction(creep=1e-3))
    else:
        axis = Axis("stiff", 0.1, friction(creep=0.1), (magnet(-3000.0, 1e-5).replace(spot=0.004),))
    torque = 150.0 * np.sin(2.0 * np.pi * 2.0 * PERIOD * np.arange(300))
    count = substeps_for(axis, PERIOD)
    longest, usual, fine = (
        simulate_open_loop(axis, torque, PERIOD, n).position for n in (round(PERIOD / LONGEST_STEP), count, 10 * count)
    )
    assert np.abs(longest - fine).max() > 3e-3 * np.ptp(fine)
    assert np.abs(usual - fine).max() < 1e-4 * np.ptp(fine)


def test_what_it_needs_bars_it() -> None:
    """Without a reversal a magnet might be a bias anywhere it was passed."""
    to_and_fro = recorded(Axis("test", 1000.0, friction()), 10.0)
    t = to_and_fro.t
    ahead = replace(to_and_fro, position=0.05 * t + 1e-3 * np.sin(2.0 * t) + 1e-7 * np.sin(1e4 * t**2))
    axis = Axis("test", 1000.0, friction())
    assert "guide_magnet" in barred(lacking(prepare([ahead]), axis))
    assert "guide_magnet" not in barred(lacking(prepare([to_and_fro]), axis))


def test_effects_that_complete_a_law_complete_this_one() -> None:
    """It declares neither a Stribeck drop nor bristles; with them on the axis they are redundant."""
    balance = TorqueBalance(prepare([recorded(Axis("test", 1000.0, friction()), 10.0)]))
    axis = Axis("test", 1000.0, friction())
    drop = instance(effect("stribeck"), {"drop": 20.0, "stribeck_velocity": 0.01})
    names, fewer = ({term.id for term, _ in eligible(x, balance)} for x in (axis, axis.with_effect(drop)))
    assert {"stribeck", "presliding", "guide_magnet"} <= names
    assert names - fewer == {"stribeck"}
