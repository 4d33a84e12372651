"""`servolink.testing`: programs in virtual time."""

from __future__ import annotations

import asyncio
import time

import pytest

import servolink
from servolink.testing import run


def test_a_movement_of_a_virtual_board_takes_no_real_time() -> None:
    async def main() -> tuple[float, float]:
        begun_at = asyncio.get_running_loop().time()
        async with servolink.connect("virtual://?servos=4") as board:
            await board.move({1: 120}, duration=300, wait=True)
            return asyncio.get_running_loop().time() - begun_at, float((await board.servo(1)).angle)

    begun_at = time.monotonic()
    virtual_seconds, angle = run(main())
    assert time.monotonic() - begun_at < 60
    assert 300 <= virtual_seconds < 310
    assert angle == 120


def test_a_task_that_is_left_behind_is_an_error() -> None:
    async def main() -> None:
        task = asyncio.create_task(asyncio.sleep(1), name="forgotten")
        asyncio.get_running_loop().call_later(2, task.cancel)

    with pytest.raises(AssertionError, match=r"tasks left behind: .*forgotten"):
        run(main())


def test_a_program_that_waits_for_nothing_fails_at_once() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="deadlock: nothing is ready"):
        run(main())
