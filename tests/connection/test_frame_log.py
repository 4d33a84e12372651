"""Frames in the log: decoded, with their times, and only when somebody reads it; and text between frames."""

from __future__ import annotations

import logging

import pytest

from servolink import connect
from servolink.connection.taps import TextLog
from servolink.protocol import (
    AddActionRequest,
    ByteOrder,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
    encode_frame,
)
from servolink.testing import Fate
from tests.client.piped_board import PipedBoard, connected
from tests.virtual_time import run


def test_each_frame_is_logged_decoded_and_with_its_time(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with connected(PipedBoard(servos=2, usual=Fate(delay=0.25))) as connection:
            caplog.set_level(logging.DEBUG, "servolink")  # also after the connection was opened
            await connection.request(QueryServoListRequest())

    run(main())
    assert caplog.messages == [
        "fake://board 0.0000 s -> QueryServoListRequest()",
        "fake://board 0.2500 s <- QueryServoListResponse(servo_id_list=(1, 2))",
    ]


def test_nothing_is_logged_at_info(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with connected(PipedBoard()) as connection:
            await connection.request(QueryServoListRequest())

    caplog.set_level(logging.INFO)
    run(main())
    assert not caplog.messages


def test_content_that_makes_no_packet_is_logged_as_hex(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        board = PipedBoard()
        async with connected(board) as connection:
            log = connection.answers.frame_log
            log.received((QueryServoListResponse.packet_id, b"\x09\x01"))
            log.received((60_000, b""))

    caplog.set_level(logging.DEBUG, "servolink")
    run(main())
    assert caplog.messages[0].endswith(": 09 01")
    assert "no packet has the id 60000" in caplog.messages[1]


def test_hostile_and_endless_captions_cannot_harm_the_reader_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with connected(PipedBoard()) as connection:
            log = connection.answers.frame_log
            log.sent(connection.codec.encode(AddActionRequest(1, "\u202e\x1b[2J", ()), unchecked=True))
            log.sent(connection.codec.encode(AddActionRequest(1, "Wave", (Step(1, 90, 50),) * 200)))

    caplog.set_level(logging.DEBUG, "servolink")
    run(main())
    assert caplog.messages[0].isprintable()
    assert len(caplog.messages[1]) < 1_100
    assert caplog.messages[1].endswith(" characters)")


BOOTED, COLOURED, NOISE = b"booted in 12 ms\r\n", b"\x1b[31mlow voltage 6.1 V\x1b[0m\r\n", b"\x01\x02\xfe\xfd\x05\n"


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_text_between_frames_is_logged_at_info_line_by_line_and_escaped(
    byte_order: ByteOrder, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    log = TextLog("fake://board", byte_order)
    frame = encode_frame(20011, b"\x02\x01\x02", byte_order)
    for chunk in (BOOTED[:7], frame, frame[:5], frame[5:] + BOOTED[7:], COLOURED + NOISE + frame):
        log.received(chunk)
    assert caplog.messages == [
        "fake://board sends text: booted in 12 ms",
        "fake://board sends text: \\x1b[31mlow voltage 6.1 V\\x1b[0m",
    ]


def test_endless_text_is_logged_in_pieces(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    log = TextLog("fake://board", "little")
    for _ in range(10):
        log.received(b"x" * 101)
    assert all(len(message) < 250 for message in caplog.messages)
    assert sum(message.count("x") for message in caplog.messages) >= 1000


@pytest.mark.parametrize("level", [logging.INFO, logging.WARNING])
async def test_a_connected_board_is_heard_from_its_first_byte_on(level: int, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(level)
    transport = PipedBoard(usual=Fate(damage=lambda frame: BOOTED + frame))
    async with connect(transport):
        pass
    assert any("booted in 12 ms" in message for message in caplog.messages) == (level == logging.INFO)
