"""TFmini-S on a pseudo-terminal."""

from contextlib import contextmanager

from plug_in_bench import SensorBench
from serial_stand_in import TalkingLine

from surfuse.sensors.tfmini import Parameters


@contextmanager
def bench(folder):
    with TalkingLine(bytes.fromhex("59 59 96 00 E8 03 00 00 33")) as line:
        values = {"port": line.port, "model": "tfmini-s", "timeout_s": 20}
        yield SensorBench(Parameters(line.port, "tfmini-s", 20.0), values, 1.5, line.vanish)
