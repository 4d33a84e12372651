"""Conversations with the virtual board over the kernel's real drivers."""

from __future__ import annotations

import asyncio
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

import servolink
from servolink.protocol import Action, ActionEntry
from servolink.virtual import VirtualBoard
from tests.client.test_board import CHAPTERS
from tests.kernel.guest.plug import Plug, board_use

pytestmark = pytest.mark.timeout(180)
RECORD_TYPES = pytest.mark.parametrize("kind", ["serial", "hid", "usb"])
PATIENCE = 30.0  # seconds for an answer in this slow machine
OPEN_TWICE = """
import asyncio, faulthandler, sys
import servolink

faulthandler.dump_traceback_later(60, exit=True)  # if it hangs, show where

async def main() -> None:
    for url in sys.argv[1:]:
        try:
            async with servolink.connect(url, patience=30) as board:
                print("opened", await board.servo_ids())
        except servolink.OpenError as error:
            print("OpenError", error)

asyncio.run(main())
"""


@pytest.fixture(scope="module")
def virtual() -> VirtualBoard:
    return VirtualBoard(servos=3)


@pytest.fixture(scope="module")
def plug(virtual: VirtualBoard) -> Iterator[Plug]:
    with Plug(board_use(virtual)) as plug:
        yield plug


@RECORD_TYPES
def test_every_command_does_what_it_says(plug: Plug, kind: str) -> None:
    async def main() -> None:
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            for use in CHAPTERS:
                await board.clear_all_data()
                await board.set_servo(servolink.ALL_SERVOS, start=True, hold=True)
                await use(board)
            assert board.stats.undecodable == board.stats.unsolicited == 0

    asyncio.run(main())


@RECORD_TYPES
def test_every_button_event_arrives_in_order(plug: Plug, virtual: VirtualBoard, kind: str) -> None:
    def press_all() -> None:
        now = asyncio.get_running_loop().time()
        for button_id in range(1, 51):
            virtual.press_button(button_id, now)
            virtual.release_button(button_id, now)

    async def main() -> list[tuple[int, str]]:
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board, board.button_events() as events:
            plug.call(press_all)
            return [(event.button_id, event.kind) for event in [await anext(events) for _ in range(100)]]

    assert asyncio.run(main()) == [(button_id, kind) for button_id in range(1, 51) for kind in ("press", "up")]


def store_actions(plug: Plug, first: int, count: int) -> tuple[ActionEntry, ...]:
    """Store actions, those before the `first` are there, and return the list that the board must then give."""

    async def main() -> None:
        async with servolink.connect(plug.url("serial"), patience=PATIENCE) as board:
            for number in range(first, count + 1):
                await board.add_action(Action(number, f"action {number}", ()))

    asyncio.run(main())
    return tuple(ActionEntry(number, f"action {number}") for number in range(1, count + 1))


def test_long_lists_come_whole_and_without_help_however_long_the_loop_stands(
    plug: Plug, virtual: VirtualBoard, report: Callable[[str], None]
) -> None:
    plug.call(virtual.storage.clear)
    whole = store_actions(plug, 1, 100)  # 3.6 KB
    for kind in plug.urls:
        assert asyncio.run(read_list(plug, kind)) == whole
    longest = store_actions(plug, 101, 255)  # 9.2 KB, which are 144 reports
    for kind in plug.urls:
        assert asyncio.run(read_list(plug, kind)) == longest
        assert asyncio.run(read_list(plug, kind, stall=0.5)) == longest
        report(f"{kind}: the largest list comes at {asyncio.run(list_rate(plug, kind)) / 1000:.0f} KB/s")


async def read_list(plug: Plug, kind: str, stall: float = 0.0) -> tuple[ActionEntry, ...]:
    """Ask once for the list; with `stall` the loop stands for so many seconds while the answer comes."""
    async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
        if not stall:
            return await board.actions()
        release = hold_back(plug, kind)
        try:
            reading = asyncio.create_task(board.actions())
            async with asyncio.timeout(PATIENCE):
                while not plug.call(lambda: plug.device.pending_bytes):  # until the request waits in front of the board
                    await asyncio.sleep(0.01)
        finally:
            plug.call(lambda: asyncio.get_running_loop().call_later(0.05, release))
        time.sleep(stall)  # stands for any code of the program that blocks the loop
        answer = await reading
        assert board.stats.undecodable == board.stats.unsolicited == 0
        return answer


def hold_back(plug: Plug, kind: str) -> Callable[[], None]:
    """Let the board take nothing until what is returned is called in its thread."""
    pipe = {"serial": plug.device.serial, "hid": plug.device.hid, "usb": plug.device.bulk}[kind]
    pipe.from_host._ready = lambda: False

    def release() -> None:
        pipe.from_host._ready = pipe.ready
        pipe.from_host.advance()

    return release


async def list_rate(plug: Plug, kind: str) -> float:
    """Return bytes per second."""
    async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
        start, before = time.monotonic(), board.stats.bytes_received
        for _ in range(3):
            await board.actions()
        return (board.stats.bytes_received - before) / (time.monotonic() - start)


@RECORD_TYPES
def test_round_trips_are_measured(plug: Plug, report: Callable[[str], None], kind: str) -> None:
    async def main() -> list[float]:
        times = []
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            for _ in range(200):
                start = time.monotonic()
                await board.battery()
                times.append(time.monotonic() - start)
        return sorted(times)

    times = asyncio.run(main())
    report(f"{kind}: round trip {statistics.median(times) * 1e3:.1f} ms median, {times[-2] * 1e3:.1f} ms p99")
    assert statistics.median(times) < 0.1


def test_a_second_program_is_refused_and_told_why_and_the_first_one_goes_on(plug: Plug) -> None:
    async def main() -> str:
        boards = [await servolink.connect(url, patience=PATIENCE) for url in plug.urls.values()]
        second = await asyncio.create_subprocess_exec(
            sys.executable, "-c", OPEN_TWICE, *plug.urls.values(), stdout=subprocess.PIPE
        )
        said, _ = await second.communicate()
        assert second.returncode == 0
        for board in boards:
            assert await board.servo_ids() == (1, 2, 3)
            await board.close()
        return said.decode()

    lines = asyncio.run(main()).splitlines()
    assert [line.partition(" ")[0] for line in lines] == ["OpenError"] * 3, lines
    assert all("close" in line for line in lines), lines


@RECORD_TYPES
def test_a_halted_endpoint_is_cleared_and_the_conversation_goes_on(plug: Plug, kind: str) -> None:
    pipe = {"serial": plug.device.serial, "hid": plug.device.hid, "usb": plug.device.bulk}[kind]

    async def main() -> None:
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            assert await board.servo_ids() == (1, 2, 3)
            plug.call(pipe.to_host.halt)
            assert await board.servo_ids() == (1, 2, 3)
            assert not plug.call(lambda: pipe.to_host.halted)

    asyncio.run(main())


def test_a_halted_way_to_the_board_is_cleared_too(plug: Plug) -> None:
    async def main() -> None:
        async with servolink.connect(plug.url("usb"), patience=6.0) as board:
            plug.call(plug.device.bulk.from_host.halt)  # the question is lost, and asked again
            assert await board.servo_ids() == (1, 2, 3)

    asyncio.run(main())
