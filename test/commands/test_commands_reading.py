"""Every command reads bags and tables by one function: scales, units, --column, --joint and --strict mean the same everywhere."""

from __future__ import annotations

import argparse
import gzip
import importlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tcs_friction.cli import main
from tcs_friction.commands import inputs
from tcs_friction.config import AxisFile, load_axis, save_axis, shipped
from tcs_friction.diagnose.from_simulation import signals_of
from tcs_friction.errors import InputError
from tcs_friction.physics.axis import Axis, Drive
from tcs_friction.physics.registry import law
from tcs_friction.physics.terms import instance
from tcs_friction.recording.bags import Bag, read_recordings
from tcs_friction.recording.choice import Choice
from tcs_friction.recording.pieces import read_piece
from tcs_friction.recording.recording import Recording, same_torque_unit
from tcs_friction.recording.signals import SignalMap, SignalSource
from tcs_friction.recording.tables import export_table, import_table
from tcs_friction.recording.write import write_recording

INERTIA, COULOMB, VISCOUS = 4.0, 5.0, 3.0
PLACE = "/joint_states"
TURNED = SignalMap(
    SignalSource(PLACE, "position", "az", unit="deg"), SignalSource(PLACE, "effort", "az", scale=-0.5),
    SignalSource(PLACE, "velocity", "az", scale=2.0), SignalSource("/temperature", "temperature", unit="K"),
    exogenous={"wind": SignalSource("/wind", "vector.x", scale=3.0)},
)  # fmt: skip
"""Signals each of which becomes SI units by a scale or a unit of its own."""


def motion(seconds: float = 20.0) -> Recording:
    """An axis with Coulomb and viscous friction, in SI units."""
    random, t = np.random.default_rng(0), np.arange(round(100 * seconds)) / 100.0
    position = 0.3 * np.sin(1.1 * t) + 0.2 * np.sin(2.9 * t)
    velocity = 0.33 * np.cos(1.1 * t) + 0.58 * np.cos(2.9 * t)
    acceleration = -0.363 * np.sin(1.1 * t) - 1.682 * np.sin(2.9 * t)
    torque = INERTIA * acceleration + COULOMB * np.sign(velocity) + VISCOUS * velocity + 0.02 * random.standard_normal(len(t))
    noise = 1e-6 * random.standard_normal(len(t))
    return Recording(t, position + noise, torque, velocity=velocity, temperature=20.0 + 0.01 * t, exogenous={"wind": np.cos(t)})


def axis_file(signals: SignalMap, **drive: float) -> AxisFile:
    friction = instance(law("coulomb_viscous"), {"coulomb": COULOMB, "viscous": VISCOUS})
    return AxisFile(Axis(name="az", inertia=INERTIA, friction=friction, drive=Drive(**drive)), signals)


def recorded(path: Path, signals: SignalMap = TURNED) -> Path:
    """The motion as its axis has it in a file, by the suffix; names say nothing of scales and units."""
    one = motion()
    if not path.suffix:
        write_recording(path, one, signals)
        return path
    raw = {"time [s]": one.t}
    for name, source in signals.named():
        values = one.exogenous[name] if name == "wind" else getattr(one, name)
        raw[name] = np.asarray(source.recorded(values))
    if path.suffix == ".npz":
        np.savez(path, **raw)  # type: ignore[arg-type]
    elif path.suffix == ".parquet":
        import pyarrow
        from pyarrow import parquet

        parquet.write_table(pyarrow.table(raw), path)
    else:
        cells = zip(*(values.tolist() for values in raw.values()), strict=True)
        rows = "\n".join([",".join(raw), *(",".join(map(repr, row)) for row in cells)])
        path.write_bytes(gzip.compress(rows.encode()) if path.suffix == ".gz" else rows.encode())
    return path


def imported(path: Path) -> Path:
    found = import_table(path, "", {}, TURNED)
    write_recording(path.with_suffix(""), found.recording, found.signals)
    return path.with_suffix("")


