"""The validated configuration: what a person may write into a cell file or pass with `--set key.path=value`.

Lengths in metres, angles in degrees: this is the one place, besides reports, where people type them. Every value has
a default (the reference cell of the paper), a unit in its name and limits. Later sources win: defaults, cell file,
`--set`, options of the command.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal, Self, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from surfuse import registry
from surfuse.errors import ConfigError, nearest
from surfuse.geometry.sensor_array import step_m as array_step_m
from surfuse.runs.configuration import RUN_TABLE, read_configuration
from surfuse.runs.toml_file import parse_toml
from surfuse.settings.hidden_errors import HiddenErrors
from surfuse.settings.looking_tables import CameraSettings, RangerSettings, SearchSettings
from surfuse.settings.rig_tables import AreaSettings, SensorSettings, Value, own_keys

_SHOWN = 80  # characters of a wrong value that a message repeats
_PARAMETER_PLACE = 4  # fusion.parameters.METHOD.KEY
NO_BUS = "none"
SIMULATED_DRIVERS = ("trident", "kinematic", "simulated")
BUS_PINGS_LIMIT = 31  # the count of a reading has five bits on the bus

Length = Annotated[float, Field(gt=0.0, le=10.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Plain = str | int | float | bool


class Section(BaseModel):
    """A table of the configuration: unknown keys, other types and values that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, strict=True)


class SceneSettings(Section):
    """What stands on the table of the simulated cell, and where."""

    name: str = Field("relief", description="flat, tilted, relief, or the path of a mesh file (STL, PLY, OBJ)")
    azimuth_deg: float = Field(35.0, ge=-180.0, le=180.0, description="direction of the part, seen from the arm")
    radius_m: float = Field(1.12, gt=0.2, le=3.0, description="distance of the part's front from the first axis")
    yaw_deg: float = Field(0.0, ge=-180.0, le=180.0, description="turn about the vertical, added to the scene's own")
    tilt_deg: float = Field(0.0, ge=-90.0, le=90.0, description="lean away from the arm")
    scale: float = Field(1.0, gt=0.0, description="factor on a mesh file's numbers (0.001 for millimetres)")
    up: Literal["x", "y", "z"] = Field("z", description="axis of a mesh file that points up")
    material: Literal["painted", "matte", "metal", "foam"] = Field(
        "painted",
        description="of the part: painted is heard well at 20 degrees and lost by 25 to 30, matte is heard at any "
        "tilt, metal is a mirror for sound, foam swallows it",
    )
    roughness: Fraction | None = Field(
        None, description="instead of a material: 0 a mirror, 0.35 matte, 1 fully diffuse"
    )


class TableSettings(Section):
    """The ring table."""

    table_height_m: Length = Field(1.00, description="height of its surface above the floor")
    table_inner_radius_m: Length = Field(0.95, description="radius of the hole that the arm stands in")
    table_outer_radius_m: Length = Field(1.25, description="radius of its outer edge; nothing is measured beyond it")


