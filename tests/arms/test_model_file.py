"""Arms from files: a six-axis and a seven-axis arm, URDF and MJCF, against MuJoCo itself; hostile files."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

mujoco = pytest.importorskip("mujoco")

from surfuse.arm_models import model_file  # noqa: E402
from surfuse.arm_models.model_file import ModelFileArm, Parameters  # noqa: E402
from surfuse.errors import ConfigError, DataError  # noqa: E402
from surfuse.geometry.poses import pose  # noqa: E402
from surfuse.motion.body import body_of  # noqa: E402
from surfuse.motion.clearance import ClearanceModel  # noqa: E402
from surfuse.motion.obstacles import Floor  # noqa: E402
from surfuse.plan.scan_plan import PlanParameters, scan_plan  # noqa: E402
from surfuse.records import Outline  # noqa: E402

# A six-axis arm of the common kind with an offset wrist (its last three axes do not meet), reach 1 m.
SIX = """<mujoco><compiler angle="degree"/><worldbody><body name="base"><geom type="cylinder" size=".09 .05"/>
<body pos="0 0 .16"><joint name="a1" axis="0 0 1" range="-180 180"/><geom type="sphere" size=".08"/>
<body pos="0 .13 0"><joint name="a2" axis="0 1 0" range="-190 10"/>
<geom type="capsule" fromto="0 0 0 .43 0 0" size=".06"/>
<body pos=".43 -.12 0"><joint name="a3" axis="0 1 0" range="-160 160"/>
<geom type="capsule" fromto="0 0 0 .39 0 0" size=".05"/>
<body pos=".39 0 0"><joint name="a4" axis="0 1 0" range="-180 180"/><geom type="sphere" size=".045"/>
<body pos="0 .1 0"><joint name="a5" axis="0 0 -1" range="-180 180"/><geom type="sphere" size=".045"/>
<body pos="0 0 -.1"><joint name="a6" axis="0 1 0" range="-180 180"/><geom type="box" size=".03 .03 .02"/>
<site name="flange" pos="0 .08 0" euler="-90 0 0"/>
</body></body></body></body></body></body></body></worldbody></mujoco>"""


def seven(
    tool: str = '<link name="tool"/>', limit: str = '<limit lower="-2.8" upper="2.8" effort="1" velocity="1"/>'
) -> str:
    """A seven-axis arm as URDF: shoulder, elbow and wrist of alternating roll and pitch axes."""
    text = '<robot name="seven"><link name="world_foot"/>'
    below = "world_foot"
    for j, (height, axis) in enumerate(
        [(0.16, "z"), (0.18, "y"), (0.2, "z"), (0.21, "y"), (0.2, "z"), (0.2, "y"), (0.08, "z")]
    ):
        xyz = {"z": "0 0 1", "y": "0 1 0"}[axis]
        text += (
            f'<link name="l{j}"><collision><geometry><sphere radius="0.06"/></geometry></collision></link>'
            f'<joint name="j{j}" type="revolute"><parent link="{below}"/><child link="l{j}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="{xyz}"/>{limit}</joint>'
        )
        below = f"l{j}"
    ends = '<parent link="l6"/><child link="tool"/><origin xyz="0 0 0.05" rpy="0 0 0.3"/>'
    fixed = f'<joint name="t" type="fixed">{ends}</joint>'
    return text + tool + (fixed if tool else "") + "</robot>"


@pytest.fixture
def arm_file(tmp_path: Path):  # type: ignore[no-untyped-def]
    def write(text: str, name: str = "arm.xml") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def six_axis(arm_file, **changes: object) -> ModelFileArm:  # type: ignore[no-untyped-def]
    return model_file.create(
        arm_file(SIX), "flange", pose(np.eye(3), [0.0, 0.0, 0.9]), np.eye(4), Parameters(**changes)
    )


def seven_axis(arm_file) -> ModelFileArm:  # type: ignore[no-untyped-def]
    return model_file.create(arm_file(seven(), "arm.urdf"), "tool", np.eye(4), np.eye(4))


def inside(arm: ModelFileArm, count: int, share: float = 0.8) -> np.ndarray:
    middle, half = 0.5 * (arm.lower_rad + arm.upper_rad), 0.5 * share * (arm.upper_rad - arm.lower_rad)
    return middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (count, len(middle)))


@pytest.mark.parametrize("build", [six_axis, seven_axis])
def test_forward_and_jacobian_are_mujocos(arm_file, build) -> None:  # type: ignore[no-untyped-def]
    arm = build(arm_file)
    path = next(iter(Path(arm_file("<x/>", "unused")).parent.glob("arm.*")))
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-3
    model = spec.compile()
    data = mujoco.MjData(model)
    base = arm.link_poses(arm.lower_rad)[0]
    for q in inside(arm, 5):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        if model.nsite:
            place, turn = data.site_xpos[0], data.site_xmat[0]
        else:
            place, turn = data.body("tool").xpos, data.body("tool").xmat
        assert_allclose(arm.forward(q), base @ pose(turn.reshape(3, 3), place), atol=1e-12)
        numeric = [(arm.forward(q + h) - arm.forward(q - h))[:3, 3] / 2e-6 for h in 1e-6 * np.eye(len(q))]
        assert_allclose(arm.jacobian(q)[:3], np.transpose(numeric), atol=1e-8)


@pytest.mark.parametrize("build", [six_axis, seven_axis])
def test_inverse_reaches_every_pose_that_forward_made(arm_file, build) -> None:  # type: ignore[no-untyped-def]
    arm = build(arm_file)
    for q in inside(arm, 12):
        target = arm.forward(q)[None]
        joints, valid = arm.inverse(target)
        assert valid.any()
        assert_allclose(arm.forward(joints[valid]), np.repeat(target, valid.sum(), axis=0), atol=1e-8)
        assert np.all(joints[valid] >= arm.lower_rad)
        assert np.all(joints[valid] <= arm.upper_rad)


def test_the_six_axis_arm_has_several_configurations_and_keeps_each_along_a_path(arm_file) -> None:  # type: ignore[no-untyped-def]
    arm = six_axis(arm_file)
    start = arm.forward(np.radians([20.0, -60.0, 90.0, -40.0, 70.0, 10.0]))
    path = np.repeat(start[None], 20, axis=0)
    path[:, 2, 3] += np.linspace(0.0, 0.1, 20)
    joints, valid = arm.inverse(path)
    whole = valid.all(axis=0)
    assert whole.sum() >= 4
    assert np.abs(np.diff(joints[:, whole], axis=0)).max() < 0.1
    first = joints[0, whole]
    apart = np.abs(np.angle(np.exp(1j * (first[:, None] - first[None])))).max(axis=-1)
    assert apart[~np.eye(len(first), dtype=bool)].min() > 0.05


def test_a_pose_out_of_reach_is_nan_and_the_next_one_is_found_again(arm_file) -> None:  # type: ignore[no-untyped-def]
    arm = six_axis(arm_file)
    near = arm.forward(np.radians([20.0, -60.0, 90.0, -40.0, 70.0, 10.0]))
    far = near.copy()
    far[0, 3] = 5.0
    joints, valid = arm.inverse(np.array([far, near, far, near]))
    assert not valid[[0, 2]].any()
    assert np.isnan(joints[[0, 2]]).all()
    assert valid[[1, 3]].any(axis=1).all()


@pytest.mark.parametrize("build", [six_axis, seven_axis])
def test_singularity_distance_is_zero_where_the_arm_is_stretched(arm_file, build) -> None:  # type: ignore[no-untyped-def]
    arm = build(arm_file)
    stretched = np.zeros(len(arm.lower_rad))
    values = arm.singularity_distance(np.vstack([stretched, inside(arm, 30)]))
    assert values.shape == (31, len(arm.singularities))
    assert values[0, 0] < 1e-9
    assert np.all((values >= 0.0) & (values <= 1.0))
    assert values[1:].max() > 0.02


@pytest.mark.parametrize("build", [six_axis, seven_axis])
def test_a_scan_is_planned_with_it_end_to_end(arm_file, build) -> None:  # type: ignore[no-untyped-def]
    arm = build(arm_file)
    height = float(arm.link_poses(arm.lower_rad)[0, 2, 3])
    # A plate in front of the arm, looking at it: u to the left of the arm, v up, w towards the arm.
    world_from_part = pose([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [0.95, 0.0, height + 0.3])
    plate = Outline(np.array([[-0.05, 0.0], [0.05, 0.0], [0.05, 0.1], [-0.05, 0.1]]), world_from_part)
    check = ClearanceModel(arm.link_poses, body_of(arm.capsules), (Floor(),))
    # The feet of both arms stand on the floor of the test.
    lifted = check if height > 0.0 else None
    start = 0.5 * (arm.lower_rad + arm.upper_rad)
    plan = scan_plan(plate, arm, start, lifted, PlanParameters(step_m=0.02, lowest_v_m=-np.inf))
    assert len(plan) >= 0.9 * (len(plan) + len(plan.skipped))
    assert_allclose(arm.forward(plan.joints_rad), plan.world_from_grip, atol=1e-8)
    assert np.abs(np.diff(plan.joints_rad, axis=0)).max() < 0.6


def test_the_outer_shape_covers_the_geometry(arm_file) -> None:  # type: ignore[no-untyped-def]
    arm = six_axis(arm_file)
    shape = {(capsule.link, round(capsule.radius_m, 3)) for capsule in arm.capsules}
    assert {(2, 0.06), (3, 0.05), (1, 0.08)} <= shape
    assert {capsule.link for capsule in arm.capsules} == set(range(7))
    box = next(capsule for capsule in arm.capsules if capsule.link == 6)
    assert box.radius_m >= 0.03


HOSTILE = {
    "missing tool frame": (SIX, "flang", "no tool frame 'flang'.*did you mean 'flange'"),
    "missing mesh": (
        SIX.replace("<worldbody>", '<asset><mesh name="m" file="gone.stl"/></asset><worldbody>'),
        "flange",
        "gone.stl",
    ),
    "mesh of a package": (
        seven().replace('<sphere radius="0.06"/>', '<mesh filename="package://arm/l.stl"/>', 1),
        "tool",
        "package://arm/l.stl.*relative",
    ),
    "closed chain": (
        SIX.replace(
            "</worldbody>", '</worldbody><equality><connect body1="base" site1="flange" site2="foot"/></equality>'
        )
        .replace('<body name="base">', '<body name="base"><site name="foot"/>')
        .replace('body1="base" ', ""),
        "flange",
        "close a chain",
    ),
    "no limits": (SIX.replace(' range="-160 160"', ""), "flange", "joint 'a3' has no limits"),
    "continuous joint": (
        seven().replace('type="revolute"', 'type="continuous"', 1),
        "tool",
        "joint 'j0' has no limits",
    ),
    "contradicting limits": (SIX.replace('range="-160 160"', 'range="160 -160"'), "flange", "range|limits"),
    "sliding joint": (SIX.replace('name="a2"', 'name="a2" type="slide"'), "flange", "joint 'a2' is not revolute"),
    "frame that nothing moves": (SIX, "base", "no joint moves the tool frame 'base'"),
    "not an arm": ("<html/>", "flange", "root element is <html>"),
    "not XML": ("<mujoco>", "flange", "not well-formed"),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "flange", "entities"),
    "too large": ("<mujoco>" + " " * 5_000_000 + "</mujoco>", "flange", "5000017 bytes"),
    "not a number": (SIX.replace('pos=".43 -.12 0"', 'pos="nan 0 0"'), "flange", "refuses|finite"),
}


@pytest.mark.parametrize("fault", HOSTILE)
def test_hostile_files_are_refused_with_a_cure(  # type: ignore[no-untyped-def]
    arm_file, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text, frame, words = HOSTILE[fault]
    path = arm_file(text, "arm.urdf" if text.startswith("<robot") else "arm.xml")
    with pytest.raises(DataError, match=words) as caught:
        model_file.create(path, frame, np.eye(4), np.eye(4))
    assert caught.value.cure
    assert caught.value.where == str(path)
    # MuJoCo likes to leave a log in the working folder.
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_more_than_twelve_joints_are_refused(arm_file) -> None:  # type: ignore[no-untyped-def]
    text = "".join(
        f'<body pos="0 0 .1"><joint axis="0 {j % 2} 1" range="-90 90"/><geom size=".01"/>' for j in range(13)
    )
    snake = f'<mujoco><worldbody>{text}<site name="tip"/>{"</body>" * 13}</worldbody></mujoco>'
    with pytest.raises(DataError, match="13 joints, at most 12"):
        model_file.create(arm_file(snake), "tip", np.eye(4), np.eye(4))


def test_a_missing_file_and_hostile_parameters_are_refused(tmp_path: Path, arm_file) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError, match="cannot read the arm file"):
        model_file.create(tmp_path / "gone.xml", "flange", np.eye(4), np.eye(4))
    with pytest.raises(DataError, match="not a right-handed rigid pose"):
        model_file.create(arm_file(SIX), "flange", 2.0 * np.eye(4), np.eye(4))
    with pytest.raises(ConfigError, match="starts"):
        Parameters(starts=0)
    with pytest.raises(DataError, match="wanted"):
        six_axis(arm_file).forward(np.zeros(5))
