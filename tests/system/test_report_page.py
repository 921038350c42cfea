"""The report in a real browser, headless Chromium, as people use it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from rigcal import Registry, build_targets, calibrate, load_rig, write_report
from rigcal.geometry import se3
from rigcal.observation import Observation

RIG = Path(__file__).parents[1] / "integration" / "pipeline" / "cart.yaml"
SENSORS = ["left", "lidar", "right", "scan"]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of 20 boards in front of a small rig, features simulated."""
    registry = Registry.from_entry_points()
    rig, rng = load_rig(RIG, registry), np.random.default_rng(0)
    (target,) = build_targets(rig, registry).values()
    facing = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    observations = []
    for i in range(20):
        T_root_t = np.eye(4)
        T_root_t[:3, :3] = facing @ se3.exp_so3(rng.uniform(-0.6, 0.6, 3))
        T_root_t[:3, 3] = [rng.uniform(1.8, 3.0), *rng.uniform(-0.4, 0.4, 2)]
        for name, config in rig.sensors.items():
            kind = registry.sensor_type(config.type)
            T_root_s = np.eye(4) if config.pose is None else config.pose.T_parent_sensor
            found = kind.observe(se3.inverse(T_root_s) @ T_root_t, config, target, rng)
            if found is not None:
                observations.append(Observation(name, f"{i:04d}", i, f"{name} {i}", (found,)))
    out = tmp_path_factory.mktemp("report") / "report.html"
    write_report(out, calibrate(rig, registry, observations), observations, rig, registry)
    return out


@pytest.fixture(scope="module")
def browser(page: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "no-first-run", "disable-sync",
                 "disable-background-networking", "disable-component-update",
                 f"user-data-dir={tmp_path_factory.mktemp('profile')}"):  # fmt: skip
        options.add_argument(f"--{flag}")
    driver = shutil.which("chromedriver") or "chromedriver"
    service = Service(driver, env={**os.environ, "NO_PROXY": "localhost,127.0.0.1"})
    browser = webdriver.Chrome(options=options, service=service)
    yield browser
    browser.quit()


@pytest.fixture(params=[1280, 400])
def shown(request: pytest.FixtureRequest, browser: Any, page: Path) -> Any:
    """The report, freshly opened in a window of some width."""
    size = {"width": request.param, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(page.as_uri())
    return browser


def test_it_opens_without_a_complaint(shown: Any) -> None:
    assert shown.get_log("browser") == []


def test_it_is_as_wide_as_its_window(shown: Any) -> None:
    root = shown.find_element("css selector", "html")
    assert root.get_property("scrollWidth") <= root.get_property("clientWidth")


def test_the_rig_turns_by_mouse_and_zooms_by_wheel(shown: Any) -> None:
    canvas = shown.find_element("id", "rig3d")
    shown.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    picture = canvas.screenshot_as_png
    view = {key: float(canvas.get_attribute(f"data-{key}")) for key in ("yaw", "size")}
    ActionChains(shown).drag_and_drop_by_offset(canvas, 80, 0).perform()
    turned = canvas.screenshot_as_png
    assert float(canvas.get_attribute("data-yaw")) == pytest.approx(view["yaw"] - 0.64, abs=0.05)
    assert turned != picture
    wheel = "arguments[0].dispatchEvent(new WheelEvent('wheel', {deltaY: -500, cancelable: true}))"
    shown.execute_script(wheel, canvas)
    assert float(canvas.get_attribute("data-size")) < 0.7 * view["size"]
    assert canvas.screenshot_as_png != turned


def test_the_rig_turns_by_keys_and_never_over_the_pole(shown: Any) -> None:
    canvas = shown.find_element("id", "rig3d")
    yaw = float(canvas.get_attribute("data-yaw"))
    canvas.send_keys(Keys.ARROW_LEFT, *[Keys.ARROW_UP] * 20)
    assert float(canvas.get_attribute("data-yaw")) == pytest.approx(yaw - 0.1, abs=1e-3)
    assert float(canvas.get_attribute("data-pitch")) == pytest.approx(1.55, abs=1e-3)


def test_parts_of_the_3d_view_can_be_hidden(shown: Any) -> None:
    canvas = shown.find_element("id", "rig3d")
    for part in ("boards", "views", "names"):
        before = canvas.screenshot_as_png
        shown.find_element("id", f"show-{part}").click()
        assert canvas.screenshot_as_png != before, part


def test_tables_sort_by_the_clicked_column(shown: Any) -> None:
    def column(number: int) -> list[str]:
        rows = shown.find_elements("css selector", "#transforms tbody tr")
        return [row.find_elements("tag name", "td")[number].text for row in rows]

    heads = shown.find_elements("css selector", "#transforms thead th")
    shown.execute_script("arguments[0].click()", heads[3])
    numbers = [float(text) for text in column(3)]
    assert numbers == sorted(numbers)
    shown.execute_script("arguments[0].click()", heads[3])
    assert [float(text) for text in column(3)] == numbers[::-1]
    shown.execute_script("arguments[0].click()", heads[0])
    assert column(0) == [name for name in SENSORS if name != "lidar"]
