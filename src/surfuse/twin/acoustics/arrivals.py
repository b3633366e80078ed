"""From rays to arrivals: what each hit adds to the energy and the amplitude that come back, by distance.

Kernels. Arrivals are binned over the distance from the beam's origin: `mirror` holds energies (mirror-like parts and
edges, whose phases are not followed), `real` and `imag` the complex amplitude of the diffuse part, whose phases are
fixed to the surface. The unit of amplitude is the pressure 1 m from the piston on its axis, so that a perfect plate at
distance d, facing the beam, adds the energy 1 / (2 d)^2.
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray

# Half-width of the mirror lobe in units of the first Fresnel zone: matches knife-edge diffraction at one zone radius.
LOBE = 0.7
_GRAZING = 1e-3
# Energy gain below which a diffuse hit is left out: 60 dB under one on the axis.
_INAUDIBLE = 1e-6
# Share of an edge's energy that does not keep to its normal plane.
_SKEW = 0.03


@compiled
def aim(
    rotation: FloatArray,
    directions: FloatArray,
    mouth: FloatArray,
    origin: FloatArray,
    start: FloatArray,
    ray: FloatArray,
    ray32: FloatArray,
) -> None:
    """Turn the bundle (N, 3) into the world: float64 `ray`, float32 `ray32` and `start` for Embree."""
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
    position: FloatArray,
    axis: FloatArray,
    mouth: FloatArray,
    origin: FloatArray,
    edge_sine: float,
    farthest_m: float,
    first: int,
    start: FloatArray,
    ray: FloatArray,
    ray32: FloatArray,
    chosen: IntArray,
) -> int:
    """Append a ray to each edge point inside the beam's rim; returns how many rays there are then."""
    count = first
    edge_cosine = np.sqrt(1.0 - edge_sine * edge_sine)
    for k in range(len(position)):
        x, y, z = position[k, 0] - mouth[0], position[k, 1] - mouth[1], position[k, 2] - mouth[2]
        ahead = x * axis[0] + y * axis[1] + z * axis[2]
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
    """Two-way energy directivity at the sine of an angle from the axis, by interpolation."""
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
def distances(
    mouth: FloatArray,
    ray: FloatArray,
    hit: IntArray,
    normal: FloatArray,
    offset: FloatArray,
    distance: FloatArray,
    cosine: FloatArray,
) -> None:
    """Distance (N,) and cosine of incidence (N,) of every hit from the plane of its triangle; inf and 0 for none."""
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


