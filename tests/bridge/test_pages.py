"""What the documentation shows of the bridge is what it does."""

import contextlib
import io
import json
import re
import shutil
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest

from surfuse.arms.bridge import Parameters
from surfuse.bridge import answers, questions
from surfuse.bridge.consistency import Tolerances
from surfuse.bridge.fields import Fields
from surfuse.bridge.messages import Ability, ArmKind, ArmOfBridge, CameraOfBridge, Question, Refusal
from surfuse.bridge.patience import Patience
from surfuse.bridge.refusals import error_of
from surfuse.bridge.strict_json import decode_line

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "docs" / "reference" / "bridge.md").read_text("utf-8")
HOW_TO = (ROOT / "docs" / "how-to" / "own_bridge.md").read_text("utf-8")
EXAMPLES = ROOT / "examples" / "bridges"
PAIRS = [
    block.strip().splitlines() for block in re.findall(r"^```json\n(.*?)^```", REFERENCE, re.DOTALL | re.MULTILINE)
]


def code_after(mark):
    return re.search(rf"<!-- {re.escape(mark)} -->\n```python\n(.*?)^```", HOW_TO, re.DOTALL | re.MULTILINE).group(1)


def read_question(fields, kind):
    match kind:
        case Question.REACH:
            return questions.decode_reach(fields)
        case Question.MOVE:
            return questions.decode_move(fields)
        case Question.SWEEP:
            return questions.decode_sweep(fields, ("us0", "us1"))
        case _:
            return None


def read_answer(fields, kind):
    arm = ArmOfBridge(ArmKind.JOINTS, 6)
    if not fields.flag("ok"):
        return error_of(fields, kind, "bridge")
    match kind:
        case Question.HELLO:
            return answers.decode_hello(fields)
        case Question.STATE | Question.MOVE | Question.STOP:
            return answers.decode_state(fields, arm)
        case Question.REACH:
            return answers.decode_reach(fields, 2)
        case Question.SWEEP:
            return answers.decode_sweep(fields, ("us0", "us1"))
        case Question.IMAGE:
            return answers.decode_image(fields, CameraOfBridge(4, 3))
        case Question.BEGIN | Question.BYE:
            return fields


@pytest.mark.parametrize(("asked", "answered"), PAIRS)
def test_an_example_of_the_reference_is_understood(asked, answered):
    question, answer = Fields(decode_line(asked.encode())), Fields(decode_line(answered.encode()))
    kind = questions.decode_kind(question)
    assert question.whole("id") == answer.whole("id")
    read_question(question, kind)
    assert read_answer(answer, kind) is not None


def test_the_reference_shows_every_question_and_every_optional_field():
    assert {json.loads(asked)["do"] for asked, _ in PAIRS} == {question.value for question in Question}
    hello = read_answer(Fields(json.loads(PAIRS[0][1])), Question.HELLO)
    assert hello.can == frozenset(Ability)
    for refusal in Refusal:
        assert f"| `{refusal.value}` |" in REFERENCE


def test_the_reference_names_every_limit_as_it_is():
    for record in (Patience(), Tolerances()):
        for field in fields(record):
            if field.name != "attempts":
                assert f"`{field.name}`" in REFERENCE
    assert "4.5 s (`give_up_s`)" in REFERENCE
    assert Patience().give_up_s == 4.5
    assert (Patience().answer_timeout_s, Patience().sweep_timeout_s, Patience().move_timeout_s) == (2.0, 4.0, 60.0)
    assert (Tolerances().position_tolerance_m, Tolerances().angle_tolerance_rad) == (0.005, 0.03)
    cell = Parameters(address="tcp://127.0.0.1:5005")
    assert cell.tolerances() == Tolerances()
    assert cell.patience() == Patience()


def test_the_how_to_holds_the_whole_minimal_bridge():
    assert code_after("minimal.py") == (EXAMPLES / "minimal.py").read_text("utf-8")


def test_the_how_to_runs_and_prints_what_it_says(tmp_path, monkeypatch):
    if shutil.which("python3") is None:
        pytest.skip("the page says python3")
    (tmp_path / "minimal.py").write_text(code_after("minimal.py"), "utf-8")
    monkeypatch.chdir(tmp_path)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code_after("try it"), "own_bridge.md", "exec"), {})
    printed = re.search(r"It prints\n\n```\n(.*?)```", HOW_TO, re.DOTALL).group(1)
    assert out.getvalue() == printed


def test_the_files_that_the_how_to_names_exist():
    for name in re.findall(r"`(examples/bridges/\w+\.py)`", HOW_TO):
        assert (ROOT / name).is_file(), name
    named = set(re.findall(r"`examples/bridges/(\w+\.py)`", HOW_TO))
    assert named == {path.name for path in EXAMPLES.glob("*.py")} - {"rotations.py"}


def test_the_cell_file_of_the_how_to_names_the_sensors_of_its_bridge():
    cell = tomllib.loads(re.search(r"^```toml\n(.*?)^```", HOW_TO, re.DOTALL | re.MULTILINE).group(1))
    assert [sensor["name"] for sensor in cell["sensor"]] == ["us0"]
    assert cell["arm"]["driver"] == "bridge"
