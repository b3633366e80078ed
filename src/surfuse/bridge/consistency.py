"""Whether a bridge contradicts itself over time: its clock, and the pose of an arm that nobody has sent anywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.bridge.messages import MoveTo, State
from surfuse.errors import ConfigError, SafetyStopError
from surfuse.records import FloatArray

_CURE = "find out what moved the arm or what the bridge reports wrongly"

WAY_SHARE, WAY_SLACK_M, WAY_SLACK_RAD = 0.5, 0.05, 0.1
"""How far an arm may leave the straight way to its target: a share of the way, and what any move may take."""


@dataclass(frozen=True)
class Tolerances:
    """How far a bridge may be from what it was told, and from what it said before.

    `position_tolerance_m` and `angle_tolerance_rad` hold between the pose sent and the pose reached, and between the
    poses of an arm that was not moved; the angle also for each joint. `time_tolerance_s` is for stamps that were
    rounded.
    """

    position_tolerance_m: float = 0.005
    angle_tolerance_rad: float = 0.03
    time_tolerance_s: float = 0.001

    def __post_init__(self) -> None:
        for name in ("position_tolerance_m", "angle_tolerance_rad", "time_tolerance_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"{name} = {value}", cure="give a positive number")


class Consistency:
    """What the bridge has said so far, and what that allows it to say next."""

    def __init__(self, tolerances: Tolerances, where: str) -> None:
        self._tolerances, self._where = tolerances, where
        self._latest_s = -math.inf
        self._rest: State | None = None

    @property
    def rest(self) -> State | None:
        """Where the arm stands, None while nobody knows."""
        return self._rest

    def new_connection(self) -> None:
        """A bridge that was started again may count its time anew; the arm must still stand where it stood."""
        self._latest_s = -math.inf

    def moving(self) -> None:
        """From here on the arm may be anywhere."""
        self._rest = None

    def check_times(self, times_s: list[float]) -> None:
        """Stamps of one answer, in any order among themselves, none before those of earlier answers.

        Raises
        ------
        SafetyStopError : the clock went backwards. So do the others here, each with value and limit.
        """
        if not times_s:
            return
        back_s = self._latest_s - min(times_s)
        if back_s > self._tolerances.time_tolerance_s:
            raise SafetyStopError(
                f"the clock of the bridge went back by {back_s:.6g} s (to t_s = {min(times_s):.6f}), "
                f"at most {self._tolerances.time_tolerance_s:g} s",
                where=self._where,
                cure="use a clock that only goes forward (time.monotonic)",
            )
        self._latest_s = max(self._latest_s, *times_s)

    def check_arrival(self, to: MoveTo, reached: State) -> None:
        """The arm is where it was sent; from here on it has to stay there."""
        self._compare(_end_of(to), reached, "the arm is {off} from where it was sent, at most {limit}")
        self._rest = reached

    def arrived(self, to: MoveTo, state: State) -> bool:
        """Whether the arm is where it was to go, as far as the state says."""
        target = _end_of(to)
        said = (target.world_from_tool is not None and state.world_from_tool is not None) or (
            target.joints_rad is not None and state.joints_rad is not None
        )
        return said and self._excess(target, state) is None

    def check_on_way(self, stood: State, to: MoveTo, state: State) -> None:
        """After a move that was lost with its line: the arm is somewhere between where it stood and its target.

        One that is further away was put somewhere else, and its straight way to the target may lead through the part.
        """
        target = _end_of(to)
        off = _off_way(stood, target, state)
        if off is not None:
            raise SafetyStopError(
                f"after the line broke in a move, the arm is {off[0]} from its way, at most {off[1]}",
                where=self._where,
                cure=_CURE,
            )

    def check_rest(self, state: State) -> None:
        """An arm that was not sent anywhere has not moved."""
        if self._rest is None:
            self._rest = state
            return
        self._compare(self._rest, state, "the arm has moved by {off} without a move, at most {limit}")

    def _compare(self, wanted: State, got: State, text: str) -> None:
        excess = self._excess(wanted, got)
        if excess is not None:
            off, limit = excess
            raise SafetyStopError(text.format(off=off, limit=limit), where=self._where, cure=_CURE)

    def _excess(self, wanted: State, got: State) -> tuple[str, str] | None:
        """What is beyond its limit and the limit; what only one of both says is not compared."""
        metres, radians = self._tolerances.position_tolerance_m, self._tolerances.angle_tolerance_rad
        if wanted.world_from_tool is not None and got.world_from_tool is not None:
            # Not by NumPy: numbers near the end of float64 would warn of an overflow there.
            away_m = math.dist(got.world_from_tool[:3, 3].tolist(), wanted.world_from_tool[:3, 3].tolist())
            if not away_m <= metres:
                return f"{1e3 * away_m:.3f} mm", f"{1e3 * metres:g} mm"
            turned_rad = turn_between_rad(wanted.world_from_tool, got.world_from_tool)
            if not turned_rad <= radians:
                return f"{math.degrees(turned_rad):.3f} deg", f"{math.degrees(radians):.3g} deg"
        if wanted.joints_rad is not None and got.joints_rad is not None:
            if len(wanted.joints_rad) != len(got.joints_rad):
                return f"{len(got.joints_rad)} joints", f"{len(wanted.joints_rad)} joints"
            pairs = zip(got.joints_rad.tolist(), wanted.joints_rad.tolist(), strict=True)
            off_rad, joint = max((abs(there - here), j + 1) for j, (here, there) in enumerate(pairs))
            if not off_rad <= radians:
                return f"{math.degrees(off_rad):.3f} deg at joint {joint}", f"{math.degrees(radians):.3g} deg"
        return None


def _off_way(stood: State, target: State, state: State) -> tuple[str, str] | None:
    """How far a state is from the way between two others, and the limit; None within it, or where nobody can tell."""
    poses = (stood.world_from_tool, target.world_from_tool, state.world_from_tool)
    if poses[0] is not None and poses[1] is not None and poses[2] is not None:
        start, end, here = (pose[:3, 3].tolist() for pose in poses if pose is not None)
        limit_m = WAY_SHARE * math.dist(start, end) + WAY_SLACK_M
        off_m = max(math.dist(start, here), math.dist(here, end)) - math.dist(start, end)
        return None if off_m <= limit_m else (f"{1e3 * off_m:.0f} mm", f"{1e3 * limit_m:.0f} mm")
    joints = (stood.joints_rad, target.joints_rad, state.joints_rad)
    if joints[0] is not None and joints[1] is not None and joints[2] is not None:
        low, high = np.minimum(joints[0], joints[1]), np.maximum(joints[0], joints[1])
        off_rad = float(np.max(np.maximum(low - joints[2], joints[2] - high), initial=0.0))
        if off_rad > WAY_SLACK_RAD:
            return f"{math.degrees(off_rad):.1f} deg", f"{math.degrees(WAY_SLACK_RAD):.1f} deg"
    return None


def turn_between_rad(world_from_a: FloatArray, world_from_b: FloatArray) -> float:
    """The angle of the rotation from one pose to the other; by sine and cosine, which is exact also near 0."""
    turn = world_from_a[:3, :3].T @ world_from_b[:3, :3]
    twice_sine = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return math.atan2(float(np.linalg.norm(twice_sine)), float(np.trace(turn)) - 1.0)


def _end_of(to: MoveTo) -> State:
    """The state that a move is to end in; its time does not matter."""
    return State(0.0, to.world_from_tool, to.joints_rad)
