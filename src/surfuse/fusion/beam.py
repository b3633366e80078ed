"""Beam-aware fusion: the surface whose predicted first echoes explain all readings best, with its uncertainty.

Each reading is the first echo that crosses a threshold somewhere in a wide beam, not a depth on the axis. The method
predicts that echo (mirror-like facet, rim, or speckle), tries several explanations of all readings, and keeps the most
probable one. The parts are in `beam_model`; the model is explained in docs/explanations/beam.md.
"""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.beam_model.echo.detector import DetectorModel
from surfuse.beam_model.light.every_kind import map_of_every_kind
from surfuse.beam_model.map.live import LiveMap
from surfuse.confidence.gate import GateParameters
from surfuse.errors import ConfigError, DataError
from surfuse.fusing.mapwise import MapwiseFusion, MapwiseState
from surfuse.fusing.median_of_sweep import medians
from surfuse.interfaces import FusionMethod
from surfuse.records import FusedPoints, FusionScene, MapGrid, Readings, SurfaceMap

SUMMARY = "beam-aware: the surface whose predicted first echoes explain all readings best"


@dataclass(frozen=True)
class Parameters:
    """What no data sheet gives, with the values of a Polaroid-type ranging module on matte parts.

    threshold_ratio: detection threshold relative to the echo of a facing plate. rise_wavelengths: time constant of the
    echo's rise, in wavelengths of range. burst_cycles: cycles of the burst. roughness_m: diffuse scattering length of
    the surface (m). edge_price: how improbable a break between two cells is (units of log likelihood).
    air_temperature_sigma_k: standard deviation of the air temperature that the ranges were computed with (K); the error
    of the speed of sound is common to all readings, so no number of them takes it out of sigma. 0: measured exactly.
    """

    threshold_ratio: float = 0.0145
    rise_wavelengths: float = 2.0
    burst_cycles: int = 16
    roughness_m: float = 0.00065
    edge_price: float = 0.5
    air_temperature_sigma_k: float = 0.4

    def __post_init__(self) -> None:
        limits = {
            "threshold_ratio": (self.threshold_ratio, 1e-4, 0.5),
            "rise_wavelengths": (self.rise_wavelengths, 0.1, 100.0),
            "burst_cycles": (float(self.burst_cycles), 1.0, 1000.0),
            "roughness_m": (self.roughness_m, 1e-6, 0.1),
            "edge_price": (self.edge_price, 0.01, 1000.0),
            "air_temperature_sigma_k": (self.air_temperature_sigma_k, 0.0, 50.0),
        }
        for name, (value, low, high) in limits.items():
            if not low <= value <= high:
                raise ConfigError(f"fusion.beam.{name} = {value}", cure=f"give a value from {low:g} to {high:g}")

    @property
    def detector(self) -> DetectorModel:
        """The detector and surface that these parameters describe."""
        return DetectorModel(
            self.threshold_ratio, self.burst_cycles, self.rise_wavelengths, self.roughness_m,
            self.air_temperature_sigma_k,
        )  # fmt: skip


@dataclass
class BeamState(MapwiseState):
    """Live fusion so far, and a preview if one was asked for."""

    live: LiveMap | None = None


@dataclass(frozen=True)
class BeamFusion(MapwiseFusion):
    """The map that explains all readings, which can also be looked at while the scan runs."""

    parameters: Parameters

    def start(self, scene: FusionScene) -> BeamState:
        """A fresh state."""
        return BeamState(scene, self.local.start(scene))

    def preview(self, state: object, grid: MapGrid) -> SurfaceMap:
        """The map so far: estimated again around the sweeps since the last call; nothing of it enters the final map.

        Raises
        ------
        DataError : the state is not one that `start` of this method returned.
        """
        own = self._own(state)
        if not isinstance(own, BeamState):
            raise DataError(f"a state of type {type(own).__name__}", cure="pass what start() of 'beam' returned")
        if own.live is None:
            own.live = LiveMap(own.scene, grid, self.parameters.detector, self.parameters.edge_price)
        own.live.update(own.sweeps[len(own.live.sweeps) :])
        return own.live.surface()


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters; the point of a stop is the median of its valid readings."""

    def mapped(scene: FusionScene, readings: Readings, points: FusedPoints, grid: MapGrid) -> SurfaceMap:
        return map_of_every_kind(scene, readings, grid, parameters.detector, parameters.edge_price)

    return BeamFusion("beam", medians(GateParameters()), mapped, parameters)
