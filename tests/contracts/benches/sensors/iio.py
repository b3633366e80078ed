"""A VL53L1X as the kernel's files."""

from contextlib import contextmanager

from plug_in_bench import SensorBench

from surfuse.sensors.iio import Parameters


@contextmanager
def bench(folder):
    raw, scale = folder / "in_distance_raw", folder / "in_distance_scale"
    raw.write_text("431\n")
    scale.write_text("0.001\n")
    yield SensorBench(Parameters(folder, "vl53l1x"), {"folder": str(folder), "model": "vl53l1x"}, 0.431, raw.unlink)
