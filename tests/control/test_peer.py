"""The JSON-RPC of the control interface: whatever a program sends, it gets one clear answer, and costs little.

Module: servolink.control.error_codes.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Coroutine
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta, Struct

from servolink.control import peer
from servolink.control.error_codes import Code
from servolink.control.peer import MOST_BEGUN, MOST_NOTIFICATIONS, MOST_WAITING, Methods, Peer, encode, encoded
from servolink.control.rights import Role, Touches
from servolink.errors import MotionRefused, NotFound
from tests.virtual_time import run


class Nothing(Struct, forbid_unknown_fields=True):
    pass


class Wait(Struct, forbid_unknown_fields=True):
    seconds: Annotated[float, Meta(ge=0, le=60)] = 0.0
    name: str = ""


class Log:
    """What the methods were asked, in the order in which they did it."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.under_way = 0
        self.most = 0


METHODS: Methods[Log] = Methods()


@METHODS.add("look", Role.WATCH, touches=Touches.NOTHING)
def look(log: Log, params: Nothing) -> dict[str, int]:
    """Return at once."""
    return {"done": len(log.done)}


@METHODS.add("read", Role.WATCH, touches=Touches.NOTHING)
async def read(log: Log, params: Wait) -> dict[str, str]:
    """Take some time."""
    log.under_way += 1
    log.most = max(log.most, log.under_way)
    await asyncio.sleep(params.seconds)
    log.under_way -= 1
    log.done.append(params.name)
    return {"name": params.name}


@METHODS.add("move", Role.MOVE, touches=Touches.MOTION, in_order=True)
async def move(log: Log, params: Wait, on_progress: Callable[[Struct], None]) -> None:
    """Take some time, in its turn."""
    on_progress(params)
    await asyncio.sleep(params.seconds)
    log.done.append(params.name)


@METHODS.add("stop", Role.WATCH, touches=Touches.NOTHING)
def stop(log: Log, params: Nothing) -> Coroutine[Any, Any, None]:
    """Begin at once, and end in a moment."""
    log.done.append("stop")
    return asyncio.sleep(0.5)


@METHODS.add("start", Role.RUN, touches=Touches.NOTHING, is_urgent=True)
async def start(log: Log, params: Wait) -> None:
    """Wait for a moment that was agreed on."""
    await asyncio.sleep(params.seconds)


@METHODS.add("refuse", Role.WATCH, touches=Touches.NOTHING)
async def refuse(log: Log, params: Nothing) -> None:
    raise MotionRefused("beyond\u202e the limit", "targets.hip")


@METHODS.add("seek", Role.WATCH, touches=Touches.NOTHING)
def seek(log: Log, params: Nothing) -> None:
    raise NotFound("there is none")


@METHODS.add("break", Role.WATCH, touches=Touches.NOTHING)
async def fail(log: Log, params: Nothing) -> None:
    raise ZeroDivisionError("secret")


@METHODS.add("odd", Role.WATCH, touches=Touches.NOTHING)
def odd(log: Log, params: Nothing) -> list[str]:
    return ["\u202e", "\udcff", "é"]


class Program:
    """The other end."""

    def __init__(
        self, role: Role = Role.EDIT, *, log: Log | None = None, reading: asyncio.Semaphore | None = None
    ) -> None:
        self.log = log or Log()
        self.raw: list[bytes] = []
        self.aborted = ""
        self.peer: Peer[Log] = Peer(METHODS, lambda: self.log, self.raw.append, self._abort, role=role, reading=reading)

    def _abort(self, reason: str) -> None:
        self.aborted = reason

    def call(self, method: str, request_id: Any = None, **params: Any) -> None:
        message = {"jsonrpc": "2.0", "method": method, "params": params}
        self.peer.receive(json.dumps(message | ({} if request_id is None else {"id": request_id})))

    @property
    def got(self) -> list[dict[str, Any]]:
        return [json.loads(message) for message in self.raw]

    def errors(self) -> list[int]:
        return [message["error"]["code"] for message in self.got if "error" in message]

    async def settle(self, seconds: float = 100.0) -> None:
        await asyncio.sleep(seconds)


