"""The tables of what measures in the simulated cell: the array, its bus, the ranging kit, and the air between."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from surfuse.settings.section import Section

NO_BUS = "none"
BUS_PINGS_LIMIT = 31  # the count of a reading has five bits on the bus


class ArraySettings(Section):
    """The four rangers at the wrist."""

    sensor: str = Field("polaroid", description="the kind of all four: a plug-in of the folder sensors")
    side_m: float = Field(0.05, ge=0.01, le=0.5, description="side of the square, ds")
    pings: int = Field(5, ge=1, le=100, description="emissions averaged for one reading; at most 31 over a bus")
    trigger: Literal["sequential", "simultaneous"] = Field(
        "sequential", description="simultaneous: all send at the same moment and hear each other"
    )


class BusSettings(Section):
    """The CAN bus between the host and the sensor node."""

    interface: str = Field(
        "virtual", description="virtual (node in this process), none (no bus), udp_multicast, slcan, socketcan, ..."
    )
    channel: str = Field("", description="name, port or group of the adapter; empty: the usual one")
    port: int = Field(43113, ge=1024, le=65535, description="UDP port of udp_multicast")
    bitrate_bps: int = Field(
        1_000_000,
        ge=10_000,
        le=1_000_000,
        description="bit rate of the bus; simulated time goes on by that of its bits",
    )
    node: int = Field(1, ge=1, le=7, description="address of the node")
    connect_timeout_s: float = Field(20.0, gt=0.0, le=3600.0, description="wait for a node in another process")
    tether_port: int = Field(
        43114, ge=0, le=65535, description="TCP port on which a simulated node is told where the arm is; 0: none"
    )


class KitSettings(Section):
    """The ranging kit's parameters."""

    frequency_hz: float = Field(63e3, ge=20e3, le=200e3, description="of the burst that is sent")
    cycles: int = Field(16, ge=1, le=64, description="periods of the burst: more give a stronger, longer echo")
    blanking_s: float = Field(
        1.9e-3, ge=0.0, le=0.02, description="after the start of the burst nothing is heard: the nearest range"
    )
    gain: float = Field(1.0, gt=0.0, le=1000.0, description="factor on the gain of the receiver")
    tube_length_m: float = Field(0.20, ge=0.0, le=0.5, description="of the tube that narrows the beam; 0: no tube")
    sample_rate_hz: float = Field(1e6, ge=1e4, le=1e9, description="rate of the clock that counts the time of flight")
    trigger: Literal["external", "internal"] = Field(
        "external", description="internal: every kit on its own clock, so that neighbours disturb each other"
    )


class AirSettings(Section):
    """The air: what it is, and what the kit believes."""

    temperature_c: float = Field(20.0, ge=-30.0, le=60.0, description="what it is")
    assumed_temperature_c: float = Field(
        20.0, ge=-30.0, le=60.0, description="what the kit takes it for when it turns times into ranges"
    )
    humidity_percent: float = Field(50.0, ge=1.0, le=100.0, description="relative humidity, which dampens echoes")
