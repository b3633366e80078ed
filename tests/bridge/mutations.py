"""Damaged answers of a bridge, and what a client may make of them.

Each case asks for a state, which is answered well, then one question whose first answer is damaged (or it is the
greeting that is damaged); if that is asked again, the answer is good. The client may end with an error of surfuse. It
may give the values of the good answer. It may give the values of the damaged line only when that is still a valid
answer for a reader that is not ours (plain `json.loads` and the rules below): a number that was exchanged for another
valid one cannot be noticed by anybody.
"""

from __future__ import annotations

import base64
import contextlib
import copy
import json
import math
import random
import socket
import threading
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scripted_bridge import CLOSE, HALF_CLOSE, HELLO, POSE, good

from surfuse.bridge.client import BridgeClient
from surfuse.bridge.messages import MoveTo
from surfuse.bridge.patience import Patience
from surfuse.bridge.transport import TcpTransport
from surfuse.errors import SurfuseError
from surfuse.records import Status

START_S = 1000.0
TARGET = [*POSE[:3], 0.25, *POSE[4:]]
HURRIED = Patience(0.02, 0.02, 0.02, 0.02, 0.02, start_timeout_s=5.0, give_up_s=0.03)
ASKS = ("hello", "state", "sweep", "move", "reach", "image")
ODD = (
    *(None, True, False, 0, -1, -0.0, 1e-320, 1e308, -1e308, 2**53 + 1, 10**30, 0.5, 999.0, 1000.5, math.nan),
    *(math.inf, -math.inf, "", "0.5", "ok", "no_echo", "fault", "us0", "us1", "us2", "\x1b[2J\u202e", [], [0.5], {}),
    *([[[]]], {"range_m": 0.5}, "AAAAAA==", "AA A", "x" * 3000),
)


@dataclass(frozen=True)
class Case:
    """One question, and the pieces that are sent as its first answer."""

    ask: str
    kind: str
    pieces: tuple[object, ...]

    @property
    def line(self):
        """The damaged line, when it is whole."""
        stream = b"".join(piece for piece in self.pieces if isinstance(piece, bytes))
        return stream.split(b"\n")[0] if b"\n" in stream else None


def rich_answer(question):
    """A good answer with every optional field."""
    answer = copy.deepcopy(good(question, START_S))
    if question["do"] == "hello":
        answer.update(copy.deepcopy(HELLO))
    if question["do"] == "sweep":
        samples = base64.b64encode(np.linspace(0, 1, 5, dtype="<f4").tobytes()).decode()
        for i, reading in enumerate(answer["readings"]):
            reading["range_m"] = 0.5 + 0.125 * i
            reading.update(amplitude=0.75, sigma_m=0.0003, echoes=[{"range_m": 0.5, "amplitude": 1.0}])
            reading["envelope"] = {"range0_m": 0.1, "bin_m": 0.001, "float32": samples}
    return answer


def places(value, path=()):
    """Paths of all values inside, containers too."""
    found = [path] if path else []
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        found += places(item, (*path, key))
    return found


def at(value, path):
    for key in path:
        value = value[key]
    return value


def odd(dice):
    """A value that may not belong there."""
    return copy.deepcopy(dice.choice(ODD))


def put(value, path, new):
    at(value, path[:-1])[path[-1]] = new


def damaged_object(answer, dice):
    """The line of an answer with one or two changes of its values or keys."""
    for _ in range(dice.choice((1, 1, 1, 2))):
        path = dice.choice(places(answer))
        parent, key = at(answer, path[:-1]), path[-1]
        match dice.randrange(7):
            case 0:
                put(answer, path, odd(dice))
            case 1:
                del parent[key]
            case 2:
                other = dice.choice(places(answer))
                here, there = at(answer, path), at(answer, other)
                if path[: len(other)] != other and other[: len(path)] != path:
                    put(answer, path, there)
                    put(answer, other, here)
            case 3:
                value = at(answer, path)
                if isinstance(value, int | float) and not isinstance(value, bool):
                    put(answer, path, dice.choice((-value, value + 1, value * 1.000002, value - 1e-3, value * 1e3)))
            case 4:
                answer["id"] = dice.choice((0, -1, 1, 2, answer.get("id"), 4, 10**6, "3", None, 3.0, True))
            case 5 if isinstance(parent, list):
                parent.insert(dice.randrange(len(parent) + 1), at(answer, path))
            case _:
                answer[dice.choice(("do", "kind", "error", "t_s", "x"))] = odd(dice)
        if not places(answer):
            break
    return json.dumps(answer).encode() + b"\n"


