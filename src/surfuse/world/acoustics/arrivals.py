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
def foot_share(
    j: int,
    mouth: FloatArray,
    rotation: FloatArray,
    ray: FloatArray,
    hit: IntArray,
    distance: FloatArray,
    normal: FloatArray,
    offset: FloatArray,
    nearest: IntArray,
    edge_sine: float,
    tolerance_m: float,
    foot: FloatArray,
) -> float:
    """How surely the foot of the perpendicular on ray j's surface lies on that surface, 0 to 1.

    The bundle itself answers: the ray next to the foot must have met the same plane. `foot` (1,) receives the sine
    of the foot's angle from the axis.
    """
    t = hit[j]
    sign = -1.0 if normal[t, 0] * ray[j, 0] + normal[t, 1] * ray[j, 1] + normal[t, 2] * ray[j, 2] < 0.0 else 1.0
    x = sign * (normal[t, 0] * rotation[0, 0] + normal[t, 1] * rotation[1, 0] + normal[t, 2] * rotation[2, 0])
    y = sign * (normal[t, 0] * rotation[0, 1] + normal[t, 1] * rotation[1, 1] + normal[t, 2] * rotation[2, 1])
    z = sign * (normal[t, 0] * rotation[0, 2] + normal[t, 1] * rotation[1, 2] + normal[t, 2] * rotation[2, 2])
    foot[0] = np.sqrt(x * x + y * y) if z > 0.0 else 1.0
    if foot[0] > edge_sine:
        return 1.0
    scale = 0.5 * (nearest.shape[0] - 1)
    k = nearest[int((x / edge_sine + 1.0) * scale + 0.5), int((y / edge_sine + 1.0) * scale + 0.5)]
    if hit[k] < 0 or not np.isfinite(distance[k]):
        return 0.0
    gap = -offset[t]
    for a in range(3):
        gap += normal[t, a] * (mouth[a] + distance[k] * ray[k, a])
    return float(np.exp(-((gap / tolerance_m) ** 2)))


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
    of radius rho the share (rho / (d + rho))^2 of it. Where the foot of the perpendicular is on the surface, distance
    and directivity are those of the foot (image source); else those of the ray (diffraction at the edge).
    Diffuse: Lambert's law, one random phase per surface cell.
    """
    wavelength = 2.0 * np.pi / wave_number
    foot = np.zeros(1)
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
            energy = mirror_of[m] * np.exp(-roughness_of[m] * c * c - q2 / s2) * weight[j]
            energy /= 4.0 * np.pi * s2 * c**5 * r * r
            share = foot_share(
                j, mouth, rotation, ray, hit, distance, normal, offset, nearest, edge_sine, 0.25 * wavelength, foot
            )
            if share > 1e-3:
                loss = np.exp(-4.0 * absorption * height)
                deposit(height, energy * share * loss * beam_energy(foot[0], two_way), bin_m, mirror, extent)
            if share < 0.999:
                loss = np.exp(-4.0 * absorption * r)
                deposit(r, energy * (1.0 - share) * loss * gain[j], bin_m, mirror, extent)
        if diffuse_of[m] > 0.0:
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
