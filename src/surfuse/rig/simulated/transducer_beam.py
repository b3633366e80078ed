"""The beam of a sensor as the twin has it: that of the spec's piston."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.physics.air import speed_of_sound
from surfuse.records import ULTRASONIC, SensorSpec
from surfuse.twin.acoustics.beam import directivity
from surfuse.twin.acoustics.kit import KitParameters
from surfuse.twin.world import transducer_of

_FLOOR_DB = -60.0


def two_way_beam_rad(spec: SensorSpec) -> float:
    """Full angle between the -6 dB points of the two-way amplitude of the spec's piston."""
    wave_number = 2.0 * np.pi * (spec.frequency_hz or KitParameters().frequency_hz) / speed_of_sound(20.0)
    fine = np.radians(np.linspace(0.0, 90.0, 36001))
    two_way = directivity(transducer_of(spec).aperture_m, wave_number, np.sin(fine)) ** 2
    below = two_way < 0.5
    return 2.0 * float(fine[int(np.argmax(below))]) if below.any() else float(np.pi)


@dataclass(frozen=True)
class BeamPattern:
    """Two-way directivity in dB over the angle from the axis in degrees; empty for sensors without one."""

    beam_deg: tuple[float, ...] = ()
    beam_db: tuple[float, ...] = ()
    beam_full_angle_deg: float | None = None


def beam_pattern(spec: SensorSpec) -> BeamPattern:
    """Two-way directivity of an ultrasonic sensor; other sensors have none."""
    if spec.kind != ULTRASONIC:
        return BeamPattern()
    wave_number = 2.0 * np.pi * (spec.frequency_hz or KitParameters().frequency_hz) / speed_of_sound(20.0)
    degrees = np.arange(-60.0, 60.25, 0.25)
    sine = np.sin(np.radians(degrees))
    level = 40.0 * np.log10(np.maximum(np.abs(directivity(transducer_of(spec).aperture_m, wave_number, sine)), 1e-9))
    level = np.maximum(level, _FLOOR_DB)
    full = float(np.degrees(two_way_beam_rad(spec)))
    return BeamPattern(tuple(degrees.tolist()), tuple(level.tolist()), full)