@compiled
def bend_at_foot(
    j: int, mouth: FloatArray, rotation: FloatArray, ray: FloatArray, hit: IntArray, distance: FloatArray,
    height: float, normal: FloatArray, offset: FloatArray, nearest: IntArray, edge_sine: float, foot: FloatArray,
) -> float:  # fmt: skip
    """Where the mirror point of ray j's surface lies: 0 at the foot of its perpendicular, 1 at the ray's own hit.

    A plane's mirror point is the foot; a ball's lies at the share d / (d + radius) of the way back to the ray; beyond
    an edge there is none, and the hit stands for it. The bundle itself tells how the surface goes on: the hit of the
    ray next to the foot is so far behind the tangent plane as its curvature says. `foot` (3,) receives the direction
    of the foot, world frame.
    """
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
def add_surfaces(
    mouth: FloatArray,
    rotation: FloatArray,
    ray: FloatArray,
    hit: IntArray,
    distance: FloatArray,
    cosine: FloatArray,
    weight: FloatArray,
    gain: FloatArray,
    two_way: FloatArray,
    nearest: IntArray,
    edge_sine: float,
    normal: FloatArray,
    offset: FloatArray,
    material: IntArray,
    body: IntArray,
    grid_from_world: FloatArray,
    mirror_of: FloatArray,
    roughness_of: FloatArray,
    diffuse_of: FloatArray,
    wave_number: float,
    absorption: float,
    cell_m: float,
    seed: int,
    bin_m: float,
    mirror: FloatArray,
    real: FloatArray,
    imag: FloatArray,
    extent: IntArray,
) -> None:
    """Mirror-like and diffuse echoes of the bundle's rays (N, of which `weight` has the length).

    Mirror: the lobe exp(-tan(i)^2 / s^2) / (4 pi s^2 cos(i)^5) makes a facing plate return 1 / (2 d)^2 and a sphere
    of radius rho the share (rho / (d + rho))^2 of it. Distance and directivity are those of the mirror point
    (`bend_at_foot`): the image source of a plane, the edge where the surface ends.
    Diffuse: Lambert's law, one random phase per surface cell.
    """
    wavelength = 2.0 * np.pi / wave_number
    foot = np.zeros(3)
    place = np.zeros(3)
    for j in range(len(weight)):
        t = hit[j]
        r = distance[j]
        if t < 0 or not np.isfinite(r) or r < 1e-3:
            continue
        c = cosine[j]
        m = material[t]
        height = r * c
        s2 = LOBE * LOBE * wavelength / (2.0 * height)
        q2 = (1.0 - c * c) / (c * c)
        if q2 < 25.0 * s2:
            share = bend_at_foot(
                j, mouth, rotation, ray, hit, distance, height, normal, offset, nearest, edge_sine, foot
            )
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
        if diffuse_of[m] * gain[j] > _INAUDIBLE:
            density = diffuse_of[m] / np.pi * c * gain[j] / (r * r)
            cell_sr = cell_m * cell_m * c / (r * r)
            amplitude = weight[j] * np.sqrt(density / (cell_sr + weight[j])) * np.exp(-2.0 * absorption * r)
            far2 = 0.0
            g = grid_from_world[body[t]]
            for a in range(3):
                from_mouth = g[a, 0] * mouth[0] + g[a, 1] * mouth[1] + g[a, 2] * mouth[2] + g[a, 3]
                step = g[a, 0] * ray[j, 0] + g[a, 1] * ray[j, 1] + g[a, 2] * ray[j, 2]
                place[a] = np.floor((from_mouth + r * step) / cell_m)
                far2 += ((place[a] + 0.5) * cell_m - from_mouth) ** 2
            phase = hash_phase(int(place[0]), int(place[1]), int(place[2]), body[t], seed)
            phase += 2.0 * wave_number * np.sqrt(far2)
            deposit(r, amplitude * np.cos(phase), bin_m, real, extent)
            deposit(r, amplitude * np.sin(phase), bin_m, imag, extent)


@compiled
def add_edges(
    first: int, count: int, chosen: IntArray, position: FloatArray, tangent: FloatArray, faces: FloatArray,
    length: FloatArray, mouth: FloatArray, axis: FloatArray, ray: FloatArray, distance: FloatArray,
    two_way: FloatArray, strength: float, wave_number: float, absorption: float, bin_m: float, mirror: FloatArray,
    extent: IntArray,
) -> None:  # fmt: skip
    """Diffraction at visible edge points (Keller): a straight edge across the beam returns c^2 / (2 k d^3).

    c grows as 1 / sin(angle from a face's normal) towards the mirror direction, where the Fresnel lobe bounds it.
    Along the edge the energy keeps to the Fresnel lobe around its normal plane, but for a small share from corners
    and the edge's own roughness.
    """
    wavelength = 2.0 * np.pi / wave_number
    for j in range(first, count):
        k = chosen[j - first]
        r = 0.0
        for a in range(3):
            r += (position[k, a] - mouth[a]) ** 2
        r = np.sqrt(r)
        if distance[j] < r - 1e-3:
            continue
        s = LOBE * np.sqrt(wavelength / (2.0 * r))
        skew, cosine = 0.0, 0.0
        for a in range(3):
            skew += tangent[k, a] * ray[j, a]
            cosine += axis[a] * ray[j, a]
        across2 = max(1e-9, 1.0 - skew * skew)
        strength2 = 1.0
        for f in range(2):
            slope = faces[k, f, 0] * ray[j, 0] + faces[k, f, 1] * ray[j, 1] + faces[k, f, 2] * ray[j, 2]
            strength2 += 0.5 / (max(0.0, 1.0 - slope * slope / across2) + s * s)
        strength2 *= strength * strength
        lobe = (1.0 - _SKEW) * np.exp(-((skew / s) ** 2)) + _SKEW
        energy = strength2 / wave_number / (2.0 * np.sqrt(np.pi) * s * r**4) * length[k] * lobe
        sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
        energy *= beam_energy(sine, two_way) * np.exp(-4.0 * absorption * r)
        deposit(r, energy, bin_m, mirror, extent)
