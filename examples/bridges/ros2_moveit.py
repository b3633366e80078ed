"""Bridge to any robot with ROS 2 and MoveIt 2, by its Python interface moveit_py.

Run inside a launch file that gives the node `surfuse_bridge` the robot's MoveIt parameters; surfuse connects to
`address = "tcp://127.0.0.1:5005"`. GROUP, TIP and WORLD are names of your robot: TIP is a link whose z lies along the
beams. The planner goes round what MoveIt knows of the cell. The sensors have drivers of their own in the cell file.
Checked against a stand-in with the methods of moveit_py (Jazzy). Not checked: a real ROS 2, a robot, a planner.
"""

import sys
import time

import rclpy
from bridge_lines import RefusedError, serve
from geometry_msgs.msg import PoseStamped
from moveit.core.robot_state import RobotState
from moveit.planning import MoveItPy, PlanRequestParameters
from rotations import quaternion

GROUP, TIP, WORLD, IK_TIMEOUT_S = "manipulator", "tool0", "base_link", 0.05


def message(m):
    """A pose (16 numbers, row by row) as a ROS message."""
    goal = PoseStamped()
    goal.header.frame_id = WORLD
    goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = m[3], m[7], m[11]
    turn = goal.pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion(m)
    return goal


def reachable(m):
    """Whether the robot's inverse kinematics finds joints."""
    return bool(RobotState(robot.get_robot_model()).set_from_ik(GROUP, message(m).pose, TIP, IK_TIMEOUT_S))


def state(ask):
    """Where the tip is, by the joints that MoveIt hears of."""
    with robot.get_planning_scene_monitor().read_only() as scene:
        now = scene.current_state
        now.update()
        pose = now.get_global_link_transform(TIP)
    return {"t_s": time.monotonic(), "world_from_tool": [float(item) for row in pose for item in row]}


def move(ask):
    """Plan, and do it."""
    if not reachable(ask["world_from_tool"]):
        raise RefusedError("unreachable", "inverse kinematics finds no joints")
    group.set_start_state_to_current_state()
    group.set_goal_state(pose_stamped_msg=message(ask["world_from_tool"]), pose_link=TIP)
    how = PlanRequestParameters(robot, "plan_request_params")
    how.max_velocity_scaling_factor = how.max_acceleration_scaling_factor = ask.get("speed_share", 0.3)
    plan = group.plan(single_plan_parameters=how)
    if not plan:
        raise RefusedError("unreachable", "the planner finds no way")
    status = robot.execute(plan.trajectory, controllers=[]).status
    if status != "SUCCEEDED":
        raise RefusedError("safety" if status in ("PREEMPTED", "ABORTED") else "device", f"the motion ended: {status}")
    return state(ask)


def stop(ask):
    """Cancel the motion that is under way."""
    robot.get_trajectory_execution_manager().stop_execution()
    return state(ask)


DO = {
    "hello": lambda ask: {"protocol": 1, "name": "MoveIt", **WHAT},
    "state": state,
    "reach": lambda ask: {"reachable": [reachable(pose) for pose in ask["world_from_tool"]]},
    "move": move,
    "stop": stop,
    "bye": lambda ask: {},
}
WHAT = {"arm": {"kind": "cartesian"}, "sensors": [], "camera": None, "can": ["reach", "stop"]}

rclpy.init()
robot = MoveItPy(node_name="surfuse_bridge")
group = robot.get_planning_component(GROUP)
serve(DO, int(sys.argv[1]) if sys.argv[1:] and sys.argv[1].isdigit() else 5005)
rclpy.shutdown()
