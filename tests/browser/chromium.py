"""A small driver of a headless Chromium over its debugging socket: enough to open a page, act, and listen."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
)
PATIENCE_S = 300.0  # bounds a hang; nothing waits so long for an answer that comes


def executable() -> str | None:
    """Path of an installed Chromium or Chrome, None without one."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for path in map(shutil.which, names) if path), None)


class Chromium:
    """One browser with one tab, closed by `with`."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="surfuse-chromium-"))
        self.events: list[dict] = []
        self.count = 0

    def __enter__(self) -> Chromium:
        from websockets.sync.client import connect

        command = [executable(), *FLAGS, f"--user-data-dir={self.folder}", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        told = self.folder / "DevToolsActivePort"
        end = time.monotonic() + PATIENCE_S
        while not (told.exists() and "\n" in told.read_text()):
            if time.monotonic() > end:
                raise TimeoutError("Chromium does not answer")
            time.sleep(0.05)
        port = int(told.read_text().splitlines()[0])
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=PATIENCE_S) as answer:
            tab = next(one for one in json.load(answer) if one["type"] == "page")
        # No keepalive: its thread draws from the global `random`, which hypothesis watches in tests that run later.
        self.socket = connect(tab["webSocketDebuggerUrl"], max_size=None, ping_interval=None)
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()
        self.process.terminate()
        self.process.wait(timeout=PATIENCE_S)
        shutil.rmtree(self.folder, ignore_errors=True)

    def ask(self, method: str, **parameters: object) -> dict:
        """One command and its answer; events on the way are kept."""
        self.count += 1
        mine = self.count
        self.socket.send(json.dumps({"id": mine, "method": method, "params": parameters}))
        while True:
            heard = json.loads(self.socket.recv(timeout=PATIENCE_S))
            if heard.get("id") == mine:
                assert "error" not in heard, heard
                return heard["result"]
            self.events.append(heard)

    def open(self, path: Path, width: int = 1280, height: int = 900, dark: bool = False) -> None:
        """Load a file at a window size and wait until it is drawn."""
        self.visit(path.as_uri(), width, height, dark)

    def visit(self, address: str, width: int = 1280, height: int = 900, dark: bool = False) -> None:
        """Load an address at a window size and wait until it is drawn."""
        self.events.clear()
        self.ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])
        self.ask("Page.navigate", url=address)
        end = time.monotonic() + PATIENCE_S
        while self.run("document.readyState") != "complete" or self.run("location.href") == "about:blank":
            assert time.monotonic() < end
            time.sleep(0.05)
        self.settle()

    def run(self, code: str) -> object:
        """The value of an expression on the page."""
        answer = self.ask("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait for two drawn frames."""
        self.run(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 30))))"
        )

    def move(self, x: float, y: float) -> None:
        """Move the mouse."""
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.settle()

    def picture(self, path: Path) -> None:
        """A screenshot of the whole page."""
        answer = self.ask("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(answer["data"]))

    def requests(self) -> list[str]:
        """Addresses that the page asked for."""
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]

    def complaints(self) -> list[str]:
        """Exceptions, and errors on the console."""
        found = [str(e["params"]) for e in self.events if e["method"] == "Runtime.exceptionThrown"]
        calls = [e["params"] for e in self.events if e["method"] == "Runtime.consoleAPICalled"]
        logs = [e["params"]["entry"] for e in self.events if e["method"] == "Log.entryAdded"]
        found += [str(call) for call in calls if call["type"] in ("error", "assert")]
        return found + [str(entry) for entry in logs if entry["level"] == "error"]
