"""Plots in a page: what the page holds is what is plotted, no name becomes markup, paper gets the picture."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcs_friction.report.assets import plots_script, uplot_script
from tcs_friction.report.figures import BELIEVED, IMPROVED, MEASURED, MUTED
from tcs_friction.report.html import page, picture, table
from tcs_friction.report.plot import Curve, Panel, Plot, Rule, Scale, Spacing, main_range, shown_limits
from tcs_friction.report.plot_page import kept, plot_data, short
from tcs_friction.report.plot_picture import drawn_plot

LARGEST = 2_000_000  # bytes of a page
HOSTILE = "</script x></script><script>document.title='broken'</script><img src=x onerror=\"document.title='broken'\">&\u2028"
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

T = np.linspace(0.0, 300.0, 300_000)
NOISE = np.random.default_rng(0).standard_normal(len(T))
TIME = Scale("time", "s")


def long_plot(name: str = "torque") -> Plot:
    torque, model = 50.0 * np.sin(T) + NOISE, 50.0 * np.sin(T)
    torque[123_456] = 400.0
    above = Panel(TIME, Scale(name, "N m"), (Curve(name, MEASURED, T, torque), Curve("model", IMPROVED, T, model)))
    left = Curve("residual", BELIEVED, T, torque - model)
    below = Panel(TIME, Scale("residual", "N m", limits=(-5.0, 5.0)), (left,), rules=(Rule(2.0, MUTED),), spans=((10.0, 20.0),))
    return Plot("torque", f"Torque over time: {name}", ((above,), (below,)), linked=True)


def scatter_plot() -> Plot:
    speed = np.geomspace(1e-4, 1.0, 60)
    speed = np.concatenate([-speed[::-1], speed])
    friction = np.sign(speed) * 60.0
    points = Curve("measured", MEASURED, speed, friction, points=True, size=4.0, low=friction - 1.0, high=friction + 1.0)
    law = Curve("law", IMPROVED, speed, friction, low=friction - 0.5, high=friction + 0.5)
    x = Scale("speed", "deg/s", Spacing.ASINH, linear=1e-3, also=("rad/s", np.pi / 180.0))
    return Plot("friction", "Friction against speed.", ((Panel(x, Scale("friction", "N m"), (law, points)),),))


def embedded(document: str) -> list[dict[str, Any]]:
    found = re.findall(r'<script type="application/json">(.*?)</script>', document, re.DOTALL)
    return [json.loads(text) for text in found]


def page_of(*plots: Plot) -> str:
    return page("Title", "A sentence.", *(picture(drawn_plot(plot)) for plot in plots))


def test_a_page_with_plots_carries_the_library_once_and_one_without_does_not() -> None:
    document = page_of(long_plot(), scatter_plot())
    assert document.count(uplot_script()) == 1
    assert document.count(plots_script()) == 1
    assert "uPlot" not in page("Title", "A sentence.")


def test_the_numbers_in_the_page_are_those_of_the_plot_and_no_peak_is_lost() -> None:
    plot = long_plot()
    (content,) = embedded(page_of(plot))
    for panel, row in zip(plot.panels, content["rows"], strict=True):
        for curve, held, at in zip(panel.curves, row["panels"][0]["curves"], kept(panel.curves), strict=True):
            x, y = np.array(held["x"]), np.array(held["y"])
            assert 1000 < len(x) < 7000
            span = np.ptp(shown_limits(panel)[1])
            np.testing.assert_allclose(x, curve.x[at], atol=1e-3)
            np.testing.assert_allclose(y, curve.y[at], atol=1e-5 * span)
            assert y.max() == pytest.approx(curve.y.max(), abs=1e-5 * span)
            assert y.min() == pytest.approx(curve.y.min(), abs=1e-5 * span)
    (panel,) = content["rows"][1]["panels"]
    assert panel["y"]["limits"] == [-5.0, 5.0]
    assert panel["spans"] == [[10.0, 20.0]]
    assert panel["rules"][0]["at"] == 2.0


def test_few_points_are_all_in_the_page_with_their_bars() -> None:
    plot = scatter_plot()
    law, points = plot_data(plot)["rows"][0]["panels"][0]["curves"]
    np.testing.assert_allclose(points["x"], plot.panels[0].curves[1].x, rtol=1e-5)
    np.testing.assert_allclose(np.subtract(points["high"], points["y"]), 1.0, atol=1e-3)
    np.testing.assert_allclose(np.subtract(law["high"], law["low"]), 1.0, atol=1e-3)


def test_lines_over_the_same_x_keep_the_same_samples() -> None:
    curves = long_plot().panels[0].curves
    first, second = kept(curves)
    np.testing.assert_array_equal(first, second)


def test_a_page_of_six_long_plots_stays_small() -> None:
    document = page("Title", "A sentence.", *[picture(drawn_plot(long_plot()))] * 6)
    assert len(document.encode()) < LARGEST


def test_gaps_are_null_and_numbers_have_no_digits_that_nobody_sees() -> None:
    values = np.array([np.nan, np.inf, 1.23456789, -0.000001234567])
    assert short(values, Scale("x"), (0.0, 10.0)) == [None, None, 1.2346, -0.0]
    assert short(values, Scale("x", spacing=Spacing.LOG), (1e-9, 10.0)) == [None, None, 1.23457, -1.23457e-06]


class Elements(HTMLParser):
    """Every element with its attributes, as a browser reads them."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def elements(document: str) -> list[tuple[str, dict[str, str | None]]]:
    parser = Elements()
    parser.feed(document)
    return parser.found


