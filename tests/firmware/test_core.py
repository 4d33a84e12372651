"""Core of the firmware: frames, pulses, macros and buttons."""

from __future__ import annotations

import json
import random
import struct
from itertools import pairwise
from time import process_time
from typing import Any

import pytest

from servolink.protocol import FrameParser
from tests.firmware.conversations import frame
from tests.firmware.host import PERIOD, HostBoard, needs_compiler
from tests.protocol.declared import DATA

pytestmark = needs_compiler

NO_RESPONSE = {10050, 20050, 20060}
READY = frame(20030, bytes([255, 1, 1]))
STOP = frame(20030, bytes([255, 0, 1]))
RELEASE = frame(20030, bytes([255, 1, 0]))


def move(*steps: tuple[int, int, int]) -> bytes:
    """Return the request for a movement: servo, degrees and 10 ms for each."""
    return frame(20050, bytes([len(steps)]) + b"".join(struct.pack("<Bhh", *step) for step in steps))


def add_action(action_id: int, *steps: tuple[int, int, int]) -> bytes:
    """Return the request to add an action."""
    content = struct.pack("<i32sH", action_id, b"action", len(steps))
    return frame(30030, content + b"".join(struct.pack("<Bhh", *step) for step in steps))


def add_macro(macro_id: int, *commands: tuple[int, int, int, int]) -> bytes:
    """Return the request to add a macro: id or ms, type, ratio and loop for each command."""
    content = struct.pack("<i32sH", macro_id, b"macro", len(commands))
    return frame(30070, content + b"".join(struct.pack("<iBBhi", *command, 0) for command in commands))


def run_macro(macro_id: int) -> bytes:
    """Return the request to run a macro."""
    return frame(30090, struct.pack("<i", macro_id))


def answers(sent: bytes) -> list[tuple[int, bytes]]:
    """Return id and content of frames."""
    return [(each[0], bytes(each[1])) for each in FrameParser().feed(sent)]


def test_every_golden_request_gets_its_response(board: HostBoard) -> None:
    vectors = json.loads((DATA / "vectors.json").read_text("utf-8"))
    board.run(0.5)
    asked = 0
    for vector in vectors:
        if vector["byte_order"] == "little" and vector["id"] % 10 == 0:
            found = answers(board.ask(bytes.fromhex(vector["frame"])))
            is_odd = vector["id"] in {20030, 20040} and not found  # a servo or a flag that does not exist
            assert [each[0] for each in found] == [vector["id"] + 1] or vector["id"] in NO_RESPONSE or is_odd
            asked += 1
    assert asked > 90


@pytest.mark.parametrize("size", [1, 2, 7, 4096])
def test_frames_may_be_cut_anywhere(board: HostBoard, size: int) -> None:
    stream = b"\x13\x4c" + frame(10050, frame(20010) * 3) + b"noise" + frame(20010) + b"\x13\x4c\x05" + frame(10040)
    for at in range(0, len(stream), size):
        board.receive(stream[at : at + size])
    assert [each[0] for each in answers(board.transmit())] == [20011, 10041]


def test_a_damaged_movement_moves_nothing(ready: HostBoard) -> None:
    data = move((1, 90, 0), (2, 90, 0))
    for at in range(len(data)):
        for bit in range(8):
            ready.receive(data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])
            ready.run(0.3, 30_000)
            assert ready.pulses == [1500] * 16


def test_a_request_within_a_damaged_frame_is_found(board: HostBoard) -> None:
    damaged = bytearray(frame(10050, frame(20010)))
    damaged[-1] ^= 1
    assert [each[0] for each in answers(board.ask(bytes(damaged)))] == [20011]


def test_a_frame_that_never_ends_delays_a_stop_by_five_milliseconds_and_its_answer_more(ready: HostBoard) -> None:
    ready.receive(move((1, 90, 200)))
    ready.run(0.5)
    ready.receive(frame(10050, bytes(60_000))[:20] + STOP)
    assert ready.run(0.006) == b""
    stopped = ready.pulses[0]
    assert answers(ready.run(1)) == [(20031, STOP[8:-1])], "after a quarter second"
    assert 1500 < ready.pulses[0] == stopped < 2500


