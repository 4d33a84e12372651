"""Hostile programs at the control interface: each gets errors or is disconnected, and nobody else notices.

Modules: servolink.control.messages, servolink.hub.method_messages, servolink.hub.methods.control_session.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from servolink.control import Greeting
from servolink.hub.hub import Hub
from servolink.hub.method_messages import CREDIT
from servolink.hub.methods.control_session import METHODS, ControlInterface
from tests.hub.control_program import shared
from tests.hub.door_hub import RawLine, on_hub, raw_socket, sharing, until
from tests.virtual_time import run

_IDS = st.integers(-2, 300) | st.sampled_from(["all", "hip", "", "name:1", "\u202e", "\udcff"])
_VALUES = st.one_of(
    st.none(),
    st.booleans(),
    _IDS,
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([2**31, 2**64, 10**400, -1, "action", "macro", "joystick_table"]),
    st.dictionaries(_IDS.map(str), st.integers(-400, 400) | st.floats(-1e9, 1e9), max_size=3),
    st.just({"schema": 1}),
    st.just({"schema": 1, "actions": [{"action_id": 1, "steps": [{"servo_id": 1, "degree": 5, "interval_ms": 10}]}]}),
)
_NAMES = sorted({field for method in METHODS.values() for field in getattr(method.params, "__struct_fields__", ())})
_CALLS = st.tuples(
    st.sampled_from(sorted(METHODS)),
    st.dictionaries(st.sampled_from([*_NAMES, "type", "record"]), _VALUES, max_size=4),
)


async def test_programs_of_a_group_read_as_one() -> None:
    async with shared() as here:
        groups: list[Any] = ["a link", "a link", "another", UNSET, UNSET]
        channels = [
            here.interface.open_channel(
                here.hub, Greeting(wants="rpc", who="x", group=group), str(number), lambda _: None, pytest.fail
            )
            for number, group in enumerate(groups)
        ]
        shares = [channel._peer._reading for channel in channels]
        assert shares[0] is shares[1]
        assert len({id(share) for share in shares}) == 4
        for channel in channels:
            await channel.close()


@settings(max_examples=25)
@given(st.lists(_CALLS, max_size=15))
def test_no_params_break_a_method(calls: list[tuple[str, dict[str, Any]]]) -> None:
    async def main() -> None:
        async with shared() as here:
            sent: list[dict[str, Any]] = []
            greeting = Greeting(wants="rpc", who="x")
            channel = here.interface.open_channel(
                here.hub, greeting, "x", lambda message: sent.append(json.loads(message)), pytest.fail
            )
            for number, (method, params) in enumerate(calls):
                channel.receive(json.dumps({"jsonrpc": "2.0", "id": number, "method": method, "params": params}))
            await channel.close()
            assert not [each for each in sent if each.get("error", {}).get("code") == -32603]
            async with here.program("other") as other:
                assert (await other.call("status"))["lease"] is None
                await other.call("servo.set", servo="all", start=True, hold=True)
                await other.call("move", targets={"1": 10}, duration=0.1, wait=True)

    run(main())


@settings(max_examples=25)
@given(_CALLS)
def test_a_method_ends_with_a_result_or_an_error(call: tuple[str, dict[str, Any]]) -> None:
    async def main() -> None:
        async with shared() as here, here.program("x") as program:
            message = {"jsonrpc": "2.0", "id": 1, "method": call[0], "params": call[1]}
            sent: list[dict[str, Any]] = []
            program.channel._peer._send = lambda message: sent.append(json.loads(message))
            program.channel.receive(json.dumps(message))
            for _ in range(100):
                if any("id" in each for each in sent if "method" not in each):
                    break
                await asyncio.sleep(10)
            (answer,) = [each for each in sent if "method" not in each]
            assert "result" in answer or answer["error"]["code"] != -32603

    run(main())


def on_socket(use: Callable[[Hub, RawLine], Awaitable[None]]) -> None:
    """Run `use` with a program that has greeted the hub and speaks JSON-RPC, and see that others are served."""

    async def main(hub: Hub, virtual: object) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel):
            with raw_socket() as line, raw_socket() as other:
                program, witness = RawLine(line), RawLine(other)
                assert "session" in await program.greet(wants="rpc")
                assert "session" in await witness.greet(wants="rpc")
                await use(hub, program)
                await witness.send(b'{"jsonrpc": "2.0", "id": "witness", "method": "board.state"}\n')
                assert b'"witness"' in await witness.read()
        await interface.close()

    on_hub(main)


def test_garbage_gets_one_error_a_line() -> None:
    async def main(hub: Hub, program: RawLine) -> None:
        await program.send(b"nonsense\n\n  \r\n\xff\xfe\n" + b"[" * 90_000 + b"\n" + b"{}\n")
        answers = b""
        while answers.count(b"\n") < 4:
            answers += await program.read()
        codes = [json.loads(answer)["error"]["code"] for answer in answers.splitlines()]
        assert sorted(codes) == [-32700, -32700, -32700, -32600]  # a long line is read in a thread

    on_socket(main)


def test_a_line_without_end_is_cut_off() -> None:
    async def main(hub: Hub, program: RawLine) -> None:
        with suppress(OSError):  # disconnected while it was sending
            await program.send(b"x" * (3 << 20))
        assert await program.until_end() == b""

    on_socket(main)


def test_who_asks_and_does_not_read_is_disconnected() -> None:
    async def main(hub: Hub, program: RawLine) -> None:
        request = b'{"jsonrpc": "2.0", "id": 1, "method": "status"}\n'
        taken = 0
        with suppress(OSError):
            while taken < 1_000_000:
                await program.send(request * 100)
                taken += 100
        assert taken < 1_000_000
        await until(lambda: len(hub.programs) == 1)

    on_socket(main)


def test_who_watches_and_does_not_read_costs_little() -> None:
    async def main(hub: Hub, program: RawLine) -> None:
        for number in range(200):
            call = {"jsonrpc": "2.0", "id": number, "method": "servos.watch", "params": {"hz": 200}}
            await program.send(json.dumps(call).encode() + b"\n")
        heard = b""
        while heard.count(b'"busy"') + heard.count(b'"credit"') < 200:
            heard += await program.read()
        while b'"method":"servos"' not in heard:
            heard += await program.read()
        assert heard.count(b'"number":') <= CREDIT * heard.count(b'"credit"')

    on_socket(main)