class ArmSettings(Section):
    """The arm and how it may move."""

    name: str = Field("puma560", description="the built-in arm; `file` gives another one")
    file: str | None = Field(None, description="MJCF or URDF file of another arm")
    tool: str | None = Field(None, description="site, body or link of that file that carries the array; z along beams")
    driver: str | None = Field(
        None,
        description="trident: servo cards and dynamics (default of the PUMA 560); kinematic or simulated: no dynamics, "
        "for speed; of a real rig: bridge, ur_rtde, ...",
    )
    law: str = Field(
        "computed_torque",
        description="control law behind the servo cards: computed_torque, gravity_pd, independent_pid, set_points_28ms",
    )
    fixture_kg: float = Field(0.45, ge=0.0, le=100.0, description="mass of sensors, tubes and bracket at the wrist")
    base_height_m: float = Field(0.50, ge=0.0, le=3.0, description="height of the stand under the arm's base")
    grip_offset_m: float = Field(
        0.08, gt=0.0, le=0.5, description="wrist centre, or tool frame of an arm file, to the faces of the transducers"
    )
    ready_deg: tuple[float, ...] | None = Field(
        None, strict=False, max_length=12, description="joints of the search of an arm file; default: found by itself"
    )
    joint_speed_deg_s: float = Field(60.0, gt=0.0, le=1000.0, description="of every joint of an arm file")
    joint_acceleration_deg_s2: float = Field(120.0, gt=0.0, le=10000.0, description="of every joint of an arm file")
    speed_share: float = Field(1.0, gt=0.0, le=1.0, description="share of the joint speeds and accelerations")
    settle_deg: float | None = Field(
        None,
        gt=0.0,
        le=5.0,
        description="behind the servo cards: a joint nearer to its target has arrived; default: what the law can do",
    )
    settle_s: float = Field(0.15, ge=0.0, le=10.0, description="rest after each move, before the array fires")
    repeatability_mm: float = Field(0.1, ge=0.0, le=10.0, description="repeatability at the tool")
    clearance_m: float = Field(0.005, ge=0.0, le=0.5, description="least distance of arm and tubes to table and part")
    tool_speed_max_m_s: float = Field(
        1.0, gt=0.0, le=5.0, description="of the array; faster moves are slowed, faster passes refused"
    )

    world_from_base: list[float] | None = Field(
        None, description="where a real arm of a file stands: pose of its base, 4 x 4 row by row; default: the world"
    )
    parameters: dict[str, Value] = Field({}, description="further keys: the fields of a real driver's Parameters")

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, values: object) -> object:
        driver = values.get("driver") if isinstance(values, dict) else None
        return own_keys(cls, values) if isinstance(driver, str) and driver not in SIMULATED_DRIVERS else values

    @field_validator("driver")
    @classmethod
    def _is_a_driver(cls, driver: str | None) -> str | None:
        known = {*SIMULATED_DRIVERS, *registry.names("arms")}
        if driver is not None and driver not in known:
            raise ConfigError(f"arm.driver = '{driver}'", cure=nearest(driver, known))
        return driver

    @field_validator("law")
    @classmethod
    def _is_known(cls, law: str) -> str:
        if law not in registry.names("control_laws"):
            raise ConfigError(f"arm.law = '{law}'", cure=nearest(law, registry.names("control_laws")))
        return law

    @property
    def driven_by(self) -> Literal["trident", "kinematic"]:
        """The driver: the servo cards unless set, or unless the arm is that of a file."""
        if self.driver is None:
            return "trident" if self.file is None else "kinematic"
        return "trident" if self.driver == "trident" else "kinematic"

    @property
    def is_real(self) -> bool:
        """Whether the driver is that of a real rig."""
        return self.driver is not None and self.driver not in SIMULATED_DRIVERS


class ArraySettings(Section):
    """The four rangers at the wrist."""

    sensor: str = Field("polaroid", description="the kind of all four: a plug-in of the folder sensors")
    side_m: float = Field(0.05, ge=0.01, le=0.5, description="side of the square, ds")
    pings: int = Field(5, ge=1, le=100, description="emissions averaged for one reading; at most 31 over a bus")
    trigger: Literal["sequential", "simultaneous"] = Field(
        "sequential", description="simultaneous: all send at the same moment and hear each other"
    )


class BusSettings(Section):
    """The CAN bus between the host and the sensor node."""

    interface: str = Field(
        "virtual", description="virtual (node in this process), none (no bus), udp_multicast, slcan, socketcan, ..."
    )
    channel: str = Field("", description="name, port or group of the adapter; empty: the usual one")
    port: int = Field(43113, ge=1024, le=65535, description="UDP port of udp_multicast")
    bitrate_bps: int = Field(
        1_000_000,
        ge=10_000,
        le=1_000_000,
        description="bit rate of the bus; simulated time goes on by that of its bits",
    )
    node: int = Field(1, ge=1, le=7, description="address of the node")
    connect_timeout_s: float = Field(20.0, gt=0.0, le=3600.0, description="wait for a node in another process")
    tether_port: int = Field(
        43114, ge=0, le=65535, description="TCP port on which a simulated node is told where the arm is; 0: none"
    )


class KitSettings(Section):
    """The ranging kit's parameters."""

    frequency_hz: float = Field(63e3, ge=20e3, le=200e3, description="of the burst that is sent")
    cycles: int = Field(16, ge=1, le=64, description="periods of the burst: more give a stronger, longer echo")
    blanking_s: float = Field(
        1.9e-3, ge=0.0, le=0.02, description="after the start of the burst nothing is heard: the nearest range"
    )
    gain: float = Field(1.0, gt=0.0, le=1000.0, description="factor on the gain of the receiver")
    tube_length_m: float = Field(0.20, ge=0.0, le=0.5, description="of the tube that narrows the beam; 0: no tube")
    sample_rate_hz: float = Field(1e6, ge=1e4, le=1e9, description="rate of the clock that counts the time of flight")
    trigger: Literal["external", "internal"] = Field(
        "external", description="internal: every kit on its own clock, so that neighbours disturb each other"
    )


