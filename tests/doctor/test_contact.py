"""The contact finds a board in any order and mode; the counts of the line say how well it answers."""

from __future__ import annotations

import pytest

from servolink.doctor import contact
from servolink.doctor.contact import ProbeResult, probe, reach, response_of
from servolink.doctor.line_quality import REQUESTS, LineCounts, check_line, measure
from servolink.errors import ConnectionLost, OpenError
from servolink.protocol import ByteOrder, Codec
from servolink.testing import Fate
from servolink.transports import Faults, FaultyTransport, Receiver, Transport
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.piped_board import PipedBoard
from tests.virtual_time import run


def heard_from(board: VirtualBoard, monkeypatch: pytest.MonkeyPatch, faults: Faults | None = None) -> ProbeResult:
    def create(url: str) -> Transport:
        line = VirtualTransport(board)
        return line if faults is None else FaultyTransport(line, faults)

    monkeypatch.setattr(contact, "create", create)
    return run(probe("virtual://"))


@pytest.mark.parametrize("byte_order", ["little", "big"])
@pytest.mark.parametrize(
    "mode", [pytest.param(0, marks=pytest.mark.virtual_only("the firmware has no old transmission mode")), 1]
)
def test_a_board_is_found_in_any_order_and_mode(
    byte_order: ByteOrder, mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = VirtualBoard(4, codec=Codec(byte_order))
    board.mode = mode
    board.storage.project_id = 77
    answer = heard_from(board, monkeypatch).response
    assert answer is not None
    assert (answer.byte_order, answer.transmission_mode, answer.project_id) == (byte_order, mode, 77)
    assert board.mode == 1


def test_a_line_that_loses_everything_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    assert heard_from(VirtualBoard(4), monkeypatch, Faults(drop=1.0)) == ProbeResult(None)


def test_a_line_that_ends_meanwhile_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = heard_from(VirtualBoard(4), monkeypatch, Faults(unplug=5))
    assert heard.response is None
    assert "unplugged" in heard.problem


def test_what_cannot_be_opened_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    class Nowhere(PipedBoard):
        async def open(self, receiver: Receiver) -> None:
            raise OpenError("there is no /dev/nowhere")

    assert "unknown kind of address" in run(probe("gopher://x")).problem
    monkeypatch.setattr(contact, "create", lambda url: Nowhere())
    assert "there is no /dev/nowhere" in run(probe("serial:///dev/nowhere")).problem


class Resetting(PipedBoard):
    """It is lost by its first frame as often as told."""

    resets = 1

    async def send(self, data: bytes) -> None:
        if Resetting.resets:
            Resetting.resets -= 1
            self.vanish()
            raise ConnectionLost("reset")
        await super().send(data)


@pytest.mark.parametrize(("resets", "is_found"), [(1, True), (2, False)])
def test_a_board_that_is_reset_by_its_opening_is_opened_once_more(
    resets: int, is_found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contact, "create", lambda url: Resetting())
    monkeypatch.setattr(Resetting, "resets", resets)
    result = run(probe("fake://board"))
    assert (result.response is not None) == is_found
    assert ("reset" in result.problem) != is_found


# --- the line -----------------------------------------------------------------------------------------------------


async def measured(board: PipedBoard, monkeypatch: pytest.MonkeyPatch) -> LineCounts:
    monkeypatch.setattr(contact, "create", lambda url: board)
    transport, connection = await reach("fake://board")
    try:
        assert (await response_of(connection)).project_id == 0
        return await measure(connection)
    finally:
        await connection.close()
        await transport.free()


@pytest.mark.parametrize(
    ("usual", "checks"),
    [
        (Fate(), []),
        (Fate(delay=0.3), []),  # slow, but nothing is late
        (Fate(delay=1.0), []),  # the same
        (Fate(copies=2), ["answers twice"]),
        (Fate(damage=lambda frame: b"temperature 21 degrees\r\n" + frame), ["text"]),
        (Fate(damage=lambda frame: b"\x01\x02\x03" + frame), ["noise"]),
    ],
    ids=["healthy", "late", "very late", "twice", "text", "noise"],
)
async def test_what_is_odd_about_a_line_is_named(
    usual: Fate, checks: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = await measured(PipedBoard(usual=usual), monkeypatch)
    assert [finding.check for finding in check_line(line)] == checks
    assert not line.unanswered
    assert (line.repeated >= REQUESTS) == (usual.copies == 2)
    assert usual.copies == 2 or not line.repeated


async def test_a_line_that_does_not_last_is_measured_until_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    class Short(PipedBoard):
        async def send(self, data: bytes) -> None:
            if len(self.sent) == 40:
                self.vanish()
            await super().send(data)

    line = await measured(Short(), monkeypatch)
    assert 0 < line.requests < REQUESTS
    (ended,) = check_line(line)
    assert (ended.check, "disconnected" in ended.observation) == ("connection", True)


def test_a_clean_line_is_no_finding() -> None:
    assert list(check_line(LineCounts(1020, 0, REQUESTS, 0, 0, [0.001] * REQUESTS))) == []


def test_noise_and_missing_answers_are_counted() -> None:
    noise, answers = check_line(LineCounts(1000, 25, REQUESTS, 3, 2, [0.001] * 57))
    assert noise.observation == "25 of 1000 received bytes (2.5 %) were outside frames"
    assert answers.observation == f"3 of {REQUESTS} queries had no response in 0.5 s, and 2 responses came late"
    assert "remove the noise first" in answers.remedy
    (answers,) = check_line(LineCounts(1000, 0, REQUESTS, 3, 0, [0.001] * 57))
    assert "busy" in answers.meaning


@pytest.mark.parametrize(("percent", "seconds"), [(0, 1.0), (50, 3.0), (90, 4.0), (100, 4.0)])
def test_percentiles(percent: int, seconds: float) -> None:
    assert LineCounts(0, 0, 0, 0, 0, [4.0, 1.0, 3.0, 2.0]).percentile(percent) == seconds
    assert LineCounts(0, 0, 0, 0, 0, []).percentile(percent) is None