def test_nothing_that_a_name_contains_is_markup() -> None:
    plain, hostile = elements(page_of(long_plot())), elements(page_of(long_plot(HOSTILE)))
    assert [tag for tag, _ in hostile] == [tag for tag, _ in plain]
    assert not any("onerror" in attributes for _, attributes in hostile)
    assert embedded(page_of(long_plot(HOSTILE)))[0]["rows"][0]["panels"][0]["y"]["name"] == HOSTILE


def test_a_page_loads_nothing_from_anywhere() -> None:
    document = page_of(long_plot(), scatter_plot())
    for _, attributes in elements(document):
        for name in ("src", "href", "action", "data", "srcset"):
            assert (attributes.get(name) or "data:").startswith("data:")
    scripts = document.replace(uplot_script(), "")
    for loader in ("fetch(", "XMLHttpRequest", "import(", "eval(", "new Function", "innerHTML", "@import", "url("):
        assert loader not in scripts


@pytest.mark.parametrize("arrays", [{"y": np.zeros(3)}, {"low": np.zeros(4)}, {"low": np.zeros(3), "high": np.zeros(4)}])
def test_curves_whose_arrays_do_not_fit_are_refused(arrays: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match="curve 'a'"):
        Curve(**{"name": "a", "color": MUTED, "x": np.zeros(4), "y": np.zeros(4), **arrays})


