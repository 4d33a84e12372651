"""The boards and lines that benchmarks ask: they answer as real ones would, and a model of a line obeys its formula."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from msgspec.structs import astuple

from benchmarks.answers import SERVO_IDS, SERVOS, answers
from benchmarks.instant import InstantTransport, requests
from benchmarks.responder import Responder, program
from benchmarks.wire import LINES, Line, limit
from servolink.client import connect
from servolink.protocol import Codec, Query, QueryRemainPowerRequest, QueryServoListRequest, QueryServoRequest
from servolink.transports import Transport

REQUEST, RESPONSE = 10, 186  # bytes of the frames of a poll


async def ask_everything(url: str | Transport) -> None:
    async with connect(url) as board:
        assert [astuple(servo)[:7] for servo in await board.servos()] == [*map(astuple, SERVOS)]
        assert await board.servo_ids() == SERVO_IDS
        memory = await board.memory()
        assert (memory.size, memory.total_size) == (900_000, 1_000_000)
        assert await board.battery() == 80
        assert await board.project_id() == 7
        assert await board.active_joystick_table() == 1


@pytest.mark.parametrize("language", ["C", "Python"])
def test_a_responder_answers_whatever_opening_and_polling_ask(language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if language == "Python":
        monkeypatch.setattr("shutil.which", lambda _: None)
        program.cache_clear()
    other = Responder(answers())
    try:
        asyncio.run(ask_everything(other.path))
    finally:
        other.close()
        program.cache_clear()


def test_an_instant_board_answers_the_same() -> None:
    asyncio.run(ask_everything(InstantTransport()))


def test_several_frames_in_one_write_are_several_requests() -> None:
    packets: list[Query[Any]] = [QueryServoRequest(255), QueryServoListRequest(), QueryRemainPowerRequest()]
    frames = [Codec().encode(packet) for packet in packets]
    assert requests(b"".join(frames)) == [
        (packet.packet_id, len(frame)) for packet, frame in zip(packets, frames, strict=True)
    ]


def round_trip(line: Line) -> float:
    return (REQUEST + RESPONSE) / line.bytes_per_second + line.turnaround


@pytest.mark.parametrize("line", [line for line in LINES if not line.latency], ids=lambda line: line.name)
def test_a_line_asked_one_by_one_waits_for_each_round_trip(line: Line) -> None:
    assert limit(line, 1, 50) == pytest.approx(RESPONSE / line.bytes_per_second / round_trip(line))


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.name)
def test_a_line_is_full_where_enough_requests_are_on_it(line: Line) -> None:
    shares = [limit(line, depth, 1000) for depth in (1, 4, 16)]
    assert shares == sorted(shares)
    assert 0.98 < shares[-1] <= 1


def test_an_adapter_keeps_a_response_until_its_time_is_over() -> None:
    (line,) = (line for line in LINES if line.latency)
    first = REQUEST / line.bytes_per_second + line.turnaround + 1 / line.bytes_per_second
    expected = RESPONSE / line.bytes_per_second / (first + line.latency)
    whole = limit(Line("long enough", line.bytes_per_second, line.turnaround, 0.1), 1, 20)
    assert whole == pytest.approx(RESPONSE / line.bytes_per_second / (first + 0.1))
    assert limit(line, 1, 20) < expected  # its last bytes come after the first 16 ms, and wait once more
