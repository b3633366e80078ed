"""Answers of a bridge: JSON objects to records and back, every field checked."""

from __future__ import annotations

import base64
import binascii
import itertools
import math
from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from surfuse.bridge.fields import Fields, fields_of, flag_of, number_of, text_of
from surfuse.bridge.messages import (
    MOST_JOINTS,
    MOST_PIXELS,
    MOST_SENSORS,
    PROTOCOL_VERSION,
    Ability,
    ArmKind,
    ArmOfBridge,
    BridgeReading,
    CameraOfBridge,
    Envelope,
    Hello,
    Image,
    Reach,
    State,
    SweepAnswer,
)
from surfuse.bridge.strict_json import Json, cleaned
from surfuse.errors import DataError, DeviceError
from surfuse.records import FloatArray, Status

LONGEST_NAME = 64
_STATUS_WORDS = {
    "ok": Status.OK,
    "no_echo": Status.NO_ECHO,
    "too_close": Status.TOO_CLOSE,
    "fault": Status.FAULT,
}
_WORD_OF = {status: word for word, status in _STATUS_WORDS.items()}
_RANGE_OF = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}
_ARM_KINDS = {kind.value: kind for kind in ArmKind}
_ABILITIES = {ability.value: ability for ability in Ability}


def encode_hello(hello: Hello) -> dict[str, Json]:
    """What is behind the bridge, as fields of an answer."""
    arm, camera = hello.arm, hello.camera
    arm_fields: Json = None
    if arm is not None:
        arm_fields = {"kind": arm.kind.value, "joints": arm.joints} if arm.joints else {"kind": arm.kind.value}
    size: Json = None if camera is None else {"width": camera.width_px, "height": camera.height_px}
    return {
        "protocol": hello.protocol,
        "name": hello.name,
        "arm": arm_fields,
        "sensors": list(hello.sensors),
        "camera": size,
        "can": sorted(ability.value for ability in hello.can),
    }


def decode_hello(answer: Fields) -> Hello:
    """What is behind the bridge; abilities that this version does not know are passed over.

    Raises
    ------
    DeviceError : another version of the protocol.
    DataError : a field that does not fit. So do all others here.
    """
    version = answer.whole("protocol")
    if version != PROTOCOL_VERSION:
        raise DeviceError(
            f"the bridge speaks protocol {version}, this surfuse speaks {PROTOCOL_VERSION}",
            cure="bring both to the same version",
        )
    sensors = answer.each("sensors", _name_of)
    if len(sensors) > MOST_SENSORS:
        raise DataError(f"{len(sensors)} sensors, at most {MOST_SENSORS}")
    _refuse_twins(sensors, "'sensors'")
    words = answer.each("can", text_of) if answer.has("can") else ()
    return Hello(
        name=cleaned(answer.text("name"), LONGEST_NAME) or "bridge",
        arm=_arm_of(answer.inner("arm")) if answer.value("arm") is not None else None,
        sensors=sensors,
        camera=_camera_of(answer.inner("camera")) if answer.has("camera") else None,
        can=frozenset(_ABILITIES[word] for word in words if word in _ABILITIES),
    )


def encode_state(state: State) -> dict[str, Json]:
    """Where the arm is."""
    fields: dict[str, Json] = {"t_s": state.t_s}
    if state.world_from_tool is not None:
        fields["world_from_tool"] = row_major(state.world_from_tool)
    if state.joints_rad is not None:
        fields["joints_rad"] = state.joints_rad.tolist()
    return fields


