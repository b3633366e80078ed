"""Why a node cannot be used, and what to do about it."""

from __future__ import annotations

from collections.abc import Collection

from surfuse.errors import DeviceError
from surfuse.node.counters import BusCounters

_WIRING = "check power, wiring, bitrate and id; see `surfuse devices`"


def two_nodes(node: int, boards: Collection[int]) -> DeviceError:
    """Two boards with one address: no number says whose it is."""
    heard = ", ".join(map(str, sorted(boards)))
    return _lost(node, f"two nodes answer under this id (boards heard: {heard})", "give each node an id of its own")


def no_adapter(node: int, counts: BusCounters) -> DeviceError:
    """The adapter has gone."""
    what = f"the CAN adapter takes no frames ({counts.send_errors} not sent, opened anew {counts.reopened} times)"
    return _lost(node, what, "plug it in again; see `surfuse devices`")


def no_heartbeat(node: int, counts: BusCounters, waited_s: float) -> DeviceError:
    """No node has ever been heard."""
    what = f"no heartbeat within {waited_s:g} s ({counts.foreign} frames of others)"
    return _lost(node, what, f"start the node (`surfuse node`); {_WIRING}")


def no_answer(node: int, counts: BusCounters) -> DeviceError:
    """The node was there, and its answers are gone or useless."""
    what = (
        f"no trustworthy answer ({counts.frames} frames received, {counts.unanswered} triggers unanswered, "
        f"{counts.refused} sensors refused, {counts.conflicts} conflicts, {counts.restarts} restarts, "
        f"{counts.receive_errors} receive errors)"
    )
    return _lost(node, what, _WIRING)


def _lost(node: int, what: str, cure: str) -> DeviceError:
    return DeviceError(what, cure=cure, where=f"sensor node {node}")
