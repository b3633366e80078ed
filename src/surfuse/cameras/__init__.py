"""Cameras; every file is a plug-in."""

from surfuse.records import CameraModel

# A 1/3 inch interline sensor of 500 x 582 pixels (cells about 9.6 x 6.5 um) behind a lens of 5 mm: 51 x 42 degrees,
# so that a part of 20 cm at 1 m covers a fifth of the width. A pixel is wider than high by fy / fx = 1.46.
REFERENCE_MODEL = CameraModel(
    width_px=500,
    height_px=582,
    fx_px=520.0,
    fy_px=760.0,
    cx_px=249.5,
    cy_px=290.5,
    distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
)
