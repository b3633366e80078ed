"""What moves in the scene of a scan: the array on its tool, its beams, the links of the arm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import viser
import viser.transforms

from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import ByteArray, FloatArray, IntArray, Status
from surfuse.report.meshes import quaternion_to, rod

# Colours per vertex are taken as linear light by the player: these show as the green and the red of the legend.
USED, KEPT_OUT, SILENT = (0, 90, 45), (171, 28, 0), (120, 120, 120)
STEEL = (120, 130, 142)
ARM_RADIUS_M = 0.035
SILENT_M = 0.15
"""A beam without an echo is drawn this long."""

BEAM_LEGEND = (("#00a077", "echo"), ("#d55e00", "echo kept out, or a fault"), ("#b0b0b0", "no echo"))
"""The colours of the beams as they show, and what they mean."""


def colours_by_status(status: IntArray) -> ByteArray:
    """Colours (S, 3) of readings by what the devices said of them."""
    heard, silent = status == Status.OK, status == Status.NO_ECHO
    colours = np.where(heard[:, None], np.array(USED), np.where(silent[:, None], np.array(SILENT), np.array(KEPT_OUT)))
    result: ByteArray = colours.astype(np.uint8)
    return result


@dataclass(frozen=True)
class Moment:
    """One stop as it is drawn: pose of the grip, and of S readings place, axis, range (m) and colour (S, 3)."""

    world_from_grip: FloatArray
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    colours: ByteArray


@dataclass
class ArrayParts:
    """The array: a body for each sensor, the mount that carries them, and a beam for each reading of a stop."""

    scene: viser.SceneApi
    slots: int = 1
    _centres_m: dict[int, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._frame = self.scene.add_frame("/array", show_axes=False)
        self._beams = self._add_beams()

    def _add_beams(self) -> viser.LineSegmentsHandle:
        empty = np.zeros((self.slots, 2, 3))
        return self.scene.add_line_segments("/beams", empty, np.zeros_like(empty), thickness=0.004)

    def mount(self, sensor: IntArray, moment: Moment) -> None:
        """Draw the sensors that are not drawn yet, where the readings of this moment say that they sit."""
        grip_from_world, before = inverse(moment.world_from_grip), len(self._centres_m)
        for row, number in enumerate(sensor.tolist()):
            if number in self._centres_m:
                continue
            centre = transform_points(grip_from_world, moment.position_m[row])
            axis = grip_from_world[:3, :3] @ moment.axis[row]
            self._centres_m[number] = centre
            body, faces = rod(0.03, 0.018)
            self.scene.add_mesh_simple(
                f"/array/sensor {number + 1}",
                body,
                faces,
                color=(45, 52, 60),
                wxyz=quaternion_to(axis),
                position=centre - 0.03 * axis,
                side="double",
            )
        if len(self._centres_m) > before:
            centres = np.array(list(self._centres_m.values())).reshape(-1, 3)
            spokes = np.stack([np.zeros((len(centres), 3)), centres], axis=1)
            self.scene.add_line_segments("/array/mount", spokes, STEEL, thickness=0.008)

    def show(self, moment: Moment) -> None:
        """Bring the array and its beams to a stop."""
        pose, n = moment.world_from_grip, len(moment.range_m)
        self._frame.wxyz = viser.transforms.SO3.from_matrix(pose[:3, :3]).wxyz
        self._frame.position = pose[:3, 3]
        if n > self.slots:
            self.slots = n
            self._beams = self._add_beams()
        ends = np.zeros((self.slots, 2, 3))
        colours = np.full((self.slots, 2, 3), 150, dtype=np.uint8)
        reach = np.where(np.isfinite(moment.range_m), moment.range_m, SILENT_M)
        ends[:n, 0] = moment.position_m
        ends[:n, 1] = moment.position_m + reach[:, None] * moment.axis
        # Unused slots shrink to a point of the array, where nobody sees them.
        ends[n:] = pose[:3, 3]
        colours[:n] = moment.colours[:, None]
        self._beams.points = ends.astype(np.float32)
        self._beams.colors = colours


@dataclass
class ArmParts:
    """The arm as rods from joint to joint, of the typical lengths (L,) that they have."""

    scene: viser.SceneApi
    lengths_m: FloatArray

    def __post_init__(self) -> None:
        self._links: list[tuple[int, viser.MeshHandle]] = []
        for k, length in enumerate(self.lengths_m):
            if length > 0.005:
                thick = ARM_RADIUS_M * (1.0 - 0.5 * k / max(len(self.lengths_m) - 1, 1))
                vertices, faces = rod(float(length), thick)
                name = f"/arm/link {k + 1}"
                self._links.append((k, self.scene.add_mesh_simple(name, vertices, faces, color=STEEL, side="double")))

    def show(self, joints_m: FloatArray) -> None:
        """Bring the links to where the joints (L + 1, 3) are in the world."""
        for k, handle in self._links:
            foot, head = joints_m[k], joints_m[k + 1]
            length = max(float(np.linalg.norm(head - foot)), 1e-9)
            handle.position = foot
            handle.wxyz = quaternion_to((head - foot) / length)
            # A link that slides or that only stands for several joints changes its length.
            if abs(length - self.lengths_m[k]) > 1e-3:
                handle.scale = (1.0, 1.0, length / float(self.lengths_m[k]))


def link_lengths(joints_m: FloatArray) -> FloatArray:
    """Typical lengths (L,) of the links in postures (N, L + 1, 3)."""
    lengths: FloatArray = np.median(np.linalg.norm(np.diff(joints_m, axis=1), axis=2), axis=0)
    return lengths
