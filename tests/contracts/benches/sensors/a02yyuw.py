"""A02YYUW on a pseudo-terminal."""

from contextlib import contextmanager

from plug_in_bench import SensorBench
from serial_stand_in import TalkingLine

from surfuse.sensors.a02yyuw import Parameters


@contextmanager
def bench(folder):
    with TalkingLine(bytes.fromhex("FF 07 A1 A7")) as line:
        values = {"port": line.port, "timeout_s": 20.0}
        yield SensorBench(Parameters(line.port, 20.0), values, 1.953, line.vanish)
