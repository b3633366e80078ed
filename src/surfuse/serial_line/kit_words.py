r"""The words of the ranging kit on its serial line: `$WORD,number,field,...*CRC` and `\r\n`.

CRC is that of the bytes between `$` and `*`, as four hexadecimal digits: CRC-16 with the polynomial 0x1021 from 0xFFFF
("CCITT-FALSE"). Besides, every word has a number that comes back and a known count of fields of a known form, so that a
damaged line is not taken for a good one, nor an old answer for a new one. The page is docs/reference/kit_serial.md.
"""

from __future__ import annotations

import binascii
import re
from dataclasses import replace

from surfuse.errors import ConfigError
from surfuse.node.messages import KitMessage, TriggerSource

PROTOCOL = 1
MAX_NUMBER = 9999
NOTHING, EARLY = "NONE", "EARLY"
ERROR_WORDS = {
    "SUM": "the line was damaged",
    "WORD": "the kit does not know the command",
    "NAME": "the kit has no such parameter",
    "VALUE": "the kit cannot have this value",
    "PINGS": "the kit cannot fire so often",
    "HARD": "the transducer or its amplifier is faulty",
}
_FRAME = re.compile(r"\$([A-Z]+,[0-9]{1,4}(?:,[A-Za-z0-9_.=+-]*)*)\*([0-9A-F]{4})")
_TRIGGERS = {"EXT": TriggerSource.EXTERNAL, "INT": TriggerSource.INTERNAL}
_NAMES = ("FREQ", "CYC", "BLANK", "GAIN", "RATE", "TRIG")
_NUMBER = re.compile(r"[0-9]{1,8}")
_GAIN = re.compile(r"[0-9]{1,3}\.[05]")


def framed(word: str, number: int, *fields: str) -> bytes:
    """One line, with its check and its end."""
    body = ",".join([word, str(number), *fields])
    return f"${body}*{_check(body):04X}\r\n".encode("ascii")


def unframed(line: str) -> tuple[str, int, tuple[str, ...]] | None:
    """Word, number and fields of one line without its end; None when the line is damaged."""
    found = _FRAME.fullmatch(line)
    if found is None or _check(found[1]) != int(found[2], 16):
        return None
    word, number, *fields = found[1].split(",")
    return word, int(number), tuple(fields)


def as_fields(kit: KitMessage) -> tuple[str, ...]:
    """The six parameters, in the order in which the kit tells them."""
    trigger = next(text for text, source in _TRIGGERS.items() if source is kit.trigger_source)
    return (
        f"FREQ={kit.frequency_hz}",
        f"CYC={kit.cycles}",
        f"BLANK={kit.blanking_us}",
        f"GAIN={kit.gain_db:.1f}",
        f"RATE={kit.sample_rate_hz}",
        f"TRIG={trigger}",
    )


def changed_by(kit: KitMessage, fields: tuple[str, ...]) -> KitMessage | str:
    """The parameters with some of them set anew; an error word when a field is wrong."""
    for field in fields:
        name, _, value = field.partition("=")
        if name not in _NAMES:
            return "NAME"
        try:
            kit = _with(kit, name, value)
        except (ConfigError, ValueError):
            return "VALUE"
    return kit


def _with(kit: KitMessage, name: str, value: str) -> KitMessage:
    """One parameter set anew; ValueError or ConfigError when the kit cannot have the value."""
    if name == "TRIG":
        if value not in _TRIGGERS:
            raise ValueError(value)
        return replace(kit, trigger_source=_TRIGGERS[value])
    if name == "GAIN":
        if not _GAIN.fullmatch(value):
            raise ValueError(value)
        return replace(kit, gain_db=float(value))
    if not _NUMBER.fullmatch(value):
        raise ValueError(value)
    match name:
        case "FREQ":
            return replace(kit, frequency_hz=int(value))
        case "CYC":
            return replace(kit, cycles=int(value))
        case "BLANK":
            return replace(kit, blanking_us=int(value))
        case _:
            return replace(kit, sample_rate_hz=int(value))


def _check(body: str) -> int:
    return binascii.crc_hqx(body.encode("ascii"), 0xFFFF)