def test_all_stops_within_half_a_frame_act_and_the_strongest_counts(ready: HostBoard) -> None:
    stops = [frame(20030, bytes([servo, servo % 2, 0 if servo % 2 else 1])) for servo in range(1, 17)]
    ready.receive(move(*((servo, 90, 200) for servo in range(1, 17))))
    ready.run(0.5)
    ready.receive(frame(10050, bytes(60_000))[:20] + b"".join(stops) + frame(20030, b"\1\0\1") + STOP[:-1] + b"\0")
    ready.run(0.022)
    stopped = list(ready.pulses)
    assert [not width for width in stopped] == [servo % 2 == 1 for servo in range(1, 17)]
    ready.run(0.1)
    assert ready.pulses == stopped


def test_a_stop_within_a_whole_frame_is_its_content(ready: HostBoard) -> None:
    ready.receive(move((1, 90, 200)))
    ready.receive(frame(10050, RELEASE * 3) + frame(10050, STOP))
    ready.run(2.1)
    assert ready.pulses[0] == 2500


@pytest.mark.parametrize("end", range(-8, 9, 4))
def test_a_stop_that_has_acted_does_not_stop_what_comes_later(ready: HostBoard, end: int) -> None:
    ready.detach()  # so that it is known where the bytes are: the stop is at the end of those that can be kept
    filled = 65535 + 9 + 8192 + end - len(STOP)
    ready.receive(frame(10050, bytes(40_000)) + frame(10050, bytes(filled - 40_000 - 18)) + STOP)
    ready.receive(READY + move((1, 90, 20)))
    ready.run(0.5)
    assert ready.pulses[0] == 2500


def test_any_flood_takes_a_time_in_proportion_to_its_length(board: HostBoard) -> None:
    nested = frame(10050, bytes(65_000))[:8] * 20_000
    noise = random.Random(0).randbytes(len(nested))
    times = []
    for flood in (noise, nested):
        begun = process_time()
        for at in range(0, len(flood), 64):
            board.receive(flood[at : at + 64])
        times.append(process_time() - begun)
    assert times[1] < 30 * times[0] + 0.5
    board.run(0.3, 50_000)
    assert answers(board.ask(frame(20010)))[-1][0] == 20011


def test_a_host_that_reads_nothing_loses_requests_but_no_stop(ready: HostBoard) -> None:
    ready.receive(move((1, 90, 500)))
    ready.receive(frame(20020, b"\xff") * 1000)
    ready.run(0.0)
    ready.tick(ready.fields.now + 1_000_000)
    ready.receive(STOP)
    held = ready.pulses[0]
    for _ in range(100):
        ready.tick(ready.fields.now + 20_000)
    assert ready.pulses[0] == held < 2500
    assert {each[0] for each in answers(ready.transmit() + ready.run(1))} == {20021}


def test_servos_come_up_released_and_obey_when_they_are_held(board: HostBoard) -> None:
    board.receive(move((1, 45, 10)))
    board.run(0.2)
    assert board.pulses == [0] * 16
    assert answers(board.ask(frame(20020, b"\x01")))[0][1] == struct.pack("<BBhhhhBB", 1, 1, 0, 0, 0, 0, 0, 0)
    board.ask(READY)
    board.run(0.2)
    assert board.pulses == [0] * 16, "it must not jump to an angle for which nobody asked"
    board.receive(move((1, 45, 10)))
    widths = [(board.run(PERIOD, 20_000), board.pulses[0])[1] for _ in range(55)]
    made = [width for width in widths if width]
    assert widths[:25].count(0) >= 18, "at first most pulses are left out"
    assert made == sorted(made)
    assert widths[-1] == 2000
    assert widths[45] < 2000, "the first movement takes a second"


def test_a_movement_is_linear_and_ends_in_time(ready: HostBoard) -> None:
    ready.receive(move((1, 90, 100), (2, -90, 50)))
    widths = [(ready.run(PERIOD, 2000), list(ready.pulses))[1] for _ in range(55)]
    assert all(abs((after[0] - before[0]) - 20) < 0.1 for before, after in pairwise(widths[1:49]))
    assert all(abs((after[1] - before[1]) + 40) < 0.1 for before, after in pairwise(widths[1:24]))
    assert widths[51][:3] == [2500, 500, 1500]