def damaged_bytes(line, dice):
    """The line with one kind of damage to its bytes."""
    i, j = sorted((dice.randrange(len(line)), dice.randrange(len(line))))
    some = bytes(dice.randrange(256) for _ in range(dice.randrange(1, 6)))
    match dice.randrange(8):
        case 0:
            return line[:i] + bytes([line[i] ^ 1 << dice.randrange(8)]) + line[i + 1 :]
        case 1:
            return line[:i] + line[j:]
        case 2:
            return line[:i] + some + line[i:]
        case 3:
            return line[:i] + line[i:j] + line[i:]
        case 4:
            return line[:i] + b"\n"
        case 5:
            return line[:i] + bytes([dice.choice(b'0123456789.,:eE+-[]{}" \\')]) + line[i + 1 :]
        case 6:
            return line.replace(b'"ok": true', b'"ok": true, "ok": ' + dice.choice((b"true", b"false", b"1")))
        case _:
            return bytes(dice.randrange(256) for _ in range(dice.randrange(40))) + b"\n"


def damaged_stream(line, dice, flood_bytes):
    """Pieces that are right, wrong, late or missing as a stream."""
    i = dice.randrange(len(line))
    match dice.randrange(10):
        case 0:
            return (None,)
        case 1:
            return (line[:i], CLOSE)
        case 2:
            return (line[:i], HALF_CLOSE)
        case 3:
            return (line[:i],)
        case 4:
            return (line[:i], line[i:])
        case 5:
            return (line[:i] + b"\n" + line,)
        case 6:
            return (b"\n\r\n  \n" + line,)
        case 7:
            return (line + line,)
        case 8:
            return (b"[" * 30_000 + b"\n",)
        case _:
            return (*[b"9" * 2**16] * (flood_bytes // 2**16), b"\n") if dice.random() < 0.05 else (CLOSE,)


def make_case(dice, flood_bytes):
    """One case of damage."""
    ask = dice.choice(ASKS)
    answer = rich_answer(question_of(ask))
    line = json.dumps(answer).encode() + b"\n"
    kind = dice.choices(("values", "bytes", "stream"), (6, 3, 1))[0]
    if kind == "values":
        return Case(ask, kind, (damaged_object(answer, dice),))
    if kind == "bytes":
        return Case(ask, kind, (damaged_bytes(line, dice),))
    return Case(ask, kind, damaged_stream(line, dice, flood_bytes))


def question_of(ask):
    """The third question of a conversation: after hello and state."""
    more = {"move": {"world_from_tool": TARGET}, "reach": {"world_from_tool": [POSE, TARGET]}}
    return {"id": 1 if ask == "hello" else 3, "do": ask, **more.get(ask, {})}


class DamagedBridge:
    """Answers well, but for one answer of the case at hand."""

    def __enter__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._case, self._asked = None, 0
        threading.Thread(target=self._serve, daemon=True).start()
        return self

    def __exit__(self, *error):
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def begin(self, case):
        self._case, self._asked = case, 0

    def _serve(self):
        while True:
            try:
                line, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._talk, args=(line, self._case), daemon=True).start()

    def _talk(self, line, case):
        with line, contextlib.suppress(OSError), line.makefile("rb") as questions:
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for text in questions:
                question = json.loads(text)
                pieces = self._pieces(question, case)
                for piece in pieces:
                    if piece is CLOSE:
                        return
                    if piece is HALF_CLOSE:
                        line.shutdown(socket.SHUT_WR)
                    elif piece is not None:
                        line.sendall(piece)

    def _pieces(self, question, case):
        self._asked += question["do"] == case.ask
        if self._asked == (2 if case.ask == "state" else 1) and question["do"] == case.ask:
            self._asked += 10
            return case.pieces
        return [json.dumps(rich_answer(question)).encode() + b"\n"]


def values_of(ask, result):
    """What the client gave, in plain values."""
    match ask:
        case "hello":
            arm, camera = result.arm, result.camera
            return {
                "arm": None if arm is None else (arm.kind.value, arm.joints),
                "sensors": list(result.sensors),
                "camera": None if camera is None else (camera.width_px, camera.height_px),
                "can": {ability.value for ability in result.can},
            }
        case "state" | "move":
            return {"t_s": result.t_s, "world_from_tool": result.world_from_tool.ravel().tolist()}
        case "sweep":
            return {"readings": [_reading_values(reading) for reading in result.readings]}
        case "reach":
            return {"reachable": result.tolist()}
        case _:
            return {"t_s": result.t_s, "size": result.grey.shape[::-1], "bytes": result.grey.tobytes()}


def _reading_values(reading):
    envelope = reading.envelope
    return {
        "sensor": reading.sensor,
        "t_s": reading.t_s,
        "status": reading.status.name.lower(),
        "range_m": reading.range_m if reading.status is Status.OK else None,
        "amplitude": None if math.isnan(reading.amplitude) else reading.amplitude,
        "sigma_m": None if math.isnan(reading.sigma_m) else reading.sigma_m,
        "echoes": [list(echo) for echo in reading.echoes],
        "envelope": None if envelope is None else (envelope.range0_m, envelope.bin_m, envelope.values.tobytes()),
    }


def allowed_of(ask, line):
    """What the damaged line says to a reader that is not ours; None if it is no valid answer."""
    try:
        answer = json.loads(line.decode(), object_pairs_hook=_no_twins, parse_constant=_no_constant)
        assert type(answer["id"]) is int
        assert answer["id"] == question_of(ask)["id"]
        assert answer["ok"] is True
        return _PLAIN[ask](answer)
    except (AssertionError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None


def _no_twins(pairs):
    assert len(dict(pairs)) == len(pairs)
    return dict(pairs)


def _no_constant(name):
    raise ValueError(name)


def _plain_number(value, least=-math.inf):
    assert type(value) in (int, float)
    assert math.isfinite(value)
    assert value >= least
    return float(value)


def _plain_state(answer, near):
    pose = [_plain_number(value) for value in answer["world_from_tool"]]
    assert len(pose) == 16
    assert type(answer["world_from_tool"]) is list
    rotation = np.array(pose).reshape(4, 4)[:3, :3]
    assert np.abs(rotation).max() < 1.1
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1.1e-6
    assert np.linalg.det(rotation) > 0
    assert max(abs(a - b) for a, b in zip(pose[12:], [0, 0, 0, 1], strict=True)) < 1.1e-6
    assert max(abs(a - b) for a, b in zip(pose[3:12:4], near[3:12:4], strict=True)) <= 0.0051
    assert max(abs(a - b) for a, b in zip(pose[:12], near[:12], strict=True)) < 0.031
    pose[12:] = [0.0, 0.0, 0.0, 1.0]
    return {"t_s": _plain_time(answer), "world_from_tool": pose}


def _plain_time(answer):
    return _plain_number(answer["t_s"], START_S - 0.0011)


def _plain_sweep(answer):
    assert type(answer["readings"]) is list
    readings = [_plain_reading(reading) for reading in answer["readings"]]
    names = [reading["sensor"] for reading in readings]
    assert len(set(names)) == len(names)
    assert set(names) <= {"us0", "us1"}
    return {"readings": sorted(readings, key=lambda reading: reading["sensor"])}


def _plain_reading(reading):
    optional = {key: reading.get(key) for key in ("amplitude", "sigma_m", "echoes", "envelope")}
    assert reading["status"] in ("ok", "no_echo", "too_close", "fault")
    assert (reading["range_m"] is None) == (reading["status"] != "ok")
    envelope = optional["envelope"]
    if envelope is not None:
        samples = base64.b64decode(envelope["float32"], validate=True)
        assert np.isfinite(np.frombuffer(samples, "<f4")).all()
        assert samples
        assert envelope["bin_m"] > 0
        envelope = (_plain_number(envelope["range0_m"]), _plain_number(envelope["bin_m"]), samples)
    echoes = optional["echoes"] or []
    assert type(echoes) is list
    return {
        "sensor": reading["sensor"],
        "t_s": _plain_time(reading),
        "status": reading["status"],
        "range_m": None if reading["range_m"] is None else _plain_number(reading["range_m"], 0.0),
        "amplitude": None if optional["amplitude"] is None else _plain_number(optional["amplitude"], 0.0),
        "sigma_m": None if optional["sigma_m"] is None else _plain_number(optional["sigma_m"], 5e-324),
        "echoes": [[_plain_number(echo["range_m"], 0.0), _plain_number(echo["amplitude"], 0.0)] for echo in echoes],
        "envelope": envelope,
    }


def _plain_reach(answer):
    flags = answer["reachable"]
    assert type(flags) is list
    assert [type(flag) for flag in flags] == [bool, bool]
    return {"reachable": flags}


def _plain_image(answer):
    assert (answer["width"], answer["height"]) == (4, 3)
    data = base64.b64decode(answer["gray8"], validate=True)
    assert len(data) == 12
    return {"t_s": _plain_time(answer), "size": (4, 3), "bytes": data}


def _plain_hello(answer):
    arm, camera, sensors, can = answer["arm"], answer.get("camera"), answer["sensors"], answer.get("can") or []
    assert (type(answer["protocol"]), answer["protocol"]) == (int, 1)
    assert type(answer["name"]) is str
    if arm is not None:
        joints = arm["joints"] if arm["kind"] == "joints" else 0
        assert arm["kind"] in ("joints", "cartesian")
        assert type(joints) is int
        arm = (arm["kind"], joints)
    if camera is not None:
        assert {type(camera["width"]), type(camera["height"])} == {int}
        assert min(camera["width"], camera["height"]) > 0
        camera = (camera["width"], camera["height"])
    assert type(sensors) is list
    assert type(can) is list
    assert all(type(name) is str and 0 < len(name) <= 64 and name.isprintable() for name in sensors)
    assert len(set(sensors)) == len(sensors)
    return {"arm": arm, "sensors": sensors, "camera": camera, "can": {*can} & {*HELLO["can"]}}


_PLAIN = {
    "hello": _plain_hello,
    "state": lambda answer: _plain_state(answer, POSE),
    "move": lambda answer: _plain_state(answer, TARGET),
    "sweep": _plain_sweep,
    "reach": _plain_reach,
    "image": _plain_image,
}


@dataclass
class Findings:
    """What became of the cases."""

    outcomes: Counter
    wrong: list
    crashes: list
    slowest_s: float = 0.0


def fuzz(cases, seed, flood_bytes=4 * 2**20):
    """Run so many cases."""
    dice = random.Random(seed)
    findings = Findings(Counter(), [], [])
    good_values = {ask: allowed_of(ask, json.dumps(rich_answer(question_of(ask))).encode()) for ask in ASKS}
    with DamagedBridge() as bridge:
        for _ in range(cases):
            case = make_case(dice, flood_bytes)
            bridge.begin(case)
            began_s = time.monotonic()
            _run(bridge, case, good_values[case.ask], findings)
            findings.slowest_s = max(findings.slowest_s, time.monotonic() - began_s)
    return findings


def _run(bridge, case, good_value, findings):
    try:
        with BridgeClient(TcpTransport(bridge.address), HURRIED) as client:
            if case.ask != "hello":
                client.state()
            value = values_of(case.ask, _asked(client, case.ask))
    except SurfuseError as error:
        findings.outcomes[f"{case.kind}: {type(error).__name__}"] += 1
        return
    except Exception as error:
        findings.crashes.append((case, repr(error)))
        return
    said = None if case.line is None else allowed_of(case.ask, case.line)
    if value == good_value:
        findings.outcomes[f"{case.kind}: good answer"] += 1
    elif said is not None and value == said:
        findings.outcomes[f"{case.kind}: another valid answer"] += 1
    else:
        findings.wrong.append((case, value))


def _asked(client, ask):
    match ask:
        case "hello":
            return client.hello
        case "move":
            return client.move(MoveTo(world_from_tool=np.array(TARGET).reshape(4, 4)))
        case "reach":
            return client.reach(np.array([POSE, TARGET]).reshape(2, 4, 4))
        case _:
            return getattr(client, ask)()
