"""Faults of the arm in the middle of an acquisition: a safe stop, everything scanned kept, and the scan goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from surfuse.commands.acquire import acquisition
from surfuse.commands.outcome import SilentWatcher
from surfuse.commands.servo.servo_study import LAWS
from surfuse.errors import DeviceError, SafetyStopError, SurfuseError
from surfuse.rig.devices import Rig
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.rig.simulated.servo_arm import ServoArm, ServoTwinArm
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_reader import read_log
from surfuse.runs.progress import read_progress
from surfuse.servo_cards import registers as reg
from surfuse.settings import Settings, load
from surfuse.twin.servo_card import SimulatedCard

OVERRIDES = ["scene.name=flat", "scene.azimuth_deg=-130", "scan.step_m=0.08", "array.pings=2"]
SETTINGS = load(None, [*OVERRIDES, "fusion.method=weighted_average"])
FAULTY_STOP = 4


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("servo") / "unbroken"
    assert acquisition.acquire(SETTINGS, run, SilentWatcher()).complete
    return run


def a_fault_at_a_stop(parts: list[ServoArm], happens: Callable[[SimulatedCard], None]) -> Callable[[Settings], Rig]:
    """The builder of the cell, with a fault that happens when the arm is about to leave for a stop."""

    def build(settings: Settings) -> Rig:
        cell = simulated_rig(settings)
        assert isinstance(cell.motion.arm, ServoTwinArm)
        parts.append(cell.motion.arm.parts)

        def begin(stage: str, index: int) -> None:
            cell.begin(stage, index)
            if (stage, index) == ("stop", FAULTY_STOP):
                happens(parts[-1].card)

        return replace(cell, begin=begin)

    return build


def stick(card: SimulatedCard) -> None:
    card.stick_encoder(1)


def lose_current(card: SimulatedCard) -> None:
    card.lose_amplifier(2)


def hang(card: SimulatedCard) -> None:
    card.stall(4e-3)


def die_for_a_moment(card: SimulatedCard) -> None:
    for _ in range(7):
        card.wait(1e-3)


def push_the_button(card: SimulatedCard) -> None:
    card.open_emergency_stop()


def pull_the_card(card: SimulatedCard) -> None:
    card.go_silent()


@pytest.mark.parametrize(
    ("happens", "kind", "told"),
    [
        (stick, SafetyStopError, r"encoder of joint 1 stands still at -?\d+\.\d+ deg .* \(at most 1\.72\)"),
        (lose_current, SafetyStopError, r"following error of joint 2 is -?1\d\.\d\d deg, its limit is 14\.32 deg"),
        (hang, SafetyStopError, r"heartbeat was lost: 5\.0 ms between two ticks, at most 3\.0 ms"),
        (die_for_a_moment, SafetyStopError, "watchdog was not fed in time and cut the arm power"),
        (push_the_button, SafetyStopError, "the emergency stop was pushed"),
        (pull_the_card, DeviceError, "the servo card does not answer: status register 0x0c reads 0xffff"),
    ],
)
def test_a_fault_ends_in_a_safe_stop_and_the_scan_goes_on(
    unbroken: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    map_bits: Callable[[Path], dict[str, bytes]],
    happens: Callable[[SimulatedCard], None],
    kind: type[SurfuseError],
    told: str,
) -> None:
    run, parts = tmp_path / "run", list[ServoArm]()
    with monkeypatch.context() as patch:
        patch.setattr(acquisition, "assembled", a_fault_at_a_stop(parts, happens))
        with pytest.raises(kind, match=told) as stopped:
            acquisition.acquire(SETTINGS, run, SilentWatcher())
    assert f"what was scanned is on disk, go on with 'surfuse resume {run}'" in str(stopped.value)
    card, plant = parts[0].card, parts[0].plant
    for _ in range(300):
        card.wait(1e-3)  # a card that falls silent cuts the power by itself
    card.go_silent(False)
    assert plant.brakes_on
    assert card.read(reg.STATUS_REG)[0] & reg.STATUS_POWER_ON == 0
    log = read_log(RunFolder.open(run).log)
    assert [sweep.stop for sweep in log.sweeps] == list(range(FAULTY_STOP))
    assert stopped.value.what in [event.text for event in log.events]
    assert acquisition.resume(run, SilentWatcher()).complete
    assert map_bits(run) == map_bits(unbroken)


def test_a_run_behind_the_cards_that_is_killed_goes_on_to_the_same_map(
    unbroken: Path,
    tmp_path: Path,
    map_bits: Callable[[Path], dict[str, bytes]],
    killed_at: Callable[..., None],
    sweep_places: Callable[[Path], list[int]],
) -> None:
    run = tmp_path / "run"
    words = ["acquire", "--method", "weighted_average", "--quiet", "--out", str(run)]
    for override in OVERRIDES:
        words += ["--set", override]
    killed_at(sweep_places(unbroken)[3] + 100, *words)
    progress = read_progress(run)
    assert progress is not None
    assert len(progress.done) == 3
    assert acquisition.resume(run, SilentWatcher()).complete
    assert map_bits(run) == map_bits(unbroken)


def test_the_kinematic_arm_gives_almost_the_same_map(unbroken: Path, tmp_path: Path) -> None:
    """The servo leaves errors of fractions of a millimetre, and knows of them."""
    import numpy as np

    from surfuse.exporters import nc

    run = tmp_path / "kinematic"
    settings = SETTINGS.model_copy(update={"arm": SETTINGS.arm.model_copy(update={"driver": "kinematic"})})
    assert acquisition.acquire(settings, run, SilentWatcher()).complete
    one, other = nc.read(unbroken / "surface.nc"), nc.read(run / "surface.nc")
    assert not np.array_equal(one.height_m, other.height_m)
    assert np.nanmax(np.abs(one.height_m - other.height_m)) < 2e-3


@pytest.mark.parametrize("law", LAWS)
def test_every_law_can_finish_a_scan_with_its_own_tolerance(law: str, tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"arm": SETTINGS.arm.model_copy(update={"law": law})})
    outcome = acquisition.acquire(settings, tmp_path / "run", SilentWatcher())
    assert outcome.complete
    assert isinstance(rmse_mm := outcome.summary["rmse_mm"], float)
    assert rmse_mm < 1.0


def test_a_law_that_friction_keeps_from_arriving_says_so_and_scans_with_a_wider_tolerance(tmp_path: Path) -> None:
    weak = {"law": "gravity_pd", "settle_deg": 0.0115}
    settings = SETTINGS.model_copy(update={"arm": SETTINGS.arm.model_copy(update=weak)})
    with pytest.raises(
        DeviceError, match=r"joint \d is still 0\.\d+ deg from its target after 3 s, at most 0\.011 deg"
    ):
        acquisition.acquire(settings, tmp_path / "refused", SilentWatcher())
    wider = SETTINGS.model_copy(update={"arm": SETTINGS.arm.model_copy(update={**weak, "settle_deg": 1.0})})
    outcome = acquisition.acquire(wider, tmp_path / "run", SilentWatcher())
    assert outcome.complete
    assert isinstance(rmse_mm := outcome.summary["rmse_mm"], float)
    assert rmse_mm < 1.0
