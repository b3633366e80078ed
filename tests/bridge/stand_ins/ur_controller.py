"""The controller that both interfaces of ur_rtde talk to."""

import math

from motion import Traveller

ROBOT = Traveller([0.4, 0.0, 0.4])
TURN = [math.pi, 0.0, 0.0]
STOPPED = []
