"""Tables as people have them: what names, units and times say, in every kind of file, or one line on what is missing."""

from __future__ import annotations

import gzip
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.errors import InputError
from tcs_friction.recording.bags import read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.recording import Recording
from tcs_friction.recording.signals import SignalMap
from tcs_friction.recording.table_names import Said, said
from tcs_friction.recording.tables import Imported, import_table

T = np.arange(50) * 0.004
Q, U = np.sin(T), np.cos(T)
START = 1_793_494_770  # s since 1970: 2026-11-01T00:59:30Z
HEAD = ("time [s]", "position [rad]", "torque [N m]")
BY_NUMBER = {"time": "1:s", "position": "2:rad", "torque": "3:Nm"}
SIGNALS: dict[str, dict[str, object]] = {
    "position": {"topic": "/joint_states", "field": "position", "joint": "az"},
    "torque": {"topic": "/joint_states", "field": "effort", "joint": "az"},
}


def text(columns: Sequence[np.ndarray], head: Sequence[str] = (), separator: str = ",", comma: str = ".", end: str = "") -> str:
    rows = [[f"{x:.17g}".replace(".", comma) for x in row] for row in zip(*columns, strict=True)]
    rows = [list(head), *rows] if head else rows
    return "".join(separator.join(row) + end + "\n" for row in rows)


def read(
    path: Path, content: str | bytes, chosen: Mapping[str, str] | None = None, joint: str = "", block: object = None
) -> Imported:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    signals = SignalMap.from_mapping(block, "axis.yaml") if isinstance(block, dict) else None
    return import_table(path, joint, chosen or {}, signals)


def right(found: Recording, t: np.ndarray = T) -> bool:
    return (
        np.allclose(found.t, t, atol=1e-6)
        and np.allclose(found.position, Q, atol=1e-9)
        and np.allclose(found.torque, U, atol=1e-9)
        and len(found.segments) == 1
    )


QUOTED = "\n".join(",".join(f'"{x:.12g}"'.replace(".", ",") for x in row) for row in zip(T, Q, U, strict=True))


@pytest.mark.parametrize(
    ("name", "content", "chosen"),
    [
        ("trailing.csv", text([T, Q, U], HEAD, end=",,"), {}),
        ("trailing_in_the_heading.csv", text([T, Q, U], [*HEAD, "", ""]), {}),
        ("trailing_in_the_rows.csv", ",".join(HEAD) + "\n" + text([T, Q, U], end=","), {}),
        ("none.csv", text([T, Q, U]), BY_NUMBER),
        ("none_with_decimal_commas.csv", text([T, Q, U], separator=";", comma=","), BY_NUMBER),
        ("none_with_blanks.txt", text([T, Q, U], separator="   "), BY_NUMBER),
        ("quoted.csv", '"time [s]","position [rad]","torque [N m]"\n' + QUOTED, {}),
        ("semicolons.csv", text([T, Q, U], HEAD, ";", ","), {}),
        ("tabs.tsv", text([T, Q, U], HEAD, "\t", ","), {}),
        ("blanks.txt", text([T, Q, U], HEAD, "  "), {}),
        ("savetxt.txt", "# time [s]  position [rad]  torque [N m]\n" + text([T, Q, U], separator=" "), {}),
        ("utf16.csv", text([T, Q, U], HEAD).encode("utf-16"), {}),
        ("utf16_without_mark.csv", text([T, Q, U], HEAD).encode("utf-16-le"), {}),
        ("utf16_big.csv", text([T, Q, U], HEAD).encode("utf-16-be"), {}),
        ("latin.csv", text([T, np.degrees(Q), U], ("t/s", "angle [°]", "torque [N·m]")).encode("latin-1"), {}),
        ("windows.csv", text([T, Q, U], HEAD).replace("\n", "\r\n"), {}),
        ("packed.csv.gz", gzip.compress(text([T, Q, U], HEAD).encode()), {}),
        ("units.csv", "time,position,torque\nms,deg,mNm\n" + text([1e3 * T, np.degrees(Q), 1e3 * U]), {}),
        ("in_brackets.csv", "time;position;torque\n[ms];[°];[kN·m]\n" + text([1e3 * T, np.degrees(Q), 1e-3 * U], (), ";"), {}),
        ("units_of_some.csv", "time,position,torque\nms,-,mN m\n" + text([1e3 * T, Q, 1e3 * U]), {}),
        ("names.csv", text([1e6 * T, np.degrees(Q), 1e3 * U], ("t_us", "az_act_deg", "drive_torque_mnm")), {}),
        ("camel.csv", text([1e3 * T, Q, U], ("timeMs", "actualPosition", "motorTorqueNm")), {}),
        ("chosen.csv", text([1e3 * T, np.degrees(Q), U], ("a", "b", "c")), {"time": "a:ms", "position": "b:deg", "torque": "c"}),
        ("overruled.csv", text([T, np.degrees(Q), U], HEAD), {"position": "position [rad]:deg"}),
        ("milliseconds.csv", text([4000.0 * T[:50] / 4, Q, U], ("time", "position", "torque")), {}),
        ("microseconds.csv", text([1e6 * T, Q, U], ("time", "position", "torque")), {}),
        ("nanoseconds.csv", text([1e9 * T, Q, U], ("time", "position", "torque")), {}),
        ("by_speed.csv", text([25e3 * T, np.sin(25 * T), np.cos(25 * T), U], ("time", "x_position", "x_velocity", "torque")), {}),
    ],
)
def test_tables_of_every_kind_are_read(name: str, content: str | bytes, chosen: dict[str, str], tmp_path: Path) -> None:
    found = read(tmp_path / name, content, chosen).recording
    if name == "by_speed.csv":  # steps of 100 could be milli- or microseconds; positions and velocities tell
        assert np.allclose(found.t, 25 * T)
        return
    assert right(found)


