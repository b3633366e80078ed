"""How long each kind of question may take."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from surfuse.bridge.messages import Question
from surfuse.errors import ConfigError

# Asking twice does no harm; a move is asked again only when the arm has said where it is.
ASKED_AGAIN = frozenset(Question) - {Question.MOVE, Question.BYE}


@dataclass(frozen=True)
class Patience:
    """Longest waits for one answer, by kind of question.

    `give_up_s`: a question that may be asked twice is asked again, on a new connection if need be, as long as all of it
    stays below this; so a dead bridge is noticed within `give_up_s` or the one answer time, whichever is longer.
    `attempts`: how often at most after answers that make no sense. `start_timeout_s`: for the first answer of a program
    that was only just started.
    """

    answer_timeout_s: float = 2.0
    reach_timeout_s: float = 4.0
    sweep_timeout_s: float = 4.0
    image_timeout_s: float = 4.0
    move_timeout_s: float = 60.0
    start_timeout_s: float = 20.0
    give_up_s: float = 4.5
    attempts: int = 3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"{field.name} = {value}", cure="give a positive number")

    def timeout_s(self, question: Question) -> float:
        """Longest wait for the answer to one question."""
        return {
            Question.REACH: self.reach_timeout_s,
            Question.SWEEP: self.sweep_timeout_s,
            Question.IMAGE: self.image_timeout_s,
            Question.MOVE: self.move_timeout_s,
        }.get(question, self.answer_timeout_s)