class AirSettings(Section):
    """The air: what it is, and what the kit believes."""

    temperature_c: float = Field(20.0, ge=-30.0, le=60.0, description="what it is")
    assumed_temperature_c: float = Field(
        20.0, ge=-30.0, le=60.0, description="what the kit takes it for when it turns times into ranges"
    )
    humidity_percent: float = Field(50.0, ge=1.0, le=100.0, description="relative humidity, which dampens echoes")


class ScanSettings(Section):
    """The plan and the walk through it."""

    standoff_m: Length = Field(0.43, description="from the faces of the transducers to the acquisition plane")
    margin_m: float | None = Field(
        None, ge=0.0, le=0.5, description="default: what the outline's uncertainty asks for, or two steps"
    )
    step_m: float | None = Field(None, gt=0.0, le=0.5, description="default: a fifth of the array's side")
    mode: Literal["stops", "smooth"] = Field(
        "stops", description="stops: the arm rests at every stop; smooth: the array fires while the arm moves"
    )
    pings: int = Field(1, ge=1, le=31, description="emissions averaged for one reading on a smooth pass")
    speed_m_s: float | None = Field(
        None, gt=0.0, le=1.0, description="speed of the array in a smooth pass; default: one sweep a step"
    )


class FusionSettings(Section):
    """The fusion method, and parameters of any method by its name."""

    method: str = Field("beam", description="one of `surfuse methods`")
    parameters: dict[str, dict[str, Plain]] = Field(
        default_factory=dict, description="a table a method, `fusion.parameters.<method>.<key>`; see below"
    )


Sensors = Annotated[tuple[SensorSettings, ...], Field(strict=False, max_length=64)]


class Settings(Section):
    """The whole configuration."""

    seed: int = Field(1, ge=0, le=2**63 - 1, description="of everything that is random")
    scene: SceneSettings = SceneSettings()
    cell: TableSettings = TableSettings()
    arm: ArmSettings = ArmSettings()
    camera: CameraSettings = CameraSettings()
    ranger: RangerSettings = RangerSettings()
    search: SearchSettings = SearchSettings()
    array: ArraySettings = ArraySettings()
    bus: BusSettings = BusSettings()
    kit: KitSettings = KitSettings()
    air: AirSettings = AirSettings()
    scan: ScanSettings = ScanSettings()
    fusion: FusionSettings = FusionSettings()
    sensor: Sensors = Field((), description="sensors of a real rig, one table each")
    hidden: HiddenErrors | None = Field(None, description="errors of the simulated rig that nobody knows; see below")
    area: AreaSettings | None = Field(None, description="where a real rig scans; default: a camera looks for it")

    @property
    def pings(self) -> int:
        """Emissions averaged for one reading of the array."""
        return self.array.pings if self.scan.mode == "stops" else self.scan.pings

    @model_validator(mode="after")
    def _hides_only_what_is_simulated(self) -> Self:
        if self.hidden is not None and self.arm.is_real:
            raise ConfigError(
                f"[hidden] with arm.driver = '{self.arm.driver}'",
                cure="leave it out: errors can be planted in the simulated cell only",
            )
        return self

    @field_validator("sensor")
    @classmethod
    def _names_differ(cls, sensors: tuple[SensorSettings, ...]) -> tuple[SensorSettings, ...]:
        names = [sensor.name for sensor in sensors]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"two sensors are called '{name}'", cure="give every [[sensor]] a name of its own")
        return sensors

    @model_validator(mode="after")
    def _can_be_told_where_it_is(self) -> Self:
        if self.scan.mode == "smooth" and self.bus.interface not in (NO_BUS, "virtual"):
            raise ConfigError(
                f"scan.mode = 'smooth' with bus.interface = '{self.bus.interface}': a simulated node in another "
                "process is told where the arm is once a sweep",
                cure="set bus.interface = 'virtual', or scan.mode = 'stops'",
            )
        return self

    @model_validator(mode="after")
    def _fits_the_bus(self) -> Self:
        # On a smooth pass `scan.pings` is what the bus carries, and its own limit is lower.
        if self.bus.interface != NO_BUS and self.scan.mode == "stops" and self.array.pings > BUS_PINGS_LIMIT:
            raise ConfigError(
                f"array.pings = {self.array.pings}, a reading on the bus counts at most {BUS_PINGS_LIMIT}",
                cure="give fewer, or bus.interface = 'none'",
            )
        return self

    @property
    def step_m(self) -> float:
        """Distance between stops: `s = ds / 5` unless set (paper, section 3.2)."""
        if self.scan.step_m is not None:
            return self.scan.step_m
        if self.sensor:
            return array_step_m(np.array([s.position_m for s in self.sensor]), np.array([s.axis for s in self.sensor]))
        return self.array.side_m / 5.0


