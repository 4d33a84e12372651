"""Topics of a fleet and the content of each, declared once.

The methods, their params and their results are those of the hub's control interface (`servolink.control`); a fleet
adds `prepare` and `cancel`. From these types come the checks of what is received, the reference page and the JSON
Schema.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from inspect import cleandoc
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from servolink.control import (
    ButtonPressed,
    ConnectionState,
    Done,
    ErrorObject,
    RoleName,
    Runnable,
    Scope,
    ServosFrame,
    Touches,
    about,
)
from servolink.errors import InvalidAddress, quote
from servolink.hub import METHODS as HUB_METHODS
from servolink.project import Phase
from servolink.support import ALL, is_name

PREFIX = "servolink"
UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
"""Errors raised for unreadable JSON of an unknown sender."""
MOST_BYTES = 1024 * 1024
"""The longest payload of a command."""
CONTENT_TYPE = "application/json"
ONLINE, OFFLINE = "online", "offline"
"""Content of the topic `available`."""
DEFAULT_EXPIRY = 10
"""Seconds until a command expires, unless the sender sets an expiry."""

BoardTopic: TypeAlias = Literal[
    "available", "state", "servos", "vitals", "event", "log", "cmd", "press", "start", "stop", "echo", "result", "pulse"
]
FleetTopic: TypeAlias = Literal["start", "stop", "echo"]
CommandId: TypeAlias = Annotated[str, Meta(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+(?!\n)$")]
Who: TypeAlias = Annotated[str, Meta(max_length=60, description="the sender as people call it")]

_FLEET = "_fleet"  # no board is called so: names begin with a letter or a digit
_LONGEST_PREFIX = 200
_LEVELS = re.compile(r"[^\x00-\x1f\x7f-\x9f\ud800-\udfff+#/$][^\x00-\x1f\x7f-\x9f\ud800-\udfff+#]*")


@dataclass(frozen=True, slots=True)
class Topics:
    """Topics of a fleet under a prefix."""

    prefix: str = PREFIX

    def __post_init__(self) -> None:
        """Raise InvalidAddress for a prefix that topics cannot begin with."""
        wrong = not _LEVELS.fullmatch(self.prefix) or "//" in self.prefix or self.prefix.endswith("/")
        if wrong or len(self.prefix) > _LONGEST_PREFIX:
            raise InvalidAddress(
                f"{quote(self.prefix)} cannot be a prefix of topics: use text such as servolink or school/room1, "
                "without + # $ and control characters"
            )

    def board(self, name: str, topic: BoardTopic) -> str:
        """Return a topic of a board, or of every board for the name `+`. Raise InvalidAddress for an invalid name."""
        if name == ALL:
            raise InvalidAddress(f"{ALL!r} means every board of a fleet: give the board another name, with --name")
        if name != "+" and not is_name(name):
            raise InvalidAddress(f"{quote(name)} cannot be the name of a board: use up to 64 letters, digits, - and _")
        return f"{self.prefix}/{name}/{topic}"

    def fleet(self, topic: str) -> str:
        """Return a topic of all boards together, such as `stop`, or of programs."""
        return f"{self.prefix}/{_FLEET}/{topic}"

    def parse(self, topic: str) -> tuple[str, str] | None:
        """Return the board and the kind of a topic, as in `("rex", "state")`; None for any other topic.

        The kind of results for a program is `result/USER/WORD`. An access list lets only the user of a board write
        below its name, so the topic says who has sent a message; the name in a payload proves nothing.
        """
        if not topic.startswith(f"{self.prefix}/"):
            return None
        name, _, kind = topic.removeprefix(f"{self.prefix}/").partition("/")
        is_kind = kind.startswith("result/") or (kind and "/" not in kind)
        return (name, kind) if is_name(name) and name != ALL and is_kind else None

    def may_answer(self, board: str, topic: str) -> bool:
        """Return whether `board` sends results to this response topic: below its own `result`, and nowhere else.

        Elsewhere, a sender could have a board write what the broker does not allow the sender to write.
        """
        reader = topic.removeprefix(f"{self.board(board, 'result')}/")
        return reader != topic and len(reader) <= _LONGEST_PREFIX and _LEVELS.fullmatch(reader) is not None

    def reader(self, user: str | None, word: str) -> str:
        """Return the kind of the results that only this user reads, as in `result/teacher/WORD`."""
        is_level = user and "/" not in user and len(user) < _LONGEST_PREFIX // 2 and _LEVELS.fullmatch(user)
        return f"result/{user if is_level else '-'}/{word}"

    def is_earlier_reply(self, topic: str) -> bool:
        """Return whether an earlier version of servolink listens there: every board could write in another's name."""
        return topic.startswith(f"{self.prefix}/{_FLEET}/reply/")


