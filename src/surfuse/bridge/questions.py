"""Questions of surfuse: records to JSON objects and back, for both ends of the bridge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from surfuse.bridge.answers import row_major
from surfuse.bridge.fields import Fields, pose_of, text_of
from surfuse.bridge.messages import MoveTo, Question
from surfuse.bridge.strict_json import Json, cleaned
from surfuse.errors import DataError, nearest
from surfuse.records import FloatArray

_WORDS = {question.value: question for question in Question}


def encode_question(number: int, question: Question, fields: Mapping[str, Json]) -> dict[str, Json]:
    """A whole question."""
    return {"id": number, "do": question.value, **fields}


def decode_kind(fields: Fields) -> Question:
    """What is asked for.

    Raises
    ------
    DataError : no question of the protocol. So do all others here.
    """
    word = fields.text("do")
    if word not in _WORDS:
        raise DataError(f"unknown question '{cleaned(word, 40)}'", cure=nearest(word[:40], _WORDS))
    return _WORDS[word]


def encode_reach(world_from_tool: FloatArray) -> dict[str, Json]:
    """Poses (N, 4, 4) whose reach is asked for."""
    return {"world_from_tool": [row_major(pose) for pose in world_from_tool]}


def decode_reach(fields: Fields) -> FloatArray:
    """Poses (N, 4, 4)."""
    return np.array(fields.each("world_from_tool", pose_of)).reshape(-1, 4, 4)


def encode_move(to: MoveTo) -> dict[str, Json]:
    """A target, and the share of the speed when one is said."""
    fields: dict[str, Json] = {}
    if to.world_from_tool is not None:
        fields["world_from_tool"] = row_major(to.world_from_tool)
    if to.joints_rad is not None:
        fields["joints_rad"] = to.joints_rad.tolist()
    if to.speed_share is not None:
        fields["speed_share"] = to.speed_share
    return fields


def decode_move(fields: Fields) -> MoveTo:
    """A target: a pose or joints."""
    return MoveTo(
        world_from_tool=fields.pose("world_from_tool") if fields.has("world_from_tool") else None,
        joints_rad=fields.numbers("joints_rad") if fields.has("joints_rad") else None,
        speed_share=fields.number("speed_share") if fields.has("speed_share") else None,
    )


def encode_sweep(sensors: tuple[str, ...] | None) -> dict[str, Json]:
    """The sensors to fire (None: all)."""
    return {} if sensors is None else {"sensors": list(sensors)}


def decode_sweep(fields: Fields, known: tuple[str, ...]) -> tuple[str, ...]:
    """The sensors to fire, each one that exists."""
    if not fields.has("sensors"):
        return known
    asked = fields.each("sensors", text_of)
    for name in asked:
        if name not in known:
            raise DataError(f"there is no sensor '{cleaned(name, 40)}'", cure=nearest(name[:40], known))
    if len(set(asked)) != len(asked):
        raise DataError("a sensor stands twice in 'sensors'", cure="name each once")
    return asked
