"""`servolink.control.channel`: calls that wait for their response.

Module: servolink.control.channel.
"""

from __future__ import annotations

import asyncio

from servolink.control.channel import PendingCalls
from servolink.errors import ConnectionLost


async def ask(calls: PendingCalls[int, str], call_id: int) -> str:
    with calls.expect(call_id) as response:
        return await response


async def test_each_call_gets_the_response_with_its_id() -> None:
    calls = PendingCalls[int, str]()
    one, other = asyncio.create_task(ask(calls, 1)), asyncio.create_task(ask(calls, 2))
    await asyncio.sleep(0)
    calls.settle(2, "second")
    calls.settle(1, "first")
    calls.settle(1, "again")
    assert (await one, await other) == ("first", "second")


async def test_a_response_for_nobody_is_ignored() -> None:
    calls = PendingCalls[int, str]()
    cancelled = asyncio.create_task(ask(calls, 1))
    await asyncio.sleep(0)
    cancelled.cancel()
    await asyncio.wait((cancelled,))
    calls.settle(1, "late")
    calls.settle(7, "unknown")
    calls.fail_all(AssertionError)
    assert cancelled.cancelled()


async def test_all_calls_fail_with_an_error_of_their_own_when_the_connection_ends() -> None:
    calls = PendingCalls[int, str]()
    tasks = [asyncio.create_task(ask(calls, number)) for number in range(3)]
    await asyncio.sleep(0)
    calls.fail_all(lambda: ConnectionLost("the hub is gone"))
    await asyncio.wait(tasks)
    errors = [task.exception() for task in tasks]
    assert [type(error) for error in errors] == [ConnectionLost] * 3
    assert len(set(map(id, errors))) == 3
