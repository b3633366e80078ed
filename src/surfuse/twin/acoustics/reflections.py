"""Echoes over two surfaces: ghosts in corners and between part and table. Kernels, conventions as in `arrivals`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled, inlined
from surfuse.records import FloatArray, IntArray
from surfuse.twin.acoustics.arrivals import Aim, Bins, Bundle, Rays, Sound, Triangles, beam_energy, deposit

# Half-width of the lobe around the sensor in units of the first Fresnel zone; narrower than that of direct echoes,
# because the directivity is taken at the ray.
PATH_LOBE = 0.5
_GRAZING = 1e-3
# Rays within 15 degrees of the normal return to the sensor itself.
_BOUNCE_COSINE = 0.966
_BOUNCE_GAIN = 1e-4


class Onward(NamedTuple):
    """Room for reflected rays: float32 start and direction for Embree, direction, the ray that each comes from.

    `start`, `ray` and `ray32` are (N, 3), `parent` (N,); starts in m from where Embree counts.
    """

    start: FloatArray
    ray: FloatArray
    ray32: FloatArray
    parent: IntArray


@compiled
def reflect(
    mouth: FloatArray,
    origin: FloatArray,
    rays: Rays,
    bundle: Bundle,
    triangles: Triangles,
    sound: Sound,
    onward: Onward,
) -> int:
    """Rays that go on after a mirror-like reflection and might come back over a second surface; returns their number.

    Rays nearly along the normal return to the sensor itself and are left out, as are those outside the main beam.

    `mouth` (3,) in m is where the beam starts, in the world; `origin` (3,) is where Embree counts from.
    """
    ray, hit, distance, cosine = rays.ray, rays.hit, rays.distance, rays.cosine
    normal, start = triangles.normal, onward.start
    count = 0
    for j in range(len(bundle.gain)):
        t = hit[j]
        if t < 0 or cosine[j] <= 0.0 or cosine[j] > _BOUNCE_COSINE or bundle.gain[j] < _BOUNCE_GAIN:
            continue
        material = triangles.material[t]
        if sound.mirror_of[material] * np.exp(-sound.roughness_of[material] * cosine[j] ** 2) < 0.01:
            continue
        slope = normal[t, 0] * ray[j, 0] + normal[t, 1] * ray[j, 1] + normal[t, 2] * ray[j, 2]
        for a in range(3):
            onward.ray[count, a] = ray[j, a] - 2.0 * slope * normal[t, a]
            onward.ray32[count, a] = onward.ray[count, a]
            # A hair off the surface, so that the ray does not meet the triangle that it leaves.
            start[count, a] = mouth[a] + distance[j] * ray[j, a] + 1e-5 * onward.ray[count, a] - origin[a]
        onward.parent[count] = j
        count += 1
    return count


@compiled
def add_second_bounce(
    aim: Aim, rays: Rays, onward: Onward, hit2: IntArray, bundle: Bundle, triangles: Triangles, sound: Sound, bins: Bins
) -> None:
    """Echoes over two mirror-like surfaces: each ray brings its energy to where it passes the sensor.

    `hit2` (K,) are the triangles that the first K reflected rays hit. A path of length P with image sources returns
    1 / P^2; a ray that passes the sensor at distance h counts with the lobe exp(-(h / b)^2) / (pi b^2), b of the size
    of the Fresnel zone.
    """
    wavelength = 2.0 * np.pi / sound.wave_number
    back = np.zeros(3)
    for i in range(len(hit2)):
        u, j = hit2[i], onward.parent[i]
        if u < 0:
            continue
        path, miss2, along = _way_back(i, u, aim.mouth, rays, onward, triangles, back)
        b2 = PATH_LOBE * PATH_LOBE * wavelength * path
        if path < 0.0 or miss2 > 20.0 * b2:
            continue
        facing = -(back[0] * aim.rotation[0, 2] + back[1] * aim.rotation[1, 2] + back[2] * aim.rotation[2, 2])
        if facing <= 0.0:
            continue
        energy = bundle.weight[j] * np.exp(-miss2 / b2) / (np.pi * b2) * np.exp(-2.0 * sound.absorption * path)
        sine = np.sqrt(max(0.0, 1.0 - facing * facing))
        energy *= np.sqrt(bundle.gain[j] * beam_energy(sine, bundle.two_way))
        first, second = triangles.material[rays.hit[j]], triangles.material[u]
        energy *= sound.mirror_of[first] * np.exp(-sound.roughness_of[first] * rays.cosine[j] ** 2)
        energy *= sound.mirror_of[second] * np.exp(-sound.roughness_of[second] * along * along)
        deposit(0.5 * path, energy, bins.bin_m, bins.mirror, bins.extent)


@inlined
def _way_back(
    i: int,
    u: int,
    mouth: FloatArray,
    rays: Rays,
    onward: Onward,
    triangles: Triangles,
    back: FloatArray,
) -> tuple[float, float, float]:
    """Length of a path over two surfaces (m; -1: it does not come back), squared miss (m^2), cosine at the second one.

    The path is that of reflected ray `i` over the triangle `u` that it hits. `back` (3,) receives the unit direction in
    which it passes the sensor, whose mouth is at `mouth` (3,) in world axes.
    """
    j = onward.parent[i]
    ray, distance, normal = rays.ray, rays.distance[j], triangles.normal
    along = normal[u, 0] * onward.ray[i, 0] + normal[u, 1] * onward.ray[i, 1] + normal[u, 2] * onward.ray[i, 2]
    if abs(along) < _GRAZING:
        return -1.0, 0.0, along
    height = triangles.offset[u]
    for a in range(3):
        height -= normal[u, a] * (mouth[a] + distance * ray[j, a])
    middle = height / along
    ahead, far2 = 0.0, 0.0
    for a in range(3):
        second = mouth[a] + distance * ray[j, a] + middle * onward.ray[i, a]
        back[a] = onward.ray[i, a] - 2.0 * along * normal[u, a]
        ahead += (mouth[a] - second) * back[a]
        far2 += (mouth[a] - second) ** 2
    if ahead <= 0.0:
        return -1.0, 0.0, along
    # The mean of the ray's length to its nearest approach and of that to the sensor is exact to second order.
    return distance + middle + 0.5 * (ahead + np.sqrt(far2)), max(0.0, far2 - ahead * ahead), along