def exported(path: Path, suffix: str) -> Path:
    (one,) = read_recordings([path], TURNED)
    export_table(one, path.with_suffix(suffix), "rotary", TURNED)
    return path.with_suffix(suffix)


READERS: dict[str, Callable[[Path], Recording]] = {
    "bag": lambda folder: read_recordings([recorded(folder / "a")], TURNED)[0],
    "piece of a bag": lambda folder: read_piece(Bag(recorded(folder / "a")), TURNED),
    "csv": lambda folder: read_recordings([recorded(folder / "a.csv")], TURNED)[0],
    "csv.gz": lambda folder: read_recordings([recorded(folder / "a.csv.gz")], TURNED)[0],
    "parquet": lambda folder: read_recordings([recorded(folder / "a.parquet")], TURNED)[0],
    "npz": lambda folder: read_recordings([recorded(folder / "a.npz")], TURNED)[0],
    "imported": lambda folder: read_recordings([imported(recorded(folder / "a.csv"))], TURNED)[0],
    "exported csv": lambda folder: read_recordings([exported(recorded(folder / "a"), ".csv")], TURNED)[0],
    "exported parquet": lambda folder: read_recordings([exported(recorded(folder / "a"), ".parquet")], TURNED)[0],
}


@pytest.mark.parametrize("name", READERS)
def test_every_reader_applies_scales_and_units_once(name: str, tmp_path: Path) -> None:
    found, true = READERS[name](tmp_path), motion()
    for signal in ("position", "velocity", "torque", "temperature"):
        assert np.allclose(getattr(found, signal), getattr(true, signal), rtol=1e-9), signal
    assert np.allclose(found.exogenous["wind"], true.exogenous["wind"], rtol=1e-9)


def test_the_fleet_reads_as_everybody_does(tmp_path: Path) -> None:
    axes = pytest.importorskip("tcs_friction.fleet.axes")
    save_axis(tmp_path / "az.yaml", axis_file(TURNED))
    table = recorded(tmp_path / "a.csv")
    text = table.read_text().replace("torque", "force_x", 1)
    (tmp_path / "b.csv").write_text(text)
    (tmp_path / "axes.yaml").write_text("[{axis: az.yaml, columns: {torque: force_x}}]")
    (axis,) = axes.read_axes(tmp_path / "axes.yaml")
    assert np.allclose(axis.table(tmp_path / "b.csv").torque, motion().torque)
    told = axis.told(Choice({"torque": "7", "position": "position:rad"}, "", True), axis.signals.of_joint("dome"))
    assert dict(told.columns) == {"torque": "7", "position": "position:rad"}
    assert told.signals.torque.joint == "dome"
    assert told.strict
    assert told.decides != axis.decides
    for columns, message in (("{torke: x}", "unknown key 'torke', expected torque"), ("{torque: 3}", r"\{'torque': 3\}")):
        (tmp_path / "axes.yaml").write_text(f"[{{axis: az.yaml, columns: {columns}}}]")
        with pytest.raises(InputError, match=message):
            axes.read_axes(tmp_path / "axes.yaml")


class ReadError(Exception):
    """A command has read its recordings."""