def error_of(message: bytes | str, role: Role = Role.EDIT) -> dict[str, Any]:
    """Return the one error that a message is answered with."""

    async def main() -> dict[str, Any]:
        program = Program(role)
        program.peer.receive(message)
        await program.settle(1)
        assert len(program.got) == 1
        assert program.got[0]["jsonrpc"] == "2.0"
        return program.got[0]

    return run(main())


def request(**fields: Any) -> str:
    return json.dumps({"jsonrpc": "2.0", "id": 1, "method": "look"} | fields)


@pytest.mark.parametrize(
    ("message", "request_id", "code", "text"),
    [
        ("nonsense", None, Code.PARSE_ERROR, "is not JSON"),
        (b"\xff\xfe", None, Code.PARSE_ERROR, "UTF-8"),
        ("", None, Code.PARSE_ERROR, "is not JSON"),
        ("[" * 100_000, None, Code.PARSE_ERROR, "nested too deeply"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, None, Code.PARSE_ERROR, "nested too deeply"),
        ('{"id": 1, "id": 2}', None, Code.PARSE_ERROR, "'id' is a duplicate key"),
        (f'{{"id": {"9" * 5000}}}', None, Code.PARSE_ERROR, "thousands of digits"),
        ('{"id": NaN}', None, Code.PARSE_ERROR, "NaN is not a number"),
        (" " * (Peer.MOST_BYTES + 1), None, Code.PARSE_ERROR, "larger than 1 MiB"),
        (f"[{request()}]", None, Code.INVALID_REQUEST, "batches are not supported"),
        ("17", None, Code.INVALID_REQUEST, "must be an object, not 17"),
        (request(id=1.5), None, Code.INVALID_REQUEST, "id must be text or an integer"),
        (request(id=None), None, Code.INVALID_REQUEST, "id must be text or an integer of at most 2**53, not null"),
        (request(id=True), None, Code.INVALID_REQUEST, "id must be text or an integer of at most 2**53, not true"),
        (request(id=2**60), None, Code.INVALID_REQUEST, "at most 2**53"),
        (request(id="x" * 129), None, Code.INVALID_REQUEST, "at most 128 characters"),
        (request(jsonrpc="1.0"), 1, Code.INVALID_REQUEST, '"jsonrpc" must be "2.0"'),
        (request(method=7), 1, Code.INVALID_REQUEST, "method must be text"),
        (request(params=[1]), 1, Code.INVALID_REQUEST, "given by name"),
        (request(extra="\u202e"), 1, Code.INVALID_REQUEST, "'extra' is not a field"),
        (request(method="fly\u202e", id="a"), "a", Code.METHOD_NOT_FOUND, r"there is no method 'fly\u202e'"),
        (request(params={"x": 1}), 1, Code.INVALID_PARAMS, "'x' is not a field"),
        (request(method="read", params={"seconds": "1"}), 1, Code.INVALID_PARAMS, "seconds: must be a number, not '1'"),
        (request(method="read", params={"seconds": 1e9}), 1, Code.INVALID_PARAMS, "at most 60"),
        (request(method="read", params={"seconds": 10**400}), 1, Code.INVALID_PARAMS, "seconds"),
        (request(method="read", params={"name": ["\udcff"]}), 1, Code.INVALID_PARAMS, "name"),
    ],
)
def test_what_is_wrong_is_answered_with_one_clear_error(
    message: bytes | str, request_id: Any, code: Code, text: str
) -> None:
    answer = error_of(message)
    assert answer["id"] == request_id
    assert answer["error"]["code"] == code
    assert answer["error"]["data"]["kind"] == code.name.lower()
    assert answer["error"]["data"]["remedy"]
    assert text in answer["error"]["message"]
    assert len(answer["error"]["message"]) < 300


def test_an_error_of_the_library_has_its_own_code_and_says_what_to_do() -> None:
    error = error_of(request(method="refuse"))["error"]
    assert error["code"] == 202
    assert error["data"] == {
        "kind": "MotionRefused",
        "remedy": "nothing moved: stay within the limits, or take the lease",
        "path": "targets.hip",
        "reason": "other",
    }
    assert error["message"] == "targets.hip: beyond\\u202e the limit"
    assert error_of(request(method="seek"))["error"]["code"] == 303


