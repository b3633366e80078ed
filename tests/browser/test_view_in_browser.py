"""The page of a scan in a real browser: drawn, without a word on the console, and asking nobody else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.report.viewer import opened

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
