"""The kit's parameters as the bus tells them, and as the twin's kit has them."""

from __future__ import annotations

import math
from dataclasses import replace

from surfuse.node.messages import KitMessage, TriggerSource
from surfuse.twin.acoustics.kit import KitParameters

# What the bus calls the gain at which the kit's threshold is told.
NOMINAL_GAIN_DB = 40.0


def kit_as_message(kit: KitParameters, pings: int) -> KitMessage:
    """What is said of a kit: its values, rounded to what the bus carries.

    Raises
    ------
    ConfigError : a value that the bus cannot carry.
    """
    return KitMessage(
        frequency_hz=2 * round(0.5 * kit.frequency_hz),
        cycles=kit.cycles,
        blanking_us=round(1e6 * kit.blanking_s),
        gain_db=0.5 * round(2.0 * (NOMINAL_GAIN_DB + 20.0 * math.log10(kit.gain))),
        sample_rate_hz=round(kit.sample_rate_hz),
        trigger_source=TriggerSource.INTERNAL if kit.trigger == "internal" else TriggerSource.EXTERNAL,
        pings=pings,
    )


def kit_from_message(settings: KitMessage, now: KitParameters) -> KitParameters:
    """The kit with these settings; what the bus does not tell stays as it is.

    Raises
    ------
    ConfigError : a value that the kit cannot have.
    """
    return replace(
        now,
        frequency_hz=float(settings.frequency_hz),
        cycles=settings.cycles,
        blanking_s=1e-6 * settings.blanking_us,
        gain=10.0 ** ((settings.gain_db - NOMINAL_GAIN_DB) / 20.0),
        sample_rate_hz=float(settings.sample_rate_hz),
        trigger="internal" if settings.trigger_source is TriggerSource.INTERNAL else "external",
    )
