"""The report in a real browser: `pytest -m browser`, where Chromium is installed."""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxradar.drive import RoadStep
from jaxradar.evaluation import Evaluation, Events, Failure, OperatingPoint, Picture, SeriesResult, Settings
from jaxradar.matching import Score, Summary
from jaxradar.report import write_report
from jaxradar.systems.step import ShiftDetector

pytestmark = pytest.mark.browser
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVES = 5000


def result(number: int) -> SeriesResult:
    rng = np.random.default_rng(number)
    times = np.sort(rng.uniform(0, 20, number % 4))
    events = Events(times, *(rng.uniform(0.2, 0.6, len(times)) for _ in range(3)), np.arange(len(times)), 0.16)
    track = 0.45 + 0.02 * np.cumsum(rng.normal(size=160)) / 10
    picture = Picture(
        start_s=0.0,
        stop_s=20.0,
        range_m=np.stack([track, track + 0.01]).astype(np.float32),
        speed_m_s=np.stack([-np.abs(rng.normal(size=160)), np.abs(rng.normal(size=160))]).astype(np.float32),
        statistic=rng.uniform(0, 0.3, 160).astype(np.float32),
        event=np.zeros(160, bool),
        amplitude=rng.integers(0, 256, (32, 80)).astype(np.uint8),
        near_m=0.1,
        far_m=1.0,
    )
    lead_s = 0.05 + 1e-5 * number if number % 2 else None
    score = None if number % 10 == 0 else Score((RoadStep(12.0),), (lead_s,), number % 4)
    problems = ("Something was mended.",) if number % 7 == 0 else ()
    name = f"/logs/{number % 9}/log {number:05d}"
    return SeriesResult(name, 3, 6000, 20.0, 300.0, 5, events, score, problems, picture)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    page = tmp_path_factory.mktemp("report") / "report.html"
    found = Evaluation.of(map(result, range(DRIVES)), Settings(ShiftDetector()))
    found = dataclasses.replace(found, failures=(Failure("/logs/bad", "/logs/bad: is <b>bad</b>."),))
    points = [OperatingPoint(0.1 * n, Summary(5, 36000.0, 60 - 10 * n, 10 * n, 4**n), n == 2) for n in range(4, 0, -1)]
    write_report(found, page, curve=points)
    return page


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        held = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield held
        held.close()


@pytest.fixture
def page(browser: Any, report: Path) -> Iterator[Any]:
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    said: list[str] = []
    asked: list[str] = []
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.on("console", lambda line: said.append(line.text))
    opened.on("request", lambda request: asked.append(request.url))
    opened.goto(report.as_uri())
    opened.wait_for_function("document.documentElement.dataset.ready === 'yes'")
    yield opened
    assert said == []
    assert asked == [report.as_uri()]
    opened.close()


def names(page: Any) -> list[str]:
    return page.locator("tbody tr.row th").all_inner_texts()


def test_five_thousand_series_load_soon(browser: Any, report: Path) -> None:
    taken = []
    for _ in range(3):
        fresh = browser.new_page()
        start = time.monotonic()
        fresh.goto(report.as_uri())
        fresh.wait_for_function("document.documentElement.dataset.ready === 'yes'")
        fresh.locator("tbody tr.row").first.wait_for()
        taken.append(time.monotonic() - start)
        fresh.close()
    print(f"{report.stat().st_size / 1e6:.1f} MB, loaded in {min(taken):.2f} to {max(taken):.2f} s")
    assert report.stat().st_size < 30e6


def test_the_sum_is_what_was_measured(page: Any) -> None:
    text = page.locator("#sum").inner_text()
    assert "5,000" in text
    assert "30,000,000" in text
    assert "1 could not be read" in text
    assert page.locator("#charts svg").count() == 2
    assert page.locator("#charts circle").count() == 4
    assert page.locator("#failures li").text_content() == "/logs/bad: is <b>bad</b>."


def test_sorting_and_filtering(page: Any) -> None:
    assert names(page)[0] == "0/log 00000"
    page.get_by_role("button", name="false", exact=True).click()
    assert page.locator("th[aria-sort=descending]").inner_text() == "false"
    falses = [int(text) for text in page.locator("tbody tr.row td:nth-child(11)").all_inner_texts()]
    assert falses == sorted(falses, reverse=True)
    page.get_by_role("button", name="log", exact=True).click()
    assert names(page) == sorted(names(page))
    page.locator("#words").fill("log 0421")
    assert page.locator("#count").inner_text() == "11 of 5,000"
    page.locator("#kind").select_option("whose truth is not known")
    assert names(page) == ["7/log 04210"]
    page.locator("#words").fill("nothing of that name")
    assert names(page) == []


