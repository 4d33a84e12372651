"""A recorded board answers a program that does what was recorded, and ends the connection with any other."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from servolink.client import Board, connect
from servolink.errors import ConnectionLost, InvalidAddress, OpenError, OutcomeUnknown
from servolink.protocol import (
    Action,
    Codec,
    ExecuteActionRequest,
    Packet,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.recorder.channels import Event, Message, Wire
from servolink.transports import create
from tests.recorder.files import write
from tests.virtual_time import run

WAVE = Path(__file__).parents[1] / "data" / "wave.mcap"
"""A robot with two servos moves, learns an action, waits for button 7, plays the action and goes limp."""
CODEC = Codec()


async def wave(board: Board) -> None:
    """Do what was recorded."""
    await board.move({1: 60, 2: -40}, speed=120, wait=True)
    await board.add_action(Action(3, "Wave", (Step(1, 30, 50), Step(2, -30, 50))))
    async with board.button_events() as events:
        assert (await anext(events)).button_id == 7
    await board.run_action(3, wait=True)
    assert [int(servo.angle) for servo in await board.servos()] == [30, -30]
    await board.release()


@pytest.mark.parametrize("options", ["", "?timing=0", "?speed=10"])
async def test_program_that_does_what_was_recorded(options: str) -> None:
    async with connect(f"replay://{WAVE}{options}") as board:
        await wave(board)
        with pytest.raises(ConnectionLost, match="nothing more was sent in the recording"):
            await board.release()


def replayed(path: Path, act: Callable[[Board], Awaitable[object]], patience: float = 3.0) -> None:
    """Run a program on a recorded board."""

    async def main() -> None:
        async with connect(f"replay://{path}", patience=patience) as board:
            await act(board)

    run(main())


def passed(*frames: tuple[float, str, Packet | bytes]) -> list[tuple[float, Message]]:
    """Return the messages of a conversation, `>` to the board and `<` from it."""
    return [
        (
            seconds,
            Wire(
                "sent" if way == ">" else "received", each if isinstance(each, bytes) else CODEC.encode(each), seconds
            ),
        )
        for seconds, way, each in frames
    ]


LIMP, LIMP_DONE = SetServoParameterRequest(1, 0, 0), SetServoParameterResponse(1, 0, 0)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda board: board.release(),
            "expected ExecuteAction 1=60 in .*, 2=-40 in .*, got SetServoParameter servo_id=255",
        ),
        (lambda board: board.move({1: 61}, speed=120), "expected ExecuteAction 1=60 in .*, got ExecuteAction 1=61"),
        (lambda board: board.action(9), "the recording has no response to QueryAction action_id=9"),
    ],
)
def test_program_that_goes_another_way(act: Callable[[Board], Awaitable[object]], message: str) -> None:
    with pytest.raises(ConnectionLost, match=f"the program differs from the recording: .*{message}"):
        replayed(WAVE, act)


def test_nothing_comes_behind_the_recording(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", passed((0.0, ">", LIMP), (0.1, "<", LIMP_DONE)))

    async def act(board: Board) -> None:
        await board.release(1)
        with pytest.raises(ConnectionLost, match="nothing more was sent in the recording, got ExecuteAction"):
            await board.send(ExecuteActionRequest((Step(1, 2, 3),)))

    replayed(path, act)


def test_state_is_that_of_the_moment(tmp_path: Path) -> None:
    ask = QueryRemainPowerRequest()
    path = write(
        tmp_path / "x.mcap",
        passed(
            *((at / 10, way, packet) for at in range(3) for way, packet in ((">", ask), ("<", power(900 + at)))),
            (1.0, ">", LIMP),
            (1.1, "<", LIMP_DONE),
            (1.2, ">", ask),
            (1.3, "<", power(500)),
            (1.4, ">", ask),
        ),
    )

    async def act(board: Board) -> None:
        await board.release(1)
        assert [(await board.request(ask)).permil for _ in range(2)] == [500, 500]

    replayed(path, act)


def power(permil: int) -> QueryRemainPowerResponse:
    return QueryRemainPowerResponse(permil)


def test_repeats_of_either_side_are_no_other_way(tmp_path: Path) -> None:
    write_id, written = WriteProjectIDRequest(7), WriteProjectIDResponse(1)
    limp = (1.0, ">", LIMP), (1.1, "<", LIMP_DONE)
    released: list[int] = []

    def program(writes: int) -> Callable[[Board], Awaitable[object]]:
        async def act(board: Board) -> None:
            for _ in range(writes):
                await board.write_project_id(7)
            await board.release(1)
            released.append(writes)

        return act

    first, again = ((0.0, ">", write_id), (0.1, "<", written)), ((0.5, ">", write_id), (0.6, "<", written))
    replayed(write(tmp_path / "twice.mcap", passed(*first, *again, *limp)), program(1))
    once = passed(*first, *limp)
    replayed(write(tmp_path / "once.mcap", once), program(2))
    assert released == [1, 2]


def test_silence_is_replayed(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", passed((0.0, ">", LIMP)))
    with pytest.raises(OutcomeUnknown):
        replayed(path, lambda board: board.release(1), patience=1.0)


def test_noise_is_replayed_before_what_followed_it(tmp_path: Path) -> None:
    noisy = b"\x13\x4c\x05\x1dnoise" + CODEC.encode(LIMP_DONE)
    path = write(tmp_path / "x.mcap", passed((0.0, ">", LIMP), (0.1, "<", noisy[:11]), (0.2, "<", noisy[11:])))

    async def act(board: Board) -> None:
        await board.release(1)
        assert sum(board.stats.skipped.values()) == 9

    replayed(path, act)


@pytest.mark.parametrize("messages", [[], [(0.0, Event("mark", "mark"))], passed((0.0, "<", LIMP_DONE))])
def test_recording_without_a_conversation(messages: list[tuple[float, Message]], tmp_path: Path) -> None:
    with pytest.raises(OpenError, match="cannot be replayed: no sent packets are recorded"):
        replayed(write(tmp_path / "x.mcap", messages), lambda board: board.servos())


@pytest.mark.parametrize("name", ["none.mcap", "none.jsonl"])
def test_missing_file(name: str, tmp_path: Path) -> None:
    with pytest.raises(OpenError, match="cannot read the recording"):
        replayed(tmp_path / name, lambda board: board.servos())


async def test_relative_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(WAVE.parents[1])
    async with connect("replay://data/wave.mcap") as board:
        await wave(board)


@pytest.mark.parametrize("url", ["replay://", "replay://x:1/y", f"replay://{WAVE}?speed=-1", f"replay://{WAVE}?x=1"])
def test_address_that_is_refused(url: str) -> None:
    with pytest.raises(InvalidAddress):
        create(url)


async def test_closing_in_the_middle_leaves_nothing_behind() -> None:
    async with connect(f"replay://{WAVE}") as board:
        asking = asyncio.ensure_future(board.move({1: 60, 2: -40}, speed=120, wait=True))
        await asyncio.sleep(0.001)
    with pytest.raises(ConnectionLost):
        await asking
