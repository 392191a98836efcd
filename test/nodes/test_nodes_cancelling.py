"""Commissioning that diagnoses: what is named is tried, what tracking is better with is kept, and a restart loses nothing."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.action import ActionClient
from tcs_friction_msgs.action import Commission as CommissionAction

from tcs_friction.commissioning.journal import STATE
from tcs_friction.commissioning.run import Run
from tcs_friction.config import AxisFile, load_axis, save_axis
from tcs_friction.control.reference import load_reference
from tcs_friction.diagnose.outcome.result import SCHEMA
from tcs_friction.nodes.core.jobs import Waiter
from tcs_friction.nodes.graph import GRAPH
from tcs_friction.physics.axis import Axis
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.report.diagnosis_files import EXPERIMENT

CONFIG = Path(__file__).resolve().parents[2] / "config"
MODELLED = ("controller", "dob", "lugre_compensator")
RIPPLE = {"order": 7200.0, "amplitude": 3.0, "phase": 1.0}  # 2 Hz at the speed of the run
TELLS_NOTHING = {"order": 7200.0, "amplitude": -3.0, "phase": 1.0}
ENCODER = {"order": 12000.0, "amplitude": 2.0e-6, "phase": 0.5}  # 3.3 Hz at the speed of the run


class Diagnosed:
    """In place of a diagnosis, which has tests of its own: writes the files of one that finds what it is told."""

    def __init__(self, *found: Mapping[str, Mapping[str, float]] | list[dict[str, float]]) -> None:
        """What each diagnosis finds: effects by id, or several coggings."""
        self.found = [
            list(one.items()) if isinstance(one, Mapping) else [("cogging", values) for values in one] for one in found
        ]
        self.asked: list[tuple[list[str], AxisFile]] = []

    def __call__(self, request: Any, _live: Any, file: AxisFile, _progress: Any) -> Any:
        number = len(self.asked)
        self.asked.append(([Path(bag).name for bag in request.bags], file))
        effects = self.found[number] if number < len(self.found) else []
        items = tuple(instance(effect(name), values) for name, values in effects)
        return Found(replace(file, axis=replace(file.axis, effects=(*file.axis.effects, *items))), effects)


class Found:
    """As much of a diagnosis as the node asks for."""

    def __init__(self, file: AxisFile, effects: Sequence[tuple[str, Mapping[str, float]]]) -> None:
        self.axis_file = file
        self.verdict = "missing_physics" if effects else "match"
        self.statement = f"found {', '.join(name for name, _ in effects) or 'nothing'}"
        self.effects: list[Any] = []
        self.content = {
            "schema": SCHEMA,
            "effects": [
                {"effect": name, "parameters": {key: {"value": value, "std": 0.01} for key, value in values.items()}}
                for name, values in effects
            ],
            "described": [],
        }


def written(directory: Path, found: Found) -> None:
    (directory / "diagnosis.json").write_text(json.dumps(found.content))
    save_axis(directory / "axis.yaml", found.axis_file)


@pytest.fixture
def commissioned(
    together: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Any, Diagnosed]]:
    """A graph whose plant has a ripple and whose diagnoser finds what the test says."""

    def make(*found: Any, **settings: Any) -> tuple[Any, Diagnosed]:
        from tcs_friction.nodes.analysis import diagnoser

        told = Diagnosed(*found)
        monkeypatch.setattr(diagnoser, "diagnosed", told)
        monkeypatch.setattr(diagnoser, "write_diagnosis", written)
        run, measure = tmp_path / "run.yaml", tmp_path / "measure.yaml"
        run.write_text("reference: {kind: legs, speed: 1.7453293e-3, leg: 2.0, acceleration: 5.0e-3, duration: 9.0}\n")
        measure.write_text("reference: {kind: sinusoid, amplitude: 3.0e-3, period: 10.0, duration: 12.0}\n")
        file = load_axis(CONFIG / "azimuth_1p2m.yaml")
        effects = tuple(instance(effect("cogging"), values) for values in settings.pop("plant", (RIPPLE,)))
        effects += tuple(instance(effect("encoder_periodic_error"), values) for values in settings.pop("encoder", ()))
        save_axis(tmp_path / "plant.yaml", file.with_axis(replace(file.axis, effects=effects)))
        values = {"axis": tmp_path / "plant.yaml", "reference_file": run, "measure_file": measure, "settle": 1.0, "period": 0.004}
        values |= {"run_until": 0.0, "answer_limit": 3.0, "results": tmp_path, "trials": 1, "diagnoses": 2} | settings
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        return together(*words, nodes=GRAPH), told

    return make


def commission(graph: Any, directory: str, cancel_when: Callable[[str], bool] | None = None) -> Any:
    """The ended goal: status and result."""
    waiter, client = Waiter(graph.driver), ActionClient(graph.driver, CommissionAction, "commission/commission")
    heard: list[str] = []

    async def act() -> Any:
        assert await waiter.until(client.server_is_ready, 20.0)
        sent = client.send_goal_async(
            CommissionAction.Goal(directory=directory), feedback_callback=lambda message: heard.append(message.feedback.stage)
        )
        await waiter.until(sent.done, 20.0)
        finished = sent.result().get_result_async()
        if cancel_when is not None:
            await waiter.until(lambda: any(map(cancel_when, heard)), 120.0)
            sent.result().cancel_goal_async()
        await waiter.until(finished.done, 200.0)
        return finished.result()

    return graph.result(act(), 200.0)


def models(graph: Any) -> set[tuple[str, tuple[str, ...]]]:
    return {(graph[name].config.model, tuple(graph[name].config.left_out)) for name in MODELLED}


def assert_read_back(graph: Any, out: Path, names: Sequence[str]) -> None:
    """Runs that are read from their bags are what they were when they were made."""
    for name in names:
        run = graph["commission"].runs[name]
        again = Run.read(out / name, "azimuth", "/azimuth", list(run.topics))
        assert again.topics.keys() == run.topics.keys()
        for topic, columns in run.topics.items():
            for one, other in zip(columns, again.topics[topic], strict=True):
                assert np.array_equal(one, other), (name, topic)


def test_what_is_found_is_cancelled_and_what_does_not_help_is_put_back(
    commissioned: Callable[..., Any], tmp_path: Path
) -> None:
    """One name is right, and one is wrong: a ripple of the same size that is not there. So is what a second round finds."""
    wrong = {"order": 5000.0, "amplitude": 6.0, "phase": 0.0}
    graph, told = commissioned({"cogging": RIPPLE, "torque_ripple": {**wrong, "amplitude": 0.04}}, [wrong])
    result = commission(graph, "out").result
    assert result.success, result.message
    assert list(result.cancelled) == ["cogging"]
    out = tmp_path / "out"
    content = json.loads((out / "commission.json").read_text())
    first, friction, found, ideal = (content[name]["rms"] for name in ("before", "after", "found", "ideal"))
    assert first > friction > 2.0 * found
    assert found < 1.5 * ideal
    assert result.rms_after == pytest.approx(found * np.pi / 648000.0)
    cogging, ripple, later = content["effects"]
    assert cogging["cancelled"]
    assert cogging["gain"]["between"][1] < 0.9
    for one in (ripple, later):
        assert (one["cancelled"], one["why_not"]) == (False, "tracking is not measurably better with it")
    assert content["statements"] == ["found cogging, torque_ripple", "found cogging"]
    assert models(graph) == {(str(out / "model.yaml"), ())}
    assert graph["lugre_compensator"].config.switch3
    assert [item.order for item in load_axis(out / "model.yaml").axis.effects] == [7200.0]
    bags, file = told.asked[0]
    assert bags == ["measure", "before", "after"]
    assert file.axis.effects == (), "nobody tells the diagnosis what the simulated plant has"
    assert file.axis.friction.values["coulomb"] == pytest.approx(78.1, rel=0.05)
    assert {"trial_1_1", "trial_1_2", "trial_1_3"} <= {path.name for path in out.iterdir()}
    assert not (out / STATE).exists()


def test_what_a_second_round_finds_is_cancelled_beside_what_the_first_one_kept(
    commissioned: Callable[..., Any], tmp_path: Path
) -> None:
    """The first round also names a cogging that is not there, so that the names of the others change."""
    slower, wrong = {"order": 3600.0, "amplitude": 6.0, "phase": 0.0}, {"order": 5000.0, "amplitude": 3.0, "phase": 0.0}
    graph, told = commissioned([wrong, RIPPLE], [slower], plant=(RIPPLE, slower), diagnoses=3)
    result = commission(graph, "out").result
    assert result.success, result.message
    orders = [[item.order for item in file.axis.effects] for _, file in told.asked]
    assert orders == [[], [7200.0], [7200.0, 3600.0]], "what was put back is not believed"
    content = json.loads((tmp_path / "out/commission.json").read_text())
    assert content["found"]["rms"] < 0.5 * content["after"]["rms"]
    assert sorted(load_axis(tmp_path / "out/model.yaml").axis.effects[k].order for k in (0, 1)) == [3600.0, 7200.0]
    told_of = sorted((entry["cancelled"], entry["gain"] is not None) for entry in content["effects"])
    assert told_of == [(False, True), (True, True), (True, True)]
    assert content["statements"][-1] == "found nothing"


def test_a_wrong_diagnosis_changes_nothing_that_was_verified(commissioned: Callable[..., Any], tmp_path: Path) -> None:
    graph, _ = commissioned({"cogging": TELLS_NOTHING})
    result = commission(graph, "out").result
    assert result.success
    assert list(result.cancelled) == []
    content = json.loads((tmp_path / "out/commission.json").read_text())
    assert content["found"] is None
    assert result.rms_after == pytest.approx(content["after"]["rms"] * np.pi / 648000.0)
    assert models(graph) == {("", ())}
    assert graph["lugre_compensator"].config.switch3, "friction is compensated"
    assert graph["lugre_compensator"].config.positive.coulomb == result.parameters.positive.coulomb
    assert_read_back(graph, tmp_path / "out", ("before", "measure", "after"))


def test_an_error_of_the_encoder_with_the_wrong_sign_is_not_corrected(commissioned: Callable[..., Any], tmp_path: Path) -> None:
    wrong = {**ENCODER, "amplitude": -ENCODER["amplitude"]}
    graph, _ = commissioned({"encoder_periodic_error": wrong}, plant=(), encoder=(ENCODER,))
    result = commission(graph, "out").result
    assert result.success, result.message
    (entry,) = json.loads((tmp_path / "out/commission.json").read_text())["effects"]
    assert (entry["cancelled"], entry["why_not"]) == (False, "a recording made after the diagnosis does not show it")
    for name in ("controller", "dob"):
        model = graph[name].config.model
        assert not model or load_axis(Path(model)).axis.effects == ()


def test_an_error_of_the_encoder_is_corrected_where_a_fresh_recording_shows_it(
    commissioned: Callable[..., Any], tmp_path: Path
) -> None:
    """The tracking error is measured by the encoder itself and says nothing of it; the torque's effect beside it is tracked."""
    graph, told = commissioned({"cogging": RIPPLE, "encoder_periodic_error": ENCODER}, encoder=(ENCODER,))
    result = commission(graph, "out").result
    assert result.success, result.message
    assert sorted(result.cancelled) == ["cogging", "encoder_periodic_error"]
    assert models(graph) == {(str(tmp_path / "out/model.yaml"), ())}
    content = json.loads((tmp_path / "out/commission.json").read_text())
    gains = {entry["name"]: entry["gain"] for entry in content["effects"]}
    assert {name: gain["of"] for name, gain in gains.items()} == {"cogging": "tracking", "encoder_periodic_error": "torque"}
    assert gains["encoder_periodic_error"]["between"][1] < 0.9
    assert (tmp_path / "out/check_1").is_dir()
    assert content["found"]["rms"] < 0.6 * content["after"]["rms"]
    believed = sorted(item.term.id for item in told.asked[1][1].axis.effects)
    assert believed == ["cogging", "encoder_periodic_error"], "what is known is believed"


