"""What the stand-ins of the makers' packages were told, one JSON line a call, for the tests to read."""

import json
import os


def note(call, *values):
    """Write down one call."""
    with open(os.environ["STAND_IN_JOURNAL"], "a", encoding="utf-8") as journal:
        journal.write(json.dumps([call, *values]) + "\n")


def fault(name):
    """Whether the test has ordered this fault."""
    return name in os.environ.get("STAND_IN_FAULTS", "").split(",")
