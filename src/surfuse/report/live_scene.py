"""The scene of a scan that runs: the planned stops, the arm and its beams at any stop so far, and the map so far."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import viser

from surfuse.geometry.poses import transform_points
from surfuse.records import FloatArray, FusionScene, ScanPlan, SurfaceMap, Sweep
from surfuse.report.map_layers import LAYERS, ColourRange, colour_range, coloured_mesh, legend_html
from surfuse.report.moving_parts import ArmParts, ArrayParts, Moment, colours_by_status, link_lengths
from surfuse.report.playback import Playback
from surfuse.report.scale_bar import add_scale_bar

LinkPoses = Callable[[FloatArray], FloatArray]

LINE, PLANNED = (11, 110, 110), (150, 150, 150)
NODES_MAX = 10000
"""A map of more nodes is thinned out: it is sent again with every change."""


class LiveScene:
    """Scene and controls of a running scan on a server.

    The sweeps are kept, so that every stop can be shown again. `link_poses` maps joints (N, J) to poses (N, L, 4, 4) of
    the arm's links; without it only the array is drawn.
    """

    def __init__(
        self, server: viser.ViserServer, scene: FusionScene, plan: ScanPlan, link_poses: LinkPoses | None = None
    ) -> None:
        self._server, self._plan, self._link_poses = server, plan, link_poses
        self._sweeps: list[Sweep] = []
        self._array: ArrayParts | None = None
        self._arm: ArmParts | None = None
        self._map: SurfaceMap | None = None
        self._turn = threading.Lock()
        box = np.concatenate([plan.uv_m, plan.outline.vertices_m])
        self._low, self._high = box.min(axis=0), box.max(axis=0)
        self._add_plan(scene)
        add_scale_bar(server.scene, scene.world_from_part, self._low, self._high)
        self._aim(scene.world_from_part)
        self._status = server.gui.add_html("")
        self._layer = server.gui.add_dropdown("Map", LAYERS, initial_value=LAYERS[0])
        self._layer.on_update(lambda _: self._draw_map())
        self._legend = server.gui.add_html(legend_html(None, beams=True))
        self.playback = Playback(server.gui, self._show, -1, follow=True)

    def _add_plan(self, scene: FusionScene) -> None:
        flat = np.column_stack([self._plan.uv_m, np.zeros(len(self._plan))])
        stops = transform_points(scene.world_from_part, flat).astype(np.float32)
        if len(stops):
            cloud = self._server.scene.add_point_cloud("/planned", stops, PLANNED, precision="float32")
            cloud.point_size, cloud.point_shape = 0.002, "circle"
        outline = self._plan.outline.vertices_m
        if len(outline) >= 3:
            corners = transform_points(scene.world_from_part, np.column_stack([outline, np.zeros(len(outline))]))
            sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            self._server.scene.add_line_segments("/outline", sides, LINE, thickness=2.5, thickness_units="screen")

    def _aim(self, world_from_part: FloatArray) -> None:
        """Look at the part from the sensors' side; pages that are open already turn there, too."""
        middle = 0.5 * (self._low + self._high)
        centre = transform_points(world_from_part, np.array([*middle, 0.5 * self._plan.standoff_m]))
        far = max(2.2 * float(np.linalg.norm(self._high - self._low)), 2.2 * self._plan.standoff_m)
        place = centre + far * (world_from_part[:3, :3] @ np.array([0.85, 0.55, 0.75]))
        fov_rad = float(np.radians(45.0))
        first = self._server.initial_camera
        first.position, first.look_at, first.fov = place, centre, fov_rad
        for page in self._server.get_clients().values():
            page.camera.position, page.camera.look_at, page.camera.fov = place, centre, fov_rad

    def add(self, sweep: Sweep) -> None:
        """One stop more; it is drawn by `playback.extend` for those who follow."""
        self._sweeps.append(sweep)

    def tell(self, text_html: str) -> None:
        """What the page says of the scan."""
        self._status.content = text_html

    def show_map(self, surface: SurfaceMap) -> None:
        """Draw this map from now on."""
        self._map = surface
        self._draw_map()

    def _draw_map(self) -> None:
        with self._turn:
            surface = self._map
            shown: ColourRange | None = None
            if surface is not None:
                shown = colour_range([surface], self._layer.value)
                mesh = coloured_mesh(surface, NODES_MAX, shown)
                if mesh is not None:
                    self._server.scene.add_mesh_trimesh("/map", mesh)
            self._legend.content = legend_html(shown, beams=True)

    def _show(self, number: int) -> None:
        sweep = self._sweeps[number]
        moment = Moment(
            sweep.world_from_grip, sweep.position_m, sweep.axis, sweep.range_m, colours_by_status(sweep.status)
        )
        # Arm and array of one moment, for every page.
        with self._server.atomic():
            if self._array is None:
                self._array = ArrayParts(self._server.scene, max(len(sweep.range_m), 1))
            self._array.mount(sweep.sensor, moment)
            self._array.show(moment)
            if self._link_poses is not None and sweep.joints_rad.size:
                joints_m = self._link_poses(sweep.joints_rad[None])[0, :, :3, 3]
                self._arm = self._arm or ArmParts(self._server.scene, link_lengths(joints_m[None]))
                self._arm.show(joints_m)
