"""A MaxBotix HRXL on a pseudo-terminal."""

from contextlib import contextmanager

from plug_in_bench import SensorBench
from serial_stand_in import TalkingLine

from surfuse.sensors.maxbotix import Parameters


@contextmanager
def bench(folder):
    with TalkingLine(b"R1234\r") as line:
        values = {"port": line.port, "model": "hrxl-5m", "timeout_s": 20.0}
        yield SensorBench(Parameters(line.port, "hrxl-5m", 20.0), values, 1.234, line.vanish)
