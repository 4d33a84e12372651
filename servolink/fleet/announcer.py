"""Announcer: keeps Home Assistant up to date about one board."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NoReturn

import msgspec

from servolink.control.notifications import ServosFrame
from servolink.control.peer import encode
from servolink.errors import ConnectionLost
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.home_assistant import Document, HomeAssistant, discovery, without
from servolink.fleet.mqtt_client import Publication
from servolink.fleet.outbox import Outbox
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.telemetry import Telemetry
from servolink.fleet.topics import UNREADABLE, Topics, Vitals

VITALS_SECONDS = 2.0
"""How often the vitals are sent if something has changed."""


class Announcer:
    """Sends the discovery document and the vitals of one board."""

    def __init__(
        self,
        home_assistant: HomeAssistant,
        topics: Topics,
        policy: BoardPolicy,
        telemetry: Telemetry,
        outbox: Outbox,
        broker: BrokerConnection,
        kept: Mapping[str, bytes],
    ) -> None:
        """`kept` has the document that the broker holds from an earlier time, by topic."""
        self._home_assistant = home_assistant
        self._topics = topics
        self._policy = policy
        self._telemetry = telemetry
        self._outbox = outbox
        self._broker = broker
        self._board = telemetry.now.board
        self._topic = home_assistant.topic(topics, self._board)
        self._before: Document = _document(kept.get(self._topic, b""))
        telemetry.least_hz = 1 / VITALS_SECONDS
        telemetry.on_catalog = self.announce

    def announce(self) -> None:
        """Send the document, if it has changed; what is not in it any more is removed first."""
        telemetry = self._telemetry
        document = discovery(
            self._topics, telemetry.now, telemetry.servo_ids, self._policy, numbers=self._home_assistant.numbers
        )
        for each in (without(document, self._before), document):
            if each is not None and each != self._before:
                self._outbox.put(Publication(self._topic, encode(each), 1, retain=True))
        self._before = document

    async def send_vitals(self) -> NoReturn:
        """Send the vitals now and then."""
        topic, sent = self._topics.board(self._board, "vitals"), None
        while True:
            await self._broker.until_connected()
            frame = self._telemetry.frame
            vitals = None if frame is None else _vitals(msgspec.json.decode(frame, type=ServosFrame))
            if vitals is not None and vitals != sent:
                with suppress(ConnectionLost):
                    await self._broker.send(Publication(topic, encode(vitals), retain=True))
                    sent = vitals
            await asyncio.sleep(VITALS_SECONDS)


def _vitals(frame: ServosFrame) -> Vitals:
    temperatures = {servo.servo_id: servo.temperature_raw for servo in frame.servos}
    currents = {servo.servo_id: servo.current_raw for servo in frame.servos}
    return Vitals(
        {servo.servo_id: servo.angle for servo in frame.servos},
        temperatures,
        currents,
        max(temperatures.values(), default=None),
        max(currents.values(), default=None),
    )


def _document(payload: bytes) -> Document:
    """Return the document in a payload; an empty one if it is not ours."""
    with suppress(*UNREADABLE, AttributeError, TypeError, KeyError):
        found: Any = msgspec.json.decode(payload)
        return {**found, "components": {key: {"platform": one["platform"]} for key, one in found["components"].items()}}
    return {}
