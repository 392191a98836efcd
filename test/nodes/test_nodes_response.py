"""The plant's frequency response through the graph: reference, controller and plant are nodes, the bag is what they said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_nodes_lockstep import Ears

from tcs_friction.cli import main
from tcs_friction.config import load_axis, save_axis, shipped
from tcs_friction.physics.registry import effect
from tcs_friction.physics.terms import instance
from tcs_friction.recording.encode import encoded, joint_states
from tcs_friction.recording.write import EPOCH, write_bag

SECONDS = 24.0
MODE = {"frequency": 22.0, "damping": 0.03, "inertia_ratio": 0.3}
MULTISINE = (
    "reference: {kind: multisine, velocity_amplitude: 3.0e-5, lowest_frequency: 1.0, frequency_step: 0.5, "
    f"components: 80, speed: 1.7453e-2, duration: {SECONDS}}}\n"
)
SWEEP = (
    "reference: {kind: swept_sine, velocity_amplitude: 4.0e-4, lowest_frequency: 1.0, highest_frequency: 40.0, "
    f"sweep: {SECONDS}, speed: 1.7453e-2, duration: {SECONDS}}}\n"
)


def heard_bag(ears: Ears, path: Path) -> None:
    """What went over the topics, as a recorder writes it."""
    stamps = sorted(set(ears.heard["joint_states"]) & set(ears.heard["reference"]))
    times = EPOCH + np.array(stamps)
    states = np.array([ears.heard["joint_states"][stamp] for stamp in stamps]).T
    wanted = np.array([ears.heard["reference"][stamp][0] for stamp in stamps])
    joint = dict(zip(("position", "velocity", "effort"), states, strict=True))
    reference = encoded("/azimuth/reference", "tcs_friction_msgs/msg/AxisReference", times, {"position": wanted})
    write_bag(path, [joint_states("/azimuth/joint_states", times, {"azimuth": joint}), reference])


@pytest.mark.parametrize(("excitation", "flexible"), [(MULTISINE, True), (SWEEP, False)])
def test_a_graph_that_is_excited_tells_its_plant(
    together: Callable[..., Any], tmp_path: Path, excitation: str, flexible: bool
) -> None:
    file = load_axis(shipped("azimuth_1p2m.yaml"))
    mode = instance(effect("flexible_mode"), MODE)
    axis = replace(file.axis, effects=(*file.axis.effects, mode) if flexible else file.axis.effects)
    save_axis(tmp_path / "axis.yaml", replace(file, axis=axis))
    (tmp_path / "reference.yaml").write_text(excitation)
    graph = together(
        "-p", f"axis:={tmp_path / 'axis.yaml'}", "-p", f"reference_file:={tmp_path / 'reference.yaml'}",
        "-p", "start_position:=0.0", "-p", f"run_until:={SECONDS}",
    )  # fmt: skip
    ears = Ears(graph)
    last = round(SECONDS * 1e9)
    assert graph.until(lambda: last in ears.heard["joint_states"], 120.0)
    heard_bag(ears, tmp_path / "bag")
    words = ["response", str(tmp_path / "bag"), "--axis", str(shipped("azimuth_1p2m.yaml")), "-o", str(tmp_path / "out")]
    assert main([*words, "--lowest", "1.5", "--highest", "40"]) == 0
    result = json.loads((tmp_path / "out" / "response.json").read_text())
    coherence = np.array(result["response"]["coherence"])
    assert np.mean(coherence > 0.9) > 0.5
    found = {form: model["parameters"] for form, model in result["models"].items()}
    if flexible:
        for name, value in MODE.items():
            assert found["two_inertias"][name]["value"] == pytest.approx(value, rel=0.1 if name != "damping" else 0.4), name
        assert found["two_inertias"]["inertia"]["value"] == pytest.approx(axis.inertia, rel=0.03)
        assert result["models"]["two_inertias"]["misfit"] < 0.3 * result["models"]["second_order"]["misfit"]
    else:
        assert found["second_order"]["first"]["value"] == pytest.approx(axis.inertia, rel=0.02)
        assert found["second_order"]["delay"]["value"] == pytest.approx(0.0, abs=3e-4)
    assert (tmp_path / "out" / "response.png").is_file()
    assert ("spring" in (tmp_path / "out" / "report.html").read_text().split("</header>")[0]) == flexible
