"""What moveit_py offers in MoveItPy and around it, as far as the example uses it."""

import contextlib
import threading

import numpy as np
from journal import fault, note

from moveit.core.robot_state import RobotState, matrix_of


class PlanRequestParameters:
    def __init__(self, moveit_cpp, ns):
        assert isinstance(moveit_cpp, MoveItPy)
        self.max_velocity_scaling_factor = self.max_acceleration_scaling_factor = 1.0


class _Status:
    def __init__(self, status):
        self.status = status


class _Solution:
    def __init__(self, trajectory):
        self.trajectory = trajectory

    def __bool__(self):
        return self.trajectory is not None


class _Scene:
    def __init__(self, pose):
        self.current_state = RobotState("model")
        self.current_state._tip = pose


class _Monitor:
    def __init__(self, robot):
        self._robot = robot

    @contextlib.contextmanager
    def read_only(self):
        yield _Scene(self._robot.tip.copy())


class _Component:
    def __init__(self):
        self._started, self._goal = False, None

    def set_start_state_to_current_state(self):
        self._started = True

    def set_goal_state(self, *, pose_stamped_msg, pose_link):
        assert pose_link == "tool0"
        assert pose_stamped_msg.header.frame_id == "base_link"
        self._goal = matrix_of(pose_stamped_msg.pose)

    def plan(self, single_plan_parameters=None):
        assert self._started
        assert 0.0 < single_plan_parameters.max_velocity_scaling_factor <= 1.0
        note("plan", self._goal.ravel().tolist(), single_plan_parameters.max_velocity_scaling_factor)
        blocked = self._goal[1, 3] > 0.5  # something stands there
        return _Solution(None if blocked else self._goal)


class _Execution:
    def __init__(self):
        self.stopped = threading.Event()

    def stop_execution(self, auto_clear=True):
        note("stop_execution")
        self.stopped.set()


class MoveItPy:
    def __init__(self, node_name="moveit_py"):
        self.tip, self._execution = np.diag([1.0, -1.0, -1.0, 1.0]), _Execution()
        self.tip[:3, 3] = 0.4, 0.0, 0.4

    def get_planning_component(self, name):
        assert name == "manipulator"
        return _Component()

    def get_robot_model(self):
        return "model"

    def get_planning_scene_monitor(self):
        return _Monitor(self)

    def get_trajectory_execution_manager(self):
        return self._execution

    def execute(self, trajectory, controllers):
        assert controllers == []
        self._execution.stopped.clear()
        if self._execution.stopped.wait(10.0 if fault("slow") else 0.02):
            return _Status("PREEMPTED")
        if fault("controller"):
            return _Status("TIMED_OUT")
        self.tip = trajectory
        return _Status("SUCCEEDED")
