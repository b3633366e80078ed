"""dc1: how well a reading follows the straight line through the last fused points of its scan line (section 3.2)."""

from __future__ import annotations

import math

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray

WINDOW = 3
"""How many fused values the temporal window keeps (the paper's "three last values of the average")."""


@compiled
def remember(window_m: FloatArray, held: int, world_from_grip: FloatArray, j: int, depth_m: float) -> int:
    """Append the fused point o + M g of stop j (world) to the window (3, 3), oldest first.

    `held` points were in the window; returns how many are in it now.
    """
    n = held
    if n == WINDOW:
        for k in range(WINDOW - 1):
            for d in range(3):
                window_m[k, d] = window_m[k + 1, d]
        n -= 1
    for d in range(3):
        window_m[n, d] = world_from_grip[j, d, 3] + depth_m * world_from_grip[j, d, 2]
    return n + 1


@compiled
def predicted_depth(window_m: FloatArray, held: int, world_from_grip: FloatArray, j: int) -> float:
    """Range along the grip axis of stop j, poses (M, 4, 4), that the window predicts; nan with under two points.

    The fused points of the window are seen from the present grip pose: depth y along the grip axis, position x
    along the direction of travel, which is 0 on the present axis. A least-squares straight line y(x) = a + b x
    gives the prediction a. When the grip moves in a plane and does not turn, y are the last values M(n-3..n-1) and
    x their positions along the line: the paper's predictor, against position and not index. Points at one and the
    same place determine no slope: their mean is the prediction.
    """
    if held < 2:
        return math.nan
    ox, oy, oz = world_from_grip[j, 0, 3], world_from_grip[j, 1, 3], world_from_grip[j, 2, 3]
    gx, gy, gz = world_from_grip[j, 0, 2], world_from_grip[j, 1, 2], world_from_grip[j, 2, 2]
    dx, dy, dz = ox - window_m[0, 0], oy - window_m[0, 1], oz - window_m[0, 2]
    depth = dx * gx + dy * gy + dz * gz
    dx, dy, dz = dx - depth * gx, dy - depth * gy, dz - depth * gz
    travel = math.sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / travel if travel > 0.0 else 0.0
    sx, sy, sxx, sxy = 0.0, 0.0, 0.0, 0.0
    # Sums relative to the newest point: far from the origin the plain sums lose digits.
    y0 = 0.0
    for k in range(held - 1, -1, -1):
        ex, ey, ez = window_m[k, 0] - ox, window_m[k, 1] - oy, window_m[k, 2] - oz
        x = (ex * dx + ey * dy + ez * dz) * scale
        y = ex * gx + ey * gy + ez * gz
        if k == held - 1:
            y0 = y
        sx += x
        sy += y - y0
        sxx += x * x
        sxy += x * (y - y0)
    mean_x, mean_y = sx / held, sy / held
    variance = sxx - sx * mean_x
    # Travel under a millionth of the distance to the part is pose noise, not a line.
    if variance <= 1e-12 * depth * depth:
        return y0 + mean_y
    slope = (sxy - sx * mean_y) / variance
    return y0 + mean_y - slope * mean_x


@compiled
def prediction_confidence(deviation_m: float, scale_m: float) -> float:
    """dc1 = exp(-(m - predicted)^2 / (2 scale^2)): 1 on the predicted line, 0.61 one scale away, 0.01 three away."""
    z = deviation_m / scale_m
    return math.exp(-0.5 * z * z)
