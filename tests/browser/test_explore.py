"""explore.html in headless Chromium: what is read off the page is what the analysis gives, and nothing leaves it.

Run by `make test-browser`, which installs what it needs; marked `browser`, so that the default run leaves it out.
"""

from __future__ import annotations

import importlib.util
import json
import shutil

import numpy as np
import pytest
import synthetic_results

from analysis.results.reader import read_results

pytestmark = pytest.mark.browser
MISSING = [name for name in ("plotly", "selenium") if importlib.util.find_spec(name) is None]
MISSING += [] if shutil.which("chromedriver") else ["chromedriver"]
TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def results():
    return read_results(synthetic_results.small_example((1, 2, 3), (0.04, 0.1)))


@pytest.fixture(scope="module")
def driver(results, tmp_path_factory):
    """The page in a browser that logs its network requests and errors."""
    if MISSING:
        pytest.fail(f"{', '.join(MISSING)} not installed; `make test-browser` installs what is needed")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    from analysis.report.explore import write_explore

    page = write_explore(results, tmp_path_factory.mktemp("page"))
    options = webdriver.ChromeOptions()
    for word in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--window-size=1300,1000",
    ):
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    browser = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)
    browser.set_page_load_timeout(120)
    try:
        browser.get(page.as_uri())
        yield browser
    finally:
        browser.quit()


def choose(driver, name, value):
    """Choose an entry of a list, or set the slider of the strain, as the hand of a person does."""
    driver.execute_script(
        "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
        "e.dispatchEvent(new Event(e.tagName === 'SELECT' ? 'change' : 'input', {bubbles: true}));", name, str(value)
    )  # fmt: skip


def read_off(driver):
    """Threshold and exceedance probability, with all digits, as the page has read them off."""
    out = driver.find_element("id", "readout")
    return float(out.get_attribute("data-threshold")), float(out.get_attribute("data-exceedance"))


def point_at(driver, plot, share):
    """Move the pointer to a place in a plot, at this share of its width."""
    from selenium.webdriver.common.action_chains import ActionChains

    area = driver.find_element("css selector", f"#{plot} .nsewdrag")
    driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", area)
    offset = int((share - 0.5) * area.size["width"])
    ActionChains(driver, duration=0).move_to_element_with_offset(area, offset, 0).perform()


def expected(results, symbol, mu_iso, k, threshold):
    return float(results.response(symbol, mu_iso).pdf.exceedance(threshold / UNIT.get(symbol, 1.0))[k])


UNIT = {"eps_v": 100.0}


