"""Gantries against a small Marlin and a small GRBL on pseudo-terminals: what is sent, faults of board and line."""

from __future__ import annotations

import os
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from surfuse.arms.gcode import LOOKING_DOWN, Parameters, create
from surfuse.errors import ConfigError, DeviceError, SafetyStopError, SurfuseError, UnreachableError
from surfuse.geometry.poses import pose

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
DOWN = np.reshape(LOOKING_DOWN, (3, 3))
SOMEWHERE = pose(DOWN, [0.1, 0.05, 0.2])
ELSEWHERE = pose(DOWN, [0.12, 0.05, 0.2])


def board_of(dialect):
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[1] / "stand_ins"))
    from gcode_boards import Grbl, Marlin

    return {"marlin": Marlin, "grbl": Grbl}[dialect]()


def parameters(board, dialect, **changes):
    usual = Parameters(
        board.port,
        dialect,
        (0.0, 0.0, 0.0),
        (0.3, 0.3, 0.3),
        settle_s=0.0,
        answer_timeout_s=0.6,
        move_timeout_s=5.0,
        start_timeout_s=2.0,
    )
    return replace(usual, **changes)


@pytest.fixture(params=["marlin", "grbl"])
def dialect(request):
    return request.param


@pytest.fixture
def board(dialect):
    with board_of(dialect) as made:
        yield made


@pytest.fixture
def grbl():
    with board_of("grbl") as made:
        yield made


@pytest.fixture
def marlin():
    with board_of("marlin") as made:
        yield made


def test_it_goes_there_in_millimetres_on_absolute_lines(board, dialect):
    with create(parameters(board, dialect)) as arm:
        arm.move_to_pose(pose(DOWN, [0.1234567, 0.05, 0.2]))
    assert board.told.index("G21") < board.told.index("G90")
    assert ("G53 " if dialect == "grbl" else "") + "G1 X123.457 Y50.000 Z200.000 F3000" in board.told


def test_ways_towards_the_part_are_slow(board, dialect):
    with create(parameters(board, dialect, feed_mm_min=1200.0)) as arm:
        arm.move_to_pose(pose(DOWN, [0.1, 0.05, 0.02]))
        arm.move_to_pose(pose(DOWN, [0.1, 0.05, 0.0]))
        arm.move_to_pose(pose(DOWN, [0.1, 0.05, 0.02]))
    moves = [line.partition(" F")[2] for line in board.told if "G1 " in line]
    assert moves == ["3000", "1200", "3000"]


@pytest.mark.parametrize("quarters", range(4))
def test_the_machine_may_stand_anyhow_in_the_world(grbl, quarters):
    turn = Rotation.from_euler("zx", [90.0 * quarters, 90.0], degrees=True).as_matrix()
    world_from_machine = pose(turn, [1.0, -2.0, 0.3])
    place = np.array([0.01, 0.02, 0.03])
    chosen = parameters(grbl, "grbl", world_from_machine=tuple(world_from_machine.ravel()))
    with create(chosen) as arm:
        target = world_from_machine @ pose(DOWN, place)
        assert_allclose(arm.move_to_pose(target).world_from_tool, target, atol=1e-9)
    assert "G53 G1 X10.000 Y20.000 Z30.000 F3000" in grbl.told


def test_the_tool_may_look_another_way(grbl):
    sideways = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    with create(parameters(grbl, "grbl", tool_turn=sideways)) as arm:
        assert_allclose(arm.tool_state().world_from_tool[:3, 2], [1.0, 0.0, 0.0])
        with pytest.raises(UnreachableError, match="turned by"):
            arm.move_to_pose(SOMEWHERE)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (pose(DOWN, [0.31, 0.05, 0.2]), r"x = 0\.3100 m .*0 to 0\.3 m"),
        (pose(DOWN, [0.1, -0.001, 0.2]), r"y = -0\.0010 m .*0 to 0\.3 m"),
        (pose(DOWN, [0.1, 0.1, 1e300]), r"z = "),
        (pose(Rotation.from_euler("x", 3.0, degrees=True).as_matrix() @ DOWN, [0.1, 0.1, 0.1]), r"3\.00 deg.*0\.5 deg"),
        (np.full((4, 4), np.nan), "not finite"),
    ],
)
def test_a_pose_that_it_cannot_take_is_named_with_value_and_limit(board, dialect, where, words):
    with create(parameters(board, dialect)) as arm:
        with pytest.raises(UnreachableError, match=words):
            arm.move_to_pose(where)
        assert arm.reachable(np.stack([where, SOMEWHERE])).tolist() == [False, True]
    assert not [line for line in board.told if "G1 " in line]


