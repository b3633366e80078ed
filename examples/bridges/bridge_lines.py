"""The loop that the bridges of this folder share: questions in, answers out, one JSON object a line.

Import it before the maker's package: some of them print while they are imported.
"""

import json
import socket
import sys
import threading

_writing = threading.Lock()
_answers, sys.stdout = sys.stdout, sys.stderr  # what a library prints must not stand between the answers


class RefusedError(Exception):
    """A kind of the protocol (unreachable, safety, device, usage) and one sentence."""


def serve(do, port=None):
    """Answer until surfuse closes: on standard input and output, or for one client of a port of this machine.

    `do` holds a function for each word after "do"; it gets the question and gives the fields of the answer.
    """
    if port is None:
        _answer_all(do, sys.stdin, _answers)
        return
    with socket.create_server(("127.0.0.1", port)) as listener:
        line, _ = listener.accept()
    with line, line.makefile("r", encoding="utf-8") as questions, line.makefile("w", encoding="utf-8") as answers:
        _answer_all(do, questions, answers)


def _answer_all(do, questions, answers):
    """Moves have a thread of their own, so that a `stop` is heard meanwhile."""
    mover = None
    for text in questions:
        ask = json.loads(text)
        if ask["do"] == "move":
            mover = threading.Thread(target=_answer, args=(do, ask, answers))
            mover.start()
        else:
            _answer(do, ask, answers)
    if mover is not None and mover.is_alive() and "stop" in do:
        do["stop"]({})  # surfuse has gone, nobody watches the arm


def _answer(do, ask, answers):
    try:
        fields = {"ok": True, **do[ask["do"]](ask)}
    except RefusedError as why:
        fields = {"ok": False, "kind": why.args[0], "error": why.args[1]}
    except Exception as error:
        kind = "usage" if isinstance(error, KeyError) else "device"
        fields = {"ok": False, "kind": kind, "error": f"{type(error).__name__}: {error}"}
    with _writing:  # the answers to a move and to a stop must not run into each other
        answers.write(json.dumps({"id": ask["id"], **fields}) + "\n")
        answers.flush()
