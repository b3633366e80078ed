"""Builds the simulated cell: the one place besides the pipeline that sees the world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from surfuse.cameras import simulated as simulated_camera
from surfuse.errors import ConfigError
from surfuse.interfaces import Camera, Clock, RangeSensor
from surfuse.node.messages import MAX_SENSORS
from surfuse.records import Fixture, FloatArray
from surfuse.rig import sequential_array as sequential
from surfuse.rig.description import (
    PING_PERIOD_S,
    array_fixture,
    bus_parameters,
    camera_model,
    camera_mount,
    ranger_mount,
    shoulder_spec,
    turn_of,
)
from surfuse.rig.devices import JointMotion, Lookout, Rig, SmoothMotion, Truth
from surfuse.rig.mounts import world_from_shoulder
from surfuse.rig.node_array import ArrayElsewhere, ArrayInProcess, elsewhere, in_process
from surfuse.rig.simulated.arm import ArmInCell, arm_in_cell
from surfuse.rig.simulated.hidden_errors import true_air, true_camera, true_fixture, true_place
from surfuse.sensors import simulated as simulated_sensor
from surfuse.settings import NO_BUS, Settings
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.kit import TUBE, KitParameters
from surfuse.twin.materials import Material, Surface, with_material, with_roughness
from surfuse.twin.optics import OpticsParameters
from surfuse.twin.parts import Part, PartPose, make_part
from surfuse.twin.scene import Scene, TableParameters, table_bodies
from surfuse.twin.simultaneous_array import SimultaneousArray
from surfuse.twin.tether import HostEnd, Place
from surfuse.twin.world import Twin, TwinParameters, transducer_of

ARM_REACH_M = 0.86


class SimulatedClock:
    """Time that passes only when a simulated device says so."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Seconds since the start of the run."""
        return self._now_s

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        self._now_s += duration_s


def simulated_rig(settings: Settings) -> Rig:
    """The cell of the configuration, simulated.

    Raises
    ------
    ConfigError, UsageError, DataError : the scene, the arm or a sensor cannot be built as configured.
    """
    if settings.array.sensor != "polaroid":
        raise ConfigError(
            f"array.sensor = '{settings.array.sensor}'", cure="the simulated cell has the sensor 'polaroid'"
        )
    _refuse_real_camera(settings)
    world, part = build_world(settings)
    clock = SimulatedClock()
    fixture = array_fixture(settings)
    mover = arm_in_cell(settings, fixture, world, clock)
    arm = mover.arm

    def grip() -> FloatArray:
        return true_place(settings, arm.true_tool_pose())

    sensors = array_sensors(settings, fixture, world, grip, clock)
    stop = _Stop()

    def begin(stage: str, index: int) -> None:
        stop.stage, stop.index = stage, index
        world.begin(stage, index)
        arm.begin_stop()

    def place() -> Place:
        return Place(stop.stage, stop.index, clock.now_s(), grip())

    together = fired_together(settings, fixture, world, grip, clock)
    array = _array(settings, fixture, sensors, together, clock, place)
    return Rig(
        clock=clock,
        array=array,
        motion=JointMotion(
            arm, mover.clearance, mover.model.link_poses, mover.guard.surround, SmoothMotion(arm, mover.line_planner)
        ),
        lookout=_lookout(settings, mover, world, clock),
        begin=begin,
        simulated=True,
        truth=Truth(*part.mesh()),
        warnings=part.warnings,
        counters=(lambda: array.counters) if isinstance(array, ArrayInProcess | ArrayElsewhere) else None,
    )


def _refuse_real_camera(settings: Settings) -> None:
    """Refuse what only a real rig has, before it is left aside without a word."""
    if settings.camera.is_real:
        what = f"camera.driver = '{settings.camera.driver}'"
    elif settings.search.plane is not None:
        what = "search.plane"
    else:
        return
    raise ConfigError(f"{what} in the simulated cell", cure="leave it out, or name the driver of a real arm, too")


def _lookout(settings: Settings, mover: ArmInCell, world: Twin, clock: Clock) -> Lookout:
    """Camera and ranger on the shoulder, wherever joint 1 truly is."""
    camera_place = camera_mount(settings).shoulder_from_device
    ranger_place = ranger_mount(settings).shoulder_from_device

    def on_shoulder(place: FloatArray) -> FloatArray:
        placed: FloatArray = world_from_shoulder(float(mover.arm.true_joints_rad[0])) @ place
        return true_place(settings, placed)

    # Beyond half a turn each way the camera would see the same again.
    lower, upper = float(mover.model.kinematics.lower_rad[0]), float(mover.model.kinematics.upper_rad[0])
    return Lookout(
        arm=mover.arm,
        camera=_camera(settings, world, clock, partial(on_shoulder, true_camera(settings, camera_place))),
        turn_rad=turn_of(settings, lower, upper),
        ranger=_ranger(settings, world, clock, partial(on_shoulder, ranger_place)),
        ready_rad=mover.model.ready_rad,
        shoulder_from_camera=camera_place,
        shoulder_from_ranger=ranger_place,
    )


