"""Three thousand damaged answers: no crash, no hang, no wrong number."""

import json

from mutations import ASKS, allowed_of, fuzz, question_of, rich_answer


def test_damaged_answers_end_in_an_error_of_ours_or_in_right_numbers():
    findings = fuzz(3000, seed=11)
    assert findings.crashes == []
    assert findings.wrong == []
    outcomes = findings.outcomes
    assert sum(outcomes.values()) == 3000
    # The dice reach every kind of outcome, else the test would prove nothing.
    assert outcomes["values: SafetyStopError"] > 3
    assert outcomes["values: good answer"] > 100
    assert outcomes["values: another valid answer"] > 10
    assert outcomes["stream: good answer"] > 3


def test_the_judge_knows_good_answers_from_bad_ones():
    for ask in ASKS:
        answer = rich_answer(question_of(ask))
        assert allowed_of(ask, json.dumps(answer).encode()) is not None
        assert allowed_of(ask, json.dumps({**answer, "id": 4}).encode()) is None
        assert allowed_of(ask, json.dumps({**answer, "ok": 1}).encode()) is None
    old = {**rich_answer(question_of("state")), "t_s": 999.0}
    assert allowed_of("state", json.dumps(old).encode()) is None