def test_a_curve_keeps_what_it_was_given() -> None:
    x = np.zeros(4)
    curve = Curve("a", MUTED, x, x)
    x[0] = 1.0
    assert curve.x[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        curve.y[0] = 1.0


@pytest.mark.parametrize(
    ("scale", "values"),
    [
        (Scale("x"), np.full(3, 5.0)),
        (Scale("x"), np.zeros(0)),
        (Scale("x"), np.full(3, np.nan)),
        (Scale("x", spacing=Spacing.LOG), np.array([0.0, 1.0, 100.0])),
        (Scale("x", spacing=Spacing.LOG), np.full(3, 2.0)),
        (Scale("x", spacing=Spacing.ASINH, linear=0.1), np.array([-5.0, 0.0, 5.0])),
    ],
)
def test_limits_hold_all_values_and_are_never_empty(scale: Scale, values: np.ndarray) -> None:
    panel = Panel(scale, scale, (Curve("a", MUTED, values, values),))
    for low, high in shown_limits(panel):
        assert low < high
        seen = values[np.isfinite(values) & ((values > 0.0) | (scale.spacing is not Spacing.LOG))]
        assert ((seen >= low) & (seen <= high)).all()
    assert drawn_plot(Plot("a", "b", ((panel,),))).png.startswith(b"\x89PNG")


def test_the_main_range_leaves_out_a_single_spike() -> None:
    values = np.append(np.ones(5000), 1e6)
    assert main_range(values) == (-1.5, 1.5)
    assert main_range(np.zeros(3)) == (-1.0, 1.0)


@pytest.fixture(scope="module")
def browser() -> str:
    if BROWSER is None:
        pytest.skip("no Chromium here; apt-get install chromium")
    return BROWSER


def seen(browser: str, tmp_path: Path, document: str, *arguments: str) -> str:
    """The page's elements after its scripts have run."""
    path = tmp_path / "page.html"
    path.write_text(document, encoding="utf-8")
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    fixed = ("--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000", profile, "--window-size=900,900")
    ran = subprocess.run(
        [browser, *fixed, *arguments, "--dump-dom", path.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    return ran.stdout


PROBE = """<script>addEventListener("load", () => {
  const shown = (selector) => getComputedStyle(document.querySelector(selector)).display !== "none";
  const plot = document.querySelector("canvas");
  const pixels = plot && plot.width ? plot.getContext("2d").getImageData(0, 0, plot.width, plot.height).data : [];
  document.body.dataset.probe = JSON.stringify({
    cut: [...document.querySelectorAll(".wide")].map((one) => getComputedStyle(one).overflowX !== "visible"),
    live: shown(".live"), still: shown(".still"), ink: pixels.some((value, k) => k % 4 === 3 && value),
    canvases: document.querySelectorAll("canvas").length, title: document.title,
    labels: [...document.querySelectorAll(".u-label")].map((one) => one.textContent),
  });
})</script></body>"""


READ = """<script>addEventListener("load", async () => {
  const over = document.querySelector(".u-over"), box = over.getBoundingClientRect(), said = [];
  const middle = box.top + 0.5 * box.height;
  const at = (share) => ({ bubbles: true, clientX: box.left + share * box.width, clientY: middle, movementX: 1 });
  const send = async (kind, share, target = over) => {
    target.dispatchEvent(new MouseEvent(kind, at(share)));
    await new Promise((done) => setTimeout(done, 50));
  };
  const read = async () => {
    await send("mousemove", 0.5);
    said.push([...document.querySelectorAll(".u-legend")].map((one) => one.querySelector(".u-value").textContent));
  };
  HAND
  await send("mouseenter", 0.5);
  await read();
  await drag();
  await read();
  await back();
  await read();
  document.body.dataset.probe = JSON.stringify({ said });
})</script></body>"""


MOUSE = """
  const drag = async () => { await send("mousedown", 0.6); await send("mousemove", 0.8); await send("mouseup", 0.8, document); };
  const back = () => send("dblclick", 0.5);"""
FINGER = """
  const finger = { pointerType: "touch", isPrimary: true };
  const touch = (kind, share) => over.dispatchEvent(new PointerEvent(kind, { ...at(share), ...finger }));
  const drag = async () => { touch("pointerdown", 0.6); touch("pointermove", 0.8); touch("pointerup", 0.8); };
  const back = async () => { for (const kind of ["pointerdown", "pointerup", "pointerdown", "pointerup"]) touch(kind, 0.5); };"""


def probed(dom: str) -> dict[str, Any]:
    parser = Elements()
    parser.feed(dom)
    text = next(attributes["data-probe"] for tag, attributes in parser.found if tag == "body")
    assert text is not None
    result: dict[str, Any] = json.loads(text)
    return result


def test_a_browser_draws_the_plots_and_takes_names_as_text(browser: str, tmp_path: Path) -> None:
    document = page_of(long_plot(HOSTILE), scatter_plot()).replace("</body>", PROBE)
    found = probed(seen(browser, tmp_path, document))
    assert found["live"]
    assert not found["still"]
    assert found["ink"]
    assert found["canvases"] == 3
    assert found["title"] == "Title"
    assert HOSTILE in found["labels"]


@pytest.mark.parametrize("hand", [MOUSE, FINGER], ids=["mouse", "finger"])
def test_a_drag_zooms_all_panels_of_a_plot_and_a_double_click_goes_back(browser: str, tmp_path: Path, hand: str) -> None:
    document = page_of(long_plot()).replace("</body>", READ.replace("HAND", hand))
    whole, zoomed, back = probed(seen(browser, tmp_path, document))["said"]
    assert all(text.endswith(" s") for text in whole + zoomed)
    seconds = [[float(text.removesuffix(" s")) for text in row] for row in (whole, zoomed, back)]
    np.testing.assert_allclose(seconds, [[150.0] * 2, [210.0] * 2, [150.0] * 2], atol=1.5)


def test_a_printed_page_holds_the_picture(browser: str, tmp_path: Path) -> None:
    plot = scatter_plot()
    width = int.from_bytes(drawn_plot(plot).png[16:20], "big")
    printed = tmp_path / "page.pdf"
    seen(browser, tmp_path, page_of(plot), f"--print-to-pdf={printed}")
    assert f"/Width {width}".encode() in printed.read_bytes()


def test_paper_and_pages_without_scripts_get_the_picture(browser: str, tmp_path: Path) -> None:
    document = page_of(scatter_plot()).replace("</body>", f"{table(['a'], [['b']])}</body>")
    printed = document.replace("@media print", "@media all").replace("@media screen", "@media not all")
    found = probed(seen(browser, tmp_path, printed.replace("</body>", PROBE)))
    assert found["still"]
    assert not found["live"]
    assert found["cut"] == [False]  # a bar to scroll with is of no use on paper
    broken = document.replace(uplot_script(), "throw new Error('no library')")
    found = probed(seen(browser, tmp_path, broken.replace("</body>", PROBE)))
    assert found["still"]
    assert not found["live"]
