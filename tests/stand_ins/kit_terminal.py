"""The twin's ranging kit on a pseudo-terminal, before a large plate; what it says can be damaged."""

import os
import tty

import numpy as np

from surfuse.geometry.poses import pose
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.rig.simulated.kit_on_a_line import KitOnALine, ServedKit
from surfuse.sensors.ranging_kit import SPEC
from surfuse.twin.acoustics.kit import TUBE
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.world import Twin, TwinParameters

LOOKING_ALONG_X = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def twin_before_a_plate(parameters=None):
    """A plate at x = 0."""
    corners = np.array([[0.0, -2.0, -2.0], [0.0, 2.0, -2.0], [0.0, 2.0, 2.0], [0.0, -2.0, 2.0]])
    plate = SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART, np.eye(4))
    return Twin(Scene([plate]), parameters or TwinParameters(transducers={SPEC.name: TUBE}), 1)


class DamagedKit(KitOnALine):
    """`damage` gets every line that the kit says, and returns what goes over the wire."""

    damage = staticmethod(lambda line: line)

    def hear(self, data):
        for line in super().hear(data):
            yield self.damage(line)


class KitTerminal:
    """`port` is the terminal's name; `kit` and `world` are behind it; `range_m` the distance of the plate."""

    def __init__(self, range_m=0.43, parameters=None):
        self.range_m, self.world, self.clock = range_m, twin_before_a_plate(parameters), SimulatedClock()
        self.kit = self.new_kit()

    def new_kit(self):
        """As it is when it has been switched on."""
        return DamagedKit(self.world, SPEC, lambda: pose(LOOKING_ALONG_X, [-self.range_m, 0.0, 0.0]), self.clock)

    def __enter__(self):
        self._master, self._slave = os.openpty()
        for end in (self._master, self._slave):
            tty.setraw(end)
        self.port, self._gone = os.ttyname(self._slave), False
        self._served = ServedKit(self.kit, self._master)
        self._served.__enter__()
        return self

    def __exit__(self, *error):
        self.vanish()

    def power_cycle(self, usual):
        """Off and on: it has its usual parameters, and has not been set since."""
        self.world.set_kit(SPEC.name, usual)
        self.kit._sets = 0

    def vanish(self):
        """Pull the plug."""
        if not self._gone:
            self._gone = True
            self._served.__exit__(None, None, None)
            os.close(self._master)
            os.close(self._slave)
