"""The probe tells how a board answers; the line's figures tell how well."""

from __future__ import annotations

import pytest

from servolink.connection import probe as probing
from servolink.connection.probe import PATIENCE, ProbeResult, probe
from servolink.doctor.line_quality import REQUESTS, LineCounts, check_line, measure
from servolink.protocol.codec import Codec
from servolink.protocol.frame import ByteOrder
from servolink.transports.base import Receiver, Transport
from servolink.transports.line_faults import Faults, FaultyTransport
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import VirtualTransport
from tests.virtual_time import run


def heard_from(board: VirtualBoard, monkeypatch: pytest.MonkeyPatch, faults: Faults | None = None) -> ProbeResult:
    def create(url: str) -> Transport:
        line = VirtualTransport(board)
        return line if faults is None else FaultyTransport(line, faults)

    monkeypatch.setattr(probing, "create", create)
    return run(probe("virtual://"))


@pytest.mark.parametrize("byte_order", ["little", "big"])
@pytest.mark.parametrize("mode", [0, 1])
def test_a_board_is_found_in_any_order_and_mode(
    byte_order: ByteOrder, mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = VirtualBoard(4, codec=Codec(byte_order))
    board.mode = mode
    board.storage.project_id = 77
    answer = heard_from(board, monkeypatch).response
    assert answer is not None
    assert (answer.byte_order, answer.transmission_mode, answer.project_id) == (byte_order, mode, 77)
    assert answer.seconds < PATIENCE
    assert board.mode == 1


def test_a_line_that_loses_everything_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    assert heard_from(VirtualBoard(4), monkeypatch, Faults(drop=1.0)) == ProbeResult(None, 0, 0)


def test_a_line_that_ends_meanwhile_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = heard_from(VirtualBoard(4), monkeypatch, Faults(unplug=5))
    assert heard.response is None
    assert "unplugged" in heard.problem


def test_what_cannot_be_opened_is_a_problem() -> None:
    assert "there is no /dev/nowhere" in run(_heard_nowhere()).problem
    assert "unknown kind of address" in run(probe("gopher://x")).problem


async def _heard_nowhere() -> ProbeResult:
    class Nowhere:
        url = "serial:///dev/nowhere"

        async def open(self, receiver: Receiver) -> None:
            from servolink.errors import OpenError

            raise OpenError("there is no /dev/nowhere")

        async def send(self, data: bytes) -> None:
            raise AssertionError

        async def close(self) -> None:
            raise AssertionError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probing, "create", lambda url: Nowhere())
        return await probe("serial:///dev/nowhere")


def test_a_clean_line_is_no_finding() -> None:
    assert list(check_line(LineCounts(1020, 0, REQUESTS, 0, 0, [0.001] * REQUESTS))) == []


def test_noise_and_missing_answers_are_counted() -> None:
    noise, answers = check_line(LineCounts(1000, 25, REQUESTS, 3, 2, [0.001] * 57))
    assert noise.observation == "25 of 1000 received bytes (2.5 %) were outside frames"
    assert answers.observation == f"3 of {REQUESTS} queries had no response in 0.5 s, and 2 responses came late"
    assert "remove the noise first" in answers.remedy
    (answers,) = check_line(LineCounts(1000, 0, REQUESTS, 3, 0, [0.001] * 57))
    assert "busy" in answers.meaning


def test_a_line_that_does_not_last_is_measured_until_its_end() -> None:
    line = run(_measured("virtual://?unplug=400"))
    assert 0 < line.requests < REQUESTS
    assert len(line.round_trips) == line.requests - 1
    (ended,) = check_line(line)
    assert (ended.check, "unplugged" in ended.observation) == ("connection", True)


async def _measured(url: str) -> LineCounts:
    return await measure(url, "little")


@pytest.mark.parametrize(("percent", "seconds"), [(0, 1.0), (50, 3.0), (90, 4.0), (100, 4.0)])
def test_percentiles(percent: int, seconds: float) -> None:
    assert LineCounts(0, 0, 0, 0, 0, [4.0, 1.0, 3.0, 2.0]).percentile(percent) == seconds
    assert LineCounts(0, 0, 0, 0, 0, []).percentile(percent) is None
