"""Joins as `servolink fleet join` does, and kills itself at a point of a command."""

from __future__ import annotations

import os
import signal
import sys
from typing import Any

from servolink.__main__ import main
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Received
from servolink.fleet.hub_session import HubSession


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def install(point: str) -> None:
    """Die when a movement has been noted, before it, or after it."""
    ask = HubSession.ask

    async def ask_or_die(session: HubSession, method: str, *rest: Any) -> Any:
        if method == "move" and point == "before":
            die()
        reply = await ask(session, method, *rest)
        if method == "move" and point == "after":
            die()
        return reply

    setattr(HubSession, "ask", ask_or_die)  # noqa: B010 - its type differs
    acknowledge = BrokerConnection.acknowledge

    def acknowledge_or_die(connection: BrokerConnection, message: Received) -> None:
        if message.topic.endswith("/cmd"):
            die()
        acknowledge(connection, message)

    if point == "noted":  # the broker will deliver it again
        setattr(BrokerConnection, "acknowledge", acknowledge_or_die)  # noqa: B010 - likewise


if __name__ == "__main__":
    install(sys.argv[1])
    sys.exit(main(["fleet", "join", *sys.argv[2:]]))
