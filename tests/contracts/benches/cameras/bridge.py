"""The rig over a tilted plane behind the bridge protocol, which answers 'image'."""

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from plug_in_bench import CameraBench

from surfuse.bridge.client import BridgeClient
from surfuse.bridge.patience import Patience
from surfuse.bridge.shared import SharedBridge
from surfuse.bridge.transport import TcpTransport
from surfuse.cameras import REFERENCE_MODEL
from surfuse.cameras.bridge import Parameters, Surroundings

sys.path.insert(0, str(Path(__file__).parents[3] / "bridge"))
from tilted_plane import Served, TiltedPlane

MODEL = replace(REFERENCE_MODEL, width_px=4, height_px=3)


@contextmanager
def bench(folder):
    with Served(TiltedPlane()) as served:

        def connect():
            return BridgeClient(TcpTransport(served.address), Patience(give_up_s=1.0))

        surroundings = Surroundings(model=MODEL, bridge=SharedBridge(connect))
        yield CameraBench(Parameters(surroundings), {}, served.server.close)
