"""A joint of a MuJoCo model as the simulated axis: the engine's motion under the axis file's drive, seen by its encoder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.config import default_control
from tcs_friction.control.loop import LoopConfig, simulate_loop
from tcs_friction.control.reference import reference_from_mapping
from tcs_friction.errors import InputError, JobError
from tcs_friction.physics.axis import Axis, Drive, Sensors
from tcs_friction.physics.mujoco_axis import MujocoSimulator
from tcs_friction.physics.registry import effect, law
from tcs_friction.physics.simulate import Simulator
from tcs_friction.physics.terms import instance

pytest.importorskip("mujoco", reason="of the optional set mujoco")

PERIOD = 1e-3  # s
INERTIA = 2.0  # kg m^2
LUGRE = (1e5, 4e2, 1.0, 1.5, 1e-2)  # stiffness, damping, coulomb, static, stribeck_velocity
FRICTION = instance(law("coulomb_viscous"), {"coulomb": 1.0, "viscous": 0.5})


def axis(**changes: object) -> Axis:
    parts: dict[str, object] = {"name": "test", "inertia": INERTIA, "friction": FRICTION}
    return Axis(**(parts | changes))  # type: ignore[arg-type]


def model(folder: Path, joint: str = 'type="hinge" axis="0 0 1"', inside: str = "", more: str = "", option: str = "") -> Path:
    """One body of INERTIA (mass as well) on a joint named test, with RK4 at 1 ms and no gravity."""
    path = folder / "model.xml"
    path.write_text(f"""<mujoco><compiler angle="radian"/>
<option timestep="1e-3" integrator="RK4" gravity="0 0 0" {option}/>
<worldbody><body><joint name="test" {joint}/>
<inertial pos="0 0 0" mass="{INERTIA}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>{inside}</body></worldbody>{more}</mujoco>""")
    return path


def friction() -> str:
    values = " ".join(map(str, LUGRE))
    motor = 'motorconst="1e-9" resistance="1" input="none"'
    return f'<actuator><dcmotor name="friction" joint="test" {motor} lugre="{values}" damping="0.5 0 0"/></actuator>'


@pytest.mark.parametrize("kind", ["rotary", "linear"])
def test_a_free_body_gets_the_impulse(tmp_path: Path, kind: str) -> None:
    joint = 'type="hinge" axis="0 0 1"' if kind == "rotary" else 'type="slide" axis="1 0 0"'
    simulator = MujocoSimulator(axis(kind=kind), model(tmp_path, joint), "test", PERIOD)
    torque = np.random.default_rng(0).uniform(-3.0, 3.0, 200)
    for one in torque:
        assert simulator.step(float(one)) == one
    assert simulator.inertia == pytest.approx(INERTIA, rel=1e-12)
    assert simulator.velocity == pytest.approx(torque.sum() * PERIOD / INERTIA, rel=1e-9)
    assert simulator.opposing == pytest.approx(0.0, abs=1e-12)


def test_friction_of_the_engine_holds_up_to_its_static_level(tmp_path: Path) -> None:
    path = model(tmp_path, more=friction())

    def travelled(torque: float) -> float:
        simulator = MujocoSimulator(axis(), path, "test", PERIOD)
        for k in range(4000):  # slowly, so that the bristle's own damping takes no part
            simulator.step(torque * min(1.0, k / 3000))
        return simulator.position

    assert abs(travelled(1.4)) < 1e-3
    assert travelled(1.6) > 1e-2


def test_gravity_is_an_opposing_torque(tmp_path: Path) -> None:
    mass, arm = 3.0, 0.4
    weight = f'<body><inertial pos="{arm} 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    path = model(tmp_path, 'type="hinge" axis="0 -1 0"', weight)
    path.write_text(path.read_text().replace('gravity="0 0 0"', 'gravity="0 0 -9.81"'))
    simulator = MujocoSimulator(axis(), path, "test", PERIOD, position=0.3)
    for _ in range(20):
        simulator.step(mass * 9.81 * arm * math.cos(simulator.position))
    assert simulator.opposing == pytest.approx(mass * 9.81 * arm * math.cos(0.3), rel=1e-4)
    assert simulator.position == pytest.approx(0.3, abs=1e-6)


