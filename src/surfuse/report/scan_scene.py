"""The scan as a scene of the 3-D viewer: surfaces, outline, arm, sensor array, beams and fused points."""

from __future__ import annotations

import numpy as np
import trimesh
import viser
import viser.transforms

from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, Gate, IntArray, Readings
from surfuse.report.colours import colourise
from surfuse.report.content import ReportContent
from surfuse.report.meshes import both_windings, map_mesh, quaternion_to, rod
from surfuse.report.scene_limits import SceneLimits

FUSED = (230, 159, 0)
# Colours per vertex are taken as linear light by the player: these show as the green and the red of the legend.
USED, KEPT_OUT = (0, 90, 45), (171, 28, 0)
STEEL, TRUTH, LINE = (120, 130, 142), (110, 150, 200), (11, 110, 110)
ARM_RADIUS_M = 0.035
# A beam without an echo is drawn this long.
SILENT_M = 0.15
# Fused points are sent in this many clouds: one that grows would be sent again and again.
CLOUDS = 40


def _centre_and_size(content: ReportContent) -> tuple[FloatArray, float, FloatArray]:
    """Middle of what is shown (3,), its extent in m, and the pose of the part (identity when unknown)."""
    named = (*content.maps, *((content.truth,) if content.truth else ()))
    if named:
        surface = named[0].surface
        points, _, _ = map_mesh(surface, 400)
        pose = surface.grid.world_from_part
    elif content.readings is not None:
        points, pose = content.readings.position_m, np.eye(4)
    else:
        points, pose = np.zeros((0, 3)), np.eye(4)
    finite = points[np.all(np.isfinite(points), axis=1)]
    if not len(finite):
        return np.zeros(3), 1.0, pose
    low, high = finite.min(axis=0), finite.max(axis=0)
    return 0.5 * (low + high), max(0.05, float(np.linalg.norm(high - low))), pose


def _aim_camera(server: viser.ViserServer, content: ReportContent) -> None:
    """Look at the part from the sensors' side, far enough to see the arm when there is one."""
    centre, size, pose = _centre_and_size(content)
    far = 2.0 * size if not len(content.arm_m) else max(2.0 * size, 0.85)
    direction = pose[:3, :3] @ np.array([0.85, 0.55, 0.75])
    server.initial_camera.position = centre + far * direction
    # With an arm in view, between the part and the array.
    server.initial_camera.look_at = centre + (0.1 * pose[:3, 2] if len(content.arm_m) else 0.0)
    server.initial_camera.fov = float(np.radians(45.0))


