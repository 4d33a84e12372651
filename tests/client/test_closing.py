"""Closing a board from another event loop or thread than the one that connected it."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import aclosing, closing, contextmanager

import pytest

from servolink import Board, connect
from servolink.virtual import VirtualBoard, serve


async def opened(url: str) -> Board:
    return await connect(url, handshake=False)  # nobody answers here


@contextmanager
def loop_in_a_thread() -> Iterator[asyncio.AbstractEventLoop]:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def abandon(loop: asyncio.AbstractEventLoop) -> None:
    """Close a loop without an end of its tasks, unlike asyncio.run, and without a word when these are collected."""
    for task in asyncio.all_tasks(loop):
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # it would be in the log of another test
    loop.close()


@pytest.mark.parametrize("reconnect", [False, True])
def test_a_board_of_a_loop_that_runs_is_not_closed_in_another(reconnect: bool) -> None:
    async def connected() -> Board:
        return await connect("virtual://", reconnect=reconnect)

    with loop_in_a_thread() as home:
        board = asyncio.run_coroutine_threadsafe(connected(), home).result()
        with pytest.raises(RuntimeError, match=r"connected in <.*> and cannot be closed in <.*>: close it"):
            asyncio.run(board.close())
        assert repr(board) == "<Board virtual:// connected>"
        assert len(asyncio.run_coroutine_threadsafe(board.servo_ids(), home).result()) == 16
        asyncio.run_coroutine_threadsafe(board.close(), home).result()
        assert repr(board) == "<Board virtual:// closed>"


@pytest.mark.parametrize("reconnect", [False, True])
def test_a_board_whose_loop_has_ended_can_be_closed(reconnect: bool) -> None:
    async def connected() -> Board:
        return await connect("virtual://", reconnect=reconnect)

    board = asyncio.run(connected())
    asyncio.run(board.close())
    assert repr(board) == "<Board virtual:// closed>"


def test_a_board_whose_loop_ended_below_those_who_wait_can_be_closed() -> None:
    """Waking them used to raise "Event loop is closed", and the port stayed open."""
    waiting: list[asyncio.Task[object]] = []

    async def wait_in_many_ways() -> Board:
        board = await connect("virtual://")
        events, states = board.button_events(), board.states()
        await events.__aenter__()
        assert await anext(states) == "connected"
        waiting.extend(asyncio.ensure_future(each) for each in (anext(events), anext(states), board.servos()))
        await asyncio.sleep(0)
        return board

    loop = asyncio.new_event_loop()
    board = loop.run_until_complete(wait_in_many_ways())
    abandon(loop)
    asyncio.run(board.close())
    assert repr(board) == "<Board virtual:// closed>"
    assert not any(task.done() for task in waiting)


def test_a_board_whose_loop_ended_while_it_was_lost_can_be_closed() -> None:
    async def lost() -> Board:
        async with serve(VirtualBoard(servos=1), tcp="127.0.0.1:0") as (url,):
            board = await connect(url, reconnect=True)
        async with aclosing(board.states()) as states:
            async for state in states:
                if state == "lost":
                    break
        return board

    loop = asyncio.new_event_loop()
    board = loop.run_until_complete(lost())
    abandon(loop)
    asyncio.run(board.close())
    assert repr(board).endswith(" closed>")


def test_closing_after_the_loop_has_ended_frees_a_tcp_connection() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        board = asyncio.run(opened(f"tcp://127.0.0.1:{server.getsockname()[1]}"))
        with closing(server.accept()[0]) as other_end:
            asyncio.run(board.close())
            assert other_end.recv(1) == b""


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals")
def test_closing_after_the_loop_has_ended_frees_a_serial_port() -> None:
    controller, terminal = os.openpty()
    try:
        url = f"serial://{os.ttyname(terminal)}"
        board = asyncio.run(opened(url))
        asyncio.run(board.close())

        async def reopen() -> str:
            async with connect(url, handshake=False) as another:  # the port is opened exclusively
                return repr(another)

        assert asyncio.run(reopen()) == f"<Board {url} connected>"
    finally:
        os.close(controller)
        os.close(terminal)
