"""What makes two pings from one place differ."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.errors import ConfigError


@dataclass(frozen=True)
class AcousticNoise:
    """What makes two pings from one place differ.

    Parameters
    ----------
    timing_m : standard deviation of a single ping's range (turbulence, electronics).
    amplitude : relative standard deviation of the echo's strength (turbulence).
    receiver : standard deviation of the receiver's noise, in the unit of `KitParameters.threshold`, before the gain.
    dropout : probability that a ping is not heard at all.
    slip : probability that the detector misses one period, so that the range is half a wavelength long.
    neighbours : other kits in the air when the trigger is internal.
    drift_m : range error of a kit that has just been switched on.
    drift_time_s : time constant with which that error dies out.
    """

    timing_m: float = 0.3e-3
    amplitude: float = 0.03
    receiver: float = 1e-5
    dropout: float = 0.0
    slip: float = 0.0
    neighbours: int = 3
    drift_m: float = 0.0
    drift_time_s: float = 600.0

    def __post_init__(self) -> None:
        for name in ("timing_m", "amplitude", "receiver"):
            value = getattr(self, name)
            if not 0.0 <= value <= 0.5:
                raise ConfigError(f"noise.{name} = {value}", cure="give 0 to 0.5")
        for name in ("dropout", "slip"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"noise.{name} = {value}", cure="give a probability between 0 and 1")
        if not 0 <= self.neighbours <= 100:
            raise ConfigError(f"noise.neighbours = {self.neighbours}", cure="give 0 to 100")
        if not (abs(self.drift_m) <= 0.1 and self.drift_time_s > 0.0):
            raise ConfigError(
                f"noise.drift_m = {self.drift_m} with drift_time_s = {self.drift_time_s}",
                cure="give at most 0.1 m and a time > 0",
            )


SILENT = AcousticNoise(timing_m=0.0, amplitude=0.0, receiver=0.0)