def test_it_homes_only_when_told(dialect):
    word = {"marlin": "G28", "grbl": "$H"}[dialect]
    for home in (False, True):
        with board_of(dialect) as board:
            with create(parameters(board, dialect, home=home)):
                pass
            assert (word in board.told) is home


def test_a_locked_board_is_a_safety_stop_unless_it_may_home(grbl):
    grbl._alarm = True
    with pytest.raises(SafetyStopError, match="in alarm") as caught, create(parameters(grbl, "grbl")):
        pass
    assert "home = true" in caught.value.cure
    with create(parameters(grbl, "grbl", home=True)) as arm:
        arm.move_to_pose(SOMEWHERE)


def test_work_positions_are_read_with_their_offset(grbl):
    grbl.report, grbl.offset_mm = "WPos", (-10.0, 20.0, 5.5)
    with create(parameters(grbl, "grbl")) as arm:
        assert_allclose(arm.move_to_pose(SOMEWHERE).world_from_tool, SOMEWHERE, atol=1e-9)


def test_more_axes_than_three_do_not_matter(grbl):
    grbl.more_axes, grbl.report, grbl.offset_mm = ",7.500,-1.000", "WPos", (5.0, 0.0, 0.0)
    with create(parameters(grbl, "grbl")) as arm:
        assert_allclose(arm.move_to_pose(SOMEWHERE).world_from_tool, SOMEWHERE, atol=1e-9)


def test_reports_in_inches_are_refused(grbl):
    grbl.inches = True
    with pytest.raises(DeviceError, match=r"inches") as caught, create(parameters(grbl, "grbl")):
        pass
    assert "$13=0" in caught.value.cure


COMPLAINTS = {
    "marlin": [
        (b"Error:Printer halted. kill() called!\n", DeviceError, "Printer halted"),
        (b"!! Move out of range\n", DeviceError, "Move out of range"),
        (b"Resend: 12\n", DeviceError, "did not understand"),
        (b'echo:Unknown command: "G\x01"\nok\n', DeviceError, "does not do 'G1"),
        (b"echo:Home X first\nok\n", DeviceError, "Home X first"),
    ],
    "grbl": [
        (b"ALARM:1\r\n", SafetyStopError, "limit switch"),
        (b"ALARM:3\r\n", SafetyStopError, "reset in motion"),
        (b"ALARM:77\r\n", SafetyStopError, "GRBL 1.1 does not have"),
        (b"error:20\r\n", DeviceError, "error:20, a G-code is not supported"),
        (b"error:99\r\n", DeviceError, "GRBL 1.1 does not have"),
    ],
}


@pytest.mark.parametrize("number", range(5))
def test_what_a_board_complains_of_is_said_in_words(board, dialect, number):
    complaint, kind, words = COMPLAINTS[dialect][number]
    with create(parameters(board, dialect)) as arm:
        board.complaint = complaint
        with pytest.raises(kind, match=words) as caught:
            arm.move_to_pose(SOMEWHERE)
    assert caught.value.cure
    assert caught.value.where == board.port


def test_after_a_refused_line_it_goes_on(board, dialect):
    with create(parameters(board, dialect)) as arm:
        board.complaint = COMPLAINTS[dialect][3][0]
        with pytest.raises(DeviceError):
            arm.move_to_pose(SOMEWHERE)
        assert_allclose(arm.move_to_pose(SOMEWHERE).world_from_tool, SOMEWHERE, atol=1e-5)


