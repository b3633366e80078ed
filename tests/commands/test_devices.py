"""The listing of devices, from a made-up /sys and /dev."""

import json

from surfuse.commands.machine.devices import devices
from surfuse.commands.outcome import finite


def test_found_devices_are_told_with_what_to_do(tmp_path):
    net = tmp_path / "sys" / "class" / "net" / "can0"
    iio = tmp_path / "sys" / "bus" / "iio" / "devices" / "iio:device0"
    for folder, files in (
        (net, {"type": "280", "operstate": "down"}),
        (iio, {"name": "vl53l1x", "in_distance_raw": "5"}),
    ):
        folder.mkdir(parents=True)
        for name, text in files.items():
            (folder / name).write_text(text + "\n")
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev" / "video0").touch()
    outcome = devices(tmp_path / "sys", tmp_path / "dev")
    rows = dict(outcome.table)
    assert "down; ip link set can0" in rows["can socketcan can0"]
    assert rows[f"camera {tmp_path / 'dev' / 'video0'}"] == "no name"
    assert "plug-in iio, model 'vl53l1x'" in rows[f"iio {iio}"]
    assert "virtual" in rows["python-can"]
    assert rows["sensor driver iio"].startswith("rangers behind the Linux industrial I/O files")
    assert "needs the package" not in rows["camera driver recorded"]
    data = json.loads(json.dumps(finite(outcome.summary)))
    assert {one["name"] for one in data["drivers"]["arms"]} >= {"recorded", "simulated", "trident", "ur_rtde"}
    assert data["can_adapters"][0]["channel"] == "can0"
    assert data["iio_devices"][0]["model"] == "vl53l1x"


def test_nothing_is_an_answer_too(tmp_path, monkeypatch):
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    assert devices(tmp_path, tmp_path).table[0] == ("devices", "none found")