@pytest.mark.parametrize(
    ("factor", "told"), [(1.0, ""), (1e3, "counts ms since 1970"), (1e6, "counts us since 1970"), (1e9, "counts ns since 1970")]
)
def test_times_since_1970_tell_their_unit_and_the_date(factor: float, told: str, tmp_path: Path) -> None:
    found = read(tmp_path / "a.csv", text([factor * (START + T), Q, U], ("time", "position", "torque"))).recording
    assert found.start == pytest.approx(START * 10**9, abs=1000)
    assert np.allclose(found.t, T, atol=1e-6)
    assert any(told in note and "mended" in note for note in found.notes) == bool(told)


@pytest.mark.parametrize(
    ("form", "start"),
    [
        ("2026-11-01T00:59:{:09.6f}+00:00", START),
        ("2026-11-01T01:59:{:09.6f}+01:00", START),
        ("2026-11-01 00:59:{:09.6f}Z", START),
        ("2026/11/01 00:59:{:09.6f} UTC", START),
        ("2026-11-01 00:59:{:09.6f}", START),
        ("00:59:{:09.6f}", 0),
        ("59:{:09.6f}", 0),
    ],
)
def test_times_in_words_are_read(form: str, start: int, tmp_path: Path) -> None:
    rows = "".join(f"{form.format(30 + t)},{q:.12g},{u:.12g}\n" for t, q, u in zip(T, Q, U, strict=True))
    found = read(tmp_path / "a.csv", "time,position [rad],torque [N m]\n" + rows).recording
    assert right(found)
    assert found.start == start * 10**9
    assert any("without a zone" in note for note in found.notes) == (form.endswith("f}") and start > 0)


def test_a_second_column_of_dates_is_no_signal(tmp_path: Path) -> None:
    rows = "".join(f"2026-11-01,{t:.6f},{q!r},{u!r}\n" for t, q, u in zip(T, Q.tolist(), U.tolist(), strict=True))
    found = read(tmp_path / "a.csv", "Date,time [s],position [rad],torque [N m]\n" + rows).recording
    assert right(found)
    assert not found.exogenous


def test_a_clock_may_pass_midnight_and_zones_may_change(tmp_path: Path) -> None:
    samples = list(zip(T, Q, U, strict=True))
    rows = [f"{'23:59:59' if t < 0.1 else '00:00:00'}.{round(900 + 1e3 * t) % 1000:03d},{q},{u}" for t, q, u in samples]
    found = read(tmp_path / "a.csv", "\n".join(["time,position [rad],torque [N m]", *rows])).recording
    assert right(found)
    assert any("mended: the clock passes midnight" in note for note in found.notes)
    zones = [f"2026-10-25T0{2 + (t < 0.1)}:00:{t:09.6f}+0{1 + (t < 0.1)}:00,{q},{u}" for t, q, u in samples]
    assert right(read(tmp_path / "b.csv", "\n".join(["time,position [rad],torque [N m]", *zones])).recording)


