"""A process of the benchmark of the fleet: virtual boards that join a broker, or a bare program that echoes messages.

`python -m benchmarks.fleet_worker boards URL FIRST COUNT HZ` and `python -m benchmarks.fleet_worker echo URL`. It
prints `ready`, and the end of its input ends it.
"""

from __future__ import annotations

import asyncio
import gc
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from typing import Any

from paho.mqtt import client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from servolink.fleet.access import BrokerAccess, BrokerAddress, parse_broker

ECHO = "bare/cmd"
MACRO = "Wave"
_SERVOS = 16


async def _boards(url: str, first: int, count: int, hz: float) -> None:
    from servolink.client.connecting import connect
    from servolink.fleet.join import LocalBoard, LocalFleet
    from servolink.fleet.policy import BoardPolicy, FleetFile
    from servolink.fleet.topics import Topics
    from servolink.hub.serving import serve_board
    from servolink.protocol.records import Action, Macro, MacroCommand, Step

    bow = Action(1, "Bow", tuple(Step(servo, 60 if servo % 2 else -60, 500) for servo in range(1, _SERVOS + 1)))
    wave = Macro(1, MACRO, (MacroCommand(1, total_interval=5000),))
    async with AsyncExitStack() as stack:
        here = []
        for number in range(first, first + count):
            name = f"bench{number}"
            served = serve_board(f"virtual://?servos={_SERVOS}&seed={number}", name=name)
            await stack.enter_async_context(served)
            async with connect(f"share://{name}") as board:
                await board.add_action(bow)
                await board.add_macro(wave)
            here.append(LocalBoard(name, name))
        policies = FleetFile(BoardPolicy(allow="edit"))
        fleet = LocalFleet(BrokerAccess.of(url), Topics(), policies, hz=hz)

        def ready() -> None:
            gc.freeze()  # as `servolink fleet join` does
            _say("ready")

        joined = asyncio.create_task(fleet.join(here, ready))
        ending = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
        await asyncio.wait((joined, ending), return_when=asyncio.FIRST_COMPLETED)
        joined.cancel()
        with suppress(asyncio.CancelledError):
            await joined


class BareClient:
    """A program that uses paho-mqtt with its own thread, and sends at once, as ours does."""

    def __init__(self, address: BrokerAddress, topic: str, on_message: Callable[[mqtt.MQTTMessage], None]) -> None:
        """Connect, subscribe to `topic` and call `on_message`, in the thread of paho-mqtt."""
        self.client = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
        self._subscribed = threading.Event()
        self.client.on_subscribe = lambda *_: self._subscribed.set()
        self.client.on_message = lambda _client, _data, message: on_message(message)
        self.client.connect(address.host, address.port)
        sock: Any = self.client.socket()
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.client.loop_start()
        self.client.subscribe(topic, 1)
        self._subscribed.wait()

    def close(self) -> None:
        """Disconnect."""
        self.client.disconnect()
        self.client.loop_stop()


async def _echo(url: str) -> None:
    """Answer each message of QoS 1 by one of QoS 1, with nothing between."""

    def echo(message: mqtt.MQTTMessage) -> None:
        bare.client.publish(message.properties.ResponseTopic, message.payload, 1)  # type: ignore[union-attr]

    bare = BareClient(parse_broker(url), ECHO, echo)
    _say("ready")
    await asyncio.to_thread(sys.stdin.read)
    bare.close()


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    if sys.argv[1] == "echo":
        asyncio.run(_echo(sys.argv[2]))
    else:
        asyncio.run(_boards(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), float(sys.argv[5])))