def test_a_defect_is_logged_and_not_explained_to_the_program(caplog: pytest.LogCaptureFixture) -> None:
    error = error_of(request(method="break"))["error"]
    assert error["code"] == Code.INTERNAL_ERROR
    assert "secret" not in error["message"]
    assert "break failed" in caplog.text


def test_a_role_is_enough_for_some_methods_only() -> None:
    error = error_of(request(method="move"), Role.WATCH)["error"]
    assert (error["code"], error["message"]) == (
        Code.FORBIDDEN,
        "move needs the role move, and this program has the role watch",
    )
    assert "result" in error_of(request(method="stop"), Role.WATCH)


async def test_responses_are_ascii_whatever_is_stored() -> None:
    program = Program()
    program.call("odd", 1)
    assert program.raw[0].isascii()
    assert program.got[0]["result"] == ["\u202e", "\udcff", "é"]


class Found(Struct, frozen=True):
    content: Any
    number: int = 1


@pytest.mark.parametrize(
    "content", ["揮手", [], {}, [1, "手"], ["揮手", "手"] * 99, {"é": [["°"], 'a"😀', None] * 99}, ["\udcff", ""] * 99]
)
def test_json_is_ascii_and_the_same_in_pieces(content: Any) -> None:
    for text in (encode(Found(content)), encode(encoded(Found(content)))):
        assert text.isascii()
        assert json.loads(text) == {"content": content, "number": 1}


def test_a_large_result_is_encoded_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    def measured(value: Any) -> bytes:
        sizes.append(len(text := encode(value)))
        return text

    monkeypatch.setattr(peer, "encode", measured)
    actions = [{"action_id": number, "action_caption": "揮手"} for number in range(20_000)]
    encoded(Found({"actions": actions}))
    assert max(sizes) < sum(sizes) / 100


async def test_a_request_without_id_is_carried_out_and_not_answered() -> None:
    program = Program()
    program.call("read", name="a")
    program.call("seek")
    program.call("refuse")
    program.call("fly")
    await program.settle()
    assert program.log.done == ["a"]
    assert program.got == []


async def test_motion_keeps_its_order_while_reading_goes_on_and_a_stop_goes_first() -> None:
    program = Program()
    program.call("move", 1, name="slow", seconds=3)
    program.call("move", 2, name="quick")
    for number in range(20):
        program.call("read", 10 + number, name="read", seconds=1)
    await asyncio.sleep(0)
    program.call("stop", 99)
    assert program.log.done == ["stop"]
    await program.settle()
    assert program.log.done.index("slow") < program.log.done.index("quick")
    assert program.log.done.index("read") < program.log.done.index("slow")
    assert program.log.most == Peer.MOST_READING
    assert sorted(message["id"] for message in program.got if "id" in message) == [1, 2, *range(10, 30), 99]


async def test_programs_of_a_group_read_as_one_and_a_stop_goes_first() -> None:
    log, reading = Log(), asyncio.Semaphore(Peer.MOST_READING)
    programs = [Program(log=log, reading=reading) for _ in range(10)]
    for program in programs:
        for number in range(10):
            program.call("read", number, name="read", seconds=1)
    await asyncio.sleep(0)
    programs[-1].call("stop", 99)
    assert log.done == ["stop"]
    await programs[0].settle()
    assert log.most == Peer.MOST_READING
    assert len(log.done) == 101


async def test_progress_names_the_request() -> None:
    program = Program()
    program.call("move", "import", name="step")
    await program.settle()
    assert program.got[0] == {
        "jsonrpc": "2.0",
        "method": "progress",
        "params": {"id": "import", "seconds": 0.0, "name": "step"},
    }


async def test_a_flood_is_refused_and_a_stop_still_passes() -> None:
    program = Program()
    for number in range(1000):
        program.call("move", number, seconds=1)
    assert program.errors() == [Code.BUSY] * (1000 - MOST_WAITING)
    program.call("stop", "stop")
    assert program.log.done == ["stop"]
    await program.settle()
    assert len(program.log.done) == 1 + MOST_WAITING
    program.call("move", "again")
    await program.settle()
    assert program.got[-1] == {"jsonrpc": "2.0", "id": "again", "result": {}}


