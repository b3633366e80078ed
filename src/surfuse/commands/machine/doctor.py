"""What is installed, connected, reachable and calibrated, without moving anything."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from surfuse import __version__, registry, settings
from surfuse.acquisition.station import take_sweep
from surfuse.commands.acquire.locating import locate
from surfuse.commands.acquire.planning import plan_for, scene_of
from surfuse.commands.acquire.settings_check import doubts, refuse_contradictions
from surfuse.commands.acquire.warm_up import compile_fusion
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.machine.checks import HEARS_NOTHING, Check
from surfuse.commands.machine.first_contact import first_contact
from surfuse.commands.outcome import Outcome, SilentWatcher
from surfuse.errors import SurfuseError
from surfuse.extras import EXTRAS, Extra
from surfuse.geometry.kernel_folder import kernel_folder
from surfuse.records import Outline, ScanPlan, Status
from surfuse.rig.area import outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import Rig
from surfuse.surface.gridding import lattice

_CORE = ("numpy", "scipy", "numba", "embreex", "trimesh", "opencv-python-headless", "mcap", "h5netcdf", "viser")


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
    missing = ", ".join(extra.name for extra in EXTRAS if extra.missing)
    well = f"all is well; extras that are not installed: {missing}" if missing else "all is well"
    result = f"{len(problems)} problems: {', '.join(problems)}" if problems else well
    rows.append(("result", result + _silence([name for name, text, _ in checks if text.startswith(HEARS_NOTHING)])))
    data: dict[str, object] = {name: {"text": text, "good": good} for name, text, good in checks}
    return Outcome({"checks": data, "problems": problems}, rows)


def _silence(sensors: list[str]) -> str:
    """What the result adds of sensors that hear nothing; that is right only where nothing is before them."""
    if not sensors:
        return ""
    count = f"{len(sensors)} sensor{'s' if len(sensors) > 1 else ''} heard nothing ({', '.join(sensors)})"
    return f"; but {count}: hold something before them within their range and look again"


def _packages() -> list[Check]:
    found: list[Check] = []
    for name in _CORE:
        try:
            found.append((name, version(name), True))
        except PackageNotFoundError:
            found.append((name, f"not installed; pip install {name}", False))
    return found + [_extra(extra) for extra in EXTRAS]


def _extra(extra: Extra) -> Check:
    """An extra is no problem when it is missing: not everybody needs it."""
    listing = ", ".join(extra.missing or extra.modules)
    told = f"missing ({listing}); for {extra.purpose}: {extra.command}" if extra.missing else f"present ({listing})"
    return f"extra {extra.name}", told, True


def _plug_ins() -> list[Check]:
    """All plug-ins by kind; what one still needs, or why it is left out, in a line of its own."""
    checks: list[Check] = []
    for kind in registry.KINDS:
        listing = registry.listing(kind)
        checks.append((kind.replace("_", " "), ", ".join(listing.names), True))
        checks += [(f"{registry.NOUNS[kind]} {one.name}", one.needs, True) for one in listing.plug_ins if one.needs]
        checks += [(f"{kind} note {n}", line, True) for n, line in enumerate(listing.left_out, start=1)]
    return checks


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
        built = assembled(chosen)
        refuse_contradictions(chosen, built.specs)
    except SurfuseError as error:
        return [("configuration", str(error), False)]
    checks: list[Check] = [("configuration", f"scene '{chosen.scene.name}', method '{chosen.fusion.method}'", True)]
    if chosen.arm.is_real:
        return [("configuration", f"real rig, driver '{chosen.arm.driver}'", True), *first_contact(built, chosen)]
    with built.opened():
        try:
            return checks + _reach(built, chosen)
        except SurfuseError as error:
            return [*checks, ("cell", str(error), False)]


def _reach(built: Rig, chosen: settings.Settings) -> list[Check]:
    if chosen.area is not None:
        outline = outline_of(chosen.area)
        plan = plan_for(built, chosen, outline, SilentWatcher())
        return _fusion(built, chosen, outline, plan)
    part = locate(built, chosen, SilentWatcher())
    plan = plan_for(built, chosen, part.outline, SilentWatcher())
    size = 1e3 * (part.outline.vertices_m.max(axis=0) - part.outline.vertices_m.min(axis=0))
    return [
        ("camera", f"sees a part of {size[0]:.0f} x {size[1]:.0f} mm after {part.pictures} pictures", True),
        ("reach", f"{len(plan)} of {len(plan) + len(plan.skipped)} stops can be visited", True),
        *(("doubt", text, True) for text in doubts(chosen, built.specs, plan)),
        *_fusion(built, chosen, part.outline, plan),
    ]


def _fusion(built: Rig, chosen: settings.Settings, outline: Outline, plan: ScanPlan) -> list[Check]:
    """One sweep of the array, through the whole fusion; all that a scan and its report need is compiled, once."""
    compile_fusion(chosen.fusion.method)
    standing = built.stop_arm.go_to(plan, len(plan) // 2)
    sweep = take_sweep(0, 0, standing, built.array)
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
