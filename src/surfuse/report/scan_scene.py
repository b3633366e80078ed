"""The scan as a scene of the 3-D viewer: surfaces, outline, arm, sensor array, beams and fused points."""

from __future__ import annotations

import numpy as np
import viser

from surfuse.geometry.poses import transform_points
from surfuse.records import FloatArray, Gate, IntArray, Readings
from surfuse.report.content import ReportContent
from surfuse.report.map_layers import ColourRange, Layer, add_even_light, colour_range, coloured_mesh
from surfuse.report.meshes import map_mesh
from surfuse.report.moving_parts import (
    KEPT_OUT,
    SILENT,
    USED,
    ArmParts,
    ArrayParts,
    Moment,
    link_lengths,
)
from surfuse.report.scale_bar import add_scale_bar
from surfuse.report.scene_limits import SceneLimits

FUSED = (230, 159, 0)
TRUTH, LINE = (110, 150, 200), (11, 110, 110)
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
        self.scene, self._limits = server.scene, limits
        self.surfaces: dict[str, viser.SceneNodeHandle] = {}
        readings = content.readings
        sweeps = readings.n_sweeps if readings else 0
        self.moments = np.unique(np.linspace(0, max(sweeps - 1, 0), min(sweeps, limits.frames_max)).astype(np.int64))
        _aim_camera(server, content)
        add_even_light(server.scene)
        self._add_cell()
        self._add_surfaces()
        self._clouds: list[viser.PointCloudHandle] = []
        self._filled: list[int] = []
        if readings is not None and sweeps:
            self._add_array(readings)
            self._arm = ArmParts(server.scene, link_lengths(content.arm_m)) if len(content.arm_m) else None
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

    def _add_surfaces(self) -> None:
        content, limits = self.content, self._limits
        self.colour_by("height")
        if content.truth is not None:
            vertices, faces, _ = map_mesh(content.truth.surface, limits.nodes_max)
            path = f"/surfaces/{_node_name(content.truth.label)}"
            if len(faces):
                self.surfaces[content.truth.label] = self.scene.add_mesh_simple(
                    path, vertices, faces, color=TRUTH, opacity=0.6, side="double", flat_shading=True, visible=False
                )

    def colour_by(self, layer: Layer) -> ColourRange | None:
        """Colour all maps by a layer, in one range; None where there is no map."""
        maps = self.content.maps[: self._limits.surfaces_max]
        if not maps:
            return None
        shown = colour_range([named.surface for named in self.content.maps], layer)
        for k, named in enumerate(maps):
            before = self.surfaces.get(named.label)
            mesh = coloured_mesh(named.surface, self._limits.nodes_max, shown)
            if mesh is not None:
                path = f"/surfaces/{k + 1} {_node_name(named.label)}"
                visible = k == 0 if before is None else before.visible
                self.surfaces[named.label] = self.scene.add_mesh_trimesh(path, mesh, visible=visible)
        return shown

    def _add_array(self, readings: Readings) -> None:
        self._array = ArrayParts(self.scene, max(int(np.diff(readings.start).max(initial=1)), 1))
        for sensor in range(len(readings.specs)):
            rows = np.flatnonzero(readings.sensor == sensor)
            if len(rows):
                sweep = int(np.searchsorted(readings.start, rows[0], side="right")) - 1
                self._array.mount(readings.sensor[rows[:1]], self._moment(readings, sweep, rows[:1]))

    def _moment(self, readings: Readings, sweep: int, rows: IntArray) -> Moment:
        heard = np.isfinite(readings.range_m[rows])
        points, used = self.content.points, heard
        if points is not None and len(points.gate) == len(readings.range_m):
            used = heard & (points.gate[rows] == Gate.PASSED)
        silent = np.isposinf(readings.range_m[rows])
        colours = np.where(
            used[:, None], np.array(USED), np.where(silent[:, None], np.array(SILENT), np.array(KEPT_OUT))
        )
        return Moment(
            readings.world_from_grip[sweep],
            readings.position_m[rows],
            readings.axis[rows],
            readings.range_m[rows],
            colours.astype(np.uint8),
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
        rows = np.arange(readings.start[sweep], readings.start[sweep + 1])
        self._array.show(self._moment(readings, sweep, rows))
        if self._arm is not None:
            self._arm.show(self.content.arm_m[sweep])
        self._show_points(sweep)

    def _show_points(self, sweep: int) -> None:
        for k, cloud in enumerate(self._clouds):
            seen = int(np.searchsorted(self._cloud_stops[k], sweep, side="right"))
            if seen == self._filled[k]:
                continue
            self._filled[k] = seen
            if seen:
                cloud.points = self._world_points[self._cloud_stops[k][:seen]].astype(np.float32)
            cloud.visible = seen > 0


def add_scale_of(scene: viser.SceneApi, content: ReportContent) -> None:
    """A scale beside the first map; none where there is no map."""
    for named in content.maps[:1]:
        grid = named.surface.grid
        low, high = (np.array([end(grid.u_m), end(grid.v_m)]) for end in (np.min, np.max))
        add_scale_bar(scene, grid.world_from_part, low, high)


def _node_name(label: str) -> str:
    """A label as a name in the scene tree, where a slash would start a child."""
    return label.replace("/", "-").strip() or "map"