@pytest.mark.parametrize(("asked", "width"), [(91, 2500), (-400, 500), (32767, 2500), (-32768, 500), (45, 2000)])
def test_no_pulse_leaves_the_range(ready: HostBoard, asked: int, width: float) -> None:
    ready.receive(move((3, asked, 0)))
    ready.run(0.05)
    assert ready.pulses[2] == width


def test_a_correction_shifts_the_next_movement(ready: HostBoard) -> None:
    ready.ask(frame(30110, struct.pack("<HBh32s", 1, 4, -9, b"elbow")))
    ready.run(0.1)
    assert ready.pulses[3] == 1500
    ready.receive(move((4, 0, 0)))
    ready.run(0.05)
    assert ready.pulses[3] == 1400
    assert struct.unpack_from("<h", answers(ready.ask(frame(20020, b"\x04")))[0][1], 2) == (0,)


@pytest.mark.parametrize("correction", [-32677, 32677, 32678])
def test_a_correction_as_large_as_can_be_shifts_the_angle_and_does_not_wrap_it(
    ready: HostBoard, correction: int
) -> None:
    assert answers(ready.ask(frame(30110, struct.pack("<HBh32s", 1, 4, correction, b""))))[0][1] == b"\1"
    for asked in (-32768, 0, 32767):
        ready.receive(move((4, asked, 0)))
        ready.run(0.05)
        told = struct.unpack_from("<h", answers(ready.ask(frame(20020, b"\4")))[0][1], 2)[0]
        assert told == (ready.pulses[3] - 1500) * 0.09 - correction


@pytest.mark.parametrize(("request_", "width"), [(STOP, 1750.0), (RELEASE, 0.0)])
def test_stop_and_release_act_at_once_and_end_the_macro(ready: HostBoard, request_: bytes, width: float) -> None:
    ready.ask(add_action(1, (1, 90, 100)))
    ready.ask(add_macro(1, (1, 0, 100, 1), (1, 0, 100, 30)))
    ready.ask(run_macro(1))
    ready.run(0.25)
    ready.receive(request_)
    assert ready.pulses[0] == pytest.approx(width, abs=25)
    stopped = ready.pulses[0]
    ready.ask(READY)
    ready.run(3)
    assert ready.pulses[0] == stopped


def test_a_macro_keeps_time_with_ratio_loop_delay_and_nesting(ready: HostBoard) -> None:
    ready.ask(add_action(1, (1, 90, 20)))
    ready.ask(add_action(2, (1, -90, 20), (2, 30, 10)))
    ready.ask(add_macro(1, (1, 0, 50, 1), (100, 1, 100, 2), (2, 0, 100, 1)))  # 400 + 200 + 200 ms
    ready.ask(add_macro(2, (1, 2, 50, 2), (1, 0, 100, 1)))  # 2 * 1600 + 200 ms
    assert answers(ready.ask(run_macro(2)))[0][1] == b"\1"
    at = {}
    for moment in range(0, 3500, 10):
        at[moment] = ready.pulses[0]
        ready.run(0.01, 1000)
    assert [at[moment] for moment in (830, 1190, 2430, 2790, 3430)] == [2500] * 5
    assert all(2400 < at[moment] < 2500 for moment in (790, 2390))
    assert all(500 <= at[moment] < 570 for moment in (1600, 3200))


@pytest.mark.parametrize(
    "commands",
    [[(9, 0, 100, 1)], [(9, 2, 100, 1)], [(5, 2, 100, 1)], [(1, 0, 100, 1), (6, 2, 100, 1)]],
    ids=["no action", "no macro", "itself", "itself through another"],
)
def test_an_incomplete_macro_or_a_circle_is_refused(ready: HostBoard, commands: list[Any]) -> None:
    ready.ask(add_action(1, (1, 90, 0)))
    ready.ask(add_macro(6, (5, 2, 100, 1)))
    ready.ask(add_macro(5, *commands))
    assert answers(ready.ask(run_macro(5)))[0][1] == b"\0"
    ready.run(0.5)
    assert ready.pulses == [1500] * 16


def test_the_last_step_of_a_servo_counts(ready: HostBoard) -> None:
    ready.receive(move((1, -90, 0), (2, 45, 0), (1, 90, 100)))
    ready.run(0.02)
    assert ready.pulses[0] == pytest.approx(1500, abs=25), "no jump to the first one"
    ready.run(1.1)
    assert ready.pulses[:2] == [2500, 2000]


