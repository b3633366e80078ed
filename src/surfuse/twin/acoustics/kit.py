"""The transducer with its tube, and the ranging kit that drives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import FloatArray

REFERENCE_HZ = 63e3
# Ends of the gain steps after the start of the burst: blanking, then seven of 256 and three of 512 periods of the
# 93.33 kHz clock (TL851). The last step lasts until the cycle ends.
_CLOCK_HZ = 420e3 / 4.5
_FIRST_STEP_S = 16.0 / 49.41e3 + 192.0 / _CLOCK_HZ
GAIN_STEP_ENDS_S = tuple(
    _FIRST_STEP_S + periods / _CLOCK_HZ
    for periods in (0.0, 256.0, 512.0, 768.0, 1024.0, 1280.0, 1536.0, 1792.0, 2304.0, 2816.0, 3328.0)
)


def _check_limits(name: str, parameters: object, limits: dict[str, tuple[float, float]]) -> None:
    for field, (low, high) in limits.items():
        value = getattr(parameters, field)
        if not low <= value <= high:
            raise ConfigError(f"{name}.{field} = {value}", cure=f"give {low:g} to {high:g}")


@dataclass(frozen=True)
class TransducerParameters:
    """The piston that radiates and hears.

    Parameters
    ----------
    aperture_m : diameter of the radiating piston: the tube's mouth, or the *effective* diameter of the bare foil.
        The bare foil is clamped at its rim, so that its beam is that of a smaller ideal piston: 17 mm gives the
        measured 22 degrees at 63 kHz, where an ideal 38.4 mm piston would give 10.
    tube_length_m : length of the tube, 0 without one; the beam starts at its mouth, the range counts from the foil.
    rise_time_s : time constant of transducer and receiver, each of which delays the envelope once.
    ring_down_level : strength of the transducer's own ringing when the burst ends (1: the echo of a plate 0.5 m away).
    ring_down_time_s : time constant of its decay.
    resonance_hz : frequency at which it sends and hears best; 0: equally well at every frequency.
    quality : resonance over bandwidth (-3 dB, one way). 55 kHz and 3 span 47 to 65 kHz, about the band of the
        600-series foil.
    """

    aperture_m: float = 0.040
    tube_length_m: float = 0.20
    rise_time_s: float = 12e-6
    ring_down_level: float = 300.0
    ring_down_time_s: float = 120e-6
    resonance_hz: float = 55e3
    quality: float = 3.0

    def __post_init__(self) -> None:
        limits = {
            "aperture_m": (0.002, 0.2),
            "tube_length_m": (0.0, 1.0),
            "rise_time_s": (5e-6, 1e-3),
            "ring_down_level": (0.0, 1e6),
            "ring_down_time_s": (1e-6, 1e-2),
            "resonance_hz": (0.0, 1e6),
            "quality": (0.1, 1000.0),
        }
        _check_limits("transducer", self, limits)

    def response(self, frequency_hz: float) -> float:
        """Amplitude of an echo, out and back, relative to that at the paper's 63 kHz, where strengths are told.

        One resonance, `1 / sqrt(1 + Q^2 (f / f0 - f0 / f)^2)`, acts once as loudspeaker and once as microphone.
        """
        if self.resonance_hz == 0.0:
            return 1.0
        return self._two_way(frequency_hz) / self._two_way(REFERENCE_HZ)

    def _two_way(self, frequency_hz: float) -> float:
        detuning = frequency_hz / self.resonance_hz - self.resonance_hz / frequency_hz
        return 1.0 / (1.0 + (self.quality * detuning) ** 2)


TUBE = TransducerParameters()
BARE = TransducerParameters(aperture_m=0.017, tube_length_m=0.0)


@dataclass(frozen=True)
class KitParameters:
    """What can be set on the ranging kit.

    Parameters
    ----------
    frequency_hz : transmit frequency: sets beam, absorption, wavelength, and how well the transducer responds.
    cycles : periods in the burst: more give a stronger, longer echo.
    blanking_s : time after the start of the burst before anything is heard; nearest range = c * blanking_s / 2.
    gain : factor on the receiver's gain; divides the threshold.
    gain_step_db : by how much each of the 12 steps of the time-variable gain raises it.
    threshold : level that the envelope must reach at gain step 0 (1: the echo of a plate 0.5 m away).
    sample_rate_hz : rate of the clock that counts the time of flight; the reading is its next tick.
    listen_s : how long the kit listens.
    trigger : `external` fires when asked, one kit at a time; `internal` lets every kit run on its own clock, so that
        a neighbour's burst, back from the same surface, may be taken for the own echo.
    period_s : time between bursts of a kit that runs on its own clock.
    """

    frequency_hz: float = 63e3
    cycles: int = 16
    blanking_s: float = 1.9e-3
    gain: float = 1.0
    gain_step_db: float = 5.0
    threshold: float = 0.06
    sample_rate_hz: float = 1e6
    listen_s: float = 23.5e-3
    trigger: Literal["external", "internal"] = "external"
    period_s: float = 0.05

    def __post_init__(self) -> None:
        limits = {
            "frequency_hz": (10e3, 500e3),
            "cycles": (1, 200),
            "blanking_s": (0.0, 0.1),
            "gain": (1e-3, 1e3),
            "gain_step_db": (0.0, 12.0),
            "threshold": (1e-6, 10.0),
            "sample_rate_hz": (1e4, 1e9),
            "listen_s": (1e-4, 0.1),
            "period_s": (1e-3, 10.0),
        }
        _check_limits("kit", self, limits)
        if not self.blanking_s < self.listen_s:
            raise ConfigError(
                f"kit.blanking_s = {self.blanking_s} is not below kit.listen_s = {self.listen_s}",
                cure="shorten the blanking",
            )
        if self.trigger not in ("external", "internal"):
            raise ConfigError(f"kit.trigger = '{self.trigger}'", cure="valid: external, internal")

    def level(self, time_s: FloatArray) -> FloatArray:
        """Envelope (N,) that is detected at times (N,) after the start of the burst, under the stepped gain."""
        step = np.searchsorted(GAIN_STEP_ENDS_S, time_s, side="right")
        return np.asarray(self.threshold / (self.gain * 10.0 ** (self.gain_step_db * step / 20.0)), dtype=np.float64)
