"""The ranging module, its lines timed by a counter that may be unplugged."""

from contextlib import contextmanager

from plug_in_bench import SensorBench, TickingClock

from surfuse.errors import DeviceError
from surfuse.sensors.polaroid import Parameters, Surroundings


class Counter:
    there = True

    def __call__(self):
        if not self.there:
            raise DeviceError("the counter does not answer", cure="check its cable")
        return 2 * 0.43 / 343.2

    def vanish(self):
        self.there = False


@contextmanager
def bench(folder):
    counter = Counter()
    around = Surroundings(clock=TickingClock(), timer=counter)
    yield SensorBench(Parameters(3, surroundings=around), {"pings": 3}, 0.43, counter.vanish, always_open=True)