@pytest.mark.parametrize(
    ("content", "chosen", "message"),
    [
        (text([T, Q, U]), {}, "has no heading; its 3 columns begin with 0, 0, 1, expected --column time=1"),
        (text([T, Q, U]), {"time": "1", "position": "4"}, "no column '4', expected one of 1, 2, 3"),
        (text([25e3 * T, Q, U], ("time", "position", "torque")), {}, "steps of 100, ms or us, expected the unit: --column time="),
        (text([250 * T, Q, U], ("time", "position", "torque")), {}, "steps of 1, s or ms, expected the unit: --column time="),
        (text([1e3 * (START + T), Q, U], HEAD), {}, "times of 1.793e+12 cannot be s, expected ms since 1970: --column"),
        ("time,position,torque\n01.11.2026 00:59,1,2\n", {}, "times such as '01.11.2026 00:59' cannot be read"),
        ("time,position,torque\n,1,2\n,1,2\n", {}, "no times in column 'time', expected numbers, h:m:s or 2026-"),
        ("time,position,torque\ns,furlong,Nm\n" + text([T, Q, U]), {}, "holds the position in 'furlong', expected one of rad"),
        (text([T, Q, U], HEAD) + "1,2\n1,2,3\n", {}, "row 52: 2 cells, expected 3 as in the first line"),
        (text([T, Q, U], HEAD) + "1,2,3,4\n", {}, "row 52: 4 cells, expected 3"),
        (text([T, Q, U, U], ("t", "angle", "a current", "b current")), {}, "2 columns that may be the torque: 'a current' and"),
        (text([T, Q, U], ("t", "angle", "torque_cmd")), {}, "no torque, expected a column of that name, or --column torque="),
        ("1," * 1_000_000, {}, "a line of more than 1048576 characters"),
        (b"ULog\x01\x12\x35" + bytes(100), {}, "is a ULog of PX4, expected one of the .csv files that `ulog2csv`"),
        (b"PK\x03\x04[Content_Types].xml", {}, "is a spreadsheet or archive, expected the same saved as .csv"),
        (b"PK\x03\x04" + bytes(100), {}, "is a zip archive"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), {}, "is an HDF5 file"),
        (text([T, Q, U], HEAD).encode() + b"1,2,3\n" * 20_000 + b"\xff\xfe", {}, "cannot be read"),
    ],
)
def test_what_cannot_be_right_is_one_line(content: str | bytes, chosen: dict[str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.csv", content, chosen)
    assert message in str(caught.value)
    assert "a.csv" in str(caught.value)


def test_what_is_packed_is_bounded_and_may_be_broken(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="takes more work than"):
        read(tmp_path / "a.csv.gz", gzip.compress(b"1.000000,2.000000,3.000000\n" * 1_000_000))
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "b.csv.gz", gzip.compress(text([T, Q, U], HEAD).encode())[:-20])
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "c.csv.gz", b"no gzip at all")
    whole = bytearray(gzip.compress(text([T, Q, U], HEAD).encode()))
    whole[10:14] = b"\xff" * 4
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "d.csv.gz", bytes(whole))


def test_a_cut_last_row_is_mended_and_strict_refuses_it(tmp_path: Path) -> None:
    path = tmp_path / "cut.csv"
    found = read(path, text([T, Q, U], HEAD) + "0.2,0.3").recording
    assert right(found)
    assert "mended: the last row is cut, left out" in found.notes
    signals = SignalMap.from_mapping(SIGNALS, "axis.yaml")
    assert read_recordings([path], signals, Choice())[0].notes == found.notes
    with pytest.raises(InputError, match=r"cut\.csv: the last row is cut, left out, expected nothing to mend \(--strict\)"):
        read_recordings([path], signals, Choice(strict=True))


JOINTS = ("__time", *(f"/joint_states/{joint}/{field}" for joint in ("az", "el") for field in ("effort", "position")))
NUMBERED = ("t", "tau1", "q1", "tau2", "q2")


