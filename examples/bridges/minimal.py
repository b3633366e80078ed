"""A whole bridge in plain Python: a pretended gantry with one sensor that looks at a tilted plane.

Run: python minimal.py 5005 (it listens on 127.0.0.1), or without a number as `command` in the cell file.
Checked with surfuse's own client; there is no hardware behind it. Put your robot into `move`, your sensor into `sweep`.
"""

import json
import socket
import sys
import time

pose = [1, 0, 0, 0.0, 0, -1, 0, 0.0, 0, 0, -1, 0.5, 0, 0, 0, 1]  # row by row; the third column looks down
HELLO = {"protocol": 1, "name": "minimal", "arm": {"kind": "cartesian"}, "sensors": ["us0"], "camera": None, "can": []}


def state(ask):
    return {"t_s": time.monotonic(), "world_from_tool": pose}


def move(ask):
    target = ask["world_from_tool"]
    if max(abs(target[3]), abs(target[7])) > 1.0:
        return {"ok": False, "kind": "unreachable", "error": "the gantry is 2 m wide"}
    pose[:] = target  # drive there, wait until it stands still
    return state(ask)


def sweep(ask):
    range_m = (pose[11] - 0.1 * pose[3]) / max(-pose[10] + 0.1 * pose[2], 1e-9)  # along the beam to z = 0.1 x
    return {"readings": [{"sensor": "us0", "t_s": time.monotonic(), "range_m": range_m, "status": "ok"}]}


questions, answers = sys.stdin, sys.stdout
if len(sys.argv) > 1:
    line, _ = socket.create_server(("127.0.0.1", int(sys.argv[1]))).accept()
    questions, answers = line.makefile("r", encoding="utf-8"), line.makefile("w", encoding="utf-8")
do = {"hello": lambda ask: HELLO, "state": state, "move": move, "sweep": sweep, "bye": lambda ask: {}}
for text in questions:
    ask = json.loads(text)
    known = do.get(ask["do"], lambda ask: {"ok": False, "kind": "usage", "error": "no such question"})
    print(json.dumps({"id": ask["id"], "ok": True, **known(ask)}), file=answers, flush=True)