class ScanScene:
    """The scene on a server, with the moment of the scan that it shows."""

    def __init__(self, server: viser.ViserServer, content: ReportContent, limits: SceneLimits) -> None:
        self.content = content
        self.scene = server.scene
        self.surfaces: dict[str, viser.SceneNodeHandle] = {}
        readings = content.readings
        sweeps = readings.n_sweeps if readings else 0
        self.moments = np.unique(np.linspace(0, max(sweeps - 1, 0), min(sweeps, limits.frames_max)).astype(np.int64))
        _aim_camera(server, content)
        self._add_cell()
        self._add_surfaces(limits)
        self._clouds: list[viser.PointCloudHandle] = []
        self._filled: list[int] = []
        if readings is not None and sweeps:
            self._add_array(readings)
            self._add_arm()
            self._add_clouds()

    def _add_cell(self) -> None:
        for k, item in enumerate(self.content.scenery):
            self.scene.add_mesh_simple(
                f"/cell/{k + 1}", item.vertices_m, item.faces, color=(190, 196, 203), side="double", flat_shading=True
            )
        plan, maps = self.content.plan, self.content.maps
        if plan is None or not maps or len(plan.outline_m) < 3:
            return
        flat = np.column_stack([plan.outline_m, np.zeros(len(plan.outline_m))])
        corners = transform_points(maps[0].surface.grid.world_from_part, flat)
        sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        self.scene.add_line_segments("/outline", sides, LINE, thickness=2.5, thickness_units="screen")

    def _add_surfaces(self, limits: SceneLimits) -> None:
        content = self.content
        heights = [named.surface.height_m[named.surface.mask] for named in content.maps]
        joined = np.concatenate(heights) if heights else np.zeros(0)
        low, high = np.percentile(joined, [0.5, 99.5]) if joined.size else (0.0, 1.0)
        for k, named in enumerate(content.maps[: limits.surfaces_max]):
            vertices, faces, height = map_mesh(named.surface, limits.nodes_max)
            if not len(faces):
                continue
            # The GLB path carries vertex colours but draws front sides only.
            twice, both = both_windings(vertices, faces)
            colours = colourise(np.tile(height, 2), float(low), max(float(high), float(low) + 1e-3))
            mesh = trimesh.Trimesh(twice, both, vertex_colors=colours, process=False)
            path = f"/surfaces/{k + 1} {_node_name(named.label)}"
            self.surfaces[named.label] = self.scene.add_mesh_trimesh(path, mesh, visible=k == 0)
        if content.truth is not None:
            vertices, faces, _ = map_mesh(content.truth.surface, limits.nodes_max)
            path = f"/surfaces/{_node_name(content.truth.label)}"
            if len(faces):
                self.surfaces[content.truth.label] = self.scene.add_mesh_simple(
                    path, vertices, faces, color=TRUTH, opacity=0.6, side="double", flat_shading=True, visible=False
                )

    def _add_array(self, readings: Readings) -> None:
        self._array = self.scene.add_frame("/array", show_axes=False)
        grip_from_world = inverse(readings.world_from_grip)
        centres = []
        for sensor in range(len(readings.specs)):
            rows = np.flatnonzero(readings.sensor == sensor)
            if not len(rows):
                continue
            sweep = int(np.searchsorted(readings.start, rows[0], side="right")) - 1
            centre = transform_points(grip_from_world[sweep], readings.position_m[rows[0]])
            centres.append(centre)
            axis = grip_from_world[sweep, :3, :3] @ readings.axis[rows[0]]
            body, faces = rod(0.03, 0.018)
            self.scene.add_mesh_simple(
                f"/array/sensor {sensor + 1}",
                body,
                faces,
                color=(45, 52, 60),
                wxyz=quaternion_to(axis),
                position=centre - 0.03 * axis,
                side="double",
            )
        spokes = np.stack([np.zeros((len(centres), 3)), np.array(centres).reshape(-1, 3)], axis=1)
        self.scene.add_line_segments("/array/mount", spokes, STEEL, thickness=0.008)
        most = int(np.diff(readings.start).max(initial=1))
        self._slots = max(most, 1)
        empty = np.zeros((self._slots, 2, 3))
        self._beams = self.scene.add_line_segments("/beams", empty, np.zeros_like(empty), thickness=0.004)

    def _add_arm(self) -> None:
        self._links: list[tuple[int, viser.MeshHandle]] = []
        arm = self.content.arm_m
        if not len(arm):
            return
        self._lengths = np.median(np.linalg.norm(np.diff(arm, axis=1), axis=2), axis=0)
        for k, length in enumerate(self._lengths):
            if length > 0.005:
                thick = ARM_RADIUS_M * (1.0 - 0.5 * k / max(len(self._lengths) - 1, 1))
                vertices, faces = rod(float(length), thick)
                self._links.append(
                    (k, self.scene.add_mesh_simple(f"/arm/link {k + 1}", vertices, faces, color=STEEL, side="double"))
                )

    def _add_clouds(self) -> None:
        points, maps = self.content.points, self.content.maps
        if points is None or not maps:
            return
        self._world_points = transform_points(maps[0].surface.grid.world_from_part, points.point_m)
        bounds = np.linspace(0, len(points), CLOUDS + 1).astype(np.int64)
        self._cloud_stops: list[IntArray] = []
        for k in range(CLOUDS):
            stops = np.arange(bounds[k], bounds[k + 1])
            self._cloud_stops.append(stops[np.all(np.isfinite(self._world_points[stops]), axis=1)])
            cloud = self.scene.add_point_cloud(f"/points/{k + 1}", np.zeros((1, 3)), FUSED, precision="float32")
            cloud.point_size, cloud.point_shape, cloud.visible = 0.003, "circle", False
            self._clouds.append(cloud)
        self._filled = [0] * CLOUDS

    def show_surfaces(self, visible: bool) -> None:
        """Show or hide the first surface: it is what the scan is to find."""
        for named in self.content.maps[:1]:
            if named.label in self.surfaces:
                self.surfaces[named.label].visible = visible

    def show(self, sweep: int) -> None:
        """Bring array, beams, arm and points to the moment of a sweep."""
        readings = self.content.readings
        if readings is None or not readings.n_sweeps:
            return
        pose = readings.world_from_grip[sweep]
        self._array.wxyz = viser.transforms.SO3.from_matrix(pose[:3, :3]).wxyz
        self._array.position = pose[:3, 3]
        self._show_beams(readings, sweep)
        for k, handle in self._links:
            foot, head = self.content.arm_m[sweep, k : k + 2]
            length = max(float(np.linalg.norm(head - foot)), 1e-9)
            handle.position = foot
            handle.wxyz = quaternion_to((head - foot) / length)
            # A link that slides or that only stands for several joints changes its length.
            if abs(length - self._lengths[k]) > 1e-3:
                handle.scale = (1.0, 1.0, length / self._lengths[k])
        self._show_points(sweep)

    def _show_beams(self, readings: Readings, sweep: int) -> None:
        rows = np.arange(readings.start[sweep], readings.start[sweep + 1])
        ends = np.zeros((self._slots, 2, 3))
        colours = np.full((self._slots, 2, 3), 150, dtype=np.uint8)
        reach = readings.range_m[rows]
        reach = np.where(np.isfinite(reach), reach, SILENT_M)
        ends[: len(rows), 0] = readings.position_m[rows]
        ends[: len(rows), 1] = readings.position_m[rows] + reach[:, None] * readings.axis[rows]
        # Unused slots shrink to a point of the array, where nobody sees them.
        ends[len(rows) :] = readings.world_from_grip[sweep, :3, 3]
        used = np.isfinite(readings.range_m[rows])
        points = self.content.points
        if points is not None and len(points.gate) == len(readings.range_m):
            used &= points.gate[rows] == Gate.PASSED
        colours[: len(rows)] = np.where(used[:, None, None], np.array(USED), np.array(KEPT_OUT))
        self._beams.points = ends.astype(np.float32)
        self._beams.colors = colours

    def _show_points(self, sweep: int) -> None:
        for k, cloud in enumerate(self._clouds):
            seen = int(np.searchsorted(self._cloud_stops[k], sweep, side="right"))
            if seen == self._filled[k]:
                continue
            self._filled[k] = seen
            if seen:
                cloud.points = self._world_points[self._cloud_stops[k][:seen]].astype(np.float32)
            cloud.visible = seen > 0


def _node_name(label: str) -> str:
    """A label as a name in the scene tree, where a slash would start a child."""
    return label.replace("/", "-").strip() or "map"
