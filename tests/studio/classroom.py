"""Virtual boards with the demo that have joined a broker, on a thread of their own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from servolink.control import RoleName
from servolink.fleet import BoardPolicy, BrokerAccess, FleetFile, LocalBoard, LocalFleet, Topics
from servolink.studio.robots import VIRTUAL, Robots
from tests.fleet.mosquitto import Broker
from tests.processes import LIMIT


class Joined(NamedTuple):
    """Boards that have joined."""

    hubs: dict[str, str]
    """Names of hubs by the names of boards."""


@contextmanager
def classroom(broker: Broker, **allowed: RoleName) -> Iterator[Joined]:
    """Let a new virtual board with each name join `broker`, which allows so much; yield when all have joined."""
    ready, hubs, failures = threading.Event(), dict[str, str](), list[BaseException]()
    loop = asyncio.new_event_loop()
    ending = asyncio.Event()

    async def main() -> None:
        robots = Robots()
        for name in allowed:
            hubs[name] = await robots.open(VIRTUAL)
        policies = FleetFile(boards={name: BoardPolicy(allow) for name, allow in allowed.items()})
        fleet = LocalFleet(BrokerAccess.of(broker.url), Topics(), policies, hz=5.0)
        members = [LocalBoard(hub, name) for name, hub in hubs.items()]
        joining = asyncio.ensure_future(fleet.join(members, ready.set))
        ended = asyncio.ensure_future(ending.wait())
        await asyncio.wait((joining, ended), return_when=asyncio.FIRST_COMPLETED)
        if joining.done():
            failures.append(joining.exception() or AssertionError("the boards have left"))
            ready.set()
        joining.cancel()
        await asyncio.wait((joining,))
        await robots.close()

    thread = threading.Thread(target=lambda: loop.run_until_complete(main()), daemon=True)
    thread.start()
    try:
        assert ready.wait(LIMIT)
        assert not failures, failures
        yield Joined(hubs)
    finally:
        loop.call_soon_threadsafe(ending.set)
        thread.join(LIMIT)
        assert not thread.is_alive()
        loop.close()
