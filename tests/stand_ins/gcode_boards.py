"""A small Marlin and a small GRBL on a pseudo-terminal, as their documents describe what goes over the line.

Marlin: marlinfw.org, "G-code index" (G0/G1, G21, G28, G38, G90, M114, M400, M410). GRBL 1.1: gnea/grbl wiki, "Grbl
v1.1 Interface" (real-time ?, !, Ctrl-X; status reports; error and alarm numbers; `[PRB:...]` after probing).
"""

import os
import re
import select
import threading
import time
import tty

from motion import Traveller


class Board:
    """One machine with three axes from 0 to 300 mm, behind a terminal whose name is `port`.

    Faults: `silent` says nothing any more; `late_s` waits before every ok; `noise` is said before every line; `slip_mm`
    is lost on the way of the next move; `complaint` is said to the next move instead of doing it; `part_mm` is the
    height (z) at which a probe touches (None: nowhere).
    """

    banner = b""

    def __init__(self):
        self.silent, self.late_s, self.noise, self.slip_mm, self.complaint = False, 0.0, b"", None, b""
        self.part_mm = None
        self.lost_mm = [0.0, 0.0, 0.0]

    def __enter__(self):
        self._master, slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self.port, self._slave = os.ttyname(slave), slave
        self.axes, self.told, self._line = Traveller([0.0, 0.0, 0.0]), [], b""
        self._late = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()
        self.say(self.banner)
        return self

    def __exit__(self, *error):
        self.vanish()

    def displace(self):
        """Somebody pushes the tool: it stands elsewhere, and the board knows."""
        self.lost_mm = [5.0, 0.0, 0.0]

    def vanish(self):
        """Pull the plug."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._slave)
            os.close(self._master)

    def start_again(self):
        """As after a dip of the supply: it believes to be at zero, and moves no more."""
        self.axes = Traveller([0.0, 0.0, 0.0])
        self.say(self.banner)

    def push(self, *by_mm):
        """Something moves the machine."""
        self.axes = Traveller([a + b for a, b in zip(self.where(), by_mm, strict=True)])

    def say(self, text):
        if self.silent:
            return
        if self.late_s and text.startswith(b"ok"):
            self._late.append((time.monotonic() + self.late_s, text))
        else:
            os.write(self._master, self.noise + text)

    def where(self):
        return [a + b for a, b in zip(self.axes.where(), self.lost_mm, strict=True)]

    def _work(self):
        while not self._closing.is_set():
            ready, _, _ = select.select([self._master], [], [], 0.005)
            for byte in os.read(self._master, 256) if ready else b"":
                self.hear(bytes([byte]))
            while self._late and self._late[0][0] <= time.monotonic():
                os.write(self._master, self._late.pop(0)[1])
            self.tick()

    def hear(self, byte):
        """One byte of a line."""
        if byte in b"\r\n":
            line, self._line = self._line.decode("ascii", "replace"), b""
            if line.strip():
                self.told.append(line)
                self.obey(line)
        else:
            self._line += byte

    def target(self, line):
        found = dict(re.findall(r"([XYZF])(-?[\d.]+)", line))
        where = [float(found.get(axis, now)) for axis, now in zip("XYZ", self.axes.where(), strict=True)]
        return where, float(found.get("F", 1000.0)) / 60.0

    def go(self, where, speed):
        self.axes.go(where, speed)
        if self.slip_mm is not None:
            self.lost_mm, self.slip_mm = list(self.slip_mm), None

    def go_to_part(self, where, speed):
        """Down to the part or the target; whether it touches."""
        touches = self.part_mm is not None and where[2] <= self.part_mm
        self.go([where[0], where[1], max(where[2], self.part_mm)] if touches else where, speed)
        return touches


class Marlin(Board):
    """Answers `ok` when a line is taken; M400 when all moves are done, with `echo:busy` meanwhile."""

    banner = b"start\necho:Marlin 2.1.2\n"

    def __enter__(self):
        self._waiting, self._busy = None, 0
        return super().__enter__()

    def start_again(self):
        self._waiting = None
        super().start_again()

    def obey(self, line):
        if line.startswith("M410"):
            self.axes.halt()
            self.say(b"ok\n")
        elif line.startswith(("G0", "G1 ", "G38.3 ")):
            self._move(line)
        elif line == "G28":
            self.lost_mm, self.axes = [0.0, 0.0, 0.0], Traveller([0.0, 0.0, 0.0])
            self.say(b"ok\n")
        elif line == "M400":
            self._waiting = True
        elif line == "M114":
            x, y, z = self.where()
            steps = f"Count X:{80 * x:.0f} Y:{80 * y:.0f} Z:{400 * z:.0f}"
            self.say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 {steps}\n".encode())
            self.say(b"ok\n")
        elif line in ("G21", "G90"):
            self.say(b"ok P15 B3\n")
        else:
            self.say(f'echo:Unknown command: "{line}"\n'.encode())
            self.say(b"ok\n")

    def _move(self, line):
        where, speed = self.target(line)
        complaint, self.complaint = self.complaint, b""
        if complaint or max(where) > 300.0:
            self.say(complaint or b"Error:Printer halted. kill() called!\n")
            return
        if line.startswith("G38"):
            self.go_to_part(where, speed)
        else:
            self.go(where, speed)
        self.say(b"ok\n")

    def tick(self):
        if self._waiting and not self.axes.moves():
            self._waiting = None
            self.say(b"ok\n")
        elif self._waiting:
            self._busy += 1
            if self._busy % 20 == 0:
                self.say(b"echo:busy: processing\n")


class Grbl(Board):
    """Real-time bytes are obeyed between the bytes of a line; `ok` comes when a line is in the planner.

    `report` is MPos or WPos; then `offset_mm` goes with every tenth report. `locked`: as after a start with homing.
    `more_axes` is what a board with more than three adds to every place.
    """

    banner = b"\r\nGrbl 1.1h ['$' for help]\r\n"
    report = "MPos"
    locked = False
    inches = False
    offset_mm = (0.0, 0.0, 0.0)
    more_axes = ""

    def __enter__(self):
        self._held, self._alarm, self._probing, self._reports = False, self.locked, None, 0
        return super().__enter__()

    def start_again(self):
        self._held = self._alarm = False
        super().start_again()

    def hear(self, byte):
        if byte == b"?":
            self._say_report()
        elif byte == b"!":
            self._held = self._held or not self._alarm
            self.axes.halt()
        elif byte == b"\x18":
            self.told.append("reset")
            self._held, self._line = False, b""
            self.say(self.banner)
        else:
            super().hear(byte)

    def _say_report(self):
        self._reports += 1
        work = self.report == "WPos"
        x, y, z = (a - b * work for a, b in zip(self.where(), self.offset_mm, strict=True))
        where = f"{self.report}:{x:.3f},{y:.3f},{z:.3f}{self.more_axes}"
        offset = "|WCO:{:.3f},{:.3f},{:.3f}".format(*self.offset_mm) + self.more_axes if self._reports % 10 == 0 else ""
        self.say(f"<{self._state()}|{where}|FS:0,0{offset}>\r\n".encode())

    def _state(self):
        return "Alarm" if self._alarm else "Hold:0" if self._held else "Run" if self.axes.moves() else "Idle"

    def obey(self, line):
        if line == "$H":
            self._alarm, self.lost_mm, self.axes = False, [0.0, 0.0, 0.0], Traveller([0.0, 0.0, 0.0])
            self.say(b"ok\r\n")
        elif line == "$$":
            self.say(f"$10=1\r\n$13={int(self.inches)}\r\n".encode())
            self.say(b"ok\r\n")
        elif self._alarm:
            self.say(b"error:9\r\n")
        elif line.startswith(("G53 G1 ", "G38.3 ")):
            self._move(line)
        else:
            self.say(b"ok\r\n" if line in ("G21", "G90", "G94") else b"error:20\r\n")

    def _move(self, line):
        where, speed = self.target(line.removeprefix("G53 ").removeprefix("G38.3 "))
        complaint, self.complaint = self.complaint, b""
        if complaint or max(where) > 300.0:
            self._alarm = not complaint.startswith(b"error")
            self.say(complaint or b"ALARM:2\r\n")
        elif line.startswith("G38"):
            machine = [a + b for a, b in zip(where, self.offset_mm, strict=True)]
            self._probing = self.go_to_part(machine, speed)
        else:
            self.go(where, speed)
            self.say(b"ok\r\n")

    def tick(self):
        if self._probing is not None and not self.axes.moves():
            x, y, z = self.where()
            touched, self._probing = int(self._probing), None
            self.say(f"[PRB:{x:.3f},{y:.3f},{z:.3f}{self.more_axes}:{touched}]\r\n".encode())
            self.say(b"ok\r\n")