async def test_of_a_flood_of_stops_each_is_carried_out_and_some_are_told_what_came_of_it() -> None:
    program = Program()
    for number in range(1000):
        program.call("stop", number)
    assert program.log.done == ["stop"] * 1000
    assert program.errors() == [Code.BUSY] * (1000 - MOST_BEGUN)
    assert "this stop was carried out, but no outcome is reported: 128 earlier" in program.got[0]["error"]["message"]
    await program.settle()
    assert sum("result" in message for message in program.got) == MOST_BEGUN
    program.call("stop", "again")
    await program.settle()
    assert program.got[-1] == {"jsonrpc": "2.0", "id": "again", "result": {}}
    program.call("stop", "unheard")
    await program.peer.close()


async def test_a_stop_is_accepted_however_many_starts_wait_for_their_moment() -> None:
    program = Program()
    for number in range(1000):
        program.call("start", number, seconds=5)
    assert program.errors() == [Code.BUSY] * (1000 - 2 * MOST_WAITING)
    program.call("stop", "stop")
    await program.settle(2)
    assert program.got[-1] == {"jsonrpc": "2.0", "id": "stop", "result": {}}
    await program.settle()


async def test_large_requests_do_not_fill_the_memory() -> None:
    program = Program()
    for number in range(10):
        program.call("move", number, name="x" * (Peer.MOST_BYTES - 1000), seconds=1)
    assert program.errors() == [Code.BUSY] * 8
    await program.settle()


async def test_a_program_that_does_not_read_gets_nothing_but_what_it_must() -> None:
    program = Program()
    program.peer.pause()
    program.call("read", 1, name="a")
    program.call("stop", 2)
    for number in range(2 * MOST_NOTIFICATIONS):
        program.peer.notify("tick", {"number": number})
    await program.settle()
    assert program.log.done == ["stop"]  # carried out, and its response is short
    assert len(program.raw) == 1
    assert program.peer.dropped == MOST_NOTIFICATIONS
    program.peer.resume()
    await program.settle()
    assert program.got[1]["params"]["number"] == MOST_NOTIFICATIONS
    assert program.got[-1]["result"] == {"name": "a"}


async def test_a_program_that_asks_without_ever_reading_is_disconnected() -> None:
    program = Program()
    program.peer.pause()
    for number in range(1000):
        program.call("look", number)
    assert "responses wait unread" in program.aborted
    assert len(program.raw) == MOST_WAITING
    program.peer.notify("tick", {})
    program.peer.receive(request())
    await program.peer.close()
    assert len(program.raw) == MOST_WAITING


async def test_sending_may_pause_again() -> None:
    program = Program()
    program.peer.pause()
    for number in range(3):
        program.peer.notify("tick", {"number": number})

    def send(message: bytes) -> None:
        program.raw.append(message)
        program.peer.pause()

    program.peer._send = send
    program.peer.resume()
    assert len(program.raw) == 1
    program.peer.resume()
    program.peer.resume()
    assert [message["params"]["number"] for message in program.got] == [0, 1, 2]


async def test_the_end_of_a_program_ends_its_requests() -> None:
    program = Program()
    program.call("move", 1, name="never", seconds=50)
    program.call("move", 2, name="never either")
    await asyncio.sleep(1)
    await program.peer.close()
    await program.settle()
    assert program.log.done == []
    assert [message for message in program.got if "id" in message] == []


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters(), max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
_REQUESTS = st.fixed_dictionaries(
    {},
    optional={
        "jsonrpc": st.just("2.0") | _JSON,
        "id": st.integers() | st.text(max_size=4) | _JSON,
        "method": st.sampled_from([*METHODS, "fly"]) | _JSON,
        "params": st.dictionaries(st.sampled_from(["seconds", "name", "x"]), _JSON, max_size=2) | _JSON,
    },
)


@given(st.lists(_REQUESTS.map(json.dumps) | _JSON.map(json.dumps) | st.binary(max_size=60), max_size=8))
def test_no_message_breaks_it(messages: list[str | bytes]) -> None:
    async def main() -> None:
        program = Program()
        for message in messages:
            program.peer.receive(message)
        await program.settle(10_000)
        responses = [message for message in program.got if "id" in message]
        assert len(responses) <= len(messages)
        assert all(("result" in message) != ("error" in message) for message in responses)
        assert all(raw.isascii() and b"\n" not in raw for raw in program.raw)
        program.call("look", "still here")
        assert program.got[-1]["id"] == "still here"

    run(main())