def decode_state(answer: Fields, arm: ArmOfBridge | None) -> State:
    """Where the arm is: a cartesian one by its pose, others by a pose or by all their joints."""
    pose = answer.pose("world_from_tool") if answer.has("world_from_tool") else None
    joints = answer.numbers("joints_rad") if answer.has("joints_rad") else None
    cartesian = arm is not None and arm.kind is ArmKind.CARTESIAN
    if pose is None and (joints is None or cartesian):
        answer.pose("world_from_tool")  # says what is missing
    if joints is not None and arm is not None and arm.joints and len(joints) != arm.joints:
        raise DataError(f"'joints_rad' has {len(joints)} numbers, the arm has {arm.joints} joints")
    return State(answer.number("t_s"), pose, joints)


def encode_reach(reach: Reach) -> dict[str, Json]:
    """Which poses can be taken."""
    return {"reachable": reach.reachable.tolist()}


def decode_reach(answer: Fields, poses: int) -> Reach:
    """Which of so many poses can be taken."""
    flags = answer.each("reachable", flag_of)
    if len(flags) != poses:
        raise DataError(f"'reachable' has {len(flags)} items for {poses} poses", cure="answer one for each pose")
    return Reach(np.array(flags, dtype=np.bool_))


def encode_sweep(sweep: SweepAnswer) -> dict[str, Json]:
    """The readings; a range that is not finite is null, its status says why."""
    return {"readings": [_encode_reading(reading) for reading in sweep.readings]}


def decode_sweep(answer: Fields, asked: Collection[str]) -> SweepAnswer:
    """The readings of sensors that were asked, each at most once."""
    readings = answer.each("readings", lambda item, name: _reading_of(fields_of(item, name), asked))
    _refuse_twins([reading.sensor for reading in readings], "'readings'")
    return SweepAnswer(readings)


def encode_image(image: Image) -> dict[str, Json]:
    """A picture; its bytes row by row."""
    height, width = image.grey.shape
    return {"t_s": image.t_s, "width": width, "height": height, "gray8": _base64(image.grey.tobytes())}


def decode_image(answer: Fields, camera: CameraOfBridge) -> Image:
    """A picture of the size that was announced."""
    width, height = answer.whole("width", least=1), answer.whole("height", least=1)
    if (width, height) != (camera.width_px, camera.height_px):
        announced = f"{camera.width_px} x {camera.height_px}"
        raise DataError(f"an image of {width} x {height} pixels, 'hello' announced {announced}")
    grey = _bytes_of(answer, "gray8")
    if len(grey) != width * height:
        raise DataError(f"'gray8' holds {len(grey)} bytes, {width} x {height} pixels are {width * height}")
    return Image(answer.number("t_s"), np.frombuffer(grey, np.uint8).reshape(height, width))


def row_major(pose: FloatArray) -> list[float]:
    """A pose as 16 numbers, row by row."""
    return [float(item) for item in np.asarray(pose, dtype=np.float64).ravel()]


def _arm_of(fields: Fields) -> ArmOfBridge:
    kind = fields.word("kind", _ARM_KINDS)
    return ArmOfBridge(kind, fields.whole("joints", least=1, most=MOST_JOINTS) if kind is ArmKind.JOINTS else 0)


def _camera_of(fields: Fields) -> CameraOfBridge:
    camera = CameraOfBridge(fields.whole("width", least=1), fields.whole("height", least=1))
    pixels = camera.width_px * camera.height_px
    if pixels > MOST_PIXELS:
        raise DataError(f"a camera of {pixels} pixels, at most {MOST_PIXELS}", cure="send smaller images")
    return camera


def _encode_reading(reading: BridgeReading) -> dict[str, Json]:
    fields: dict[str, Json] = {
        "sensor": reading.sensor,
        "t_s": reading.t_s,
        "range_m": reading.range_m if reading.status is Status.OK else None,
        "status": _WORD_OF[reading.status],
    }
    if not math.isnan(reading.amplitude):
        fields["amplitude"] = reading.amplitude
    if not math.isnan(reading.sigma_m):
        fields["sigma_m"] = reading.sigma_m
    if not math.isnan(reading.spread_m):
        fields["spread_m"] = reading.spread_m
    if reading.count != 1:
        fields["count"] = reading.count
    if reading.echoes:
        fields["echoes"] = [{"range_m": range_m, "amplitude": amplitude} for range_m, amplitude in reading.echoes]
    if reading.envelope is not None:
        envelope = reading.envelope
        samples = _base64(envelope.values.astype("<f4").tobytes())
        fields["envelope"] = {"range0_m": envelope.range0_m, "bin_m": envelope.bin_m, "float32": samples}
    return fields


