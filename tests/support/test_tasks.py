"""Background tasks end with whoever began them."""

from __future__ import annotations

import asyncio

from servolink.support.tasks import Tasks
from tests.virtual_time import run


async def test_tasks_are_kept_until_they_are_over() -> None:
    tasks = Tasks()
    task = tasks.begin(asyncio.sleep(1, "done"))
    assert len(tasks) == 1
    assert await task == "done"
    assert len(tasks) == 0


def test_those_that_do_not_end_in_time_are_cancelled_with_what_they_begin() -> None:
    ended = list[str]()

    async def work(tasks: Tasks, name: str, seconds: float) -> None:
        try:
            await asyncio.sleep(seconds)
            ended.append(f"{name} is done")
        finally:
            if name == "slow":
                tasks.begin(work(tasks, "child", 60))

    async def main() -> None:
        tasks = Tasks()
        quick, slow = tasks.begin(work(tasks, "quick", 1)), tasks.begin(work(tasks, "slow", 3))
        begun = asyncio.get_running_loop().time()
        await tasks.close(linger=2)
        assert asyncio.get_running_loop().time() == begun + 2
        assert (quick.cancelled(), slow.cancelled(), len(tasks)) == (False, True, 0)
        await tasks.close(linger=2)
        assert asyncio.get_running_loop().time() == begun + 2

    run(main())
    assert ended == ["quick is done"]


async def test_who_stops_waiting_for_a_task_of_several_cancels_it_for_nobody() -> None:
    tasks = Tasks()
    task = tasks.begin(asyncio.sleep(2, "done"))
    first, second = (asyncio.ensure_future(Tasks.shared_result(task)) for _ in range(2))
    await asyncio.sleep(1)
    first.cancel()
    assert await second == "done"
    assert first.cancelled()
