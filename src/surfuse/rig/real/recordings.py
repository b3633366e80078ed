"""The recorded devices of a cell file: one log a device, read once, played back stop by stop."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import numpy as np

from surfuse import registry
from surfuse.arms import recorded as recorded_arm
from surfuse.errors import ConfigError, DataError
from surfuse.interfaces import Arm, Clock
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.records import FloatArray, JointState
from surfuse.rig.described_sensors import described_spec
from surfuse.rig.real.recorded_poses import RecordedPoseArm
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_records import RunLog
from surfuse.sensors import recorded as recorded_sensor
from surfuse.settings import RECORDED_DRIVER, ArmSettings
from surfuse.settings.rig_tables import SensorSettings, Value

_LOG = "log"
Table = TypeVar("Table", ArmSettings, SensorSettings)


class RecordedClock:
    """The clock of the record: time stands where the device that moved or fired last stands."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Time of the record."""
        return self._now_s

    def advance(self, duration_s: float) -> None:
        """Time goes on by itself, to that of the next stop."""

    def reach(self, t_s: float) -> None:
        """Go on to the time of a stop; a log that is played back from an earlier stop goes back."""
        self._now_s = t_s


class Recordings:
    """What plays back the devices with `driver = "recorded"`; `log` is a run folder or a log, by default the arm's.

    `begin` puts all of them at a stop, so that a resumed scan plays on from where it was.
    """

    DRIVER = RECORDED_DRIVER

    def __init__(self, of_arm: dict[str, Value]) -> None:
        self._of_arm = of_arm
        self._logs: dict[Path, RunLog] = {}
        self._sensors: list[recorded_sensor.RecordedSensor] = []
        self._times_s: dict[int, float] = {}
        self.clock = RecordedClock()

    def begin(self, stage: str, index: int) -> None:
        """The stop that comes next."""
        for sensor in self._sensors:
            sensor.go_to(index)
        self.clock.reach(self._times_s.get(index, self.clock.now_s()))

    def joint_arm(self, surroundings: ArmSurroundings) -> Arm:
        """The arm whose joints were recorded.

        Raises
        ------
        ConfigError, DataError : no log is named, or it cannot be read, or it holds no joints.
        """
        log = self._log(self._of_arm, "arm")
        if any(len(sweep.joints_rad) == 0 for sweep in log.sweeps):
            raise DataError(
                "the log holds poses and no joints", where=self._name(self._of_arm), cure="leave out arm.file"
            )
        states = [JointState(sweep.joints_rad, self._begun_s(log, k)) for k, sweep in enumerate(log.sweeps)]
        around = recorded_arm.Surroundings(
            surroundings.kinematics, surroundings.limits, surroundings.clock, surroundings.guard, states=states
        )
        made = registry.parameters("arms", self.DRIVER, {"in_order": False, **_others(self._of_arm)}, "arm", around)
        assert isinstance(made, recorded_arm.Parameters)
        return recorded_arm.create(made)

    def pose_arm(self, tool_from_grip: FloatArray) -> RecordedPoseArm:
        """The arm of which the poses of the grip were recorded.

        Raises
        ------
        ConfigError, DataError : no log is named, or it cannot be read.
        """
        log = self._log(self._of_arm, "arm")
        if others := _others(self._of_arm):
            raise ConfigError(f"unknown key 'arm.{next(iter(others))}'", cure="a recorded arm without a file has 'log'")
        times_s = np.array([self._begun_s(log, k) for k in range(len(log.sweeps))])
        return RecordedPoseArm(np.array([sweep.world_from_grip for sweep in log.sweeps]), times_s, tool_from_grip)

    def sensor(self, sensor: SensorSettings, clock: Clock) -> recorded_sensor.RecordedSensor:
        """A sensor of a log; `sensor` is its name there, by default its own.

        Raises
        ------
        ConfigError, DataError : no log is named, or it cannot be read, or it has no such sensor.
        """
        where = f"sensor '{sensor.name}'"
        log = self._log({**self._of_arm, **sensor.parameters}, where)
        readings = log.readings()
        table = {"sensor": sensor.name, **_others(sensor.parameters)}
        usual = next((spec for spec in readings.specs if spec.name == table["sensor"]), None)
        around = recorded_sensor.Surroundings(
            clock=clock, spec=None if usual is None else described_spec(sensor, usual), readings=readings
        )
        made = registry.parameters("sensors", self.DRIVER, table, where, around)
        assert isinstance(made, recorded_sensor.Parameters)
        playing = recorded_sensor.create(made)
        self._sensors.append(playing)
        return playing

    def _log(self, table: dict[str, Value], where: str) -> RunLog:
        if not self._name(table):
            raise ConfigError(
                "no log is named to play back", cure="give log = 'RUN', the folder of a run or a log", where=where
            )
        path = Path(self._name(table)).resolve()
        if path not in self._logs:
            log = read_log(path)
            if not log.sweeps:
                raise DataError("a log without a sweep", where=str(path), cure="give the log of a scan")
            self._logs[path] = log
            for k, sweep in enumerate(log.sweeps):
                self._times_s.setdefault(int(sweep.stop), self._begun_s(log, k))
        return self._logs[path]

    @staticmethod
    def _name(table: dict[str, Value]) -> str:
        return str(table.get(_LOG, ""))

    @staticmethod
    def _begun_s(log: RunLog, number: int) -> float:
        """When a sweep began."""
        return float(log.sweeps[number].t_s.min())


def with_whole_log(table: Table) -> Table:
    """The table of a device with the whole path of the log that it plays back; of any other device the same."""
    name = table.parameters.get(_LOG)
    if table.driver != Recordings.DRIVER or not isinstance(name, str):
        return table
    return table.model_copy(update={"parameters": {**table.parameters, _LOG: str(Path(name).resolve())}})


def _others(table: dict[str, Value]) -> dict[str, Value]:
    return {key: value for key, value in table.items() if key != _LOG}
