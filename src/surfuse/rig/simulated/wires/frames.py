"""What rangers say on their serial lines: the bytes of a reading, as their drivers understand them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from surfuse.errors import ConfigError
from surfuse.records import Echo, Status
from surfuse.sensors import maxbotix, tfmini

Encode = Callable[[Echo], bytes]
"""A reading as the bytes of one frame; empty: the device says nothing."""
_STRONG, _WEAK = 1000, 0
_FAR_CM = 1_200
_NOTHING, _DISTURBED = 0xFFFD, 0xFFFE


def encoder(driver: str, parameters: Mapping[str, object]) -> Encode:
    """How the ranger of a serial driver speaks; `parameters` are the driver's keys of the sensor's table.

    Raises
    ------
    ConfigError : this driver reads no serial line, or has no such model.
    """
    if driver == "a02yyuw":
        return _a02yyuw
    model = str(parameters.get("model"))
    if driver == "tfmini" and model in tfmini.MODELS:
        return _tfmini(tfmini.MODELS[model])
    if driver == "maxbotix" and model in maxbotix.MODELS:
        return _maxbotix(maxbotix.MODELS[model])
    raise ConfigError(
        f"driver = '{driver}' with model = '{model}' reads no serial line of the twin",
        cure="take a02yyuw, maxbotix, tfmini or ranging_kit, with its model",
    )


def _a02yyuw(echo: Echo) -> bytes:
    instead = {Status.NO_ECHO: _NOTHING, Status.TOO_CLOSE: 0, Status.FAULT: _DISTURBED}
    number = round(1e3 * echo.range_m) if echo.status is Status.OK else instead[echo.status]
    return _summed(b"\xff" + number.to_bytes(2, "big"))


def _tfmini(model: tfmini.Model) -> Encode:
    instead = {Status.NO_ECHO: _FAR_CM, Status.TOO_CLOSE: model.too_close_cm - 1, Status.FAULT: 0}

    def encode(echo: Echo) -> bytes:
        number = round(1e2 * echo.range_m) if echo.status is Status.OK else instead[echo.status]
        strength = _WEAK if echo.status is Status.FAULT else _STRONG
        return _summed(b"\x59\x59" + number.to_bytes(2, "little") + strength.to_bytes(2, "little") + b"\x00\x00")

    return encode


def _maxbotix(model: maxbotix.Model) -> Encode:
    instead = {Status.NO_ECHO: model.nothing, Status.TOO_CLOSE: model.too_close}
    digits = 4 if model.unit_m == 1e-3 else 3
    end = b" P1\r" if b" P" in model.pattern.pattern else b"\r"

    def encode(echo: Echo) -> bytes:
        if echo.status is Status.FAULT:
            return b""
        number = round(echo.range_m / model.unit_m) if echo.status is Status.OK else instead[echo.status]
        return f"R{number:0{digits}d}".encode("ascii") + end

    return encode


def _summed(head: bytes) -> bytes:
    return head + bytes([sum(head) & 0xFF])
