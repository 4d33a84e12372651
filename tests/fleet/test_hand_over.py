"""The hand-over from the network thread to the event loop: bounded, in order, and passed by stops."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from time import sleep

from servolink.fleet.hand_over import HandOver
from tests.fleet.bridged import run

_SIZE, _MANY = 10, 8
ROOM = _SIZE * _MANY


class Flood:
    """A network thread that puts items as long as there is room, and what the event loop was called with."""

    def __init__(self, *items: str) -> None:
        self.hand_over = HandOver(ROOM)
        self.put: list[str] = []
        self.taken: list[str] = []
        self._items = items
        self._thread = threading.Thread(target=self._run, daemon=True)

    def begin(self) -> None:
        self._thread.start()

    def _run(self) -> None:
        for item in self._items:
            size = 0 if item.startswith("answer") else _SIZE
            self.hand_over.put(partial(self.taken.append, item), size, is_stop=item.startswith("stop"))
            self.put.append(item)

    def until_put(self, count: int) -> int:
        """Hold the event loop until the thread has put `count` items. Return how many it then goes on to."""
        while len(self.put) < count:
            sleep(0)
        for _ in range(100):
            sleep(0)  # for the thread, which has nothing else to wait for
        return len(self.put)

    async def until_taken(self, count: int) -> None:
        while len(self.taken) < count:
            await asyncio.sleep(0)

    def end(self) -> None:
        self._thread.join()


@contextmanager
def flood(*items: str) -> Iterator[Flood]:
    """Yield a thread that puts these items, and end it."""
    made = Flood(*items)
    made.begin()
    try:
        yield made
    finally:
        made.hand_over.close()
        made.end()


def messages(count: int) -> list[str]:
    return [f"message {number}" for number in range(count)]


def test_a_full_hand_over_blocks_the_thread_and_loses_nothing() -> None:
    async def main() -> None:
        sent = messages(50 * _MANY)
        with flood(*sent) as thread:
            assert thread.until_put(_MANY) == _MANY
            await thread.until_taken(len(sent))
            assert thread.taken == sent

    run(main())


def test_a_stop_passes_a_full_hand_over_and_is_handled_first() -> None:
    async def main() -> None:
        sent = messages(_MANY)
        with flood(*sent, "stop", "one more") as thread:
            assert thread.until_put(_MANY + 1) == _MANY + 1
            assert thread.taken == []
            await thread.until_taken(1)
            assert thread.taken[: _MANY + 1] == ["stop", *sent]  # in one turn, while the barrier of the stop is up
            await thread.until_taken(_MANY + 2)
            assert thread.taken[-1] == "one more"

    run(main())


def test_a_flood_of_stops_is_bounded_as_well() -> None:
    async def main() -> None:
        stops = [f"stop {number}" for number in range(20 * _MANY)]
        with flood(*stops) as thread:
            assert thread.until_put(2 * _MANY) == 2 * _MANY
            await thread.until_taken(len(stops))
            assert thread.taken == stops

    run(main())


def test_an_answer_of_the_broker_never_blocks_and_stays_in_its_place() -> None:
    async def main() -> None:
        sent = [*messages(_MANY), "answer 1", "answer 2"]  # paho-mqtt holds a lock that a sender may wait for
        with flood(*sent) as thread:
            thread.end()
            await thread.until_taken(len(sent))
            assert thread.taken == sent

    run(main())


def test_a_burst_wakes_the_event_loop_once() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        wakes = []
        wake = loop.call_soon_threadsafe
        loop.call_soon_threadsafe = lambda *given, **options: wakes.append(given) or wake(*given, **options)  # type: ignore[method-assign, func-returns-value]
        with flood(*messages(_MANY)) as thread:
            thread.end()
            assert len(wakes) == 1
            await thread.until_taken(_MANY)

    run(main())


def test_a_closed_hand_over_drops_messages_and_frees_the_thread() -> None:
    async def main() -> None:
        with flood(*messages(5 * _MANY), "answer") as thread:
            assert thread.until_put(_MANY) == _MANY
            thread.hand_over.close()
            thread.end()
            await thread.until_taken(1)
            assert thread.taken == ["answer"]

    run(main())
