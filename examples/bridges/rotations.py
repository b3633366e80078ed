"""Quaternions and rotation vectors of poses (16 numbers, row by row), in plain Python."""

import math


def quaternion(m):
    """x, y, z, w of a pose, by its largest part (Shepperd 1978): also half turns are exact."""
    trace = m[0] + m[5] + m[10]
    big = max(range(4), key=lambda i: trace if i == 3 else m[5 * i])
    if big == 3:
        parts = [m[9] - m[6], m[2] - m[8], m[4] - m[1], 1.0 + trace]
    else:
        j, k = (big + 1) % 3, (big + 2) % 3
        parts = [0.0] * 4
        parts[big] = 1.0 + m[5 * big] - m[5 * j] - m[5 * k]
        parts[j], parts[k] = m[4 * big + j] + m[4 * j + big], m[4 * big + k] + m[4 * k + big]
        parts[3] = m[4 * k + j] - m[4 * j + k]
    length = math.sqrt(sum(part * part for part in parts))
    return [part / length for part in parts]


def rotation_vector(m):
    """Axis times angle in rad, of a pose."""
    *axis, w = quaternion(m)
    sine = math.sqrt(sum(part * part for part in axis))
    angle = 2.0 * math.atan2(sine, w)
    return [angle * part / sine if sine else 0.0 for part in axis]


def pose_of_vector(position_m, vector):
    """The pose at a position with a rotation vector (Rodrigues' formula)."""
    angle = math.sqrt(sum(part * part for part in vector))
    a, b, c = (part / angle if angle else 0.0 for part in vector)
    s, w = math.sin(angle), math.cos(angle)
    v = 1.0 - w
    x, y, z = position_m
    return [
        *(w + a * a * v, a * b * v - c * s, a * c * v + b * s, x),
        *(a * b * v + c * s, w + b * b * v, b * c * v - a * s, y),
        *(a * c * v - b * s, b * c * v + a * s, w + c * c * v, z),
        *(0.0, 0.0, 0.0, 1.0),
    ]
