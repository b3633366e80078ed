"""The HTML document around the sections: style, scripts, data, and a policy that forbids any outside request."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

from surfuse.durable import replace_file
from surfuse.errors import StorageError
from surfuse.report.markup import Child, Markup, element, join, script_json

SCRIPTS = (
    "decode.js",
    "scales.js",
    "heatmap.js",
    "cut.js",
    "relief.js",
    "readout.js",
    "explorer.js",
    "comparison.js",
    "side_by_side.js",
    "page.js",
)

# The browser itself refuses every outside address; blob:, data: and WebAssembly are what the embedded player needs.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; worker-src blob: data:; connect-src data: blob:; media-src data: blob:; "
    "form-action 'none'; base-uri 'none'"
)

# Stands for "<" where the text of the recording could end or nest the script element that carries it.
SENTINEL = "\x01"


def _asset(name: str) -> str:
    return (files("surfuse.report") / "assets" / name).read_text(encoding="utf-8")


def stylesheet() -> str:
    """The style of all pages."""
    return _asset("page.css")


def _data(value: object) -> Markup:
    return Markup(f'<script type="application/json" id="surfuse-data">{script_json(value)}</script>')


def _recording(text: str) -> Markup:
    """The player as inert text; the page's script turns the sentinel back when the reader starts it."""
    safe = text
    for mark in ("</script", "</SCRIPT", "<script", "<SCRIPT", "<!--"):
        safe = safe.replace(mark, SENTINEL + mark[1:])
    return Markup(f'<script type="text/plain" id="recording">{safe}</script>')


def document(title: str, header: Markup, body: list[Child], data: object, recording: str, footer: str) -> str:
    """The whole page as text. `recording` is the HTML of the player, empty for none."""
    script = "(() => {\n'use strict';\n" + "\n".join(_asset(name) for name in SCRIPTS) + "})();"
    head = [
        element("meta", {"charset": "utf-8"}),
        element("meta", {"http-equiv": "Content-Security-Policy", "content": POLICY}),
        element("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        element("meta", {"name": "referrer", "content": "no-referrer"}),
        element("title", None, title),
        Markup(f"<style>{stylesheet()}</style>"),
    ]
    quiet = "The maps, cuts and the 3-D view of this page need JavaScript; the texts and tables do not."
    parts: list[Child] = [
        element("header", {"class": "top"}, header),
        element("main", None, element("noscript", None, element("p", {"class": "safety"}, quiet)), *body),
        element("footer", None, footer),
        _data(data),
        *([_recording(recording)] if recording else []),
        Markup(f"<script>{script}</script>"),
    ]
    html = element("html", {"lang": "en"}, element("head", None, *head), element("body", None, *parts))
    return str(join([Markup("<!doctype html>\n"), html, Markup("\n")]))


def write_page(path: Path, page: str) -> None:
    """Write a page so that a reader finds the old file or the new one, never half of it.

    Raises
    ------
    StorageError : the disk refuses.
    """
    half = path.with_name(f".{path.name}.part")
    try:
        with half.open("w", encoding="utf-8", newline="\n") as file:
            file.write(page)
            file.flush()
            os.fsync(file.fileno())
        replace_file(half, path)
    except OSError as error:
        half.unlink(missing_ok=True)
        raise StorageError(
            f"cannot write the report: {error.strerror or error}", where=str(path), cure="free space or choose --out"
        ) from error