@pytest.mark.parametrize(
    ("head", "joint", "block", "taken"),
    [
        (JOINTS, "az", None, "az"),
        (JOINTS, "0", None, "az"),
        (JOINTS, "", SIGNALS, "az"),
        (NUMBERED, "1", None, "1"),
        (NUMBERED, "0", None, "1"),
        (tuple(name.replace("/joint_states/", "").replace("/", "_") for name in JOINTS), "az", None, "az"),
    ],
)
def test_of_several_joints_one_is_taken_by_name_or_number(
    head: tuple[str, ...], joint: str, block: object, taken: str, tmp_path: Path
) -> None:
    found = read(tmp_path / "a.csv", text([T, U, Q, 2 * U, 2 * Q], head), {}, joint, block)
    assert right(found.recording)
    assert found.signals.position.joint == taken
    assert any(note.startswith(f"joint {taken} of 2") for note in found.recording.notes)
    assert [np.allclose(column, 2.0 * Q) for column in found.recording.exogenous.values()] == ([] if block else [True])


def test_other_joints_may_push_on_one_and_a_second_clock_does_not(tmp_path: Path) -> None:
    head = (*JOINTS, "/joint_states/el/velocity", "/joint_states/header/stamp", "/wind/speed")
    found = read(tmp_path / "a.csv", text([T, U, Q, 2 * U, 2 * Q, U, T, U], head), {}, "az")
    assert sorted(found.recording.exogenous) == ["el_position", "el_velocity", "wind_speed"]


@pytest.mark.parametrize(
    ("joint", "message"),
    [("", "2 joints, expected --joint with one of 0 az, 1 el"), ("dome", "no joint 'dome', expected --joint with one of 0 az")],
)
def test_of_several_joints_none_is_guessed(joint: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.csv", text([T, U, Q, U, Q], JOINTS), {}, joint)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ("az_act_deg", Said("position", ("az",), "deg", weak=True)),
        ("az_cmd_deg", Said("reference", ("az",), "deg")),
        ("motor_current_A", Said("torque", ("motor",), "A", weak=True)),
        ("torque_mnm", Said("torque", (), "mnm", sure=True)),
        ("pos[deg]", Said("position", (), "deg", sure=True)),
        ("speed (rpm)", Said("velocity", (), "rpm", sure=True)),
        ("velocity_rad_s", Said("velocity", (), "rad/s", sure=True)),
        ("q[0]", Said("position", ("0",))),
        ("current_position", Said("position", ("current",))),
        ("torque_cmd", Said()),
        ("position error [deg]", Said(unit="deg")),
        ("motor_u", Said()),
        ("phase_a", Said()),
        ("comment", Said()),
    ],
)
def test_names_say_signal_joint_and_unit(column: str, expected: Said) -> None:
    assert said(column) == expected


def test_the_axis_file_says_units_that_no_column_tells(tmp_path: Path) -> None:
    block = {name: {**entry} for name, entry in SIGNALS.items()}
    block["position"]["unit"], block["torque"]["unit"] = "deg", "mNm"
    content = text([T, np.degrees(Q), 1e3 * U], ("time [s]", "position", "torque"))
    assert right(read(tmp_path / "a.csv", content, block=block).recording)
    assert right(read(tmp_path / "b.csv", text([T, Q, U], HEAD), block=block).recording), "a column's own unit counts more"


