"""What is installed, connected, reachable and calibrated, without moving anything."""

from __future__ import annotations

import importlib.util
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from surfuse import __version__, registry, settings
from surfuse.acquire.station import take_sweep
from surfuse.commands.acquire.locating import locate
from surfuse.commands.acquire.plan_and_walk import plan_for, scene_of
from surfuse.commands.acquire.warm_up import compile_fusion
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Outcome, SilentWatcher
from surfuse.errors import SurfuseError
from surfuse.geometry.kernel_folder import kernel_folder
from surfuse.records import Outline, ScanPlan, Status
from surfuse.rig.devices import Rig
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.surface.gridding import lattice

_CORE = ("numpy", "scipy", "numba", "embreex", "trimesh", "opencv-python-headless", "mcap", "h5netcdf", "viser")
_EXTRAS = {
    "sdfio": "surface",
    "x3pio": "surface",
    "serial": "serial",
    "gpiozero": "gpio",
    "mujoco": "dynamics",
    "eaik": "closed-form",
}

Check = tuple[str, str, bool]


def doctor(rig: Path | None, assignments: list[str]) -> Outcome:
    """Check the installation, the configuration and, in the twin, whether the whole part can be scanned."""
    checks = [
        ("surfuse", f"{__version__}, Python {platform.python_version()}", True),
        *_packages(),
        *_plug_ins(),
        _kernels(),
    ]
    checks += _cell(rig, assignments)
    rows = [(name, text if good else f"PROBLEM: {text}") for name, text, good in checks]
    problems = [name for name, _, good in checks if not good]
    rows.append(("result", f"{len(problems)} problems: {', '.join(problems)}" if problems else "all is well"))
    data: dict[str, object] = {name: {"text": text, "good": good} for name, text, good in checks}
    return Outcome({"checks": data, "problems": problems}, rows)


def _packages() -> list[Check]:
    found: list[Check] = []
    for name in _CORE:
        try:
            found.append((name, version(name), True))
        except PackageNotFoundError:
            found.append((name, f"not installed; pip install {name}", False))
    for module, extra in _EXTRAS.items():
        there = importlib.util.find_spec(module) is not None
        found.append(
            (module, "installed" if there else f"not installed; pip install 'surfuse[{extra}]' if needed", True)
        )
    return found


def _plug_ins() -> list[Check]:
    return [(kind, ", ".join(registry.names(kind)), True) for kind in registry.KINDS]


def _kernels() -> Check:
    """Where compiled kernels are kept; not a problem where they cannot be, only slower."""
    folder = kernel_folder()
    if folder is not None and folder.lasting:
        return ("kernels", f"kept in {folder.path}", True)
    refused = () if folder is None else folder.refused
    tried = f" ({', '.join(map(str, refused))}: not writable, or writable by others)" if refused else ""
    return ("kernels", f"compiled anew by every command{tried}; set NUMBA_CACHE_DIR to a folder of your own", True)


def _cell(rig: Path | None, assignments: list[str]) -> list[Check]:
    """Configuration, part and reach; each step needs the one before."""
    try:
        chosen = settings.load(rig, assignments)
        built = simulated_rig(chosen)
    except SurfuseError as error:
        return [("configuration", str(error), False)]
    checks: list[Check] = [("configuration", f"scene '{chosen.scene.name}', method '{chosen.fusion.method}'", True)]
    with built.opened():
        try:
            return checks + _reach(built, chosen)
        except SurfuseError as error:
            return [*checks, ("cell", str(error), False)]


def _reach(built: Rig, chosen: settings.Settings) -> list[Check]:
    part = locate(built, chosen, SilentWatcher())
    plan = plan_for(built, chosen, part.outline, SilentWatcher())
    size = 1e3 * (part.outline.vertices_m.max(axis=0) - part.outline.vertices_m.min(axis=0))
    return [
        ("camera", f"sees a part of {size[0]:.0f} x {size[1]:.0f} mm after {part.pictures} pictures", True),
        ("reach", f"{len(plan)} of {len(plan) + len(plan.skipped)} stops can be visited", True),
        *_fusion(built, chosen, part.outline, plan),
    ]


def _fusion(built: Rig, chosen: settings.Settings, outline: Outline, plan: ScanPlan) -> list[Check]:
    """One sweep of the array, through the whole fusion; all that a scan and its report need is compiled, once."""
    compile_fusion(chosen.fusion.method)
    built.arm.move_to(plan.joints_rad[len(plan) // 2])
    sweep = take_sweep(0, 0, built.arm.joint_state(), built.arm.kinematics, built.array)
    method = create_method(chosen.fusion)
    scene = scene_of(built, chosen, outline, plan)
    state = method.start(scene)
    method.step(state, sweep)
    grid = lattice(plan.uv_m, scene.world_from_part)
    fused = method.finish(state, grid).points
    echoes = int((sweep.status == int(Status.OK)).sum())
    value = f"{fused.depth_m[0]:.3f} m" if np.isfinite(fused.depth_m[0]) else "no value (all readings were refused)"
    return [
        ("array", f"{echoes} of {len(sweep.sensor)} sensors hear the part", echoes > 0),
        ("fusion", f"method '{method.name}' is compiled; the middle of the part is at {value}", True),
    ]
