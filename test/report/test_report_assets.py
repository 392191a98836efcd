"""The plot library that pages carry: intact, licensed, fit for an inline element, and part of what is installed."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import zipfile
from importlib.resources import files
from pathlib import Path

import pytest

from tcs_friction.report.assets import SHA256, VERSION, uplot_script, uplot_style

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", SHA256)
def test_files_of_the_library_are_what_its_authors_published(name: str) -> None:
    content = files("tcs_friction.report.assets").joinpath(name).read_bytes()
    assert hashlib.sha256(content).hexdigest() == SHA256[name]


def test_the_stated_version_is_that_of_the_file() -> None:
    readme = files("tcs_friction.report.assets").joinpath("README.md").read_text()
    assert f"(v{VERSION}) */" in uplot_script()
    assert f"uPlot {VERSION}," in readme


@pytest.mark.parametrize("text", [uplot_script(), uplot_style()])
def test_the_licence_stands_in_what_a_page_embeds(text: str) -> None:
    assert text.startswith("/*!")
    assert "Copyright (c) 2022 Leon Sorokin" in text
    assert "permission notice shall be included in" in text


def test_the_library_cannot_end_the_element_it_stands_in_and_loads_nothing() -> None:
    for text in (uplot_script(), uplot_style()):
        assert "</" not in text
        assert "<!--" not in text
        for loader in ("@import", "url(", "fetch(", "XMLHttpRequest", "eval(", "new Function", ".src="):
            assert loader not in text


def test_the_library_is_in_what_is_installed(tmp_path: Path) -> None:
    build = ["egg_info", "--egg-base", str(tmp_path), "build", "--build-base", str(tmp_path / "b")]
    subprocess.run([sys.executable, "setup.py", "-q", *build], cwd=ROOT, check=True, capture_output=True)
    installed = next((tmp_path / "b").glob("lib*")) / "tcs_friction" / "report" / "assets"
    assert {*SHA256, "README.md", "plots.js"} <= {path.name for path in installed.iterdir()}


def test_the_library_is_found_in_a_zipped_package(tmp_path: Path) -> None:
    archive = tmp_path / "package.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in (ROOT / "tcs_friction" / "report" / "assets").iterdir():
            if path.is_file():
                packed.write(path, f"assets/{path.name}")
    code = "import assets; print(len(assets.uplot_script()))"
    ran = subprocess.run([sys.executable, "-c", code], env={"PYTHONPATH": str(archive)}, capture_output=True, check=True)
    assert int(ran.stdout) == len(uplot_script())
