"""Bridge to a gantry with a Marlin, Klipper or GRBL board on a serial line, by the package pyserial.

Run: python gcode_gantry.py /dev/ttyUSB0 marlin|grbl, as `command` of the cell file. Home the machine first.
World is the machine frame; the tool looks down (its z against the machine's) and never turns. On GRBL positions are
machine positions (`$10=1`, moves by G53), on Marlin and Klipper those of M114. A sensor has a driver of its own in the
cell file. The limits are the board's.
Checked on pseudo-terminals with a small Marlin and a small GRBL that answer as their documents say. Not checked: a
real board, a real Klipper.
"""

import re
import sys
import threading
import time

import serial
from bridge_lines import RefusedError, serve

FEED_MM_MIN, BAUD, LONGEST_S = 3000.0, 115200, 60.0
DOWN = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]
moving = threading.Lock()


def lines_until(done, limit_s=LONGEST_S):
    """What the board says until a line that `done` accepts, that line included."""
    began, heard = time.monotonic(), []
    while time.monotonic() - began < limit_s:
        line = port.readline().decode("ascii", "replace").strip()
        if line.startswith(("ALARM", "error", "Error", "!!")) or (line.startswith("Grbl ") and heard):
            raise RefusedError("safety" if line.startswith("ALARM") else "device", f"the board says: {line}")
        if line:
            heard.append(line)
        if line and done(line):
            return heard
    raise RefusedError("device", f"no answer of the board within {limit_s:g} s")


def command(text):
    """Send one line; what the board says until its ok."""
    port.write(text.encode("ascii") + b"\n")
    return lines_until(lambda line: line == "ok" or line.startswith("ok "))


def grbl_status():
    """The state and the machine position in mm: <Idle|MPos:0.000,0.000,0.000|...>."""
    port.write(b"?")
    report = lines_until(lambda line: line.startswith("<"), 2.0)[-1]
    found = re.search(r"MPos:([-\d.]+),([-\d.]+),([-\d.]+)", report)
    if found is None:
        raise RefusedError("usage", f"no MPos in {report}: send $10=1 to the board once")
    return report[1:].split("|")[0], [float(number) for number in found.groups()]


def marlin_position():
    """The position in mm: X:0.00 Y:0.00 Z:0.00 E:0.00 Count ..."""
    report = next(line for line in command("M114") if line.startswith("X:"))
    return [float(re.search(axis + r":([-\d.]+)", report).group(1)) for axis in "XYZ"]


def state(ask):
    """Where the tool is."""
    x, y, z = grbl_status()[1] if dialect == "grbl" else marlin_position()
    rows = [DOWN[:3], DOWN[3:6], DOWN[6:]]
    pose = [item for row, mm in zip(rows, (x, y, z), strict=True) for item in (*row, 1e-3 * mm)]
    return {"t_s": time.monotonic(), "world_from_tool": [*pose, 0.0, 0.0, 0.0, 1.0]}


def move(ask):
    """Go there and wait until the machine stands."""
    with moving:
        drive(ask["world_from_tool"], FEED_MM_MIN * ask.get("speed_share", 1.0))
        return state(ask)


def drive(m, feed):
    """One straight line in the machine's coordinates."""
    if max(abs(m[4 * i + j] - DOWN[3 * i + j]) for i in range(3) for j in range(3)) > 1e-3:
        raise RefusedError("unreachable", "this gantry cannot turn its tool")
    target = f"G1 X{1e3 * m[3]:.3f} Y{1e3 * m[7]:.3f} Z{1e3 * m[11]:.3f} F{feed:.0f}"
    if dialect == "marlin":
        command(target)
        command("M400")
        return
    command("G53 " + target)
    began = time.monotonic()
    while True:
        now, where = grbl_status()
        if now.startswith(("Hold", "Alarm", "Door")):
            raise RefusedError("safety", f"the board is in the state {now}")
        if now == "Idle" and max(abs(where[i] - 1e3 * m[4 * i + 3]) for i in range(3)) < 0.05:
            return  # the board may say Idle before it begins, too
        if time.monotonic() - began > LONGEST_S:
            raise RefusedError("device", f"the machine is at {where} after {LONGEST_S:g} s")
        time.sleep(0.02)


def stop(ask):
    """Hold and reset (GRBL) or quick stop (Marlin with EMERGENCY_PARSER, not Klipper); written while a move waits."""
    port.write(b"!" if dialect == "grbl" else b"M410\n")
    with moving:  # until the move has noticed
        if dialect == "grbl":
            while grbl_status()[0] == "Hold:1":  # a reset in motion would lose the position
                time.sleep(0.02)
            port.write(b"\x18")
        time.sleep(0.3)
        port.reset_input_buffer()
        return state(ask)


DO = {
    "hello": lambda ask: {"protocol": 1, "name": f"{dialect} gantry", **WHAT},
    "state": state,
    "move": move,
    "stop": stop,
    "bye": lambda ask: {},
}
WHAT = {"arm": {"kind": "cartesian"}, "sensors": [], "camera": None, "can": ["stop"]}

dialect = sys.argv[2]
port = serial.Serial(sys.argv[1], BAUD, timeout=0.1)
time.sleep(float(sys.argv[3]) if len(sys.argv) > 3 else 2.0)  # most boards start again when the port opens
port.reset_input_buffer()
for setup in ("G21", "G90"):
    command(setup)
serve(DO)