def test_a_running_macro_sees_the_records_as_they_were(ready: HostBoard) -> None:
    ready.ask(add_action(1, (1, 90, 30)))
    ready.ask(add_action(2, (1, -90, 30)))
    ready.ask(add_macro(1, (1, 0, 100, 1), (2, 0, 100, 1)))
    ready.ask(run_macro(1))
    ready.ask(frame(30080, struct.pack("<i", 1)))
    ready.ask(add_action(2, (1, 0, 30)))
    ready.run(1)
    assert ready.pulses[0] == 500


@pytest.mark.parametrize(
    "refused",
    [
        add_action(0, (1, 0, 1)),
        add_action(1, (1, 0, -1)),
        add_macro(1, (1, 3, 100, 1)),
        add_macro(1, (1, 0, 0, 1)),
        add_macro(1, (1, 0, 101, 1)),
        add_macro(1, (1, 0, 100, -1)),
        add_macro(1, (-1, 1, 100, 1)),
        frame(30110, struct.pack("<HBh32s", 1, 17, 0, b"")),
        frame(30110, struct.pack("<HBh32s", 1, 1, -32768, b"")),
        frame(30110, struct.pack("<HBh32s", 1, 16, -32678, b"")),
        frame(30110, struct.pack("<HBh32sBh32s", 2, 1, 0, b"", 2, 32679, b"")),
        frame(40050, struct.pack("<i", 1)),
        frame(40070, b"\2"),
    ],
)
def test_values_out_of_the_document_are_refused(board: HostBoard, refused: bytes) -> None:
    assert answers(board.ask(refused))[0][1] == b"\0"


def _press(board: HostBoard, seconds: float) -> list[tuple[int, bytes]]:
    board.fields.pressed = 1 << 2
    sent = board.run(seconds)
    board.fields.pressed = 0
    return answers(sent + board.run(0.1))


def test_buttons_tell_of_press_long_press_and_release_after_a_subscription(board: HostBoard) -> None:
    assert _press(board, 1.5) == []
    board.ask(frame(40070, b"\1"))
    assert _press(board, 0.01) == [], "shorter than it may bounce"
    assert _press(board, 0.5) == [(40081, b"\3\0\0\0\1"), (40081, b"\3\0\0\0\4")]
    assert [content[4] for _, content in _press(board, 1.2)] == [1, 2, 4]


def test_buttons_that_are_pressed_together_all_tell_of_it(board: HostBoard) -> None:
    board.ask(frame(40070, b"\1"))
    board.fields.pressed = 0xFF
    pressed = answers(board.run(0.5))
    board.fields.pressed = 0
    assert sorted(pressed) == [(40081, bytes([button, 0, 0, 0, 1])) for button in range(1, 9)]
    assert sorted(answers(board.run(0.5))) == [(40081, bytes([button, 0, 0, 0, 4])) for button in range(1, 9)]


@pytest.mark.parametrize("uninterruptible", [0, 1])
def test_buttons_run_the_macros_of_the_active_table(ready: HostBoard, uninterruptible: int) -> None:
    for number, angle in enumerate((90, -90, 45), 1):
        ready.ask(add_action(number, (number, angle, 50)))
        ready.ask(add_macro(number, (number, 0, 100, 1)))
    ready.ask(add_macro(2, (2, 0, 100, 1), (2, 0, 100, 1), (500, 1, 100, 1), (1000, 1, 100, 1), (2, 0, 100, 1)))
    button = struct.pack("<I32siiiB", 3, b"button", 1, 2, 3, uninterruptible)
    ready.ask(frame(40030, struct.pack("<i32sH", 1, b"table", 1) + button))
    _press(ready, 1.3)
    assert ready.pulses[0] == 2500
    ready.run(0.6)
    assert ready.pulses[2] == (1500 if uninterruptible else 2000)
    ready.run(3)
    assert ready.pulses[2] == 2000


def test_the_battery_is_reported_in_permil(board: HostBoard) -> None:
    for millivolts, permil in ((8400, 1000), (7200, 500), (6000, 0), (5000, 0), (9000, 1000)):
        board.fields.millivolts = millivolts
        assert answers(board.ask(frame(10040)))[0][1] == struct.pack("<h", permil)
