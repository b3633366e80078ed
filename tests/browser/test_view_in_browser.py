"""The pages of a scan and of a recording in a real browser: drawn, without a word, and asking nobody else."""

from __future__ import annotations

import json
import re
import sys
import threading
from pathlib import Path

import numpy as np

from surfuse import settings
from surfuse.commands.acquire.recording import record_run
from surfuse.commands.outcome import SilentWatcher
from surfuse.commands.show.live_view import live_view
from surfuse.report.viewer import opened

BRIDGE = Path(__file__).parents[1] / "commands" / "moving_bridge.py"
TEXT = "document.body.innerText"
OURS = ("data:", "blob:", "about:")


def colours(browser, folder: Path) -> int:
    """How many colours the middle of the page has: one says that nothing was drawn."""
    import cv2

    browser.picture(folder / "page.png")
    picture = cv2.imread(str(folder / "page.png"))
    height, width = picture.shape[:2]
    middle = picture[height // 5 : -height // 5, width // 5 : -2 * width // 5]
    return len(np.unique(middle.reshape(-1, 3), axis=0))


def wait_for(browser, code: str) -> None:
    """Until an expression on the page is true; the time-out of the test bounds a hang."""
    while not browser.run(code):
        browser.settle()


def test_view_is_drawn_and_plays_without_a_word_and_asks_nobody_else(browser, synthetic_run, tmp_path):
    with opened(synthetic_run.report_content(), 0) as address:
        browser.visit(address)
        wait_for(browser, "document.body.innerText.includes('height, mm')")
        while colours(browser, tmp_path) < 50:
            browser.settle()
        text = browser.run("document.body.innerText")
        assert "no reading holds it" in text
        assert "echo kept out" in text
        browser.run("[...document.querySelectorAll('button')].find((one) => one.innerText === 'Play').click()")
        wait_for(browser, "[...document.querySelectorAll('button')].some((one) => one.innerText === 'Pause')")
        assert browser.complaints() == []
        assert all(url.startswith((address, *OURS)) for url in browser.requests())
        assert browser.run('fetch("http://127.0.0.1:9/").then(() => "sent", () => "refused")') == "refused"


class UntilTold(SilentWatcher):
    """Goes on until the test has seen enough."""

    def __init__(self) -> None:
        self.enough = threading.Event()

    def stop_requested(self) -> bool:
        return self.enough.is_set()


def cell(folder: Path) -> Path:
    command = json.dumps([sys.executable, str(BRIDGE), "waits", "0.02"])
    sensor = '[[sensor]]\nname = "us0"\nkind = "laser"\nposition_m = [-0.02, 0.0, 0.0]\nbeam_full_angle_deg = 1.0\n'
    sensor += "range_min_m = 0.05\nrange_max_m = 1.2\nsigma_m = 0.0005\n"
    path = folder / "rig.toml"
    path.write_text(f'[arm]\ndriver = "bridge"\ncommand = {command}\n{sensor}[scan]\nstep_m = 0.01\n', "utf-8")
    return path


def cells(browser) -> int:
    found = re.search(r"(\d+) cells", browser.run(TEXT))
    return int(found.group(1)) if found else 0


def test_the_page_of_a_recording_shows_the_map_grow(browser, tmp_path):
    watcher, told, warnings = UntilTold(), [], []
    with live_view(0, warnings.append, told.append) as view:
        recording = threading.Thread(
            target=record_run,
            args=(settings.load(cell(tmp_path), ["fusion.method=mean"]), tmp_path / "run", watcher),
            kwargs={"observer": view},
        )
        recording.start()
        try:
            browser.visit(told[0])
            wait_for(browser, f"/recording: \\d+ sweeps/.test({TEXT})")
            wait_for(browser, f"{TEXT}.includes('height, mm')")
            first = cells(browser)
            while cells(browser) <= first or colours(browser, tmp_path) < 50:
                browser.settle()
        finally:
            watcher.enough.set()
            recording.join(300)
        wait_for(browser, f"/done: \\d+ sweeps/.test({TEXT})")
        assert "median sigma" in browser.run(TEXT)
        assert browser.complaints() == []
    assert warnings == []
    assert (tmp_path / "run" / "surface.nc").is_file()
