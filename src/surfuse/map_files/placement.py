"""Where the part frame of a file lies in the world: one line of text that the comment of any format can hold.

`surfuse placement: world_from_part R11 R12 R13 x R21 ... z; first node u v`, in metres. Binary STL has 80 bytes for it:
a mark and twelve numbers in single precision.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.records import FloatArray, MapGrid

STL_HEADER_BYTES = 80
_STL_MARK = b"surfuse world_from_part "
_NUMBER = r"[-+0-9.eE]+"
_TEXT = re.compile(
    rf"surfuse placement: world_from_part ((?:{_NUMBER} ){{11}}{_NUMBER}); first node ({_NUMBER}) ({_NUMBER})"
)
_OLD_PLY = b"comment surfuse map, part frame, metres"
_LOOKED_AT_BYTES = 64 * 1024
_RIGID = 1e-5


@dataclass(frozen=True)
class Placement:
    """Part frame (4, 4) of a file of ours, None where it only says that it is in one; its first node in that frame.

    `world_from_part` is the part frame; (`first_u_m`, `first_v_m`) is the node of row 0 and column 0.
    """

    world_from_part: FloatArray | None
    first_u_m: float = 0.0
    first_v_m: float = 0.0


def placement_text(grid: MapGrid, from_first_node: bool = False) -> str:
    """The line for a file; `from_first_node` when its coordinates begin with 0 at the first node of the grid."""
    numbers = " ".join(repr(float(value)) for value in grid.world_from_part[:3].ravel())
    first = (float(grid.u_m[0]), float(grid.v_m[0])) if from_first_node else (0.0, 0.0)
    return f"surfuse placement: world_from_part {numbers}; first node {first[0]!r} {first[1]!r}"


def stl_header(grid: MapGrid) -> bytes:
    """The 80 bytes at the beginning of a binary STL."""
    return (_STL_MARK + grid.world_from_part[:3].astype("<f4").tobytes()).ljust(STL_HEADER_BYTES, b" ")


def placement_in(text: str) -> Placement | None:
    """The placement that a text holds, None without a sound one."""
    found = _TEXT.search(text)
    if found is None:
        return None
    try:
        numbers = [float(number) for number in found[1].split()]
        frame = _frame(np.array(numbers))
        return None if frame is None else Placement(frame, float(found[2]), float(found[3]))
    except ValueError:
        return None


def placement_of(path: Path) -> Placement | None:
    """The placement that a file of ours holds in its header or comments; None in a file of anyone else."""
    with path.open("rb") as stream:
        head = stream.read(_LOOKED_AT_BYTES)
    if head.startswith(_STL_MARK):
        frame = _frame(np.frombuffer(head, "<f4", 12, len(_STL_MARK)).astype(np.float64))
        return None if frame is None else Placement(frame)
    found = placement_in(head.decode("latin-1"))
    return Placement(None) if found is None and _OLD_PLY in head.splitlines()[:4] else found


def _frame(numbers: FloatArray) -> FloatArray | None:
    """The pose (4, 4) of twelve numbers, if it is one."""
    pose = np.vstack([numbers.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    turn = pose[:3, :3]
    if not np.all(np.isfinite(pose)) or np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0.0:
        return None
    return pose
