"""The scan as a recording inside one HTML text: the viewer's own player with its data, nothing else needed."""

from __future__ import annotations

from surfuse.report.content import ReportContent
from surfuse.report.quiet_viewer import loopback_server
from surfuse.report.scan_scene import ScanScene
from surfuse.report.scene_limits import SceneLimits

SCAN_S = 16.0
HOLD_S = 3.0


def record_scan(content: ReportContent, limits: SceneLimits | None = None) -> str:
    """HTML of a player with the replay of the scan: about 0.85 MB of player and what the scan adds.

    A server on the loopback address lives while the scene is put together, for less than a second.
    """
    with loopback_server(0, "surfuse") as server:
        scan = ScanScene(server, content, limits or SceneLimits())
        recorder = server.get_scene_serializer()
        if len(scan.moments):
            scan.show_surfaces(False)
            for sweep in scan.moments.tolist():
                scan.show(sweep)
                recorder.insert_sleep(SCAN_S / len(scan.moments))
            scan.show_surfaces(True)
            recorder.insert_sleep(HOLD_S)
        return recorder.as_html()
