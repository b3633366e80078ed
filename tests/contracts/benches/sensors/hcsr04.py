"""HC-SR04 on gpiozero's mock pins."""

from contextlib import contextmanager

import pytest
from plug_in_bench import SensorBench

from surfuse.sensors.hcsr04 import Parameters

PULSE_S = 5e-3


@contextmanager
def bench(folder):
    gpiozero = pytest.importorskip("gpiozero")
    from gpiozero.pins.mock import MockFactory, MockPin
    from gpiozero.pins.pi import PiPin

    class InstantTrigger(MockPin):
        """Answers a trigger at once with edges at exact times."""

        def _set_state(self, value):
            falls = self.state and not value
            super()._set_state(value)
            if falls:
                for ticks, state in ((1.0, 1), (1.0 + PULSE_S, 0)):
                    self.echo._state = bool(state)
                    PiPin._call_when_changed(self.echo, ticks, state)

    earlier, factory = gpiozero.Device.pin_factory, MockFactory()
    gpiozero.Device.pin_factory = factory
    trigger = factory.pin("GPIO23", pin_class=InstantTrigger)
    trigger.echo = factory.pin("GPIO24")
    values = {"trigger_pin": "GPIO23", "echo_pin": "GPIO24", "air_temperature_c": 0}
    try:
        # No pin can vanish: a sensor that does not answer is a fault.
        yield SensorBench(Parameters("GPIO23", "GPIO24", 0.0), values, 0.5 * PULSE_S * 331.3)
    finally:
        factory.reset()
        gpiozero.Device.pin_factory = earlier
