"""A bridge that answers by a script: raw bytes, silence, a closed line, whatever a broken program may do."""

from __future__ import annotations

import contextlib
import json
import socket
import threading

HELLO = {
    "protocol": 1,
    "name": "scripted",
    "arm": {"kind": "cartesian"},
    "sensors": ["us0", "us1"],
    "camera": {"width": 4, "height": 3},
    "can": ["reach", "stop", "echoes", "envelope", "image"],
}
POSE = [1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.5, 0.0, 0.0, 0.0, 1.0]
CLOSE = object()  # the line is closed
HALF_CLOSE = object()  # only its own direction: the socket still reads


class ScriptedBridge:
    """Greets as told, then hands each question to `answer(question)`, which gives bytes, a dict, CLOSE, or a list."""

    def __init__(self, answer, hello=HELLO):
        self._answer, self._hello = answer, hello
        self.questions = []

    def __enter__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._closing, self._line = False, None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._closing = True
        for line in (self._listener, self._line):
            if line is not None:
                with contextlib.suppress(OSError):
                    line.shutdown(socket.SHUT_RDWR)
                line.close()
        self._thread.join(10.0)
        assert not self._thread.is_alive()

    def _serve(self):
        while not self._closing:
            try:
                self._line, _ = self._listener.accept()
            except OSError:
                return
            with self._line, contextlib.suppress(OSError), self._line.makefile("rb") as questions:
                for text in questions:
                    if not self._respond(json.loads(text)):
                        break

    def _respond(self, question):
        """Whether the line stays open."""
        self.questions.append(question)
        if question["do"] == "hello":
            answer = {"id": question["id"], "ok": True, **self._hello} if isinstance(self._hello, dict) else self._hello
        else:
            answer = self._answer(question)
        for part in answer if isinstance(answer, list) else [answer]:
            if part is CLOSE:
                return False
            if part is HALF_CLOSE:
                self._line.shutdown(socket.SHUT_WR)
            elif part is not None:
                self._line.sendall(json.dumps(part).encode() + b"\n" if isinstance(part, dict) else part)
        return True


def good(question, t_s=1.0):
    """The right answer to any question."""
    answer = {"id": question["id"], "ok": True}
    match question["do"]:
        case "state" | "stop":
            return {**answer, "t_s": t_s, "world_from_tool": POSE}
        case "move":
            return {**answer, "t_s": t_s, "world_from_tool": question.get("world_from_tool", POSE)}
        case "reach":
            return {**answer, "reachable": [True] * len(question["world_from_tool"])}
        case "sweep":
            names = question.get("sensors", ["us0", "us1"])
            readings = [{"sensor": name, "t_s": t_s, "range_m": 0.5, "status": "ok"} for name in names]
            return {**answer, "readings": readings}
        case "image":
            return {**answer, "t_s": t_s, "width": 4, "height": 3, "gray8": "AAECAwQFBgcICQoL"}
        case _:
            return answer