def test_the_page_has_loaded_without_an_error(driver):
    assert driver.find_element("tag name", "body").get_attribute("data-ready") == "yes"
    assert [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"] == []
    for plot in ("along", "pdf", "cdf", "joint"):
        assert driver.find_elements("css selector", f"#{plot} .main-svg"), plot


@pytest.mark.parametrize("symbol", ["eta", "Z", "eps_v"])
@pytest.mark.parametrize("plot", ["cdf", "pdf"])
def test_the_exceedance_at_the_pointer_is_that_of_the_analysis(driver, results, symbol, plot):
    choose(driver, "response", symbol)
    read = []
    for k in (7, 30, len(results.strain) - 1):
        choose(driver, "strain", k)
        for share in (0.2, 0.5, 0.8):
            point_at(driver, plot, share)
            threshold, probability = read_off(driver)
            assert abs(probability - expected(results, symbol, 0.04, k, threshold)) < TOLERANCE
            read.append(probability)
    assert max(read) - min(read) > 0.5, "the pointer has not moved"


def test_a_typed_threshold_and_another_density(driver, results):
    choose(driver, "response", "eta")
    choose(driver, "strain", len(results.strain) - 1)
    for place, mu_iso in enumerate((0.04, 0.1)):
        choose(driver, "set", place)
        choose(driver, "threshold", 0.66)
        threshold, probability = read_off(driver)
        assert threshold == 0.66
        assert abs(probability - expected(results, "eta", mu_iso, -1, 0.66)) < TOLERANCE
    choose(driver, "set", 0)


def test_denoised_values_are_those_of_the_model(driver, results):
    from analysis.tables.explore import denoised_pdf

    choose(driver, "response", "eta")
    choose(driver, "strain", 40)
    choose(driver, "kind", "denoised")
    pdf = denoised_pdf(results, "eta", 0.04)
    for threshold in (0.6, 0.66, 0.72, 0.9):
        choose(driver, "threshold", threshold)
        assert abs(read_off(driver)[1] - float(pdf.exceedance(threshold)[40])) < TOLERANCE
    choose(driver, "kind", "as simulated")


def test_dragging_the_slider_moves_the_strain_and_the_plots(driver, results):
    from selenium.webdriver.common.action_chains import ActionChains

    slider = driver.find_element("id", "strain")
    choose(driver, "strain", 0)
    before = driver.find_element("css selector", "#pdf .gtitle").text
    ActionChains(driver, duration=50).move_to_element_with_offset(
        slider, -slider.size["width"] // 2 + 8, 0
    ).click_and_hold().move_by_offset(slider.size["width"] // 2, 0).release().perform()
    k = int(slider.get_property("value"))
    assert 20 < k < len(results.strain) - 20
    shown = f"{100 * results.strain[k]:.3g} % strain"
    assert driver.find_element("css selector", "#pdf .gtitle").text == f"PDF at {shown}" != before
    assert shown in driver.find_element("id", "readout").text


def test_a_click_into_the_curves_sets_the_strain(driver):
    choose(driver, "strain", 0)
    point_at(driver, "along", 0.75)
    driver.find_element("css selector", "#along .nsewdrag").click()  # in its middle
    assert 20 < int(driver.find_element("id", "strain").get_property("value")) < 60


def test_the_shown_pdf_is_that_of_the_results_in_displayed_units(driver, results):
    choose(driver, "response", "eps_v")
    choose(driver, "strain", 50)
    x, y = (driver.execute_script(f"return document.getElementById('pdf').data[0].{axis}") for axis in "xy")
    pdf = results.response("eps_v", 0.04).pdf
    assert np.sum(y) * (x[1] - x[0]) == pytest.approx(1.0, abs=1e-4)
    np.testing.assert_allclose(np.dot(x, y) * (x[1] - x[0]), 100 * (pdf.p[50] @ pdf.x) * pdf.dx[50], rtol=1e-4)
    assert "(1/%)" in driver.find_element("css selector", "#pdf .ytitle").text


def test_points_have_the_colour_of_the_chosen_input_and_the_joint_density_follows(driver, results):
    points = results.points
    for name, values in (("G_p", points.G_p * 1e-9), ("mu_s", points.mu_s)):
        choose(driver, "colour", name)
        colour = driver.execute_script("return document.getElementById('joint').data.at(-1).marker.color")
        np.testing.assert_allclose(colour, values, rtol=1e-12)
    choose(driver, "response", "eta")
    choose(driver, "second", "e")
    choose(driver, "strain", 50)
    x, y = (driver.execute_script(f"return document.getElementById('joint').data.at(-1).{axis}") for axis in "xy")
    np.testing.assert_allclose(x, results.response("eta", 0.04).values[50], rtol=1e-6)
    np.testing.assert_allclose(y, results.response("e", 0.04).values[50], rtol=1e-6)
    z, gx, gy = (driver.execute_script(f"return document.getElementById('joint').data[0].{axis}") for axis in "zxy")
    assert np.sum(z) * (gx[1] - gx[0]) * (gy[1] - gy[0]) == pytest.approx(1.0, abs=0.02)


def test_it_fits_a_phone(driver):
    from selenium.webdriver.support.ui import WebDriverWait

    driver.set_window_size(500, 900)
    fits = "return [...document.querySelectorAll('.plots .main-svg')].every((e) => e.clientWidth <= window.innerWidth)"
    WebDriverWait(driver, 30).until(lambda page: page.execute_script(fits))
    assert driver.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    driver.set_window_size(1300, 1000)


def test_no_request_leaves_the_page_and_none_could(driver):
    requests = []
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            requests.append(message["params"]["request"]["url"])
    outside = [url for url in requests if not url.startswith(("file:", "data:", "blob:"))]
    assert requests and outside == [] and sum(url.startswith("file:") for url in requests) == 1
    refused = driver.execute_async_script(
        "const done = arguments[0]; fetch('https://example.org/').then(() => done('sent'), () => done('refused'))"
    )
    assert refused == "refused"
    assert any("Content Security Policy" in entry["message"] for entry in driver.get_log("browser"))