def test_the_encoder_and_its_speed_are_the_axis_file_s(tmp_path: Path) -> None:
    """Under the same torque a free body on the engine and in the own simulator are read alike, noise and steps included."""
    nothing = instance(law("coulomb_viscous"), {"coulomb": 1e-12, "viscous": 0.0})
    seen = Sensors(resolution=1e-4, noise=3e-4, velocity_bandwidth=50.0)
    free = axis(friction=nothing, sensors=seen, drive=Drive(limit=2.0, noise=0.3, noise_bandwidth=10.0))
    one = MujocoSimulator(free, model(tmp_path), "test", PERIOD, seed=5, position=0.2)
    other = Simulator(free, PERIOD, seed=5, position=0.2)
    for k in range(300):
        torque = 3.0 * math.sin(0.05 * k)
        assert one.step(torque) == other.step(torque)
        assert one.measured_position == pytest.approx(other.measured_position, abs=1.01e-4)
        assert one.measured_position / 1e-4 == pytest.approx(round(one.measured_position / 1e-4), abs=1e-6)
    assert one.velocity == pytest.approx(other.velocity, rel=1e-5)


@pytest.mark.parametrize("delay", [0.003, 0.0035])
def test_torque_acts_after_the_actuation_delay(tmp_path: Path, delay: float) -> None:
    path = model(tmp_path)
    path.write_text(path.read_text().replace('timestep="1e-3"', 'timestep="2e-4"'))
    late = MujocoSimulator(axis(actuation_delay=delay), path, "test", PERIOD)
    for _ in range(5):
        late.step(0.0)
    for _ in range(10):
        late.step(1.0)
    assert late.velocity == pytest.approx((10 * PERIOD - delay) / INERTIA, rel=0.02)


def test_the_engine_takes_whole_steps_of_a_period_no_longer_than_its_own(tmp_path: Path) -> None:
    path = model(tmp_path)
    assert MujocoSimulator(axis(), path, "test", 2.5e-3)._model.opt.timestep == pytest.approx(2.5e-3 / 3)
    assert MujocoSimulator(axis(), path, "test", 1e-4)._model.opt.timestep == pytest.approx(1e-4)


def test_same_seed_same_motion_bit_for_bit(tmp_path: Path) -> None:
    noisy = axis(drive=Drive(noise=0.3), sensors=Sensors(noise=1e-5))

    def motion(seed: int) -> list[tuple[float, float]]:
        simulator = MujocoSimulator(noisy, model(tmp_path, more=friction()), "test", PERIOD, seed)
        return [(simulator.step(2.0), simulator.measured_position) for _ in range(100)]

    assert motion(1) == motion(1)
    assert motion(1) != motion(2)


def test_what_the_axis_file_says_of_effects_and_signals_is_not_simulated(tmp_path: Path) -> None:
    wind = instance(effect("wind_torque"), {"coefficient": 5.0}, signal="wind")
    simulator = MujocoSimulator(axis(effects=(wind,)), model(tmp_path), "test", PERIOD)
    simulator.step(0.0, 50.0, (20.0,))
    assert (simulator.position, simulator.friction) == (0.0, 0.0)


def test_other_joints_begin_at_home_and_their_actuators_keep_their_controls(tmp_path: Path) -> None:
    arm = '<body><joint name="arm" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    more = """<actuator><position joint="arm" kp="10" kv="5"/></actuator>