def test_a_machine_that_ends_elsewhere_is_a_safety_stop_with_value_and_limit(board, dialect):
    with create(parameters(board, dialect)) as arm:
        board.slip_mm = [3.0, 0.0, 4.0]
        with pytest.raises(SafetyStopError, match=r"5\.000 mm from where it was sent, at most 0\.2 mm"):
            arm.move_to_pose(SOMEWHERE)


def test_a_machine_that_moves_by_itself_is_a_safety_stop(board, dialect):
    with create(parameters(board, dialect)) as arm:
        arm.move_to_pose(SOMEWHERE)
        arm.tool_state()
        board.push(0.0, 0.1, 0.0)
        arm.tool_state()
        board.push(0.0, 0.2, 0.0)
        for _ in range(2):
            with pytest.raises(SafetyStopError, match=r"moved by 0\.300 mm without a move, at most 0\.2 mm"):
                arm.tool_state()
        with pytest.raises(SafetyStopError, match="without a move"):
            arm.move_to_pose(ELSEWHERE)


def test_a_board_that_starts_anew_is_a_safety_stop_until_it_is_opened_again(board, dialect):
    with create(parameters(board, dialect)) as arm:
        arm.move_to_pose(SOMEWHERE)
        board.start_again()
        for _ in range(2):
            with pytest.raises(SafetyStopError, match="started anew"):
                arm.move_to_pose(ELSEWHERE)
    with create(parameters(board, dialect)) as arm:
        assert_allclose(arm.tool_state().world_from_tool, pose(DOWN, np.zeros(3)), atol=1e-9)


def test_a_start_in_the_middle_of_a_move_is_noticed(board, dialect):
    with create(parameters(board, dialect, travel_feed_mm_min=500.0)) as arm:
        threading.Timer(0.3, board.start_again).start()
        with pytest.raises(SafetyStopError, match="started anew"):
            arm.move_to_pose(SOMEWHERE)


def test_silence_is_a_device_error_and_ends(board, dialect):
    with create(parameters(board, dialect)) as arm:
        board.silent = True
        with pytest.raises(DeviceError, match=r"within 0\.6 s") as caught:
            arm.move_to_pose(SOMEWHERE)
        assert caught.value.cure


def test_a_port_without_a_board_is_a_device_error(board, dialect):
    board.silent = True
    with pytest.raises(DeviceError, match=r"no machine answers within 0\.4 s"):
        create(parameters(board, dialect, start_timeout_s=0.4)).__enter__()


def test_a_move_that_does_not_end_is_stopped(board, dialect):
    slow = create(parameters(board, dialect, travel_feed_mm_min=60.0, move_timeout_s=0.3))
    with slow as arm, pytest.raises(DeviceError):
        arm.move_to_pose(SOMEWHERE)
    board_stands = board.where()
    time.sleep(0.1)
    assert board.where() == board_stands
    assert board_stands[0] < 99.0


def test_a_late_ok_is_not_taken_for_that_of_the_next_command(board, dialect):
    with create(parameters(board, dialect)) as arm:
        board.late_s = 0.9
        with pytest.raises(DeviceError, match=r"within 0\.6 s"):
            arm.move_to_pose(SOMEWHERE)
        board.late_s = 0.0
        time.sleep(1.0)
        assert_allclose(arm.move_to_pose(ELSEWHERE).world_from_tool, ELSEWHERE, atol=1e-5)


def test_a_slow_ok_is_waited_for(board, dialect):
    with create(parameters(board, dialect)) as arm:
        board.late_s = 0.2
        assert_allclose(arm.move_to_pose(SOMEWHERE).world_from_tool, SOMEWHERE, atol=1e-5)


def test_lines_of_noise_between_the_answers_are_passed_over(board, dialect):
    board.noise = b"\xff\x00<Idle|MPos:9\r\n\x80[PRB:1\n"
    with create(parameters(board, dialect)) as arm:
        assert_allclose(arm.move_to_pose(SOMEWHERE).world_from_tool, SOMEWHERE, atol=1e-5)


