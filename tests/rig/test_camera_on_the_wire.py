"""The twin behind the bridge, with the camera and the ranger on its shoulder: the paper's search in a real rig."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.acquire.dry_run import dry_run
from surfuse.commands.acquire.locating import locate
from surfuse.commands.acquire.looking import look_for_part
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError, DataError
from surfuse.exporters import nc
from surfuse.rig.assembled import assembled
from surfuse.rig.description import shoulder_spec
from surfuse.rig.simulated.on_the_wire import TwinOnTheWire
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HERE = Path(__file__).parent
spec = importlib.util.spec_from_file_location("pretended_rig", HERE / "pretended_rig.py")
pretended = importlib.util.module_from_spec(spec)
spec.loader.exec_module(pretended)

COMMON = '[scan]\nstep_m = 0.04\n[fusion]\nmethod = "weighted_average"\n[search]\nfrom_deg = 0.0\nto_deg = 160.0\n'
TWIN = f'[arm]\ndriver = "kinematic"\n{COMMON}'
CAMERA = (
    '[camera]\ndriver = "bridge"\nmounted = "shoulder"\nwidth_px = 500\nheight_px = 582\nfx_px = 520.0\nfy_px = 760.0\n'
    "height_m = 1.3\nforward_m = 0.1\n"
)


@pytest.fixture(scope="module")
def twin_settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("twin") / "twin.toml"
    path.write_text(TWIN, "utf-8")
    return load(path)


@pytest.fixture
def served(twin_settings):
    with TwinOnTheWire(twin_settings) as twin, pretended.Served(twin) as found:
        found.twin = twin
        yield found


def cell(folder: Path, address: str, twin_settings, ranger: bool = True, camera: str = CAMERA, more: str = "") -> Path:
    sensors = "".join(
        f'[[sensor]]\nname = "us{k}"\nkind = "ultrasonic"\nposition_m = [{x}, {y}, 0.0]\nbeam_full_angle_deg = 13.0\n'
        "range_min_m = 0.33\nrange_max_m = 4.0\nsigma_m = 0.0003\nfrequency_hz = 63000.0\naperture_m = 0.04\n"
        "dead_length_m = 0.2\nfiring_time_s = 0.125\n"
        for k, (x, y) in enumerate([(0.025, -0.025), (-0.025, -0.025), (0.025, 0.025), (-0.025, 0.025)])
    )
    known = shoulder_spec(twin_settings)
    shoulder = (
        f'[ranger]\ndriver = "bridge"\nrange_min_m = {known.range_min_m}\nrange_max_m = {known.range_max_m}\n'
        f"sigma_m = {known.sigma_m}\n"
    )
    path = folder / "rig.toml"
    arm = f'[arm]\ndriver = "bridge"\naddress = "{address}"\n'
    path.write_text(f"{arm}{sensors}{camera}{shoulder if ranger else ''}{COMMON}{more}", "utf-8")
    return path


@pytest.fixture(scope="module")
def in_process(twin_settings):
    rig = assembled(twin_settings)
    with rig.opened():
        return locate(rig, twin_settings, SilentWatcher())


def test_the_outline_over_the_wire_is_that_of_this_process_to_the_last_bit(served, in_process, twin_settings, tmp_path):
    settings = load(cell(tmp_path, served.address, twin_settings))
    rig = assembled(settings)
    with rig.opened():
        found = look_for_part(rig, settings, SilentWatcher())
    assert found.pictures == in_process.pictures
    np.testing.assert_array_equal(found.frames[0].image, in_process.frame.image)
    for name in ("vertices_m", "world_from_part", "sigma_m", "viewpoint_m"):
        np.testing.assert_array_equal(getattr(found.outline, name), getattr(in_process.outline, name), err_msg=name)
    assert found.outlined.distance == in_process.outlined.distance


def test_without_a_ranger_the_foot_alone_says_how_far_it_is(served, in_process, twin_settings, tmp_path):
    settings = load(cell(tmp_path, served.address, twin_settings, ranger=False))
    rig = assembled(settings)
    with rig.opened():
        found = look_for_part(rig, settings, SilentWatcher())
    assert np.isnan(found.outlined.distance.range_m)
    assert found.outlined.distance.foot_m == in_process.outlined.distance.foot_m
    size, wanted = (np.ptp(one.outline.vertices_m, axis=0) for one in (found, in_process))
    np.testing.assert_allclose(size, wanted, rtol=0.03)


def test_the_part_is_scanned_and_the_report_shows_the_search(served, twin_settings, tmp_path):
    acquire(twin_settings, tmp_path / "twin", SilentWatcher())
    path = cell(tmp_path, served.address, twin_settings)
    assert acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True).complete
    ours, twins = read_log(tmp_path / "run"), read_log(tmp_path / "twin")
    np.testing.assert_array_equal(ours.scene.outline.vertices_m, twins.scene.outline.vertices_m)
    # The same stops, to which the controller goes by poses.
    np.testing.assert_array_equal(ours.plan.uv_m, twins.plan.uv_m)
    one, other = nc.read(tmp_path / "run" / "surface.nc"), nc.read(tmp_path / "twin" / "surface.nc")
    both = one.mask & other.mask
    assert both.sum() > 0.8 * other.mask.sum()
    np.testing.assert_allclose(one.height_m[both], other.height_m[both], atol=0.003)
    assert 'id="search"' in (tmp_path / "run" / "report.html").read_text("utf-8")


def test_a_dry_run_looks_from_where_the_arm_stands(served, in_process, twin_settings, tmp_path):
    path = cell(tmp_path, served.address, twin_settings)
    away = served.twin._motion.arm.joint_state().position_rad
    with pytest.raises(DataError, match=r"no part seen in 1 picture.*--dry-run moves nothing"):
        dry_run(load(path), None, SilentWatcher())
    np.testing.assert_array_equal(served.twin._motion.arm.joint_state().position_rad, away)
    there = away.copy()
    there[0] = in_process.parts[0].angle_rad
    served.twin._motion.arm.move_to(there)
    outcome = dry_run(load(path), tmp_path / "dry", SilentWatcher())
    assert outcome.summary["stops"] > 10
    found = doctor(path, []).summary
    assert found["problems"] == []
    assert "500 x 582 pixels" in found["checks"]["camera"]["text"]
    assert "on the shoulder" in found["checks"]["us_shoulder"]["text"]
    assert "parts in this picture: 1, the largest" in found["checks"]["search"]["text"]


def test_a_place_on_the_shoulder_must_be_given_and_the_simulated_cell_has_its_own(twin_settings, tmp_path):
    for lost in ("height_m = 1.3\n", "forward_m = 0.1\n"):
        with pytest.raises(ConfigError, match=rf"but {lost.split()[0]} of it are not given"):
            load(cell(tmp_path, "tcp://127.0.0.1:1", twin_settings, camera=CAMERA.replace(lost, "")))
    with pytest.raises(ConfigError, match=r"camera.driver = 'uvc' in the simulated cell"):
        assembled(
            load(
                None,
                [
                    "camera.driver=uvc",
                    "camera.mounted=shoulder",
                    *(f"camera.{key}" for key in ("width_px=500", "height_px=582", "fx_px=520.0", "fy_px=760.0")),
                    "camera.height_m=1.3",
                    "camera.forward_m=0.1",
                ],
            )
        )
    with pytest.raises(ConfigError, match=r"turns joint 1 from -170 to 160 degrees, its limits are -160 and 160"):
        assembled(load(None, ["arm.driver=kinematic", "search.from_deg=-170.0"]))


def test_with_an_area_the_twin_serves_its_array_alone(twin_settings):
    area = {"origin_m": (0.0, 0.0, 0.0), "width_m": 0.1, "height_m": 0.1}
    plain = TwinOnTheWire(load(None, ["arm.driver=kinematic"], area=area)).hello().sensors
    assert plain == ("us0", "us1", "us2", "us3")
    assert TwinOnTheWire(twin_settings).hello().sensors == (*plain, "us_shoulder")
