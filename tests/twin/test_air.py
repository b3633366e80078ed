import json
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.physics.air import speed_of_sound
from surfuse.twin.acoustics.air import AirParameters, absorption, absorption_db_per_m

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "acoustics_reference.json").read_text())


def test_absorption_is_that_of_the_standard() -> None:
    for row in REFERENCE["iso9613_1_dB_per_m"]:
        air = AirParameters(temperature_c=row["T_C"], humidity_percent=row["RH"])
        assert absorption_db_per_m(air, row["f"]) == pytest.approx(row["alpha"], rel=1e-4)


def test_speed_of_sound_is_that_of_the_standard() -> None:
    for row in REFERENCE["speed_of_sound"]:
        assert speed_of_sound(row["T_C"]) == pytest.approx(row["iso9613"], rel=1e-9)


def test_one_kelvin_is_0_17_percent() -> None:
    assert speed_of_sound(21.0) / speed_of_sound(20.0) - 1.0 == pytest.approx(1.7e-3, abs=5e-5)


def test_nepers_and_decibels_agree() -> None:
    air = AirParameters()
    assert 20.0 * np.log10(np.exp(absorption(air, 63e3))) == pytest.approx(absorption_db_per_m(air, 63e3))


@pytest.mark.parametrize("wrong", [{"temperature_c": 99.0}, {"humidity_percent": -1.0}, {"pressure_kpa": float("nan")}])
def test_impossible_air_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="give"):
        AirParameters(**wrong)
