"""A bridge whose arm is moved by somebody else, over the plane z = 0.4 x, in a time of its own: 50 ms a question.

Run: python moving_bridge.py [dies N] [waits S] [shakes] [deaf] [guided] - `dies` ends at question N, `waits` takes S
seconds of real time a sweep, `shakes` throws the tool about, with `deaf` 'us1' hears nothing, `guided` is an arm that
surfuse could move, too.
"""

import json
import math
import sys
import time

SLOPE = 0.4
STEP_S = 0.05
LATE_S = 0.03  # so much later than its stamp 'us1' reads
PLACES = {"us0": -0.02, "us1": 0.02}  # along x of the tool
SENSORS = list(PLACES)


def number(name, usual):
    return float(sys.argv[sys.argv.index(name) + 1]) if name in sys.argv else usual


def pose(t_s):
    """The tool: to and fro along x, slowly along y, nodding about y; it looks down."""
    x, y = 0.05 * math.sin(2.0 * math.pi * t_s / 4.0), 0.003 * t_s - 0.03
    if "shakes" in sys.argv:
        x = 0.3 * (-1.0) ** round(t_s / STEP_S // 2)
    nod = 0.05 * math.sin(2.0 * math.pi * t_s / 5.0)
    c, s = math.cos(nod), math.sin(nod)
    return [c, 0, -s, x, 0, -1, 0, y, -s, 0, -c, 0.4, 0, 0, 0, 1]


def range_of(name, t_s):
    """Along the beam to the plane z = SLOPE x."""
    place = pose(t_s)
    x = place[3] + PLACES[name] * place[0]
    z = place[11] + PLACES[name] * place[8]
    return (z - SLOPE * x) / (SLOPE * place[2] - place[10])


def main():
    t_s, last = 0.0, number("dies", math.inf)
    deaf = ("us1",) if "deaf" in sys.argv else ()
    arm = {"kind": "cartesian"} if "guided" in sys.argv else None
    for count, text in enumerate(sys.stdin):
        if count >= last:
            sys.exit(7)
        ask = json.loads(text)
        answer = {"id": ask["id"], "ok": True}
        t_s += STEP_S
        if ask["do"] == "hello":
            answer |= {"protocol": 1, "name": "moving", "arm": arm, "sensors": SENSORS, "camera": None, "can": []}
        elif ask["do"] == "state":
            answer |= {"t_s": t_s, "world_from_tool": pose(t_s)}
        elif ask["do"] == "sweep":
            time.sleep(number("waits", 0.0))
            taken = {"us0": t_s, "us1": t_s + 0.01}
            late = {"us0": 0.0, "us1": LATE_S}
            answer["readings"] = [
                {
                    "sensor": name,
                    "t_s": taken[name],
                    "range_m": range_of(name, taken[name] + late[name]),
                    "status": "ok",
                }
                if name not in deaf
                else {"sensor": name, "t_s": taken[name], "range_m": None, "status": "no_echo"}
                for name in ask.get("sensors", SENSORS)
            ]
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
