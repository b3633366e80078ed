"""What a calibration says: a part of a cell file, data for machines, a table for people."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse import __version__
from surfuse.records import CameraModel
from surfuse.rig.mounts import Mount
from surfuse.vision.calibration_camera import CameraCalibration
from surfuse.vision.calibration_ranger import ShoulderRanger
from surfuse.vision.calibration_shoulder import ShoulderCamera
from surfuse.vision.calibration_target import NotSeen, Target

_COVERAGE_GOOD = 0.5


@dataclass(frozen=True)
class ShoulderResult:
    """Camera and ranger on the shoulder, how many views were used, and which were not."""

    found: ShoulderCamera
    mount: Mount
    ranger: ShoulderRanger | None
    ranger_height_m: float
    used: int
    left_out: tuple[NotSeen, ...]


def camera_lines(camera: CameraModel) -> list[str]:
    """Lens and pixels as lines of a [camera] table."""
    numbers = ", ".join(f"{value:.8f}" for value in camera.distortion)
    return [
        f"width_px = {camera.width_px}",
        f"height_px = {camera.height_px}",
        *(f"{name} = {getattr(camera, name):.5f}" for name in ("fx_px", "fy_px", "cx_px", "cy_px")),
        f"distortion = [{numbers}]",
    ]


def camera_toml(found: CameraCalibration, target: Target) -> str:
    """The [camera] section of a cell file, with what is known of its quality as comments."""
    sigma = found.sigma
    deviations = ", ".join(f"{value:.2g}" for value in sigma.distortion)
    return "\n".join(
        [
            f"# Camera calibrated by surfuse {__version__} from {len(found.used)} views of a {target.pattern} of "
            f"{target.columns} x {target.rows} squares of {1e3 * target.square_m:g} mm.",
            f"# Reprojection error {found.reprojection_px:.3f} px, coverage {100.0 * found.coverage:.0f} %.",
            f"# Standard deviations: fx {sigma.fx_px:.3f}, fy {sigma.fy_px:.3f}, cx {sigma.cx_px:.3f}, "
            f"cy {sigma.cy_px:.3f} px; distortion {deviations}.",
            "[camera]",
            *camera_lines(found.camera),
            "",
        ]
    )


def camera_summary(found: CameraCalibration, out: Path) -> dict[str, object]:
    """Camera, standard deviations, fit and views, as plain data."""

    def plain(camera: CameraModel) -> dict[str, object]:
        return {
            "fx_px": camera.fx_px,
            "fy_px": camera.fy_px,
            "cx_px": camera.cx_px,
            "cy_px": camera.cy_px,
            "distortion": list(camera.distortion),
        }

    return {
        "width_px": found.camera.width_px,
        "height_px": found.camera.height_px,
        "camera": plain(found.camera),
        "sigma": plain(found.sigma),
        "reprojection_px": found.reprojection_px,
        "coverage": found.coverage,
        "largest_tilt_deg": math.degrees(found.tilt_rad),
        "used": dict(zip(found.used, found.per_view_px, strict=True)),
        "left_out": {view.name: view.reason for view in found.left_out},
        "out": str(out),
    }


def camera_table(found: CameraCalibration, out: Path) -> list[tuple[str, str]]:
    """The same for people."""
    camera, sigma = found.camera, found.sigma
    table = [
        (name, f"{getattr(camera, name):10.3f} +- {getattr(sigma, name):.3f} px")
        for name in ("fx_px", "fy_px", "cx_px", "cy_px")
    ]
    table += [
        (name, f"{value:10.5f} +- {spread:.5f}" if spread > 0.0 else f"{value:10.5f} (held)")
        for name, value, spread in zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion, sigma.distortion, strict=True)
    ]
    table += [
        ("reprojection", f"{found.reprojection_px:.3f} px over {len(found.used)} views"),
        ("coverage", f"{100.0 * found.coverage:.0f} % of the picture"),
    ]
    table += [("left out", f"{view.name}: {view.reason}") for view in found.left_out]
    if found.coverage < _COVERAGE_GOOD:
        table.append(("note", "the board never was in large parts of the picture: distortion there is a guess"))
    return [*table, ("written", str(out))]


def shoulder_toml(result: ShoulderResult, camera: CameraModel, noise_levels: float) -> str:
    """The [camera] section with the place on the shoulder, and [ranger] where it was ranged."""
    found, mount, ranger = result.found, result.mount, result.ranger
    place = ", ".join(f"{1e3 * value:.2f}" for value in found.sigma[:3])
    turn = ", ".join(f"{math.degrees(value):.3f}" for value in found.sigma[3:])
    lines = [
        f"# Camera and its place on the shoulder, calibrated by surfuse {__version__}.",
        f"# Reprojection error {found.reprojection_px:.3f} px. Standard deviations along and about x, y, z:",
        f"# {place} mm; {turn} degrees.",
        "[camera]",
        'mounted = "shoulder"',
        *camera_lines(camera),
        f"noise_levels = {noise_levels}",
        f"forward_m = {mount.forward_m:.6f}",
        f"left_m = {mount.left_m:.6f}",
        f"height_m = {mount.height_m:.6f}",
        *(f"{name}_deg = {math.degrees(getattr(mount, name + '_rad')):.5f}" for name in ("yaw", "pitch", "roll")),
    ]
    if ranger is not None:
        forward, left = ranger.forward_left_m.tolist()
        sigma = ", ".join(f"{1e3 * value:.2f}" for value in ranger.sigma_m)
        lines += [
            "",
            f"# From {ranger.ranges} ranges, rms {1e3 * ranger.rms_m:.2f} mm; standard deviations {sigma} mm.",
            "[ranger]",
            f"forward_m = {forward:.6f}",
            f"left_m = {left:.6f}",
            f"height_m = {result.ranger_height_m:.6f}",
        ]
    return "\n".join([*lines, ""])


def shoulder_summary(result: ShoulderResult, out: Path) -> dict[str, object]:
    """Places, turns, standard deviations and views, as plain data."""
    found, mount, ranger = result.found, result.mount, result.ranger
    return {
        "camera": {
            "forward_m": mount.forward_m,
            "left_m": mount.left_m,
            "height_m": mount.height_m,
            "yaw_deg": math.degrees(mount.yaw_rad),
            "pitch_deg": math.degrees(mount.pitch_rad),
            "roll_deg": math.degrees(mount.roll_rad),
        },
        "sigma_m": found.sigma[:3].tolist(),
        "sigma_deg": np.degrees(found.sigma[3:]).tolist(),
        "reprojection_px": found.reprojection_px,
        "ranger": None
        if ranger is None
        else {
            "forward_m": float(ranger.forward_left_m[0]),
            "left_m": float(ranger.forward_left_m[1]),
            "sigma_m": ranger.sigma_m.tolist(),
            "rms_m": ranger.rms_m,
            "ranges": ranger.ranges,
        },
        "views": result.used,
        "left_out": {view.name: view.reason for view in result.left_out},
        "out": str(out),
    }


def shoulder_table(result: ShoulderResult, out: Path) -> list[tuple[str, str]]:
    """The same for people."""
    found, mount, ranger = result.found, result.mount, result.ranger
    places = zip(("forward", "left", "height"), (mount.forward_m, mount.left_m, mount.height_m), strict=True)
    turns = zip(("roll", "pitch", "yaw"), (mount.roll_rad, mount.pitch_rad, mount.yaw_rad), strict=True)
    table = [
        (f"camera {name}", f"{1e3 * value:9.2f} +- {1e3 * sigma:.2f} mm")
        for (name, value), sigma in zip(places, found.sigma[:3].tolist(), strict=True)
    ]
    table += [
        (f"camera {name}", f"{math.degrees(value):9.3f} +- {math.degrees(sigma):.3f} degrees")
        for (name, value), sigma in zip(turns, found.sigma[3:].tolist(), strict=True)
    ]
    table.append(("reprojection", f"{found.reprojection_px:.3f} px over {result.used} views"))
    if ranger is not None:
        table += [
            (f"ranger {name}", f"{1e3 * value:9.2f} +- {1e3 * sigma:.2f} mm")
            for name, value, sigma in zip(
                ("forward", "left"), ranger.forward_left_m.tolist(), ranger.sigma_m.tolist(), strict=True
            )
        ]
        table.append(("ranges", f"{ranger.ranges} used, rms {1e3 * ranger.rms_m:.2f} mm"))
    table += [("left out", f"{view.name}: {view.reason}") for view in result.left_out]
    return [*table, ("written", str(out))]
