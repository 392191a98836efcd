"""The report of a fleet: pages, JSON, exit status, and bad input in one line."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tcs_friction.commands import fleet_report
from tcs_friction.commands.parser import parser_of
from tcs_friction.errors import InputError


def _rows() -> Any:
    path = Path(__file__).parents[1] / "trends" / "fleet_rows.py"
    spec = importlib.util.spec_from_file_location("fleet_rows", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


rows = _rows()


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three axes: one with a bump, one unchanged, one with a name that no file may have; and recordings of no axis."""
    content = {
        "south": rows.as_content(rows.year(4, bump=True)[0], ["coulomb"]),
        "north": rows.as_content(rows.year(1)[0], ["coulomb"]),
        "a%2Fb": rows.as_content(rows.year(6)[0], ["coulomb"])[:3],
        "_none": rows.as_content(rows.year(6)[0], ["coulomb"])[:2],
    }
    return rows.stored(tmp_path_factory.mktemp("fleet"), content)


def run(*words: str) -> int:
    return fleet_report.run(parser_of("fleet report", fleet_report).parse_args(words))


def test_pages_and_json_say_who_is_needed(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(str(out), "-o", str(tmp_path), "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["schema"] == "tcs_friction/fleet/1"
    assert printed["needs_person"] == ["south"]
    assert [axis["axis"] for axis in printed["axes"]] == ["south", "a/b", "north"]
    assert printed["axes"][0]["events"][0]["effects"][0]["effect"] == "local_friction_bump"
    assert json.loads((tmp_path / "fleet.json").read_text()) == printed
    index = (tmp_path / "index.html").read_text()
    assert "1 of 3 axes needs a person: south." in index
    for axis in ("axis_south.html", "axis_north.html", "axis_a%2Fb.html"):
        assert (tmp_path / axis).is_file()
        assert f'href="{axis.replace("%", "%25")}"' in index
    assert 'src="data:image/png' in (tmp_path / "axis_south.html").read_text()


def test_nothing_to_do_is_status_0(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows.stored(tmp_path, {"north": rows.as_content(rows.year(1)[0], ["coulomb"])})
    assert run(str(tmp_path)) == 0
    assert capsys.readouterr().out.startswith("The axis needs nobody.")
    assert (tmp_path / "report" / "index.html").is_file()


def test_the_largest_difference_is_of_axes_of_one_law(tmp_path: Path) -> None:
    content = [row for row in rows.as_content(rows.year(1)[0], ["coulomb"]) if row["status"] == "done"][:3]

    def scaled(law: str, by: float) -> list[dict[str, Any]]:
        return [{**row, "law": law, "parameter_values": [by * value for value in row["parameter_values"]]} for row in content]

    axes = {"a": ("lugre", 1.0), "b": ("lugre", 1.1), "c": ("dahl_viscous", 2.0), "d": ("dahl_viscous", 3.0)}
    rows.stored(tmp_path, {name: scaled(*one) for name, one in axes.items()})
    run(str(tmp_path))
    index = (tmp_path / "report" / "index.html").read_text()
    assert "10 %, a and b" in index
    assert "50 %, c and d" in index


def test_a_url_is_read_through_fsspec(out: Path, tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    with pytest.raises(InputError, match="no folder for the pages"):
        run(f"file://{out}")
    assert run(f"file://{out}", "-o", str(tmp_path)) == 1
    with pytest.raises(InputError, match="holds no results of a fleet"):
        run(f"file://{tmp_path}/nothing", "-o", str(tmp_path))


def test_without_fsspec_a_url_says_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(InputError, match="URLs need the package fsspec"):
        run("s3://bucket/out", "-o", str(tmp_path))


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no folder"):
        run(str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="holds no results of a fleet"):
        run(str(tmp_path))
    with pytest.raises(InputError, match="a date such as"):
        run(str(tmp_path), "--since", "March")
    (tmp_path / "rows" / "axis=a" / "month=2025-01").mkdir(parents=True)
    with pytest.raises(InputError, match=r"holds no|is missing"):
        run(str(tmp_path))


def test_a_damaged_row_is_one_line(tmp_path: Path) -> None:
    content = rows.as_content(rows.year(1)[0], ["coulomb"])[:3]
    rows.stored(
        tmp_path / "lacking", {"a": [{k: v for k, v in row.items() if k != "law"} for row in content]}
    )
    with pytest.raises(InputError, match="column law is missing"):
        run(str(tmp_path / "lacking"))
    rows.stored(tmp_path / "none", {"_none": content})
    with pytest.raises(InputError, match="holds no recordings of any axis"):
        run(str(tmp_path / "none"))


@pytest.mark.parametrize("damage", ["cut", "scrambled", "no parquet", "a column"])
def test_an_axis_that_cannot_be_read_is_reported_and_others_go_on(
    damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = rows.as_content(rows.year(1)[0], ["coulomb"])
    lacking = [{k: v for k, v in row.items() if k != "law" or damage != "a column"} for row in content[:3]]
    rows.stored(tmp_path, {"bad": lacking, "good": content, "other": content})
    file = tmp_path / "rows" / "axis=bad" / "month=2025-01" / "part.parquet"
    whole = file.read_bytes()
    scrambled = whole[:4] + bytes(byte ^ 0x5A for byte in whole[4:3000]) + whole[3000:]
    file.write_bytes({"cut": whole[:-100], "scrambled": scrambled, "no parquet": b"x" * 999, "a column": whole}[damage])
    assert run(str(tmp_path), "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    counts = {axis["axis"]: axis["recordings"] for axis in printed["axes"]}
    assert counts == {"bad": 0, "good": len(content), "other": len(content)}
    (reason,) = printed["axes"][0]["reasons"]
    assert reason.startswith(f"its results cannot be read: {file}: ")
    assert printed["needs_person"] == ["bad"]
    assert "cannot be read" in (tmp_path / "report" / "axis_bad.html").read_text()
