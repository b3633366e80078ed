"""The old controller against the new laws: the same arm, the same scan, the same torque limits."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from surfuse import durable
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, Puma560
from surfuse.arms import trident
from surfuse.commands.outcome import Outcome, Watcher, finite
from surfuse.commands.servo.servo_plot import study_drawing
from surfuse.errors import ConfigError, StorageError
from surfuse.geometry.poses import pose
from surfuse.motion.planners import Planner, torque_limited, trapezoidal
from surfuse.motion.time_optimal import PassParameters, time_optimal_pass
from surfuse.motion.trajectory import Trajectory
from surfuse.plan.raster import grip_targets, raster
from surfuse.plan.reach import reach
from surfuse.records import FloatArray, Outline
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.rig.simulated.servo_arm import ServoArm, ServoDesign, Unknown, build_servo_arm, known_model
from surfuse.servo_cards.supervision import Supervision
from surfuse.settings import Settings
from surfuse.settings.changes import changed

OLD = "set_points_28ms"
NEW = "computed_torque"
LAWS = (OLD, "independent_pid", "gravity_pd", NEW)
SETTLED_M = 1e-4
_MARGIN_M = 0.02
_PLATE_M = 0.2
_WATCH_S = 4.0
_STAY_S = 0.05
CONDITIONS = {"as modelled": Unknown(), "2 kg more, friction 15 % more": Unknown(2.0, 0.15)}

_USED = (
    "arm.settle_s",
    "arm.base_height_m",
    "arm.grip_offset_m",
    "scene.azimuth_deg",
    "scene.radius_m",
    "cell.",
    "scan.margin_m",
    "scan.step_m",
    "scan.standoff_m",
    "array.side_m",
)


@dataclass(frozen=True)
class Tracking:
    """How well a law follows: errors of the tool in mm, times in s, torque as a share of the limit.

    `settle_s`: median time from the planned end of a move until the tool stays within 0.1 mm of its target; nan where
    most moves did not get there within 4 s. `arrived`: share of the moves that did.
    """

    law: str
    condition: str
    motion: str
    rms_mm: float
    peak_mm: float
    settle_s: float
    arrived: float
    move_s: float
    torque_rms: float
    torque_peak: float


@dataclass(frozen=True)
class ScanTime:
    """Robot time of one way to scan the plate, moves and rests; `rest` says what the arm waits for at a stop."""

    law: str
    motion: str
    rest: str
    stops: int
    moves_s: float
    total_s: float


@dataclass(frozen=True)
class Trace:
    """Tool error (T,) in mm over time (T,) in s, for the plot."""

    law: str
    t_s: FloatArray
    error_mm: FloatArray


def servo_study(settings: Settings, out: Path | None, stops: int, watcher: Watcher) -> Outcome:
    """Follow the start of the default scan with every law, with and without an unknown load, and time the whole scan.

    `stops`: how many stops of the scan the laws are compared on. With `out`, a folder that must not exist yet,
    `servo_study.json` and `servo_study.svg` are written there.

    Raises
    ------
    ConfigError : too few stops, or no stop of the plate can be reached with these settings.
    """
    if out is not None and out.exists():
        raise StorageError("the folder exists already", where=str(out), cure="give the name of a new one")
    for key in changed(settings):
        if not key.startswith(_USED):
            watcher.warn(f"{key} has no effect here: the study has its own laws, arm and scene")
    kinematics = _kinematics(settings)
    joints = scan_joints(settings, kinematics)
    if not 3 <= stops <= len(joints):
        raise ConfigError(f"stops = {stops}, the scan has {len(joints)}", cure=f"give 3 to {len(joints)}")
    watcher.stage("servo study", len(CONDITIONS) * len(LAWS) + 1)
    rows: list[Tracking] = []
    traces: list[Trace] = []
    for condition, unknown in CONDITIONS.items():
        for law in LAWS:
            tracked, trace = _track(kinematics, joints[:stops], law, condition, unknown)
            rows += tracked
            traces += [trace] if not unknown.load_kg else []
            watcher.advance()
    times = scan_times(kinematics, joints, settings.arm.settle_s, stops)
    watcher.advance()
    outcome = _outcome(rows, times)
    if out is not None:
        out.mkdir(parents=True)
        durable.write_text(out / "servo_study.json", json.dumps(finite(outcome.summary), indent=2) + "\n")
        series = [(trace.law, trace.t_s, trace.error_mm) for trace in traces]
        durable.write_text(out / "servo_study.svg", study_drawing(series))
    return outcome


def _kinematics(settings: Settings) -> Puma560:
    return Puma560(
        pose(np.eye(3), [0.0, 0.0, settings.arm.base_height_m]),
        pose(np.eye(3), [0.0, 0.0, settings.arm.grip_offset_m - FLANGE_OFFSET_M]),
    )


def scan_joints(settings: Settings, kinematics: Puma560) -> FloatArray:
    """Joints (N, 6) at the stops of the scan of a plate of 20 x 20 cm with margin, at the configured place.

    Raises
    ------
    ConfigError : no stop can be reached.
    """
    azimuth, radius = np.radians(settings.scene.azimuth_deg), settings.scene.radius_m
    towards = np.array([-np.cos(azimuth), -np.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    foot = np.append(-radius * towards[:2], settings.cell.table_height_m)
    world_from_part = pose(np.column_stack([np.cross(up, towards), up, towards]), foot)
    half, given = 0.5 * _PLATE_M, settings.scan.margin_m
    margin = _MARGIN_M if given is None else given
    right, top = half + margin, _PLATE_M + margin
    outline = Outline(np.array([[-right, 0.0], [right, 0.0], [right, top], [-right, top]]), world_from_part)
    places = raster(outline, settings.step_m).uv_m
    checked = reach(grip_targets(world_from_part, places, settings.scan.standoff_m), kinematics, READY_RAD)
    if checked.reached.sum() < 3:
        raise ConfigError(
            f"{int(checked.reached.sum())} of {len(places)} stops can be reached",
            cure="change scene.radius_m or arm.base_height_m",
        )
    return checked.joints_rad[checked.reached]


def _servo(kinematics: Puma560, law: str, planner: Planner, unknown: Unknown, start: FloatArray) -> ServoArm:
    # A study watches laws that lag or sag; the driver's own limits would stop them.
    lenient = trident.Parameters(supervision=Supervision(following_rad=0.6, stuck_rad=0.2, stuck_counts=1e9))
    clock, rng = SimulatedClock(), np.random.default_rng(0)
    design = ServoDesign(law, planner, unknown, parameters=lenient, calibrated_at_start=False)
    return build_servo_arm(kinematics, clock, rng, design, start)


@dataclass(frozen=True)
class _Watched:
    """One motion as it was: time, true tool error and torque share at every tick, and when the tool had settled."""

    t_s: FloatArray
    error_mm: FloatArray
    torque_share: FloatArray
    settle_s: float


def _watch(parts: ServoArm, kinematics: Puma560, trajectory: Trajectory, wait: bool) -> _Watched:
    """Run a motion and, if asked to, wait for the tool to settle; errors are of the true arm against the plan."""
    commands, period, servo = parts.law.commands(trajectory), parts.law.period_s, parts.arm.servo
    count = len(commands)
    true, torque = np.empty((count, 6)), np.empty((count, 6))
    for i in range(count):
        # A command is for the moment at which its tick reads the encoders.
        true[i] = parts.plant.position_rad
        servo.tick(commands.position_rad[i], commands.velocity_rad_s[i], commands.acceleration_rad_s2[i])
        torque[i] = servo.torque_nm
    t = np.linspace(period, count * period, count)
    planned = trajectory.sample(t)[0]
    error = np.linalg.norm((kinematics.forward(true) - kinematics.forward(planned))[:, :3, 3], axis=1)
    settle = _settle(parts, kinematics, commands.position_rad[-1], t[-1] - trajectory.duration_s) if wait else np.nan
    share = np.abs(torque) / known_model().torque_max_nm
    return _Watched(t, 1e3 * error, share, settle)


def _settle(parts: ServoArm, kinematics: Puma560, target: FloatArray, late_s: float) -> float:
    """Time from the planned end until the tool is within 0.1 mm and stays for 50 ms; nan if that takes too long."""
    period, inside = parts.law.period_s, 0
    wanted = kinematics.forward(target)[:3, 3]
    for i in range(int(_WATCH_S / period)):
        parts.arm.servo.hold(target, 1)
        off = np.linalg.norm(kinematics.forward(parts.plant.position_rad)[:3, 3] - wanted)
        inside = inside + 1 if off <= SETTLED_M else 0
        if inside * period >= _STAY_S:
            return max(0.0, late_s + (i + 1 - inside) * period)
    return float("nan")


def _track(
    kinematics: Puma560, joints: FloatArray, law: str, condition: str, unknown: Unknown
) -> tuple[list[Tracking], Trace]:
    """One law under one condition: stop by stop at the published limits, then one smooth pass at 0.1 m/s."""
    planner = trapezoidal(LIMITS)
    parts = _servo(kinematics, law, planner, unknown, joints[0])
    with parts.arm:
        moves = [_watch(parts, kinematics, planner(joints[i], joints[i + 1]), True) for i in range(len(joints) - 1)]
    smooth, _ = time_optimal_pass(joints, known_model(), LIMITS, kinematics.jacobian, PassParameters(0.75, 0.1))
    parts = _servo(kinematics, law, planner, unknown, joints[0])
    with parts.arm:
        passed = _watch(parts, kinematics, smooth, False)
    rows = [_summed(law, condition, "stop by stop", moves), _summed(law, condition, "smooth pass", [passed])]
    return rows, Trace(law, passed.t_s, passed.error_mm)


def _summed(law: str, condition: str, motion: str, moves: list[_Watched]) -> Tracking:
    error = np.concatenate([move.error_mm for move in moves])
    share = np.concatenate([move.torque_share for move in moves])
    settle = np.array([move.settle_s for move in moves])
    arrived = np.isfinite(settle)
    return Tracking(
        law,
        condition,
        motion,
        rms_mm=float(np.sqrt(np.mean(error**2))),
        peak_mm=float(error.max()),
        settle_s=float(np.median(np.where(arrived, settle, np.inf))) if arrived.mean() > 0.5 else float("nan"),
        arrived=float(arrived.mean()),
        move_s=float(np.mean([move.t_s[-1] for move in moves])),
        torque_rms=float(np.sqrt(np.mean(share**2, axis=0)).max()),
        torque_peak=float(share.max()),
    )


def scan_times(kinematics: Puma560, joints: FloatArray, rest_s: float, watched: int) -> list[ScanTime]:
    """Robot time of the whole scan (N, 6): the old way, the new law at the torque limits, one smooth pass.

    The first two are given twice: with the same fixed rest at every stop, and with the rest that the tool needs to
    come within 0.1 mm (at most 4 s): the mean over the first `watched` stops, run through the servo cards.
    """
    model, times, count = known_model(), [], len(joints) - 1
    for law, planner, motion in (
        (OLD, trapezoidal(LIMITS), "trapezoid, published limits"),
        (NEW, torque_limited(model, LIMITS), "jerk-limited, torque limits"),
    ):
        parts = _servo(kinematics, law, planner, Unknown(), joints[0])
        plans = [planner(joints[i], joints[i + 1]) for i in range(count)]
        with parts.arm:
            moves = [_watch(parts, kinematics, plan, True) for plan in plans[: watched - 1]]
        # What the controller is told takes whole periods of its set points.
        moving = float(sum(len(parts.law.commands(plan)) for plan in plans)) * parts.law.period_s
        settle = float(np.mean([move.settle_s if np.isfinite(move.settle_s) else _WATCH_S for move in moves]))
        times.append(ScanTime(law, motion, f"{rest_s:g} s", count + 1, moving, moving + rest_s * count))
        times.append(ScanTime(law, motion, "within 0.1 mm", count + 1, moving, moving + (settle + _STAY_S) * count))
    smooth, _ = time_optimal_pass(joints, model, LIMITS, kinematics.jacobian, PassParameters(0.75, 0.25))
    times.append(ScanTime(NEW, "smooth pass, 0.25 m/s", "none", count + 1, smooth.duration_s, smooth.duration_s))
    return times


def _outcome(rows: list[Tracking], times: list[ScanTime]) -> Outcome:
    ratios = _ratios(rows, times)
    table = [(f"{row.law}, {row.motion}, {row.condition}", _words(row)) for row in rows]
    table += [
        (f"scan time, {row.law}, {row.motion}, rest {row.rest}", f"{row.total_s:.0f} s for {row.stops} stops")
        for row in times
    ]
    table += [(name, f"{value:.2f}") for name, value in ratios.items()]
    summary: dict[str, object] = {
        "tracking": [asdict(row) for row in rows],
        "scan_time": [asdict(row) for row in times],
        "ratios": ratios,
    }
    return Outcome(summary, table)


def _words(row: Tracking) -> str:
    settle = f"settled after {1e3 * row.settle_s:.0f} ms, " if np.isfinite(row.settle_s) else "not settled in 4 s, "
    if row.motion != "stop by stop":
        settle = ""
    return (
        f"tool error rms {row.rms_mm:.3f} mm, peak {row.peak_mm:.3f} mm, {settle}"
        f"torque rms {100 * row.torque_rms:.0f} %, peak {100 * row.torque_peak:.0f} %"
    )


def _ratios(rows: list[Tracking], times: list[ScanTime]) -> dict[str, float]:
    """The old way over the new one: tool error for every motion and condition, and scan time at equal rest."""
    error = {(row.law, row.motion, row.condition): row.rms_mm for row in rows}
    ratios = {
        f"error old / new, {motion}, {condition}": value / error[NEW, motion, condition]
        for (law, motion, condition), value in error.items()
        if law == OLD
    }
    total = {(row.law, row.rest): row.total_s for row in times}
    rest = times[0].rest
    ratios[f"scan time saved, rest {rest}"] = 1.0 - total[NEW, rest] / total[OLD, rest]
    ratios["scan time saved, rest until within 0.1 mm"] = (
        1.0 - total[NEW, "within 0.1 mm"] / total[OLD, "within 0.1 mm"]
    )
    ratios["smooth pass / new start-stop"] = total[NEW, "none"] / total[NEW, rest]
    return ratios
