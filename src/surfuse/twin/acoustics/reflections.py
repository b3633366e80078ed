"""Echoes over two surfaces: ghosts in corners and between part and table. Kernels, conventions as in `arrivals`."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.twin.acoustics.arrivals import beam_energy, deposit

# Half-width of the lobe around the sensor in units of the first Fresnel zone; narrower than that of direct echoes,
# because the directivity is taken at the ray.
PATH_LOBE = 0.5
_GRAZING = 1e-3
# Rays within 15 degrees of the normal return to the sensor itself.
_BOUNCE_COSINE = 0.966
_BOUNCE_GAIN = 1e-4


@compiled
def reflect(
    mouth: FloatArray,
    origin: FloatArray,
    ray: FloatArray,
    hit: IntArray,
    distance: FloatArray,
    cosine: FloatArray,
    gain: FloatArray,
    normal: FloatArray,
    material: IntArray,
    mirror_of: FloatArray,
    roughness_of: FloatArray,
    rays: int,
    start: FloatArray,
    onward: FloatArray,
    onward32: FloatArray,
    parent: IntArray,
) -> int:
    """Rays that go on after a mirror-like reflection and might come back over a second surface; returns their number.

    Rays nearly along the normal return to the sensor itself and are left out, as are those outside the main beam.
    """
    count = 0
    for j in range(rays):
        t = hit[j]
        if t < 0 or cosine[j] <= 0.0 or cosine[j] > _BOUNCE_COSINE or gain[j] < _BOUNCE_GAIN:
            continue
        if mirror_of[material[t]] * np.exp(-roughness_of[material[t]] * cosine[j] ** 2) < 0.01:
            continue
        slope = normal[t, 0] * ray[j, 0] + normal[t, 1] * ray[j, 1] + normal[t, 2] * ray[j, 2]
        for a in range(3):
            onward[count, a] = ray[j, a] - 2.0 * slope * normal[t, a]
            onward32[count, a] = onward[count, a]
            # A hair off the surface, so that the ray does not meet the triangle that it leaves.
            start[count, a] = mouth[a] + distance[j] * ray[j, a] + 1e-5 * onward[count, a] - origin[a]
        parent[count] = j
        count += 1
    return count


@compiled
def add_second_bounce(
    count: int,
    mouth: FloatArray,
    axis: FloatArray,
    ray: FloatArray,
    hit: IntArray,
    distance: FloatArray,
    cosine: FloatArray,
    weight: FloatArray,
    gain: FloatArray,
    onward: FloatArray,
    hit2: IntArray,
    parent: IntArray,
    normal: FloatArray,
    offset: FloatArray,
    material: IntArray,
    mirror_of: FloatArray,
    roughness_of: FloatArray,
    two_way: FloatArray,
    wave_number: float,
    absorption: float,
    bin_m: float,
    mirror: FloatArray,
    extent: IntArray,
) -> None:
    """Echoes over two mirror-like surfaces: each ray brings its energy to where it passes the sensor.

    A path of length P with image sources returns 1 / P^2; a ray that passes the sensor at distance h counts with the
    lobe exp(-(h / b)^2) / (pi b^2), b of the size of the Fresnel zone.
    """
    wavelength = 2.0 * np.pi / wave_number
    second = np.zeros(3)
    back = np.zeros(3)
    for i in range(count):
        u = hit2[i]
        if u < 0:
            continue
        j = parent[i]
        t = hit[j]
        along = normal[u, 0] * onward[i, 0] + normal[u, 1] * onward[i, 1] + normal[u, 2] * onward[i, 2]
        if abs(along) < _GRAZING:
            continue
        height = offset[u]
        for a in range(3):
            height -= normal[u, a] * (mouth[a] + distance[j] * ray[j, a])
        middle = height / along
        ahead, far2 = 0.0, 0.0
        for a in range(3):
            second[a] = mouth[a] + distance[j] * ray[j, a] + middle * onward[i, a]
            back[a] = onward[i, a] - 2.0 * along * normal[u, a]
            ahead += (mouth[a] - second[a]) * back[a]
            far2 += (mouth[a] - second[a]) ** 2
        if ahead <= 0.0:
            continue
        # The mean of the ray's length to its nearest approach and of that to the sensor is exact to second order.
        path = distance[j] + middle + 0.5 * (ahead + np.sqrt(far2))
        b2 = PATH_LOBE * PATH_LOBE * wavelength * path
        miss2 = max(0.0, far2 - ahead * ahead)
        if miss2 > 20.0 * b2:
            continue
        facing = -(back[0] * axis[0] + back[1] * axis[1] + back[2] * axis[2])
        if facing <= 0.0:
            continue
        energy = weight[j] * np.exp(-miss2 / b2) / (np.pi * b2) * np.exp(-2.0 * absorption * path)
        energy *= np.sqrt(gain[j] * beam_energy(np.sqrt(max(0.0, 1.0 - facing * facing)), two_way))
        energy *= mirror_of[material[t]] * np.exp(-roughness_of[material[t]] * cosine[j] ** 2)
        energy *= mirror_of[material[u]] * np.exp(-roughness_of[material[u]] * along * along)
        deposit(0.5 * path, energy, bin_m, mirror, extent)
