"""Models of other people: only the joint changes, nothing is doubled, what was there is said, and the engine has the friction."""

from __future__ import annotations

import difflib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_axes import axis

from tcs_friction.config import load_axis, shipped
from tcs_friction.errors import InputError
from tcs_friction.export import mjcf
from tcs_friction.export.curve import fitted
from tcs_friction.export.formats import format_named
from tcs_friction.export.request import Exported, Request
from tcs_friction.export.xml_edit import Document
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import law, laws
from tcs_friction.physics.steady_friction import steady
from tcs_friction.physics.terms import instance

URDF = """<?xml version="1.0"?>
<robot name="r"> <!-- mine -->
  <link name="a"/><link name="b"/>
  <joint name='azimuth' type='revolute'>
    <parent link="a"/><child link="b"/>
    <limit lower="-1" upper="1" effort="9" velocity="2"/>{dynamics}
  </joint>
  <joint name="fixed" type="fixed"><parent link="b"/><child link="c"/></joint>
</robot>
"""
SDF = """<sdf version="1.10"><model name="m">
  <joint name="azimuth" type="revolute">
    <axis><xyz>0 0 1</xyz><limit><lower>-1</lower></limit>{dynamics}</axis>
  </joint>
  <joint name="bare" type="revolute"/>
</model></sdf>
"""
MJCF = """<mujoco>
  <!-- mine -->
  <worldbody>
    <body><joint name="azimuth" axis="0 0 1"{joint}/><inertial pos="0 0 0" mass="1" diaginertia="90 90 90"/></body>
    <body><joint name="slide" type="slide"/><geom size="1"/></body>
  </worldbody>{more}
</mujoco>
"""
TEXTS = {"urdf": URDF, "sdf": SDF}
SIMPLE = Axis("azimuth", 100.0, instance(law("coulomb_viscous"), {"coulomb": 60.0, "viscous": 50.0}))


def into(folder: Path, to: str, text: str, of: Axis = SIMPLE, **changes: object) -> Exported:
    path = folder / f"user.{to}"
    path.write_text(text)
    request = Request(of, Path("axis.yaml"), folder / f"better.{to}", path, "azimuth")
    exported = format_named(to).export(replace(request, **changes))  # type: ignore[arg-type]
    for name, content in exported.files.items():
        assert isinstance(content, str)
        name.write_text(content)
    return exported


def content(exported: Exported) -> str:
    (text,) = exported.files.values()
    assert isinstance(text, str)
    return text


def changed(before: str, after: str) -> list[str]:
    """Lines that are new or gone."""
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


@pytest.mark.parametrize(
    ("to", "dynamics", "there"),
    [
        ("urdf", "", ""),
        ("urdf", '\n    <dynamics friction="0.5"/>', "was there: friction 0.5"),
        ("urdf", "\n    <dynamics damping='1' friction='2'></dynamics>", "was there: damping 1, friction 2"),
        ("sdf", "", ""),
        ("sdf", "<dynamics/>", ""),
        ("sdf", "<dynamics><damping>1</damping></dynamics>", "was there: damping 1"),
    ],
)
def test_dynamics_are_changed_and_not_doubled(to: str, dynamics: str, there: str, tmp_path: Path) -> None:
    before = TEXTS[to].format(dynamics=dynamics)
    first = into(tmp_path, to, before)
    text = content(first)
    numbers = dict(re.findall(r"(damping|friction)(?:=[\"']|>)([\d.]+)", text))
    assert float(numbers["damping"]) == pytest.approx(50.0, rel=1e-6)
    assert float(numbers["friction"]) == pytest.approx(60.0, rel=1e-6)
    assert text.count("<dynamics") == text.count("damping") // (2 if to == "sdf" else 1) == 1
    assert (first.lines[0] == there) if there else not first.lines[0].startswith("was")
    assert sum(line.startswith("-") for line in changed(before, text)) <= 2, "all else stays"
    again = into(tmp_path, to, text)
    assert content(again) == text
    assert again.lines[0].startswith("was there: ")
    assert "damping 50" in again.lines[0]