def test_only_what_is_in_sight_is_in_the_page(page: Any) -> None:
    assert len(names(page)) < 60
    page.locator("#table").focus()
    page.keyboard.press("End")
    page.wait_for_timeout(200)
    assert names(page)[-1].endswith("log 04999")
    assert page.locator("tr.active th").first.inner_text().endswith("log 04999")
    assert len(names(page)) < 60
    assert page.locator("#table").get_attribute("aria-rowcount") == "5001"
    assert page.locator("tr.active th").evaluate("cell => getComputedStyle(cell).textAlign") == "left"


def test_a_row_opens_by_key_and_by_mouse(page: Any) -> None:
    page.locator("#table").focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    dialog = page.locator("dialog")
    dialog.locator("canvas").nth(3).wait_for()
    assert dialog.locator("h2").inner_text() == "1/log 00001, sensor 3"
    labels = [one.get_attribute("aria-label") for one in dialog.locator("canvas").all()]
    assert labels == ["Range over time", "Range rate over time", "Statistic over time", "Amplitude over range and time"]
    for canvas in dialog.locator("canvas").all():
        painted = canvas.evaluate(
            "c => new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size"
        )
        assert painted > 5
    assert dialog.locator("tbody tr").count() == 1
    page.keyboard.press("ArrowRight")
    page.wait_for_function("document.getElementById('detail-heading').textContent.startsWith('2/log 00002')")
    page.keyboard.press("Escape")
    assert not dialog.is_visible()
    assert page.evaluate("document.activeElement.id") == "table"
    page.locator("tbody tr.row").nth(5).click()
    assert dialog.is_visible()


def test_dark_and_light(browser: Any, report: Path) -> None:
    papers = {}
    for scheme in ("light", "dark"):
        opened = browser.new_page(color_scheme=scheme)
        opened.goto(report.as_uri())
        opened.wait_for_function("document.documentElement.dataset.ready === 'yes'")
        papers[scheme] = opened.evaluate("getComputedStyle(document.body).backgroundColor")
        opened.get_by_role("button", name="Dark").click()
        assert opened.evaluate("getComputedStyle(document.body).backgroundColor") != papers[scheme]
        opened.close()
    assert papers == {"light": "rgb(255, 255, 255)", "dark": "rgb(22, 24, 27)"}


def test_every_control_has_a_name(page: Any) -> None:
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, table, svg, canvas")].filter((one) =>
            !(one.getAttribute("aria-label") || one.textContent.trim() || (one.labels && one.labels.length))).length"""
    )
    assert unnamed == 0


def test_the_last_series_by_button_and_the_window_resized(page: Any) -> None:
    page.locator("#table").focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    following = page.get_by_role("button", name="Next")
    following.click()
    assert following.get_attribute("aria-disabled") == "true"
    assert page.evaluate("document.activeElement.id") == "after"  # so the keys go on
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("document.getElementById('detail-heading').textContent.includes('04998')")
    for width in (900, 1000, 1100):
        page.set_viewport_size({"width": width, "height": 900})
    page.wait_for_timeout(300)
    assert page.locator("dialog canvas").count() == 4
    assert page.locator("tr[aria-selected=true]").count() == 1


def test_a_page_without_pictures(browser: Any, tmp_path: Path) -> None:
    results = [dataclasses.replace(result(number), picture=None) for number in range(60)]
    write_report(Evaluation.of(results, Settings(ShiftDetector())), tmp_path / "page.html")
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    opened.goto((tmp_path / "page.html").as_uri())
    opened.wait_for_function("document.documentElement.dataset.ready === 'yes'")
    heights = opened.evaluate(
        "[...document.querySelectorAll('tr.row')].map((row) => row.getBoundingClientRect().height)"
    )
    assert set(heights) == {opened.evaluate("document.querySelector('tr.row').offsetHeight")}
    assert max(heights) < 45
    opened.locator("#table").focus()
    for _ in range(30):
        opened.keyboard.press("ArrowDown")
    box, row = opened.locator("#scroll").bounding_box(), opened.locator("tr.active").bounding_box()
    assert row["y"] + row["height"] <= box["y"] + box["height"] + 1
    opened.locator("#words").fill("there is none of that name")
    assert opened.locator("#rows").inner_text() == "No series is like that."
    opened.locator("#table").focus()
    opened.keyboard.press("ArrowDown")
    assert opened.locator("#table").get_attribute("aria-activedescendant") != "row--1"
    opened.close()