# --- from a board -----------------------------------------------------------------------------------------------------


class Stored(Struct, frozen=True):
    """A stored action or macro."""

    id: int
    caption: str


class BoardNow(Struct, frozen=True, kw_only=True):
    """Board of a fleet. Sent to `state`, retained, after every change."""

    board: str
    host: Annotated[str, about("the machine that it is connected to")]
    version: Annotated[str, about("of servolink on that machine")]
    connection: ConnectionState
    allow: Annotated[RoleName, about("remote control allowed for the board")]
    battery_percent: Annotated[float | None, about("to 0.1; null if unknown, or beyond 100")] = None
    problems: Annotated[tuple[str, ...], about("the latest, which people should look at")] = ()
    noise: Annotated[int, about("bytes from the board that belong to no frame")] = 0
    programs: Annotated[int, about("that use the board on its machine")] = 0
    lease: Annotated[str | None, about("the program that moves the board; null if none does")] = None
    hold: Annotated[str | None, about("the program that has exclusive use of the board; null if none has")] = None
    tcp: Annotated[
        str | None, about("address of its hub for programs on other machines (`share --tcp`); null without one")
    ] = None
    servos: int = 0
    actions: tuple[Stored, ...] = ()
    macros: tuple[Stored, ...] = ()
    at: Annotated[float, about("seconds since 1970, by the clock of its machine")]


class ServosNow(ServosFrame, frozen=True):
    """Latest state of the servos. Sent to `servos`, QoS 0: late states are dropped.

    None is sent from `prepare` to the start.
    """


class Vitals(Struct, frozen=True):
    """Readings for programs that keep every value. Sent to `vitals`, retained, every few seconds; by servo id.

    Values that cannot be true are null.
    """

    angle: dict[int, int | None]
    temperature_raw: dict[int, int | None]
    current_raw: dict[int, int | None]
    highest_temperature_raw: int | None
    highest_current_raw: int | None


class EventNow(ButtonPressed, frozen=True, kw_only=True):
    """A button of the joystick. Sent to `event`."""

    id: Annotated[int, about("counts up from the start of the bridge")]
    at: Annotated[float, about("seconds since 1970, by the clock of its machine")]


class LogLine(Struct, frozen=True):
    """Notice for people. Sent to `log`, QoS 0."""

    level: Literal["info", "warning", "error"]
    text: str
    at: Annotated[float, about("seconds since 1970, by the clock of its machine")]


# --- to a board, and back ---------------------------------------------------------------------------------------------


class BoardCommand(Struct, forbid_unknown_fields=True):
    """Method to carry out, once however often delivered. Sent to `cmd`, with a message expiry."""

    id: CommandId
    method: Annotated[str, Meta(max_length=40)]
    params: dict[str, Any] = {}
    who: Who = ""
    pulse: Annotated[
        Annotated[str, Meta(max_length=40)] | None,
        about("the latest `pulse` of the board that the sender has heard: how old the command is, without clocks"),
    ] = None


class Press(Struct, forbid_unknown_fields=True):
    """Method to carry out at once or never, from a program that can neither number messages nor let them expire.

    Sent to `press`, QoS 0, it expires in 5 seconds, and is not kept for a board that is away. One that is
    delivered twice counts as two.
    """

    method: Annotated[str, Meta(max_length=40)]
    params: dict[str, Any] = {}
    who: Who = ""


class Prepare(Struct, forbid_unknown_fields=True):
    """Params of the method `prepare`: take the lease, and wait for the message that starts all boards together."""

    start: Annotated[CommandId, about("the `id` of the message `start` to wait for")]
    run: Annotated[Runnable, about("what to run then")]
    expires: Annotated[float, Meta(gt=0, le=60, description="seconds after which the run is forgotten")] = 10.0


class Prepared(Struct, frozen=True):
    """Result of the method `prepare`."""

    seconds: Annotated[float | None, about("planned duration of an action; null for a macro")]
    idle_servos: Annotated[
        tuple[int, ...], about("servos that are stopped or released and do not move, as last read")
    ] = ()


class Cancel(Struct, forbid_unknown_fields=True):
    """Params of the method `cancel`: forget the prepared run, and give the lease back."""

    start: CommandId


class Start(Struct, forbid_unknown_fields=True):
    """Sent to `start` of a board, or to `_fleet/start` for all: those prepared for the id begin, and send a result."""

    id: CommandId
    who: Who = ""
    at: Annotated[
        float | None,
        about(
            "for one board: when to begin by the clock of its machine, at most 1 s ahead; else 0.1 s after the message"
        ),
    ] = None


