"""All eight inverse solutions of an elbow arm with shoulder offset and spherical wrist (the PUMA 560).

Solution k = 4 right + 2 down + flip: left or right arm, elbow up or down, wrist not flipped or flipped: the
order lun, luf, ldn, ldf, run, ruf, rdn, rdf of Corke's toolbox (names of Lee and Ziegler 1984). The arm solves as
a planar triangle whose sides are the upper arm a2 and the forearm sqrt(a3^2 + d4^2), the wrist as z-y-z angles
(Paul and Zhang 1986; derived anew, so that shared terms are computed once).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from surfuse.geometry.compiled import compiled

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SOLUTIONS = 8
_REACH_SLACK = 1e-12  # rounding of a pose exactly at full stretch must not make it unreachable
_WRIST_SINGULAR = 1e-10  # sine of joint 5 below which joints 4 and 6 turn about the same axis


@compiled
def all_solutions(
    poses: FloatArray, base_from_world: FloatArray, tool_from_flange: FloatArray, sizes: FloatArray
) -> FloatArray:
    """Joint angles (N, 8, 6) in [-pi, pi] for tool poses (N, 4, 4); nan where the pose is out of reach.

    `sizes` is d1, a2, a3, d3, d4 in metres. Joint 4 is 0 where the wrist is singular.
    """
    n = poses.shape[0]
    joints = np.full((n, SOLUTIONS, 6), np.nan)
    middle = np.empty((3, 4))
    flange = np.empty((3, 4))
    for i in range(n):
        for r in range(3):
            for c in range(4):
                middle[r, c] = (
                    base_from_world[r, 0] * poses[i, 0, c]
                    + base_from_world[r, 1] * poses[i, 1, c]
                    + base_from_world[r, 2] * poses[i, 2, c]
                )
            middle[r, 3] += base_from_world[r, 3]
        for r in range(3):
            for c in range(4):
                flange[r, c] = (
                    middle[r, 0] * tool_from_flange[0, c]
                    + middle[r, 1] * tool_from_flange[1, c]
                    + middle[r, 2] * tool_from_flange[2, c]
                )
            flange[r, 3] += middle[r, 3]
        _solve_arm(flange, sizes, joints[i])
    return joints


@compiled
def _solve_arm(flange: FloatArray, sizes: FloatArray, joints: FloatArray) -> None:
    """Joints 1 to 3 from the wrist centre, for both shoulders and both elbows, then the wrist of each."""
    d1, a2, a3, d3, d4 = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
    x, y, height = flange[0, 3], flange[1, 3], flange[2, 3] - d1
    radius_squared = x * x + y * y
    ahead_squared = radius_squared - d3 * d3
    forearm = math.sqrt(a3 * a3 + d4 * d4)
    cos_bend = (ahead_squared + height * height - a2 * a2 - forearm * forearm) / (2.0 * a2 * forearm)
    # Written so that nan, too, counts as out of reach.
    if not (ahead_squared >= -_REACH_SLACK and abs(cos_bend) <= 1.0 + _REACH_SLACK):
        return
    ahead = math.sqrt(max(ahead_squared, 0.0))
    cos_bend = min(1.0, max(-1.0, cos_bend))
    bend = math.acos(cos_bend)
    sin_bend = math.sqrt(1.0 - cos_bend * cos_bend)
    # Angle from the upper arm's foot to the wrist, and between that line and the upper arm.
    elevation = math.atan2(height, ahead)
    lift = math.atan2(forearm * sin_bend, a2 + forearm * cos_bend)
    beta = math.atan2(d4, a3)
    for right in range(2):
        side = 2.0 * right - 1.0
        c1 = (side * x * ahead - y * d3) / radius_squared
        s1 = (side * y * ahead + x * d3) / radius_squared
        q1 = math.atan2(s1, c1)
        for down in range(2):
            # Elbow up: the upper arm lies above the line from shoulder to wrist, on either shoulder.
            above = 1.0 - 2.0 * down
            q2 = elevation + above * lift
            q3 = -above * bend - beta
            if right == 0:
                q2 = math.pi - q2
                q3 = above * bend - beta
            k = 4 * right + 2 * down
            joints[k + 1, 0], joints[k + 1, 1], joints[k + 1, 2] = q1, _wrapped(q2), _wrapped(q3)
            _solve_wrist(flange, c1, s1, q2 + q3, joints[k], joints[k + 1])


@compiled
def _solve_wrist(
    flange: FloatArray, c1: float, s1: float, q23: float, straight: FloatArray, flipped: FloatArray
) -> None:
    """Joints 4 to 6 from the orientation in link 3, which is Rz(q4) Ry(-q5) Rz(q6)."""
    c23, s23 = math.cos(q23), math.sin(q23)
    outwards_z = c1 * flange[0, 2] + s1 * flange[1, 2]
    xz = c23 * outwards_z + s23 * flange[2, 2]
    yz = c1 * flange[1, 2] - s1 * flange[0, 2]
    zz = c23 * flange[2, 2] - s23 * outwards_z
    sin_q5 = math.sqrt(xz * xz + yz * yz)
    # Only the sum of joints 4 and 6 is determined where the wrist is singular.
    c4, s4 = 1.0, 0.0
    if sin_q5 >= _WRIST_SINGULAR:
        c4, s4 = -xz / sin_q5, -yz / sin_q5
    # Row y of Rz(-q4) R = Ry(-q5) Rz(q6) is (sin q6, cos q6, 0): exact for the rounded q4, singular or not.
    xx = c23 * (c1 * flange[0, 0] + s1 * flange[1, 0]) + s23 * flange[2, 0]
    xy = c23 * (c1 * flange[0, 1] + s1 * flange[1, 1]) + s23 * flange[2, 1]
    yx, yy = c1 * flange[1, 0] - s1 * flange[0, 0], c1 * flange[1, 1] - s1 * flange[0, 1]
    q4 = math.atan2(s4, c4)
    q6 = math.atan2(c4 * yx - s4 * xx, c4 * yy - s4 * xy)
    flipped[3], flipped[4], flipped[5] = q4, math.atan2(sin_q5, zz), q6
    straight[0], straight[1], straight[2] = flipped[0], flipped[1], flipped[2]
    straight[3], straight[4], straight[5] = _opposite(q4), -flipped[4], _opposite(q6)


@compiled
def _opposite(angle: float) -> float:
    """The angle half a turn further, in [-pi, pi]."""
    return angle - math.pi if angle > 0.0 else angle + math.pi


@compiled
def _wrapped(angle: float) -> float:
    """The same direction in [-pi, pi], for an angle within three half turns."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    if angle < -math.pi:
        return angle + 2.0 * math.pi
    return angle


@compiled
def into_limits(joints: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Shift angles (N, K, J) by whole turns into their limits, in place; which solutions (N, K) then are inside.

    An angle that is inside already keeps its value; one that no shift brings inside keeps it too.
    """
    n, solutions, count = joints.shape
    inside = np.empty((n, solutions), dtype=np.bool_)
    for i in range(n):
        for k in range(solutions):
            all_inside = True
            for j in range(count):
                q = joints[i, k, j]
                if q < lower[j] and q + 2.0 * math.pi <= upper[j]:
                    q += 2.0 * math.pi
                elif q > upper[j] and q - 2.0 * math.pi >= lower[j]:
                    q -= 2.0 * math.pi
                joints[i, k, j] = q
                # Written so that nan counts as outside.
                if not lower[j] <= q <= upper[j]:
                    all_inside = False
            inside[i, k] = all_inside
    return inside
