"""The page in a real browser: drawn, silent, without a request, and deaf to what a recording says."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drift_tables import make_drift_tables, simulated
from navigation_tables import make_navigation_tables
from report_tables import HOSTILE, make_tables, publish
from static_tables import make_static_tables

from pipeline.report import page

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")

from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="chromium and chromium-driver are not installed"
)

PATIENCE = 20  # seconds; a page takes one or two on an idle machine

DRAWN = "return typeof Bokeh !== 'undefined' && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"

# For each figure, the number of colours on its canvas; figures live in shadow roots.
COLOURS = """
function canvases(node) {
  const inside = [...node.querySelectorAll("*")].flatMap(e => e.shadowRoot ? canvases(e.shadowRoot) : []);
  return [...node.querySelectorAll("canvas")].concat(inside);
}
return [...document.querySelectorAll(".picture")].map(picture => canvases(picture).map(canvas => {
  if (!canvas.width || !canvas.height) return 0;
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return new Set(new Uint32Array(data.buffer)).size;
}));
"""

# The text of all tooltips that are shown.
TOOLTIPS = """
function shadows(node) {
  const inside = [...node.querySelectorAll("*")].map(e => e.shadowRoot).filter(s => s);
  return inside.concat(inside.flatMap(shadows));
}
const values = shadows(document).flatMap(s => [...s.querySelectorAll(".bk-tooltip-row-value")]);
return values.map(e => e.textContent).join("|");
"""


# How many curves are hidden.
HIDDEN = """
const models = [...Bokeh.documents[0]._all_models.values()];
return models.filter(model => model.type === "GlyphRenderer" && !model.visible).length;
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in (
        "headless=new",
        "no-sandbox",
        "disable-gpu",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
        "no-first-run",
        "window-size=1300,1600",
        f"user-data-dir={tmp_path_factory.mktemp('chromium')}",
    ):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    with webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER)) as driver:
        driver.set_page_load_timeout(PATIENCE)
        yield driver


@pytest.fixture(scope="module")
def opened(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The page of a recording whose every text is hostile, opened from its file and drawn."""
    out = tmp_path_factory.mktemp("out")
    publish(out, "run-7", make_tables(HOSTILE), HOSTILE)
    browser.get("about:blank")
    for log in ("browser", "performance"):
        browser.get_log(log)  # the browser's own start page is none of ours
    browser.get(page.write_page(out, "run-7").as_uri())
    WebDriverWait(browser, PATIENCE, poll_frequency=0.1).until(lambda b: b.execute_script(DRAWN))
    return browser


def test_every_figure_is_drawn(opened: Any) -> None:
    pictures = opened.execute_script(COLOURS)
    assert len(pictures) == 7
    panels = [canvas for picture in pictures for canvas in picture]
    # 4 rates and lanes, 3 angles, 1 trend, 2 ends, 6 errors, 1 of samples, 1 spectrum
    assert len([colours for colours in panels if colours > 5]) >= 18


def test_hovering_over_a_finding_shows_its_text_as_text(opened: Any) -> None:
    rates = opened.find_element(By.ID, "picture-0")
    opened.execute_script("arguments[0].scrollIntoView({block: 'center'})", rates)
    size = rates.size
    below_middle = size["height"] / 2 - 75  # the lane of the finding that lasts all along lies above the axis
    for dy in range(-20, 21, 4):
        webdriver.ActionChains(opened).move_to_element_with_offset(rates, 0, int(below_middle + dy)).perform()
        shown = opened.execute_script(TOOLTIPS)
        if shown:
            break
    assert HOSTILE in shown


def test_nothing_that_a_recording_says_is_run(opened: Any) -> None:
    assert opened.execute_script("return typeof window.hacked") == "undefined"
    assert opened.find_elements(By.CSS_SELECTOR, "img, mjx-container") == []


def test_nothing_is_fetched_and_nothing_is_complained_of(opened: Any) -> None:
    messages = [json.loads(entry["message"])["message"] for entry in opened.get_log("performance")]
    urls = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert urls[0].startswith("file:")
    assert {url.split(":")[0] for url in urls} <= {"file", "data", "blob"}
    assert sum(url.startswith("file:") for url in urls) == 1
    assert [entry for entry in opened.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_the_pictures_of_a_drift_run_are_drawn(browser: Any, tmp_path: Path) -> None:
    runs = [
        simulated(0, "polar", (0.02, -0.01), 24.0, 300.0),
        simulated(1, "vertical", (0.5, -0.4), 12.0, 300.0),
    ]
    file = tmp_path / "drift.html"
    file.write_text(page.render("run-7", make_drift_tables(runs, HOSTILE)), encoding="utf-8")
    browser.get(file.as_uri())
    WebDriverWait(browser, PATIENCE, poll_frequency=0.1).until(lambda b: b.execute_script(DRAWN))
    pictures = browser.execute_script(COLOURS)
    # angles, sky planes and residuals of two runs; drift; theta and epsilon; estimates; bars; map
    drawn = [sum(colours > 5 for colours in picture) for picture in pictures]
    assert len(drawn) == 8
    assert all(np.array(drawn) >= [4, 2, 4, 6, 7, 6, 1, 1])
    assert browser.execute_script("return typeof window.hacked") == "undefined"
    assert browser.find_elements(By.CSS_SELECTOR, "img, mjx-container") == []
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_the_pictures_of_a_static_run_are_drawn(browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "static.html"
    file.write_text(page.render("run-7", make_static_tables("pqr", HOSTILE)), encoding="utf-8")
    browser.get(file.as_uri())
    WebDriverWait(browser, PATIENCE, poll_frequency=0.1).until(lambda b: b.execute_script(DRAWN))
    pictures = browser.execute_script(COLOURS)
    # deviations, spectra, growth by rate and by time: a legend and three channels each
    assert [sum(colours > 5 for colours in picture) >= 4 for picture in pictures] == [True] * 4
    first = browser.find_element(By.ID, "picture-0")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", first)
    left, top = (-first.size[side] // 2 for side in ("width", "height"))
    webdriver.ActionChains(browser).move_to_element_with_offset(first, left + 110, top + 18).click().perform()
    assert browser.execute_script(HIDDEN) == 7  # curve and band of each channel, and the legend's sample
    assert browser.execute_script("return typeof window.hacked") == "undefined"
    assert browser.find_elements(By.CSS_SELECTOR, "img, mjx-container") == []
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_the_pictures_of_a_navigation_are_drawn(browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "navigation.html"
    file.write_text(page.render("run-7", make_navigation_tables(text=HOSTILE)), encoding="utf-8")
    browser.get(file.as_uri())
    WebDriverWait(browser, PATIENCE, poll_frequency=0.1).until(lambda b: b.execute_script(DRAWN))
    pictures = browser.execute_script(COLOURS)
    # two maps and the height; aids; sizes; errors; states; biases, wind, barometer; poles; innovations
    drawn = [sum(colours > 5 for colours in picture) for picture in pictures]
    assert len(drawn) == 8
    assert all(np.array(drawn) >= [3, 1, 4, 9, 6, 9, 2, 7])
    assert browser.execute_script("return typeof window.hacked") == "undefined"
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_the_index_leads_to_the_page(browser: Any, tmp_path: Path) -> None:
    publish(tmp_path, "run-7", make_tables())
    page.write_page(tmp_path, "run-7")
    browser.get(page.write_index(tmp_path).as_uri())
    browser.find_element(By.LINK_TEXT, "run-7").click()
    WebDriverWait(browser, PATIENCE).until(lambda b: b.execute_script(DRAWN))
    assert browser.title == "run-7"
