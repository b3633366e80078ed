"""The configuration: defaults of the paper's cell, sources in order, and what is refused."""

from __future__ import annotations

import contextlib
import string
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from surfuse.errors import ConfigError
from surfuse.runs.configuration import write_configuration
from surfuse.settings import Section, Settings, from_tree, load


def sections(model: type[BaseModel] = Settings, path: tuple[str, ...] = ()):
    """Every field of the configuration with its path."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, Section):
            yield from sections(kind, (*path, name))
        else:
            yield (*path, name), field


def test_the_defaults_are_the_cell_of_the_paper():
    settings = load()
    table, kit, camera = settings.cell, settings.kit, settings.camera
    assert (table.table_height_m, table.table_inner_radius_m, table.table_outer_radius_m) == (1.00, 0.95, 1.25)
    assert (camera.width_px, camera.height_px) == (500, 582)
    assert camera.fx_px != camera.fy_px
    assert (kit.frequency_hz, kit.tube_length_m) == (63e3, 0.20)
    assert settings.scan.standoff_m == 0.43
    assert settings.arm.name == "puma560"
    assert settings.scene.name == "relief"


def test_the_step_is_a_fifth_of_the_sensor_spacing_unless_it_is_set():
    assert load().step_m == pytest.approx(0.01)
    assert load(None, ["array.side_m=0.08"]).step_m == pytest.approx(0.016)
    assert load(None, ["array.side_m=0.08", "scan.step_m=0.005"]).step_m == 0.005


def test_every_number_says_its_unit_or_is_a_count_or_a_share():
    units = ("_m", "_mm", "_kg", "_deg", "_deg_s", "_deg_s2", "_s", "_hz", "_px", "_c", "_bps", "_percent", "_share")
    units += ("_levels",)
    bare = {
        "seed",
        "part",
        "scale",
        "roughness",
        "pings",
        "cycles",
        "gain",
        "distortion",
        "port",
        "node",
        "tether_port",
    }
    for path, field in sections():
        if field.annotation in (float, int, float | None, int | None):
            assert path[-1].endswith(units) or path[-1] in bare, ".".join(path)


def test_a_file_gives_what_it_names_and_assignments_win(tmp_path: Path):
    file = tmp_path / "cell.toml"
    file.write_bytes(b"\xef\xbb\xbfseed = 4\n[scan]\nstep_m = 0.02\nmargin_m = 0.03\n[kit]\ncycles = 8\n")
    settings = load(file, ["scan.step_m=0.05", "seed=9"])
    assert (settings.scan.step_m, settings.scan.margin_m, settings.kit.cycles, settings.seed) == (0.05, 0.03, 8, 9)


def test_the_last_assignment_wins():
    assert load(None, ["seed=1", "seed=2"]).seed == 2


def test_text_needs_no_quotes():
    assert load(None, ["scene.name=my part.stl"]).scene.name == "my part.stl"
    assert load(None, ["scene.name='flat'", "fusion.method = mean"]).fusion.method == "mean"


def test_whole_numbers_may_stand_for_lengths_but_not_the_reverse():
    assert load(None, ["scan.standoff_m=1"]).scan.standoff_m == 1.0
    with pytest.raises(ConfigError, match=r"array\.pings = 5\.0.*integer"):
        load(None, ["array.pings=5.0"])


def test_parameters_of_methods_are_kept_by_name():
    settings = load(None, ["fusion.parameters.mean.a=1", "fusion.parameters.median.b='x'"])
    assert settings.fusion.parameters == {"mean": {"a": 1}, "median": {"b": "x"}}


@pytest.mark.parametrize("path", [".".join(path) for path, _ in sections()])
def test_a_misspelt_key_names_the_nearest_one(path):
    *section, name = path.split(".")
    wrong = ".".join([*section, name[:-1] + "q"])
    with pytest.raises(ConfigError, match=rf"unknown key '{wrong}'.*valid: .*{name}"):
        load(None, [f"{wrong}=1"])


@pytest.mark.parametrize("path", [".".join(path) for path, field in sections() if field.annotation is float])
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "true", "'1.0'", "[1.0]", "{a = 1}"])
def test_no_number_takes_anything_but_a_finite_number(path, value):
    with pytest.raises(ConfigError, match=path.replace(".", r"\.")):
        load(None, [f"{path}={value}"])


def test_several_problems_are_counted():
    with pytest.raises(ConfigError, match=r"and 1 more"):
        load(None, ["scan.step_m=-1", "scan.margin_m=-1"])


@pytest.mark.parametrize("text", ["", "=", "=1", "a", ".=1", "a..b=1", "scan.=1"])
def test_an_assignment_without_key_and_value_is_refused(text):
    with pytest.raises(ConfigError, match=r"key\.path=value"):
        load(None, [text])


def test_an_assignment_does_not_go_through_a_value():
    with pytest.raises(ConfigError, match="goes through 'seed'"):
        load(None, ["seed=1", "seed.x=2"])


@given(st.text(alphabet=string.printable, max_size=60))
def test_no_assignment_breaks_the_reader(text):
    with contextlib.suppress(ConfigError):
        assert isinstance(load(None, [text]), Settings)


@given(st.binary(max_size=200))
def test_no_file_breaks_the_reader(tmp_path_factory, content):
    file = tmp_path_factory.mktemp("cells") / "cell.toml"
    file.write_bytes(content)
    with contextlib.suppress(ConfigError):
        assert isinstance(load(file), Settings)


def test_what_a_run_wrote_is_read_back_equal(tmp_path: Path):
    settings = load(None, ["seed=77", "scan.step_m=0.03", "scene.name=tilted", "fusion.parameters.mean.a=0.5"])
    write_configuration(tmp_path / "run.toml", settings.model_dump(exclude={"seed"}), settings.seed)
    assert load(tmp_path / "run.toml") == settings
    assert load(tmp_path / "run.toml", ["seed=78"]).seed == 78


def test_the_tree_of_settings_builds_them_again():
    settings = load(None, ["seed=3", "kit.gain=2.5"])
    assert from_tree(settings.model_dump()) == settings


def test_settings_do_not_change():
    with pytest.raises(ValueError, match="frozen"):
        load().scan.step_m = 0.5


def test_the_limit_of_the_bus_is_on_what_the_bus_carries():
    assert load(None, ["array.pings=50", "scan.mode=smooth", "scan.pings=2"]).pings == 2
    assert load(None, ["array.pings=50", "bus.interface=none"]).pings == 50
    assert load(None, ["array.pings=31"]).pings == 31
    with pytest.raises(ConfigError, match=r"array\.pings = 50.*at most 31.*fewer"):
        load(None, ["array.pings=50"])
    with pytest.raises(ConfigError, match=r"scan\.pings = 32"):
        load(None, ["scan.mode=smooth", "scan.pings=32"])


def test_the_control_law_is_one_of_the_plug_ins():
    assert load(None, ["arm.law=gravity_pd"]).arm.law == "gravity_pd"
    with pytest.raises(ConfigError, match=r"arm\.law = 'gravity_dp'; did you mean 'gravity_pd'"):
        load(None, ["arm.law=gravity_dp"])


RIG = '[arm]\ndriver = "bridge"\naddress = "tcp://127.0.0.1:5005"\n'
ONE = '[[sensor]]\nname = "us0"\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[sensor]\nname = "us0"\n', r"\[sensor\] is one table, .*; write \[\[sensor\]\], with two brackets"),
        ("sensor = 3\n", r"sensor = 3: .* write a table \[\[sensor\]\] for each"),
        ('[[arm]]\ndriver = "bridge"\n', r"\[\[arm\]\] makes a list of tables, .*; write \[arm\], with one bracket"),
        ("[[area]]\nwidth_m = 1.0\n", r"write \[area\], with one bracket"),
        (f"{ONE}position_m = [0.1, 0.2]\n", r"sensor 'us0': position_m = .*number of values is 2, and 3 are needed"),
        (f"{ONE}axis = [0, 0, 1, 0]\n", r"sensor 'us0': axis = .*number of values is 4, and 3 are needed"),
        (f"{ONE}position_m = 0.1\n", r"sensor 'us0': position_m = 0.1: .* in square brackets"),
        (f'{ONE}position_m = ["0.1", 0, 0]\n', r"position_m\[0\] = '0.1': .* write it without quotes: 0.1"),
        (f'{ONE}range_max_m = "1.2"\n', r"sensor 'us0': range_max_m = '1.2': .* write it without quotes: 1.2"),
        (f'{ONE}kind = "ultrasonc"\n', r"sensor 'us0': kind = .*did you mean 'ultrasonic'\?"),
        ('[[sensor]]\nkind = "laser"\n', r"sensor number 1 has no name; add the key 'name'"),
        (f'{RIG}collision_check = "true"\n', r"arm.collision_check = 'true': .* write true without quotes"),
        ("[arm]\ndriver = true\n", r'arm.driver = True: .* write it in quotes: "true"'),
        ('[arm]\ndriver = "bridge"\ncommand = ["python3", 1]\n', r"arm.command = .* a list of texts or of numbers"),
        ("[scan]\nstandoff_m = 430\n", r"scan.standoff_m = 430: .*10; give metres \(430 mm are 0.43\)"),
        ("[scan]\nstep_m = 0,01   # one\n", r"not valid TOML: .*line 2.*; write numbers with a point: 0.01"),
        ("[sensor]\na = 1\n[sensor]\na = 1\n", r"not valid TOML: .*; write \[\[sensor\]\] for each"),
        ("[sensor]\na = 1\n[[sensor]]\na = 1\n", r"not valid TOML: .*; write \[\[sensor\]\] for each"),
        ("[[sensor]]\na = 1\n[sensor]", r"not valid TOML: .*; write \[\[sensor\]\] for each"),
        ("[arm]\na = 1\n[arm]\na = 1\n", r"not valid TOML: .*; write one \[arm\] table"),
        ("a = 1\na = 1\n", r"not valid TOML: .*; correct that line"),
        ("standoff_m = 0.3\n", r"unknown key 'standoff_m'; it is a key of \[scan\]"),
        (f"{ONE}axis = [0.0, 0.0, 90.0]\n", r"cell.toml: sensor 'us0': axis = .*wanted 1"),
    ],
)
def test_a_slip_in_a_table_of_a_rig_says_what_to_write(tmp_path: Path, text: str, told: str):
    (tmp_path / "cell.toml").write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=told):
        load(tmp_path / "cell.toml")


def test_files_that_a_cell_file_names_are_found_beside_it_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    rig, here = tmp_path / "rig", tmp_path / "here"
    rig.mkdir()
    here.mkdir()
    for name in ("bridge.py", "arm.urdf", "part.stl", "both.csv"):
        (rig / name).write_text("")
    (here / "both.csv").write_text("")
    words = '["python3", "bridge.py", "--port", "5", "nowhere.py"]'
    (rig / "cell.toml").write_text(
        f'[arm]\ndriver = "bridge"\ncommand = {words}\nfile = "arm.urdf"\ntool = "t"\n[area]\nmesh = "part.stl"\n',
        "utf-8",
    )
    monkeypatch.chdir(here)
    found = load(rig / "cell.toml")
    assert found.arm.parameters["command"] == ["python3", str(rig / "bridge.py"), "--port", "5", "nowhere.py"]
    assert found.arm.file == str(rig / "arm.urdf")
    assert found.area is not None
    assert found.area.mesh == str(rig / "part.stl")
    # What is there where we are comes first, as it is written.
    (rig / "cell.toml").write_text('[area]\noutline = "both.csv"\n', "utf-8")
    area = load(rig / "cell.toml").area
    assert area is not None
    assert area.outline == "both.csv"


def test_a_cell_file_that_is_not_there_names_those_that_are(tmp_path: Path):
    for name in ("rig.toml", "sensors.toml"):
        (tmp_path / name).write_text("")
    for wrong in (tmp_path, tmp_path / "rig.tml"):
        with pytest.raises(ConfigError, match=r"cannot read it .*there is rig.toml$"):
            load(wrong)
    with pytest.raises(ConfigError, match=r"surfuse init FOLDER"):
        load(tmp_path / "nowhere" / "rig.toml")
