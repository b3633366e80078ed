"""The digital twin: the scene as simulated devices may feel it."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import Generator
from surfuse.physics.air import speed_of_sound
from surfuse.records import ULTRASONIC, ByteArray, CameraModel, FloatArray, SensorSpec
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.beam import BundleParameters
from surfuse.twin.acoustics.crosstalk import ping_together
from surfuse.twin.acoustics.kit import BARE, TUBE, KitParameters, TransducerParameters
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.acoustics.sounder import Sounder
from surfuse.twin.materials import MATERIALS, Material, Surface
from surfuse.twin.optics import OpticsParameters, render
from surfuse.twin.scene import Scene

_ECHOES, _LIGHT, _ARM = 0, 1, 2


@dataclass(frozen=True)
class TwinParameters:
    """Physics of the twin.

    Parameters
    ----------
    transducers : acoustic parameters by name of the sensor, which then sends at the kit's frequency; others get
        theirs, and their frequency, from their spec (see `transducer_of`).
    kit, air, noise, bundle : the ranging kit, the air, what makes pings differ, how finely the beam is sampled.
    optics : light and camera.
    surfaces : what the materials do to sound.
    repeatability_rad : standard deviation of the error that each joint makes at a stop.
    """

    transducers: Mapping[str, TransducerParameters] = field(default_factory=dict)
    kit: KitParameters = field(default_factory=KitParameters)
    air: AirParameters = field(default_factory=AirParameters)
    noise: AcousticNoise = field(default_factory=AcousticNoise)
    bundle: BundleParameters = field(default_factory=BundleParameters)
    optics: OpticsParameters = field(default_factory=OpticsParameters)
    surfaces: Mapping[Material, Surface] = field(default_factory=lambda: dict(MATERIALS))
    repeatability_rad: float = 5e-5

    def __post_init__(self) -> None:
        if not 0.0 <= self.repeatability_rad <= 0.1:
            raise ConfigError(f"repeatability_rad = {self.repeatability_rad}", cure="give 0 to 0.1 rad")


class Twin:
    """A `World`: echoes, pictures and arm errors of one scene.

    Every random number depends on the seed, the stage and index given to `begin`, and the device that asks, never on
    what ran before; so a resumed run repeats an uninterrupted one. The roughness of the surfaces depends on the seed.
    One caller at a time is let in.
    """

    def __init__(self, scene: Scene, parameters: TwinParameters | None = None, seed: int = 0) -> None:
        if seed < 0:
            raise ConfigError(f"seed = {seed}", cure="give 0 or more")
        self._scene, self._parameters, self._seed = scene, parameters or TwinParameters(), seed
        self._sounders: dict[tuple[TransducerParameters, KitParameters], Sounder] = {}
        self._of_spec: dict[SensorSpec, Sounder] = {}
        self._kits: dict[str, KitParameters] = {}
        self._streams: dict[tuple[int, int], Generator] = {}
        self._stop = (0, 0)
        self._gate = threading.Lock()
        self.begin("start", 0)

    @property
    def scene(self) -> Scene:
        """The truth."""
        return self._scene

    @property
    def parameters(self) -> TwinParameters:
        """The physics."""
        return self._parameters

    def begin(self, stage: str, index: int) -> None:
        """Choose the random streams of a stop: they depend on seed, stage and index alone."""
        with self._gate:
            self._stop = (zlib.crc32(stage.encode()), index)
            self._streams = {}

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (pings,) and amplitudes (pings,) of repeated emissions from one pose.

        Ultrasonic sensors hear echoes; any other kind measures along its axis with the spec's sigma.
        """
        with self._gate:
            stream = self._stream(_ECHOES, zlib.crc32(spec.name.encode()))
            if spec.kind != ULTRASONIC:
                return _along_axis(self._scene, world_from_sensor, spec, pings, stream)
            return self._sounder(spec).ping(world_from_sensor, pings, self._parameters.noise, stream, t_s)

    def ping_together(
        self, world_from_sensor: FloatArray, specs: Sequence[SensorSpec], pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (S, pings) and amplitudes (S, pings) of sensors at poses (S, 4, 4) that send at the same moment.

        Sensors with the same acoustics hear each other; others are deaf to their frequency.
        """
        with self._gate:
            streams = [self._stream(_ECHOES, zlib.crc32(spec.name.encode())) for spec in specs]
            ranges, amplitudes = np.empty((len(specs), pings)), np.empty((len(specs), pings))
            groups: dict[Sounder | None, list[int]] = {}
            for place, spec in enumerate(specs):
                groups.setdefault(self._sounder(spec) if spec.kind == ULTRASONIC else None, []).append(place)
            for sounder, group in groups.items():
                if sounder is not None:
                    ranges[group], amplitudes[group] = ping_together(
                        sounder,
                        world_from_sensor[group],
                        pings,
                        self._parameters.noise,
                        [streams[i] for i in group],
                        t_s,
                    )
                    continue
                for i in group:
                    found = _along_axis(self._scene, world_from_sensor[i], specs[i], pings, streams[i])
                    ranges[i], amplitudes[i] = found
            return ranges, amplitudes

    @property
    def assumed_speed_m_s(self) -> float:
        """Speed of sound from which the kits take their ranges."""
        return speed_of_sound(self._parameters.air.assumed_temperature_c)

    def kit(self, spec: SensorSpec) -> KitParameters:
        """The kit that drives a sensor."""
        with self._gate:
            return self._sounder(spec).kit

    def set_kit(self, name: str, kit: KitParameters) -> None:
        """Drive the sensor of this name by another kit."""
        with self._gate:
            self._kits[name] = kit
            self._of_spec.clear()

    def sounder(self, spec: SensorSpec) -> Sounder:
        """The acoustics of one sensor, for drawing and for data sheets."""
        with self._gate:
            return self._sounder(spec)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        """One grey picture (H, W)."""
        with self._gate:
            stream = self._stream(_LIGHT, 0)
            return render(self._scene, camera, world_from_camera, stream, self._parameters.optics)

    def repeatability(self, joints: int) -> FloatArray:
        """Error (J,) rad that the arm makes at this stop."""
        with self._gate:
            draw = self._stream(_ARM, 0).standard_normal(joints)
            return np.asarray(self._parameters.repeatability_rad * draw, dtype=np.float64)

    def _stream(self, purpose: int, device: int) -> Generator:
        key = (purpose, device)
        if key not in self._streams:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(*self._stop, purpose, device))
            self._streams[key] = np.random.Generator(np.random.PCG64(sequence))
        return self._streams[key]

    def _sounder(self, spec: SensorSpec) -> Sounder:
        if spec not in self._of_spec:
            self._of_spec[spec] = self._shared_sounder(spec)
        return self._of_spec[spec]

    def _shared_sounder(self, spec: SensorSpec) -> Sounder:
        """Sensors of one kind share their acoustics."""
        own = self._parameters
        named = own.transducers.get(spec.name)
        transducer = named or transducer_of(spec)
        frequency_hz = own.kit.frequency_hz if named else spec.frequency_hz or own.kit.frequency_hz
        kit = self._kits.get(spec.name) or replace(own.kit, frequency_hz=frequency_hz)
        key = (transducer, kit)
        if key not in self._sounders:
            self._sounders[key] = Sounder(self._scene, transducer, kit, own.air, own.bundle, own.surfaces, self._seed)
        return self._sounders[key]


def transducer_of(spec: SensorSpec) -> TransducerParameters:
    """Acoustics that fit a spec: with a tube when it has a dead length, else bare.

    The aperture of a spec is the effective one: that of the ideal piston with the sensor's beam. A spec does not tell
    a resonance: its sensor is made for its frequency.
    """
    usual = replace(TUBE, tube_length_m=spec.dead_length_m) if spec.dead_length_m > 0.0 else BARE
    made_for_it = replace(usual, resonance_hz=0.0)
    return made_for_it if spec.aperture_m is None else replace(made_for_it, aperture_m=spec.aperture_m)


def _along_axis(
    scene: Scene, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, stream: Generator
) -> tuple[FloatArray, FloatArray]:
    """An optical ranger: the first surface on the axis, with Gaussian noise; its amplitude is not modelled."""
    distance, _ = scene.cast(world_from_sensor[:3, 3], world_from_sensor[:3, 2])
    ranges = distance[0] + spec.sigma_m * stream.standard_normal(pings)
    return np.asarray(ranges, dtype=np.float64), np.full(pings, np.nan)
