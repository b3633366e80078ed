"""Plug-ins by name: files of their folders, and those of others, which can neither stop nor replace anything."""

from __future__ import annotations

import sys
import textwrap
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

from surfuse import registry
from surfuse.errors import ConfigError, UsageError
from surfuse.interfaces import STANDING_ALONE, CameraSurroundings
from surfuse.registry import folders, listed

GOOD = """
from dataclasses import dataclass
from surfuse.fusion import mean
SUMMARY = "theirs: the plain average again"
@dataclass(frozen=True)
class Parameters(mean.Parameters):
    '''None of its own.'''
def create(parameters):
    return mean.create(mean.Parameters())
"""
FORMAT = """
SUMMARY, SUFFIXES, MARKS_PRIOR, NOT_READ = "nodes, counted", (".count",), False, "it holds a number"
def write(path, surface, overwrite=False):
    path.write_text(str(surface.mask.sum()))
"""


@dataclass
class Site:
    """A folder of installed packages; real ones, with entry points that importlib finds."""

    path: Path

    def package(self, name: str, points: str, **modules: str) -> None:
        for module, code in modules.items():
            (self.path / f"{module}.py").write_text(textwrap.dedent(code), "utf-8")
        info = self.path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", "utf-8")
        (info / "entry_points.txt").write_text(textwrap.dedent(points), "utf-8")
        forget()


def forget() -> None:
    folders.found.cache_clear()
    listed.listing.cache_clear()


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    modules = set(sys.modules)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield Site(tmp_path)
    monkeypatch.undo()
    for name in set(sys.modules) - modules:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]
    forget()


@pytest.mark.parametrize("kind", registry.KINDS)
def test_every_file_of_the_folder_is_a_plug_in_and_nothing_else(kind):
    folder = Path(import_module(folders.PACKAGES[kind]).__path__[0])
    files = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert files == set(registry.found(kind).built_in)
    assert list(registry.names(kind)) == sorted(registry.names(kind))
    assert files


def test_every_plug_in_folder_is_in_the_registry():
    root = Path(import_module("surfuse").__path__[0])
    told = {path.parent for path in root.rglob("__init__.py") if "every file is a plug-in" in path.read_text("utf-8")}
    assert told == {Path(import_module(package).__path__[0]) for package in folders.PACKAGES.values()}


@pytest.mark.parametrize("kind", registry.KINDS)
def test_an_unknown_name_gets_the_nearest(kind):
    name = registry.names(kind)[0]
    with pytest.raises(UsageError, match=rf"unknown {registry.NOUNS[kind]} .*did you mean '{name}'"):
        registry.load(kind, name + "x")


def test_an_unknown_kind_gets_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'sensors'"):
        registry.names("sensor")


@pytest.mark.parametrize("kind", registry.KINDS)
def test_every_built_in_plug_in_is_listed_in_one_line(kind):
    listing = registry.listing(kind)
    assert set(registry.found(kind).built_in) <= set(listing.names)
    for one in listing.plug_ins:
        assert one.summary or one.needs
        assert "\n" not in one.summary + one.needs


def test_naming_imports_nothing(site):
    site.package("other", "[surfuse.sensors]\nloud = loud", loud="raise RuntimeError('imported')")
    assert "loud" in registry.names("sensors")
    assert "loud" not in sys.modules


def test_another_package_adds_a_plug_in(site, command):
    site.package("other", "[surfuse.fusion]\ntheirs = their_mean", their_mean=GOOD)
    assert "theirs" in registry.names("fusion")
    assert "theirs" not in registry.names("sensors")
    assert registry.load("fusion", "theirs") is sys.modules["their_mean"]
    told = command("methods", "--json")
    assert told.json["methods"]["theirs"] == "theirs: the plain average again"
    assert told.err == ""


def test_another_package_adds_a_format(site, command, flat_run, tmp_path):
    site.package("other", "[surfuse.exporters]\ncounted = counted", counted=FORMAT)
    assert command("export", flat_run, tmp_path / "map.count").status == 0
    assert int((tmp_path / "map.count").read_text()) > 10
    command("evaluate", tmp_path / "map.count", "--truth", flat_run / "truth.ply").error(3, "it holds a number")