def _camera(settings: Settings, world: Twin, clock: Clock, pose: Callable[[], FloatArray]) -> Camera:
    """The camera on the shoulder."""
    model = camera_model(settings)
    around = simulated_camera.Surroundings(model=model, clock=clock, world=world, pose=pose)
    return simulated_camera.create(simulated_camera.Parameters(surroundings=around))


def _ranger(settings: Settings, world: Twin, clock: Clock, pose: Callable[[], FloatArray]) -> RangeSensor:
    """The ranger on the shoulder."""
    spec = shoulder_spec(settings)
    around = simulated_sensor.Surroundings(clock=clock, spec=spec, world=world, pose=pose)
    return simulated_sensor.create(simulated_sensor.Parameters(settings.array.pings, surroundings=around))


def build_world(settings: Settings, kind: type[Twin] = Twin) -> tuple[Twin, Part]:
    """The twin with the ring table and the part, and the part by itself."""
    table = TableParameters(
        settings.cell.table_height_m, settings.cell.table_inner_radius_m, settings.cell.table_outer_radius_m
    )
    part = make_part(settings.scene.name, _part_pose(settings), table)
    return kind(Scene([*table_bodies(table), part.body]), _physics(settings), settings.seed), part


def array_sensors(
    settings: Settings, fixture: Fixture, world: Twin, world_from_grip: Callable[[], FloatArray], clock: Clock
) -> tuple[RangeSensor, ...]:
    """The simulated sensors of the array, wherever the grip truly is when they fire."""
    between_s = PING_PERIOD_S if settings.scan.mode == "smooth" else 0.0
    seated = true_fixture(settings, fixture)
    rate_hz = settings.kit.sample_rate_hz

    def placed(index: int) -> FloatArray:
        found: FloatArray = world_from_grip() @ seated.grip_from_sensor[index]
        return found

    return tuple(
        simulated_sensor.create(
            simulated_sensor.Parameters(
                settings.pings,
                between_s,
                rate_hz,
                simulated_sensor.Surroundings(clock=clock, spec=spec, world=world, pose=partial(placed, index)),
            )
        )
        for index, spec in enumerate(fixture.specs)
    )


def fired_together(
    settings: Settings, fixture: Fixture, world: Twin, world_from_grip: Callable[[], FloatArray], clock: Clock
) -> SimultaneousArray:
    """The simulated sensors of the array as they send at the same moment."""
    seated = true_fixture(settings, fixture)
    return SimultaneousArray(
        fixture, world, world_from_grip, clock, settings.pings, settings.kit.sample_rate_hz, seated
    )


@dataclass
class _Stop:
    """Which random streams the twin draws from."""

    stage: str = "start"
    index: int = 0


def _array(
    settings: Settings,
    fixture: Fixture,
    sensors: tuple[RangeSensor, ...],
    together: SimultaneousArray,
    clock: Clock,
    place: Callable[[], Place],
) -> sequential.SequentialArray | SimultaneousArray | ArrayInProcess | ArrayElsewhere:
    """The sensors behind the configured bus."""
    bus, at_once = settings.bus, settings.array.trigger == "simultaneous"
    if bus.interface == NO_BUS or len(sensors) > MAX_SENSORS:
        return together if at_once else sequential.create(fixture, sensors)
    if bus.interface == "virtual":
        return in_process(fixture, sensors, bus.node, bus.bitrate_bps, clock, together.fire_together, at_once)
    tether = HostEnd(bus.tether_port, settings.model_dump(), place) if bus.tether_port else None
    return elsewhere(fixture, bus_parameters(bus), bus.node, bus.connect_timeout_s, tether, clock, at_once)


def _part_pose(settings: Settings) -> PartPose:
    scene = settings.scene
    return PartPose(
        np.radians(scene.azimuth_deg),
        scene.radius_m,
        np.radians(scene.yaw_deg),
        np.radians(scene.tilt_deg),
        scene.scale,
        scene.up,
    )


def _surfaces(settings: Settings) -> dict[Material, Surface]:
    """What the part and the cell do to sound; a roughness counts before a material, as in files that have no other."""
    scene = settings.scene
    return with_material(scene.material) if scene.roughness is None else with_roughness(scene.roughness)


def _physics(settings: Settings) -> TwinParameters:
    """The kit, the air, the light and the joints as configured."""
    kit, air = settings.kit, settings.air
    temperature_c, speed_factor = true_air(settings)
    specs = (*array_fixture(settings).specs, shoulder_spec(settings))
    return TwinParameters(
        transducers={spec.name: replace(transducer_of(spec), resonance_hz=TUBE.resonance_hz) for spec in specs},
        kit=KitParameters(
            kit.frequency_hz,
            kit.cycles,
            kit.blanking_s,
            kit.gain,
            sample_rate_hz=kit.sample_rate_hz,
            trigger=kit.trigger,
        ),
        air=AirParameters(
            temperature_c,
            air.humidity_percent,
            assumed_temperature_c=air.assumed_temperature_c,
            speed_factor=speed_factor,
        ),
        optics=OpticsParameters(noise_levels=settings.camera.noise_levels),
        surfaces=_surfaces(settings),
        # Six joints, each at about half the reach on average, share the error at the tool.
        repeatability_rad=1e-3 * settings.arm.repeatability_mm / (0.5 * ARM_REACH_M * np.sqrt(6.0)),
    )
