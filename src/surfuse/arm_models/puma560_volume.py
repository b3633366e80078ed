"""The outer shape of the PUMA 560 as capsules, for clearance checks.

Lengths along the links follow from the Denavit-Hartenberg parameters; the thicknesses are rounded-up estimates, not
measured ones: measure them on the real arm before relying on small clearances.
"""

from __future__ import annotations

from surfuse.motion.body import Capsule
from surfuse.motion.obstacles import Column

TOOL_LINK = 7  # of the link poses: base, links 1 to 6, tool
_SHOULDER_HEIGHT_M = 0.67183

UPPER_ARM = "upper arm"
FOREARM = "forearm"
WRIST = "wrist"

CAPSULES = (
    # The upper arm runs along -x of link 2, beside the trunk: its centre of gravity lies at z = 0.2275 m (Corke).
    Capsule(UPPER_ARM, 2, (-0.4318, 0.0, 0.2275), (0.0, 0.0, 0.2275), 0.09),
    Capsule(FOREARM, 3, (-0.0203, 0.0, 0.0), (-0.0203, 0.0, 0.20), 0.075),
    Capsule(FOREARM, 3, (0.0, 0.0, 0.20), (0.0, 0.0, 0.4318), 0.055),
    Capsule(WRIST, 6, (0.0, 0.0, 0.0), (0.0, 0.0, 0.03), 0.045),
)

# Parts that can meet. Upper arm and forearm run side by side at every angle of joint 3; forearm, wrist and bracket
# meet in the wrist's centre.
OWN_PAIRS = (
    (UPPER_ARM, WRIST),
    (UPPER_ARM, "sensor bracket"),
    (UPPER_ARM, "sensor tube"),
    (FOREARM, "sensor tube"),
)


def column(base_height_m: float) -> Column:
    """Stand and trunk of the arm; the upper arm is bolted to it and runs beside it."""
    return Column(top_m=base_height_m + _SHOULDER_HEIGHT_M, radius_m=0.10, ignores=(UPPER_ARM,))
