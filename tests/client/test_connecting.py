"""Connect: how a board is opened and closed, with which options, and what is counted."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.errors import (
    ConnectionLost,
    InvalidAddress,
    OpenError,
    RequestTimeout,
    ServolinkError,
    TransportUnavailable,
)
from servolink.protocol import (
    ACTION,
    Action,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
)
from servolink.testing import Fate
from servolink.transports import Receiver
from servolink.virtual import VirtualTransport
from tests.client.piped_board import LOST, PipedBoard, lie, now, opened

# --- opening and closing ------------------------------------------------------------------------------------------


async def test_await_opens_and_the_caller_closes_once_or_twice() -> None:
    board = await connect("virtual://?servos=1")
    assert await board.servo_ids() == (1,)
    await board.close()
    await board.close()
    with pytest.raises(ConnectionLost, match="closed by this program"):
        await board.servo_ids()


async def test_one_async_with_at_a_time() -> None:
    connecting = connect("virtual://?servos=1")

    async def enter() -> Board:
        async with connecting as board:
            await board.servo_ids()
            return board

    async with connecting as board:
        with pytest.raises(RuntimeError, match=r"used by another `async with`; call connect again"):
            await enter()
        assert await board.servo_ids() == (1,)
    assert repr(board).endswith("closed>")
    outcomes = await asyncio.gather(enter(), enter(), return_exceptions=True)  # while the first one opens
    assert [type(outcome) for outcome in outcomes] == [Board, RuntimeError]


async def test_async_with_may_be_entered_again_after_an_opening_that_failed() -> None:
    connecting = connect("tcp://127.0.0.1:1")
    for _ in range(2):
        with pytest.raises(OpenError):
            await connecting.__aenter__()


async def test_async_with_closes_also_after_an_error() -> None:
    fake = PipedBoard()
    with pytest.raises(KeyError):
        async with opened(fake):
            raise KeyError
    assert fake.closed == 1


async def test_the_end_of_async_with_fails_what_still_waits() -> None:
    fake = PipedBoard(usual=LOST)
    async with opened(fake) as board:
        waiting = asyncio.create_task(board.servo_ids())
        await asyncio.sleep(0.1)
    with pytest.raises(ConnectionLost, match="closed by this program"):
        await waiting


async def test_closing_takes_no_longer_than_a_second_though_the_board_is_silent() -> None:
    fake = PipedBoard()
    board = await connect(fake, patience=15)
    await board.button_events().__aenter__()
    events = board.button_events()
    await events.__aenter__()
    fake.usual = LOST
    waiting = asyncio.create_task(board.servo_ids())
    await asyncio.sleep(0.1)
    begun = now()
    await board.close()
    assert now() - begun <= 1
    await asyncio.wait((waiting,))
    assert isinstance(waiting.exception(), ConnectionLost)


async def test_who_is_cancelled_while_closing_has_closed() -> None:
    fake = PipedBoard()
    board = await connect(fake)
    events = board.button_events()
    await events.__aenter__()
    fake.plan(SubscribeButtonEventRequest, LOST)
    closing = asyncio.create_task(board.close())
    await asyncio.sleep(0.02)
    closing.cancel()
    await asyncio.wait((closing,))
    assert closing.cancelled()
    assert fake.closed == 1


async def test_a_board_whose_closing_fails_is_closed_for_all_who_follow_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(_: VirtualTransport) -> None:
        raise ServolinkError("it cannot be saved")

    board = await connect("virtual://")
    monkeypatch.setattr(VirtualTransport, "_close", fail)
    states, events = board.states(), board.button_events()
    assert await anext(states) == "connected"
    waiting = asyncio.ensure_future(anext(events))
    await asyncio.sleep(0.1)
    with pytest.raises(ServolinkError, match="cannot be saved"):
        await board.close()
    assert [state async for state in states][-1] == "closed"
    with pytest.raises(StopAsyncIteration):
        await waiting


async def test_a_board_that_vanishes_while_idle_is_gone_for_the_next_who_asks() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servo_ids()
        fake.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await board.move({1: 0}, duration=1)
    assert fake.closed == 1


async def test_a_board_that_cannot_be_opened_says_so_and_leaves_nothing_open() -> None:
    class Busy(PipedBoard):
        async def open(self, receiver: Any) -> None:
            raise OpenError("fake://board: in use by another program; close it")

    with pytest.raises(OpenError, match="in use"):
        async with connect(Busy()):
            pytest.fail("it was opened")
    with pytest.raises(TransportUnavailable, match="unknown kind of address"):
        await connect("carrier-pigeon://roof")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"patience": 0}, r"patience must be 0\.001\.\.3600 seconds, not 0"),
        ({"patience": float("inf")}, "patience must be .* not inf"),
        ({"patience": 10**5000}, "patience must be .* not this int"),
        ({"patience": -1}, "patience"),
        ({"patience": float("nan")}, "patience must be .* not nan"),
        ({"depth": 0}, r"depth must be 1\.\.64, not 0"),
        ({"depth": 65}, r"depth must be 1\.\.64, not 65"),
        ({"transmission_mode": 0}, "transmission_mode must be 'auto', 'keep' or 1, not 0"),
        ({"transmission_mode": True}, "transmission_mode must be 'auto', 'keep' or 1, not True"),
        ({"transmission_mode": [1]}, "transmission_mode must be 'auto', 'keep' or 1, not .1."),
        ({"byte_order": "middle"}, "byte_order must be 'little' or 'big', not 'middle'"),
        ({"caption_encoding": "klingon"}, "klingon"),
        ({"speed_cap": 0}, "speed_cap"),
        ({"angle_limits": (10, -10)}, "angle_limits"),
    ],
)
def test_options_that_make_no_sense_are_refused_at_once(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        connect("virtual://", **options)


@pytest.mark.parametrize("url", [Path("/dev/ttyACM0"), b"/dev/ttyACM0", 7])
def test_what_is_no_address_and_no_transport_is_refused_at_once(url: Any) -> None:
    with pytest.raises(TypeError, match="url must be an address as text, a transport or None, not "):
        connect(url)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"patience": "1"}, "patience must be a number of seconds, not '1'"),
        ({"patience": True}, "patience must be a number of seconds, not True"),
        ({"depth": 1.5}, r"depth must be an integer, not 1\.5"),
        ({"depth": True}, "depth must be an integer, not True"),
        ({"depth": float("inf")}, "depth must be an integer, not inf"),
    ],
)
def test_options_of_the_wrong_kind_are_refused_at_once(options: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        connect("virtual://", **options)


async def test_options_hold_for_all_requests() -> None:
    fake = PipedBoard(usual=LOST)
    async with opened(fake, patience=0.5) as board:
        begun = now()
        with pytest.raises(RequestTimeout):
            await board.servo_ids()
        assert now() - begun == pytest.approx(0.5)
        with pytest.raises(ConnectionLost):  # twice that without a response
            await board.write_project_id(1)
        assert now() - begun == pytest.approx(1.0)


async def test_options_of_the_address_hold_for_the_connection() -> None:
    async with connect("virtual://?byte_order=big&caption_encoding=big5") as board:
        assert (board.codec.byte_order, board.codec.caption_encoding) == ("big", "big5")
        assert board.url == "virtual://?byte_order=big&caption_encoding=big5"
        await board.add_action(Action(1, "揮手"))
        assert (await board.action(1)).action_caption == "揮手"


async def test_an_argument_overrides_the_address() -> None:
    begun = now()
    with pytest.raises(OpenError, match="byte order"):
        await connect("virtual://?byte_order=big&patience=600", byte_order="little", patience=0.5)
    assert now() - begun == pytest.approx(0.5)


async def test_a_wrong_option_in_the_address_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(InvalidAddress, match=r"option patience must be a number .*, not 'long'"):
        await connect("tcp://127.0.0.1:1?patience=long")
    with pytest.raises(InvalidAddress, match=r"unknown option dept; .*every address has: byte_order, .* depth"):
        await connect("tcp://127.0.0.1:1?dept=4")


@pytest.mark.virtual_only("the firmware has no old transmission mode")
async def test_mode_1_is_set_on_connecting_if_asked_for() -> None:
    fake = PipedBoard()
    fake.mode = 0
    async with connect(fake, transmission_mode=1) as board:
        assert fake.mode == 1
        assert len(await board.servo_ids()) == 4
    assert fake.executed_of(TransmissionModeSettingRequest) == [TransmissionModeSettingRequest(1)]


@pytest.mark.parametrize("fate", [LOST, lie(TransmissionModeSettingResponse(0))])
async def test_a_board_that_does_not_take_mode_1_is_not_opened(fate: Fate) -> None:
    fake = PipedBoard()
    fake.usual_of[TransmissionModeSettingRequest] = fate
    with pytest.raises(OpenError, match=r"TransmissionModeSettingRequest|in mode 0"):
        await connect(fake, transmission_mode=1, patience=0.5)
    assert fake.closed == 1


async def test_captions_are_written_and_read_in_the_encoding_asked_for() -> None:
    fake = PipedBoard()
    async with opened(fake, caption_encoding="big5") as board:
        await board.add_action(Action(1, "揮手"))
        assert (await board.action(1)).action_caption == "揮手"
        assert "揮手".encode("big5") in (fake.storage.get(ACTION, 1) or b"")


# --- counters -----------------------------------------------------------------------------------------------------


async def test_stats_count_what_went_over_the_line() -> None:
    fake = PipedBoard(servos=2, usual=Fate(delay=0.010))
    async with opened(fake) as board:
        await board.servo_ids()
        await board.project_id()
        stats = board.stats.as_dict()
    assert stats["frames_sent"] == stats["frames_received"] == 2
    assert stats["bytes_sent"] == 9 + 9
    assert stats["bytes_received"] == 9 + 3 + 9 + 4
    assert stats["round_trip_ms"] == {"p50": 10.0, "p90": 10.0, "p99": 10.0}
    assert stats["skipped"] == {}


class _Broken:
    """A transport of another package that raises errors of its own."""

    url = "broken://"

    def __init__(self, where: str) -> None:
        self._where = where

    async def open(self, receiver: Receiver) -> None:
        if self._where == "open":
            raise KeyError("wire")

    async def send(self, data: bytes) -> None:
        raise KeyError("wire")

    async def close(self) -> None:
        pass


async def test_errors_of_a_foreign_transport_become_errors_of_the_library() -> None:
    with pytest.raises(
        OpenError, match=r"broken://: cannot open it: KeyError: 'wire' \(raised by the transport _Broken\)"
    ):
        await connect(_Broken("open"))
    with pytest.raises(OpenError, match=r"broken://: the connection was lost: KeyError: 'wire'"):
        await connect(_Broken("send"))
    async with connect(_Broken("send"), handshake=False, angle_unit=None) as board:
        with pytest.raises(ConnectionLost, match="'wire'"):
            await board.battery()


@pytest.mark.parametrize("method", ["plan_project", "apply_project"])
async def test_a_path_is_not_a_project(method: str) -> None:
    async with connect("virtual://") as board:
        with pytest.raises(TypeError, match=r"must be a Project, not 'robot.json'; read a file with load_project"):
            await getattr(board, method)("robot.json")


@pytest.mark.parametrize("seconds", [0.3, 0.5])
async def test_a_board_that_takes_longer_than_a_try_for_each_response_is_connected_to(seconds: float) -> None:
    for _ in range(10):
        async with connect(PipedBoard(usual=Fate(delay=seconds))) as board:
            assert len(await board.servo_ids()) == 4
