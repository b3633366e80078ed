"""The driver in docs/how-to/own_sensor.md is whole: it is installed as another package would, and reads a plate."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "contracts"))
from serial_stand_in import TalkingLine

from surfuse import registry
from surfuse.errors import ConfigError
from surfuse.interfaces import STANDING_ALONE
from surfuse.records import Status
from surfuse.registry import folders, listed

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own_sensor.md"


@pytest.fixture
def driver(tmp_path, monkeypatch):
    """The page's module and entry point in a package of their own."""
    text = PAGE.read_text("utf-8")
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "SUMMARY" in block]
    (group, point) = re.search(r'entry-points\."(.*?)"\]\n(.*?)\n```', text).groups()
    package, info = tmp_path / "my_package", tmp_path / "mine-1.0.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").touch()
    (package / "my_ranger.py").write_text(code, "utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(f"[{group}]\n{point.replace(chr(34), '')}\n", "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    folders.found.cache_clear()
    listed.listing.cache_clear()
    yield "my_ranger"
    monkeypatch.undo()
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_package"]:
        del sys.modules[name]
    folders.found.cache_clear()
    listed.listing.cache_clear()


def test_the_driver_of_the_page_is_listed_and_reads_a_plate(driver):
    listing = registry.listing("sensors")
    assert driver in listing.names
    assert listing.left_out == ()
    with TalkingLine(bytes.fromhex("AA 01 F4 9F")) as line:
        table = {"port": line.port, "timeout_s": 20}
        parameters = registry.parameters("sensors", driver, table, "sensor us0", STANDING_ALONE)
        with registry.load("sensors", driver).create(parameters) as sensor:
            echo = sensor.fire()
    assert (echo.status, echo.range_m) == (Status.OK, 0.5)
    assert sensor.spec.name == "my_ranger"


def test_its_parameters_are_checked(driver):
    with pytest.raises(ConfigError, match="timeout_s = 0"):
        registry.parameters("sensors", driver, {"port": "COM3", "timeout_s": 0}, "sensor us0")
