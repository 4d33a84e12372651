"""Home Assistant: a device for each board with sensors, events, buttons and, on request, angles.

Everything is in one retained message, by which Home Assistant finds it: its "device discovery" over MQTT. What Home
Assistant sends goes to `stop` and to `press`, as it can neither number commands nor let them expire.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple, NoReturn

import msgspec

from servolink.control import ServosFrame, encode
from servolink.errors import ConnectionLost
from servolink.fleet.broker import BrokerConnection
from servolink.fleet.broker_messages import Publication
from servolink.fleet.outbox import Outbox
from servolink.fleet.policy import BoardPolicy
from servolink.fleet.telemetry import Telemetry
from servolink.fleet.topics import OFFLINE, ONLINE, UNREADABLE, BoardNow, Topics, Vitals, readable

VITALS_SECONDS = 2.0
"""How often the vitals are sent if something has changed."""

DISCOVERY_PREFIX = "homeassistant"
"""Default topic prefix under which Home Assistant looks for devices."""

_MOST_RECORDS = 100  # of each kind; nobody has so many buttons on a page
_FULL_TURN = (-180.0, 180.0)
_WHO = "Home Assistant"
_SPEED = 60.0  # degrees per second of an angle set in Home Assistant
_KINDS = ["press", "long_press", "up"]

Document = dict[str, Any]


class HomeAssistant(NamedTuple):
    """Options of the discovery documents for Home Assistant."""

    prefix: str = DISCOVERY_PREFIX
    numbers: bool = False
    """Whether the angle of each servo can be set."""

    def topic(self, topics: Topics, board: str) -> str:
        """Return where Home Assistant looks for a board: below its name, as an access list is written for names."""
        return f"{self.prefix}/device/{board}/{_object_id(topics, board)}/config"

    @property
    def birth_topic(self) -> str:
        """Topic where Home Assistant says `online` when it has started."""
        return f"{self.prefix}/status"

    def earlier_topic(self, topics: Topics, board: str) -> str:
        """Return the topic of earlier versions, whose document would show the board twice."""
        return f"{self.prefix}/device/{_object_id(topics, board)}/config"


def discovery(
    topics: Topics, now: BoardNow, servo_ids: tuple[int, ...], policy: BoardPolicy, *, numbers: bool
) -> Document:
    """Return the document for a board, without entities that the policy forbids."""
    entities = _Entities(topics, now.board)
    entities.add_board()
    entities.add_servos(servo_ids)
    if policy.allow != "watch":
        entities.add_records(now)
    if numbers and policy.allow in {"move", "edit"}:
        entities.add_angles(servo_ids, policy)
    return {
        "device": {
            "identifiers": [_object_id(topics, now.board)],
            "name": now.board,
            "manufacturer": "servolink",
            "model": "servo control board",
            "sw_version": now.version,
        },
        "origin": {"name": "servolink", "sw_version": now.version},
        "availability_mode": "all",
        "availability": [entities.is_joined, entities.is_connected],
        "qos": 1,
        "components": entities.found,
    }


def without(document: Document, before: Document) -> Document | None:
    """Return the document that removes only the entities of `before`; None if `before` has no entities."""
    gone = {
        key: {"platform": component["platform"]}
        for key, component in before.get("components", {}).items()
        if key not in document["components"]
    }
    return {**document, "components": {**document["components"], **gone}} if gone else None


class _Entities:
    """Collector of the entities of a board."""

    def __init__(self, topics: Topics, board: str) -> None:
        self.found: dict[str, Document] = {}
        self.is_joined = {
            "topic": topics.board(board, "available"),
            "payload_available": ONLINE,
            "payload_not_available": OFFLINE,
        }
        self.is_connected = {
            "topic": topics.board(board, "state"),
            "value_template": f"{{{{ '{ONLINE}' if value_json.connection == 'connected' else '{OFFLINE}' }}}}",
            "payload_available": ONLINE,
            "payload_not_available": OFFLINE,
        }
        self._topics = topics
        self._board = board

    def add_board(self) -> None:
        """Add the entities that every board has."""
        state = {"state_topic": self._topics.board(self._board, "state")}
        always = {"availability": [self.is_joined], "entity_category": "diagnostic"}
        self._add(
            "battery",
            "sensor",
            "Battery",
            **state,
            value_template="{{ value_json.battery_percent }}",
            device_class="battery",
            state_class="measurement",
            unit_of_measurement="%",
        )
        self._add(
            "connection",
            "binary_sensor",
            "Connection",
            **state,
            **always,
            value_template="{{ 'ON' if value_json.connection == 'connected' else 'OFF' }}",
            device_class="connectivity",
        )
        self._add(
            "noise",
            "sensor",
            "Noise on the line",
            **state,
            **always,
            value_template="{{ value_json.noise }}",
            state_class="total_increasing",
            unit_of_measurement="B",
        )
        self._add(
            "buttons",
            "event",
            "Remote control",
            state_topic=self._topics.board(self._board, "event"),
            value_template=("{{ {'event_type': value_json.kind, 'button_id': value_json.button_id} | to_json }}"),
            event_types=_KINDS,
            device_class="button",
        )
        stop = {
            "command_topic": self._topics.board(self._board, "stop"),
            "payload_press": _json({"who": "Home Assistant"}),
        }
        self._add("stop", "button", "Stop", **stop, icon="mdi:stop-circle")

    def add_servos(self, servo_ids: tuple[int, ...]) -> None:
        """Add the raw numbers of servos, without a unit: the document gives them none."""
        self._add_raw("highest_temperature_raw", "Highest temperature (raw)", "value_json.highest_temperature_raw")
        self._add_raw("highest_current_raw", "Highest current (raw)", "value_json.highest_current_raw")
        for servo_id in servo_ids:
            for kind in ("temperature", "current"):
                self._add_raw(
                    f"servo_{servo_id}_{kind}_raw",
                    f"Servo {servo_id} {kind} (raw)",
                    f"value_json.{kind}_raw['{servo_id}']",
                    enabled_by_default=False,
                )

    def add_records(self, now: BoardNow) -> None:
        """Add a button for each stored action and macro."""
        for kind, records in (("action", now.actions), ("macro", now.macros)):
            for record in records[:_MOST_RECORDS]:
                command = {"method": "run", "params": {"type": kind, "id": record.id}, "who": _WHO}
                self._add(
                    f"{kind}_{record.id}",
                    "button",
                    readable(record.caption).strip() or f"{kind.capitalize()} {record.id}",
                    command_topic=self._topics.board(self._board, "press"),
                    payload_press=_json(command),
                )

    def add_angles(self, servo_ids: tuple[int, ...], policy: BoardPolicy) -> None:
        """Add a number for the angle of each servo, which shows the reported angle, not the requested target."""
        speed = min(_SPEED, policy.max_speed or _SPEED)
        for servo_id in servo_ids:
            low, high = _range(policy, servo_id)
            if low >= high:  # nothing to choose from
                continue
            self._add(
                f"servo_{servo_id}_angle",
                "number",
                f"Servo {servo_id} angle",
                state_topic=self._topics.board(self._board, "vitals"),
                value_template=f"{{{{ value_json.angle['{servo_id}'] | default(none) }}}}",
                command_topic=self._topics.board(self._board, "press"),
                command_template=(
                    '{"method": "move", "params": {"targets": {"'
                    f'{servo_id}": {{{{ value }}}}}}, "speed": {speed:g}}}, "who": "{_WHO}"}}'
                ),
                min=low,
                max=high,
                step=1,
                mode="slider",
                unit_of_measurement="°",
                optimistic=False,
            )

    def _add_raw(self, key: str, name: str, value: str, **options: Any) -> None:
        self._add(
            key,
            "sensor",
            name,
            state_topic=self._topics.board(self._board, "vitals"),
            value_template=f"{{{{ {value} | default(none) }}}}",
            state_class="measurement",
            entity_category="diagnostic",
            **options,
        )

    def _add(self, key: str, platform: str, name: str, **options: Any) -> None:
        unique_id = f"{_object_id(self._topics, self._board)}_{key}"
        self.found[key] = {"platform": platform, "unique_id": unique_id, "name": name, **options}


def _object_id(topics: Topics, board: str) -> str:
    """Return the id of a board: letters, digits, - and _; the same name in another fleet has a different id."""
    if topics.prefix.isascii() and topics.prefix.isalnum():
        return f"{topics.prefix}_{board}"
    # Several prefixes are written alike, or like the beginning of a name.
    prefix = "".join(each if each.isascii() and each.isalnum() else "_" for each in topics.prefix)
    return f"{prefix}_{board}_{hashlib.blake2b(f'{topics.prefix}/{board}'.encode(), digest_size=4).hexdigest()}"


def _range(policy: BoardPolicy, servo_id: int) -> tuple[float, float]:
    """Return the lowest and the highest angle in degrees, within the limits of the servo and of all servos."""
    pairs = [policy.angles[key] for key in (str(servo_id), "all") if key in policy.angles] or [_FULL_TURN]
    return max(low for low, _ in pairs), min(high for _, high in pairs)


def _json(value: Document) -> str:
    return json.dumps(value, separators=(",", ":"))


class Announcer:
    """Sender of the discovery document and the vitals of a board."""

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
        """`kept` has the document retained by the broker from an earlier time, by topic."""
        self._home_assistant = home_assistant
        self._topics = topics
        self._policy = policy
        self._telemetry = telemetry
        self._outbox = outbox
        self._broker = broker
        self._board = telemetry.now.board
        self._topic = home_assistant.topic(topics, self._board)
        self._before: Document = _document(kept.get(self._topic, b""))
        self._announced: Document | None = None
        self._vitals: Vitals | None = None
        """The latest vitals at the broker."""
        if kept.get(earlier := home_assistant.earlier_topic(topics, self._board)):
            outbox.put(Publication(earlier, b"", 1, retain=True))
        telemetry.least_hz = 1 / VITALS_SECONDS
        telemetry.on_catalog = self.announce

    def follow(self, policy: BoardPolicy) -> None:
        """Announce what `policy` allows."""
        self._policy = policy
        self.announce()

    def announce(self) -> None:
        """Send the document after a change. Removed entities are deleted first."""
        telemetry = self._telemetry
        document = discovery(
            self._topics, telemetry.now, telemetry.servo_ids, self._policy, numbers=self._home_assistant.numbers
        )
        for each in (without(document, self._before), document):
            if each is not None and each != self._before:
                self._outbox.put(Publication(self._topic, encode(each), 1, retain=True))
        self._before = self._announced = document

    def resend(self) -> None:
        """Send everything again, on a new connection: a broker that was started again may have forgotten it."""
        self._vitals = None
        if self._announced is not None:
            self._outbox.put(Publication(self._topic, encode(self._announced), 1, retain=True))

    async def send_vitals(self) -> NoReturn:
        """Send the vitals now and then."""
        topic = self._topics.board(self._board, "vitals")
        while True:
            await self._broker.until_connected()
            frame = self._telemetry.frame
            vitals = None if frame is None else _vitals(msgspec.json.decode(frame, type=ServosFrame))
            if vitals is not None and vitals != self._vitals:
                with suppress(ConnectionLost):
                    await self._broker.send(Publication(topic, encode(vitals), retain=True))
                    self._vitals = vitals
            await asyncio.sleep(VITALS_SECONDS)


def _vitals(frame: ServosFrame) -> Vitals:
    true = [servo for servo in frame.servos if not servo.doubt]
    unknown = dict.fromkeys(servo.servo_id for servo in frame.servos if servo.doubt)
    return Vitals(
        {servo.servo_id: servo.angle for servo in true} | unknown,
        {servo.servo_id: servo.temperature_raw for servo in true} | unknown,
        {servo.servo_id: servo.current_raw for servo in true} | unknown,
        max((servo.temperature_raw for servo in true), default=None),
        max((servo.current_raw for servo in true), default=None),
    )


def _document(payload: bytes) -> Document:
    """Return the document in a payload; an empty document for a payload of another origin."""
    with suppress(*UNREADABLE, AttributeError, TypeError, KeyError):
        found: Any = msgspec.json.decode(payload)
        return {**found, "components": {key: {"platform": one["platform"]} for key, one in found["components"].items()}}
    return {}
