"""`surfuse acquire`: the main job."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surfuse.cli import _options as options

if TYPE_CHECKING:
    from surfuse.commands.outcome import Outcome, Watcher
    from surfuse.commands.show.observer import ScanObserver

HELP = """Find the part, outline it, plan, scan, fuse, report.

\b
Examples:
    surfuse acquire    (the paper's relief)
    surfuse acquire tilted --seed 3 --out runs/t3
    surfuse acquire part.stl --set scene.scale=0.001 --set scene.yaw_deg=20
    surfuse acquire flat --method median --json
    surfuse acquire flat --arm-driver kinematic    (no servo cards, no dynamics: faster)
    surfuse acquire flat --smooth    (readings on the fly: a fifth of the robot time)
    surfuse acquire flat --arm my_arm.urdf --tool flange
    surfuse acquire relief --node udp    (against `surfuse node` in another terminal)
    surfuse acquire --cell rig.toml --dry-run    (a real rig: what would be scanned)
    surfuse acquire --cell rig.toml --out runs/part    (asks before the arm moves)
    surfuse acquire relief --view    (open the printed address in a browser)
"""

BUS_NAMES = {"udp": "udp_multicast"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("acquire", help=HELP)(acquire)


def acquire(
    scene: Annotated[str | None, typer.Argument(help="flat, tilted, relief, or a mesh file on the table.")] = None,
    out: options.Out = None,
    cell: options.Cell = None,
    method: options.Method = None,
    assignments: options.Set = None,
    seed: options.Seed = None,
    node: Annotated[
        str | None,
        typer.Option("--node", metavar="BUS", help="Bus of a node in another process: udp, or one of python-can's."),
    ] = None,
    arm: options.ArmFile = None,
    tool: options.Tool = None,
    arm_driver: options.ArmDriver = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="One smooth pass: the array fires while the arm moves.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the stops and what cannot be reached; nothing moves.")
    ] = False,
    yes: options.Yes = False,
    view: options.View = False,
    view_port: options.ViewPort = 0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Run the main job."""
    from surfuse import settings
    from surfuse.cli._watching import watched_command

    texts = options.overrides(assignments, method, seed)
    if scene is not None:
        options.check_scene(scene)
        texts.append(f"scene.name={options.toml_string(scene)}")
    if node is not None:
        texts.append(f"bus.interface={options.toml_string(BUS_NAMES.get(node, node))}")
    texts += options.arm_overrides(arm, tool, arm_driver)
    if smooth:
        texts.append('scan.mode="smooth"')
    configuration = settings.load(cell, texts)

    def job(watcher: Watcher, observer: ScanObserver) -> Outcome:
        # The import takes seconds: it comes while the watcher shows that something goes on.
        from surfuse.commands.acquire import acquisition
        from surfuse.commands.acquire import dry_run as dry

        if dry_run:
            return dry.dry_run(configuration, out, watcher)
        return acquisition.acquire(configuration, out, watcher, observer, yes)

    return watched_command(job, as_json, quiet, view_port if view else None, not configuration.arm.is_real)
