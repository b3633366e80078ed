"""The rig that a configuration describes, real or simulated."""

from __future__ import annotations

from surfuse.rig.devices import Rig
from surfuse.settings import Settings


def assembled(settings: Settings) -> Rig:
    """The devices of the cell file; the simulated cell unless it names the driver of a real arm.

    Raises
    ------
    UsageError, ConfigError, DataError : what is described cannot be built.
    """
    if settings.arm.is_real:
        from surfuse.rig.real.assembly import real_rig

        return real_rig(settings)
    from surfuse.rig.simulated.assembly import simulated_rig

    return simulated_rig(settings)
