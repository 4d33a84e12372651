"""The door for programs of this machine: what they say at first, and who they cannot harm.

Modules: servolink.control.greeting, servolink.control.share_address.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.client import Board, connect
from servolink.control import Greeting, this_program
from servolink.errors import OpenError
from servolink.hub.doors import socket_door
from servolink.hub.hub import Hub
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import (
    AddActionRequest,
    Codec,
    QueryActionRequest,
    QueryActionResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
)
from servolink.support import socket_folder, socket_path
from servolink.transports import create
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import RawLine, on_hub, raw_socket, sharing, until
from tests.processes import LIMIT
from tests.transports.wires import Ear

LIST = Codec().encode(QueryServoListRequest())
ANSWER = Codec().encode(QueryServoListResponse((1, 2, 3)))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "servolink"


# --- greetings --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("greeting", "why"),
    [
        (b"POST / HTTP/1.1\r\n", "this is not a greeting"),
        (b"{}\n", "this is not a greeting"),
        (b"\xff\n", "this is not a greeting"),
        (b'{"servolink": 2, "wants": "everything"}\n', "this hub has version 1 of its protocol, not 2"),
        (b'{"servolink": 1, "wants": "frames", "who": "x", "role": "god"}\n', "god"),
        (b'{"servolink": 1, "wants": "frames", "who": "x", "more": 1}\n', "more"),
        (b'{"servolink": 1, "wants": "frames", "who": "x", "session": "1"}\n', "they have no session yet"),
        (b'{"servolink": 1, "wants": "frames", "who": "x", "dead_man": 1}\n', "frames have no dead-man time"),
        (b'{"servolink": 1, "wants": "rpc", "who": "x"}\n', "no control interface"),
        (b"x" * (Greeting.MOST_BYTES + 1), f"a greeting has at most {Greeting.MOST_BYTES} bytes"),
        (b"[" * Greeting.MOST_BYTES + b"\n", "this is not a greeting"),
    ],
)
def test_a_wrong_greeting_is_refused_with_the_reason(greeting: bytes, why: str) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with RawLine(raw_socket()) as line:
                await line.send(greeting)
                assert why in json.loads(await line.until_end())["error"]
            assert not hub.programs

    on_hub(use)


@given(
    st.binary(max_size=Greeting.MOST_BYTES)
    | st.dictionaries(
        st.sampled_from([*Greeting.__struct_fields__, "x"]),
        st.sampled_from([1, "frames", "rpc", "edit", "big", "\ud800", None, 0.3, 1e400, [], {}]),
    ).map(lambda value: json.dumps({"servolink": 1, "wants": "frames", "who": "x"} | value).encode())
)
def test_a_greeting_is_read_or_refused(line: bytes) -> None:
    for token in ("", "secret"):
        with suppress(ValueError):
            assert socket_door._read_greeting(line, token).servolink == 1


def test_half_a_greeting_has_a_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket_door, "GREETING_LIMIT", 0.05)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with RawLine(raw_socket()) as silent, RawLine(raw_socket()) as slow:
                await slow.send(b'{"servolink": 1,')
                for line in (silent, slow):
                    assert json.loads(await line.until_end()) == {"error": "no greeting within 0.05 s"}

    on_hub(use)


def test_a_greeting_may_come_in_pieces_and_with_the_first_frames() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with RawLine(raw_socket()) as line:
                text = b'{"servolink": 1, "wants": "frames", "who": "x"}\n'
                for byte in text:
                    await line.send(bytes([byte]))
                    await asyncio.sleep(0)
                welcome = json.loads(await line.read())
                assert welcome["name"] == "rex"
                await line.send(LIST)
                assert await line.until(len(ANSWER)) == ANSWER
            with RawLine(raw_socket()) as line:
                await line.send(text + LIST)
                both = b""
                while not both.endswith(ANSWER):
                    both += await line.read()
                assert both.startswith(b'{"servolink":1')

    on_hub(use)


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b'{"error": "\\u001b[31mno"}\n', r"the hub refuses: \\x1b\[31mno"),
        (b"hello\n", "what listens there is not a hub"),
        (b'{"servolink": 2, "session": "", "name": "", "url": "", "role": "edit"}\n', "version 2 .*update servolink"),
        (b"", "the hub closed the connection"),
    ],
)
def test_what_a_hub_says_is_not_believed(answer: bytes, why: str, folder: Path) -> None:
    async def main() -> None:
        folder.mkdir(mode=0o700)
        with socket_folder() as short, socket.socket(socket.AF_UNIX) as listening:
            listening.bind(socket_path(short, "rex"))
            listening.listen()
            listening.settimeout(0)
            opening = asyncio.ensure_future(create("share://rex").open(Ear()))
            other, _ = await asyncio.get_running_loop().sock_accept(listening)
            with other:
                await asyncio.get_running_loop().sock_recv(other, Greeting.MOST_BYTES)
                await asyncio.get_running_loop().sock_sendall(other, answer)
            with pytest.raises(OpenError) as caught:
                await opening
        assert caught.match(why)

    asyncio.run(main())


def test_a_cancelled_greeting_leaves_nothing(folder: Path) -> None:
    async def main() -> None:
        folder.mkdir(mode=0o700)
        with socket_folder() as short, socket.socket(socket.AF_UNIX) as listening:
            listening.bind(socket_path(short, "rex"))
            listening.listen()
            listening.settimeout(0)
            opening = asyncio.ensure_future(connect("share://rex").open())
            other, _ = await asyncio.get_running_loop().sock_accept(listening)
            with RawLine(other) as line:
                assert await line.read()
                opening.cancel()
                assert await line.read() == b""
            with pytest.raises(asyncio.CancelledError):
                await opening

    asyncio.run(main())


def test_the_control_interface_has_the_session_of_its_program() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel):
            with RawLine(raw_socket()) as frames, RawLine(raw_socket()) as rpc, RawLine(raw_socket()) as stranger:
                session = (await frames.greet())["session"]
                assert (await rpc.greet(wants="rpc", session=session))["session"] == session
                await rpc.send(b'{"jsonrpc": "2.0", "method": "status", "id": 1}\n')
                answer = json.loads(await rpc.read())
                assert answer["result"]["name"] == "rex"
                error = (await stranger.greet(wants="rpc", session="guessed"))["error"]
                assert error == "there is no such session; perhaps it has ended"
                await rpc.send(b"x" * (socket_door.MOST_MESSAGE + 5000))
                await rpc.until_end()
        await interface.close()

    on_hub(use)


@pytest.mark.parametrize(
    ("words", "who"),
    [
        (["/usr/bin/servolink", "--board", "rex", "watch", "--csv"], "servolink watch"),
        (["/x/servolink/__main__.py", "-v", "stop"], "servolink stop"),
        (["/home/me/walk\x1b.py", "watch"], "walk\\x1b.py"),
        (["servolink"], "servolink"),
        ([""], "python"),
        ([], "python"),
    ],
)
def test_a_program_says_who_it_is(words: list[str], who: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", words)
    assert this_program() == f"{who} (pid {os.getpid()})"


# --- survival ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.slow)])
def test_many_programs_are_served_at_the_same_time(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both sides share a processor, and perhaps a busy one.
    monkeypatch.setattr(socket_door, "GREETING_LIMIT", LIMIT)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            boards: list[Board] = []
            while len(boards) < count:
                boards += await asyncio.gather(*(connect("share://rex", patience=LIMIT).open() for _ in range(25)))
            assert len(hub.programs) == count
            assert set(await asyncio.gather(*(board.servo_ids() for board in boards))) == {(1, 2, 3)}
            await asyncio.gather(*(board.close() for board in boards))
            await until(lambda: not hub.programs)

    on_hub(use)


def big_action() -> AddActionRequest:
    return AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000)))


@pytest.mark.parametrize("depth", [1, 64])
def test_a_program_that_reads_late_gets_all_it_asked_for(depth: int) -> None:
    """More than waits for it at any time."""
    size = len(Codec().encode(QueryActionResponse(1, "", big_action().steps)))

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            await board.request(big_action())
            with RawLine(raw_socket()) as line:
                session = (await line.greet())["session"]
                sending = asyncio.ensure_future(line.send(Codec().encode(QueryActionRequest(1)) * 200))
                await until(lambda: hub.programs[session].queue.is_unread)
                for _round in range(20):
                    assert await board.servo_ids() == (1, 2, 3)
                assert len(await line.until(200 * size)) == 200 * size
                await sending

    on_hub(use, depth=depth)


def test_garbage_is_counted_and_the_next_frame_is_answered() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with RawLine(raw_socket()) as line:
                session = (await line.greet())["session"]
                for _piece in range(50):
                    await line.send(os.urandom(65536).replace(b"\x13", b""))
                await line.send(LIST)
                assert await line.until(len(ANSWER)) == ANSWER
                assert hub.programs[session].garbage > 50 * 60_000

    on_hub(use)


def test_requests_of_a_flood_are_all_answered_in_order() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with RawLine(raw_socket()) as line:
                await line.greet()
                sending = asyncio.ensure_future(line.send(LIST * 2000))
                assert await line.until(len(ANSWER) * 2000) == ANSWER * 2000
                await sending

    on_hub(use)
