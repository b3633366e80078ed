"""surfuse's end of a bridge: typed questions, checked answers, and a watch over what they say one after the other."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.bridge import answers, questions
from surfuse.bridge.askable import check_sensors, check_target, demand
from surfuse.bridge.clock import ClockFindings, ClockWatch
from surfuse.bridge.consistency import Consistency, Tolerances
from surfuse.bridge.conversation import Conversation, Tally
from surfuse.bridge.frozen_clock import FrozenClock
from surfuse.bridge.messages import (
    Ability,
    Hello,
    Image,
    MoveTo,
    Question,
    State,
    SweepAnswer,
)
from surfuse.bridge.patience import Patience
from surfuse.bridge.refusals import GarbledError
from surfuse.bridge.transport import ClosedError, SilenceError, Transport
from surfuse.bridge.unstopped import UNABLE, UNANSWERED, unanswered_move, unstopped
from surfuse.errors import DeviceError, SurfuseError
from surfuse.records import BoolArray, FloatArray

PATIENCE = Patience()
TOLERANCES = Tolerances()
_POSES_A_QUESTION = 50  # a controller that solves one in 20 ms answers within a second


@dataclass(frozen=True)
class Observation:
    """A sweep, and where the arm was before and after it."""

    before: State
    sweep: SweepAnswer
    after: State


class BridgeClient:
    """A rig behind a bridge.

    Parameters
    ----------
    transport : `TcpTransport` or `ChildTransport`.
    patience : how long answers may take, and when the bridge is given up.
    tolerances : how far answers may be from what was asked and said before.

    All methods raise DeviceError for a bridge that is gone, silent, or makes no sense, SafetyStopError for one that
    contradicts itself or refuses for safety.
    """

    def __init__(
        self, transport: Transport, patience: Patience = PATIENCE, tolerances: Tolerances = TOLERANCES
    ) -> None:
        self._watch = Consistency(tolerances, transport.name)
        self._clock, self._frozen = ClockWatch(transport.name), FrozenClock(transport.name)
        self._line = Conversation(transport, patience, self._on_connection)
        self._hello: Hello | None = None
        self._unsure = False
        self._under_way = False
        self._guided = False
        self._begun: tuple[str, int] | None = None

    def __enter__(self) -> Self:
        try:
            self._hello = self._line.open()
        except BaseException:
            self._line.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None and self._hello is not None:
                self._stop_after(error)
        finally:
            self._line.close()

    @property
    def hello(self) -> Hello:
        """What is behind the bridge."""
        if self._hello is None:
            raise DeviceError("the bridge is not open", where=self._line.where, cure="use it in a with block")
        return self._hello

    @property
    def tally(self) -> Tally:
        """What went wrong and was put right."""
        return self._line.tally

    def can(self, ability: Ability) -> bool:
        """Whether the bridge says that it can."""
        return ability in self.hello.can

    def guide(self, by_hand: bool) -> None:
        """From here on somebody else moves the arm, or nobody but surfuse does; where it stood does not count."""
        self._guided = by_hand
        self._watch.moving()

    def state(self) -> State:
        """Where the arm is; one that only surfuse moves must be where it was."""
        state = self._asked_state(Question.STATE)
        if self.hello.arm is not None and not self._guided:
            self._watch.check_rest(state)
        return state

    def reach(self, world_from_tool: FloatArray) -> BoolArray:
        """Which of the poses (N, 4, 4) the arm can take: (N,)."""
        demand(self.hello, Ability.REACH, self._line.where)
        parts = [world_from_tool[i : i + _POSES_A_QUESTION] for i in range(0, len(world_from_tool), _POSES_A_QUESTION)]
        reachable = [self._reach_of(part) for part in parts]
        return np.concatenate([np.zeros(0, dtype=np.bool_), *reachable])

    def move(self, to: MoveTo) -> State:
        """Go there and settle; the state as reached.

        Raises
        ------
        UnreachableError : the arm cannot go there, and has not moved.
        SafetyStopError : it is not where it was sent, or was stopped.
        DeviceError : it did not get there in time.
        """
        check_target(self.hello, to, self._line.where)
        self._line.ensure_connected()
        if self._unsure:
            self.state()  # nobody knows how the last move ended, or where a bridge that was started again has its arm
            self._unsure = False
        stood = self._watch.rest
        self._watch.moving()
        try:
            reached = self._sent(to)
        except (ClosedError, GarbledError, SilenceError) as lost:
            reached = self._after_lost_move(stood, to, lost)
        self._frozen.moved()
        self._watch.check_times([reached.t_s])
        self._watch.check_arrival(to, reached)
        return reached

    def sweep(self, sensors: tuple[str, ...] | None = None) -> SweepAnswer:
        """Fire these sensors (None: all) once; readings in the order of the sensors, without those that did not answer.

        Where the arm was meanwhile is not asked: see `observe`.
        """
        asked = self.hello.sensors if sensors is None else sensors
        check_sensors(self.hello, asked, self._line.where)
        fields = questions.encode_sweep(sensors)
        answer = self._line.ask(Question.SWEEP, fields, lambda got: answers.decode_sweep(got, asked))
        self._clock.asked(Question.SWEEP)
        readings = sorted(answer.readings, key=lambda reading: asked.index(reading.sensor))
        times_s = [reading.t_s for reading in readings]
        self._watch.check_times(times_s)
        self._frozen.take(times_s)
        return SweepAnswer(tuple(readings))

    def observe(self, sensors: tuple[str, ...] | None = None) -> Observation:
        """A sweep between two states.

        Raises
        ------
        SafetyStopError : an arm that only surfuse moves has moved since its last move, or while the sensors fired.
        """
        at_rest = self._watch.rest
        before = at_rest if at_rest is not None and self.hello.arm is not None else self.state()
        sweep = self.sweep(sensors)
        return Observation(before, sweep, self.state())

    def begin(self, stage: str, index: int) -> None:
        """Tell a simulated rig which stop comes next; others have nothing to begin and are not asked."""
        if self.can(Ability.STREAMS):
            self._begun = stage, index
            self._begin_again()

    def image(self) -> Image:
        """One picture."""
        demand(self.hello, Ability.IMAGE, self._line.where)
        camera = self.hello.camera
        if camera is None:
            raise DeviceError("the bridge can 'image' but has no 'camera'", where=self._line.where)
        image = self._line.ask(Question.IMAGE, {}, lambda got: answers.decode_image(got, camera))
        self._clock.asked(Question.IMAGE)
        self._watch.check_times([image.t_s])
        return image

    def stop(self) -> State:
        """Stop the arm at once, also in the middle of a move; where it is then."""
        demand(self.hello, Ability.STOP, self._line.where)
        self._watch.moving()
        state = self._asked_state(Question.STOP)
        self._unsure = False
        return state

    def measure_clock(self, questions_asked: int = 8) -> ClockFindings:
        """The bridge's clock against `time.monotonic`; every state that comes later makes it better known."""
        for _ in range(questions_asked):
            self.state()
        return self.clock()

    def clock(self) -> ClockFindings:
        """What is known now of the bridge's clock, by all states since the connection was made."""
        return self._clock.findings(time.monotonic())

    def _on_connection(self) -> None:
        """Nothing that the last connection was told holds any more."""
        self._watch.new_connection()
        self._clock.new_connection()
        self._frozen.new_connection()
        self._unsure = True
        if self._begun is not None:
            self._begin_again()

    def _begin_again(self) -> None:
        assert self._begun is not None
        stage, index = self._begun
        self._line.ask(Question.BEGIN, {"stage": stage, "index": index}, lambda got: None)

    def _asked_state(self, question: Question) -> State:
        arm = self.hello.arm
        state = self._line.ask(question, {}, lambda got: self._timed(answers.decode_state(got, arm), question))
        if question is Question.STOP:
            self._under_way = False
        self._watch.check_times([state.t_s])
        return state

    def _timed(self, state: State, question: Question) -> State:
        """The state, once its stamp was compared with this machine's clock."""
        self._clock.asked(question)
        self._clock.take(self._line.sent_s, time.monotonic(), state.t_s)
        return state

    def _reach_of(self, poses: FloatArray) -> BoolArray:
        fields = questions.encode_reach(poses)
        return self._line.ask(Question.REACH, fields, lambda got: answers.decode_reach(got, len(poses))).reachable

    def _sent(self, to: MoveTo) -> State:
        arm = self.hello.arm
        self._line.ensure_connected()
        self._under_way = True
        try:
            reached = self._line.ask_once(
                Question.MOVE,
                questions.encode_move(to),
                lambda got: self._timed(answers.decode_state(got, arm), Question.MOVE),
            )
        except (ClosedError, GarbledError, SilenceError):
            raise
        except SurfuseError:
            self._under_way = False  # it was refused
            raise
        self._under_way = False
        return reached

    def _stop_after(self, error: BaseException) -> None:
        """Stop the arm at an error; one that was under way and whose stop fails may still be moving, which is told."""
        words = UNABLE
        if self.can(Ability.STOP):
            try:
                self.stop()
                return
            except (SurfuseError, KeyboardInterrupt):
                words = UNANSWERED
        if self._under_way:
            raise unstopped(error, words) from error

    def _after_lost_move(self, stood: State | None, to: MoveTo, lost: DeviceError) -> State:
        """Ask where the arm is before anything else, and stop it when it took too long.

        Only where the line broke, and the arm has said that it is on the way, the move is sent again, once.
        """
        self._unsure = True
        too_long = isinstance(lost, SilenceError)
        question = Question.STOP if too_long and self.can(Ability.STOP) else Question.STATE
        try:
            state = self._asked_state(question)
        except DeviceError as error:
            self._under_way = False  # it is told here
            raise unanswered_move(lost, error, question is Question.STOP) from error
        self._unsure = False
        if self._watch.arrived(to, state):
            self._under_way = False
            return state
        if too_long:
            raise DeviceError(
                f"{lost.what}, and the arm is not where it was sent",
                where=lost.where,
                cure="raise move_timeout_s if the arm is slow",
            ) from lost
        if stood is not None:
            self._watch.check_on_way(stood, to, state)
        return self._sent(to)
