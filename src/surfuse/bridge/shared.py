"""One bridge for arm and sensors: opened by the first that needs it, closed by the last."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from surfuse.bridge.client import BridgeClient
from surfuse.bridge.clock import ClockFindings, ClockOffset
from surfuse.errors import DeviceError

UNKNOWN_CLOCK = ClockFindings(ClockOffset(0.0, float("inf")), True, 0.0, float("inf"))


class SharedBridge:
    """A device that several devices open.

    Its clock is that of the bridge, as far as this machine's can be brought to it: `clock` says how well.
    """

    def __init__(self, connect: Callable[[], BridgeClient]) -> None:
        self._connect = connect
        self._client: BridgeClient | None = None
        self._users = 0
        self._guided = False
        self._clock = UNKNOWN_CLOCK

    def __enter__(self) -> Self:
        if self._users == 0:
            client = self._connect()
            client.__enter__()
            client.guide(self._guided)
            self._client = client
            try:
                self._clock = client.measure_clock()
            except BaseException as error:
                client.__exit__(type(error), error, error.__traceback__)
                self._client = None
                raise
        self._users += 1
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._users -= 1
        if self._users == 0 and self._client is not None:
            self._clock = self.clock
            client, self._client = self._client, None
            client.__exit__(kind, error, trace)

    def guide(self, by_hand: bool) -> None:
        """Whether somebody else moves the arm, as `BridgeClient.guide`; also before the bridge is open."""
        self._guided = by_hand
        if self._client is not None:
            self._client.guide(by_hand)

    @property
    def clock(self) -> ClockFindings:
        """What is known of the bridge's clock now, or was when it was closed."""
        return self._clock if self._client is None else self._client.clock()

    @property
    def client(self) -> BridgeClient:
        """The conversation.

        Raises
        ------
        DeviceError : it is not open.
        """
        if self._client is None:
            raise DeviceError("the bridge is not open", cure="use it in a with block")
        return self._client


class BridgeClock:
    """The bridge's clock, asked of this machine's."""

    def __init__(self, bridge: SharedBridge) -> None:
        self._bridge = bridge
        self._host_minus_bridge_s = 0.0

    def now_s(self) -> float:
        """Seconds of the bridge, by this machine's clock and the offset that is measured with every state.

        On a new connection that has not told a state yet the last offset holds; `SharedBridge.clock` then is unsure.
        """
        offset = self._bridge.clock.offset
        if math.isfinite(offset.uncertainty_s):
            self._host_minus_bridge_s = offset.host_minus_bridge_s
        return time.monotonic() - self._host_minus_bridge_s

    def advance(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(max(duration_s, 0.0))
