"""Files of a run, opened by readers that did not write them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from surfuse.exporters import nc
from surfuse.runs.log_reader import read_log


@pytest.fixture(scope="module")
def log(flat_run):
    return read_log(flat_run)


def ranges_of(log):
    """Every reading as (range, time), in the order in which it was taken."""
    return [(value, round(1e9 * t)) for sweep in log.sweeps for value, t in zip(sweep.range_m, sweep.t_s, strict=True)]


def same(found: float, wanted: float) -> bool:
    return found == pytest.approx(wanted, rel=1e-6) or (math.isnan(found) and math.isnan(wanted)) or found == wanted


@pytest.mark.parametrize("what", ["segment", "folder"])
def test_rosbags_reads_every_range_image_and_joint_state(flat_run, log, what):
    path = flat_run / "log" / "000.mcap" if what == "segment" else flat_run / "log"
    kinds: dict[str, int] = {}
    found = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            kinds[connection.msgtype] = kinds.get(connection.msgtype, 0) + 1
            if connection.msgtype == "sensor_msgs/msg/Range" and "shoulder" not in connection.topic:
                stamp = message.header.stamp
                found.append((message.range, stamp.sec * 10**9 + stamp.nanosec))
            if connection.msgtype == "sensor_msgs/msg/Image":
                assert (message.width, message.height, message.encoding) == (500, 582, "mono8")
                assert np.array_equal(message.data.reshape(582, 500), log.frames[0].image)
    wanted = ranges_of(log)
    assert len(found) == len(wanted) == 4 * len(log.sweeps)
    assert all(same(value, true) and abs(t - when) < 2 for (value, t), (true, when) in zip(found, wanted, strict=True))
    assert kinds["sensor_msgs/msg/JointState"] >= len(log.sweeps)
    assert kinds["tf2_msgs/msg/TFMessage"] >= 1


def test_the_ros2_decoder_reads_the_same_and_checksums_hold(flat_run, log):
    with (flat_run / "log" / "000.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header = reader.get_header()
        found = [
            decoded.range for schema, _, _, decoded in reader.iter_decoded_messages() if schema.name.endswith("Range")
        ]
    assert header.profile == "ros2"
    wanted = [value for value, _ in ranges_of(log)]
    assert len(found) >= len(wanted)
    assert all(same(value, true) for value, true in zip(found[-len(wanted) :], wanted, strict=True))


def test_xarray_reads_the_map_with_units_and_uncertainty(flat_run):
    surface = nc.read(flat_run / "surface.nc")
    with xarray.open_dataset(flat_run / "surface.nc", engine="h5netcdf") as data:
        assert data.attrs["Conventions"].startswith("CF-")
        grids = [name for name, values in data.variables.items() if values.shape == surface.grid.shape]
        heights = [name for name in grids if np.array_equal(data[name].values, surface.height_m, equal_nan=True)]
        sigmas = [name for name in grids if np.array_equal(data[name].values, surface.sigma_m, equal_nan=True)]
        assert len(heights) == len(sigmas) == 1
        assert data[heights[0]].attrs["units"] == "m"
        assert sigmas[0] in data[heights[0]].attrs["ancillary_variables"]
        rows, columns = data[heights[0]].dims
        assert np.array_equal(data[columns].values, surface.grid.u_m)
        assert np.array_equal(data[rows].values, surface.grid.v_m)
