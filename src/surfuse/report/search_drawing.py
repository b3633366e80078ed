"""What the camera saw: the image with contour and dominant points, and its histogram with the threshold."""

from __future__ import annotations

import base64

import numpy as np

from surfuse.errors import DataError
from surfuse.records import ByteArray, FloatArray
from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.content import FoundPartView
from surfuse.report.markup import Markup, Value, element

# An image of 500 x 582 pixels with sensor noise takes about 60 kB at this quality.
JPEG_QUALITY = 78
# Longer contours are thinned: no screen shows more corners.
CONTOUR_POINTS = 2000


def jpeg(image: ByteArray, longest_px: int) -> bytes:
    """Grey image as JPEG, made smaller when its longer side is above the limit.

    `image` (H, W) uint8; `longest_px` is the limit.

    Raises
    ------
    DataError : the image cannot be written.
    """
    import cv2

    scale = min(1.0, longest_px / max(image.shape))
    if scale < 1.0:
        size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise DataError(f"image {image.shape} cannot be written as JPEG")
    return bytes(data)


def _polygon(points_px: FloatArray, kind: str) -> Markup:
    stride = max(1, -(-len(points_px) // CONTOUR_POINTS))
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in points_px[::stride] + 0.5)
    return element("polygon", {"points": corners, "class": kind})


def search_image(part: FoundPartView, longest_px: int) -> Markup:
    """The image as it was taken, in true proportions, with what was found in it drawn over."""
    rows, columns = part.image.shape
    code = base64.b64encode(jpeg(part.image, longest_px)).decode("ascii")
    picture = element(
        "image",
        {"href": f"data:image/jpeg;base64,{code}", "width": columns, "height": rows, "preserveAspectRatio": "none"},
    )
    layers = [picture]
    if len(part.contour_px):
        layers.append(_polygon(part.contour_px, "contour"))
    width = columns * part.pixel_aspect
    # The radius is given in the drawing's units, so that circles stay round on stretched pixels.
    radius = 0.008 * max(width, rows)
    dots = [
        element("circle", {"cx": (x + 0.5) * part.pixel_aspect, "cy": y + 0.5, "r": radius, "class": "dominant"})
        for x, y in part.dominant_px.tolist()
    ]
    stretched = element("g", {"transform": f"scale({part.pixel_aspect:g} 1)"}, *layers)
    title = f"Camera image of {part.label}: contour and {len(part.dominant_px)} dominant points"
    return drawing(width, rows, title, [stretched, *dots], "picture")


def histogram_chart(part: FoundPartView) -> Markup | None:
    """Grey levels of the image with the thresholds that split them; None without a histogram."""
    if not len(part.histogram):
        return None
    counts = np.sqrt(part.histogram.astype(np.float64))
    frame = AxesFrame(0.0, 255.0, 0.0, max(1.0, float(counts.max()) * 1.05), 40.0, 26.0, 466.0, 130.0)
    outline = [(0.0, 0.0), *zip(range(256), counts.tolist(), strict=True), (255.0, 0.0)]
    layers = frame_axes(frame, "grey level", "√ pixels", y_ticks=False)
    layers.append(element("path", {"d": frame.path(outline, True), "class": "bars"}))
    layers += [line for one in part.levels for line in _marked(frame, one.level, "level", one.method)]
    if part.threshold is not None:
        layers += _marked(frame, part.threshold, "threshold", f"threshold {part.threshold}")
        anchor = "start" if part.threshold < 128 else "end"
        shift = 6 if part.threshold < 128 else -6
        place: dict[str, Value] = {"x": frame.x(part.threshold) + shift, "y": 18, "text-anchor": anchor}
        layers.append(element("text", {**place, "class": "mark-label"}, f"threshold {part.threshold}"))
    return drawing(520, 200, f"Histogram of {part.label}", layers)


def _marked(frame: AxesFrame, level: int, kind: str, name: str) -> list[Markup]:
    """A vertical line at a grey level; a pointer that rests on it reads its name."""
    x = round(frame.x(level), 2)
    place: dict[str, Value] = {"x1": x, "x2": x, "y1": frame.top, "y2": frame.top + frame.height, "class": kind}
    return [element("line", place, element("title", None, name))]
