"""A readings CSV with its sensors, part frame and outline becomes a map, and a report in words."""

from pathlib import Path

import numpy as np

import surfuse as sf

DATA = Path(__file__).parent / "data"

log = sf.read(DATA / "readings.csv")  # sensors.toml, frame.toml and outline.csv lie beside it
surface = sf.fuse(log, method="beam")

print(f"{len(log)} readings of {', '.join(log.sensors)}; part frame estimated: {log.frame_estimated}")
print(f"trust: {surface.trust}")
for finding in surface.findings:
    print(f"  {finding.code}: {finding.what}")
sigma_mm = 1e3 * surface.sigma_m
print(f"{surface.mask.sum()} cells, median sigma {np.nanmedian(sigma_mm):.2f} mm")

row, column = np.unravel_index(np.nanargmax(sigma_mm), sigma_mm.shape)
cell = surface.why(u_mm=1e3 * surface.u_m[column], v_mm=1e3 * surface.v_m[row])
print(f"least sure at u {cell.u_mm:.0f}, v {cell.v_mm:.0f} mm: {cell.height_mm:.1f} mm +- {cell.sigma_mm:.1f} mm")
print(f"  {cell.regime}; {cell.readings_used} readings reach it, {sum(cell.refused.values())} more are refused")
print("written:", surface.save("surface.nc"), surface.export("surface.ply"))
