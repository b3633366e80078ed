"""A stand-in for a Universal Robots controller, run as a process of its own: RTDE output on 30004, URScript on 30002.

Usage: python ur_stand_in.py ADDRESS. Prints "ready" when it listens. Lines on standard input change it:
`safety N`, `robot N`, `mute` (data stop), `deaf` (scripts are ignored).
"""

import math
import re
import socket
import struct
import sys
import threading
import time

TYPES = {
    b"timestamp": "DOUBLE",
    b"actual_q": "VECTOR6D",
    b"actual_qd": "VECTOR6D",
    b"robot_mode": "INT32",
    b"safety_mode": "INT32",
}
FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i"}


class Robot:
    def __init__(self) -> None:
        self.start, self.end = [0.0] * 6, [0.0] * 6
        self.began, self.duration = time.monotonic(), 0.0
        self.safety, self.mode, self.mute, self.deaf = 1, 7, False, False

    def state(self) -> tuple[list[float], list[float]]:
        t = time.monotonic() - self.began
        if t >= self.duration:
            return self.end, [0.0] * 6
        share = 0.5 * (1.0 - math.cos(math.pi * t / self.duration))
        rate = 0.5 * math.pi / self.duration * math.sin(math.pi * t / self.duration)
        pairs = list(zip(self.start, self.end, strict=True))
        return [a + share * (b - a) for a, b in pairs], [rate * (b - a) for a, b in pairs]

    def values(self, name: bytes) -> tuple[float, ...]:
        position, speed = self.state()
        return {
            b"timestamp": (time.monotonic(),),
            b"actual_q": tuple(position),
            b"actual_qd": tuple(speed),
            b"robot_mode": (self.mode,),
            b"safety_mode": (self.safety,),
        }[name]

    def script(self, text: str) -> None:
        found = re.search(r"movej\(\[([^\]]*)\], a=([0-9.]+), v=([0-9.]+)\)", text)
        if found and not self.deaf:
            here, _ = self.state()
            self.start, self.end = here, [float(angle) for angle in found[1].split(",")]
            change = max(abs(b - a) for a, b in zip(self.start, self.end, strict=True))
            self.began, self.duration = time.monotonic(), max(0.02, 0.5 * math.pi * change / float(found[3]))
        elif "stopj" in text:
            self.end, _ = self.state()
            self.duration = 0.0


def packages(line: socket.socket):  # type: ignore[no-untyped-def]
    buffer = b""
    while data := line.recv(4096):
        buffer += data
        while len(buffer) >= 3 and len(buffer) >= struct.unpack(">H", buffer[:2])[0]:
            size = struct.unpack(">H", buffer[:2])[0]
            yield chr(buffer[2]), buffer[3:size]
            buffer = buffer[size:]


def talk_rtde(line: socket.socket, robot: Robot) -> None:
    names: list[bytes] = []

    def send(kind: str, body: bytes) -> None:
        line.sendall(struct.pack(">HB", 3 + len(body), ord(kind)) + body)

    def stream(period: float) -> None:
        while True:
            if not robot.mute:
                fields = b"".join(struct.pack(">" + FORMATS[TYPES[name]], *robot.values(name)) for name in names)
                try:
                    send("U", b"\x01" + fields)
                except OSError:
                    return
            time.sleep(period)

    period = 0.008
    for kind, body in packages(line):
        if kind == "V":
            send("V", bytes([struct.unpack(">H", body)[0] == 2]))
        elif kind == "v":
            send("v", struct.pack(">IIII", 5, 11, 1, 0))
        elif kind == "O":
            period = 1.0 / struct.unpack(">d", body[:8])[0]
            names = [name for name in body[8:].split(b",") if name]
            send("O", b"\x01" + ",".join(TYPES.get(name, "NOT_FOUND") for name in names).encode())
        elif kind == "S":
            send("S", b"\x01")
            threading.Thread(target=stream, args=(period,), daemon=True).start()
        elif kind == "P":
            send("P", b"\x01")


def talk_script(line: socket.socket, robot: Robot) -> None:
    text = ""
    while data := line.recv(4096):
        text += data.decode("ascii")
        while "end\n" in text:
            program, text = text.split("end\n", 1)
            robot.script(program)


def serve(address: str, port: int, talk, robot: Robot) -> None:  # type: ignore[no-untyped-def]
    listener = socket.create_server((address, port))

    def one(line: socket.socket) -> None:
        try:
            talk(line, robot)
        except OSError:
            line.close()

    def accept() -> None:
        while True:
            line, _ = listener.accept()
            threading.Thread(target=one, args=(line,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()


if __name__ == "__main__":
    robot = Robot()
    serve(sys.argv[1], 30004, talk_rtde, robot)
    serve(sys.argv[1], 30002, talk_script, robot)
    print("ready", flush=True)
    for order in sys.stdin:
        word, *rest = order.split()
        if word in ("safety", "robot"):
            setattr(robot, {"safety": "safety", "robot": "mode"}[word], int(rest[0]))
        else:
            setattr(robot, word, True)
        print("done", flush=True)
