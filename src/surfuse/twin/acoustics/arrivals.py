"""From rays to arrivals: what each hit adds to the energy and the amplitude that come back, by distance.

Kernels. Arrivals are binned over the distance from the beam's origin: `mirror` holds energies (mirror-like parts and
edges, whose phases are not followed), `real` and `imag` the complex amplitude of the diffuse part, whose phases are
fixed to the surface. The unit of amplitude is the pressure 1 m from the piston on its axis, so that a perfect plate at
distance d, facing the beam, adds the energy 1 / (2 d)^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled, inlined
from surfuse.records import FloatArray, IntArray

# Half-width of the mirror lobe in units of the first Fresnel zone: matches knife-edge diffraction at one zone radius.
LOBE = 0.7
_GRAZING = 1e-3
# Energy gain below which a diffuse hit is left out: 60 dB under one on the axis.
_INAUDIBLE = 1e-6
# Share of an edge's energy that does not keep to its normal plane.
_SKEW = 0.03


class Aim(NamedTuple):
    """Where a beam starts and how it is turned: `mouth` (3,), `rotation` (3, 3) world from sensor, both world frame."""

    mouth: FloatArray
    rotation: FloatArray


class Rays(NamedTuple):
    """Rays of one ping (N, 3), unit, and what they hit (N,): triangle (-1: none), distance, cosine of incidence."""

    ray: FloatArray
    hit: IntArray
    distance: FloatArray
    cosine: FloatArray


class Bundle(NamedTuple):
    """How the beam is sampled (see `Beam`): weight and energy gain of each ray (N,), the table `two_way`, the rim.

    `two_way` (T,) is the energy directivity over even steps of the sine of the angle off the axis, from 0 to 1;
    `nearest` (G, G) is the ray nearest to a direction, over its x and y; `edge_sine` is the sine of the bundle's rim.
    """

    weight: FloatArray
    gain: FloatArray
    two_way: FloatArray
    nearest: IntArray
    edge_sine: float


class Triangles(NamedTuple):
    """The scene: planes of the triangles (T, 3), (T,), their material and body (T,), poses of the speckle (B, 3, 4).

    `normal` are unit vectors in the world frame and `offset` (m) their planes' distances from its origin;
    `grid_from_world` has one pose for each of B bodies.
    """

    normal: FloatArray
    offset: FloatArray
    material: IntArray
    body: IntArray
    grid_from_world: FloatArray


class Sound(NamedTuple):
    """What materials (M,) and air do to sound, and which of all rough surfaces of that kind this one is.

    `mirror_of`, `roughness_of`, `diffuse_of` (M,) are the share of energy that is reflected, (2 k roughness)^2, and the
    share that is scattered; `facets_of` (M,) is 1 / slope^2 of the facets that scatter, 0: after Lambert's law.
    `wave_number` k in 1/m, `absorption` in 1/m of amplitude, `cell_m` the side of the patches that scatter with one
    phase, `seed` chooses the phases.
    """

    mirror_of: FloatArray
    roughness_of: FloatArray
    diffuse_of: FloatArray
    facets_of: FloatArray
    wave_number: float
    absorption: float
    cell_m: float
    seed: int


class Bins(NamedTuple):
    """Arrivals over the distance (B,): energies, complex amplitudes, and the used span of bins (2,).

    `mirror` are energies, `real` and `imag` complex amplitudes of what is scattered, in steps of `bin_m`; `extent` is
    the first and the last bin in use.
    """

    mirror: FloatArray
    real: FloatArray
    imag: FloatArray
    extent: IntArray
    bin_m: float


class Edges(NamedTuple):
    """Points on sharp edges: position, tangent (K, 3), normals of both faces (K, 2, 3), length of edge each (K,).

    `strength` is Keller's coefficient, see `BundleParameters.edge_strength`.
    """

    position: FloatArray
    tangent: FloatArray
    faces: FloatArray
    length: FloatArray
    strength: float


class Room(NamedTuple):
    """Room for the rays of one ping: float32 start and direction for Embree, direction, edge point of each edge ray.

    `start`, `ray` and `ray32` are (N + E, 3) for N rays of the bundle and E to edges, `chosen` (E,).
    """

    start: FloatArray
    ray: FloatArray
    ray32: FloatArray
    chosen: IntArray


@compiled
def turn_bundle(aim: Aim, directions: FloatArray, origin: FloatArray, room: Room) -> None:
    """Turn the bundle (N, 3) into the world; `origin` (3,) is where Embree counts from."""
    rotation, mouth = aim.rotation, aim.mouth
    start, ray, ray32 = room.start, room.ray, room.ray32
    for j in range(len(directions)):
        for a in range(3):
            value = (
                rotation[a, 0] * directions[j, 0]
                + rotation[a, 1] * directions[j, 1]
                + rotation[a, 2] * directions[j, 2]
            )
            ray[j, a] = value
            ray32[j, a] = value
            start[j, a] = mouth[a] - origin[a]


@compiled
def aim_at_edges(
    position: FloatArray, aim: Aim, origin: FloatArray, edge_sine: float, farthest_m: float, first: int, room: Room
) -> int:
    """Append a ray to each edge point inside the beam's rim; returns how many rays there are then.

    `position` (K, 3) are edge points in m in the world, `origin` (3,) is where Embree counts from. Points behind the
    sensor, beyond `farthest_m`, or outside of the rim (`edge_sine`) get no ray; rays are appended from number `first`
    on.
    """
    mouth, rotation, count = aim.mouth, aim.rotation, first
    start, ray, ray32, chosen = room.start, room.ray, room.ray32, room.chosen
    edge_cosine = np.sqrt(1.0 - edge_sine * edge_sine)
    for k in range(len(position)):
        x, y, z = position[k, 0] - mouth[0], position[k, 1] - mouth[1], position[k, 2] - mouth[2]
        ahead = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
        if ahead <= 0.0 or ahead > farthest_m:
            continue
        distance = np.sqrt(x * x + y * y + z * z)
        if ahead < edge_cosine * distance or distance < 1e-3:
            continue
        if count == len(ray):
            break
        ray[count, 0], ray[count, 1], ray[count, 2] = x / distance, y / distance, z / distance
        for a in range(3):
            ray32[count, a] = ray[count, a]
            start[count, a] = mouth[a] - origin[a]
        chosen[count - first] = k
        count += 1
    return count


@compiled
def deposit(distance: float, value: float, bin_m: float, bins: FloatArray, extent: IntArray) -> None:
    """Share a value between the two bins next to a distance; `extent` (2,) keeps the used span of bins."""
    place = distance / bin_m
    low = int(place)
    if place < 0.0 or low + 1 >= len(bins):
        return
    part = place - low
    bins[low] += (1.0 - part) * value
    bins[low + 1] += part * value
    extent[0] = min(extent[0], low)
    extent[1] = max(extent[1], low + 1)


@compiled
def beam_energy(sine: float, two_way: FloatArray) -> float:
    """Two-way energy directivity at the sine of an angle from the axis, by interpolation.

    `two_way` (K,) is the table of `Bundle`; 1 on the axis.
    """
    place = min(sine, 1.0) * (len(two_way) - 1)
    low = min(int(place), len(two_way) - 2)
    part = place - low
    return float((1.0 - part) * two_way[low] + part * two_way[low + 1])


@compiled
def hash_phase(i: int, j: int, k: int, body: int, seed: int) -> float:
    """A phase in [0, 2 pi) that belongs to one cell of one body (SplitMix64 finaliser)."""
    h = np.uint64(seed) ^ (np.uint64(body + 1) * np.uint64(0x9E3779B97F4A7C15))
    for value in (i, j, k):
        h = (h ^ np.uint64(value + 0x100000)) * np.uint64(0xBF58476D1CE4E5B9)
        h ^= h >> np.uint64(27)
        h *= np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return float(h >> np.uint64(11)) * (2.0 * np.pi / 9007199254740992.0)


@compiled
def distances(mouth: FloatArray, rays: Rays, normal: FloatArray, offset: FloatArray) -> None:
    """Distance (N,) and cosine of incidence (N,) of every hit from the plane of its triangle; inf and 0 for none."""
    ray, hit, distance, cosine = rays.ray, rays.hit, rays.distance, rays.cosine
    for j in range(len(hit)):
        t = hit[j]
        distance[j] = np.inf
        cosine[j] = 0.0
        if t < 0:
            continue
        slope = normal[t, 0] * ray[j, 0] + normal[t, 1] * ray[j, 1] + normal[t, 2] * ray[j, 2]
        if abs(slope) < _GRAZING:
            continue
        height = offset[t] - (normal[t, 0] * mouth[0] + normal[t, 1] * mouth[1] + normal[t, 2] * mouth[2])
        distance[j] = height / slope
        cosine[j] = abs(slope)


@inlined
def bend_at_foot(
    j: int, height: float, rotation: FloatArray, rays: Rays, normal: FloatArray, bundle: Bundle, foot: FloatArray
) -> float:
    """Where the mirror point of ray j's surface lies: 0 at the foot of its perpendicular, 1 at the ray's own hit.

    A plane's mirror point is the foot; a ball's lies at the share d / (d + radius) of the way back to the ray; beyond
    an edge there is none, and the hit stands for it. The bundle itself tells how the surface goes on: the hit of the
    ray next to the foot is so far behind the tangent plane as its curvature says. `foot` (3,) receives the direction
    of the foot, world frame.

    `rotation` (3, 3) is world from sensor, `normal` (T, 3) those of all triangles, `height` (m) the
    distance of the sensor from its plane.
    """
    ray, hit, distance = rays.ray, rays.hit, rays.distance
    nearest, edge_sine = bundle.nearest, bundle.edge_sine
    t = hit[j]
    sign = -1.0 if normal[t, 0] * ray[j, 0] + normal[t, 1] * ray[j, 1] + normal[t, 2] * ray[j, 2] < 0.0 else 1.0
    for a in range(3):
        foot[a] = sign * normal[t, a]
    x = foot[0] * rotation[0, 0] + foot[1] * rotation[1, 0] + foot[2] * rotation[2, 0]
    y = foot[0] * rotation[0, 1] + foot[1] * rotation[1, 1] + foot[2] * rotation[2, 1]
    if x * x + y * y > edge_sine * edge_sine:
        return 0.0
    scale = 0.5 * (nearest.shape[0] - 1)
    k = nearest[int((x / edge_sine + 1.0) * scale + 0.5), int((y / edge_sine + 1.0) * scale + 0.5)]
    if hit[k] < 0 or not np.isfinite(distance[k]):
        return 1.0
    behind, apart2 = -height, 0.0
    for a in range(3):
        behind += foot[a] * distance[k] * ray[k, a]
        apart2 += (distance[k] * ray[k, a] - distance[j] * ray[j, a]) ** 2
    bend = height * 2.0 * behind / max(apart2, 1e-8)
    # A surface in front of the tangent plane hides the foot, or focuses; then the hit stands for the mirror point too.
    return 1.0 if bend < -0.5 else bend / (1.0 + bend)


@compiled
def add_echoes(
    aim: Aim,
    rays: Rays,
    chosen: IntArray,
    edges: Edges,
    bundle: Bundle,
    triangles: Triangles,
    sound: Sound,
    bins: Bins,
) -> None:
    """All that comes back directly, in one call: handing over the arguments takes as long as some of the work.

    `chosen` (E,) are the edge points of the rays beyond the bundle's. Everything is added to `bins`.
    """
    distances(aim.mouth, rays, triangles.normal, triangles.offset)
    add_mirrors(aim, rays, bundle, triangles, sound, bins)
    add_diffuse(aim.mouth, rays, bundle, triangles, sound, bins)
    add_edges(chosen, edges, aim, rays, bundle, sound, bins)


@compiled
def add_mirrors(aim: Aim, rays: Rays, bundle: Bundle, triangles: Triangles, sound: Sound, bins: Bins) -> None:
    """Mirror-like echoes of the bundle's rays.

    The lobe exp(-tan(i)^2 / s^2) / (4 pi s^2 cos(i)^5) makes a facing plate return 1 / (2 d)^2 and a sphere of radius
    rho the share (rho / (d + rho))^2 of it. Distance and directivity are those of the mirror point (`bend_at_foot`):
    the image source of a plane, the edge where the surface ends.
    """
    ray, hit, distance, cosine = rays.ray, rays.hit, rays.distance, rays.cosine
    rotation, weight, two_way, mirror, extent = aim.rotation, bundle.weight, bundle.two_way, bins.mirror, bins.extent
    material, mirror_of, roughness_of = triangles.material, sound.mirror_of, sound.roughness_of
    wavelength, absorption, bin_m = 2.0 * np.pi / sound.wave_number, sound.absorption, bins.bin_m
    foot = np.zeros(3)
    for j in range(len(weight)):
        r, c = distance[j], cosine[j]
        if hit[j] < 0 or not np.isfinite(r) or r < 1e-3:
            continue
        m = material[hit[j]]
        height = r * c
        s2 = LOBE * LOBE * wavelength / (2.0 * height)
        q2 = (1.0 - c * c) / (c * c)
        if q2 >= 25.0 * s2:
            continue
        share = bend_at_foot(j, height, rotation, rays, triangles.normal, bundle, foot)
        ahead, size2 = 0.0, 0.0
        for a in range(3):
            direction = foot[a] + share * (ray[j, a] - foot[a])
            ahead += direction * rotation[a, 2]
            size2 += direction * direction
        sine = np.sqrt(max(0.0, 1.0 - ahead * ahead / size2)) if ahead > 0.0 else 1.0
        reach = height + share * (r - height)
        energy = mirror_of[m] * np.exp(-roughness_of[m] * c * c - q2 / s2 - 4.0 * absorption * reach)
        energy *= weight[j] * beam_energy(sine, two_way) / (4.0 * np.pi * s2 * c**5 * r * r)
        deposit(reach, energy, bin_m, mirror, extent)


@compiled
def add_diffuse(mouth: FloatArray, rays: Rays, bundle: Bundle, triangles: Triangles, sound: Sound, bins: Bins) -> None:
    """Diffuse echoes of the bundle's rays: Lambert's law, one random phase per surface cell.

    Where the fine roughness is gentle the energy keeps to the slopes of its facets: exp(-tan(i)^2 / slope^2).

    `mouth` (3,) in m is where the beam starts, in the world; the amplitudes are added to `bins`.
    """
    ray, hit, distance, cosine = rays.ray, rays.hit, rays.distance, rays.cosine
    weight, gain, grid, body_of = bundle.weight, bundle.gain, triangles.grid_from_world, triangles.body
    material, diffuse_of, facets_of = triangles.material, sound.diffuse_of, sound.facets_of
    real, imag, extent, bin_m, cell_m = bins.real, bins.imag, bins.extent, bins.bin_m, sound.cell_m
    place = np.zeros(3)
    for j in range(len(weight)):
        t, r, c = hit[j], distance[j], cosine[j]
        if t < 0 or not np.isfinite(r) or r < 1e-3:
            continue
        share = diffuse_of[material[t]]
        if facets_of[material[t]] > 0.0:
            share *= np.exp(-facets_of[material[t]] * (1.0 - c * c) / (c * c))
        if share * gain[j] <= _INAUDIBLE:
            continue
        density = share / np.pi * c * gain[j] / (r * r)
        cell_sr = cell_m * cell_m * c / (r * r)
        amplitude = weight[j] * np.sqrt(density / (cell_sr + weight[j])) * np.exp(-2.0 * sound.absorption * r)
        far2, body = 0.0, body_of[t]
        for a in range(3):
            from_mouth = grid[body, a, 0] * mouth[0] + grid[body, a, 1] * mouth[1] + grid[body, a, 2] * mouth[2]
            from_mouth += grid[body, a, 3]
            step = grid[body, a, 0] * ray[j, 0] + grid[body, a, 1] * ray[j, 1] + grid[body, a, 2] * ray[j, 2]
            place[a] = np.floor((from_mouth + r * step) / cell_m)
            far2 += ((place[a] + 0.5) * cell_m - from_mouth) ** 2
        phase = hash_phase(int(place[0]), int(place[1]), int(place[2]), body, sound.seed)
        phase += 2.0 * sound.wave_number * np.sqrt(far2)
        deposit(r, amplitude * np.cos(phase), bin_m, real, extent)
        deposit(r, amplitude * np.sin(phase), bin_m, imag, extent)


@compiled
def add_edges(chosen: IntArray, edges: Edges, aim: Aim, rays: Rays, bundle: Bundle, sound: Sound, bins: Bins) -> None:
    """Diffraction at visible edge points (Keller), whose rays follow those of the bundle.

    A straight edge across the beam returns c^2 / (2 k d^3). c grows as 1 / sin(angle from a face's normal) towards the
    mirror direction, where the Fresnel lobe bounds it.
    Along the edge the energy keeps to the Fresnel lobe around its normal plane, but for a small share from corners
    and the edge's own roughness.

    `chosen` (E,) are the edge points of the rays beyond the bundle's; the energies are added to `bins`.
    """
    wave_number, absorption = sound.wave_number, sound.absorption
    wavelength = 2.0 * np.pi / wave_number
    position, tangent, faces, ray = edges.position, edges.tangent, edges.faces, rays.ray
    mouth, first = aim.mouth, len(bundle.weight)
    for j in range(first, len(rays.hit)):
        k = chosen[j - first]
        r = 0.0
        for a in range(3):
            r += (position[k, a] - mouth[a]) ** 2
        r = np.sqrt(r)
        if rays.distance[j] < r - 1e-3:
            continue
        s = LOBE * np.sqrt(wavelength / (2.0 * r))
        skew, cosine = 0.0, 0.0
        for a in range(3):
            skew += tangent[k, a] * ray[j, a]
            cosine += aim.rotation[a, 2] * ray[j, a]
        across2 = max(1e-9, 1.0 - skew * skew)
        strength2 = 1.0
        for f in range(2):
            slope = faces[k, f, 0] * ray[j, 0] + faces[k, f, 1] * ray[j, 1] + faces[k, f, 2] * ray[j, 2]
            strength2 += 0.5 / (max(0.0, 1.0 - slope * slope / across2) + s * s)
        strength2 *= edges.strength * edges.strength
        lobe = (1.0 - _SKEW) * np.exp(-((skew / s) ** 2)) + _SKEW
        energy = strength2 / wave_number / (2.0 * np.sqrt(np.pi) * s * r**4) * edges.length[k] * lobe
        sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
        energy *= beam_energy(sine, bundle.two_way) * np.exp(-4.0 * absorption * r)
        deposit(r, energy, bins.bin_m, bins.mirror, bins.extent)
