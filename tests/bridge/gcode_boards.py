"""A small Marlin and a small GRBL on a pseudo-terminal, as their documents describe what goes over the line.

Marlin: marlinfw.org, "G-code index" (G0/G1, G21, G90, M114, M400, M410). GRBL 1.1: gnea/grbl wiki, "Grbl v1.1
Interface" (real-time ?, !, Ctrl-X; status reports; error and alarm numbers).
"""

import os
import re
import select
import threading
import tty

# As a part of their folder: the stand-ins have the names of the makers' packages, which no test here may find.
from stand_ins.motion import Traveller


class Board:
    """One machine with three axes from 0 to 300 mm, behind a terminal whose name is `port`."""

    banner = b""

    def __enter__(self):
        self._master, slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self.port, self._slave = os.ttyname(slave), slave
        self.axes, self.told, self._line = Traveller([0.0, 0.0, 0.0]), [], b""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()
        self.say(self.banner)
        return self

    def __exit__(self, *error):
        self._closing.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def say(self, text):
        os.write(self._master, text)

    def _work(self):
        while not self._closing.is_set():
            ready, _, _ = select.select([self._master], [], [], 0.005)
            for byte in os.read(self._master, 256) if ready else b"":
                self.hear(bytes([byte]))
            self.tick()

    def hear(self, byte):
        """One byte of a line."""
        if byte in b"\r\n":
            line, self._line = self._line.decode(), b""
            if line.strip():
                self.told.append(line)
                self.obey(line)
        else:
            self._line += byte

    def target(self, line):
        found = dict(re.findall(r"([XYZF])(-?[\d.]+)", line))
        where = [float(found.get(axis, now)) for axis, now in zip("XYZ", self.axes.where(), strict=True)]
        return where, float(found.get("F", 1000.0)) / 60.0


class Marlin(Board):
    """Answers `ok` when a line is taken; M400 when all moves are done, with `echo:busy` meanwhile."""

    banner = b"start\necho:Marlin 2.1.2\n"

    def __enter__(self):
        self._waiting, self._busy = None, 0
        return super().__enter__()

    def obey(self, line):
        if line.startswith("M410"):
            self.axes.halt()
            self.say(b"ok\n")
        elif line.startswith(("G0", "G1 ")):
            where, speed = self.target(line)
            if max(where) > 300.0:
                self.say(b"Error:Printer halted. kill() called!\n")
                return
            self.axes.go(where, speed)
            self.say(b"ok\n")
        elif line == "M400":
            self._waiting = True
        elif line == "M114":
            x, y, z = self.axes.where()
            steps = f"Count X:{80 * x:.0f} Y:{80 * y:.0f} Z:{400 * z:.0f}"
            self.say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 {steps}\nok\n".encode())
        elif line in ("G21", "G90"):
            self.say(b"ok P15 B3\n")
        else:
            self.say(f'echo:Unknown command: "{line}"\nok\n'.encode())

    def tick(self):
        if self._waiting and not self.axes.moves():
            self._waiting = None
            self.say(b"ok\n")
        elif self._waiting:
            self._busy += 1
            if self._busy % 20 == 0:
                self.say(b"echo:busy: processing\n")


class Grbl(Board):
    """Real-time bytes are obeyed between the bytes of a line; `ok` comes when a line is in the planner."""

    banner = b"\r\nGrbl 1.1h ['$' for help]\r\n"
    report = "MPos"

    def __enter__(self):
        self._held = self._alarm = False
        return super().__enter__()

    def hear(self, byte):
        if byte == b"?":
            x, y, z = self.axes.where()
            where = f"{self.report}:{x:.3f},{y:.3f},{z:.3f}"
            self.say(f"<{self._state()}|{where}|FS:0,0|WCO:0.000,0.000,0.000>\r\n".encode())
        elif byte == b"!":
            if self.axes.moves():
                self._held = True
                self.axes.halt()
        elif byte == b"\x18":
            self.told.append("reset")
            self._held, self._line = False, b""
            self.say(self.banner)
        else:
            super().hear(byte)

    def _state(self):
        return "Alarm" if self._alarm else "Hold:0" if self._held else "Run" if self.axes.moves() else "Idle"

    def obey(self, line):
        if self._alarm:
            self.say(b"error:9\r\n")
        elif line.startswith("G53 G1 "):
            where, speed = self.target(line.removeprefix("G53 "))
            if max(where) > 300.0:
                self._alarm = True
                self.say(b"ALARM:2\r\n")
                return
            self.axes.go(where, speed)
            self.say(b"ok\r\n")
        else:
            self.say(b"ok\r\n" if line in ("G21", "G90") else b"error:20\r\n")

    def tick(self):
        pass
