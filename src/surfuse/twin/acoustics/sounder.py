"""One transducer with its kit in a scene: from a pose to the readings of repeated pings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from surfuse.physics.air import speed_of_sound
from surfuse.records import FloatArray, IntArray
from surfuse.twin.acoustics import arrivals, reflections
from surfuse.twin.acoustics.air import AirParameters, absorption
from surfuse.twin.acoustics.arrivals import Aim, Bins, Bundle, Edges, Rays, Room, Sound, Triangles
from surfuse.twin.acoustics.beam import BundleParameters, sample_beam
from surfuse.twin.acoustics.detection import Detector, Received, burst_envelope, detect
from surfuse.twin.acoustics.edges import NO_EDGES, EdgePoints, sharp_edges
from surfuse.twin.acoustics.kit import TUBE, KitParameters, TransducerParameters
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.materials import MATERIALS, Material, Surface, table_of
from surfuse.twin.scene import Scene

BIN_M = 0.0005
REFERENCE_M = 0.43
_MOST_EDGE_RAYS = 1024
_INAUDIBLE = 0.01


@dataclass(frozen=True)
class EchoArrivals:
    """What comes back, over the distance from the beam's origin: energies and complex amplitudes by bin (B,).

    `mirror` are energies, `real` and `imag` complex amplitudes in steps of `BIN_M`; `extent` (2,) is the first and the
    last bin in use. The arrays belong to the sounder, which uses them again.
    """

    mirror: FloatArray
    real: FloatArray
    imag: FloatArray
    extent: IntArray


@dataclass(frozen=True)
class _Workspace:
    """Arrays that every ping of one sounder uses again; N rays and E edge rays."""

    start: FloatArray
    ray: FloatArray
    ray32: FloatArray
    distance: FloatArray
    cosine: FloatArray
    chosen: IntArray
    onward: FloatArray
    onward32: FloatArray
    parent: IntArray
    mirror: FloatArray
    real: FloatArray
    imag: FloatArray
    extent: IntArray = field(default_factory=lambda: np.zeros(2, dtype=np.int64))


class Sounder:
    """Echoes of one scene as one transducer with its kit hears them.

    The range counts from the transducer; the beam starts at the tube's mouth. The kit's fixed delay is calibrated
    away with a facing plate 0.43 m from the transducer, in air of the temperature that the kit assumes. Not for use
    by two threads at once.

    Parameters
    ----------
    surfaces : what the materials do to sound.
    seed : which of all surfaces of equal roughness the parts have.
    """

    def __init__(
        self,
        scene: Scene,
        transducer: TransducerParameters = TUBE,
        kit: KitParameters | None = None,
        air: AirParameters | None = None,
        bundle: BundleParameters | None = None,
        surfaces: Mapping[Material, Surface] = MATERIALS,
        seed: int = 0,
    ) -> None:
        self.scene, self.transducer, self.seed = scene, transducer, seed
        self.kit, self.air, self.bundle = kit or KitParameters(), air or AirParameters(), bundle or BundleParameters()
        self.speed_m_s = speed_of_sound(self.air.temperature_c) * self.air.speed_factor
        self.assumed_speed_m_s = speed_of_sound(self.air.assumed_temperature_c)
        self.wave_number = 2.0 * np.pi * self.kit.frequency_hz / self.speed_m_s
        self.absorption = absorption(self.air, self.kit.frequency_hz)
        self.response = transducer.response(self.kit.frequency_hz)
        self.beam = sample_beam(transducer.aperture_m, self.wave_number, self.bundle)
        self._gain = np.interp(
            np.hypot(self.beam.directions[:, 0], self.beam.directions[:, 1]),
            np.linspace(0.0, 1.0, len(self.beam.two_way)),
            self.beam.two_way,
        )
        self.edges = _audible(sharp_edges(scene, self.bundle.edge_spacing_m), self.bundle.edge_strength)
        self._sound = Sound(
            mirror_of=table_of("reflectivity", surfaces),
            roughness_of=(2.0 * self.wave_number * table_of("roughness_m", surfaces)) ** 2,
            diffuse_of=table_of("diffuse", surfaces),
            facets_of=_inverse_square(table_of("facet_slope", surfaces)),
            wave_number=self.wave_number,
            absorption=self.absorption,
            cell_m=self.bundle.speckle_cell_m,
            seed=seed,
        )
        beam, edges = self.beam, self.edges
        self._bundle = Bundle(beam.weight_sr, self._gain, beam.two_way, beam.nearest, beam.edge_sine)
        self._triangles = Triangles(scene.normal, scene.offset_m, scene.material, scene.body, _speckle_grid(scene))
        self._edges = Edges(edges.position_m, edges.tangent, edges.faces, edges.length_m, self.bundle.edge_strength)
        self._shape, self._level, self._ringing, self._opens = self._timing(self.speed_m_s)
        self._shape2 = self._shape**2
        self._work = _workspace(len(self.beam.directions), len(self._level))
        self._delay_s = self._fixed_delay_s()

    @property
    def bins(self) -> int:
        """Steps of `BIN_M` over which arrivals are kept."""
        return len(self._level)

    @property
    def nearest_m(self) -> float:
        """Nearest range that the blanking leaves."""
        return 0.5 * self.assumed_speed_m_s * self.kit.blanking_s - 0.5 * self.assumed_speed_m_s * self._delay_s

    def ping(
        self,
        world_from_sensor: FloatArray,
        pings: int,
        noise: AcousticNoise,
        generator: np.random.Generator,
        t_s: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (pings,) in m after REP-117 and strengths (pings,), 1 for a facing perfect plate, nan for no echo.

        A surface nearer than the blanking allows is `-inf` only when the detector finds the level already reached as
        it opens: that the kit can know. An echo that is over by then is not heard; what comes later is returned.
        """
        return self.heard(self.arrivals(world_from_sensor), pings, noise, generator, t_s)

    def heard(
        self, arrived: EchoArrivals, pings: int, noise: AcousticNoise, generator: np.random.Generator, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """What repeated pings read of what comes back; see `ping`.

        Ranges (pings,) in m and strengths (pings,). `generator` is drawn from in the same order whatever is heard, so
        that one surface more does not change the noise of all that follows; `t_s` is the time of the trigger, by which
        the drift after switching on has faded.
        """
        scale = self.response * (1.0 + noise.amplitude * generator.standard_normal(pings))
        shift = noise.receiver * generator.standard_normal(pings)
        jitter = noise.timing_m * generator.standard_normal(pings)
        tick = generator.random(pings)
        missed = generator.random(pings) < noise.dropout
        slipped = generator.random(pings) < noise.slip
        place, peak = self._crossings(arrived, np.maximum(scale, 0.0), shift)
        heard = np.isfinite(place)
        along = np.where(heard, place, 0.0) * BIN_M
        clock = self.kit.sample_rate_hz
        time = 2.0 * (along + self.transducer.tube_length_m) / self.speed_m_s
        if self.kit.trigger == "internal":
            time = self._crossed(time, noise.neighbours, generator)
        # The burst starts anywhere between two ticks of the counting clock; the crossing is seen at the next one.
        counted = (np.ceil(time * clock + tick) - tick - 0.5) / clock
        ranges = 0.5 * self.assumed_speed_m_s * (counted - self._delay_s) + jitter
        ranges += slipped * 0.5 * self.assumed_speed_m_s / self.kit.frequency_hz
        ranges += noise.drift_m * np.exp(-max(t_s, 0.0) / noise.drift_time_s)
        strength = peak * scale * 2.0 * along * np.exp(2.0 * self.absorption * along)
        ranges = np.where(heard, ranges, place)
        return np.where(missed, np.inf, ranges), np.where(heard & ~missed, strength, np.nan)

    def arrivals(self, world_from_sensor: FloatArray) -> EchoArrivals:
        """All that comes back to a sensor at this pose; the arrays are valid until the next call.

        `world_from_sensor` (4, 4): the sensor looks along its z axis, the range counts from its origin.
        """
        scene, work, beam = self.scene, self._work, self.beam
        low, high = work.extent
        for bins in (work.mirror, work.real, work.imag):
            bins[low : high + 1] = 0.0
        work.extent[:] = (len(work.mirror), -1)
        rotation = np.ascontiguousarray(world_from_sensor[:3, :3])
        aim = Aim(world_from_sensor[:3, 3] + self.transducer.tube_length_m * rotation[:, 2], rotation)
        room = Room(work.start, work.ray, work.ray32, work.chosen)
        arrivals.turn_bundle(aim, beam.directions, scene.origin_m, room)
        count = arrivals.aim_at_edges(
            self.edges.position_m, aim, scene.origin_m, beam.edge_sine, self.bins * BIN_M, len(beam.directions), room
        )
        hit = scene.first_triangle(work.start[:count], work.ray32[:count])
        rays = Rays(work.ray, hit, work.distance, work.cosine)
        heard = Bins(work.mirror, work.real, work.imag, work.extent, BIN_M)
        sound = self._sound._replace(seed=self.seed)
        arrivals.add_echoes(aim, rays, work.chosen, self._edges, self._bundle, self._triangles, sound, heard)
        if self.bundle.bounces == 2:
            self._second_bounce(aim, rays, heard)
        return EchoArrivals(work.mirror, work.real, work.imag, work.extent)

    def envelope(self, world_from_sensor: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """For drawing: range (B,) in m from the transducer, received envelope (B,), detection level (B,)."""
        found = self.arrivals(world_from_sensor)
        full = len(self._level)
        mirror = np.convolve(found.mirror, self._shape2)[:full]
        diffuse = np.convolve(found.real + 1j * found.imag, self._shape)[:full]
        along: FloatArray = self.transducer.tube_length_m + np.arange(full, dtype=np.float64) * BIN_M
        received = self.response * np.sqrt(mirror + np.abs(diffuse) ** 2 + self._ringing**2)
        return along, np.asarray(received, dtype=np.float64), self._level

    def _second_bounce(self, aim: Aim, rays: Rays, bins: Bins) -> None:
        scene, work = self.scene, self._work
        onward = reflections.Onward(work.start, work.onward, work.onward32, work.parent)
        heard = self._bundle, self._triangles, self._sound
        count = reflections.reflect(aim.mouth, scene.origin_m, rays, *heard, onward)
        if count > 0:
            hit = scene.first_triangle(work.start[:count], work.onward32[:count])
            reflections.add_second_bounce(aim, rays, onward, hit, *heard, bins)

    def _crossings(self, found: EchoArrivals, scale: FloatArray, shift: FloatArray) -> tuple[FloatArray, float]:
        """Place (P,) of each ping's detection in bins, and the peak of the envelope after it."""
        place = np.empty(len(scale))
        received = Received(found.mirror, found.real, found.imag, found.extent, self._shape, self._shape2)
        detector = Detector(self._level, self._ringing, self._opens)
        peak = detect(received, detector, scale, shift, place)
        return place, peak

    def _crossed(self, time_s: FloatArray, neighbours: int, generator: np.random.Generator) -> FloatArray:
        """Times of flight (P,) when neighbours fire at any moment: whichever burst comes back first after blanking."""
        strangers = self.kit.period_s * generator.random((len(time_s), neighbours))
        strangers[strangers <= self.kit.blanking_s] = np.inf
        return np.asarray(np.minimum(time_s, strangers.min(axis=1, initial=np.inf)), dtype=np.float64)

    def _timing(self, speed_m_s: float) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Echo shape (W,), detection level (B,), ringing (B,), and the bin at which the detector opens."""
        kit, transducer = self.kit, self.transducer
        step_s = 2.0 * BIN_M / speed_m_s
        burst_s = kit.cycles / kit.frequency_hz
        shape = burst_envelope(burst_s, transducer.rise_time_s, step_s)
        tube_s = 2.0 * transducer.tube_length_m / speed_m_s
        bins = max(2, int((kit.listen_s - tube_s) / step_s))
        time: FloatArray = tube_s + step_s * np.arange(bins, dtype=np.float64)
        since = np.maximum(time - burst_s, 0.0) / transducer.ring_down_time_s
        ringing = transducer.ring_down_level * np.exp(-np.minimum(since, 600.0))
        level = kit.level(time)
        ringing[ringing < _INAUDIBLE * level] = 0.0
        opens = int(np.clip(np.ceil((kit.blanking_s - tube_s) / step_s), 0, bins - 1))
        return shape, level, ringing, opens

    def _fixed_delay_s(self) -> float:
        """Time between the geometric arrival from a perfect facing plate at the reference and its detection."""
        speed = self.assumed_speed_m_s
        shape, level, _, _ = self._timing(speed)
        away = REFERENCE_M - self.transducer.tube_length_m
        first = max(int(away / BIN_M), 0)
        strength = self.response * np.exp(-2.0 * self.absorption * away) / (2.0 * max(away, BIN_M))
        heard = strength * shape >= level[np.minimum(first + np.arange(len(shape)), len(level) - 1)]
        if away <= 0.0 or not np.any(heard):
            return 0.0
        k = int(np.argmax(heard))
        want = level[min(first + k, len(level) - 1)] / strength
        part = (want - shape[k - 1]) / (shape[k] - shape[k - 1]) if k else 0.0
        return float(2.0 * BIN_M * max(k - 1 + part, 0.0) / speed)


def _audible(edges: EdgePoints, strength: float) -> EdgePoints:
    if strength > 0.0:
        return edges
    return NO_EDGES


def _speckle_grid(scene: Scene) -> FloatArray:
    """Poses (B, 3, 4) of the cells of fine roughness, fixed to each body, askew to its faces."""
    quaternion = np.array([0.83, 0.31, 0.37, 0.28]) / np.linalg.norm([0.83, 0.31, 0.37, 0.28])
    w, x, y, z = quaternion
    askew = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.ascontiguousarray(askew @ scene.body_from_world[:, :3, :])


def _workspace(rays: int, bins: int) -> _Workspace:
    most = rays + _MOST_EDGE_RAYS
    return _Workspace(
        start=np.zeros((most, 3), dtype=np.float32),
        ray=np.zeros((most, 3)),
        ray32=np.zeros((most, 3), dtype=np.float32),
        distance=np.zeros(most),
        cosine=np.zeros(most),
        chosen=np.zeros(most, dtype=np.int64),
        onward=np.zeros((rays, 3)),
        onward32=np.zeros((rays, 3), dtype=np.float32),
        parent=np.zeros(rays, dtype=np.int64),
        mirror=np.zeros(bins),
        real=np.zeros(bins),
        imag=np.zeros(bins),
    )


def _inverse_square(slope: FloatArray) -> FloatArray:
    """1 / slope^2, 0 where there is no slope: after Lambert's law."""
    return np.where(slope > 0.0, 1.0 / np.maximum(slope, 1e-6) ** 2, 0.0)