@pytest.mark.parametrize("suffix", ["", ".csv"])
@pytest.mark.parametrize("command", ["identify", "diagnose", "response", "calibrate"])
def test_every_command_applies_the_scale_of_the_torque(
    command: str, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What `new` writes for a torque that is turned over is what all others go by, of bags and tables alike."""
    module = importlib.import_module(f"tcs_friction.commands.{command}")
    seen: list[Recording] = []

    def spy(*given: object, **more: object) -> object:
        seen.extend(read_recordings(*given, **more))  # type: ignore[arg-type]
        raise ReadError

    monkeypatch.setattr(module, "read_recordings", spy)
    signals = replace(TURNED, exogenous={"dynamometer": TURNED.torque})
    save_axis(tmp_path / "az.yaml", axis_file(signals if command == "calibrate" and not suffix else TURNED))
    given = recorded(tmp_path / f"run{suffix}")
    with pytest.raises(ReadError):
        main([command, str(given), "--axis", str(tmp_path / "az.yaml"), "-o", str(tmp_path / "out")])
    assert np.allclose(seen[0].torque, motion().torque)
    assert np.allclose(seen[0].position, motion().position)


@pytest.mark.parametrize("suffix", ["", ".csv"])
def test_a_turned_over_torque_is_identified(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain = SignalMap(*(SignalSource(PLACE, field, "az") for field in ("position", "effort", "velocity")))
    given = replace(plain, torque=replace(plain.torque, scale=-1.0))
    table, axis = recorded(tmp_path / f"run{suffix}", given), tmp_path / "az.yaml"
    save_axis(axis, axis_file(given))
    assert main(["identify", str(table), "--axis", str(axis), "-o", str(tmp_path / "i"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["inertia"]["value"] == pytest.approx(INERTIA, rel=0.01)
    assert found["parameters"]["coulomb"]["value"] == pytest.approx(COULOMB, rel=0.02)
    if suffix:
        bag = tmp_path / "bag"
        assert main(["bag", "import", str(table), "--axis", str(axis), "-o", str(bag)]) == 0
        assert np.allclose(read_recordings([bag], given)[0].torque, motion().torque)


CUT = "time [s],position [rad],torque [N m]\n" + "".join(f"{k / 100},{k},{k}\n" for k in range(200)) + "2.0,3"


@pytest.mark.parametrize("command", ["identify", "diagnose", "response", "calibrate", "new", "bag import", "compensate"])
def test_strict_refuses_what_would_be_mended_in_every_command(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, axis, out = tmp_path / "cut.csv", tmp_path / "az.yaml", str(tmp_path / "out")
    table.write_text(CUT)
    save_axis(axis, axis_file(replace(TURNED, temperature=None, exogenous={})))
    words = {
        "new": ["new", str(table), "-o", out],
        "bag import": ["bag", "import", str(table), "-o", out],
        "compensate": [
            "compensate", str(shipped("azimuth_geared.yaml")), "--reference", str(shipped("azimuth_geared_run.yaml")), "-o", out,
            "--surroundings", str(table),
        ],
    }.get(command, [command, str(table), "--axis", str(axis), "-o", out])  # fmt: skip
    assert main([*words, "--strict"]) == 2
    said = capsys.readouterr().err
    assert "cut.csv: the last row is cut, left out, expected nothing to mend (--strict)" in said
    assert said.count("\n") == 1
    assert not Path(out).exists()


def test_a_table_whose_position_wraps_is_continuous_and_says_so(tmp_path: Path) -> None:
    """In degrees, which are made rad before the turns are counted; the reference goes with the position."""
    t = np.arange(2000) / 100.0
    position = 500.0 * np.sin(0.5 * t)
    path, heading = tmp_path / "wrapped.csv", "time [s],position [deg],reference [deg],torque [N m]"
    rows = np.column_stack((t, position % 360.0, (position + 0.1) % 360.0, np.cos(t)))
    np.savetxt(path, rows, delimiter=",", header=heading, comments="")
    (found,) = read_recordings([path], TURNED)
    assert np.allclose(found.position, np.radians(position), atol=1e-9)
    assert found.reference is not None
    assert np.allclose(found.reference - found.position, np.radians(0.1), atol=1e-9)
    assert sum(note.startswith("mended: position: wraps at 6.2832 rad") for note in found.notes) == 1
    with pytest.raises(InputError, match=r"wraps at 6.2832 rad.*--strict"):
        read_recordings([path], TURNED, Choice(strict=True))


def test_a_torque_with_stamps_of_its_own_is_logged_in_si_units(tmp_path: Path) -> None:
    signals = SignalMap(TURNED.position, SignalSource("/drive", "wrench.torque.z", scale=-0.5, unit="mNm", acts="from_stamp"))
    write_recording(tmp_path / "bag", motion(), signals)
    (found,) = read_recordings([tmp_path / "bag"], signals)
    assert found.torque_log is not None
    assert np.allclose(found.torque, motion().torque, rtol=1e-12)
    assert np.allclose(found.torque_log, [motion().t, motion().torque], atol=1e-9)
    assert found.acts == 0.0


def test_the_axis_file_says_when_the_torque_of_a_table_acts(tmp_path: Path) -> None:
    path = recorded(tmp_path / "az.csv")
    for acts, seconds in (("from_stamp", 0.0), ("up_to_stamp", -0.01), (0.002, 0.002)):
        (found,) = read_recordings([path], replace(TURNED, torque=replace(TURNED.torque, acts=acts)))
        assert found.acts == pytest.approx(seconds, abs=1e-12)
    (found,) = read_recordings([path], TURNED)
    assert found.acts is None


@pytest.mark.parametrize("name", ["identify", "diagnose", "response", "calibrate", "new", "compensate", "fleet"])
def test_every_command_takes_the_options_of_reading(name: str) -> None:
    parser = argparse.ArgumentParser()
    importlib.import_module(f"tcs_friction.commands.{name}").add_arguments(parser)
    options = {action.dest for action in parser._actions}
    assert {"column", "joint", "strict"} <= options


@pytest.mark.parametrize(
    ("words", "message"), [(["torque"], "--column: 'torque', expected SIGNAL=COLUMN"), (["a=b", "a=c"], "'b' and 'c'")]
)
def test_columns_that_are_none_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        inputs.choice_of(argparse.Namespace(column=words, joint="", strict=False))


def test_another_joint_of_a_bag_can_be_asked_for_and_columns_cannot(tmp_path: Path) -> None:
    bag = recorded(tmp_path / "a")
    elsewhere = TURNED.of_joint("el")
    assert np.allclose(read_recordings([bag], elsewhere, Choice(joint="az"))[0].torque, motion().torque)
    with pytest.raises(InputError, match=r"--column: given for .*a, expected a table"):
        read_recordings([bag], TURNED, Choice({"torque": "x"}))


PLAIN = SignalMap(SignalSource(PLACE, "position", "az"), SignalSource(PLACE, "effort", "az"))


def table_with(path: Path, head: str, factor: float) -> Path:
    """The motion with the torque times a factor under a name."""
    one = motion()
    rows = zip(one.t.tolist(), one.position.tolist(), (factor * one.torque).tolist(), strict=True)
    path.write_text("\n".join([f"time [s],position [rad],{head}", *(",".join(map(repr, row)) for row in rows)]))
    return path


@pytest.mark.parametrize(
    ("unit", "rated", "factor", "torque_unit"),
    [
        ("A", 0.0, 1.0, "A"), ("mA", 0.0, 1e3, "A"), ("V", 0.0, 1.0, "V"), ("%", 0.0, 1.0, "%"), ("permille", 0.0, 10.0, "%"),
        ("%", 50.0, 2.0, ""), ("permille", 50.0, 20.0, ""), ("kNm", 0.0, 1e-3, ""),
    ],
)  # fmt: skip
def test_torques_are_read_in_the_unit_of_a_column_or_of_the_axis_file(
    unit: str, rated: float, factor: float, torque_unit: str, tmp_path: Path
) -> None:
    """Per cent become N m where the rated torque is known."""
    in_column = axis_file(PLAIN, rated_torque=rated)
    in_file = axis_file(replace(PLAIN, torque=replace(PLAIN.torque, unit=unit)), rated_torque=rated)
    assert in_file.axis.torque_unit == torque_unit
    for file, head in ((in_column, f"torque [{unit}]"), (in_file, "torque")):
        save_axis(tmp_path / "az.yaml", file)
        signals = load_axis(tmp_path / "az.yaml").mapped("az.yaml")
        (found,) = read_recordings([table_with(tmp_path / "run.csv", head, factor)], signals)
        assert np.allclose(found.torque, motion().torque)
        assert found.torque_unit == torque_unit


@pytest.mark.parametrize("told", ["", "A"])
def test_results_are_in_the_unit_of_the_torque(told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis, out = tmp_path / "az.yaml", tmp_path / "out"
    table = table_with(tmp_path / "run.csv", "torque" if told else "torque [A]", 1.0)
    save_axis(axis, axis_file(replace(PLAIN, torque=replace(PLAIN.torque, unit=told))))
    assert main(["identify", str(table), "--axis", str(axis), "-o", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["inertia"]["value"] == pytest.approx(INERTIA, rel=0.01)
    units = [found[name]["unit"] for name in ("inertia", "offset")] + [one["unit"] for one in found["parameters"].values()]
    assert units == ["A s^2/rad", "A", "A", "A s/rad"]
    assert load_axis(out / "axis.yaml").axis.torque_unit == "A"
    assert "N m" not in (out / "report.html").read_text().replace("\u00a0", " ")


def test_a_constant_torque_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = table_with(tmp_path / "run.csv", "torque", 0.0)
    save_axis(tmp_path / "az.yaml", axis_file(PLAIN))
    assert main(["identify", str(table), "--axis", str(tmp_path / "az.yaml"), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "run.csv: the torque is constant (0), expected the torque applied to the axis" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_messages_that_are_not_read_are_told(encoding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.JointStates", f"{encoding}schema", b"{}")
        channel = writer.register_channel(PLACE, encoding, schema)
        for k in range(5):
            writer.add_message(channel, k, b"{}", k)
        writer.finish()
    save_axis(tmp_path / "az.yaml", axis_file(PLAIN))
    for words in (["new"], ["identify", "--axis", str(tmp_path / "az.yaml")]):
        assert main([*words, str(path), "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert f"messages are serialised as {encoding}, expected cdr or ros1, or the signals as a table (.csv)" in said
        assert said.count("\n") == 1


def test_a_simulation_may_be_a_table(tmp_path: Path) -> None:
    found = signals_of(table_with(tmp_path / "run.csv", "torque [A]", 1.0))
    assert found.torque.unit == "A"


def test_units_of_torque_that_do_not_convert_are_refused(tmp_path: Path) -> None:
    plain = PLAIN
    for name, unit in (("a.csv", "A"), ("b.csv", "N m")):
        (tmp_path / name).write_text(f"time [s],position [rad],torque [{unit}]\n0,1,2\n1,2,3\n2,3,5\n")
    in_amperes = replace(plain, torque=replace(plain.torque, unit="A"))
    with pytest.raises(InputError, match=r"b\.csv: holds the torque in Nm, expected A, as signals\.torque\.unit"):
        read_recordings([tmp_path / "b.csv"], in_amperes)
    with pytest.raises(InputError, match=r"b\.csv: holds the torque in N m, expected A as in"):
        read_recordings([tmp_path / "a.csv", tmp_path / "b.csv"], plain)
    constant = replace(plain, torque=replace(plain.torque, scale=1.5))
    (known,) = read_recordings([tmp_path / "a.csv"], constant)
    assert same_torque_unit([known]) == "", "a torque constant makes N m of A"
    assert known.torque.tolist() == [3.0, 4.5, 7.5]


@pytest.mark.parametrize(
    ("signal", "unit", "message"),
    [("position", "furlong", "unit is 'furlong', expected one of rad"), ("torque", "deg", "unit is 'deg', expected"),
     ("wind", "m/s", "unit is 'm/s', expected no unit of a signal that is not the axis' own"), ("torque", 3, "unit is 3")],
)  # fmt: skip
def test_units_in_an_axis_file_are_checked(signal: str, unit: object, message: str) -> None:
    block = TURNED.to_mapping()
    place = block["exogenous"] if signal == "wind" else block
    place[signal]["unit"] = unit
    with pytest.raises(InputError) as caught:
        SignalMap.from_mapping(block, "axis.yaml")
    assert f"signals.{'exogenous.' if signal == 'wind' else ''}{signal}: {message}" in str(caught.value)
    assert SignalMap.from_mapping(TURNED.to_mapping(), "axis.yaml") == TURNED
