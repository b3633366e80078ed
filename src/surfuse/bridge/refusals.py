"""`"ok": false` on the wire, and the errors of surfuse that it stands for on both sides."""

from __future__ import annotations

from surfuse.bridge.fields import Fields
from surfuse.bridge.messages import Question, Refusal
from surfuse.bridge.strict_json import Json, cleaned, in_a_sentence, shown
from surfuse.errors import (
    ConfigError,
    DataError,
    DeviceError,
    SafetyStopError,
    SurfuseError,
    UnreachableError,
    UsageError,
)

_REFUSALS = {refusal.value: refusal for refusal in Refusal}
_LONGEST_TEXT = 300


class RefusedError(DeviceError):
    """The bridge says that its device failed, or that it cannot do what was asked."""


class GarbledError(DeviceError):
    """An answer that makes no sense."""


def no_bridge(line: bytes, where: str) -> DeviceError:
    """Another program answers where the bridge was looked for, with this line."""
    return DeviceError(
        f"what answers there is no bridge: it said {shown(line)}",
        where=where,
        cure="check the port: something else listens there; start the bridge on a port of its own",
    )


def error_of(answer: Fields, question: Question, where: str) -> SurfuseError:
    """The error that a refusal stands for, with the cleaned words of the bridge.

    Raises
    ------
    DataError : the refusal itself does not follow the protocol.
    """
    kind = answer.word("kind", _REFUSALS)
    said = in_a_sentence(answer.text("error"), _LONGEST_TEXT) or "no reason given"
    what = f"the bridge refuses '{question.value}': {said}"
    match kind:
        case Refusal.UNREACHABLE:
            return UnreachableError(what, where=where, cure="move the area nearer to the arm")
        case Refusal.SAFETY:
            return SafetyStopError(what, where=where, cure="clear the cause at the robot")
        case Refusal.USAGE:
            return RefusedError(what, where=where, cure="compare the bridge with the protocol")
        case Refusal.DEVICE:
            return RefusedError(what, where=where, cure="check the device behind the bridge")


def refusal_of(error: SurfuseError) -> dict[str, Json]:
    """An error of ours as fields of an answer."""
    match error:
        case UnreachableError():
            kind = Refusal.UNREACHABLE
        case SafetyStopError():
            kind = Refusal.SAFETY
        case UsageError() | ConfigError() | DataError():
            kind = Refusal.USAGE
        case _:
            kind = Refusal.DEVICE
    return refused(kind, str(error))


def refused(kind: Refusal, text: str) -> dict[str, Json]:
    """A refusal as fields of an answer."""
    return {"ok": False, "kind": kind.value, "error": cleaned(text, _LONGEST_TEXT)}
