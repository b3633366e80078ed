"""What the configuration says of the rig before any device is made: sensors and their places, camera, bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.geometry.sensor_array import grip_from_sensors, tool_from_grip
from surfuse.node.bus_time import sweep_bus_s
from surfuse.node.link import BusParameters
from surfuse.physics.air import speed_of_sound
from surfuse.records import CameraModel, Fixture, FloatArray, SensorSpec
from surfuse.rig.described_sensors import ASSUMED_FIRING_S, ASSUMED_INCIDENCE_RAD, described_spec, places
from surfuse.rig.mounts import Mount
from surfuse.sensors import polaroid
from surfuse.settings import NO_BUS, BusSettings, Settings

PING_PERIOD_S = polaroid.SPEC.firing_time_s / polaroid.Parameters().pings
NODE_GROUP = "239.74.163.2"
_ROUNDING_RAD = 1e-9


def square_fixture(settings: Settings) -> Fixture:
    """Four sensors on a square around the grip axis (paper, figure 1), beams parallel to it."""
    half = settings.array.side_m / 2.0
    corners = [(half, -half), (-half, -half), (half, half), (-half, half)]
    specs = tuple(array_spec(settings, f"us{index}") for index in range(4))
    return Fixture(np.array([pose(np.eye(3), [x, y, 0.0]) for x, y in corners]), specs)


def array_fixture(settings: Settings) -> Fixture:
    """The array: the sensors that the configuration lists, else the paper's square of four."""
    if not settings.sensor:
        return square_fixture(settings)
    specs = tuple(described_spec(sensor, _assumed_spec(settings, sensor.name)) for sensor in settings.sensor)
    return Fixture(grip_from_sensors(*places(settings.sensor)), specs)


def tool_from_array(settings: Settings) -> FloatArray:
    """The grip (4, 4), amid the sensors of the array, in the frame of the tool."""
    return tool_from_grip(*places(settings.sensor)) if settings.sensor else np.eye(4)


def array_spec(settings: Settings, name: str) -> SensorSpec:
    """A sensor of the array: the transducer in its tube, or bare when the tube has no length."""
    kit = settings.kit
    usual = polaroid.SPEC if kit.tube_length_m > 0.0 else polaroid.BARE_SPEC
    firing_s = settings.pings * PING_PERIOD_S
    return replace(
        usual,
        name=name,
        frequency_hz=kit.frequency_hz,
        range_min_m=nearest_range_m(settings, kit.tube_length_m),
        dead_length_m=kit.tube_length_m,
        firing_time_s=firing_s,
    )


def _assumed_spec(settings: Settings, name: str) -> SensorSpec:
    """What is taken for a sensor that the configuration lists, where its table does not say it."""
    return replace(
        array_spec(settings, name), incidence_limit_rad=ASSUMED_INCIDENCE_RAD, firing_time_s=ASSUMED_FIRING_S
    )


def shoulder_spec(settings: Settings) -> SensorSpec:
    """The bare ranger on the shoulder."""
    nearest_m = nearest_range_m(settings, polaroid.BARE_SPEC.dead_length_m)
    return replace(
        polaroid.BARE_SPEC, name="us_shoulder", frequency_hz=settings.kit.frequency_hz, range_min_m=nearest_m
    )


def nearest_range_m(settings: Settings, dead_length_m: float) -> float:
    """The nearest range that the kit's blanking leaves; inside of the tube there is nothing to be heard."""
    blanked_m = 0.5 * speed_of_sound(settings.air.assumed_temperature_c) * settings.kit.blanking_s
    return max(blanked_m, dead_length_m)


def camera_model(settings: Settings) -> CameraModel:
    """The camera of the configuration; its principal point is in the middle of the picture unless given."""
    camera = settings.camera
    return CameraModel(
        camera.width_px,
        camera.height_px,
        camera.fx_px,
        camera.fy_px,
        (camera.width_px - 1) / 2.0 if camera.cx_px is None else camera.cx_px,
        (camera.height_px - 1) / 2.0 if camera.cy_px is None else camera.cy_px,
        camera.distortion,
    )


def camera_mount(settings: Settings) -> Mount:
    """Where the camera of the configuration sits on the shoulder."""
    own = settings.camera
    turn = np.radians([own.yaw_deg, own.pitch_deg, own.roll_deg]).tolist()
    return Mount(own.forward_m, own.height_m, own.left_m, *turn)


def ranger_mount(settings: Settings) -> Mount:
    """Where the ranger of the configuration sits on the shoulder, looking straight outwards."""
    return Mount(settings.ranger.forward_m, settings.ranger.height_m, settings.ranger.left_m)


def turn_of(settings: Settings, lower_rad: float = -math.pi, upper_rad: float = math.pi) -> tuple[float, float]:
    """From and to where joint 1 turns in a search, within its limits (rad) and half a turn each way.

    Beyond that the camera would see the same again.

    Raises
    ------
    ConfigError : the turn that is wanted lies beyond the limits.
    """
    first, last = settings.search.from_deg, settings.search.to_deg
    begin, end = max(lower_rad, -math.pi), min(upper_rad, math.pi)
    wanted = (begin if first is None else math.radians(first), end if last is None else math.radians(last))
    given = first is not None or last is not None
    if given and not begin - _ROUNDING_RAD <= wanted[0] <= wanted[1] <= end + _ROUNDING_RAD:
        raise ConfigError(
            f"the search turns joint 1 from {math.degrees(wanted[0]):.4g} to {math.degrees(wanted[1]):.4g} degrees, "
            f"its limits are {math.degrees(begin):.4g} and {math.degrees(end):.4g}",
            cure="give search.from_deg and search.to_deg within them",
        )
    return wanted


def bus_parameters(bus: BusSettings) -> BusParameters:
    """The adapter between two processes, as configured."""
    options = (("port", bus.port),) if bus.interface == "udp_multicast" else ()
    usual = NODE_GROUP if bus.interface == "udp_multicast" else "can0"
    return BusParameters(bus.interface, bus.channel or usual, bus.bitrate_bps, options)


@dataclass(frozen=True)
class SweepTime:
    """How long a sweep takes: until its sensors have fired, and what its frames then take on the bus."""

    firing_s: float
    bus_s: float

    @property
    def total_s(self) -> float:
        """Until the next sweep can begin."""
        return self.firing_s + self.bus_s


def sweep_time(settings: Settings, specs: Sequence[SensorSpec]) -> SweepTime:
    """How long a sweep of these sensors takes as configured."""
    times_s = [spec.firing_time_s for spec in specs]
    firing_s = max(times_s) if settings.array.trigger == "simultaneous" else sum(times_s)
    bus = settings.bus
    return SweepTime(firing_s, 0.0 if bus.interface == NO_BUS else sweep_bus_s(len(specs), bus.bitrate_bps))
