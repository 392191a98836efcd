"""Tables with units: out and back in the same; what people write in spreadsheets is understood or refused by name."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from recording_samples import SIGNALS, TOPIC, samples, write

from tcs_friction import cli
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.tables import export_table, import_table

AXIS = f"""
axis:
  name: azimuth
  kind: rotary
  inertia: 1000.0
  friction: {{law: coulomb_viscous, coulomb: 78.1, viscous: 572.0}}
signals:
  position: {{topic: {TOPIC}, field: position, joint: azimuth}}
  torque: {{topic: {TOPIC}, field: effort, joint: azimuth}}
  velocity: {{topic: {TOPIC}, field: velocity, joint: azimuth}}
"""


def recording(count: int = 100) -> Recording:
    t = np.arange(count) * 1e-3
    return Recording(
        t, np.sin(t), np.cos(t), np.sqrt(t), t * 2, t / 3, {"wind": t * 7}, (slice(0, 40), slice(50, count))
    )


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_holds_the_recording_with_units(suffix: str, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow" if suffix == ".parquet" else "csv")
    path = tmp_path / f"table{suffix}"
    export_table(recording(), path)
    back = import_table(path, "azimuth", {})
    for name in ("position", "torque", "velocity", "temperature", "reference"):
        assert np.array_equal(getattr(back.recording, name), getattr(recording(), name)), name
    assert np.array_equal(back.recording.exogenous["wind"], recording().exogenous["wind"])
    assert np.allclose(back.recording.t, recording().t, atol=1e-9)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_columns_are_named_with_units_and_segments_counted(tmp_path: Path) -> None:
    export_table(recording(), tmp_path / "a.csv", "linear")
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == [
        "time [s]", "position [m]", "torque [N]", "velocity [m/s]", "temperature [degC]", "reference [m]", "wind", "segment",
    ]  # fmt: skip
    assert [int(rows[place]["segment"]) for place in (0, 39, 40, 49, 50, 99)] == [0, 0, -1, -1, 1, 1]


def test_a_spreadsheet_in_other_units_and_commas(tmp_path: Path) -> None:
    path = tmp_path / "sheet.csv"
    rows = ["Time (ms);Angle [deg];torque_mnm;Speed [rpm];room", "0;0,5;100;60;20", "1;1,5;200;60;21"]
    path.write_text("\n".join([*rows, "2;bad;300;60;22", "3;3,5;400;60;23", ""]))
    imported = import_table(path, "pendulum", {})
    back = imported.recording
    assert np.allclose(back.t, [0, 0.001, 0.003])
    assert np.allclose(back.position, np.radians([0.5, 1.5, 3.5]))
    assert np.allclose(back.torque, [0.1, 0.2, 0.4])
    assert back.velocity is not None
    assert np.allclose(back.velocity, 2 * np.pi)
    assert back.exogenous["room"].tolist() == [20.0, 21.0, 23.0]
    assert "position: 1 of 4 samples missing or not finite, cut as gaps" in back.notes
    assert imported.signals.torque.joint == "pendulum"


@pytest.mark.parametrize(
    ("text", "chosen", "said"),
    [
        ("", {}, "0 lines"),
        ("t,position\n0,1\n1,2\n", {}, "no torque, expected a column of that name, or --column torque=COLUMN"),
        ("t,position,torque\n0,1\n", {}, "row 2: 2 cells, expected 3"),
        ("t,t,torque\n0,1,2\n", {}, "columns with the same name"),
        ("t,position [furlong],torque\n0,1,2\n1,2,3\n", {}, "holds the position in 'furlong', expected one of rad"),
        ("t,a,b\n0,1,2\n1,2,3\n", {"position": "a", "torque": "c"}, "no column 'c', expected"),
        ("t,a,b\n0,1,2\n1,2,3\n", {"positon": "a"}, "no signal 'positon', expected position"),
        ("t,position,torque\nx,1,2\ny,2,3\n", {}, "0 messages with"),
    ],
)
def test_bad_tables_are_refused_by_name(text: str, chosen: dict[str, str], said: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        import_table(path, "axis", chosen)
    assert said in str(caught.value)
    assert "bad.csv" in str(caught.value)


def test_other_suffixes_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"suffix '.xlsx', expected \.csv or \.parquet"):
        export_table(recording(), tmp_path / "a.xlsx")
    with pytest.raises(InputError, match="does not exist"):
        import_table(tmp_path / "a.csv", "axis", {})
    assert not list(tmp_path.iterdir())


def run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    status = cli.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return status, out, err


def test_the_command_exports_and_imports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write("mcap", tmp_path / "bag", samples(100))
    (tmp_path / "axis.yaml").write_text(AXIS)
    table, again = tmp_path / "out" / "a.csv", tmp_path / "again"
    status, out, _ = run(capsys, "bag", "export", bag, "--axis", tmp_path / "axis.yaml", "-o", table)
    assert (status, out) == (0, f"{table}: 100 samples, 0.099 s\n")
    status, out, _ = run(capsys, "bag", "import", table, "-o", again, "--axis", tmp_path / "axis.yaml", "--json")
    assert status == 0
    assert json.loads(out)["samples"] == 100
    first, second = read_recordings([bag, again], SIGNALS)
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(first.torque, second.torque)
    status, out, _ = run(capsys, "bag", "import", table, "-o", tmp_path / "third", "--joint", "pan")
    assert "joint: pan" in out
    status, _, err = run(capsys, "bag", "import", table, "-o", again)
    assert (status, err.count("\n")) == (2, 1)
    assert "exists already" in err
    status, _, err = run(capsys, "bag", "import", table, "-o", tmp_path / "x", "--column", "position")
    assert (status, "SIGNAL=COLUMN" in err) == (2, True)


def test_the_command_tells_what_is_in_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    messages = samples(1000)
    del messages[400:500]
    del messages[700:703]
    bag = write("mcap", tmp_path / "bag", messages)
    status, out, _ = run(capsys, "bag", "info", bag, "--json")
    assert status == 0
    info = json.loads(out)
    (topic,) = info["topics"]
    assert (topic["topic"], topic["type"], topic["count"]) == (TOPIC, "sensor_msgs/msg/JointState", 897)
    assert (topic["rate"], topic["stamps"], topic["gaps"], topic["missing"]) == (1000.0, "header", 1, 103)
    assert topic["longest_gap"] == pytest.approx(0.101)
    assert info["signals"]["torque"] == {"topic": TOPIC, "field": "effort", "joint": "azimuth"}
    assert info["signals"]["exogenous"]["elevation_velocity"]["joint"] == "elevation"
    status, out, _ = run(capsys, "bag", "info", bag)
    assert "gaps: 1, longest 0.101 s; missing: 103" in out
    assert "position: {topic: /joint_states, field: position, joint: azimuth}" in out


def test_the_command_tells_of_damage_and_of_no_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write("mcap-bare", tmp_path / "bag", samples(400))
    bag.write_bytes(bag.read_bytes()[:30_000])
    status, out, _ = run(capsys, "bag", "info", bag)
    assert status == 0
    assert "damaged: the end of the file is missing; lost: an unknown number of messages" in out
    status, out, err = run(capsys, "bag", "info", tmp_path / "none")
    assert (status, out, err.count("\n")) == (2, "", 1)


def test_the_proposal_fits_the_shared_recordings(shared_data: Path) -> None:
    import yaml

    from tcs_friction.recording.info import bag_info

    for folder in sorted((shared_data / "data").iterdir()):
        if (folder / "axis.yaml").exists():
            known = yaml.safe_load((folder / "axis.yaml").read_text())["signals"]
            proposed = bag_info(folder / "recording").signals
            assert {name: proposed[name] for name in known} == known