def test_a_motion_is_made_for_a_diagnosis_and_the_next_one_may_ask_for_another(
    commissioned: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = tmp_path / "motion.yaml"
    motion.write_text("reference: {kind: sinusoid, amplitude: 2.0e-3, period: 4.0, duration: 4.0}\n")
    graph, told = commissioned({"cogging": RIPPLE}, diagnose_file=motion)

    def asking(directory: Path, found: Found) -> None:
        written(directory, found)
        (directory / EXPERIMENT).write_text("reference: {kind: sinusoid, amplitude: 4.0e-3, period: 6.0, duration: 6.0}\n")

    from tcs_friction.nodes.analysis import diagnoser

    monkeypatch.setattr(diagnoser, "write_diagnosis", asking)
    assert commission(graph, "out").result.success
    assert [bags for bags, _ in told.asked] == [["diagnose_1"], ["diagnose_1", "diagnose_2"]]
    durations = [run.topics["joint_states"][0][-1] for run in (graph["commission"].runs[f"diagnose_{k}"] for k in (1, 2))]
    assert durations == [4.0, 6.0]
    assert [item.term.id for item in told.asked[1][1].axis.effects] == ["cogging"], "what is known is believed"


def test_cancelled_in_a_trial_it_leaves_what_was_verified_and_goes_on_when_asked_again(
    commissioned: Callable[..., Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    graph, told = commissioned({"cogging": RIPPLE})
    ended = commission(graph, "out", lambda stage: stage.startswith("trying"))
    assert "was cancelled" in ended.result.message
    assert graph["lugre_compensator"].config.switch3, "compensating friction had been verified"
    assert models(graph) == {("", ())}
    assert (tmp_path / "out" / STATE).is_file()
    before = (tmp_path / "out/before").stat().st_mtime_ns
    result = commission(graph, "out").result
    assert result.success, result.message
    assert list(result.cancelled) == ["cogging"]
    assert (tmp_path / "out/before").stat().st_mtime_ns == before, "made once"
    assert len(told.asked) == 2, "the first diagnosis was not made again"
    assert "goes on after before, measure, identification, after, diagnosis_1" in capfd.readouterr().err


def test_other_settings_do_not_go_on_with_what_was_begun(commissioned: Callable[..., Any], tmp_path: Path) -> None:
    graph, _ = commissioned({"cogging": RIPPLE})
    (tmp_path / "out").mkdir()
    state = {"schema": "tcs_friction/commission_state/1", "settings": {"axis": "other"}, "done": {"before": True}}
    (tmp_path / "out" / STATE).write_text(json.dumps(state))
    result = commission(graph, "out").result
    assert not result.success
    assert "begun with other settings" in result.message
    (tmp_path / "out" / STATE).write_text("{")
    assert "is no state of a commissioning" in commission(graph, "out").result.message


def test_without_a_diagnoser_it_is_refused_before_anything_moves(together: Callable[..., Any], tmp_path: Path) -> None:
    nodes = [name for name in GRAPH if name != "diagnoser"]
    graph = together("-p", "run_until:=0.0", "-p", "answer_limit:=1.0", "-p", f"results:={tmp_path}", nodes=nodes)
    result = commission(graph, "out").result
    assert result.message == "diagnoser: not there within 1 s, expected the node to run, or parameter diagnoses to be 0"
    assert list(tmp_path.iterdir()) == []


def test_shipped_motion_for_a_diagnosis_keeps_the_controllers_limit() -> None:
    axis: Axis = load_axis(CONFIG / "azimuth_1p2m.yaml").axis
    reference = load_reference(CONFIG / "azimuth_1p2m_diagnose.yaml")
    speeds = np.abs(reference.over(np.linspace(0.0, reference.duration, 10_000))[:, 1])
    control = load_axis(CONFIG / "azimuth_1p2m.yaml").control
    assert control is not None
    assert speeds.max() < control.controller.velocity_limit
    assert axis.kind == "rotary"