BAD = {
    "exits": ("import sys; sys.exit(0)", "SystemExit"),
    "raises": ("raise ValueError('two\\nlines')", "ValueError: two lines"),
    "misses": ("import a_package_that_is_not_there", "a_package_that_is_not_there"),
    "bare": ("VALUE = 1", r"no SUMMARY .*, Parameters .*, create"),
    "loose": ("SUMMARY = 'x'\nParameters = dict\ncreate = dict", "no Parameters"),
    "broken": ("def create(:", "SyntaxError"),
    "absent": (None, "ModuleNotFoundError"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_plug_in_is_named_in_one_line_and_everything_else_goes_on(site, command, name):
    code, why = BAD[name]
    modules = {} if code is None else {f"module_{name}": code}
    points = f"[surfuse.fusion]\n{name} = module_{name}\ntheirs = their_mean\n"
    site.package("other", points, their_mean=GOOD, **modules)
    told = command("methods", "--json")
    assert set(told.json["methods"]) == {*registry.found("fusion").built_in, "theirs"}
    (line,) = told.err.splitlines()
    assert line.startswith(f"surfuse: note: fusion method '{name}' of the package 'other' is left out: ")
    with pytest.raises(ConfigError, match=rf"^fusion method '{name}' of the package 'other' .*(?s:{why})") as caught:
        registry.load("fusion", name)
    assert "remove it" in str(caught.value)


def test_a_plug_in_that_blocks_is_left_out_of_the_list(site, monkeypatch):
    site.package("other", "[surfuse.sensors]\nbad = bad_module", bad_module="import time\nwhile True: time.sleep(1)")
    monkeypatch.setattr(listed, "LIMIT_S", 2.0)
    listing = registry.listing("sensors")
    assert listing.names == registry.found("sensors").built_in
    (line,) = listing.left_out
    assert "'bad' of the package 'other'" in line
    assert "not imported within 2 s" in line


def test_a_plug_in_that_crashes_is_left_out_of_the_list(site):
    site.package("other", "[surfuse.sensors]\nbad = bad_module", bad_module="import os; os._exit(3)")
    (line,) = registry.listing("sensors").left_out
    assert "ended the program that imported it (status 3)" in line


def test_nobody_replaces_a_built_in_one_or_takes_a_strange_name(site, command):
    site.package(
        "other",
        "[surfuse.fusion]\nbeam = their_mean\n../up = their_mean\ntheirs = their_mean\n"
        "[surfuse.exporters]\nnc = counted\n",
        their_mean=GOOD,
        counted=FORMAT,
    )
    site.package("second", "[surfuse.fusion]\ntheirs = their_mean\n")
    assert registry.load("fusion", "beam").__name__ == "surfuse.fusion.beam"
    assert registry.load("exporters", "nc").__name__ == "surfuse.exporters.nc"
    lines = "\n".join(registry.listing("fusion").left_out)
    assert "'beam' of the package 'other' is left out: that is the name of a built-in one" in lines
    assert "'../up' of the package 'other' is left out: a name has letters" in lines
    assert "'theirs' of the package 'second' is left out: the package 'other' has one of that name" in lines
    assert len(registry.listing("fusion").left_out) == 3
    assert len(command("methods").err.splitlines()) == 3


def test_a_method_of_another_package_that_fails_does_not_end_a_comparison(site, monkeypatch, flat_run):
    from surfuse.commands.judge import method_comparison
    from surfuse.commands.outcome import SilentWatcher

    code = GOOD.replace("mean.create(mean.Parameters())", "1 / 0")
    site.package("other", "[surfuse.fusion]\nfails = failing", failing=code)
    monkeypatch.setattr(method_comparison, "usable_methods", lambda warn: ("fails", "mean"))
    rows = dict(method_comparison.compare(flat_run, None, None, (), SilentWatcher()).table)
    assert "ZeroDivisionError" in rows["fails"]
    assert "ZeroDivisionError" not in rows["mean"]


def test_usable_methods_tells_of_those_that_are_not(site):
    from surfuse.commands.fuse.methods import usable_methods

    site.package("other", "[surfuse.fusion]\nbad = bad_module\nbeam = bad_module", bad_module="raise OSError")
    told: list[str] = []
    assert usable_methods(told.append) == registry.found("fusion").built_in
    assert len(told) == 2


def test_doctor_and_devices_name_what_is_left_out(site, command):
    site.package("other", "[surfuse.arms]\nbad = bad_module", bad_module="raise OSError('no driver')")
    said = command("devices", "--json").json
    assert said["left_out"] == [
        "arm driver 'bad' of the package 'other' is left out: it cannot be imported: OSError: no driver"
    ]
    told = command("doctor", "--set", "scan.step_m=-1").out
    assert "arm driver 'bad' of the package 'other' is left out" in told


def test_damaged_entry_points_of_one_package_do_not_hide_those_of_another(site):
    site.package("damaged", "[surfuse.fusion]\nno equals sign here\n")
    site.package("other", "[surfuse.fusion]\ntheirs = their_mean\n", their_mean=GOOD)
    assert "theirs" in registry.names("fusion")
    assert registry.load("fusion", "mean").SUMMARY


def test_a_package_without_metadata_is_unknown(site):
    site.package("nameless", "[surfuse.fusion]\nbeam = their_mean\n", their_mean=GOOD)
    (site.path / "nameless-1.0.dist-info" / "METADATA").unlink()
    forget()
    (line,) = registry.found("fusion").refused
    assert line.startswith("fusion method 'beam' of ")


def test_what_is_not_a_module_is_refused(site):
    site.package("other", "[surfuse.fusion]\nodd = odd_module:VALUE", odd_module="VALUE = 42")
    with pytest.raises(ConfigError, match=r"'odd'.*not a module"):
        registry.load("fusion", "odd")


def test_a_missing_package_breaks_only_its_own_plug_in(monkeypatch):
    monkeypatch.setitem(sys.modules, "surfuse.exporters.x3p", None)
    with pytest.raises(ConfigError, match=r"needs the package.*pip install"):
        registry.load("exporters", "x3p")
    assert registry.load("exporters", "nc").SUFFIXES


def test_a_driver_that_lacks_its_package_says_how_to_get_it(monkeypatch):
    forget()
    monkeypatch.setattr(listed, "installed", lambda package: package != "serial")
    needs = {one.name: one.needs for one in registry.listing("sensors").plug_ins}
    assert "pip install 'surfuse[serial]'" in needs["tfmini"]
    assert not needs["iio"]
    forget()


@pytest.mark.parametrize(
    ("kind", "name", "values", "words"),
    [
        ("sensors", "tfmini", {"port": "COM3", "modle": "x"}, r"unknown key 'sensor us0\.modle'; did you mean 'model'"),
        ("sensors", "tfmini", {"model": "tfmini-s"}, r"sensor us0: the sensor driver 'tfmini' lacks port; add port"),
        ("sensors", "tfmini", {"port": 3, "model": "tfmini"}, r"sensor us0\.port = 3; give a text"),
        ("sensors", "tfmini", {"port": "x", "model": "tfmimi"}, r"sensor us0: .*'tfmimi'.*did you mean 'tfmini'"),
        ("sensors", "tfmini", {"port": "x", "model": "tfmini", "timeout_s": True}, r"timeout_s = True; give a number"),
        ("sensors", "tfmini", {"port": "x", "model": "tfmini", "timeout_s": -1}, r"sensor us0: timeout_s = -1"),
        ("sensors", "tfmini", {"port": "x", "model": "tfmini", "surroundings": {}}, r"unknown key 'sensor us0\.surr"),
        ("sensors", "iio", {"folder": "", "model": "ping"}, r"folder = ''; give a path"),
        ("arms", "trident", {"settle_ticks": 1.5}, r"settle_ticks = 1\.5; give a whole number, for example 20"),
        ("arms", "trident", {"supervision": {"stuck_rat": 1}}, r"supervision\.stuck_rat'; did you mean 'stuck_rad'"),
        ("arms", "trident", {"supervision": {"stuck_nm": [1, "x"]}}, r"supervision\.stuck_nm = .*give a list"),
        ("arms", "trident", {"supervision": 3}, r"supervision = 3; give a table"),
        ("cameras", "uvc", {"index": -1}, r"sensor us0: index = -1"),
        ("control_laws", "gravity_pd", {"gains": {"damping": 0}}, r"sensor us0\.gains: damping = 0\.0"),
    ],
)
def test_wrong_values_name_key_value_limit_and_the_nearest_name(kind, name, values, words):
    with pytest.raises(ConfigError, match=words):
        registry.parameters(kind, name, values, "sensor us0")


def test_values_become_what_the_fields_are():
    found = registry.parameters("sensors", "iio", {"folder": "/sys/x", "model": "ping"}, "sensor", STANDING_ALONE)
    assert found.folder == Path("/sys/x")
    assert found.surroundings is STANDING_ALONE
    found = registry.parameters("arms", "trident", {"rest_s": 1, "supervision": {"stuck_nm": [1, 2.5]}}, "arm")
    assert (found.rest_s, found.supervision.stuck_nm, found.surroundings) == (1.0, (1.0, 2.5), None)


def test_a_driver_of_the_twin_says_what_a_real_rig_lacks():
    with pytest.raises(ConfigError, match=r"sensor driver 'simulated' needs what this rig does not have: pose, world"):
        registry.parameters("sensors", "simulated", {}, "sensor us0", STANDING_ALONE)
    plug_in = registry.load("sensors", "simulated")
    with pytest.raises(ConfigError, match="'simulated' stands in no rig"):
        plug_in.create(registry.parameters("sensors", "simulated", {}, "sensor us0"))


def test_the_usual_surroundings_of_a_kind_are_taken():
    from surfuse.cameras import REFERENCE_MODEL

    around = CameraSurroundings(REFERENCE_MODEL)
    assert registry.parameters("cameras", "uvc", {"index": 2}, "camera", around).surroundings is around
