"""A real arm of a file keeps clear of itself, its table and the part; or it is said why that is not checked."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surfuse.bridge.messages import Ability, ArmKind, ArmOfBridge, CameraOfBridge, Hello, State
from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.acquire.dry_run import dry_run
from surfuse.commands.acquire.planning import obstacles
from surfuse.commands.maps.report import content_of
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError, DataError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.rig.area import outline_of
from surfuse.rig.assembled import assembled
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_source import own_scan
from surfuse.settings import load

pytest.importorskip("mujoco")
from surfuse.arm_models import model_file

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


pretended = module_of(HERE / "pretended_rig.py")
joint_rig = module_of(HERE / "test_any_devices.py").JointRig
seven = module_of(HERE.parent / "arms" / "test_model_file.py").seven
table = module_of(HERE / "box_on_a_table.py")
LASER = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
DOWN = np.diag([1.0, -1.0, -1.0])


def arm_text(more: str = "") -> str:
    """The seven-axis arm; its base, a plate of 5 cm on the table, and what `more` hangs on the tool."""
    foot = '<link name="world_foot"><collision><geometry><cylinder radius="0.1" length="0.1"/></geometry></collision>'
    tool = f'<link name="tool">{more}</link>'
    return seven(tool).replace('<link name="world_foot"/>', f"{foot}</link>")


PROBE = '<collision><origin xyz="0 0 0.12"/><geometry><cylinder radius="0.01" length="0.2"/></geometry></collision>'


class Rig:
    """The arm behind a bridge, and the cell file that describes it."""

    def __init__(self, folder: Path, text: str, stands_at=(0.45, 0.0, 0.5)):
        self.file, self.folder = folder / "arm.urdf", folder
        self.file.write_text(text, "utf-8")
        kinematics = model_file.create(self.file, "tool", np.eye(4), np.eye(4))
        joints, _ = kinematics.inverse(pose(DOWN, stands_at)[None])
        self.rig = joint_rig(kinematics, joints[~np.isnan(joints).any(axis=-1)][0])
        self.served = pretended.Served(self.rig)

    def __enter__(self):
        self.served.__enter__()
        return self

    def __exit__(self, *ended):
        self.served.__exit__(*ended)

    def settings(self, origin="[0.40, -0.04, 0.0]", tallest="0.1", arm="", size=(0.12, 0.08), standoff=0.3, sensor=""):
        path = self.folder / "rig.toml"
        path.write_text(
            f'[arm]\ndriver = "bridge"\naddress = "{self.served.address}"\nfile = "{self.file}"\ntool = "tool"\n{arm}\n'
            f'[[sensor]]\nname = "us0"\n{LASER}{sensor}[area]\norigin_m = {origin}\n'
            f"width_m = {size[0]}\nheight_m = {size[1]}\n"
            f'tallest_m = {tallest}\n[scan]\nstep_m = 0.02\nstandoff_m = {standoff}\n[fusion]\nmethod = "median"\n',
            "utf-8",
        )
        return load(path)


def test_an_arm_that_stands_on_the_table_scans_all_of_it(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        found = dry_run(rig.settings(), tmp_path / "dry", SilentWatcher()).summary
        assert found["stops"] == 35
        assert found["skipped"] == []
        assert "part up to 100 mm" in found["collisions"]
        page = (tmp_path / "dry" / "plan.html").read_text("utf-8")
        assert page.count("<svg") == 3
        assert "at the first stop" in page
        assert rig.rig.moves == 0
        assert acquire(rig.settings(), tmp_path / "run", SilentWatcher(), yes=True).complete
    # The report draws it where it stands, with the tool where the sweeps were made.
    run = RunFolder.open(tmp_path / "run")
    scan = own_scan(run.path)
    drawn = content_of(run, scan).arm_m
    np.testing.assert_allclose(drawn[:, -1], scan.readings.world_from_grip[:, :3, 3], atol=1e-6)


def test_what_reaches_past_the_sensors_into_the_part_is_left_out_with_the_reason(tmp_path):
    with Rig(tmp_path, arm_text(PROBE)) as rig:
        with pytest.raises(DataError, match=r"35 clearance to the part"):
            dry_run(rig.settings(tallest="0.2"), None, SilentWatcher())
        with pytest.raises(DataError, match=r"35 clearance to the part"):
            acquire(rig.settings(tallest="0.2"), tmp_path / "run", SilentWatcher(), yes=True)
        assert rig.rig.moves == 0
        # Said to be no check, it is none; and a lower part is no hindrance.
        found = dry_run(rig.settings(tallest="0.2", arm="collision_check = false"), None, SilentWatcher()).summary
        assert found["stops"] == 35
        assert found["collisions"] == "not checked: arm.collision_check = false"
        assert dry_run(rig.settings(tallest="0.05"), None, SilentWatcher()).summary["stops"] == 35


def test_a_file_without_shapes_is_said_not_to_be_checked(tmp_path):
    bare = seven().replace('<collision><geometry><sphere radius="0.06"/></geometry></collision>', "")
    with Rig(tmp_path, bare) as rig:
        found = dry_run(rig.settings(), None, SilentWatcher()).summary
    assert found["collisions"] == "not checked: its file holds no shapes"
    assert found["stops"] == 35


def test_stops_at_which_the_arm_would_touch_itself_are_left_out_and_the_rest_is_scanned(tmp_path):
    near = {"origin": "[0.12, -0.02, 0.0]", "size": (0.24, 0.04), "standoff": 0.25}
    with Rig(tmp_path, arm_text()) as rig:
        found = dry_run(rig.settings(**near), tmp_path / "dry", SilentWatcher()).summary
        reasons = {stop["reason"].split(":")[0] for stop in found["skipped"]}
        assert any("the arm's own link" in reason for reason in reasons)
        assert found["stops"] > 10
        assert "orange: left out, clearance to the arm" in (tmp_path / "dry" / "plan.html").read_text("utf-8")
        outcome = acquire(rig.settings(**near), tmp_path / "run", SilentWatcher(), yes=True)
        assert outcome.complete
        assert outcome.summary["stops"] == found["stops"]


def test_a_move_through_the_table_is_refused_and_one_away_from_it_is_not(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        settings = rig.settings()
        built = assembled(settings)
        with built.opened():
            motion = built.motion
            here = motion.arm.joint_state().position_rad
            low = motion.arm.kinematics.inverse(pose(DOWN, [0.45, 0.0, 0.1])[None])[0][0]
            lowest = motion.arm.kinematics.inverse(pose(DOWN, [0.45, 0.0, 0.02])[None])[0][0]
            near = low[np.argmin(np.linalg.norm(low - here, axis=1))]
            inside = lowest[np.argmin(np.linalg.norm(lowest - here, axis=1))]
            motion.surround(obstacles(settings, outline_of(settings.area)))
            moves = rig.rig.moves
            with pytest.raises(SafetyStopError, match=r"mm (inside|from) the (table|part), .* percent into a move"):
                motion.arm.move_to(inside)
            assert rig.rig.moves == moves
            # Parked in what nobody may come to, it comes away, but goes no deeper.
            rig.rig.joints_rad = near
            rig.rig.pose = rig.rig.kinematics.forward(near)
        with built.opened():
            with pytest.raises(SafetyStopError):
                motion.arm.move_to(inside)
            motion.arm.move_to(here)


def test_a_scan_begins_from_a_posture_that_is_too_near(tmp_path):
    with Rig(tmp_path, arm_text(), stands_at=(0.45, 0.0, 0.08)) as rig:
        assert acquire(rig.settings(), tmp_path / "run", SilentWatcher(), yes=True).complete


@pytest.mark.parametrize(
    ("base", "height_m"), [(np.eye(4), 0.0), (pose(np.eye(3), [0.0, 0.0, -0.4]), -0.4), (pose(DOWN, [0, 0, 1.2]), 0.0)]
)
def test_the_table_is_under_the_part_or_under_the_base(tmp_path, base, height_m):
    where = f"world_from_base = {base.ravel().tolist()}"
    with Rig(tmp_path, arm_text()) as rig:
        settings = rig.settings(arm=where)
        box, table = obstacles(settings, outline_of(settings.area))
        assert table.distance(np.array([[9.0, 9.0, 0.3]]))[0] == pytest.approx(0.3 - height_m)
        assert box.distance(np.array([[0.46, 0.0, 0.15]]))[0] == pytest.approx(0.05)


def test_before_a_plate_that_stands_upright_there_is_no_table(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        settings = rig.settings()
        upright = replace(
            outline_of(settings.area), world_from_part=pose([[0, 0, -1], [1, 0, 0], [0, -1, 0]], [1, 0, 0.5])
        )
        assert [solid.name for solid in obstacles(settings, upright)] == ["the part"]


def test_a_part_as_tall_as_the_standoff_is_warned_of_and_not_walled_off(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        found = dry_run(
            rig.settings(tallest="0.3", sensor="position_m = [0, 0, 0.03]\n"), None, SilentWatcher()
        ).summary
    assert found["stops"] == 35
    assert any("area.tallest_m = 0.3 leaves 0 mm" in warning for warning in found["warnings"])


def test_a_part_that_is_taller_than_the_standoff_is_refused_before_anything_moves(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        settings = rig.settings(tallest="0.31", sensor="position_m = [0, 0, 0.03]\n")
        for command in (
            lambda: dry_run(settings, None, SilentWatcher()),
            lambda: acquire(settings, tmp_path / "run", SilentWatcher(), yes=True),
        ):
            with pytest.raises(ConfigError, match=r"area\.tallest_m = 0\.31 is above scan\.standoff_m = 0\.3") as told:
                command()
            assert "standoff above 0.34" in told.value.cure
        assert not rig.rig.moves
    assert not (tmp_path / "run").exists()


class SeenRig(table.BoxRig):
    """The arm beside a box that a camera over it sees; only its joints are known."""

    world_from_camera = table.above(0.45, 0.0, 0.75)

    def __init__(self, kinematics, joints_rad):
        super().__init__([table.Box(0.45, 0.0, degrees=0.0)])
        self.kinematics, self.joints_rad = kinematics, joints_rad
        self.pose = kinematics.forward(joints_rad)

    def hello(self):
        camera, can = CameraOfBridge(table.WIDTH, table.HEIGHT), frozenset({Ability.IMAGE})
        return Hello("seen", ArmOfBridge(ArmKind.JOINTS, len(self.joints_rad)), ("us0",), camera, can)

    def state(self):
        return State(self._now_s(), None, self.joints_rad)

    def move(self, to):
        self.joints_rad = np.array(to.joints_rad)
        self.pose = self.kinematics.forward(self.joints_rad)
        self.moves.append(self.pose)
        return self.state()


def seen(folder: Path, address: str, search: str):
    path = folder / "rig.toml"
    mounted = f"world_from_camera = {SeenRig.world_from_camera.ravel().tolist()}"
    path.write_text(
        f'[arm]\ndriver = "bridge"\naddress = "{address}"\nfile = "{folder / "arm.urdf"}"\ntool = "tool"\n'
        f'[[sensor]]\nname = "us0"\n{LASER}[camera]\ndriver = "bridge"\nmounted = "fixed"\n{mounted}\n'
        f"width_px = {table.WIDTH}\nheight_px = {table.HEIGHT}\nfx_px = {table.FX}\nfy_px = {table.FY}\n"
        f"cx_px = {table.CX}\ncy_px = {table.CY}\n[search]\n{search}\n"
        '[scan]\nstep_m = 0.02\nstandoff_m = 0.3\n[fusion]\nmethod = "median"\n',
        "utf-8",
    )
    return load(path)


def test_a_part_that_a_camera_found_is_kept_clear_of_too(tmp_path):
    plane = f"plane = {{ origin_m = [0.0, 0.0, {table.TABLE_M}] }}\n"
    with Rig(tmp_path, arm_text(PROBE)) as drawn:
        rig = SeenRig(drawn.rig.kinematics, drawn.rig.joints_rad)
    with pretended.Served(rig) as served:
        tall = seen(tmp_path, served.address, f"{plane}tallest_m = 0.2")
        with pytest.raises(DataError, match=r"\d+ clearance to the part"):
            acquire(tall, tmp_path / "run", SilentWatcher(), yes=True)
        assert not rig.moves
        low = seen(tmp_path, served.address, f"{plane}tallest_m = 0.05")
        found = dry_run(low, None, SilentWatcher()).summary
        assert not rig.moves
        assert found["skipped"] == []
        assert "part up to 50 mm" in found["collisions"]
        assert acquire(low, tmp_path / "scan", SilentWatcher(), yes=True).complete


def test_on_a_ring_table_a_real_arm_has_floor_table_and_the_part_below_its_sensors(tmp_path):
    with Rig(tmp_path, arm_text()) as rig:
        area = outline_of(rig.settings().area)
    settings = seen(tmp_path, "tcp://127.0.0.1:1", "tallest_m = 0.02")
    solids = obstacles(settings, area)
    assert [solid.name for solid in solids] == ["the floor", "the table", "the part"]
    assert solids[2].upper_m[2] == pytest.approx(0.02)
