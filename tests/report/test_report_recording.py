import base64
import re
import socket
import threading
import urllib.request
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard

from surfuse.errors import ConfigError, UsageError
from surfuse.report.content import ReportContent
from surfuse.report.quiet_viewer import loopback_server
from surfuse.report.recording import HOLD_S, SCAN_S, record_scan
from surfuse.report.scene_limits import SceneLimits
from surfuse.report.viewer import opened, serve


def messages_of(html):
    """The recording inside the player: length, compressed msgpack, buffers."""
    code = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', html).group(1)
    raw = base64.b64decode(code)
    inner = zstandard.ZstdDecompressor().decompress(raw[8:], max_output_size=int.from_bytes(raw[:8], "little"))
    size = int.from_bytes(inner[:8], "little")
    return msgspec.msgpack.decode(inner[8 : 8 + size])


def of_type(recording, name):
    return [(at, one) for at, one in recording["messages"] if one["type"] == name]


@pytest.fixture(scope="module")
def recording(run_content):
    return messages_of(record_scan(run_content, SceneLimits(frames_max=50)))


def test_recording_lasts_the_scan_and_the_last_look(recording):
    assert recording["durationSeconds"] == pytest.approx(SCAN_S + HOLD_S)
    times = [at for at, _ in recording["messages"]]
    assert times == sorted(times)


def test_recording_holds_surfaces_arm_array_beams_and_points(recording):
    names = {one["name"] for _, one in recording["messages"] if "name" in one}
    wanted = {"/surfaces/1 fused (weighted_average)", "/surfaces/2 spline", "/surfaces/3 beam", "/surfaces/truth"}
    wanted |= {"/arm/link 1", "/array/sensor 4", "/beams", "/outline", "/cell/1", "/points/1"}
    assert wanted <= names


def test_the_array_goes_through_the_stops_in_order(recording, run_content):
    path = [one["position"] for _, one in of_type(recording, "SetPositionMessage") if one["name"] == "/array"]
    grips = run_content.readings.world_from_grip[:, :3, 3]
    asked = np.unique(np.linspace(0, len(grips) - 1, 50).astype(int))
    assert np.allclose(path[-len(asked) :], grips[asked], atol=1e-9)


def test_points_grow_with_the_scan_and_all_stops_with_a_value_end_as_points(recording, run_content):
    shown, history = {}, []
    for at, one in of_type(recording, "SceneNodeUpdateMessage"):
        if one["name"].startswith("/points/") and "points" in one["updates"]:
            buffer = one["updates"]["points"]["__binary_index"]
            shown[one["name"]] = recording["binaryBufferLengths"][buffer] // 12
            history.append((at, sum(shown.values())))
    assert sum(shown.values()) == int(np.isfinite(run_content.points.depth_m).sum())
    half = max(count for at, count in history if at <= SCAN_S / 2)
    assert 0.3 < half / history[-1][1] < 0.7


def test_the_surface_appears_at_the_end(recording):
    name = "/surfaces/1 fused (weighted_average)"
    seen = [
        (at, one["visible"]) for at, one in of_type(recording, "SetSceneNodeVisibilityMessage") if one["name"] == name
    ]
    assert seen[-2] == (0.0, False)
    assert seen[-1] == (pytest.approx(SCAN_S), True)


def test_what_the_recording_needs_is_optional():
    assert messages_of(record_scan(ReportContent(title="x")))["durationSeconds"] == 0.0


def test_readings_without_points_maps_and_arm_replay(run_content):
    bare = ReportContent(title="x", readings=run_content.readings)
    assert messages_of(record_scan(bare, SceneLimits(frames_max=5)))["durationSeconds"] == pytest.approx(19.0)


def test_nothing_is_printed_and_no_thread_is_left(run_content, capsys):
    before = set(threading.enumerate())
    record_scan(run_content, SceneLimits(frames_max=3))
    assert set(threading.enumerate()) <= before
    assert capsys.readouterr().out == ""


def test_limits_are_checked():
    with pytest.raises(ConfigError, match="frames_max = 0"):
        SceneLimits(frames_max=0)


def test_slash_in_a_label_stays_one_name(run_content):
    odd = replace(run_content.maps[0], label="a/b")
    names = {
        one["name"]
        for _, one in messages_of(record_scan(ReportContent(title="x", maps=(odd,))))["messages"]
        if "name" in one
    }
    assert "/surfaces/1 a-b" in names


def listeners(port):
    """Local addresses that listen on a port, from the kernel's table."""
    table = Path("/proc/net/tcp")
    if not table.exists():
        pytest.skip("no /proc/net/tcp")
    rows = [line.split() for line in table.read_text().splitlines()[1:]]
    return {row[1].split(":")[0] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == port}


def test_viewer_listens_on_the_loopback_address_only(run_content, capsys):
    with opened(run_content, 0) as address:
        port = int(address.rsplit(":", 1)[1])
        assert listeners(port) == {"0100007F"}
        with urllib.request.urlopen(address, timeout=300) as answer:
            assert b"<html" in answer.read(5000)
    assert listeners(port) == set()
    assert capsys.readouterr().out == ""


def test_busy_port_is_said_and_no_other_one_is_taken():
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        asked = busy.getsockname()[1]
        with pytest.raises(UsageError, match=f"{asked}.*in use"), opened(ReportContent(title="x"), asked):
            pass


def test_free_port_that_was_asked_for_is_taken():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        asked = free.getsockname()[1]
    with opened(ReportContent(title="x"), asked) as address:
        assert address == f"http://127.0.0.1:{asked}"


def test_viewer_serves_until_told_to_stop(run_content):
    heard, stop = [], threading.Event()

    def announce(address):
        heard.append(address)
        stop.set()

    before = set(threading.enumerate())
    serve(run_content, 0, announce, stop)
    assert heard[0].startswith("http://127.0.0.1:")
    assert set(threading.enumerate()) <= before


def test_viewer_refuses_to_open_a_tunnel():
    with loopback_server(0, "x") as server:
        assert server.request_share_url() is None
        assert server._share_tunnel is None


def test_impossible_ports_are_refused():
    with pytest.raises(UsageError, match="70000"), opened(ReportContent(title="x"), 70000):
        pass


def test_stray_port_variable_is_ignored(monkeypatch):
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "1")
    with loopback_server(0, "x") as server:
        assert server.get_port() > 1024
