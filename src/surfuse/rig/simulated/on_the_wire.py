"""The simulated rig behind the bridge: what `surfuse bridge` serves."""

from __future__ import annotations

import threading

import numpy as np

from surfuse.bridge.messages import (
    Ability,
    ArmKind,
    ArmOfBridge,
    BridgeReading,
    CameraOfBridge,
    Hello,
    Image,
    MoveTo,
    State,
    SweepAnswer,
)
from surfuse.errors import UnreachableError
from surfuse.geometry.poses import inverse
from surfuse.motion.choice import nearest_configuration
from surfuse.records import BoolArray, Echo, FloatArray, JointState
from surfuse.rig.description import camera_model, tool_from_array
from surfuse.rig.devices import JointMotion, Lookout, Rig
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.rig.simulated.hidden_errors import true_place
from surfuse.rig.simulated.twin_arm import TwinArm
from surfuse.settings import Settings


class TwinOnTheWire:
    """A `Bridgeable` twin: its arm takes joints or poses, its sensors are those of the configuration.

    Its random numbers depend on the stop that `begin` names, or, for clients that do not, on the number of the sweep.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._rig: Rig = simulated_rig(settings)
        self._motion: JointMotion = self._rig.joint_motion("the twin")
        self._grip_from_tool = inverse(tool_from_array(settings))
        # Where an area is given nobody looks for the part, and all sensors are those of the array.
        lookout = self._rig.lookout if settings.area is None else None
        self._ranger = lookout.ranger if isinstance(lookout, Lookout) else None
        self._shoulder: tuple[str, ...] = () if self._ranger is None else (self._ranger.spec.name,)
        self._begun = False
        self._sweeps = 0
        self._using = threading.Lock()

    def __enter__(self) -> TwinOnTheWire:
        self._opened = self._rig.opened()
        self._opened.__enter__()
        return self

    def __exit__(self, *ended: object) -> None:
        self._opened.__exit__(None, None, None)

    def hello(self) -> Hello:
        """A joint arm, the array, the camera."""
        camera = camera_model(self._settings)
        return Hello(
            name="the twin of surfuse",
            arm=ArmOfBridge(ArmKind.JOINTS, len(self._motion.arm.kinematics.lower_rad)),
            sensors=(*(spec.name for spec in self._rig.specs), *self._shoulder),
            camera=CameraOfBridge(camera.width_px, camera.height_px),
            can=frozenset({Ability.REACH, Ability.STOP, Ability.IMAGE, Ability.STREAMS}),
        )

    def begin(self, stage: str, index: int) -> None:
        """The stop that comes next."""
        self._begun = True
        self._rig.begin(stage, index)

    def state(self) -> State:
        """Where the encoders say that the arm stands."""
        return self._state(self._motion.arm.joint_state())

    def reach(self, world_from_tool: FloatArray) -> BoolArray:
        """Which poses (N, 4, 4) have a solution within the joint limits."""
        _, valid = self._motion.arm.kinematics.inverse(world_from_tool @ inverse(self._grip_from_tool))
        return np.asarray(valid.any(axis=1), dtype=np.bool_)

    def move(self, to: MoveTo) -> State:
        """Go there: to joints, or to the solution that is nearest to where the arm stands."""
        with self._using:
            joints = to.joints_rad if to.joints_rad is not None else self._solution(to)
            return self._state(self._motion.arm.move_to(joints))

    def _solution(self, to: MoveTo) -> FloatArray:
        assert to.world_from_tool is not None
        grip = (to.world_from_tool @ inverse(self._grip_from_tool))[None]
        kinematics = self._motion.arm.kinematics
        solutions, valid = kinematics.inverse(grip)
        if not valid.any():
            place = np.round(to.world_from_tool[:3, 3], 4).tolist()
            raise UnreachableError(f"the arm cannot take the pose at {place} m", cure="keep within its reach")
        here = self._motion.arm.joint_state().position_rad
        joints, _ = nearest_configuration(solutions, valid, here, kinematics.lower_rad, kinematics.upper_rad)
        return np.asarray(joints[0], dtype=np.float64)

    def world_from_grip(self) -> FloatArray:
        """Where the grip (4, 4) truly is."""
        arm = self._motion.arm
        assert isinstance(arm, TwinArm)
        with self._using:
            return true_place(self._settings, arm.true_tool_pose())

    def sweep(self, sensors: tuple[str, ...]) -> SweepAnswer:
        """All sensors of the array fire, as in a scan, and that of the shoulder; those that were asked are answered."""
        names = [spec.name for spec in self._rig.specs]
        found: dict[str, Echo] = {}
        with self._using:
            if not self._begun:
                self._rig.begin("sweep", self._sweeps)
            self._sweeps += 1
            if any(name in names for name in sensors):
                found.update(zip(names, self._rig.array.sweep(), strict=True))
            if self._ranger is not None and self._shoulder[0] in sensors:
                found[self._shoulder[0]] = self._ranger.fire()
        return SweepAnswer(tuple(_reading(name, echo) for name, echo in found.items() if name in sensors))

    def image(self) -> Image:
        """A picture of the camera on the shoulder."""
        assert self._rig.lookout is not None
        with self._using:
            grey, t_s = self._rig.lookout.camera.capture()
        return Image(t_s, grey)

    def stop(self) -> State:
        """A simulated move is over before anybody can ask."""
        return self.state()

    def _state(self, state: JointState) -> State:
        grip = self._motion.arm.kinematics.forward(state.position_rad)
        pose = np.asarray(grip @ self._grip_from_tool, dtype=np.float64)
        return State(state.t_s, pose, state.position_rad)


def _reading(name: str, echo: Echo) -> BridgeReading:
    return BridgeReading(
        name,
        echo.t_s,
        echo.range_m,
        echo.status,
        echo.amplitude,
        echo.sigma_m,
        spread_m=echo.spread_m,
        count=echo.count,
    )