def load(
    cell_file: Path | None = None,
    overrides: Iterable[str] = (),
    values: Mapping[str, object] | None = None,
    **sections: Mapping[str, object],
) -> Settings:
    """Defaults, then the cell file, then `key.path=value` overrides, then values by key path, then whole sections.

    The run.toml of a run is a cell file too: it repeats the run, with its seed.

    Raises
    ------
    ConfigError : unreadable file, unknown key (with the nearest valid one), wrong type, value out of its limits.
    """
    tree = _read_toml(cell_file) if cell_file is not None else {}
    where = str(cell_file) if cell_file is not None else "configuration"
    for text in overrides:
        _assign(tree, text)
    for path, value in (values or {}).items():
        _put(tree, path, value)
    for name, content in sections.items():
        section = tree.setdefault(name, {})
        if isinstance(section, dict):
            section.update(content)
    return from_tree(tree, where)


def from_tree(tree: Mapping[str, object], where: str = "configuration") -> Settings:
    """Validate a nested mapping of plain values."""
    try:
        return Settings.model_validate(dict(tree))
    except ValidationError as error:
        raise ConfigError(_explain(error), where=where) from error


def _read_toml(path: Path) -> dict[str, object]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"cannot read it ({error.strerror})", cure="give the path of a TOML file", where=str(path)
        ) from error
    tree = parse_toml(data, str(path))
    if RUN_TABLE not in tree:
        return tree
    tables, seed = read_configuration(path)
    return {**tables, "seed": seed}


def _assign(tree: dict[str, object], text: str) -> None:
    """Put one `key.path=value` into the tree; the value is read as TOML, else as a string."""
    path, separator, value_text = text.partition("=")
    if not separator or not all(key.strip() for key in path.split(".")):
        raise ConfigError(
            f"'{text}' is not of the form key.path=value", cure="write for example --set scan.margin_m=0.03"
        )
    try:
        value: object = tomllib.loads(f"value = {value_text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = value_text.strip()
    except RecursionError as error:
        raise ConfigError(f"the value of '{path}' is nested too deeply", cure="give a plain value") from error
    _put(tree, path, value)


def _put(tree: dict[str, object], path: str, value: object) -> None:
    """Put a value into the tree at a path of keys, a table key by key; the tables on the way are made."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _put(tree, f"{path}.{key}", inner)
        return
    node, keys = tree, [key.strip() for key in path.split(".")]
    for key in keys[:-1]:
        child = node.setdefault(key, {})
        if not isinstance(child, dict):
            raise ConfigError(f"'{path}' goes through '{key}', which is a value", cure="use a table's name there")
        node = child
    node[keys[-1]] = value


def _explain(error: ValidationError) -> str:
    """The first problem in one line: key, value, limit or nearest key."""
    problem = error.errors(include_url=False)[0]
    path = ".".join(str(part) for part in problem["loc"])
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if problem["type"] == "extra_forbidden":
        valid = _keys(tuple(str(part) for part in problem["loc"][:-1]))
        return f"unknown key '{path}'{more}; {nearest(str(problem['loc'][-1]), valid)}"
    shown = repr(problem["input"])
    shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}..."
    return _wrong_value(problem["type"], tuple(problem["loc"]), shown, problem["msg"], more)


def _wrong_value(kind: str, place: tuple[int | str, ...], shown: str, message: str, more: str) -> str:
    """A value that cannot be taken, and what can; pydantic's words where they say it."""
    if kind in ("dict_type", "model_type"):
        path = ".".join(map(str, place))
        return f"{path} = {shown}: it is a table, not a value; write {path}.KEY=VALUE{more}"
    if place[:2] == ("fusion", "parameters") and len(place) > _PARAMETER_PLACE:
        # One problem for every type that a parameter may have; the last word of the place is that type.
        path = ".".join(map(str, place[:_PARAMETER_PLACE]))
        return f"{path} = {shown}: give a finite number, a text, true or false"
    if kind in ("missing", "too_long", "too_short") and place:
        path = ".".join(str(part) for part in place if isinstance(part, str))
        return f"{path} = {shown}: it has another number of values than are needed"
    return f"{'.'.join(map(str, place))} = {shown}: {message[0].lower()}{message[1:]}{more}"


def _keys(path: tuple[str, ...]) -> tuple[str, ...]:
    """Valid keys of the section at a path."""
    model: type[BaseModel] = Settings
    for part in path:
        annotation = model.model_fields[part].annotation
        candidates = [annotation, *get_args(annotation)]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), Section)
    return tuple(model.model_fields)
