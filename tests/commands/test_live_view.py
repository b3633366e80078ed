"""A running scan on a page: what a page gets, and that the scan does not notice."""

from __future__ import annotations

import socket
import threading
import urllib.request

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from surfuse.commands.acquire import acquisition
from surfuse.commands.outcome import SilentWatcher
from surfuse.commands.show import live_view as live
from surfuse.commands.show.map_so_far import WorkShare, filled
from surfuse.errors import SafetyStopError
from surfuse.records import MapGrid, Regime, SurfaceMap
from surfuse.report.live_scene import LiveScene
from surfuse.settings import load

HOW = ["scene.name=flat", "scan.step_m=0.04", "arm.driver=kinematic", "fusion.method=weighted_average"]


class Page(threading.Thread):
    """What a browser does before it draws: it connects, and reads all messages until the server ends."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.heard: list[dict] = []
        self.link = connect(
            address.replace("http", "ws"),
            subprotocols=[f"viser-v{viser.__version__}"],
            origin=address,
            max_size=None,
            ping_interval=None,
        )
        self.start()

    def run(self) -> None:
        try:
            while True:
                raw = self.link.recv()
                inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + int.from_bytes(raw[8:16], "little")])
                self.heard += msgspec.msgpack.decode(inner)["messages"]
        except ConnectionClosed:
            pass

    def texts(self) -> str:
        """All that the page was told in words."""
        return str([one for one in self.heard if one["type"].startswith("Gui")])

    def names(self) -> set[str]:
        """The nodes of the scene that the page was given."""
        return {one["name"] for one in self.heard if "name" in one}


class SlowEnough(SilentWatcher):
    """Lets every sweep wait until the page was drawn once more: nothing depends on the speed of the machine."""

    def __init__(self, drawn: threading.Event) -> None:
        self.drawn, self.scanning = drawn, False

    def stage(self, name: str, total: int = 1) -> None:
        self.scanning = name == "scan"

    def advance(self, steps: int = 1) -> None:
        if self.scanning and steps:
            self.drawn.clear()
            assert self.drawn.wait(120)


@pytest.fixture
def unhurried(monkeypatch):
    """The page is drawn as often as the thread comes round, map included; the event says that it was."""
    drawn = threading.Event()
    monkeypatch.setattr(live, "PERIOD_S", 0.0)
    monkeypatch.setattr(live, "TICK_S", 0.001)
    monkeypatch.setattr(live, "DRAWING_SHARE", 1e9)
    monkeypatch.setattr(live, "MAP_SHARE", 1e9)
    before = live._Drawer.draw

    def draw(self):
        before(self)
        drawn.set()

    monkeypatch.setattr(live._Drawer, "draw", draw)
    return drawn


def scan(folder, view=None, watcher=None):
    how = load(None, HOW)
    return acquisition.acquire(how, folder, watcher or SilentWatcher(), *([view] if view is not None else []))


def test_pages_opened_early_late_and_twice_see_the_scan_and_the_map_keeps_its_bits(
    tmp_path, flat_run, map_bits, unhurried
):
    warnings, told = [], []
    with live.live_view(0, warnings.append, told.append) as view:
        early = [Page(told[0]), Page(told[0])]
        scan(tmp_path / "run", view, SlowEnough(unhurried))
        late = Page(told[0])
        while "<b>done</b>" not in late.texts():
            late.join(0.01)
    for page in (*early, late):
        page.join(300)
        wanted = {"/array/sensor 1", "/array/sensor 4", "/beams", "/arm/link 1", "/map", "/planned", "/scale/u"}
        assert wanted <= page.names()
        assert "height, mm" in page.texts()
        assert "<b>done</b>" in page.texts()
    assert "stops</b>, " in early[0].texts()
    assert " left" in early[0].texts()
    assert warnings == []
    assert len(told) == 1
    assert map_bits(tmp_path / "run") == map_bits(flat_run)


def test_a_fault_of_the_page_is_one_warning_and_the_scan_goes_on(tmp_path, flat_run, map_bits, monkeypatch, unhurried):
    def broken(self, sweep):
        unhurried.set()
        raise RuntimeError("no ink")

    monkeypatch.setattr(LiveScene, "add", broken)
    warnings = []
    with live.live_view(0, warnings.append, lambda _: None) as view:
        scan(tmp_path / "run", view)
        while not warnings:
            threading.Event().wait(0.01)
    assert len(warnings) == 1
    assert "no ink" in warnings[0]
    assert "the scan goes on" in warnings[0]
    assert map_bits(tmp_path / "run") == map_bits(flat_run)


def test_no_message_of_a_page_changes_or_stops_anything(tmp_path, flat_run, map_bits, unhurried):
    told = []
    with live.live_view(0, pytest.fail, told.append) as view:
        page = Page(told[0])
        for kind in ("GuiUpdateMessage", "ShareUrlRequest", "RunJavascriptMessage", "RemoveSceneNodeMessage"):
            nonsense = {"type": kind, "uuid": "x", "updates": {"value": 1}, "source": "", "name": "/map"}
            page.link.send(msgspec.msgpack.encode(nonsense))
        page.link.close()
        scan(tmp_path / "run", view)
        with urllib.request.urlopen(told[0], timeout=300) as answer:
            assert answer.status == 200
    assert map_bits(tmp_path / "run") == map_bits(flat_run)


def test_address_is_said_once_on_stderr_and_stdout_is_the_document_alone(command, tmp_path):
    how = [part for text in HOW for part in ("--set", text)]
    answer = command("acquire", *how, "--out", tmp_path / "run", "--view", "--json")
    assert answer.status == 0
    assert answer.json["complete"] is True
    (line,) = answer.err.splitlines()
    assert line.startswith("surfuse: live view: http://127.0.0.1:")


def test_a_command_whose_page_nobody_opened_ends_with_the_scan(command, tmp_path):
    how = [part for text in HOW for part in ("--set", text)]
    answer = command("acquire", *how, "--out", tmp_path / "run", "--view", "--quiet")
    assert answer.status == 0
    assert "stays" not in answer.err


def test_busy_port_is_said_before_anything_is_begun(command, tmp_path):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        answer = command("acquire", "flat", "--out", tmp_path / "run", "--view", "--view-port", port)
    answer.error(2, str(port), "0 takes any free one")
    assert not (tmp_path / "run").exists()


def test_threads_and_port_are_gone_after_a_scan_that_failed():
    before, told = set(threading.enumerate()), []
    with pytest.raises(SafetyStopError), live.live_view(0, pytest.fail, told.append):
        raise SafetyStopError("the arm stands")
    assert set(threading.enumerate()) <= before
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", int(told[0].rsplit(":", 1)[1])), timeout=300)


def test_work_begins_only_while_what_was_spent_is_within_the_share():
    now = [0.0]
    share = WorkShare(0.1, lambda: now[0])
    assert share.allows()
    share.spend(2.0)
    now[0] = 19.9
    assert not share.allows()
    now[0] = 20.1
    assert share.allows()


def flat_map(height, mask):
    mask = np.array(mask)
    return SurfaceMap(
        grid=MapGrid(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.eye(4)),
        height_m=np.where(mask, height, np.nan),
        sigma_m=np.where(mask, height, np.nan),
        confidence=np.where(mask, 1.0, 0.0),
        count=np.where(mask, 2, 0),
        mask=mask,
        regime=np.where(mask, int(Regime.MEASURED), int(Regime.EMPTY)),
        method="x",
    )


def test_work_that_would_overdraw_the_share_does_not_begin():
    now = [10.0]
    share = WorkShare(0.1, lambda: now[0])
    now[0] = 15.0
    assert share.allows(0.4)
    assert not share.allows(0.6)


def test_first_map_wins_where_both_have_a_value():
    both = filled(flat_map(1.0, [[True, False], [True, False]]), flat_map(2.0, [[True, True], [False, False]]))
    np.testing.assert_array_equal(both.height_m, [[1.0, 2.0], [1.0, np.nan]])
    np.testing.assert_array_equal(both.mask, [[True, True], [True, False]])