def test_sdf_has_a_spring(tmp_path: Path) -> None:
    found = into(tmp_path, "sdf", SDF.format(dynamics=""), axis("coulomb_viscous", "cable_wrap"), travel=(-0.2, 0.4))
    text = content(found)
    assert float(re.findall(r"<spring_reference>(.*)</", text)[0]) == pytest.approx(0.1)
    assert float(re.findall(r"<spring_stiffness>(.*)</", text)[0]) == pytest.approx(50.0, rel=0.02)
    assert any(
        re.match(r"cable wrap: as a linear spring, 0\.\d+ % of its torque left over from -0.2", line) for line in found.lines
    )


@pytest.mark.parametrize("to", ["urdf", "sdf"])
@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (("azimuth", "elevation"), "no joint azimuth, expected"),
        (("revolute", "ball"), "joint azimuth is ball, expected the kind of the axis, rotary"),
        (("revolute", "prismatic"), "joint azimuth is prismatic"),
        (("\n", "<"), "no XML"),
        (("robot", "sdf"), "its root is <sdf>, expected <robot>"),
        (("<link", '<joint name="azimuth" type="revolute"/><link'), "joint azimuth twice"),
        (("sdf version", "model version"), "no XML"),
    ],
)
def test_a_model_that_does_not_fit_is_refused(to: str, broken: tuple[str, str], words: str, tmp_path: Path) -> None:
    text = TEXTS[to].format(dynamics="")
    if broken[0] not in text:
        return
    with pytest.raises(InputError, match=re.escape(words)):
        into(tmp_path, to, text.replace(*broken))
    assert not (tmp_path / f"better.{to}").exists()


def test_a_joint_without_an_axis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="joint bare has no <axis>"):
        into(tmp_path, "sdf", SDF.format(dynamics=""), joint="bare")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<!DOCTYPE a><mujoco/>", "has a DOCTYPE"),
        ("<a>" * 500 + "</a>" * 500, "tags 400 deep|its root"),
        ("<mujoco>", "no XML"),
        ("<a/>", "its root is <a>"),
    ],
)
def test_hostile_xml_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Document(text, "x", "mujoco")


def test_edits_keep_quotes_and_values_with_brackets() -> None:
    text = "<a  b='1 > 0'\n   c=\"2\" ><!-- <d/> --><d/>\n<e/></a>"
    document = Document(text, "x", "a")
    document.set(document.root, c='3"', f="4")
    document.remove(document.root.all("e")[0])
    document.add(document.root.all("d")[0], "<g/>")
    assert document.changed() == "<a  b='1 > 0'\n   c='3\"' f=\"4\"><!-- <d/> --><d>\n  <g/>\n</d>\n</a>"


