# SPDX-License-Identifier: Apache-2.0
"""The page of `cama view` in Chromium, which draws it in software."""

import io
import os
import re
import shutil

import numpy as np
import pytest

import cama
from cama.viewing.player import Player
from conftest import grid

pytestmark = pytest.mark.long
SLOW = 300_000  # ms; drawing in software on one core


@pytest.fixture
def browser():
    from playwright.sync_api import sync_playwright

    program = os.environ.get("CAMA_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    assert program, "needs Chromium: script/test --all installs it; CAMA_CHROMIUM can name it"
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=flags)
        yield running
        running.close()


@pytest.fixture
def page(browser):
    opened = browser.new_page(viewport={"width": 900, "height": 480})
    opened.set_default_timeout(SLOW)
    opened.asked, opened.problems = [], []
    opened.on("request", lambda request: opened.asked.append(request.url))
    opened.on("websocket", lambda socket: opened.asked.append(socket.url))
    opened.on("pageerror", lambda problem: opened.problems.append(str(problem)))
    return opened


@pytest.fixture
def waves(tmp_path):
    """A recording of a sheet on a ball."""
    scene = cama.Scene(name="on a ball", time_step=1 / 60)
    scene.add_cloth(*grid(12, z=0.27), name="sheet")
    scene.add_obstacle(shape={"sphere": {"radius": 0.25, "triangles": 320}}, name="ball")
    cama.record(cama.Simulation(scene, accuracy="preview", threads=1), tmp_path, frames=30)
    return tmp_path


def opened(page, viewer):
    page.goto(viewer.url)
    page.get_by_label("shadows").set_checked(False)
    page.wait_for_timeout(3000)


def picture(page):
    """The part of the page left of the control panel, [height, width, 3], once it stands still."""
    import imageio.v3 as imageio

    last = None
    for _ in range(60):
        page.wait_for_timeout(1000)
        now = imageio.imread(io.BytesIO(page.screenshot(clip={"x": 0, "y": 200, "width": 560, "height": 280})))[..., :3]
        if last is not None and (now == last).all():
            return now.astype(int)
        last = now
    raise AssertionError("the picture does not come to rest")


def test_a_recording_in_a_browser(waves, page):
    with Player(waves) as viewer:
        opened(page, viewer)
        start = picture(page)
        assert 0.02 < (start[..., 2] > start[..., 0] + 40).mean() < 0.9  # the sheet is blue
        page.get_by_label("repeat").set_checked(False)
        page.get_by_role("button", name="Play").click()
        page.get_by_text("30 of 30").wait_for()
        end = picture(page)
        assert (np.abs(end - start).max(axis=2) > 30).mean() > 0.02
        page.get_by_label("colour by").click()
        page.get_by_role("option", name="speed").click()
        page.get_by_text("speed (m/s)").wait_for()
        colored = picture(page)
        assert (np.abs(colored - end).max(axis=2) > 30).mean() > 0.02
        assert not page.problems
        here = re.compile(rf"(blob:)?{re.escape(viewer.url)}|{re.escape(viewer.url.replace('http', 'ws'))}|data:")
        assert page.asked and all(here.match(url) for url in page.asked)


def test_a_simulation_in_a_browser(page):
    scene = cama.Scene()
    scene.add_cloth(*grid(12), name="sheet")
    simulation = cama.Simulation(scene, accuracy="preview", threads=1)
    with simulation.show() as viewer:
        opened(page, viewer)
        page.get_by_role("button", name="Step one frame").click()
        page.get_by_text(re.compile(r"^0\.0\d*[1-9]\d* s$")).wait_for()
        assert simulation.time == pytest.approx(simulation.scene.seconds_per_frame)
        box = page.locator("canvas").first.bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2 - 40, box["y"] + box["height"] / 2)
        page.wait_for_timeout(3000)
        (grip,) = viewer._grips
        assert len(grip.vertices) >= 1 and not page.problems
