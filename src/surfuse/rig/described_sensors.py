"""What a cell file says of the sensors on the tool: their places, and what is known of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import FloatArray, LateTable, SensorSpec
from surfuse.settings.rig_tables import SensorSettings

ASSUMED_INCIDENCE_RAD, ASSUMED_FIRING_S = float(np.radians(25.0)), 0.05
"""What is assumed of a sensor of which neither its table nor its driver says more."""


def places(sensors: Sequence[SensorSettings]) -> tuple[FloatArray, FloatArray]:
    """Positions (S, 3) and unit axes (S, 3) of the sensors in the frame of the tool."""
    axes = np.array([sensor.axis for sensor in sensors], dtype=np.float64)
    return (
        np.array([sensor.position_m for sensor in sensors], dtype=np.float64),
        axes / np.linalg.norm(axes, axis=1)[:, None],
    )


def check_directions(sensors: Sequence[SensorSettings]) -> None:
    """Refuse sensors that look at the tool that carries them.

    Raises
    ------
    ConfigError : names the sensor.
    """
    for sensor in sensors:
        if sensor.axis[2] < 0.0:
            raise ConfigError(
                f"sensor '{sensor.name}': axis = {list(sensor.axis)} looks back at the tool",
                cure="z of the tool points along the beams, towards the part: give an axis with z > 0",
            )


def described_spec(sensor: SensorSettings, usual: SensorSpec) -> SensorSpec:
    """What is known of a sensor: what its table says, else what its driver says of it."""
    beam_rad = None if sensor.beam_full_angle_deg is None else float(np.radians(sensor.beam_full_angle_deg))
    incidence_rad = None if sensor.incidence_limit_deg is None else float(np.radians(sensor.incidence_limit_deg))
    return replace(
        usual,
        name=sensor.name,
        kind=sensor.kind or usual.kind,
        range_min_m=_known(sensor.range_min_m, usual.range_min_m),
        range_max_m=_known(sensor.range_max_m, usual.range_max_m),
        beam_full_angle_rad=_known(beam_rad, usual.beam_full_angle_rad),
        sigma_m=_known(sensor.sigma_m, usual.sigma_m),
        frequency_hz=usual.frequency_hz if sensor.frequency_hz is None else sensor.frequency_hz,
        aperture_m=usual.aperture_m if sensor.aperture_m is None else sensor.aperture_m,
        incidence_limit_rad=_known(incidence_rad, usual.incidence_limit_rad),
        firing_time_s=_known(sensor.firing_time_s, usual.firing_time_s),
        dead_length_m=sensor.dead_length_m,
        late=_late(sensor) or usual.late,
    )


def _known(given: float | None, usual: float) -> float:
    return usual if given is None else given


def _late(sensor: SensorSettings) -> LateTable | None:
    if not sensor.late_tilt_deg:
        return None
    tilts = tuple(float(tilt) for tilt in np.radians(sensor.late_tilt_deg))
    return LateTable(tilts, tuple(sensor.late_bias_m), tuple(sensor.late_scatter_m))
