"""Damage to the byte streams of the serial sensors and to frames of the bus: crashes, and wrong readings let through.

Run: python benchmarks/fuzz_parsers.py [--frames N]. With 1,000,000 frames a parser it takes about two minutes.
A stream of good frames is damaged: bits flipped, bytes lost, put in, or replaced, pieces cut out, frames cut short and
run together. A reading is wrong when its number is not that of a frame sent since the last right one. A check sum of 8
bits meets 1 damaged frame in 256 by chance, so `wrong / damaged` below 1/256 is what it can do; MaxBotix lines have
none, and the figure says what that costs.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np

from surfuse.node.catalogue import Catalogue, Rejection
from surfuse.node.messages import CanFrame, Reading
from surfuse.records import Status
from surfuse.sensors.a02yyuw import Parser as A02Parser
from surfuse.sensors.maxbotix import MODELS as MAXBOTIX
from surfuse.sensors.maxbotix import Parser as MaxBotixParser
from surfuse.sensors.tfmini import MODELS as TFMINI
from surfuse.sensors.tfmini import Parser as TfminiParser
from surfuse.serial_line.frames import LineParser

CHUNK_FRAMES = 2000


def summed(head: bytes) -> bytes:
    return head + bytes([sum(head) & 0xFF])


def maxbotix(number: int) -> bytes:
    return b"R%04d\r" % number


def a02(number: int) -> bytes:
    return summed(bytes([0xFF, number >> 8, number & 0xFF]))


def tfmini(number: int) -> bytes:
    return summed(b"\x59\x59" + number.to_bytes(2, "little") + b"\xe8\x03\x00\x08")


def damage(frame: bytes, generator: np.random.Generator) -> bytes:
    """One of seven kinds of damage."""
    place = int(generator.integers(len(frame)))
    byte = generator.integers(0, 256, 1, dtype=np.uint8).tobytes()
    match int(generator.integers(7)):
        case 0:
            return frame[:place] + bytes([frame[place] ^ 1 << int(generator.integers(8))]) + frame[place + 1 :]
        case 1:
            return frame[:place] + frame[place + 1 :]
        case 2:
            return frame[:place] + byte + frame[place:]
        case 3:
            return frame[:place] + byte + frame[place + 1 :]
        case 4:
            return frame[:place]
        case 5:
            return frame[place:]
        case _:
            return generator.integers(0, 256, len(frame), dtype=np.uint8).tobytes()


def one_stream(
    parser: LineParser, encode: Callable[[int], bytes], span: tuple[int, int], unit_m: float, frames: int, share: float
) -> tuple[int, int, int, int]:
    """Damaged frames, right readings, wrong numbers and made-up `inf` of a stream with a `share` of damaged frames."""
    generator = np.random.default_rng(7)
    damaged = right = wrong = unreal = 0
    for _ in range(0, frames, CHUNK_FRAMES):
        numbers = generator.integers(*span, CHUNK_FRAMES).tolist()
        good = [encode(number) for number in numbers]
        hit = generator.random(CHUNK_FRAMES) < share
        pieces = [damage(frame, generator) if hurt else frame for frame, hurt in zip(good, hit, strict=True)]
        sound = [piece == frame for piece, frame in zip(pieces, good, strict=True)]
        sent = {number for number, whole in zip(numbers, sound, strict=True) if whole}
        damaged += sound.count(False)
        for number, whole, piece in zip(numbers, sound, pieces, strict=True):
            for reading in parser.feed(piece):
                if reading.status is not Status.OK:
                    unreal += reading.status is not Status.FAULT
                    continue
                got = round(reading.range_m / unit_m)
                right += whole and got == number
                wrong += not (whole and got == number) and got not in sent
    return damaged, right, wrong, unreal


def agreeing_lines(frames: int, share: float) -> None:
    """MaxBotix at rest before a plate: what asking for two lines that agree leaves of the wrong numbers."""
    generator, parser = np.random.default_rng(3), MaxBotixParser(MAXBOTIX["hrxl-5m"])
    previous, wrong, right = math.nan, 0, 0
    for _ in range(frames):
        line = maxbotix(1234 + int(generator.integers(-2, 3)))
        for reading in parser.feed(damage(line, generator) if generator.random() < share else line):
            if abs(reading.range_m - previous) <= 0.03:
                off = abs(reading.range_m - 1.234) > 0.03
                wrong, right = wrong + off, right + (not off)
            previous = reading.range_m
    print(f"maxbotix, two lines that agree, {share:.0%} damaged: {wrong} wrong numbers, {right:,} right ones")


def bus(frames: int) -> None:
    """Random data under the identifiers of readings: each is refused or is exactly what its bits say."""
    generator, catalogue = np.random.default_rng(1), Catalogue()
    data = generator.integers(0, 256, (frames, 8), dtype=np.uint8)
    began_s, refused, contradictory = time.perf_counter(), 0, 0
    for row in data:
        message = catalogue.decode(CanFrame(0x210, row.tobytes()))
        if isinstance(message, Rejection):
            refused += 1
        elif isinstance(message, Reading):
            contradictory += (message.status is Status.OK) != np.isfinite(message.range_m) or message.range_m == 0.0
    print(
        f"bus reading: {frames:,d} random frames, {refused:,d} refused, {contradictory} contradictions let through"
        f"   {time.perf_counter() - began_s:.0f} s"
    )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--frames", type=int, default=1_000_000)
    frames = options.parse_args().frames
    parsers = (
        ("maxbotix", MaxBotixParser(MAXBOTIX["hrxl-5m"]), maxbotix, (301, 5000), 1e-3),
        ("a02yyuw", A02Parser(), a02, (31, 4500), 1e-3),
        ("tfmini-s", TfminiParser(TFMINI["tfmini-s"]), tfmini, (10, 1200), 1e-2),
    )
    print("parser      damaged   of frames   right readings   wrong numbers   made-up inf   wrong/damaged   s")
    for share in (0.05, 1.0):
        for name, parser, encode, span, unit_m in parsers:
            began_s = time.perf_counter()
            damaged, right, wrong, unreal = one_stream(parser, encode, span, unit_m, frames, share)
            head = f"{name:9s} {damaged:9,d} {frames:11,d} {right:16,d} {wrong:15,d} {unreal:13,d}"
            print(f"{head} {wrong / max(damaged, 1):15.1e} {time.perf_counter() - began_s:3.0f}")
    for share in (0.01, 0.05):
        agreeing_lines(frames, share)
    print(f"a sum of 8 bits lets 1/256 = {1 / 256:.1e} of random pieces through")
    bus(frames)


if __name__ == "__main__":
    main()