class Started(Struct, frozen=True):
    """The result of a start."""

    host: str
    after: Annotated[float, about("seconds from the message until the run was sent to the board, which confirmed it")]
    monotonic: Annotated[float, about("when it was sent; comparable between boards of one machine")]


class Stop(Struct, forbid_unknown_fields=True):
    """Sent to `stop` of a board, or to `_fleet/stop` for all. An empty payload is a stop, too."""

    id: CommandId = "stop"
    who: Who = ""


class StopOver(Struct, frozen=True):
    """The result of a stop."""

    pulse: Annotated[str, about("a word for the `pulse` of what is sent after the stop")]


class Echo(Struct, forbid_unknown_fields=True):
    """Sent to `echo` of a board, or to `_fleet/echo` for all: answered at once, to measure the delay of the network."""

    id: CommandId


class Echoed(Struct, frozen=True):
    """The result of an echo."""

    monotonic: Annotated[float, about("when it was received; comparable between boards of one machine")]


class TransferStep(Struct, frozen=True):
    """How far a command is: export, plan, apply, rollback, and changes of records."""

    phase: Phase
    done: int
    total: Annotated[int, about("items of this phase")]
    item: Annotated[str, about("such as `action 3`")]


class BoardResult(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Answer to a command. Sent to `result`, or to the response topic of the command if that is below `result`.

    A message with `progress` is not the answer yet: it has no `ok`.
    """

    id: Annotated[str | None, about("id of the command; null if the message has no valid id")]
    board: str
    ok: bool | UnsetType = UNSET
    result: Annotated[Any, about("what the method returns, if `ok`")] = UNSET
    error: Annotated[ErrorObject | UnsetType, about("why it was not done, unless `ok`")] = UNSET
    progress: TransferStep | UnsetType = UNSET


SENT: dict[str, tuple[type[Struct], int, bool]] = {
    "state": (BoardNow, 1, True),
    "servos": (ServosNow, 0, False),
    "vitals": (Vitals, 0, True),
    "event": (EventNow, 1, False),
    "log": (LogLine, 0, False),
    "result": (BoardResult, 1, False),
    "cmd": (BoardCommand, 1, False),
    "press": (Press, 0, False),
    "start": (Start, 1, False),
    "stop": (Stop, 1, False),
    "echo": (Echo, 0, False),
    "_fleet/start": (Start, 1, False),
    "_fleet/stop": (Stop, 1, False),
    "_fleet/echo": (Echo, 0, False),
}
"""Payload, QoS and retained flag, by topic. `available` is plain text: `online` or `offline`."""

METHODS: dict[str, tuple[type[Struct], type[Struct], Scope]] = {
    "prepare": (Prepare, Prepared, Scope(Touches.MOTION, from_afar=True)),
    "cancel": (Cancel, Done, Scope(Touches.NOTHING, from_afar=True)),
}
"""Params, result and scope of the methods that a fleet adds to the methods of the control interface."""


def readable(caption: str) -> str:
    """Return a caption that every reader of JSON accepts: with question marks for bytes that are not text."""
    return caption.encode("utf-8", "replace").decode()


def scope_of(method: str) -> Scope:
    """Return the scope of a method of the control interface or of a fleet."""
    if method in METHODS:
        return METHODS[method][2]
    return HUB_METHODS[method].scope if method in HUB_METHODS else Scope.unknown()


def needs_pulse(scope: Scope) -> bool:
    """Return whether a command must have a pulse beside its expiry: an import turns servos by their corrections."""
    return scope.moves and Touches.BOARD in scope.touches


def schema() -> dict[str, Any]:
    """Return the JSON Schema of the payloads: `topics` and `methods` refer to the types in `$defs`."""
    types = [payload for payload, _, _ in SENT.values()] + [params for params, _, _ in METHODS.values()]
    found, definitions = msgspec.json.schema_components(
        [*types, Prepared, Started, StopOver, Echoed], ref_template="#/$defs/{name}"
    )
    of = dict(zip(map(id, types), found, strict=False))
    for definition in definitions.values():  # as Python 3.13 does without help
        definition["description"] = cleandoc(definition["description"])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "servolink fleet",
        "topics": {
            topic: {"payload": of[id(payload)], "qos": qos, "retain": retain}
            for topic, (payload, qos, retain) in SENT.items()
        },
        "methods": {name: {"params": of[id(params)]} for name, (params, _, _) in METHODS.items()},
        "$defs": definitions,
    }
