"""The twin's controller of Universal Robots as a process of its own: its library holds all threads while it connects.

Usage: python ur_stand_in.py ADDRESS. Prints "ready" when it listens. Lines on standard input change it, see `obey`.
"""

import sys

from surfuse.rig.simulated.wires.ur_controller import UrController


def obey(controller: UrController, order: str) -> None:
    """`safety N`, `robot N`, `mute` (the data stop), `deaf` (scripts are ignored), `stop` (protective), `unlock`."""
    word, *rest = order.split()
    if word == "safety":
        controller.safety_mode = int(rest[0])
    elif word == "robot":
        controller.robot_mode = int(rest[0])
    elif word == "mute":
        controller.silent = True
    elif word == "deaf":
        controller.deaf = True
    elif word == "stop":
        controller.protective_stop()
    elif word == "unlock":
        controller.unlock()
    else:
        raise ValueError(order)


def obey_input(controller: UrController) -> None:
    print("ready", flush=True)
    for order in sys.stdin:
        obey(controller, order)
        print("done", flush=True)


if __name__ == "__main__":
    with UrController(sys.argv[1], [0.0] * 6) as served:
        obey_input(served)
