"""Crop the documentation's pictures from a page: ``python docs/pictures/make_pictures.py PAGE FOLDER``.

A page has the name of its recording; the pictures of each are in `PICTURES`. ``equatorial_one`` is the sample
``equatorial`` with a test plan without the second of its ``[[runs]]`` (docs/drift.md).

Wants selenium and Debian's chromium and chromium-driver, as the test of the page does.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

PICTURES = {
    "godorov": {
        "verdict": "//header",
        "trend": "//section[h2='Trend of γ']",
        "two_ends": "//section[h2='γ at the two ends of the record']",
    },
    "polar": {
        "drift_parameters": "//section[h2='Drift parameters']",
        "drift_residuals": "//section[h2='Residuals']",
    },
    "vertical": {
        "drift_sky": "//section[h2='The sky plane']",
        "drift_in_time": "//section[h2='Estimates in time']",
    },
    "equatorial_one": {"drift_told": "//section[h2='What the record can tell']"},
    "flight": {
        "navigation_track": "//section[h2='Track']",
        "navigation_errors": "//section[h2='Errors by component']",
        "navigation_biases": "//section[h2='Biases']",
        "navigation_poles": "//section[h2='Poles of the loops']/div[@class='picture']",
    },
    "static": {
        "static_allan": "//section[h2='Allan deviation']",
        "static_spectrum": "//section[h2='Spectrum']",
        "static_rotation": "//section[h2='What rotation does']",
        "static_growth": "//section[h2='Growth of the angle error']",
    },
    "table": {"rate_table_axes": "//section[h2='Input axes']"},
    "table_axis": {"rate_table_residuals": "//section[h2='Calibration residuals']"},
}
"""By recording and name of the picture, where on the page it is."""

_DRAWN = "return typeof Bokeh !== 'undefined' && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"


_HIDE_TOOLBARS = """
for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type === "Toolbar") model.visible = false;
"""
"""A picture has nobody to press their buttons."""


def crop(page: Path, folder: Path) -> list[Path]:
    """Open a page in a browser and write its `PICTURES` as PNG files."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory() as profile:
        for argument in ("headless=new", "no-sandbox", "disable-gpu", "no-first-run", "hide-scrollbars"):
            options.add_argument(f"--{argument}")
        options.add_argument("--window-size=1240,12000")
        options.add_argument("--force-device-scale-factor=1.5")
        options.add_argument(f"--user-data-dir={profile}")
        service = webdriver.ChromeService(
            shutil.which("chromedriver")
        )  # else selenium looks for one on the net
        with webdriver.Chrome(options=options, service=service) as browser:
            browser.get(page.resolve().as_uri())
            WebDriverWait(browser, 30).until(lambda b: b.execute_script(_DRAWN))
            browser.execute_script(_HIDE_TOOLBARS)
            WebDriverWait(browser, 30).until(lambda b: b.execute_script(_DRAWN))
            written = []
            for name, place in PICTURES[page.stem].items():
                written.append(folder / f"{name}.png")
                browser.find_element(By.XPATH, place).screenshot(str(written[-1]))
            return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path, help="a page that 'gyrostand report' wrote")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    arguments = parser.parse_args()
    for picture in crop(arguments.page, arguments.folder):
        print(picture)
