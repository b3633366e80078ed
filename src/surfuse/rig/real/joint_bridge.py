"""An arm behind a bridge whose joints are commanded, because its file says what they do."""

from __future__ import annotations

import numpy as np

from surfuse.bridge.messages import MoveTo, State
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import DeviceError, SafetyStopError
from surfuse.interfaces import Kinematics, OpenedTogether
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.limits import check_position
from surfuse.records import FloatArray, JointState

_POSE_TOLERANCE_M = 0.01


class JointBridgeArm(OpenedTogether):
    """An `Arm`; where the bridge also says a pose, it must be the one that the arm's file gives for its joints."""

    def __init__(self, bridge: SharedBridge, surroundings: ArmSurroundings, speed_share: float | None) -> None:
        super().__init__(bridge)
        self._bridge, self._around, self._speed = bridge, surroundings, speed_share

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._around.kinematics

    def joint_state(self) -> JointState:
        """What the bridge says of the joints."""
        return self._joints(self._bridge.client.state())

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there, settle, and return the state as reached; `speed_share` as in `Arm`."""
        check_position(joints_rad, self._around.limits)
        if self._around.guard is not None:
            self._around.guard(self.joint_state().position_rad, joints_rad)
        share = self._speed if speed_share is None else min(speed_share, self._speed or 1.0)
        return self._joints(self._bridge.client.move(MoveTo(joints_rad=joints_rad, speed_share=share)))

    def _joints(self, state: State) -> JointState:
        if state.joints_rad is None:
            raise DeviceError(
                "the bridge does not say the joints of the arm",
                cure="let it answer 'joints_rad', or leave out arm.file: then the arm is sent to poses",
            )
        count = len(self._around.kinematics.lower_rad)
        if len(state.joints_rad) != count:
            raise DeviceError(
                f"the bridge says {len(state.joints_rad)} joints, the arm's file has {count}",
                cure="give the file of this arm",
            )
        return JointState(state.joints_rad, state.t_s)

    def check_model(self, tool_from_grip: FloatArray) -> None:
        """Compare the pose that the bridge says with that of the file.

        Raises
        ------
        SafetyStopError : they are more than 10 mm apart: base, tool or file are not those of this arm.
        """
        state = self._bridge.client.state()
        if state.world_from_tool is None or state.joints_rad is None:
            return
        said = state.world_from_tool @ tool_from_grip
        expected = self._around.kinematics.forward(state.joints_rad)
        off_m = float(np.linalg.norm(said[:3, 3] - expected[:3, 3]))
        if off_m > _POSE_TOLERANCE_M:
            raise SafetyStopError(
                f"the bridge says that the tool is {1e3 * off_m:.0f} mm from where the arm's file puts it, at most "
                f"{1e3 * _POSE_TOLERANCE_M:.0f} mm",
                cure="correct arm.world_from_base, arm.tool or arm.file",
            )
