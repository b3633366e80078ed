"""Search: joint 1 turns by fixed increments until the camera sees a part, then centres it (paper, section 3.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from surfuse.errors import ConfigError
from surfuse.records import CameraFrame, Detection


@dataclass(frozen=True)
class SearchParameters:
    """How the turn goes on and when a part counts as centred.

    Parameters
    ----------
    increment_rad : turn between pictures; less than the camera's field of view, or parts are missed.
    centred_px : largest distance of the centroid's column to the picture's middle.
    centring_turns : most turns spent on centring one part.
    same_part_rad : two sightings closer than this in angle are one part.
    all_parts : whether to go on after the first part, to the end of the turn.
    """

    increment_rad: float = math.radians(15.0)
    centred_px: float = 2.0
    centring_turns: int = 8
    same_part_rad: float = math.radians(3.0)
    all_parts: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.increment_rad <= math.pi:
            raise ConfigError(f"increment_deg = {math.degrees(self.increment_rad):g}", cure="give 0 < angle <= 180")
        if not self.centred_px > 0.0:
            raise ConfigError(f"centred_px = {self.centred_px}", cure="give a distance > 0, in pixels")
        if self.centring_turns < 1:
            raise ConfigError(f"centring_turns = {self.centring_turns}", cure="give at least 1")
        if not 0.0 <= self.same_part_rad <= math.pi:
            raise ConfigError(f"same_part_deg = {math.degrees(self.same_part_rad):g}", cure="give 0 to 180")


@dataclass(frozen=True)
class FoundPart:
    """A part with the picture in which it is centred, the angle of joint 1 there, and whether it really is centred.

    `direction_rad` is the angle of joint 1 that points at its centroid. Not centred: it lies at the end of the turn.
    """

    angle_rad: float
    direction_rad: float
    frame: CameraFrame
    detection: Detection
    centred: bool


@dataclass(frozen=True)
class SearchResult:
    """Parts in order of angle (none is an answer), all angles at which pictures were taken, and the last picture."""

    parts: tuple[FoundPart, ...]
    visited_rad: tuple[float, ...]
    last_frame: CameraFrame


def search(
    capture: Callable[[float], CameraFrame],
    find: Callable[[CameraFrame], tuple[Detection, ...]],
    lower_rad: float,
    upper_rad: float,
    parameters: SearchParameters | None = None,
) -> SearchResult:
    """Turn from `lower_rad` to `upper_rad` and look.

    `capture` turns joint 1 to an angle and takes a picture; `find` names the parts in it. A positive turn moves the
    camera to its left, so that things move to the right in the picture.

    Raises
    ------
    ConfigError : the limits are not finite or not in order.
    """
    chosen = parameters or SearchParameters()
    if not (math.isfinite(lower_rad) and math.isfinite(upper_rad) and lower_rad <= upper_rad):
        raise ConfigError(f"search from {lower_rad} to {upper_rad} rad", cure="give finite limits, the lower one first")
    turn = _Turn(capture, find, lower_rad, upper_rad, chosen)
    for angle in _stations(lower_rad, upper_rad, chosen.increment_rad):
        frame = turn.look(angle)
        seen = sorted(find(frame), key=lambda detection: _direction(angle, frame, detection))
        for detection in seen:
            turn.centre(angle, frame, detection)
            if turn.parts and not chosen.all_parts:
                return turn.result()
    return turn.result()


class _Turn:
    """What a search has seen so far."""

    def __init__(
        self,
        capture: Callable[[float], CameraFrame],
        find: Callable[[CameraFrame], tuple[Detection, ...]],
        lower_rad: float,
        upper_rad: float,
        chosen: SearchParameters,
    ) -> None:
        self._capture, self._find, self._chosen = capture, find, chosen
        self._lower_rad, self._upper_rad = lower_rad, upper_rad
        self.parts: list[FoundPart] = []
        self.visited: list[float] = []

    def look(self, angle_rad: float) -> CameraFrame:
        self.visited.append(angle_rad)
        self.last = self._capture(angle_rad)
        return self.last

    def centre(self, angle_rad: float, frame: CameraFrame, detection: Detection) -> None:
        """Turn until the centroid's column is in the middle; keep the part unless it is known already."""
        direction = _direction(angle_rad, frame, detection)
        if not detection.touches_border and self._known(direction):
            return
        for _ in range(self._chosen.centring_turns):
            aimed = min(max(direction, self._lower_rad), self._upper_rad)
            if abs(_offset_px(frame, detection)) <= self._chosen.centred_px or abs(aimed - angle_rad) < 1e-6:
                break
            closer = self.look(aimed)
            again = self._find(closer)
            if not again:
                return
            angle_rad, frame = aimed, closer
            expected = direction
            detection = min(again, key=lambda seen: abs(_direction(aimed, closer, seen) - expected))
            direction = _direction(angle_rad, frame, detection)
        if self._known(direction):
            return
        centred = abs(_offset_px(frame, detection)) <= self._chosen.centred_px
        self.parts.append(FoundPart(angle_rad, direction, frame, detection, centred))

    def result(self) -> SearchResult:
        parts = sorted(self.parts, key=lambda part: part.direction_rad)
        return SearchResult(tuple(parts), tuple(self.visited), self.last)

    def _known(self, direction_rad: float) -> bool:
        """Whether a part in this direction has been found, a full turn more or less being the same."""
        return any(
            abs(math.remainder(part.direction_rad - direction_rad, 2.0 * math.pi)) <= self._chosen.same_part_rad
            for part in self.parts
        )


def _stations(lower_rad: float, upper_rad: float, increment_rad: float) -> list[float]:
    """Angles from the lower limit on, the upper limit always among them."""
    steps = math.floor((upper_rad - lower_rad) / increment_rad + 1e-9)
    angles = [lower_rad + step * increment_rad for step in range(steps + 1)]
    return angles if upper_rad - angles[-1] < 1e-9 else [*angles, upper_rad]


def _offset_px(frame: CameraFrame, detection: Detection) -> float:
    """How far the centroid is to the right of the optical axis."""
    return float(detection.centroid_px[0]) - frame.camera.cx_px


def _direction(angle_rad: float, frame: CameraFrame, detection: Detection) -> float:
    """Angle of joint 1 that points the camera at the centroid, for a part that is far compared with the camera's arm.

    The lens distortion is left to the next turn: near the axis there is none.
    """
    return angle_rad - math.atan2(_offset_px(frame, detection), frame.camera.fx_px)