@pytest.mark.parametrize("to", ["urdf", "sdf", "mjcf", "fmu", "modelica"])
def test_a_torque_in_ampere_is_refused(to: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its torque is in A, expected N m or N"):
        into(
            tmp_path, to, URDF, replace(SIMPLE, torque_unit="A"), **({} if to in ("urdf", "sdf", "mjcf") else {"into": None})
        )


def test_the_model_must_be_named_and_readable(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--into: is missing"):
        into(tmp_path, "urdf", URDF, into=None)
    with pytest.raises(InputError, match="cannot be read"):
        into(tmp_path, "urdf", URDF, into=tmp_path / "nowhere")


def test_a_fit_says_how_far_it_is_off() -> None:
    exact = fitted(SIMPLE, 1.0, 1)
    assert (exact.dry, *exact.damping) == pytest.approx((60.0, 50.0))
    assert exact.off < 1e-9
    bent = axis("stribeck_static", "viscous_asymmetry", "quadratic_drag")
    found = fitted(bent, 1.0, 1)
    speeds = np.linspace(0.005, 1.0, 200)
    bare = replace(bent, effects=bent.effects[1:])
    friction = steady(bare, speeds)
    off = np.abs(found.dry + found.damping[0] * speeds - friction) / friction
    assert found.off == pytest.approx(off.max(), rel=0.02)
    assert found.uneven == pytest.approx(20.0 * np.sqrt(np.mean(speeds**2)), rel=1e-6)
    assert fitted(bent, 1.0, 3).off < found.off


mujoco = pytest.importorskip("mujoco", reason="of the optional set mujoco")


def friction_of(text: str, speeds: np.ndarray) -> np.ndarray:
    """What the engine's joint azimuth opposes in steady sliding at these speeds, N m."""
    found = []
    for speed in speeds:
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.timestep, model.opt.gravity[:] = 1e-4, 0.0
        data = mujoco.MjData(model)
        joint = int(model.joint("azimuth").dofadr[0])
        for _ in range(round(0.02 / speed / 1e-4) + 400):
            data.qvel[joint] = speed  # whatever the friction does to it
            mujoco.mj_step(model, data)
        data.qvel[joint] = speed
        mujoco.mj_forward(model, data)
        found.append(-data.qfrc_passive[joint] - data.qfrc_actuator[joint] - data.qfrc_constraint[joint])
    return np.array(found)


@pytest.mark.parametrize("name", sorted(set(laws()) - {"bam"}))
def test_the_engine_has_the_friction_over_speed(name: str, tmp_path: Path) -> None:
    found = into(tmp_path, "mjcf", MJCF.format(joint="", more=""), axis(name), speed=0.5)
    speeds = np.array([0.1, 0.25, 0.5])
    expected = steady(axis(name), speeds)
    text = content(found)
    stated = float(re.findall(r"at most ([\d.e-]+) % off", "\n".join(found.lines))[0]) / 100.0
    assert friction_of(text, speeds) == pytest.approx(expected, rel=max(0.01, stated))
    if name in ("lugre", "dahl_viscous", "maxwell_slip", "coulomb_viscous"):
        assert stated < 0.01


def test_mjcf_gets_bristles_cogging_springs_and_bias(tmp_path: Path) -> None:
    of = axis("lugre", "cogging", "cable_wrap", "torque_bias", "coulomb_asymmetry", "imbalance", "torque_ripple")
    found = into(tmp_path, "mjcf", MJCF.format(joint="", more=""), replace(of, actuation_delay=1e-3))
    lines = "\n".join(found.lines)
    for words in (
        "difference between directions: not expressed",
        "gravity, the model has its own",
        "torque ripple of order 30: not expressed",
        "actuation delay of 1 ms: not expressed",
        "inertia: 100 kg m^2 where the model had 90 kg m^2, as armature 10",
    ):
        assert words in lines
    model = mujoco.MjModel.from_xml_string(content(found))
    data = mujoco.MjData(model)
    places = np.linspace(-1.0, 1.0, 41)
    torque = []
    for place in places:
        data.qpos[0] = place
        mujoco.mj_forward(model, data)
        torque.append(-data.qfrc_passive[0] - data.qfrc_actuator[0])
    wave = 20.0 * np.cos(24.0 * places + 0.3) + 4.0 * np.cos(48.0 * places + 1.0)
    expected = wave + 50.0 * (places - 0.1) + 9.0 * (places - 0.1) ** 3 + 12.0
    assert np.abs(np.array(torque) - expected).max() < 0.01 * np.abs(expected).max()


def test_mjcf_that_has_friction_is_changed_and_not_doubled(tmp_path: Path) -> None:
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    before = shipped("mount_two_axis.xml").read_text()
    found = into(tmp_path, "mjcf", before, file.axis, speed=0.05)
    text = content(found)
    assert "was there: dcmotor azimuth_friction with lugre 2.96e5 3.4e4 78.1 117.2 6.1e-4, damping 572 0 0" in found.lines
    assert text.count("lugre=") == before.count("lugre=") == 2
    assert text.count("cogging=") == before.count("cogging=") == 1
    assert re.findall("<!--.*?-->", text, re.DOTALL) == re.findall("<!--.*?-->", before, re.DOTALL)
    assert all("azimuth" in line or "lugre" in line for line in changed(before, text) if line[0] != "?")
    assert content(into(tmp_path, "mjcf", text, file.axis, speed=0.05)) == text
    back = mjcf.read_axis(text, "x", "azimuth", file.axis)
    assert dict(back.friction.values) == pytest.approx(dict(file.axis.friction.values), rel=1e-6), "the way back"


def test_mjcf_without_bristles_gets_frictionloss_and_loses_old_motors(tmp_path: Path) -> None:
    motor = '<dcmotor name="old" joint="azimuth" motorconst="1e-9" resistance="1" input="none" lugre="1 1 1 1 1"/>'
    old = MJCF.format(joint=' damping="9" stiffness="3" springref="7"', more=f"<actuator>{motor}</actuator>")
    found = into(tmp_path, "mjcf", old)
    text = content(found)
    assert "lugre" not in text
    values = mjcf.read(text, "x", "azimuth")
    assert values["frictionloss"] == pytest.approx((60.0,))
    assert values["damping"] == pytest.approx((50.0,))
    assert values["stiffness"] == (0.0,)
    assert dict(mjcf.read_axis(text, "x", "azimuth", SIMPLE).friction.values) == pytest.approx(dict(SIMPLE.friction.values))
    assert found.lines[0] == "was there: joint azimuth with damping 9, stiffness 3, springref 7"


def test_a_default_of_the_model_is_overruled(tmp_path: Path) -> None:
    default = '<default><joint frictionloss="5" stiffness="2"/></default>'
    found = into(tmp_path, "mjcf", MJCF.format(joint="", more=default), axis("lugre"))
    values = mjcf.read(content(found), "x", "azimuth")
    assert values["frictionloss"] == values["stiffness"] == (0.0,)
    assert "was there: a default for joints with frictionloss, stiffness" in found.lines


def test_without_bristles_in_the_engine_it_is_coulomb_and_viscous(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjcf, "PROBE", "<mujoco><nothing/></mujoco>")
    found = into(tmp_path, "mjcf", MJCF.format(joint="", more=""), axis("lugre", "cogging"))
    assert mjcf.read(content(found), "x", "azimuth").keys() == {"damping", "frictionloss", "armature"}
    assert any("pre-sliding is not expressed" in line for line in found.lines)
    assert any("cogging of order 24: not expressed (amplitude 20 N m)" in line for line in found.lines)


@pytest.mark.parametrize(
    ("joint", "broken", "words"),
    [
        ("elevation", ("", ""), "no joint elevation, expected"),
        ("slide", ("", ""), "joint slide is a slide, expected the kind of the axis, rotary"),
        ("azimuth", ('name="azimuth"', 'name="other"'), "no joint azimuth"),
        ("other", ("<worldbody>", '<include file="robot.xml"/><worldbody>'), "it includes robot.xml, which may have it"),
    ],
)
def test_a_joint_that_cannot_be_the_axis_is_refused(joint: str, broken: tuple[str, str], words: str, tmp_path: Path) -> None:
    text = MJCF.format(joint="", more="")
    with pytest.raises(InputError, match=re.escape(words)):
        into(tmp_path, "mjcf", text.replace(*broken) if broken[0] else text, joint=joint)


def test_a_model_heavier_than_the_axis_keeps_its_armature(tmp_path: Path) -> None:
    found = into(tmp_path, "mjcf", MJCF.format(joint=' armature="1"', more=""), replace(SIMPLE, inertia=50.0))
    assert any("more than the 50 kg m^2 found; armature as it was" in line for line in found.lines)
    assert mjcf.read(content(found), "x", "azimuth")["armature"] == (1.0,)
