"""A connection with a real broker.

Modules: servolink.fleet.broker, servolink.fleet.broker_messages, servolink.fleet.mqtt_client.
"""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import ConnectionLost, OpenError
from servolink.fleet import broker as module
from servolink.fleet import mqtt_client
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker import BrokerConnection, Denied, explain
from servolink.fleet.broker_messages import Publication, Received
from servolink.fleet.mqtt_client import MqttOptions
from tests.fleet.bridged import LIMIT
from tests.fleet.mosquitto import OPEN, Broker, needs_broker
from tests.fleet.proxy import proxy_to

pytestmark = needs_broker


@asynccontextmanager
async def running(connection: BrokerConnection) -> AsyncIterator[BrokerConnection]:
    """Run a connection that is connected."""
    task = asyncio.create_task(connection.run())
    connected = asyncio.create_task(connection.until_connected())
    try:
        await asyncio.wait((task, connected), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            await task
        yield connection
    finally:
        for each in (task, connected):
            each.cancel()
        with suppress(asyncio.CancelledError, OpenError):
            await task


def connection_to(url: str, name: str = "test", **options: Any) -> BrokerConnection:
    return BrokerConnection(BrokerAccess.of(url), MqttOptions(name, **options))


def socket_of(connection: BrokerConnection) -> Any:
    """Return the socket of a connection, to lose it."""
    assert connection._client is not None
    return connection._client.socket


def limited(test: Callable[..., Awaitable[None]], *arguments: Any) -> None:
    async def run() -> None:
        async with asyncio.timeout(LIMIT):
            await test(*arguments)

    asyncio.run(run())


def test_a_message_arrives_with_all_that_belongs_to_it(broker: Broker) -> None:
    async def test() -> None:
        heard: asyncio.Queue[Received] = asyncio.Queue()
        connection = connection_to(broker.url)
        connection.on_message = heard.put_nowait
        connection.subscriptions = [("servolink/rex/cmd", 1)]
        async with running(connection):
            await connection.send(Publication("servolink/rex/cmd", b"{}", 1, False, 9, "servolink/rex/result", b"\x01"))
            message = await heard.get()
        assert message[:5] == ("servolink/rex/cmd", b"{}", 1, False, False)
        assert message.expiry in {8, 9}
        assert message[7:] == ("servolink/rex/result", b"\x01")

    limited(test)


def test_what_is_not_acknowledged_is_delivered_again(broker: Broker) -> None:
    async def test() -> None:
        heard: asyncio.Queue[Received] = asyncio.Queue()
        for times in range(2):
            connection = connection_to(broker.url, session_seconds=60, acknowledges=True)
            connection.on_message = heard.put_nowait
            connection.subscriptions = [("t", 1)]
            async with running(connection):
                if not times:
                    await connection.send(Publication("t", b"once", 1))
                message = await heard.get()
                assert (message.payload, message.is_duplicate) == (b"once", bool(times))
                if times:
                    connection.acknowledge(message)
        connection = connection_to(broker.url, session_seconds=60)
        connection.on_message = heard.put_nowait
        async with running(connection):
            await connection.send(Publication("t", b"other", 1))
            assert (await heard.get()).payload == b"other"

    limited(test)


def test_the_will_is_sent_for_a_connection_that_is_lost(broker: Broker) -> None:
    async def test() -> None:
        heard: asyncio.Queue[Received] = asyncio.Queue()
        listener = connection_to(broker.url, "listener")
        listener.on_message = heard.put_nowait
        listener.subscriptions = [("gone", 1)]
        async with running(listener):
            lost = connection_to(broker.url, will=Publication("gone", "offline", 1, True, content_type="text/plain"))
            async with running(lost):
                socket_of(lost).shutdown(socket.SHUT_RDWR)
                assert (await heard.get()).payload == b"offline"

    limited(test)


def test_a_connection_that_is_lost_while_it_begins_does_not_wait_for_answers(broker: Broker) -> None:
    async def test() -> None:
        begun = asyncio.Event()

        async def begin() -> None:
            begun.set()
            await asyncio.Event().wait()

        connection = connection_to(broker.url)
        connection.on_connect = begin
        connecting = asyncio.create_task(connection.run())
        await begun.wait()
        broker.end(signal.SIGKILL)
        with pytest.raises(OpenError, match="the connection was lost"):
            await connecting

    limited(test)


def test_a_connection_that_is_lost_while_it_sends_leaves_nothing_behind(broker: Broker) -> None:
    async def test() -> None:
        told: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: told.append(context))
        async with running(connection_to(broker.url)) as connection:
            sending = asyncio.create_task(connection.send(Publication("t", b"x", 1)))
            broker.pause()
            await asyncio.sleep(0)  # it is to be written now
            socket_of(connection).shutdown(socket.SHUT_RDWR)
            with pytest.raises(ConnectionLost):
                await sending
        broker.pause(paused=False)
        assert not told

    limited(test)


