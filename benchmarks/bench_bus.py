"""The bus between host and node: overhead of a sweep, frames a second, a bad bus, an hour of traffic.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_bus.py [--readings N]. The whole takes about five minutes with 1,000,000.
The ratio of the frame rate to what 1 Mbit/s carries at most (7,407 full frames a second) does not depend on the wire.
"""

from __future__ import annotations

import argparse
import gc
import resource
import time
import tracemalloc
from dataclasses import replace

import can
import numpy as np

from surfuse.interfaces import Clock
from surfuse.node.array import CanArray, Parameters
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.disturbed_bus import BadBus, BadLink, DirectLink
from surfuse.node.firmware import Node
from surfuse.node.link import Arrival, BusLink, BusParameters, open_bus
from surfuse.node.messages import CanFrame, Trigger
from surfuse.node.responder import NodeIdentity, Responder
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture, SensorSpec, Status

SPEC = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)
CATALOGUE = Catalogue()
BUS_LIMIT_HZ = 7407.0


class SteppedClock:
    t_s = 0.0

    def now_s(self) -> float:
        return self.t_s

    def advance(self, duration_s: float) -> None:
        self.t_s += duration_s


class Ranger:
    """Never the same range twice in a row; firing takes simulated time only."""

    fired = 0

    def __init__(self, clock: Clock, spec: SensorSpec = SPEC) -> None:
        self.clock, self.spec, self.last_m = clock, spec, 0.0

    def __enter__(self) -> Ranger:
        return self

    def __exit__(self, *error: object) -> None: ...

    def fire(self) -> Echo:
        Ranger.fired += 1
        start_s = self.clock.now_s()
        self.clock.advance(self.spec.firing_time_s)
        self.last_m = (30_000 + Ranger.fired % 300_000) / 1e5
        return Echo(self.last_m, Status.OK, start_s, 0.5, 0.0003, 5)


def fixture(spec: SensorSpec = SPEC) -> Fixture:
    return Fixture(np.stack([np.eye(4)] * 4), (spec,) * 4)


def overhead(sweeps: int) -> None:
    clock, bus = SteppedClock(), BusParameters(channel="bench_overhead")
    responder = Responder([Ranger(clock) for _ in range(4)], clock, NodeIdentity(), CATALOGUE)
    node = Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()))
    tally = Tally()
    link = BusLink(lambda: open_bus(bus), clock, tally)
    times = []
    with node, CanArray(fixture(), Parameters(bus=bus), link, clock, tally) as array:
        for _ in range(sweeps):
            began_s = time.perf_counter()
            array.sweep()
            times.append(time.perf_counter() - began_s)
    median, p99 = np.percentile(times, [50, 99]) * 1e3
    print(f"sweep of four, in-process bus, two threads   median {median:.2f} ms   p99 {p99:.2f} ms   (limit 3 ms)")


class Prepared:
    """A bus link whose answers are on the bus before they are asked for; only receiving costs time."""

    def __init__(self, link: BusLink) -> None:
        self.link, self.waited_s = link, 0.0

    def __enter__(self) -> Prepared:
        return self

    def __exit__(self, *error: object) -> None: ...

    def send(self, frame: CanFrame) -> bool:
        return True

    def receive(self, timeout_s: float) -> Arrival | None:
        arrival = self.link.receive(timeout_s)
        self.waited_s += timeout_s if arrival is None else 0.0
        return arrival


