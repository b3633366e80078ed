"""Makes the data of the examples with the digital twin: `python examples/data/make.py` (half a minute)."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

import surfuse as sf
from surfuse.runs.readings_csv import write_readings_csv

HERE = Path(__file__).parent


def main() -> None:
    """Scan the paper's relief; keep its readings to a hundredth of a millimetre, and its true shape."""
    with tempfile.TemporaryDirectory() as folder:
        run = sf.acquire("relief", out=Path(folder) / "run", seed=1)
        readings = run.log.readings
        rounded = dataclasses.replace(
            readings,
            t_s=np.round(readings.t_s, 3),
            position_m=np.round(readings.position_m, 5),
            axis=np.round(readings.axis, 6),
            range_m=np.round(readings.range_m, 5),
            amplitude=np.round(readings.amplitude, 3),
        )
        write_readings_csv(HERE / "readings.csv", rounded, run.log.scan.scene(), overwrite=True)
        # Measured with a ruler, as on a rig without a camera.
        (HERE / "outline.csv").write_text("u,v\n-0.1,0\n0.1,0\n0.1,0.2\n-0.1,0.2\n")
        (HERE / "truth.ply").write_bytes((run.path / "truth.ply").read_bytes())


if __name__ == "__main__":
    main()
