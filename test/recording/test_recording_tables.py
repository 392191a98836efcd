"""Tables with units: out and back in the same; what people write in spreadsheets is understood or refused by name."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest
from recording_samples import SIGNALS, TOPIC, samples, write

from tcs_friction import cli
from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.info import bag_info
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.table_text import read_text
from tcs_friction.recording.tables import export_table, import_table
from tcs_friction.recording.write import EPOCH

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
    assert "mended: position: 1 of 4 samples missing or not finite, cut as gaps" in back.notes
    assert imported.signals.torque.joint == "pendulum"


@pytest.mark.parametrize(
    ("text", "chosen", "said"),
    [
        ("", {}, "0 lines"),
        ("t,position\n0,1\n1,2\n", {}, "no torque, expected a column of that name, or --column torque=COLUMN"),
        ("t,position,torque\n0,1\n", {}, "row 2: 2 cells, expected 3"),
        ("t,t,torque\n0,1,2\n", {}, "2 columns with the same name 't', expected a name for each"),
        ("t,position [furlong],torque\n0,1,2\n1,2,3\n", {}, "holds the position in 'furlong', expected one of rad"),
        ("t,a,b\n0,1,2\n1,2,3\n", {"position": "a", "torque": "c"}, "no column 'c', expected"),
        ("t,a,b\n0,1,2\n1,2,3\n", {"positon": "a"}, "no signal 'positon', expected position"),
        ("t,position,torque\nx,1,2\ny,2,3\n", {}, "times such as 'x' cannot be read in column 't', expected numbers, h:m:s"),
    ],
)
def test_bad_tables_are_refused_by_name(text: str, chosen: dict[str, str], said: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        import_table(path, "axis", chosen)
    assert said in str(caught.value)
    assert "bad.csv" in str(caught.value)


def test_times_that_cannot_be_seconds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time [s],position [rad],torque [N m]\n0,0,0\n1e300,1,1\n")
    with pytest.raises(InputError, match=r"a\.csv: times are 1e\+300 s apart, expected seconds, 1e\+09 at most"):
        import_table(path, "azimuth", {})


def test_other_suffixes_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"suffix '.xlsx', expected \.csv or \.parquet"):
        export_table(recording(), tmp_path / "a.xlsx")
    with pytest.raises(InputError, match="no such file"):
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
    assert info["signals"]["exogenous"]["elevation_position"]["field"] == "position"
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


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("torque [N m]", "torque [mNm]"), "2 columns for torque: 'torque [N m]' and 'torque [mNm]', expected one, or --column"),
        (("position [rad]", "angle [deg]", "torque"), "2 columns for position: 'position [rad]' and 'angle [deg]'"),
        (("torque [s]",), "column 'torque [s]' holds the torque in 's', expected one of Nm, mNm, kNm"),
        (("torque [MNm]",), "holds the torque in 'MNm', expected"),
        (("position [rad]", "torque [N]"), "holds the torque in 'N', expected Nm"),
        (("torque", "wind [m/s]", "wind (km/h)"), "columns 'wind [m/s]' and 'wind (km/h)' would both be signal wind"),
        (("torque", "position!"), "2 columns for position: 'position' and 'position!', expected one"),
    ],
)
def test_two_columns_for_one_signal_and_units_of_something_else_are_refused(
    names: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    columns = ["time [s]", *(() if any(name.startswith(("position [", "angle")) for name in names) else ("position",)), *names]
    path = tmp_path / "two.csv"
    path.write_text("\n".join([",".join(columns), *(",".join([str(row)] * len(columns)) for row in range(5))]))
    with pytest.raises(InputError) as caught:
        import_table(path, "axis", {})
    assert said in str(caught.value)


def test_of_two_columns_the_chosen_one_is_taken_and_the_other_named(tmp_path: Path) -> None:
    path = tmp_path / "two.csv"
    path.write_text("time [s],position [rad],torque [N m],torque [mNm]\n0,1,2,3\n1,2,3,4\n")
    back = import_table(path, "axis", {"torque": "torque [mNm]"}).recording
    assert back.torque.tolist() == [0.003, 0.004]
    assert "column 'torque [N m]' left out: torque is 'torque [mNm]'" in back.notes
    with pytest.raises(InputError, match="chosen for two signals"):
        import_table(path, "axis", {"torque": "torque [mNm]", "position": "torque [mNm]"})
    words = ["bag", "import", str(path), "-o", str(tmp_path / "bag"), "--column", "torque=a", "--column", "torque=b"]
    assert cli.main(words) == 2


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [("K", 293.15, 20.0), ("degF", 68.0, 20.0), ("°C", 20.0, 20.0), ("C", 20.0, 20.0)],
)
def test_temperatures_have_other_zeros(unit: str, value: float, expected: float, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"time [s],position [rad],torque [N·m],temperature [{unit}]\n0,1,2,{value}\n1,2,3,{value}\n")
    temperature = import_table(path, "axis", {}).recording.temperature
    assert temperature is not None
    assert temperature == pytest.approx(expected)


def test_the_axis_file_says_which_kind_of_units(tmp_path: Path) -> None:
    path = tmp_path / "linear.csv"
    path.write_text("time [s],position [mm],force [kN]\n0,1,2\n1,2,3\n")
    assert import_table(path, "axis", {}, kind="linear").recording.torque.tolist() == [2000.0, 3000.0]
    with pytest.raises(InputError, match="holds the position in 'mm'"):
        import_table(path, "axis", {}, kind="rotary")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_dates_of_a_parquet_file_are_seconds(unit: str, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = [1_700_000_000 * per_second + second * per_second for second in range(50)]
    columns = {
        "time": pyarrow.array(stamps, pyarrow.timestamp(unit, tz="UTC")),
        "position": pyarrow.array(range(50)),
        "torque": pyarrow.array([1.5] * 50),
        "comment": pyarrow.array(["x"] * 50),
    }
    path = tmp_path / "dates.parquet"
    parquet.write_table(pyarrow.table(columns), path)
    back = import_table(path, "axis", {}).recording
    assert back.duration == 49.0
    assert "column 'comment' holds no numbers (string), left out" in back.notes
    with pytest.raises(InputError, match="holds the torque in 's'"):
        import_table(path, "axis", {"torque": "time", "time": "position", "position": "torque"})


def test_a_parquet_file_that_unpacks_to_a_flood_is_refused(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "flood.parquet"
    zeros = pyarrow.array(np.zeros(4_000_000))
    parquet.write_table(pyarrow.table({f"c{n}": zeros for n in range(4)}), path)
    assert path.stat().st_size < 200_000
    with pytest.raises(InputError, match="unpacks to at most 100 times its size"):
        import_table(path, "axis", {})


@pytest.mark.parametrize("head", ["a," * 5000, "a" * 300, '"' + "a" * 200_000])
def test_absurd_heads_are_refused(head: str, tmp_path: Path) -> None:
    path = tmp_path / "head.csv"
    path.write_text(head + "\n1,2\n")
    with pytest.raises(InputError):
        import_table(path, "axis", {})


def test_a_table_that_is_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="is no regular file"):
        import_table(tmp_path / "pipe.csv", "axis", {})


def test_no_cell_is_a_formula(tmp_path: Path) -> None:
    """What a spreadsheet would run is quoted, and read back under its own name; numbers stay numbers."""
    t = np.arange(5.0)
    evil = '=HYPERLINK("http://example.org")'
    export_table(Recording(t, -t, t, exogenous={evil: t, "@SUM(1)": t, "+1": t, "-1": t}), tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as stream:
        head, *rows = csv.reader(stream)
    assert not [cell for cell in head if cell.startswith(("=", "+", "-", "@"))]
    assert f"'{evil}" in head
    assert rows[1][1] == "-1.0"
    assert evil in read_text(tmp_path / "a.csv").columns


@pytest.mark.parametrize("link", [False, True])
def test_no_command_writes_over_its_input(link: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own, bag = tmp_path / "own", write("mcap", tmp_path / "bag", samples(50))
    own.mkdir()
    text = AXIS + "# the user's own comment\n"
    given = own / "axis.yaml"
    given.write_text(text)
    if link:
        given = tmp_path / "linked.yaml"
        given.symlink_to(own / "axis.yaml")
    for command in ("identify", "diagnose", "calibrate"):
        assert cli.main([command, str(bag), "--axis", str(given), "-o", str(own)]) == 2
        assert f"would be written over the input {given}" in capsys.readouterr().err
    (own / "report.html").write_text(text)
    assert cli.main(["response", str(bag), "--axis", str(own / "report.html"), "-o", str(own)]) == 2
    table = tmp_path / "axis.csv"
    table.write_text(text)
    assert cli.main(["bag", "export", str(bag), "--axis", str(table), "-o", str(table)]) == 2
    inside = bag / "metadata.csv"
    (bag / "metadata.yaml").rename(inside)
    assert cli.main(["bag", "export", str(bag), "--axis", str(given), "-o", str(inside)]) == 2
    assert [path.read_text() for path in (own / "axis.yaml", own / "report.html", table)] == [text] * 3
    assert sorted(path.name for path in own.iterdir()) == ["axis.yaml", "report.html"]


def test_a_table_serves_where_a_bag_does(tmp_path: Path) -> None:
    """With the signals of the axis file: columns that it does not know are left out and told."""
    table = tmp_path / "run.csv"
    export_table(recording(), table)
    (back,) = read_recordings([table], SIGNALS)
    assert np.array_equal(back.position, recording().position)
    assert np.array_equal(back.torque, recording().torque)
    assert any("wind" in note for note in back.notes)


def test_a_table_without_a_torque_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "run.csv"
    table.write_text("time [s],position [rad]\n0,0\n1,1\n")
    with pytest.raises(InputError, match="torque"):
        read_recordings([table], SIGNALS)


@pytest.mark.parametrize(
    ("first", "start"), [("1743382799.25", 1743382799.25), ("2026-11-01T00:00:01Z", 1793491201.0), ("0.5", EPOCH / 1e9)]
)
def test_the_date_of_a_table_is_that_of_its_bag(first: str, start: float, tmp_path: Path) -> None:
    if first.startswith("20"):
        times = [f"2026-11-01T00:00:{k + 1:02d}Z" for k in range(50)]
    else:
        times = [f"{float(first) + 0.25 * k}" for k in range(50)]
    path = tmp_path / "a.csv"
    path.write_text("time,position [rad],torque [Nm]\n" + "".join(f"{time},{k % 7},{k % 5}\n" for k, time in enumerate(times)))
    assert cli.main(["bag", "import", str(path), "-o", str(tmp_path / "bag")]) == 0
    assert bag_info(tmp_path / "bag").start == pytest.approx(start, abs=1e-6)



@pytest.mark.parametrize("by", ["position", "nothing"])
def test_rows_in_no_order_of_time_are_sorted(by: str, tmp_path: Path) -> None:
    t = 0.01 * np.arange(2000)
    order = np.argsort(np.cos(t)) if by == "position" else np.random.default_rng(0).permutation(len(t))
    rows = "".join(f"{t[k]:.2f},{np.cos(t[k]):.9g},{np.sin(t[k]):.9g}\n" for k in order)
    (tmp_path / "a.csv").write_text("time [s],position [rad],torque [N m]\n" + rows)
    found = import_table(tmp_path / "a.csv", "", {}).recording
    assert [note for note in found.notes if note.startswith("mended")] == ["mended: rows are in no order of time, sorted by it"]
    assert np.abs(found.position - np.cos(t)).max() < 1e-8


def test_a_table_whose_clock_was_set_back_is_cut_there(tmp_path: Path) -> None:
    t = 0.01 * np.tile(np.arange(500), 3)
    rows = "".join(f"{one:.2f},{np.cos(one):.9g},{np.sin(one):.9g}\n" for one in t)
    (tmp_path / "a.csv").write_text("time [s],position [rad],torque [N m]\n" + rows)
    found = import_table(tmp_path / "a.csv", "", {}).recording
    assert any("clock set back 2 times" in note for note in found.notes)
    assert len(found.t) == 1500