def test_a_connection_comes_back_after_the_broker(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FIRST_PAUSE", 0.01)

    async def test() -> None:
        states: asyncio.Queue[bool] = asyncio.Queue()
        texts: list[str] = []
        heard: asyncio.Queue[Received] = asyncio.Queue()
        connection = connection_to(broker.url)

        def tell(is_connected: bool, text: str) -> None:
            states.put_nowait(is_connected)
            texts.append(text)

        connection.on_state = tell
        connection.on_message = heard.put_nowait
        connection.subscriptions = [("t", 0)]
        async with running(connection):
            assert await states.get() is True
            broker.end(signal.SIGKILL)
            assert await states.get() is False
            assert texts[-1] == f"{broker.url}: the connection was lost"
            with pytest.raises(ConnectionLost):
                await connection.send(Publication("t", b"x", 1))
            broker.start()
            while not await states.get():
                pass
            await connection.send(Publication("t", b"back"))
            assert (await heard.get()).payload == b"back"

    limited(test)


def test_denied_topics_are_named_once(tmp_path: Path) -> None:
    access = tmp_path / "acl"
    access.write_text("topic read servolink/#\ntopic write servolink/+/state\n", encoding="utf-8")
    broker = Broker(tmp_path, [*OPEN, f"acl_file {access}"])
    broker.start()

    async def test() -> None:
        told: list[str] = []
        connection = connection_to(broker.url)
        connection.on_problem = told.append
        connection.subscriptions = [("servolink/rex/cmd", 1)]
        async with running(connection):
            await connection.send(Publication("servolink/rex/state", b"", 1))
            for _ in range(2):
                with pytest.raises(Denied, match="servolink/rex/event: not authorized"):
                    await connection.send(Publication("servolink/rex/event", b"", 1))
        (text,) = told
        assert text.startswith("the broker does not allow writing to servolink/rex/event: not authorized; correct its")
        assert text.endswith("docs/how-to/fleet-classroom.md has changed, with the topics of answers")

    limited(test)


def test_a_broker_that_refuses_is_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    broker = Broker(tmp_path, ["allow_anonymous false"])
    broker.start()

    async def test() -> None:
        with pytest.raises(OpenError, match="does not let this program in: correct user and password"):
            await connection_to(broker.url).run()
        broker.end()
        with pytest.raises(OpenError, match="no broker listens there"):
            await connection_to(broker.url).run()

    limited(test)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (socket.gaierror(-2, "Name or service not known"), "there is no host of this name: correct the name"),
        (ConnectionRefusedError(111, "Connection refused"), "no broker listens there (Connection refused): start it"),
        (OSError(113, "No route to host"), "No route to host"),
        (TimeoutError(), "no answer: check the address"),
    ],
)
def test_an_error_of_the_system_is_said_without_its_number(error: Exception, text: str) -> None:
    assert explain(error).startswith(text)


def test_a_message_does_not_wait_for_the_confirmation_of_the_one_before(broker: Broker) -> None:
    async def test() -> None:
        async with running(connection_to(broker.url)) as connection:
            assert socket_of(connection).getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)

    limited(test)


@pytest.mark.parametrize(
    "junk", [b"\x20\x03\x00\x00\xff", b"\x20\xff\xff\xff\xff\x7f", b"HTTP/1.1 400 Bad Request\r\n\r\n"]
)
def test_a_server_that_speaks_something_else_is_an_error(junk: bytes) -> None:
    async def answer(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(junk)
        writer.close()

    async def test() -> None:
        async with await asyncio.start_server(answer, "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            with pytest.raises(OpenError, match=f"^mqtt://127.0.0.1:{port}: "):
                await connection_to(f"mqtt://127.0.0.1:{port}").run()

    limited(test)


def test_a_confirmation_that_the_broker_drops_does_not_silence_the_program(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_client, "_LIMIT", 0.5)
    lost: asyncio.Queue[str] = asyncio.Queue()

    async def test() -> None:
        async with proxy_to(broker) as proxy:
            connection = connection_to(proxy.url)
            connection.on_state = lambda is_connected, text: None if is_connected else lost.put_nowait(text)
            async with running(connection):
                proxy.loses_confirmations = True
                with pytest.raises(ConnectionLost, match="the broker has not answered"):
                    await connection.send(Publication("t", b"one", 1))
                proxy.loses_confirmations = False
                assert (await lost.get()).endswith("the broker has not answered for 0.5 s")
                await connection.until_connected()
                await connection.send(Publication("t", b"two", 1))
            assert (proxy.connections, lost.empty()) == (2, True)

    limited(test)


def test_messages_that_come_at_once_stay_in_order(broker: Broker) -> None:
    async def test() -> None:
        heard: list[bytes] = []
        connection = connection_to(broker.url)
        connection.on_message = lambda message: heard.append(message.payload)
        connection.subscriptions = [("t", 1)]
        payloads = [str(number).encode() * 500 for number in range(300)]
        async with running(connection):
            await asyncio.gather(*(connection.send(Publication("t", payload, 1)) for payload in payloads))
            await connection.send(Publication("t", b"last", 1))
            async with asyncio.timeout(LIMIT):
                while heard[-1:] != [b"last"]:
                    await asyncio.sleep(0)
        assert heard == [*payloads, b"last"]

    limited(test)
