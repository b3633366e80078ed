"""Arrays of a rig of your own become a map: positions, axes and ranges in, heights and their sigma out."""

from pathlib import Path

import numpy as np

import surfuse as sf

DATA = Path(__file__).parent / "data"

# Any source of arrays will do; here they are the columns of a text file.
table = np.genfromtxt(DATA / "readings.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
ranger = sf.Sensor(
    kind="ultrasonic",
    beam_full_angle_deg=13.0,
    range_min_m=0.33,
    range_max_m=4.0,
    sigma_m=0.0003,
    frequency_hz=63e3,
    aperture_m=0.04,
    dead_length_m=0.2,
)
log = sf.log(
    table["t"],
    table["sensor"],
    np.column_stack([table["px"], table["py"], table["pz"]]),
    np.column_stack([table["ax"], table["ay"], table["az"]]),
    table["range_m"],  # inf: no echo
    dict.fromkeys(("us0", "us1", "us2", "us3"), ranger),
    stop=table["stop"],
)
surface = sf.fuse(log)

print(log)
print(surface)
print(f"heights from {1e3 * np.nanmin(surface.height_m):.1f} to {1e3 * np.nanmax(surface.height_m):.1f} mm")
for finding in surface.findings:
    print(f"{finding.severity}: {finding.what}")
surface.save("surface.nc")