<keyframe><key name="home" qpos="0 0.7" ctrl="0.7"/></keyframe>"""
    path = model(tmp_path, inside=arm, more=more)
    simulator = MujocoSimulator(axis(), path, "test", PERIOD, position=0.1)
    assert simulator.other_joints == ("arm",)
    for _ in range(100):
        simulator.step(0.0)
    assert simulator.other_positions() == pytest.approx((0.7,))
    assert simulator.other_velocities() == pytest.approx((0.0,), abs=1e-12)
    path.write_text(path.read_text().replace("home", "elsewhere"))
    assert MujocoSimulator(axis(), path, "test", PERIOD).other_positions() == (0.0,)


@pytest.mark.parametrize("servo", ['position name="servo" joint="test" kp="50"', 'velocity name="servo" joint="test" kv="50"'])
def test_a_servo_of_the_joint_is_switched_off_and_a_passive_spring_is_not(tmp_path: Path, servo: str) -> None:
    spring = '<general name="spring" joint="test" gainprm="0" biastype="affine" biasprm="0 -8 0"/>'
    simulator = MujocoSimulator(axis(), model(tmp_path, more=f"<actuator>{spring}<{servo}/></actuator>"), "test", PERIOD)
    assert [note.split(" is ")[0] for note in simulator.notes] == ["actuator servo"]
    for _ in range(round(math.pi * math.sqrt(INERTIA / 8.0) / PERIOD)):  # half a period of the spring
        simulator.step(1.0)
    assert simulator.position == pytest.approx(2.0 / 8.0, rel=1e-3)
    assert simulator.opposing == pytest.approx(2.0, rel=1e-2)


def test_the_loop_moves_it_as_it_moves_the_same_axis(tmp_path: Path) -> None:
    values = dict(zip(("stiffness", "damping", "coulomb", "static", "stribeck_velocity"), LUGRE, strict=True))
    same = axis(friction=instance(law("lugre"), {**values, "viscous": 0.5}), drive=Drive(noise=0.05))
    path = model(tmp_path, more=friction())
    path.write_text(path.read_text().replace('timestep="1e-3"', 'timestep="1e-4"'))
    reference = reference_from_mapping({"kind": "sinusoid", "amplitude": 0.05, "period": 1.0, "duration": 1.5}, "test")
    controller = default_control(same).controller

    def plant(of: Axis, period: float, seed: int, position: float) -> Simulator:
        return MujocoSimulator(of, path, "test", period, seed, position)

    config = LoopConfig(PERIOD)
    ours = simulate_loop(same, reference, controller, config)
    engines = simulate_loop(same, reference, controller, config, plant=plant)
    assert np.std(ours.torque) > 1.0
    assert np.std(engines.torque - ours.torque) < 0.02 * np.std(ours.torque)
    assert np.std(engines.error - ours.error) < 0.02 * np.std(ours.error)


def test_what_cannot_be_the_axis_is_named(tmp_path: Path) -> None:
    path = model(tmp_path)
    ball = model(tmp_path, 'type="ball"')
    other = '<body><joint name="test" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    for where, joint, of, words in (
        (tmp_path / "nothing.xml", "test", axis(), "nothing.xml: no such file, expected a model of MuJoCo"),
        (ball, "test", axis(), "joint test is neither a hinge nor a slide"),
        (path, "test", axis(), "joint test is neither"),
    ):
        with pytest.raises(InputError, match=words):
            MujocoSimulator(of, where, joint, PERIOD)
    path = model(tmp_path)
    for joint, of, words in (
        ("tset", axis(), "no joint tset, expected test"),
        ("test", axis(kind="linear"), "joint test is a hinge, expected kind: rotary in the axis file; it says linear"),
    ):
        with pytest.raises(InputError, match=words):
            MujocoSimulator(of, path, joint, PERIOD)
    path = model(tmp_path, inside=other.replace("test", "other"))
    with pytest.raises(InputError, match="joint other would be published as test, the name of another joint"):
        MujocoSimulator(axis(), path, "other", PERIOD)
    with pytest.raises(InputError, match="period"):
        MujocoSimulator(axis(), path, "test", 0.0)
    with pytest.raises(InputError, match="a finite number of N m"):
        MujocoSimulator(axis(), path, "test", PERIOD).step(math.nan)


def test_a_bad_file_is_one_line_with_the_engine_s_words(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text("<mujoco><worldbodies/></mujoco>")
    with pytest.raises(InputError, match=r"not read by MuJoCo .*unrecognized element.*line 1") as caught:
        MujocoSimulator(axis(), path, "test", PERIOD)
    assert "\n" not in str(caught.value)


def test_an_unstable_model_says_so_and_leaves_no_log_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    simulator = MujocoSimulator(axis(), model(tmp_path), "test", PERIOD)
    with pytest.raises(JobError, match=r"became unstable at 0\.0\d+ s"):
        sum(simulator.step(1e30) for _ in range(20))
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


def test_a_missing_package_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(InputError, match=r"MuJoCo: the package is not installed, expected .*pip install mujoco"):
        MujocoSimulator(axis(), model(tmp_path), "test", PERIOD)