def test_noise_within_the_lines_never_gives_a_wrong_place(board, dialect):
    with create(parameters(board, dialect, answer_timeout_s=0.2, start_timeout_s=0.5)) as arm:
        arm.move_to_pose(SOMEWHERE)
        for noise in (b"\xfe", b"ok", b"<Idle|MPos:1.000,2.000,", b"o" * 2000):
            board.noise = noise
            try:
                found = arm.tool_state().world_from_tool
            except SurfuseError:
                board.noise = b""
            else:
                assert_allclose(found, SOMEWHERE, atol=1e-5)
        board.noise = b""
        assert_allclose(arm.tool_state().world_from_tool, SOMEWHERE, atol=1e-5)


def test_another_thread_can_stop_a_move(board, dialect):
    with create(parameters(board, dialect, travel_feed_mm_min=500.0)) as arm:
        threading.Timer(0.2, arm.stop).start()
        with pytest.raises(SafetyStopError, match="stopped on its way"):
            arm.move_to_pose(SOMEWHERE)
        time.sleep(0.5)
        place = board.where()
        assert 0.0 < place[0] < 99.0
        assert_allclose(1e3 * arm.tool_state().world_from_tool[:3, 3], place, atol=0.01)
        assert_allclose(arm.move_to_pose(ELSEWHERE).world_from_tool, ELSEWHERE, atol=1e-5)


def test_an_exception_in_the_middle_of_a_move_stops_the_machine(board, dialect):
    arm = create(parameters(board, dialect, travel_feed_mm_min=500.0))

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), arm:  # noqa: PT012 - the arm is open when it is interrupted
        sleep = time.monotonic
        began = sleep()
        arm._opened()._check_stopped = lambda: interrupt() if sleep() - began > 0.3 else None
        arm.move_to_pose(SOMEWHERE)
    place = board.where()
    time.sleep(0.1)
    assert board.where() == place
    assert 0.0 < place[0] < 99.0


def test_a_held_machine_is_a_safety_stop(grbl):
    with create(parameters(grbl, "grbl")) as arm:
        grbl._held = True
        with pytest.raises(SafetyStopError, match="state Hold"):
            arm.tool_state()


def test_a_port_is_opened_once(board, dialect):
    with (
        create(parameters(board, dialect)) as arm,
        create(parameters(board, dialect)),
    ):
        arm.move_to_pose(SOMEWHERE)
        wrong = parameters(board, "grbl" if dialect == "marlin" else "marlin")
        with pytest.raises(ConfigError, match="different dialects"), create(wrong):
            pass
        arm.move_to_pose(ELSEWHERE)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"port": ""}, "port = ''"),
        ({"dialect": "fanuc"}, "valid: grbl, marlin"),
        ({"baud_bps": 9}, "baud_bps = 9"),
        ({"travel_min_m": (0.0, 0.4, 0.0)}, "travel of y from 0.4 to 0.3 m"),
        ({"travel_max_m": (300.0, 300.0, 300.0)}, "not millimetres"),
        ({"world_from_machine": (1.0,)}, "1 numbers; give 16"),
        ({"world_from_machine": tuple(np.diag([1.0, 1.0, -1.0, 1.0]).ravel())}, "no right-handed"),
        ({"tool_turn": tuple(np.diag([2.0, 2.0, 2.0]).ravel())}, "no right-handed"),
        ({"feed_mm_min": 0.0}, "feed_mm_min = 0"),
        ({"settle_s": -1.0}, "settle_s"),
        ({"answer_timeout_s": float("nan")}, "answer_timeout_s"),
        ({"position_tolerance_m": 0.5}, "position_tolerance_m"),
    ],
)
def test_parameters_check_themselves(changes, words):
    usual = Parameters("/dev/ttyUSB0", "grbl", (0.0, 0.0, 0.0), (0.3, 0.3, 0.3))
    with pytest.raises(ConfigError, match=words):
        replace(usual, **changes)


def test_a_port_that_is_not_there_is_a_device_error():
    pytest.importorskip("serial")
    with pytest.raises(DeviceError, match="cannot be opened") as caught:
        create(Parameters("/dev/nothing", "grbl", (0.0, 0.0, 0.0), (0.3, 0.3, 0.3))).__enter__()
    assert caught.value.cure