def _reading_of(fields: Fields, asked: Collection[str]) -> BridgeReading:
    sensor = fields.text("sensor")
    if sensor not in asked:
        known = ", ".join(asked) or "none"
        raise DataError(f"{fields.name_of('sensor')} = '{cleaned(sensor, 40)}' was not asked; asked: {known}")
    status = fields.word("status", _STATUS_WORDS)
    return BridgeReading(
        sensor=sensor,
        t_s=fields.number("t_s"),
        range_m=_range_of(fields, status),
        status=status,
        amplitude=fields.number("amplitude", least=0.0) if fields.has("amplitude") else math.nan,
        sigma_m=fields.positive("sigma_m") if fields.has("sigma_m") else math.nan,
        echoes=_echoes_of(fields) if fields.has("echoes") else (),
        envelope=_envelope_of(fields.inner("envelope")) if fields.has("envelope") else None,
        spread_m=fields.number("spread_m", least=0.0) if fields.has("spread_m") else math.nan,
        count=fields.whole("count", least=0) if fields.has("count") else 1,
    )


def _range_of(fields: Fields, status: Status) -> float:
    """The range; it is a number exactly when the status is "ok"."""
    given = fields.value("range_m")
    if status is Status.OK:
        return number_of(given, fields.name_of("range_m"), least=0.0)
    if given is not None:
        name, word = fields.name_of("range_m"), _WORD_OF[status]
        raise DataError(f"{name} stands beside the status '{word}'", cure="write null, or the status 'ok'")
    return _RANGE_OF[status]


def _echoes_of(fields: Fields) -> tuple[tuple[float, float], ...]:
    parts = fields.each("echoes", fields_of)
    echoes = tuple((part.number("range_m", least=0.0), part.number("amplitude", least=0.0)) for part in parts)
    for before, after in itertools.pairwise(echoes):
        if after[0] < before[0]:
            raise DataError(f"{fields.name_of('echoes')}: {after[0]:g} m after {before[0]:g} m", cure="sort by range")
    return echoes


def _envelope_of(fields: Fields) -> Envelope:
    samples = _bytes_of(fields, "float32")
    if not samples or len(samples) % 4:
        raise DataError(f"{fields.name_of('float32')} holds {len(samples)} bytes, wanted 4 a value, at least one value")
    values = np.frombuffer(samples, "<f4").astype(np.float32)
    if not np.all(np.isfinite(values)):
        raise DataError(f"{fields.name_of('float32')} holds values that are not finite")
    return Envelope(fields.number("range0_m"), fields.positive("bin_m"), values)


def _bytes_of(fields: Fields, key: str) -> bytes:
    try:
        return base64.b64decode(fields.text(key).encode("ascii"), validate=True)
    except (binascii.Error, UnicodeEncodeError) as error:
        raise DataError(f"{fields.name_of(key)} is not base64: {cleaned(str(error), 80)}") from error


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _name_of(value: object, name: str) -> str:
    text = text_of(value, name)
    if not 0 < len(text) <= LONGEST_NAME or cleaned(text) != text:
        raise DataError(
            f"{name} = '{cleaned(text, 40)}' ({len(text)} characters)",
            cure=f"give 1 to {LONGEST_NAME} characters without control characters and double spaces",
        )
    return text


def _refuse_twins(names: Sequence[str], where: str) -> None:
    twin, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise DataError(f"{where} holds '{twin}' {count} times", cure="name each sensor once")