def npz(path: Path, **arrays: np.ndarray) -> Path:
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("suffix", ["mat", "npz"])
def test_arrays_by_name_are_columns(suffix: str, tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / f"a.{suffix}"
    for arrays, joint in (({"time": T, "position": Q, "torque": U, "Ts": np.array(0.004)}, ""),
                          ({"t": T, "q": np.c_[2 * Q, Q], "tau": np.c_[2 * U, U].T}, "1")):  # fmt: skip
        if suffix == "mat":
            savemat(path, {"log": arrays, "name": "x"} if not joint else arrays, do_compression=True)
        else:
            npz(path, **arrays)
        found = import_table(path, joint, {}).recording
        assert right(found)
    assert import_table(path, "1", {}).signals.position.joint == "1"


def test_arrays_that_claim_too_much_or_are_none_are_refused(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "claims.npz", "w") as archive:
        archive.writestr("time.npy", header.getvalue() + bytes(80))
    npz(tmp_path / "flood.npz", time=np.zeros(12_000_000))
    npz(tmp_path / "objects.npz", time=np.array([{}], dtype=object))
    npz(tmp_path / "texts.npz", time=np.array(["a"]))
    (tmp_path / "none.npz").write_bytes(b"PK\x03\x04 no archive")
    (tmp_path / "none.mat").write_bytes(b"MATLAB 5.0 MAT-file" + b"\xff" * 400)
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    for name, message in (
        ("claims.npz", r"claims 8000000000000 bytes"), ("flood.npz", "claims 96000000 bytes"), ("objects.npz", "cannot be read"),
        ("texts.npz", "no arrays of numbers"), ("none.npz", "cannot be read"), ("none.mat", "cannot be read"),
        ("new.mat", "is a .mat file of version 7.3"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message):
            import_table(tmp_path / name, "", {})


def test_a_mat_file_that_unpacks_to_a_flood_is_refused(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "flood.mat", {"time": np.zeros(12_000_000)}, do_compression=True)
    with pytest.raises(InputError, match="unpacks to far more than its size"):
        import_table(tmp_path / "flood.mat", "", {})


def lerobot(folder: Path, names: object = None) -> Path:
    """Two episodes of a data set with two joints, of which the second is the axis."""
    import pyarrow
    from pyarrow import parquet

    path = folder / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    (folder / "meta").mkdir()
    features = {name: {"names": names} for name in ("observation.state", "observation.effort", "action")}
    (folder / "meta" / "info.json").write_text(json.dumps({"features": features}))
    episode = np.repeat([0, 1], 25)
    columns = {
        "observation.state": pyarrow.array(np.c_[2 * Q, Q].tolist(), pyarrow.list_(pyarrow.float64())),
        "observation.effort": pyarrow.array(np.c_[2 * U, U].tolist(), pyarrow.list_(pyarrow.float64(), 2)),
        "action": pyarrow.array(np.c_[2 * Q, Q].tolist()),
        "timestamp": T - np.where(episode, T[25], 0.0), "episode_index": episode, "frame_index": episode, "task": ["x"] * 50,
    }  # fmt: skip
    parquet.write_table(pyarrow.table(columns), path)
    return path


@pytest.mark.parametrize(
    ("names", "joint"), [(["pan.pos", "lift.pos"], "lift"), ({"motors": ["pan", "lift"]}, "1"), (None, "1"), (["one"], "1")]
)
def test_a_lerobot_data_set_has_joints_and_episodes(names: object, joint: str, tmp_path: Path) -> None:
    found = import_table(lerobot(tmp_path, names), joint, {}).recording
    assert np.allclose(found.position, Q)
    assert np.allclose(found.torque, U)
    assert found.reference is not None
    assert [part.stop - part.start for part in found.segments] == [25, 25]
    assert [np.allclose(column, 2.0 * Q) for column in found.exogenous.values()] == [True]
    with pytest.raises(InputError, match=r"is a LeRobot data set, expected one of its files, data/chunk-000"):
        read_recordings([tmp_path], SignalMap.from_mapping(SIGNALS, "axis.yaml"))


def test_lists_of_different_length_are_refused(tmp_path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({"time": [0.0, 1.0], "position": [[1.0], [1.0, 2.0]]}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="holds lists of different length"):
        import_table(tmp_path / "a.parquet", "", {})


@pytest.mark.parametrize(
    ("separator", "cell"), [(";", "1.234,5"), ("\t", "1,234.5"), (",", '"1,234.50"'), (";", "-12.345.678"), (";", "1 234,5")]
)
def test_separators_of_thousands_are_refused(separator: str, cell: str, tmp_path: Path) -> None:
    table = tmp_path / "drive.csv"
    rows = [separator.join((str(k), str(k), cell if k == 7 else "5")) for k in range(40)]
    table.write_text("\n".join([separator.join(("time", "position", "torque")), *rows]))
    with pytest.raises(InputError, match=r"drive\.csv: row 9: .* separates thousands, expected numbers that do not"):
        import_table(table, "axis", {})


@pytest.mark.parametrize(("step", "unit"), [(0.004 / 86400.0, "d"), (1e-6, "d"), (1e-11, "s")])
def test_times_that_are_too_close_for_any_axis_are_refused(step: float, unit: str, tmp_path: Path) -> None:
    """As serial dates of a spreadsheet are, whose unit is a day."""
    table = tmp_path / "drive.csv"
    rows = "".join(f"{step * k:.15g},{np.sin(0.1 * k):.6f},{np.cos(0.1 * k):.6f}\n" for k in range(100))
    table.write_text("time,position,torque\n" + rows)
    with pytest.raises(InputError, match=f"nothing that an axis is sampled at, expected the unit: --column time=time:{unit}"):
        import_table(table, "axis", {})
