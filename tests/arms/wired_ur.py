"""The twin of a cell file behind RTDE and serial lines, as a process of its own: `python wired_ur.py CELL WIRED`."""

import sys
from pathlib import Path

from ur_stand_in import obey_input

from surfuse.commands.machine.bridge_program import with_wires
from surfuse.rig.simulated.wires.wired_twin import WiredTwin
from surfuse.settings import load

if __name__ == "__main__":
    cell, wired = Path(sys.argv[1]), Path(sys.argv[2])
    with WiredTwin(load(cell), times_faster=20.0) as twin:
        wired.write_text(with_wires(cell.read_text("utf-8"), twin.wires), "utf-8")
        obey_input(twin.arm.controller)