def frames_a_second(sweeps: int, repeats: int) -> None:
    spec = replace(SPEC, kind="optical", firing_time_s=0.0)
    rates, decoded = [], []
    for repeat in range(repeats):
        clock, tally = SteppedClock(), Tally()
        responder = Responder([Ranger(clock, spec) for _ in range(4)], clock, NodeIdentity(), CATALOGUE)
        frames = [responder.heartbeat()]
        for sweep in range(1, sweeps + 1):
            frames += responder.answer(CATALOGUE.encode(Trigger(1, sweep % 256, 0, 15, 0)))
        channel = f"bench_frames_{repeat}"
        receiver = can.Bus(channel, "virtual", ignore_config=True)
        with can.Bus(channel, "virtual", ignore_config=True) as sender:
            for frame in frames:
                sender.send(can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False))
        link = BusLink(lambda receiver=receiver: receiver, clock, tally)
        timeouts = NodeTimeouts(roll_call_s=0.0)
        ready, parameters = Prepared(link), Parameters(timeouts=timeouts)
        array = CanArray(fixture(spec), parameters, ready, clock, tally, lambda ready=ready: ready.waited_s)
        began_s = time.perf_counter()
        with link, array:
            for _ in range(sweeps):
                assert all(echo.status is Status.OK for echo in array.sweep())
            rates.append(array.counters.frames / (time.perf_counter() - began_s))
        began_s = time.perf_counter()
        for frame in frames:
            CATALOGUE.decode(frame)
        decoded.append(len(frames) / (time.perf_counter() - began_s))
    rate = max(rates)
    print(
        f"frames received, decoded, checked            {rate:,.0f} /s   {rate / BUS_LIMIT_HZ:.1f} times the wire"
        f"   (limit 20,000 /s; decoding alone {max(decoded):,.0f} /s)"
    )


def bad_bus(name: str, bad: BadBus, readings: int) -> None:
    clock, tally = SteppedClock(), Tally()
    sensors = [Ranger(clock) for _ in range(4)]
    direct = DirectLink(Responder(sensors, clock, NodeIdentity(), CATALOGUE), clock)
    link = BadLink(direct, bad, np.random.default_rng(0))
    timeouts = NodeTimeouts(answer_timeout_s=0.02, silence_limit_s=60.0)
    wrong = faults = 0
    began_s = time.perf_counter()
    with CanArray(fixture(), Parameters(timeouts=timeouts), link, clock, tally, direct.monotonic_s) as array:
        for _ in range(readings // 4):
            for echo, sensor in zip(array.sweep(), sensors, strict=True):
                faults += echo.status is not Status.OK
                wrong += echo.status is Status.OK and echo.range_m != sensor.last_m
    counters = array.counters
    print(
        f"{name:44s} {wrong} wrong of {counters.readings:,}   {faults} faults   ({time.perf_counter() - began_s:.0f} s)"
    )
    print(f"  put in: {link.injected}")
    seen = {name: getattr(counters, name) for name in ("lost", "unanswered", "duplicated", "reordered", "late")}
    print(f"  counted: {seen}, retriggers {counters.retriggers}, fired again {counters.fired_again}")


def one_hour() -> None:
    """An hour of sweeps every half second with a heartbeat a second, as fast as it goes."""
    clock, bus = SteppedClock(), BusParameters(channel="bench_hour")
    responder = Responder([Ranger(clock) for _ in range(4)], clock, NodeIdentity(), CATALOGUE)
    node = Node(responder, BusLink(lambda: open_bus(bus), clock, Tally()), heartbeat_s=0.001)
    tally = Tally()
    array = CanArray(fixture(), Parameters(bus=bus), BusLink(lambda: open_bus(bus), clock, tally), clock, tally)
    with node, array:
        for _ in range(720):
            array.sweep()
        gc.collect()
        tracemalloc.start()
        peak, live = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, []
        for _ in range(3):
            for _ in range(2160):
                array.sweep()
            gc.collect()
            live.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak
    frames = array.counters.frames
    print(
        f"one hour of traffic, {frames:,} frames         {(live[2] - live[1]) / 1024:+.1f} KiB live in the last"
        f" third, {grown_kib:+d} KiB peak with the tracer"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readings", type=int, default=1_000_000)
    arguments = parser.parse_args()
    overhead(2000)
    frames_a_second(800, 5)
    one_hour()
    bad_bus("20 % loss", BadBus(0.2, 0.0, 0.0), arguments.readings // 10)
    bad_bus("20 % loss, doubling, reordering", BadBus(0.2, 0.2, 0.2), arguments.readings)


if __name__ == "__main__":
    main()
