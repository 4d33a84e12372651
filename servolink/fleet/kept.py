"""What a broker keeps: the last message of each topic that was sent as a retained one."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Sequence
from contextlib import suppress

from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.mqtt_client import ConnectionOptions, Received

_QUIET = 0.3  # seconds without a message after which the broker has sent all that it keeps


async def retained(access: BrokerAccess, filters: Sequence[str]) -> dict[str, bytes]:
    """Return what the broker keeps at topics, of which there is one at least. Raise OpenError if it cannot be asked."""
    found: dict[str, bytes] = {}
    heard = asyncio.Event()

    def take(message: Received) -> None:
        if message.is_retained:  # who sends all the time cannot keep this waiting
            found[message.topic] = message.payload
            heard.set()

    broker = BrokerConnection(access, ConnectionOptions(f"servolink-look-{secrets.token_hex(8)}", sees_retained=False))
    broker.on_message = take
    # A broker answers in order: when it confirms the first one again, it has sent what it keeps at all of them. With
    # QoS 1 it would wait for acknowledgements in between.
    broker.subscriptions = [(each, 0) for each in (*filters, filters[0])]
    connection = asyncio.create_task(broker.run())
    connected = asyncio.create_task(broker.until_connected())
    try:
        await asyncio.wait((connection, connected), return_when=asyncio.FIRST_COMPLETED)
        if connection.done():
            await connection
        with suppress(TimeoutError):  # brokers of several machines may answer in another order
            while True:
                heard.clear()
                async with asyncio.timeout(_QUIET):
                    await heard.wait()
    finally:
        for task in (connection, connected):
            task.cancel()
        await asyncio.wait((connection, connected))
    return found
