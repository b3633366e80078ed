"""How long frames take on a CAN bus: every bit of them, with as many stuff bits as there can be.

ISO 11898-1, frames with 11-bit identifiers: 44 bits and the data, 3 bits until the next frame, and at most one stuff
bit for every four of the data and the 34 bits around them that are stuffed. So the time depends on lengths alone.
"""

from __future__ import annotations

from surfuse.node.layout import FRAME_BYTES

_FRAME_BITS, _PAUSE_BITS, _STUFFED_BITS, _STUFF_EVERY = 44, 3, 34, 4
_FRAMES_A_SWEEP = 3  # the trigger, and the node's words that it begins and that it is done
_FRAMES_A_SENSOR = 2  # range and detail


def frame_bits(data_bytes: int = FRAME_BYTES) -> int:
    """Bits of a frame, until the next one can begin."""
    data = 8 * data_bytes
    return _FRAME_BITS + data + _PAUSE_BITS + (_STUFFED_BITS + data - 1) // _STUFF_EVERY


def sweep_bus_s(sensors: int, bitrate_bps: int) -> float:
    """Time on the bus of a sweep of which nothing is lost: question and answers of so many sensors."""
    return (_FRAMES_A_SWEEP + _FRAMES_A_SENSOR * sensors) * frame_bits() / bitrate_bps
